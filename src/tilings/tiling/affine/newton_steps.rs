//! Both Newton steps of rule Q in an affine element, eight points at a time.
//!
//! With J the element's map, the world gradient is g = J^-T grad F. A step is p = -F g / (|g|^2 + damping), at most as
//! long as the limits allow; the second starts at the end of the first with F and g evaluated anew in the same element,
//! whose field continues beyond its faces. The scale is s = |p1 + p2| / |F|, or at a zero |g| / (|g|^2 + damping),
//! within its limits. Points lie in rows of eight in double precision; F and gradients come in single precision. The
//! law `values_and_signs_in_bulk_are_those_of_single_points` allows 1e-4 voxel, 5e-3 with two voxels along an element.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand. Closures
// are not: no SIMD arithmetic is written in them.
#![allow(clippy::inline_always)]

use super::sample_batch::{MAX_SAMPLES, ROW, Row};
use crate::tiling::inverse_map::{dot, product};
use crate::tiling::local_map::LocalMap;
use crate::tiling::newton_distance::{StepLimits, to_world};
use druse_geometry::frame::{CellPoint, Vec3};
use druse_geometry::simd::{self, Eight, Lanes, Number, SimdKernel};

/// Points that take both Newton steps in one element.
pub(super) struct NewtonBatch {
    /// Reference coordinates.
    pub at: [CellPoint<3>; MAX_SAMPLES],
    /// Values there, and gradients by reference coordinates.
    pub slopes: [[f32; 4]; MAX_SAMPLES],
    pub len: usize,
    /// The first step, world units.
    step: [Row; 3],
    /// |F| at the start; 0 where the start is a zero.
    magnitude: Row,
    /// The scale at a zero; after the second step the scale of rule Q.
    scale: Row,
}

impl Default for NewtonBatch {
    fn default() -> Self {
        let row = [[0.0; ROW]; MAX_SAMPLES / ROW];
        Self {
            at: [CellPoint(Vec3::zeros()); MAX_SAMPLES],
            slopes: [[0.0; 4]; MAX_SAMPLES],
            len: 0,
            step: [row; 3],
            magnitude: row,
            scale: row,
        }
    }
}

impl NewtonBatch {
    /// Takes the first step: all points move to its end.
    pub fn take_first_step(&mut self, limits: StepLimits, map: &LocalMap) {
        simd::run(FirstStepKernel(limits, map, self));
    }

    /// Takes the second step: computes the scales.
    pub fn take_second_step(&mut self, limits: StepLimits, map: &LocalMap) {
        simd::run(SecondStepKernel(limits, map, self));
    }

    /// Distance per field unit at the start of point `n`.
    pub fn scale(&self, n: usize) -> f64 {
        self.scale[n / ROW % (MAX_SAMPLES / ROW)][n % ROW]
    }
}

struct FirstStepKernel<'a>(StepLimits, &'a LocalMap, &'a mut NewtonBatch);

struct SecondStepKernel<'a>(StepLimits, &'a LocalMap, &'a mut NewtonBatch);

/// Loads values and gradients of row `row`.
#[inline(always)]
fn load_slopes<L: Lanes>(
    lanes: L,
    all: &[[f32; 4]; MAX_SAMPLES],
    row: usize,
) -> Option<(Eight<L>, [Eight<L>; 3])> {
    let [f, x, y, z] = lanes.columns_to_rows(all.as_chunks().0.get(row)?);
    let (x, y) = (Eight::from_f32(lanes, x), Eight::from_f32(lanes, y));
    let z = Eight::from_f32(lanes, z);
    Some((Eight::from_f32(lanes, f), [x, y, z]))
}

impl SimdKernel for FirstStepKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self(limits, map, newton) = self;
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let inverse = map.inverse_rows(zero);
        for row in 0..newton.len.div_ceil(ROW).min(MAX_SAMPLES / ROW) {
            let Some((f, g)) = load_slopes(lanes, &newton.slopes, row) else {
                break;
            };
            // g = J^-T grad F.
            let g = to_world(inverse, g);
            let square = dot(g, g, zero); // |g|^2
            // p1 = -F g / (|g|^2 + damping), shortened to the limit.
            let step = limits.newton_step(f, g, square);
            let magnitude = f.abs();
            // A magnitude of 0 marks a zero: the quotient |p| / |F| has no value there.
            newton.magnitude[row] = magnitude
                .select_below(zero.splat(limits.zero_tolerance), zero, magnitude)
                .row();
            // s at a zero: |g| / (|g|^2 + damping).
            newton.scale[row] = (square.sqrt() / (square + zero.splat(limits.damping))).row();
            for (to, step) in newton.step.iter_mut().zip(step) {
                to[row] = step.row();
            }
            let Some(at) = newton.at.as_chunks_mut::<ROW>().0.get_mut(row) else {
                break;
            };
            // The point moves to xi + J^-1 p1 in reference coordinates.
            let mut starts = [[0.0; 3]; ROW];
            for (to, at) in starts.iter_mut().zip(&*at) {
                *to = at.0.into();
            }
            let from = Eight::points(lanes, starts);
            let [x, y, z] = product(inverse, step, from);
            let (x, y, z) = (x.row(), y.row(), z.row());
            for (n, at) in at.iter_mut().enumerate() {
                at.0 = Vec3::new(x[n], y[n], z[n]);
            }
        }
    }
}

impl SimdKernel for SecondStepKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self(limits, map, newton) = self;
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let inverse = map.inverse_rows(zero);
        let [min, max] = limits.scale_range;
        for row in 0..newton.len.div_ceil(ROW).min(MAX_SAMPLES / ROW) {
            let Some((f, g)) = load_slopes(lanes, &newton.slopes, row) else {
                break;
            };
            // g and p2 = (x, y, z) at the end of the first step; `step` is p1 + p2.
            let g = to_world(inverse, g);
            let [x, y, z] = limits.newton_step(f, g, dot(g, g, zero));
            let step = [
                Eight::of(lanes, &newton.step[0][row]) + x,
                Eight::of(lanes, &newton.step[1][row]) + y,
                Eight::of(lanes, &newton.step[2][row]) + z,
            ];
            let magnitude = Eight::of(lanes, &newton.magnitude[row]);
            // s = |p1 + p2| / |F|; at a zero the scale of the first step stays.
            let scale = dot(step, step, zero).sqrt() / magnitude;
            let scale = zero.select_below(magnitude, scale, Eight::of(lanes, &newton.scale[row]));
            newton.scale[row] = scale.min(zero.splat(max)).max(zero.splat(min)).row();
        }
    }
}
