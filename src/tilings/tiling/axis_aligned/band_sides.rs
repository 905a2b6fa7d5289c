//! The side of the band on which leaves lie, for cubes of 4^3 leaves.
//!
//! Over a part with centre c and half edges h, F is within `sum_a |dF/da| h_a + R` of F(c), with Taylor's remainder R.
//! A part whose least F is above the first bound is outside. Parts are bits along z in `[x][y]`, two a leaf and axis.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::F32_PRECISION;
use super::kernel::{PeriodicField, to_arrays};
use druse_geometry::frame::Vec3;
use druse_geometry::simd::{Lanes, SimdKernel};

/// Steps from a cube's first sample to the centres of the two parts of each of its leaves along an axis. Each
/// part has five samples; together they are the leaf and the layer around it.
const PART_CENTRES: [f64; 8] = [1.0, 6.0, 9.0, 14.0, 17.0, 22.0, 25.0, 30.0];
/// Steps from a part's centre to its first and last sample.
const PART_HALF_STEPS: f64 = 2.0;

/// The sides of a cube of 4^3 leaves, not cut at the box. Returns the leaves that are inside with all eight
/// parts, and those that are outside with all: bit `16 x + 4 y + z`.
pub(super) struct SidesKernel<'a> {
    pub field: &'a PeriodicField,
    /// The first sample, world units, as is `step`.
    pub first: Vec3,
    pub step: f64,
    /// The field is out of the band above the first and below minus the second.
    pub bounds: [f32; 2],
}

impl SimdKernel for SidesKernel<'_> {
    type Output = [u64; 2];
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [u64; 2] {
        let Self {
            field,
            first,
            step,
            bounds,
        } = self;
        let (products, periods) = (&field.products, &field.periods);
        let mut tables = [[[0.0; 8]; druse_cells::cell::FUNCTIONS]; 3];
        let mut halves = [[0.0; 8]; 3];
        for axis in 0..3 {
            let mut parts = [0.0; 8];
            // The parts of the leaves along each axis, five samples each, clamped to the box.
            for n in 0..8 {
                let centre = first[axis] + PART_CENTRES[n] * step;
                let a = periods.inside(axis, centre - PART_HALF_STEPS * step);
                let b = periods.inside(axis, centre + PART_HALF_STEPS * step);
                parts[n] = periods.part_of(axis, f64::midpoint(a, b));
                halves[axis][n] = ((b - a) / 2.0) as f32 * field.rule.wave_number[axis];
            }
            tables[axis] = to_arrays(l, &products.along(l, &parts));
        }
        let [x, y, z] = &tables;
        let [above, below] =
            products.classify_boxes(l, [x, y, z], &halves, bounds, F32_PRECISION as f32);
        // A leaf is on a side if all its parts are.
        [leaves_of(&below), leaves_of(&above)]
    }
}

/// The leaves whose parts are all marked, from a bit for each part along z, by `[x][y]`.
#[inline(always)]
fn leaves_of(parts: &[[u8; 8]; 8]) -> u64 {
    let mut leaves = 0;
    for x in 0..4 {
        for y in 0..4 {
            let [a, b] = [&parts[2 * x], &parts[2 * x + 1]];
            let all = a[2 * y] & a[2 * y + 1] & b[2 * y] & b[2 * y + 1];
            for z in 0..4 {
                let is_marked = all >> (2 * z) & 3 == 3;
                leaves |= u64::from(is_marked) << (16 * x + 4 * y + z);
            }
        }
    }
    leaves
}
