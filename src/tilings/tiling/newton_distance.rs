//! The scale of rule Q: distance per field unit, by two damped Newton steps with an element's own field.
//!
//! The steps are taken for four points of an element at a time. Between the steps the caller evaluates the
//! cell at all points. A point gives the same bits alone and among others.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand. Closures
// are not: no SIMD arithmetic is written in them.
#![allow(clippy::inline_always)]

use super::inverse_map::{CurvedMap, Matrix, dot, matrix_to_arrays, product, rows, to_arrays};
use super::local_map::LocalMap;
use druse_geometry::frame::{CellPoint, Mat3, Vec3};
use druse_geometry::simd::{self, Four, Lanes, Number, SimdKernel};

/// Newton steps are damped where the slope is below this fraction of its root mean square.
pub(super) const DAMPING_FRACTION: f64 = 0.05;
/// Bound of the scale, in units of 1 / root mean square of the slope: that of a zero, |g| / (|g|^2 + damping), is at
/// most 1 / (2 [`DAMPING_FRACTION`]).
pub(super) const MAX_SCALE_FACTOR: f64 = 10.0;

/// Damping and bounds of the Newton steps in one element.
#[derive(Clone, Copy)]
pub(super) struct StepLimits {
    /// Added to the squared slope, per squared world unit.
    pub damping: f64,
    /// Values with a smaller magnitude count as zeros.
    pub zero_tolerance: f64,
    /// The longest step, world units.
    max_step: f64,
    /// Least and greatest scale, distance per field unit.
    pub scale_range: [f64; 2],
}

impl StepLimits {
    /// The limits in an element with these slopes, per world unit.
    pub fn new(slope_rms: f64, slope_sup: f64, half_width: f64, voxel_size: f64) -> Self {
        Self {
            damping: (DAMPING_FRACTION * slope_rms).powi(2),
            // A billionth of a voxel from the surface.
            zero_tolerance: 1e-9 * slope_rms * voxel_size,
            max_step: 2.0 * half_width,
            scale_range: [1.0 / slope_sup, MAX_SCALE_FACTOR / slope_rms],
        }
    }
}

/// The first step of four points.
#[derive(Clone, Copy, Default)]
pub(super) struct FirstStep {
    /// The step, world units.
    pub step: [[f64; 4]; 3],
    /// |F| at the start; 0 where the start is a zero.
    magnitude: [f64; 4],
    /// The scale at a zero, from the slope at the start.
    zero_scale: [f64; 4],
    /// d xi / d x at the end of the step, by rows.
    pub inverse: [[[f64; 4]; 3]; 3],
}

/// d xi / d x at the start points.
#[derive(Clone, Copy)]
pub(super) enum InverseJacobians<'a> {
    /// From one local map.
    Local(&'a LocalMap),
    /// One matrix for each point.
    Each(&'a [Mat3]),
}

pub(super) struct StepStarts<'a> {
    /// World positions.
    pub x: &'a [Vec3],
    /// Reference coordinates.
    pub at: &'a mut [CellPoint<3>],
    pub inverses: InverseJacobians<'a>,
    /// Values and gradients by reference coordinates.
    pub slopes: &'a [(f64, Vec3)],
}

struct FirstStepKernel<'a>(
    StepLimits,
    Option<CurvedMap<'a>>,
    StepStarts<'a>,
    &'a mut [FirstStep],
);

struct SecondStepKernel<'a> {
    limits: StepLimits,
    slopes: &'a [(f64, Vec3)],
    first_steps: &'a [FirstStep],
    scales: &'a mut [f64],
}

/// Indices for four lanes: the last point is repeated where there are fewer than four.
#[inline(always)]
fn lane_indices(count: usize) -> [usize; 4] {
    [0, 1.min(count - 1), 2.min(count - 1), 3.min(count - 1)]
}

/// Loads values and gradients.
#[inline(always)]
fn load_slopes<L: Lanes>(lanes: L, slopes: &[(f64, Vec3)]) -> (Four<L>, [Four<L>; 3]) {
    let [a, b, c, d] = lane_indices(slopes.len());
    let (a, b, c, d) = (&slopes[a], &slopes[b], &slopes[c], &slopes[d]);
    (
        Four::of(lanes, [a.0, b.0, c.0, d.0]),
        rows(lanes, &[a.1, b.1, c.1, d.1]),
    )
}

/// Loads matrices, by rows.
#[inline(always)]
fn matrix_rows<L: Lanes>(lanes: L, matrices: &[Mat3]) -> Matrix<Four<L>> {
    let [a, b, c, d] = lane_indices(matrices.len());
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

/// World gradients from reference gradients.
#[inline(always)]
pub(super) fn to_world<T: Number>(inverse: Matrix<T>, g: [T; 3]) -> [T; 3] {
    let zero = g[0].splat(0.0);
    [
        dot([inverse[0][0], inverse[1][0], inverse[2][0]], g, zero),
        dot([inverse[0][1], inverse[1][1], inverse[2][1]], g, zero),
        dot([inverse[0][2], inverse[1][2], inverse[2][2]], g, zero),
    ]
}

impl StepLimits {
    /// The damped Newton step from value `f`, gradient `g` and its square.
    #[inline(always)]
    pub fn newton_step<T: Number>(&self, f: T, g: [T; 3], square: T) -> [T; 3] {
        let zero = f.splat(0.0);
        let rate = (zero - f) / (square + f.splat(self.damping));
        let length = (square * rate * rate).sqrt();
        let max_step = f.splat(self.max_step);
        let rate = max_step.select_below(length, rate * (max_step / length), rate);
        [g[0] * rate, g[1] * rate, g[2] * rate]
    }
}

impl SimdKernel for FirstStepKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self(limits, map, starts, first_steps) = self;
        // Lanes are points here, not samples of a row.
        let groups = starts.x.chunks(4).zip(starts.slopes.chunks(4));
        let groups = groups.zip(starts.at.chunks_mut(4)).zip(first_steps);
        // Each group of up to four points fills the lanes; missing points repeat the last.
        for (n, (((x, s), at), first_step)) in groups.enumerate() {
            let (f, g) = load_slopes(lanes, s);
            let start = rows(lanes, x);
            let inverse = match starts.inverses {
                InverseJacobians::Local(local_map) => local_map.inverse_jacobian_row(start),
                InverseJacobians::Each(all) => matrix_rows(lanes, &all[4 * n..4 * n + x.len()]),
            };
            // g = J^-T grad F.
            let g = to_world(inverse, g);
            let square = dot(g, g, f.splat(0.0));
            // p = -F g / (|g|^2 + damping), and the scale at a zero, |g| / (|g|^2 + damping).
            let step = limits.newton_step(f, g, square);
            let zero_scale = square.sqrt() / (square + f.splat(limits.damping));
            // A magnitude of 0 marks a zero, where |p| / |F| has no value.
            let magnitude = f.abs();
            let magnitude =
                magnitude.select_below(f.splat(limits.zero_tolerance), f.splat(0.0), magnitude);
            // The point moves to xi + J^-1 p; a curved map corrects that by a Newton step of its inverse.
            let [a, b, c, d] = lane_indices(at.len());
            let from = rows(lanes, &[at[a].0, at[b].0, at[c].0, at[d].0]);
            let estimate = product(inverse, step, from);
            let (to, inverse) = match map {
                Some(map) => {
                    let end = [start[0] + step[0], start[1] + step[1], start[2] + step[2]];
                    map.refine(end, estimate, inverse)
                }
                None => (estimate, inverse),
            };
            first_step.step = to_arrays(step);
            first_step.magnitude = magnitude.row();
            first_step.zero_scale = zero_scale.row();
            first_step.inverse = matrix_to_arrays(inverse);
            let to = to_arrays(to);
            for (n, at) in at.iter_mut().enumerate() {
                at.0 = Vec3::new(to[0][n], to[1][n], to[2][n]);
            }
        }
    }
}

impl SimdKernel for SecondStepKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let limits = self.limits;
        let groups = self.slopes.chunks(4).zip(self.first_steps);
        for ((s, first_step), scales) in groups.zip(self.scales.chunks_mut(4)) {
            let (f, g) = load_slopes(lanes, s);
            let inverse = [
                load_rows(lanes, first_step.inverse[0]),
                load_rows(lanes, first_step.inverse[1]),
                load_rows(lanes, first_step.inverse[2]),
            ];
            let g = to_world(inverse, g);
            let [x, y, z] = limits.newton_step(f, g, dot(g, g, f.splat(0.0)));
            let first = load_rows(lanes, first_step.step);
            let (magnitude, zero_scale) = (
                Four::of(lanes, first_step.magnitude),
                Four::of(lanes, first_step.zero_scale),
            );
            let step = [first[0] + x, first[1] + y, first[2] + z];
            let scale = dot(step, step, f.splat(0.0)).sqrt() / magnitude;
            let scale = f.splat(0.0).select_below(magnitude, scale, zero_scale);
            let [min, max] = limits.scale_range;
            let scale = scale.min(f.splat(max)).max(f.splat(min)).row();
            scales.copy_from_slice(&scale[..scales.len()]);
        }
    }
}

#[inline(always)]
fn load_rows<L: Lanes>(lanes: L, v: [[f64; 4]; 3]) -> [Four<L>; 3] {
    [
        Four::of(lanes, v[0]),
        Four::of(lanes, v[1]),
        Four::of(lanes, v[2]),
    ]
}

/// Takes the first step: moves the reference coordinates to its end. `first_steps` has an entry for each four points.
/// `map` corrects the end of a step in a curved element; without it the map counts as affine. `starts.at` changes.
pub(super) fn take_first_step(
    limits: StepLimits,
    map: Option<CurvedMap>,
    starts: StepStarts,
    first_steps: &mut [FirstStep],
) {
    simd::run(FirstStepKernel(limits, map, starts, first_steps));
}

/// Takes the second step, from values and gradients at the end of the first, and clamps the scales. `scales` has an
/// entry for each point, in distance per field unit.
pub(super) fn take_second_step(
    limits: StepLimits,
    slopes: &[(f64, Vec3)],
    first_steps: &[FirstStep],
    scales: &mut [f64],
) {
    simd::run(SecondStepKernel {
        limits,
        slopes,
        first_steps,
        scales,
    });
}
