//! Interpolation of corner values over an element: linear, or smooth towards the corners.
//!
//! Linear: the shape functions of the linear element; r are the parameters of the cube, l barycentric coordinates.
//! Smooth is `Smoothstep`, with S(t) = t^2 (3 - 2 t): on the cube the shape functions of S(r), whose slope across the
//! faces vanishes; on the tet S(l) / sum S(l); on the wedge the latter in the triangle times S along the prism. In each
//! case the values on a face depend on the face's corners alone and are the same from both sides, and the functions are
//! positive and sum to one. Planar elements count as prisms, of 6 and 8 corners. [`Interpolation::Smooth`] has control
//! points instead of corners and does not come here.

use super::Interpolation;
use crate::scaffold::Kind;
use druse_geometry::frame::{CellPoint, Element, Vec3};

/// The corner functions of an element at a point, with gradients in the cell frame, in VTK order.
pub(super) struct CornerFunctions {
    pub count: usize,
    pub values: [f64; 8],
    pub slopes: [Vec3; 8],
}

const TRIANGLE_HEIGHT: f64 = 0.866_025_403_784_438_6;

fn smoothstep(t: f64) -> (f64, f64) {
    let t = t.clamp(0.0, 1.0);
    (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t))
}

/// Smooth barycentric functions S(l) / sum S(l).
fn rational<const N: usize>(l: [f64; N], slopes: [Vec3; N]) -> ([f64; N], [Vec3; N]) {
    let s = l.map(smoothstep);
    let sum: f64 = s.iter().map(|s| s.0).sum();
    let mut change = Vec3::zeros();
    for (s, g) in s.iter().zip(slopes) {
        change += g * s.1;
    }
    let mut values = [0.0; N];
    let mut out = [Vec3::zeros(); N];
    for i in 0..N {
        values[i] = s[i].0 / sum;
        out[i] = (slopes[i] * s[i].1 - change * values[i]) / sum;
    }
    (values, out)
}

impl CornerFunctions {
    /// The corners' functions and their gradients at a point xi of the element. Their sum is 1; in the cell they are
    /// not negative. Entries after `count` are 0. A pyramid has the linear functions in any case.
    pub fn at(shape: Element, CellPoint(xi): CellPoint<3>, interpolation: Interpolation) -> Self {
        let mut c = Self {
            count: 0,
            values: [0.0; 8],
            slopes: [Vec3::zeros(); 8],
        };
        let line = |t: f64| match interpolation {
            Interpolation::Smoothstep => smoothstep(t),
            Interpolation::Linear | Interpolation::Smooth => (t, 1.0),
        };
        match shape {
            Element::Tet => {
                // Face planes n.x = 1/2 opposite the vertices: l = (1/2 - n.x) / 2.
                let n =
                    [[1., 1., 1.], [-1., -1., 1.], [1., -1., -1.], [-1., 1., -1.]].map(Vec3::from);
                let l = n.map(|n| (0.5 - n.dot(&xi)) / 2.0);
                let g = n.map(|n| n * -0.5);
                let (l, g) = match interpolation {
                    Interpolation::Smoothstep => rational(l, g),
                    Interpolation::Linear | Interpolation::Smooth => (l, g),
                };
                c.values[..4].copy_from_slice(&l);
                c.slopes[..4].copy_from_slice(&g);
                c.count = 4;
            }
            Element::Wedge | Element::Tri => {
                // Functions of the triangle's corners times those along the prism's axis, linear or smooth.
                let (x, y) = (xi.x + 0.5, xi.y + TRIANGLE_HEIGHT / 3.0);
                let l2 = y / TRIANGLE_HEIGHT;
                let l1 = x - l2 / 2.0;
                let g2 = Vec3::y() / TRIANGLE_HEIGHT;
                let g1 = Vec3::x() - g2 / 2.0;
                let (l, g) = ([1.0 - l1 - l2, l1, l2], [-g1 - g2, g1, g2]);
                let (l, g) = match interpolation {
                    Interpolation::Smoothstep => rational(l, g),
                    Interpolation::Linear | Interpolation::Smooth => (l, g),
                };
                let (t, dt) = line(xi.z + 0.5);
                for (layer, (h, dh)) in [(1.0 - t, -dt), (t, dt)].into_iter().enumerate() {
                    for i in 0..3 {
                        c.values[3 * layer + i] = l[i] * h;
                        c.slopes[3 * layer + i] = g[i] * h + Vec3::z() * (l[i] * dh);
                    }
                }
                c.count = 6;
            }
            Element::Pyramid => {
                let kind = Kind::Pyramid5;
                let point = CellPoint(xi);
                c.values[..5].copy_from_slice(&kind.shape_functions(point));
                c.slopes[..5].copy_from_slice(&kind.shape_gradients(point));
                c.count = 5;
            }
            // A ball is interpolated as the cube around it.
            Element::Hex | Element::Quad | Element::Ball => {
                let [(x, dx), (y, dy), (z, dz)] = [xi.x, xi.y, xi.z].map(|t| line(t + 0.5));
                let ends = |t: f64, d: f64| [(1.0 - t, -d), (t, d)];
                let (xs, ys, zs) = (ends(x, dx), ends(y, dy), ends(z, dz));
                for (v, corner) in Kind::Hex8.lattice().iter().enumerate() {
                    let [i, j, k] = corner.map(usize::from);
                    let ((a, da), (b, db), (d, dd)) = (xs[i], ys[j], zs[k]);
                    c.values[v] = a * b * d;
                    c.slopes[v] = Vec3::new(da * b * d, a * db * d, a * b * dd);
                }
                c.count = 8;
            }
        }
        c
    }

    /// Interpolates corner values.
    pub fn of(&self, values: impl Fn(usize) -> f64) -> (f64, Vec3) {
        let mut sum = (0.0, Vec3::zeros());
        for v in 0..self.count {
            let at = values(v);
            sum.0 += self.values[v] * at;
            sum.1 += self.slopes[v] * at;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_one_at_their_corner_and_sum_to_one() {
        for shape in [Element::Tet, Element::Hex, Element::Wedge, Element::Pyramid] {
            for interpolation in [Interpolation::Linear, Interpolation::Smoothstep] {
                for (i, v) in shape.vertices().into_iter().enumerate() {
                    let c = CornerFunctions::at(shape, CellPoint(v), interpolation);
                    for j in 0..c.count {
                        let expected = f64::from(u8::from(i == j));
                        assert!(
                            (c.values[j] - expected).abs() < 1e-12,
                            "{shape:?} {interpolation:?}"
                        );
                    }
                }
                let x = shape.centroid().0 + Vec3::new(0.07, -0.05, 0.03);
                let c = CornerFunctions::at(shape, CellPoint(x), interpolation);
                assert!((c.of(|_| 1.0).0 - 1.0).abs() < 1e-12);
                assert!(c.of(|_| 1.0).1.norm() < 1e-12);
                let value = |i: usize| (i * i) as f64;
                let h = 1e-6;
                for axis in 0..3 {
                    let at = |s: f64| {
                        let x = CellPoint(x + Vec3::ith(axis, s * h));
                        CornerFunctions::at(shape, x, interpolation).of(value).0
                    };
                    let slope = (at(1.0) - at(-1.0)) / (2.0 * h);
                    assert!(
                        (slope - c.of(value).1[axis]).abs() < 1e-8,
                        "{shape:?} {interpolation:?}"
                    );
                }
            }
        }
    }
}
