//! The inverse map of a curved element: Newton's method for the continued map, for one point or a row of points.
//!
//! Outside an element its map is continued linearly from the nearest point of the closed cell
//! ([`Preimage`](super::patch::Preimage)). A step from the point c of the closed cell goes to xi = c + J(c)^-1 (x - M(c));
//! the next one starts at the closest point of the cell. Inside, convergence is quadratic.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::clamp::{clamp_row, face_distance_row};
use crate::scaffold::{ElementMap, Polynomial};
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use druse_geometry::simd::{Eight, Lanes, Number, difference, splat_vector};

/// Newton steps for a row of points. Points that need more steps are searched for one by one.
const MAX_STEPS: usize = 12;

/// Greatest magnitude of reference coordinates; greater ones, and none, show a singular map.
const MAX_COORDINATE: f64 = 1e9;

/// Rows of a matrix.
pub(super) type Matrix<T> = [[T; 3]; 3];

/// The map of a curved element.
#[derive(Clone, Copy)]
pub(super) struct CurvedMap<'a> {
    element: ElementMap<'a>,
    /// The map in powers of xi, if it is a polynomial.
    polynomial: Option<&'a Polynomial>,
    shape: Element,
}

/// The result of a Newton step from a point of the closed cell.
pub(super) struct Step<T> {
    /// The world position of that point.
    pub from: [T; 3],
    /// Reference coordinates at the end of the step.
    pub xi: [T; 3],
    /// d xi / d x at that point, by rows.
    pub inverse: Matrix<T>,
}

/// The last steps towards a row of points.
pub(super) struct StepRow<T> {
    pub step: Step<T>,
    /// Largest signed distance to the faces in reference coordinates.
    pub face_distance: T,
    /// The points that have converged, a bit each.
    pub converged: u8,
}

// No SIMD arithmetic is written in closures: they are not inlined into a caller compiled for the processor.

/// a . b + c.
#[inline(always)]
pub(super) fn dot<T: Number>(a: [T; 3], b: [T; 3], c: T) -> T {
    a[0].fused(b[0], a[1].fused(b[1], a[2].fused(b[2], c)))
}

/// m a + c.
#[inline(always)]
pub(super) fn product<T: Number>(m: Matrix<T>, a: [T; 3], c: [T; 3]) -> [T; 3] {
    [dot(m[0], a, c[0]), dot(m[1], a, c[1]), dot(m[2], a, c[2])]
}

/// A matrix in every lane, by rows.
#[inline(always)]
pub(super) fn matrix_rows<T: Number>(m: &Mat3, lane: T) -> Matrix<T> {
    [
        splat_vector(lane, [m[0], m[3], m[6]]),
        splat_vector(lane, [m[1], m[4], m[7]]),
        splat_vector(lane, [m[2], m[5], m[8]]),
    ]
}

#[inline(always)]
fn scaled<T: Number>(a: [T; 3], by: T) -> [T; 3] {
    [a[0] * by, a[1] * by, a[2] * by]
}

#[inline(always)]
fn cross<T: Number>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// The inverse, by the adjugate; not finite for a singular matrix.
#[inline(always)]
fn inverse<T: Number>([a, b, c]: Matrix<T>) -> Matrix<T> {
    let (bc, ca, ab) = (cross(b, c), cross(c, a), cross(a, b));
    let reciprocal = a[0].splat(1.0) / dot(a, bc, a[0].splat(0.0));
    let (p, q, r) = (
        scaled(bc, reciprocal),
        scaled(ca, reciprocal),
        scaled(ab, reciprocal),
    );
    [[p[0], q[0], r[0]], [p[1], q[1], r[1]], [p[2], q[2], r[2]]]
}

/// The last step within the closed cell, reference units, below which Newton's method has converged, from the distance
/// of its end outside the cell. Inside, the next step would be about the square of this one. Outside, convergence is
/// linear: each step is a small fraction (curvature times distance) of the previous one. On the faces the last digit
/// decides which element owns a point.
#[inline(always)]
pub(super) fn convergence_tolerance<T: Number>(face_distance: T, for_f32: bool) -> T {
    let (rough, fine) = (face_distance.splat(1e-6), face_distance.splat(1e-9));
    let zero = face_distance.splat(0.0);
    if !for_f32 {
        return zero.select_below(face_distance, fine, rough);
    }
    // Away from the faces, on both sides, values in single precision do not show the error.
    let near_face = face_distance.splat(1e-3);
    let outside = near_face.select_below(face_distance, rough, fine);
    let inside = face_distance.select_below(zero - near_face, face_distance.splat(1e-4), rough);
    zero.select_below(face_distance, outside, inside)
}

impl<'a> CurvedMap<'a> {
    pub fn new(element: ElementMap<'a>) -> Self {
        Self {
            element,
            polynomial: element.polynomial(),
            shape: element.shape(),
        }
    }

    /// The world point and its derivatives by xi, by rows.
    #[inline(always)]
    fn evaluate<T: Number>(&self, xi: [T; 3]) -> ([T; 3], Matrix<T>) {
        if let Some(polynomial) = self.polynomial {
            return polynomial.evaluate(xi);
        }
        // Pyramids, point by point.
        let at = |xi: [f64; 3]| self.element.map_and_jacobian(CellPoint(xi.into()));
        let row = |r: usize| {
            T::map_points(xi, |xi| {
                let jacobian = at(xi).1;
                [jacobian[(r, 0)], jacobian[(r, 1)], jacobian[(r, 2)]]
            })
        };
        (
            T::map_points(xi, |xi| at(xi).0.0.into()),
            [row(0), row(1), row(2)],
        )
    }

    /// The world point at `xi` by the continued map, and d xi / d x there.
    #[inline(always)]
    pub fn point_and_inverse<T: Number>(&self, xi: [T; 3]) -> ([T; 3], Matrix<T>) {
        let inside = clamp_row(self.shape, xi);
        let (from, jacobian) = self.evaluate(inside);
        let point = product(jacobian, difference(xi, inside), from);
        (point, inverse(jacobian))
    }

    /// Refines an estimate `at` of the preimage of `x`, and the estimate `inverse` of d xi / d x, by one Newton step.
    #[inline(always)]
    pub fn refine<T: Number>(
        &self,
        x: [T; 3],
        at: [T; 3],
        mut inverse: Matrix<T>,
    ) -> ([T; 3], Matrix<T>) {
        // Start from the clamped point, where the Jacobian is regular.
        let step = self.step(x, clamp_row(self.shape, at));
        let mut to = at;
        // Where the map is singular, the estimates remain.
        let limit = x[0].splat(MAX_COORDINATE);
        let magnitude = step.xi[0].abs() + step.xi[1].abs() + step.xi[2].abs();
        for (to, found) in to.iter_mut().zip(step.xi) {
            *to = magnitude.select_below(limit, found, *to);
        }
        for (row, found) in inverse.iter_mut().zip(step.inverse) {
            for (to, found) in row.iter_mut().zip(found) {
                *to = magnitude.select_below(limit, found, *to);
            }
        }
        (to, inverse)
    }

    /// A Newton step towards `x` from `at`, a point of the closed cell.
    #[inline(always)]
    fn step<T: Number>(&self, x: [T; 3], at: [T; 3]) -> Step<T> {
        let (from, jacobian) = self.evaluate(at);
        let inverse = inverse(jacobian);
        Step {
            from,
            xi: product(inverse, difference(x, from), at),
            inverse,
        }
    }

    /// Newton's method for a row of points from an estimate of their preimages, for values in single precision, until
    /// the points of `needed`, a bit each, have converged. Where the map is singular they do not.
    #[inline(always)]
    pub fn preimages<L: Lanes>(
        &self,
        x: [Eight<L>; 3],
        estimate: [Eight<L>; 3],
        needed: u8,
    ) -> StepRow<Eight<L>> {
        let mut at = clamp_row(self.shape, estimate);
        let mut steps = 0;
        loop {
            let step = self.step(x, at);
            let next = clamp_row(self.shape, step.xi);
            let face_distance = face_distance_row(self.shape, step.xi);
            let [a, b, c] = difference(next, at);
            let moved = a.abs().max(b.abs()).max(c.abs());
            let [x, y, z] = &step.xi;
            let limit = moved.splat(MAX_COORDINATE);
            let is_finite =
                x.abs().bits_below(limit) & y.abs().bits_below(limit) & z.abs().bits_below(limit);
            let converged =
                is_finite & moved.bits_below(convergence_tolerance(face_distance, true));
            steps += 1;
            if needed & !converged == 0 || steps == MAX_STEPS {
                return StepRow {
                    step,
                    face_distance,
                    converged,
                };
            }
            at = next;
        }
    }

    /// [`LocalMap::second_derivatives`](super::local_map::LocalMap::second_derivatives) at a reference point, from
    /// d xi / d x there; none if the map is no polynomial.
    #[inline(always)]
    pub fn second_derivatives<T: Number>(
        &self,
        at: [T; 3],
        inverse: Matrix<T>,
    ) -> Option<[[T; 3]; 6]> {
        let zero = at[0].splat(0.0);
        let all = self.polynomial?.second_derivatives(at);
        let forms = [
            transformed(all[0], inverse),
            transformed(all[1], inverse),
            transformed(all[2], inverse),
        ];
        // d2 xi / dx_j dx_k = -J^-1 (H_c(a_j, a_k)), by coordinates c: H_c are those of x, a_j the columns of J^-1.
        let mut found = [[zero; 3]; 6];
        for (n, to) in found.iter_mut().enumerate() {
            let factor = zero.splat(if n < 3 { -0.5 } else { -1.0 });
            let form = [forms[0][n], forms[1][n], forms[2][n]];
            *to = product(inverse, scaled(form, factor), [zero; 3]);
        }
        Some(found)
    }

    /// k: expansions of second order about points of the element err by at most k r^3 at the distance r, world units,
    /// where the way between both points is in the element. k is per square world unit; infinite for pyramids, and where
    /// no least stretch is proved.
    pub fn expansion_factor(&self) -> f64 {
        let Some(polynomial) = self.polynomial else {
            return f64::INFINITY;
        };
        let vertices = self.shape.vertices();
        let reach = vertices.iter().map(Vec3::amax).fold(0.0, f64::max);
        let [second, third] = polynomial.derivative_bounds(reach);
        // |D^3 xi| <= 3 |J^-1|^5 |D^2 x|^2 + |J^-1|^4 |D^3 x|: the derivative of -J^-1 D^2 x (J^-1, J^-1).
        let (least, greatest) = self.element.stretch();
        let third = 3.0 * second.powi(2) / least.powi(5) + third / least.powi(4);
        // The remainder of Taylor's formula in xi, times the greatest stretch.
        greatest * third / 6.0
    }
}

/// The values `h(a_j, a_k)` of a symmetric form at the columns of a matrix: xx, yy, zz, xy, yz, zx.
#[inline(always)]
fn transformed<T: Number>([xx, yy, zz, xy, yz, zx]: [T; 6], matrix: Matrix<T>) -> [T; 6] {
    let zero = xx.splat(0.0);
    let form = [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]];
    let [p, q, r] = matrix;
    let (x, y, z) = ([p[0], q[0], r[0]], [p[1], q[1], r[1]], [p[2], q[2], r[2]]);
    let (hx, hy, hz) = (
        product(form, x, [zero; 3]),
        product(form, y, [zero; 3]),
        product(form, z, [zero; 3]),
    );
    [
        dot(x, hx, zero),
        dot(y, hy, zero),
        dot(z, hz, zero),
        dot(x, hy, zero),
        dot(y, hz, zero),
        dot(z, hx, zero),
    ]
}

#[cfg(test)]
mod tests {
    use super::CurvedMap;
    use crate::scaffold::{Connectivity, Kind, Scaffold};
    use crate::tiling::local_map::LocalMap;
    use druse_geometry::frame::{CellPoint, Mat3, Vec3};

    #[test]
    fn expansions_are_of_second_order_within_their_bound() {
        let kinds = [
            Kind::Tet10,
            Kind::Hex8,
            Kind::Hex20,
            Kind::Hex27,
            Kind::Wedge6,
            Kind::Wedge15,
        ];
        for kind in kinds {
            let wave = |p: Vec3| Vec3::new(p.y * p.z + p.y * p.y, p.z * p.x, p.x * p.y - p.z * p.z);
            let nodes = kind.reference_nodes();
            let nodes = Vec::from_iter(nodes.iter().map(|p| (p.0 + 0.1 * wave(p.0)) * 40.0));
            let mut elements = Connectivity::default();
            elements.push(kind, &Vec::from_iter(0..nodes.len() as u32));
            let scaffold = Scaffold::new(nodes, elements).unwrap();
            let element = scaffold.element(0);
            let map = CurvedMap::new(element);
            let (bound, mut worst) = (map.expansion_factor(), 0f64);
            for at in element.shape().vertices().into_iter().map(|v| v * 0.5) {
                let (x, inverse) = map.point_and_inverse::<f64>(at.into());
                let inverse = inverse.map(Vec3::from);
                let expansion = LocalMap {
                    x: x.into(),
                    xi: at,
                    inverse: Mat3::from_columns(&inverse).transpose(),
                    second_derivatives: None,
                };
                let expansion = expansion.with_second_derivatives(map);
                // The error of the estimate for the image of a point, world units, and the distance.
                let error = |xi: Vec3| {
                    let x = element.map(CellPoint(xi)).0;
                    let found = element.map(CellPoint(expansion.estimate(x))).0;
                    ((found - x).norm(), (x - expansion.x).norm())
                };
                for toward in element.shape().vertices() {
                    let way = (toward - at) * 0.1;
                    let ((near, r), (nearer, _)) = (error(at + way), error(at + way / 2.0));
                    assert!(near <= bound * r.powi(3), "{kind:?}: {near}, {r}, {bound}");
                    assert!(nearer <= near / 6.0 + 1e-12, "{kind:?}: {nearer}, {near}");
                    worst = worst.max(near / r.powi(3));
                }
            }
            assert!(bound < 100.0 * worst, "{kind:?}: {bound}, {worst}");
        }
    }
}
