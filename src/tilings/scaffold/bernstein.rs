//! Polynomials over the reference cell in Bernstein form, which give rigorous bounds of curved elements.
//!
//! A polynomial over a simplex, cube or prism is a convex combination of its Bernstein coefficients, so their hull
//! contains its range; splitting the cell tightens the hull quadratically. Parametric coordinates r in `[0, 1]^3`:
//! barycentrics (1 - r1 - r2 - r3, r1, r2, r3) on the simplex, both on the prism. The integral is the
//! mean coefficient times the cell's volume.

use super::kind::Family;
use druse_geometry::frame::Vec3;
use nalgebra::DMatrix;
use std::ops::{Add, Mul, Sub};
use std::sync::OnceLock;

/// A coefficient: a number, a vector or a matrix.
pub(super) trait Coefficient:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<f64, Output = Self>
{
}
impl<T> Coefficient for T where T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T> {}

/// A polynomial of the given degree (per axis for cubes, in total for simplices).
#[derive(Clone, Debug)]
pub(super) struct Net<T> {
    pub family: Family,
    pub degree: usize,
    /// First parameter fastest; the simplex keeps i + j + k <= degree.
    pub coefficients: Vec<T>,
}

/// Vertex pairs of the simplex, in the order that numbers its splits.
const SIMPLEX_EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];

/// The exponents of every basis function, in the order of the coefficients.
pub(super) fn lattice(family: Family, degree: usize) -> impl Iterator<Item = [usize; 3]> {
    let n = degree;
    (0..=n).flat_map(move |k| {
        (0..=family.room(n, k)).flat_map(move |j| {
            let last = family.row(n, j, k);
            (0..=last).map(move |i| [i, j, k])
        })
    })
}

/// The index of a basis function among the coefficients.
pub(super) fn index(family: Family, n: usize, [i, j, k]: [usize; 3]) -> usize {
    match family {
        Family::Tensor => i + (n + 1) * (j + (n + 1) * k),
        Family::Simplex => {
            let layer = |m: usize| (m + 1) * (m + 2) * (m + 3) / 6;
            let m = n - k;
            layer(n) - layer(m) + j * (m + 1) - j * j.saturating_sub(1) / 2 + i
        }
        Family::Prism => k * (n + 1) * (n + 2) / 2 + j * (n + 1) - j * j.saturating_sub(1) / 2 + i,
    }
}

pub(super) fn count(family: Family, degree: usize) -> usize {
    let n = degree + 1;
    match family {
        Family::Simplex => n * (n + 1) * (n + 2) / 6,
        Family::Tensor => n * n * n,
        Family::Prism => n * n * (n + 1) / 2,
    }
}

fn binomial(n: usize, k: usize) -> f64 {
    (0..k).fold(1.0, |b, i| b * (n - i) as f64 / (i + 1) as f64)
}

/// The exponents of the triangle's basis functions, with a last one of 0.
fn triangle(degree: usize) -> impl Iterator<Item = [usize; 3]> {
    (0..=degree).flat_map(move |j| (0..=degree - j).map(move |i| [i, j, 0]))
}

/// The inverse of the matrix of Bernstein basis functions at the equidistant lattice: it takes values there to
/// coefficients. On a line for cubes, on the simplex for tets, on the triangle for prisms. Tables are made once, for
/// degrees up to 5. On distinct points the matrix is regular, so that the inverse exists.
fn collocation(family: Family, degree: usize) -> &'static DMatrix<f64> {
    static TABLES: [[OnceLock<DMatrix<f64>>; 6]; 3] = [const { [const { OnceLock::new() }; 6] }; 3];
    TABLES[family as usize][degree].get_or_init(|| {
        let n = degree;
        let at = |i: usize| i as f64 / n.max(1) as f64; // A constant has one point, at 0.
        let basis = match family {
            Family::Tensor => DMatrix::from_fn(n + 1, n + 1, |row, i| {
                // B_i(t) = (n over i) t^i (1 - t)^(n - i), one row for each point.
                let t = at(row);
                binomial(n, i) * t.powi(i as i32) * (1.0 - t).powi((n - i) as i32)
            }),
            Family::Simplex | Family::Prism => {
                let points: Vec<_> = if family == Family::Simplex {
                    lattice(family, n).collect()
                } else {
                    triangle(n).collect()
                };
                DMatrix::from_fn(points.len(), points.len(), |row, column| {
                    // B_ijk = n! / (i! j! k! l!) r_0^i r_1^j r_2^k (1 - r_0 - r_1 - r_2)^l with l = n - i - j - k.
                    let r = points[row].map(at);
                    let l = if n == 0 {
                        1.0
                    } else {
                        1.0 - r[0] - r[1] - r[2]
                    };
                    let [i, j, k] = points[column];
                    binomial(n, i)
                        * binomial(n - i, j)
                        * binomial(n - i - j, k)
                        * r[0].powi(i as i32)
                        * r[1].powi(j as i32)
                        * r[2].powi(k as i32)
                        * l.max(0.0).powi((n - i - j - k) as i32)
                })
            }
        };
        basis
            .try_inverse()
            .expect("Bernstein collocation at distinct points is regular")
    })
}

impl<T: Coefficient> Net<T> {
    /// The polynomial of this degree with these values at the equidistant lattice points. Values are in the order of
    /// the coefficients.
    pub fn interpolating(family: Family, degree: usize, mut values: Vec<T>) -> Self {
        // The coefficients of linear polynomials are their values at the corners.
        if degree == 1 {
            return Self {
                family,
                degree,
                coefficients: values,
            };
        }
        let combine = |c: &DMatrix<f64>, row: usize, get: &dyn Fn(usize) -> T| {
            (1..c.ncols()).fold(get(0) * c[(row, 0)], |s, j| s + get(j) * c[(row, j)])
        };
        // One axis of a cube, or the height of a prism: coefficients replace the values of each line.
        let along = |values: &[T], n: usize, stride: usize| -> Vec<T> {
            let c = collocation(Family::Tensor, degree);
            (0..values.len())
                .map(|at| {
                    let row = at / stride % n;
                    let start = at - row * stride;
                    combine(c, row, &|j| values[start + j * stride])
                })
                .collect()
        };
        match family {
            Family::Simplex => {
                let c = collocation(family, degree);
                values = (0..c.nrows())
                    .map(|row| combine(c, row, &|j| values[j]))
                    .collect();
            }
            Family::Tensor => {
                let n = degree + 1;
                for stride in [1, n, n * n] {
                    values = along(&values, n, stride);
                }
            }
            Family::Prism => {
                let c = collocation(family, degree);
                // Each layer is a triangle; then the layers are combined along the height.
                let layer = c.nrows();
                values = (0..values.len())
                    .map(|at| combine(c, at % layer, &|j| values[at / layer * layer + j]))
                    .collect();
                values = along(&values, degree + 1, layer);
            }
        }
        Self {
            family,
            degree,
            coefficients: values,
        }
    }

    /// The polynomial `f`, from its samples at parametric coordinates.
    pub fn of(family: Family, degree: usize, f: impl Fn(Vec3) -> T) -> Self {
        let scale = 1.0 / degree.max(1) as f64;
        let values = lattice(family, degree)
            .map(|p| f(Vec3::from(p.map(|i| i as f64 * scale))))
            .collect();
        Self::interpolating(family, degree, values)
    }

    /// The mean over the cell.
    pub fn mean(&self) -> T {
        let c = &self.coefficients;
        c[1..].iter().fold(c[0], |s, &x| s + x) * (1.0 / c.len() as f64)
    }

    /// Coefficients at the cell's vertices, which are values of the polynomial, with the vertices.
    pub fn corners(&self) -> Vec<(T, Vec3)> {
        let n = self.degree;
        lattice(self.family, 1)
            .map(|p| {
                let c = self.coefficients[index(self.family, n, p.map(|i| i * n))];
                (c, Vec3::from(p.map(|i| i as f64)))
            })
            .collect()
    }

    /// Both halves of the polynomial, each over its half of the cell as a cell of its own. `way` is an axis of the
    /// cube, an edge of the simplex (in the order 01, 12, 20, 03, 13, 23) or of the prism's triangle (01, 12, 20), or 3
    /// for the prism's axis; an edge is cut in its middle.
    pub fn split(&self, way: usize) -> [Self; 2] {
        let mut halves = [Self::empty(), Self::empty()];
        self.split_into(way, &mut halves);
        halves
    }

    /// An empty polynomial, as a buffer for [`Net::split_into`].
    pub fn empty() -> Self {
        Self {
            family: Family::Simplex,
            degree: 0,
            coefficients: Vec::new(),
        }
    }

    /// As [`Net::split`], into existing buffers.
    pub fn split_into(&self, way: usize, halves: &mut [Self; 2]) {
        for half in &mut *halves {
            half.family = self.family;
            half.degree = self.degree;
        }
        match self.family {
            Family::Tensor => self.split_axis((self.degree + 1).pow(way as u32), halves),
            Family::Prism if way == 3 => {
                self.split_axis((self.degree + 1) * (self.degree + 2) / 2, halves);
            }
            Family::Prism | Family::Simplex => {
                let [a, b] = SIMPLEX_EDGES[way];
                self.move_to_midpoint(b, a, &mut halves[0].coefficients);
                self.move_to_midpoint(a, b, &mut halves[1].coefficients);
            }
        }
    }

    fn split_axis(&self, stride: usize, [low, high]: &mut [Self; 2]) {
        let n = self.degree;
        low.coefficients.clone_from(&self.coefficients);
        high.coefficients.clone_from(&self.coefficients);
        for start in 0..self.coefficients.len() {
            if !(start / stride).is_multiple_of(n + 1) {
                continue;
            }
            let at = |i: usize| start + i * stride;
            // De Casteljau in place: `high` holds the diagonal, `low` collects its first entries.
            for level in 0..=n {
                low.coefficients[at(level)] = high.coefficients[at(0)];
                for i in 0..n - level {
                    high.coefficients[at(i)] =
                        (high.coefficients[at(i)] + high.coefficients[at(i + 1)]) * 0.5;
                }
            }
        }
    }

    /// The coefficients of the same polynomial over the simplex, or the prism by its triangle, whose vertex `gone` has
    /// moved to the middle of its edge to `kept`. `gone` and `kept` are vertices by number; the result replaces
    /// `coefficients`.
    fn move_to_midpoint(&self, gone: usize, kept: usize, coefficients: &mut Vec<T>) {
        let n = self.degree;
        coefficients.clear();
        coefficients.extend(lattice(self.family, n).map(|p| {
            let prism = self.family == Family::Prism;
            // A prism's layers are triangles of their own.
            let (fourth, layer) = if prism { (0, p[2]) } else { (p[2], 0) };
            let mut bary = [n - p[0] - p[1] - fourth, p[0], p[1], fourth];
            let m = bary[gone];
            let total = bary[gone] + bary[kept];
            let scale = 0.5f64.powi(m as i32);
            let mut term = |k: usize| {
                bary[kept] = total - m + k;
                bary[gone] = m - k;
                let place = [bary[1], bary[2], bary[3] + layer];
                let c = self.coefficients[index(self.family, n, place)];
                c * (scale * binomial(m, k))
            };
            let first = term(0);
            (1..=m).fold(first, |s, k| s + term(k))
        }));
    }
}

impl Net<f64> {
    /// Least and greatest coefficient: they bound the polynomial.
    pub fn range(&self) -> (f64, f64) {
        self.coefficients
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &c| {
                (a.min(c), b.max(c))
            })
    }
}

/// A part of the reference cell made by splitting: the vertices it spans, parametric.
#[derive(Clone, Copy, Debug)]
pub(super) enum Part {
    Simplex([Vec3; 4]),
    Tensor(Vec3, Vec3),
    /// Corners of the triangle (third coordinate 0), least and greatest third coordinate.
    Prism([Vec3; 3], [f64; 2]),
}

impl Part {
    /// The whole cell.
    pub fn whole(family: Family) -> Self {
        match family {
            Family::Simplex => Self::Simplex([Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()]),
            Family::Tensor => Self::Tensor(Vec3::zeros(), Vec3::repeat(1.0)),
            Family::Prism => Self::Prism([Vec3::zeros(), Vec3::x(), Vec3::y()], [0.0, 1.0]),
        }
    }

    /// The way to split across the longest extent, which keeps the aspect ratio of the parts bounded.
    pub fn longest_way(&self) -> usize {
        let first_longest = |lengths: &mut dyn Iterator<Item = f64>| {
            let (mut best, mut way) = (0.0, 0);
            for (i, l) in lengths.enumerate() {
                // Of lengths equal to rounding the first.
                if l > best * (1.0 + 1e-9) {
                    (best, way) = (l, i);
                }
            }
            way
        };
        match self {
            // Lengths in the regular tetrahedron, where |(a, b, c)|^2 = a^2 + b^2 + c^2 + ab + bc + ca.
            Self::Simplex(v) => first_longest(&mut SIMPLEX_EDGES.iter().map(|&[a, b]| {
                let d = v[b] - v[a];
                d.norm_squared() + d.x * d.y + d.y * d.z + d.z * d.x
            })),
            Self::Tensor(min, max) => first_longest(&mut (0..3).map(|a| max[a] - min[a])),
            // In the equilateral triangle |(a, b)|^2 = a^2 + b^2 + ab.
            Self::Prism(v, [low, high]) => {
                let side = |a: usize, b: usize| {
                    let d: Vec3 = v[b] - v[a];
                    d.norm_squared() + d.x * d.y
                };
                let along = (high - low).powi(2);
                let lengths = [side(0, 1), side(1, 2), side(2, 0), along];
                first_longest(&mut lengths.into_iter())
            }
        }
    }

    /// Both halves of a part cut across `way`, in the order of [`Net::split`]: an axis of the cube, an edge of the
    /// simplex or of the prism's triangle, or 3 for the prism's axis.
    pub fn split(&self, way: usize) -> [Self; 2] {
        let mut halves = [*self; 2];
        match self {
            Self::Simplex(v) => {
                let [a, b] = SIMPLEX_EDGES[way];
                let middle = (v[a] + v[b]) / 2.0;
                // Each half has the middle in place of one end of the edge.
                for (half, gone) in halves.iter_mut().zip([b, a]) {
                    if let Self::Simplex(w) = half {
                        w[gone] = middle;
                    }
                }
            }
            Self::Tensor(min, max) => {
                let middle = f64::midpoint(min[way], max[way]);
                let (mut high_min, mut low_max) = (*min, *max);
                high_min[way] = middle;
                low_max[way] = middle;
                halves = [Self::Tensor(*min, low_max), Self::Tensor(high_min, *max)];
            }
            Self::Prism(v, [low, high]) if way == 3 => {
                let middle = f64::midpoint(*low, *high);
                halves = [
                    Self::Prism(*v, [*low, middle]),
                    Self::Prism(*v, [middle, *high]),
                ];
            }
            Self::Prism(v, _) => {
                let [a, b] = SIMPLEX_EDGES[way];
                let middle = (v[a] + v[b]) / 2.0;
                for (half, gone) in halves.iter_mut().zip([b, a]) {
                    if let Self::Prism(w, _) = half {
                        w[gone] = middle;
                    }
                }
            }
        }
        halves
    }

    /// A point of the whole cell from coordinates within the part.
    pub fn place(&self, r: Vec3) -> Vec3 {
        match self {
            Self::Simplex(v) => {
                v[0] + (v[1] - v[0]) * r.x + (v[2] - v[0]) * r.y + (v[3] - v[0]) * r.z
            }
            Self::Tensor(min, max) => min + (max - min).component_mul(&r),
            Self::Prism(v, [low, high]) => {
                let flat = v[0] + (v[1] - v[0]) * r.x + (v[2] - v[0]) * r.y;
                Vec3::new(flat.x, flat.y, low + (high - low) * r.z)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cubic in total degree, so exact on both families at degree 3.
    fn cubic(r: Vec3) -> f64 {
        1.0 + r.x - 2.0 * r.y * r.z + 3.0 * r.x * r.y * r.z - r.z * r.z * r.x + r.y.powi(3)
    }

    fn evaluate(net: &Net<f64>, r: Vec3) -> f64 {
        let n = net.degree;
        lattice(net.family, n)
            .zip(&net.coefficients)
            .map(|([i, j, k], c)| {
                let power = |t: f64, i: usize| t.powi(i as i32);
                c * match net.family {
                    Family::Simplex => {
                        let l = 1.0 - r.x - r.y - r.z;
                        binomial(n, i)
                            * binomial(n - i, j)
                            * binomial(n - i - j, k)
                            * power(r.x, i)
                            * power(r.y, j)
                            * power(r.z, k)
                            * power(l, n - i - j - k)
                    }
                    Family::Prism => {
                        let l = 1.0 - r.x - r.y;
                        binomial(n, i)
                            * binomial(n - i, j)
                            * power(r.x, i)
                            * power(r.y, j)
                            * power(l, n - i - j)
                            * binomial(n, k)
                            * power(r.z, k)
                            * power(1.0 - r.z, n - k)
                    }
                    Family::Tensor => {
                        let b = |t: f64, i| binomial(n, i) * power(t, i) * power(1.0 - t, n - i);
                        b(r.x, i) * b(r.y, j) * b(r.z, k)
                    }
                }
            })
            .sum()
    }

    #[test]
    fn coefficients_reproduce_the_polynomial_and_splitting_keeps_it() {
        for family in [Family::Simplex, Family::Tensor, Family::Prism] {
            let net = Net::of(family, 3, cubic);
            assert_eq!(net.coefficients.len(), count(family, 3));
            for (place, p) in lattice(family, 3).enumerate() {
                assert_eq!(index(family, 3, p), place);
            }
            let r = Vec3::new(0.2, 0.3, 0.15);
            assert!((evaluate(&net, r) - cubic(r)).abs() < 1e-13);
            let ways = match family {
                Family::Tensor => 3,
                Family::Prism => 4,
                Family::Simplex => 6,
            };
            for way in 0..ways {
                let parts = Part::whole(family).split(way);
                for (half, part) in net.split(way).iter().zip(parts) {
                    assert!((evaluate(half, r) - cubic(part.place(r))).abs() < 1e-13);
                }
            }
        }
    }

    #[test]
    fn mean_is_the_integral() {
        // Integral of x over the unit simplex is 1/24, its volume 1/6.
        let net = Net::of(Family::Simplex, 2, |r| r.x);
        assert!((net.mean() / 6.0 - 1.0 / 24.0).abs() < 1e-15);
        let net = Net::of(Family::Tensor, 3, |r| r.x.powi(3) * r.y);
        assert!((net.mean() - 1.0 / 8.0).abs() < 1e-14);
    }
}
