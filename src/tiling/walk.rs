//! The scale of rule Q: distance per field unit, by two damped Newton steps with an element's own field.
//!
//! Points of one element walk together, four at a time; between the steps the cell is asked for all of
//! them. A point gives the same bits alone and among others.
// Small functions of hot paths, which must be compiled for the processor that their caller is for;
// closures would not be.
#![allow(clippy::inline_always)]

use super::place::{Curve, Matrix, columns, dot, matrices, product, rows};
use crate::frame::{CellPoint, Mat3, Vec3};
use crate::lanes::{self, Four, Lanes, Number, Work};

/// Newton steps are damped where the slope is below this fraction of its mean.
const DAMPING: f64 = 0.05;
/// Scales beyond this many times the mean distance per field unit are cut off.
const STEEPEST: f64 = 10.0;

/// How far a walk in one element may go.
#[derive(Clone, Copy)]
pub(super) struct Pace {
    damping: f64,
    /// Values nearer to 0 are zeros.
    zero: f64,
    /// Of a step, world units.
    longest: f64,
    /// Distance per field unit.
    scales: [f64; 2],
}

impl Pace {
    /// In an element with these slopes per world unit, for this half width and voxel size.
    pub fn new(slope_rms: f64, slope_sup: f64, half_width: f64, voxel_size: f64) -> Self {
        Self {
            damping: (DAMPING * slope_rms).powi(2),
            zero: 1e-9 * slope_rms * voxel_size,
            longest: 2.0 * half_width,
            scales: [1.0 / slope_sup, STEEPEST / slope_rms],
        }
    }
}

/// The first step of a point.
#[derive(Clone, Copy, Default)]
pub(super) struct Leg {
    pub way: Vec3,
    /// |F| at the start; 0 where that is a zero already.
    size: f64,
    /// The scale there.
    flat: f64,
}

/// Points on their way: reference coordinates, d xi / d x, value and gradient by the former.
pub(super) struct Walkers<'a> {
    pub x: &'a [Vec3],
    pub at: &'a mut [CellPoint<3>],
    pub inverses: &'a mut [Mat3],
    pub slopes: &'a [(f64, Vec3)],
    pub legs: &'a mut [Leg],
}

struct SetOff<'a>(Pace, Option<Curve<'a>>, Walkers<'a>);

struct Arrive<'a> {
    pace: Pace,
    slopes: &'a [(f64, Vec3)],
    inverses: &'a [Mat3],
    legs: &'a [Leg],
    scales: &'a mut [f64],
}

/// What is to be known of four walkers; the last one again where there are fewer.
#[inline(always)]
fn indices(count: usize) -> [usize; 4] {
    [0, 1.min(count - 1), 2.min(count - 1), 3.min(count - 1)]
}

/// Values, and gradients by world coordinates.
#[inline(always)]
fn slopes<L: Lanes>(
    lanes: L,
    slopes: &[(f64, Vec3)],
    inverses: &[Mat3],
) -> (Four<L>, [Four<L>; 3], Matrix<Four<L>>) {
    let [a, b, c, d] = indices(slopes.len());
    let f = Four::of(lanes, [slopes[a].0, slopes[b].0, slopes[c].0, slopes[d].0]);
    let g = rows(lanes, &[slopes[a].1, slopes[b].1, slopes[c].1, slopes[d].1]);
    let (p, q, r, s) = (&inverses[a], &inverses[b], &inverses[c], &inverses[d]);
    // Columns of d xi / d x.
    let mut turned = [g; 3];
    for (n, column) in turned.iter_mut().enumerate() {
        let n = 3 * n;
        for (k, v) in column.iter_mut().enumerate() {
            *v = Four::of(lanes, [p[n + k], q[n + k], r[n + k], s[n + k]]);
        }
    }
    let zero = f.like(0.0);
    let slope = [
        dot(turned[0], g, zero),
        dot(turned[1], g, zero),
        dot(turned[2], g, zero),
    ];
    (f, slope, turned)
}

impl Pace {
    /// A damped Newton step from where value and gradient are these.
    #[inline(always)]
    fn step<T: Number>(&self, f: T, g: [T; 3], square: T) -> [T; 3] {
        let zero = f.like(0.0);
        let rate = (zero - f) / (square + f.like(self.damping));
        let length = (square * rate * rate).sqrt();
        let longest = f.like(self.longest);
        let rate = longest.below(length, rate * (longest / length), rate);
        [g[0] * rate, g[1] * rate, g[2] * rate]
    }
}

impl Work for SetOff<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self(pace, curve, walkers) = self;
        let groups = walkers.x.chunks(4).zip(walkers.slopes.chunks(4));
        let groups = groups.zip(walkers.at.chunks_mut(4));
        let groups = groups.zip(walkers.inverses.chunks_mut(4));
        for ((((x, s), at), inverses), legs) in groups.zip(walkers.legs.chunks_mut(4)) {
            let (f, g, turned) = slopes(lanes, s, inverses);
            let square = dot(g, g, f.like(0.0));
            let step = pace.step(f, g, square);
            let flat = square.sqrt() / (square + f.like(pace.damping));
            let size = f.abs();
            let size = size.below(f.like(pace.zero), f.like(0.0), size);
            let (size, flat, step_rows) = (size.row(), flat.row(), columns(step));
            for (n, to) in legs.iter_mut().enumerate() {
                *to = Leg {
                    way: Vec3::new(step_rows[0][n], step_rows[1][n], step_rows[2][n]),
                    size: size[n],
                    flat: flat[n],
                };
            }
            let [a, b, c, d] = indices(at.len());
            let from = rows(lanes, &[at[a].0, at[b].0, at[c].0, at[d].0]);
            // Its columns turned into rows.
            let by = [
                [turned[0][0], turned[1][0], turned[2][0]],
                [turned[0][1], turned[1][1], turned[2][1]],
                [turned[0][2], turned[1][2], turned[2][2]],
            ];
            let mut to = product(by, step, from);
            if let Some(curve) = curve {
                let x = rows(lanes, x);
                let end = [x[0] + step[0], x[1] + step[1], x[2] + step[2]];
                let (found, by) = curve.follow(end, to, by);
                to = found;
                let by = matrices(by);
                for (n, inverse) in inverses.iter_mut().enumerate() {
                    *inverse = Mat3::from_fn(|r, c| by[r][c][n]);
                }
            }
            let to = columns(to);
            for (n, at) in at.iter_mut().enumerate() {
                at.0 = Vec3::new(to[0][n], to[1][n], to[2][n]);
            }
        }
    }
}

impl Work for Arrive<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let pace = self.pace;
        let groups = self.slopes.chunks(4).zip(self.inverses.chunks(4));
        let groups = groups.zip(self.legs.chunks(4));
        for (((s, inverses), legs), scales) in groups.zip(self.scales.chunks_mut(4)) {
            let (f, g, _) = slopes(lanes, s, inverses);
            let [x, y, z] = pace.step(f, g, dot(g, g, f.like(0.0)));
            let [a, b, c, d] = indices(legs.len());
            let (a, b, c, d) = (&legs[a], &legs[b], &legs[c], &legs[d]);
            let first = rows(lanes, &[a.way, b.way, c.way, d.way]);
            let size = Four::of(lanes, [a.size, b.size, c.size, d.size]);
            let flat = Four::of(lanes, [a.flat, b.flat, c.flat, d.flat]);
            let way = [first[0] + x, first[1] + y, first[2] + z];
            let scale = dot(way, way, f.like(0.0)).sqrt() / size;
            let scale = f.like(0.0).below(size, scale, flat);
            let [least, most] = pace.scales;
            let scale = scale.min(f.like(most)).max(f.like(least)).row();
            scales.copy_from_slice(&scale[..scales.len()]);
        }
    }
}

/// The first step: moves the walkers' reference coordinates to its end.
pub(super) fn set_off(pace: Pace, curve: Option<Curve>, walkers: Walkers) {
    lanes::run(SetOff(pace, curve, walkers));
}

/// The second step, from value and gradient at the end of the first: the scales, not beyond their limits.
pub(super) fn arrive(
    pace: Pace,
    slopes: &[(f64, Vec3)],
    inverses: &[Mat3],
    legs: &[Leg],
    scales: &mut [f64],
) {
    lanes::run(Arrive {
        pace,
        slopes,
        inverses,
        legs,
        scales,
    });
}
