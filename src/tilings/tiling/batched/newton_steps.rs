//! Both Newton steps of rule Q in an element ([`newton_distance`](crate::tiling::newton_distance)), eight points at a time.
//!
//! Points lie in rows of eight in double precision; F and gradients come in single precision. Between the steps the
//! caller evaluates the cell at all points. The laws `values_and_signs_in_bulk_are_those_of_single_points` and
//! `values_in_bulk_are_those_of_single_points_in_graded_elements_of_every_kind` allow 1e-4 voxel, the former 5e-3 with
//! two voxels along an element.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand. Closures
// are not: no SIMD arithmetic is written in them.
#![allow(clippy::inline_always)]

use super::sample_batch::{MAX_SAMPLES, ROW, Row};
use crate::tiling::inverse_map::matrix_rows;
use crate::tiling::newton_distance::{FirstStep, StepLimits, StepMap};
use druse_geometry::frame::{CellPoint, Vec3};
use druse_geometry::simd::{self, Eight, Lanes, SimdKernel};

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
    /// d xi / d x at the end of the first step, by rows, in curved elements.
    inverse: [[Row; 3]; 3],
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
            inverse: [[row; 3]; 3],
        }
    }
}

impl NewtonBatch {
    /// Takes the first step: all points move to its end.
    pub fn take_first_step(&mut self, limits: StepLimits, map: StepMap) {
        simd::run(FirstStepKernel(limits, map, self));
    }

    /// Takes the second step: computes the scales.
    pub fn take_second_step(&mut self, limits: StepLimits, map: StepMap) {
        simd::run(SecondStepKernel(limits, map, self));
    }

    /// Distance per field unit at the start of point `n`.
    pub fn scale(&self, n: usize) -> f64 {
        self.scale[n / ROW % (MAX_SAMPLES / ROW)][n % ROW]
    }
}

struct FirstStepKernel<'a>(StepLimits, StepMap<'a>, &'a mut NewtonBatch);

struct SecondStepKernel<'a>(StepLimits, StepMap<'a>, &'a mut NewtonBatch);

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

/// Loads row `row` of each coordinate.
#[inline(always)]
fn load_rows<L: Lanes>(lanes: L, rows: &[Row; 3], row: usize) -> [Eight<L>; 3] {
    [
        Eight::of(lanes, &rows[0][row]),
        Eight::of(lanes, &rows[1][row]),
        Eight::of(lanes, &rows[2][row]),
    ]
}

impl SimdKernel for FirstStepKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self(limits, map, newton) = self;
        for row in 0..newton.len.div_ceil(ROW).min(MAX_SAMPLES / ROW) {
            let Some((f, g)) = load_slopes(lanes, &newton.slopes, row) else {
                break;
            };
            let Some(points) = newton.at.as_chunks_mut::<ROW>().0.get_mut(row) else {
                break;
            };
            let mut starts = [[0.0; 3]; ROW];
            for (to, at) in starts.iter_mut().zip(&*points) {
                *to = at.0.into();
            }
            let mut at = Eight::points(lanes, starts);
            let first = limits.first_step(map, &mut at, f, g);
            newton.magnitude[row] = first.magnitude.row();
            newton.scale[row] = first.zero_scale.row();
            for (to, step) in newton.step.iter_mut().zip(first.step) {
                to[row] = step.row();
            }
            if let StepMap::Curved(_) = map {
                for (to, values) in newton.inverse.iter_mut().zip(first.inverse) {
                    for (to, value) in to.iter_mut().zip(values) {
                        to[row] = value.row();
                    }
                }
            }
            let [x, y, z] = [at[0].row(), at[1].row(), at[2].row()];
            for (n, at) in points.iter_mut().enumerate() {
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
        for row in 0..newton.len.div_ceil(ROW).min(MAX_SAMPLES / ROW) {
            let Some((f, g)) = load_slopes(lanes, &newton.slopes, row) else {
                break;
            };
            let [a, b, c] = &newton.inverse;
            let first = FirstStep {
                step: load_rows(lanes, &newton.step, row),
                magnitude: Eight::of(lanes, &newton.magnitude[row]),
                zero_scale: Eight::of(lanes, &newton.scale[row]),
                inverse: match map {
                    StepMap::Affine(inverse) => matrix_rows(&inverse, f),
                    StepMap::Curved(_) => [
                        load_rows(lanes, a, row),
                        load_rows(lanes, b, row),
                        load_rows(lanes, c, row),
                    ],
                },
            };
            newton.scale[row] = limits.scale(first, f, g).row();
        }
    }
}
