//! On which side of the band the leaves of a cube lie, 4^3 of them at a time.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::SINGLE;
use super::kernel::{Function, stored};
use crate::frame::Vec3;
use crate::simd::{Lanes, Work};

/// Steps from a cube's first sample to the middles of the two parts of its leaves, of five samples each,
/// which together are the leaf and the layer around it.
const MIDDLES: [f64; 8] = [1.0, 6.0, 9.0, 14.0, 17.0, 22.0, 25.0, 30.0];
/// Steps from there to the first and last of the five.
const HALF: f64 = 2.0;

/// A cube of leaves whose sides are asked for, the box not regarded. Gives the leaves of whose eight parts
/// all are inside, and those of which all are outside: bit `16 x + 4 y + z`.
pub(super) struct SidesWork<'a> {
    pub function: &'a Function,
    /// The first sample.
    pub first: Vec3,
    pub step: f64,
    /// Above the first and below minus the second the field is beyond the band.
    pub bounds: [f32; 2],
}

impl Work for SidesWork<'_> {
    type Output = [u64; 2];
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [u64; 2] {
        let Self {
            function,
            first,
            step,
            bounds,
        } = self;
        let (products, periods) = (&function.products, &function.periods);
        let mut tables = [[[0.0; 8]; crate::cell::FUNCTIONS]; 3];
        let mut halves = [[0.0; 8]; 3];
        for axis in 0..3 {
            let mut parts = [0.0; 8];
            for n in 0..8 {
                let middle = first[axis] + MIDDLES[n] * step;
                let a = periods.inside(axis, middle - HALF * step);
                let b = periods.inside(axis, middle + HALF * step);
                parts[n] = periods.part_of(axis, f64::midpoint(a, b));
                halves[axis][n] = ((b - a) / 2.0) as f32 * function.rule.turn[axis];
            }
            tables[axis] = stored(l, &products.along(l, &parts));
        }
        let [x, y, z] = &tables;
        let [above, below] = products.sides(l, [x, y, z], &halves, bounds, SINGLE as f32);
        [leaves_of(&below), leaves_of(&above)]
    }
}

/// The leaves of which all parts are marked, from one bit by part along z, `[x][y]`.
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
