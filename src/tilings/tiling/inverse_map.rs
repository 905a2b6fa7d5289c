//! The inverse map of a curved element: Newton's method for the continued map, four points at a time, and local maps.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::clamp::{clamp_row, face_distance_row};
use super::local_map::LocalMap;
use super::patch::{Preimage, has_converged};
use crate::scaffold::Polynomial;
use druse_geometry::frame::{Element, Mat3, Vec3};
use druse_geometry::simd::{self, Four, Lanes, Number, SimdKernel, difference};

/// Newton steps for four points. Points that need more steps are searched for one by one.
const MAX_STEPS: usize = 12;

/// Rows of a matrix.
pub(super) type Matrix<T> = [[T; 3]; 3];

/// The polynomial map of a curved element.
#[derive(Clone, Copy)]
pub(super) struct CurvedMap<'a> {
    pub polynomial: &'a Polynomial,
    pub shape: Element,
}

/// The result of a Newton step from a point of the closed cell.
struct Step<T> {
    /// The world position of that point.
    from: [T; 3],
    xi: [T; 3],
    /// d xi / d x at that point, by rows.
    inverse: Matrix<T>,
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

/// Loads points by coordinates; the last one is repeated where there are fewer than four.
#[inline(always)]
pub(super) fn rows<L: Lanes>(lanes: L, points: &[Vec3]) -> [Four<L>; 3] {
    let last = points.len() - 1;
    let (a, b, c, d) = (
        points[0],
        points[last.min(1)],
        points[last.min(2)],
        points[last],
    );
    Four::points(lanes, [a.into(), b.into(), c.into(), d.into()])
}

/// Stores a matrix by row, column and lane.
#[inline(always)]
pub(super) fn matrix_to_arrays<L: Lanes>(m: Matrix<Four<L>>) -> [[[f64; 4]; 3]; 3] {
    [to_arrays(m[0]), to_arrays(m[1]), to_arrays(m[2])]
}

/// Stores a vector by coordinate and lane.
#[inline(always)]
pub(super) fn to_arrays<L: Lanes>(v: [Four<L>; 3]) -> [[f64; 4]; 3] {
    [v[0].row(), v[1].row(), v[2].row()]
}

impl CurvedMap<'_> {
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
        let limit = x[0].splat(1e9);
        let magnitude = step.xi[0].abs().max(step.xi[1].abs()).max(step.xi[2].abs());
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
        let (from, jacobian) = self.polynomial.evaluate(at);
        let inverse = inverse(jacobian);
        Step {
            from,
            xi: product(inverse, difference(x, from), at),
            inverse,
        }
    }
}

/// Finds preimages in one element; `None` for points that do not converge in [`MAX_STEPS`].
struct PreimagesKernel<'a> {
    map: CurvedMap<'a>,
    local_map: &'a mut LocalMap,
    for_f32: bool,
    points: &'a [Vec3],
    found: &'a mut Vec<Option<Preimage>>,
}

impl SimdKernel for PreimagesKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        for points in self.points.chunks(4) {
            let four = rows(lanes, points);
            let mut preimages = [None; 4];
            self.map
                .preimages_of_row(four, self.local_map, self.for_f32, &mut preimages);
            if let Some(preimage) = &preimages[0] {
                *self.local_map = self.local_map.recentred(points[0], preimage);
            }
            self.found.extend(&preimages[..points.len()]);
        }
    }
}

impl CurvedMap<'_> {
    /// The preimages of points, estimated from the first of the previous four.
    pub fn preimages(
        &self,
        local_map: &mut LocalMap,
        for_f32: bool,
        points: &[Vec3],
        found: &mut Vec<Option<Preimage>>,
    ) {
        let map = *self;
        simd::run(PreimagesKernel {
            map,
            local_map,
            for_f32,
            points,
            found,
        });
    }

    /// The preimages of four points by Newton steps from the local map's estimates. `None` stays where these do not
    /// converge, or the map is singular.
    #[inline(always)]
    fn preimages_of_row<L: Lanes>(
        &self,
        x: [Four<L>; 3],
        local_map: &LocalMap,
        for_f32: bool,
        preimages: &mut [Option<Preimage>; 4],
    ) {
        let mut at = clamp_row(self.shape, local_map.estimate_row(x));
        for _ in 0..MAX_STEPS {
            let step = self.step(x, at);
            let next = clamp_row(self.shape, step.xi);
            let face_distance = face_distance_row(self.shape, step.xi).row();
            let [a, b, c] = difference(next, at);
            let moved = a.abs().max(b.abs()).max(c.abs()).row();
            let mut converged = [false; 4];
            for n in 0..4 {
                converged[n] =
                    preimages[n].is_none() && has_converged(moved[n], face_distance[n], for_f32);
            }
            if converged.contains(&true) {
                let rest = difference(x, step.from);
                let outside_distance = dot(rest, rest, x[0].splat(0.0)).sqrt().row();
                let (xi, inverse) = (to_arrays(step.xi), matrix_to_arrays(step.inverse));
                // Where the map is singular there is no preimage.
                let is_found = |n: usize| xi.iter().all(|row| row[n].is_finite());
                for n in (0..4).filter(|&n| converged[n] && is_found(n)) {
                    preimages[n] = Some(Preimage {
                        xi: Vec3::from_fn(|r, _| xi[r][n]),
                        inverse: Mat3::from_fn(|r, c| inverse[r][c][n]),
                        face_distance: face_distance[n],
                        outside_distance: if face_distance[n] > 0.0 {
                            outside_distance[n]
                        } else {
                            0.0
                        },
                    });
                }
                if preimages.iter().all(Option::is_some) {
                    return;
                }
            }
            at = next;
        }
    }
}

/// Half the second derivatives of xi by x at a point: xx, yy, zz, and the whole mixed ones xy, yz, zx.
struct SecondDerivativesKernel<'a> {
    map: CurvedMap<'a>,
    at: Vec3,
    inverse: &'a Mat3,
}

impl SimdKernel for SecondDerivativesKernel<'_> {
    type Output = [Vec3; 6];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> [Vec3; 6] {
        // Central differences are exact: the Jacobian has at most degree 2 in each coordinate.
        const DIFFERENCE_STEP: f64 = 0.25;
        let a = self.inverse;
        // -d a / d x, one matrix for each coordinate of x.
        let mut changes = [Mat3::zeros(); 3];
        for (axes, count) in [([0, 1], 2), ([2, 2], 1)] {
            let (p, q) = (
                Vec3::ith(axes[0], DIFFERENCE_STEP),
                Vec3::ith(axes[1], DIFFERENCE_STEP),
            );
            let points = [self.at + p, self.at - p, self.at + q, self.at - q];
            let (_, jacobian) = self.map.polynomial.evaluate(rows(lanes, &points));
            let j = matrix_to_arrays(jacobian);
            for (n, &axis) in axes.iter().enumerate().take(count) {
                let slope = Mat3::from_fn(|r, c| {
                    (j[r][c][2 * n] - j[r][c][2 * n + 1]) / (2.0 * DIFFERENCE_STEP)
                });
                let rate = a * slope * a;
                for (column, change) in changes.iter_mut().enumerate() {
                    *change += rate * a[(axis, column)];
                }
            }
        }
        [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)].map(|(i, j)| {
            let second: Vec3 = -changes[i].column(j);
            if i == j { second / 2.0 } else { second }
        })
    }
}

impl CurvedMap<'_> {
    /// [`LocalMap::second_derivatives`] at a reference point.
    pub fn second_derivatives(&self, at: Vec3, inverse: &Mat3) -> [Vec3; 6] {
        simd::run(SecondDerivativesKernel {
            map: *self,
            at,
            inverse,
        })
    }
}

/// The distance of a local map's estimates from the results of a Newton step, for four points.
struct LocalMapErrorKernel<'a>(CurvedMap<'a>, &'a LocalMap, [Vec3; 4]);

impl SimdKernel for LocalMapErrorKernel<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> f64 {
        let Self(map, local_map, points) = self;
        let x: [Four<L>; 3] = rows(lanes, &points);
        let estimate = local_map.estimate_row(x);
        let step = map.step(x, clamp_row(map.shape, estimate));
        let [a, b, c] = difference(step.xi, estimate);
        let errors = a.abs().max(b.abs()).max(c.abs()).row();
        // NaN counts as the greatest error.
        errors
            .into_iter()
            .fold(0.0, |m, v| if v <= m { m } else { v })
    }
}

impl CurvedMap<'_> {
    /// The greatest error of a local map at four points of the element, reference units.
    pub fn error(&self, local_map: &LocalMap, points: [Vec3; 4]) -> f64 {
        simd::run(LocalMapErrorKernel(*self, local_map, points))
    }
}
