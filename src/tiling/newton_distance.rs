//! The scale of rule Q: distance per field unit, by two damped Newton steps with an element's own field.
//!
//! Points of one element walk together, four at a time; between the steps the cell is asked for all of
//! them. A point gives the same bits alone and among others.
// Small functions of hot paths, which must be compiled for the processor that their caller is for;
// arithmetic on lanes stands in no closure, which would not be.
#![allow(clippy::inline_always)]

use super::inverse_map::{Curve, Matrix, dot, product, rows, stored, stored_matrix};
use super::local_map::Trail;
use crate::frame::{CellPoint, Mat3, Vec3};
use crate::simd::{self, Four, Lanes, Number, Work};

/// Newton steps are damped where the slope is below this fraction of its mean.
const DAMPING: f64 = 0.05;
/// Scales beyond this many times the mean distance per field unit are cut off.
const STEEPEST: f64 = 10.0;

/// How far a walk in one element may go.
#[derive(Clone, Copy)]
pub(super) struct Pace {
    pub damping: f64,
    /// Values nearer to 0 are zeros.
    pub zero: f64,
    /// Of a step, world units.
    longest: f64,
    /// Least and greatest distance per field unit.
    pub scales: [f64; 2],
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

/// The first step of four points.
#[derive(Clone, Copy, Default)]
pub(super) struct Leg {
    /// The step, world units.
    pub way: [[f64; 4]; 3],
    /// |F| at the start; 0 where that is a zero already.
    size: [f64; 4],
    /// The scale there.
    flat: [f64; 4],
    /// d xi / d x at its end, by rows.
    pub by: [[[f64; 4]; 3]; 3],
}

/// d xi / d x where points set off.
#[derive(Clone, Copy)]
pub(super) enum Frame<'a> {
    /// As a trail has it.
    Trail(&'a Trail),
    /// One for each of them.
    Each(&'a [Mat3]),
}

/// Points that set off from where they lie in the world and in the cell, with the field's values and
/// gradients by reference coordinates.
pub(super) struct Walkers<'a> {
    pub x: &'a [Vec3],
    pub at: &'a mut [CellPoint<3>],
    pub frame: Frame<'a>,
    pub slopes: &'a [(f64, Vec3)],
}

struct SetOff<'a>(Pace, Option<Curve<'a>>, Walkers<'a>, &'a mut [Leg]);

struct Arrive<'a> {
    pace: Pace,
    slopes: &'a [(f64, Vec3)],
    legs: &'a [Leg],
    scales: &'a mut [f64],
}

/// The numbers of four; the last one again where there are fewer.
#[inline(always)]
fn indices(count: usize) -> [usize; 4] {
    [0, 1.min(count - 1), 2.min(count - 1), 3.min(count - 1)]
}

/// Values and gradients.
#[inline(always)]
fn slopes<L: Lanes>(lanes: L, slopes: &[(f64, Vec3)]) -> (Four<L>, [Four<L>; 3]) {
    let [a, b, c, d] = indices(slopes.len());
    let (a, b, c, d) = (&slopes[a], &slopes[b], &slopes[c], &slopes[d]);
    (
        Four::of(lanes, [a.0, b.0, c.0, d.0]),
        rows(lanes, &[a.1, b.1, c.1, d.1]),
    )
}

/// Rows of matrices.
#[inline(always)]
fn turned<L: Lanes>(lanes: L, matrices: &[Mat3]) -> Matrix<Four<L>> {
    let [a, b, c, d] = indices(matrices.len());
    let (a, b, c, d) = (&matrices[a], &matrices[b], &matrices[c], &matrices[d]);
    let mut all = [[Four::of(lanes, [0.0; 4]); 3]; 3];
    for (r, row) in all.iter_mut().enumerate() {
        for (c3, v) in [0, 3, 6].into_iter().zip(row) {
            let n = r + c3;
            *v = Four::of(lanes, [a[n], b[n], c[n], d[n]]);
        }
    }
    all
}

/// Gradients by the world from those by the cell.
#[inline(always)]
pub(super) fn to_world<T: Number>(by: Matrix<T>, g: [T; 3]) -> [T; 3] {
    let zero = g[0].like(0.0);
    [
        dot([by[0][0], by[1][0], by[2][0]], g, zero),
        dot([by[0][1], by[1][1], by[2][1]], g, zero),
        dot([by[0][2], by[1][2], by[2][2]], g, zero),
    ]
}

impl Pace {
    /// A damped Newton step from where value and gradient are these.
    #[inline(always)]
    pub fn step<T: Number>(&self, f: T, g: [T; 3], square: T) -> [T; 3] {
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
        let Self(pace, curve, walkers, legs) = self;
        let groups = walkers.x.chunks(4).zip(walkers.slopes.chunks(4));
        let groups = groups.zip(walkers.at.chunks_mut(4)).zip(legs);
        for (n, (((x, s), at), leg)) in groups.enumerate() {
            let (f, g) = slopes(lanes, s);
            let start = rows(lanes, x);
            let by = match walkers.frame {
                Frame::Trail(trail) => trail.inverse_row(start),
                Frame::Each(all) => turned(lanes, &all[4 * n..4 * n + x.len()]),
            };
            let g = to_world(by, g);
            let square = dot(g, g, f.like(0.0));
            let way = pace.step(f, g, square);
            let flat = square.sqrt() / (square + f.like(pace.damping));
            let size = f.abs();
            let size = size.below(f.like(pace.zero), f.like(0.0), size);
            let [a, b, c, d] = indices(at.len());
            let from = rows(lanes, &[at[a].0, at[b].0, at[c].0, at[d].0]);
            let guess = product(by, way, from);
            let (to, by) = match curve {
                Some(curve) => {
                    let end = [start[0] + way[0], start[1] + way[1], start[2] + way[2]];
                    curve.follow(end, guess, by)
                }
                None => (guess, by),
            };
            leg.way = stored(way);
            leg.size = size.row();
            leg.flat = flat.row();
            leg.by = stored_matrix(by);
            let to = stored(to);
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
        let groups = self.slopes.chunks(4).zip(self.legs);
        for ((s, leg), scales) in groups.zip(self.scales.chunks_mut(4)) {
            let (f, g) = slopes(lanes, s);
            let by = [
                loaded(lanes, leg.by[0]),
                loaded(lanes, leg.by[1]),
                loaded(lanes, leg.by[2]),
            ];
            let g = to_world(by, g);
            let [x, y, z] = pace.step(f, g, dot(g, g, f.like(0.0)));
            let first = loaded(lanes, leg.way);
            let (size, flat) = (Four::of(lanes, leg.size), Four::of(lanes, leg.flat));
            let way = [first[0] + x, first[1] + y, first[2] + z];
            let scale = dot(way, way, f.like(0.0)).sqrt() / size;
            let scale = f.like(0.0).below(size, scale, flat);
            let [least, most] = pace.scales;
            let scale = scale.min(f.like(most)).max(f.like(least)).row();
            scales.copy_from_slice(&scale[..scales.len()]);
        }
    }
}

/// From memory: by coordinate and lane.
#[inline(always)]
fn loaded<L: Lanes>(lanes: L, v: [[f64; 4]; 3]) -> [Four<L>; 3] {
    [
        Four::of(lanes, v[0]),
        Four::of(lanes, v[1]),
        Four::of(lanes, v[2]),
    ]
}

/// The first step: moves the walkers' reference coordinates to its end; there is a leg for each four.
pub(super) fn set_off(pace: Pace, curve: Option<Curve>, walkers: Walkers, legs: &mut [Leg]) {
    simd::run(SetOff(pace, curve, walkers, legs));
}

/// The second step, from value and gradient at the end of the first: the scales, not beyond their limits.
pub(super) fn arrive(pace: Pace, slopes: &[(f64, Vec3)], legs: &[Leg], scales: &mut [f64]) {
    simd::run(Arrive {
        pace,
        slopes,
        legs,
        scales,
    });
}
