//! Where points lie in a curved element: Newton's method for the continued map, four points at a time.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::clamp::{beyond_row, clamp_row};
use super::local_map::Trail;
use super::patch::{Spot, is_settled};
use crate::frame::{Element, Mat3, Vec3};
use crate::scaffold::Polynomial;
use crate::simd::{self, Four, Lanes, Number, Work, difference};

/// Newton steps for four points; a point that takes more is looked for by itself.
const STEPS: usize = 12;

/// Rows of a matrix.
pub(super) type Matrix<T> = [[T; 3]; 3];

/// A curved element as the steps see it.
#[derive(Clone, Copy)]
pub(super) struct Curve<'a> {
    pub map: &'a Polynomial,
    pub shape: Element,
}

/// What a step finds, from a point of the closed cell.
struct Step<T> {
    /// Where the cell's point lies in the world.
    from: [T; 3],
    xi: [T; 3],
    /// d xi / d x by rows, at the cell's point.
    inverse: Matrix<T>,
}

// Arithmetic on lanes stands in no closure: it would not be compiled for its caller's processor.

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

/// By the adjugate; not finite where there is none.
#[inline(always)]
fn inverse<T: Number>([a, b, c]: Matrix<T>) -> Matrix<T> {
    let (bc, ca, ab) = (cross(b, c), cross(c, a), cross(a, b));
    let share = a[0].like(1.0) / dot(a, bc, a[0].like(0.0));
    let (p, q, r) = (scaled(bc, share), scaled(ca, share), scaled(ab, share));
    [[p[0], q[0], r[0]], [p[1], q[1], r[1]], [p[2], q[2], r[2]]]
}

/// Points by coordinates; the last one again where there are fewer than four.
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

/// To memory: by row, column and lane.
#[inline(always)]
pub(super) fn stored_matrix<L: Lanes>(m: Matrix<Four<L>>) -> [[[f64; 4]; 3]; 3] {
    [stored(m[0]), stored(m[1]), stored(m[2])]
}

/// To memory: by coordinate and lane.
#[inline(always)]
pub(super) fn stored<L: Lanes>(v: [Four<L>; 3]) -> [[f64; 4]; 3] {
    [v[0].row(), v[1].row(), v[2].row()]
}

impl Curve<'_> {
    /// One step from a guess `at` that is close to where `x` lies, and d xi / d x (guessed as `by`) there.
    #[inline(always)]
    pub fn follow<T: Number>(
        &self,
        x: [T; 3],
        at: [T; 3],
        mut by: Matrix<T>,
    ) -> ([T; 3], Matrix<T>) {
        // From the clamped point, so that the Jacobian is regular.
        let step = self.step(x, clamp_row(self.shape, at));
        let mut to = at;
        // A map that is singular there leaves everything as it was guessed.
        let far = x[0].like(1e9);
        let size = step.xi[0].abs().max(step.xi[1].abs()).max(step.xi[2].abs());
        for (to, found) in to.iter_mut().zip(step.xi) {
            *to = size.below(far, found, *to);
        }
        for (row, found) in by.iter_mut().zip(step.inverse) {
            for (to, found) in row.iter_mut().zip(found) {
                *to = size.below(far, found, *to);
            }
        }
        (to, by)
    }

    /// A step towards `x` from `at`, which is in the closed cell.
    #[inline(always)]
    fn step<T: Number>(&self, x: [T; 3], at: [T; 3]) -> Step<T> {
        let (from, jacobian) = self.map.evaluate(at);
        let inverse = inverse(jacobian);
        Step {
            from,
            xi: product(inverse, difference(x, from), at),
            inverse,
        }
    }
}

/// Finds points in one element; `None` for those that take more steps than most.
struct Find<'a> {
    curve: Curve<'a>,
    trail: &'a mut Trail,
    is_rough: bool,
    points: &'a [Vec3],
    found: &'a mut Vec<Option<Spot>>,
}

impl Work for Find<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        for points in self.points.chunks(4) {
            let four = rows(lanes, points);
            let mut spots = [None; 4];
            self.curve.find(four, self.trail, self.is_rough, &mut spots);
            if let Some(spot) = &spots[0] {
                *self.trail = self.trail.moved(points[0], spot);
            }
            self.found.extend(&spots[..points.len()]);
        }
    }
}

impl Curve<'_> {
    /// Where points lie, guessed from the first of the last four, if that was found.
    pub fn find_all(
        &self,
        trail: &mut Trail,
        is_rough: bool,
        points: &[Vec3],
        found: &mut Vec<Option<Spot>>,
    ) {
        let curve = *self;
        simd::run(Find {
            curve,
            trail,
            is_rough,
            points,
            found,
        });
    }

    #[inline(always)]
    fn find<L: Lanes>(
        &self,
        x: [Four<L>; 3],
        trail: &Trail,
        is_rough: bool,
        spots: &mut [Option<Spot>; 4],
    ) {
        let mut at = clamp_row(self.shape, trail.guess_row(x));
        for _ in 0..STEPS {
            let step = self.step(x, at);
            let next = clamp_row(self.shape, step.xi);
            let beyond = beyond_row(self.shape, step.xi).row();
            let [a, b, c] = difference(next, at);
            let moved = a.abs().max(b.abs()).max(c.abs()).row();
            let mut settled = [false; 4];
            for n in 0..4 {
                settled[n] = spots[n].is_none() && is_settled(moved[n], beyond[n], is_rough);
            }
            if settled.contains(&true) {
                let rest = difference(x, step.from);
                let overshoot = dot(rest, rest, x[0].like(0.0)).sqrt().row();
                let (xi, inverse) = (stored(step.xi), stored_matrix(step.inverse));
                // Where the map is singular nothing is found.
                let is_found = |n: usize| xi.iter().all(|row| row[n].is_finite());
                for n in (0..4).filter(|&n| settled[n] && is_found(n)) {
                    spots[n] = Some(Spot {
                        xi: Vec3::from_fn(|r, _| xi[r][n]),
                        inverse: Mat3::from_fn(|r, c| inverse[r][c][n]),
                        beyond: beyond[n],
                        overshoot: if beyond[n] > 0.0 { overshoot[n] } else { 0.0 },
                    });
                }
                if spots.iter().all(Option::is_some) {
                    return;
                }
            }
            at = next;
        }
    }
}

/// How d xi / d x turns on about a point.
struct Bend<'a> {
    curve: Curve<'a>,
    at: Vec3,
    inverse: &'a Mat3,
}

impl Work for Bend<'_> {
    type Output = [Vec3; 6];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> [Vec3; 6] {
        // Differences are exact: the Jacobian is of degree 2 at most in each coordinate.
        const FAR: f64 = 0.25;
        let a = self.inverse;
        // - d a / d xi, by column of d x.
        let mut turns = [Mat3::zeros(); 3];
        for (axes, count) in [([0, 1], 2), ([2, 2], 1)] {
            let (p, q) = (Vec3::ith(axes[0], FAR), Vec3::ith(axes[1], FAR));
            let points = [self.at + p, self.at - p, self.at + q, self.at - q];
            let (_, jacobian) = self.curve.map.evaluate(rows(lanes, &points));
            let j = stored_matrix(jacobian);
            for (n, &axis) in axes.iter().enumerate().take(count) {
                let slope =
                    Mat3::from_fn(|r, c| (j[r][c][2 * n] - j[r][c][2 * n + 1]) / (2.0 * FAR));
                let turn = a * slope * a;
                for (by, turned) in turns.iter_mut().enumerate() {
                    *turned += turn * a[(axis, by)];
                }
            }
        }
        [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)].map(|(i, j)| {
            let second: Vec3 = -turns[i].column(j);
            if i == j { second / 2.0 } else { second }
        })
    }
}

impl Curve<'_> {
    /// [`Trail::bend`] where a point lies.
    pub fn bend(&self, at: Vec3, inverse: &Mat3) -> [Vec3; 6] {
        simd::run(Bend {
            curve: *self,
            at,
            inverse,
        })
    }
}

/// How far guesses of four points are from where a step takes them.
struct Astray<'a>(Curve<'a>, &'a Trail, [Vec3; 4]);

impl Work for Astray<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> f64 {
        let Self(curve, trail, points) = self;
        let x: [Four<L>; 3] = rows(lanes, &points);
        let guess = trail.guess_row(x);
        let step = curve.step(x, clamp_row(curve.shape, guess));
        let [a, b, c] = difference(step.xi, guess);
        let far = a.abs().max(b.abs()).max(c.abs()).row();
        // What is no number counts as far.
        far.into_iter().fold(0.0, |m, v| if v <= m { m } else { v })
    }
}

impl Curve<'_> {
    /// By how much, in reference units, a trail errs at one of four points of the element at most.
    pub fn error(&self, trail: &Trail, points: [Vec3; 4]) -> f64 {
        simd::run(Astray(*self, trail, points))
    }
}
