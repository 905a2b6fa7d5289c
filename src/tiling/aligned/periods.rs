//! Where the samples of rows along the axes lie in the periods of a box of equal hexes.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use crate::frame::{Aabb, Vec3};
use crate::lanes::Lanes;

/// Parts of a period, -1/2 to 1/2, of eight places along each axis.
pub(super) type Places = [[f32; 8]; 3];

/// Where the periods lie in world space, and the box that they fill.
#[derive(Clone, Copy, Debug)]
pub(super) struct Periods {
    /// Where the reference coordinates are 0.
    pub centre: Vec3,
    /// Periods per world unit.
    pub rate: Vec3,
    pub room: Aabb,
}

/// World coordinates of a row of samples along each axis.
#[derive(Clone, Copy)]
pub(super) struct Rows {
    pub origin: Vec3,
    pub step: f64,
    /// Whether they are clamped to the box.
    pub clamp: bool,
}

impl Periods {
    /// The hexes that a box meets, numbered from the least corner, z fastest.
    pub fn for_each_hex(&self, region: &Aabb, mut found: impl FnMut(usize)) {
        let counts = self.room.size().component_mul(&self.rate);
        let counts = [0, 1, 2].map(|a| counts[a].round() as usize);
        let along = |axis: usize| {
            let place = |x: f64| (x - self.room.min[axis]) * self.rate[axis];
            // Negative places are those of the first hex, if the box reaches it at all.
            let (first, end) = (place(region.min[axis]), place(region.max[axis]));
            first.max(0.0) as usize..counts[axis].min((end + 1.0).max(0.0) as usize)
        };
        let [x, y, z] = [0, 1, 2].map(along);
        for (i, j) in x.flat_map(|i| y.clone().map(move |j| (i, j))) {
            let row = (i * counts[1] + j) * counts[2];
            z.clone().for_each(|k| found(row + k));
        }
    }

    /// Parts of a period at so many steps from a row's origin along an axis.
    #[inline(always)]
    pub fn parts<L: Lanes>(&self, l: L, axis: usize, rows: &Rows, steps: &[f64; 8]) -> [f32; 8] {
        let mut parts = [0.0; 8];
        for half in [0, 4] {
            let mut four = [0.0; 4];
            four.copy_from_slice(&steps[half..half + 4]);
            let ahead = l.mul_four(l.four(four), l.all_four(rows.step));
            let mut x = l.add_four(ahead, l.all_four(rows.origin[axis]));
            if rows.clamp {
                x = l.max_four(x, l.all_four(self.room.min[axis]));
                x = l.min_four(x, l.all_four(self.room.max[axis]));
            }
            parts[half..half + 4].copy_from_slice(&self.part(l, axis, x));
        }
        parts
    }

    /// Parts of a period of four coordinates along an axis.
    #[inline(always)]
    pub fn part<L: Lanes>(&self, l: L, axis: usize, x: L::D) -> [f32; 4] {
        let from = l.sub_four(x, l.all_four(self.centre[axis]));
        let u = l.mul_four(from, l.all_four(self.rate[axis]));
        let whole = l.floor_four(l.add_four(u, l.all_four(0.5)));
        l.singles(l.sub_four(u, whole))
    }

    /// The same along all three.
    #[inline(always)]
    pub fn places<L: Lanes>(&self, l: L, rows: &Rows, steps: &[f64; 8]) -> Places {
        [
            self.parts(l, 0, rows, steps),
            self.parts(l, 1, rows, steps),
            self.parts(l, 2, rows, steps),
        ]
    }
}

/// Steps to the samples of a leaf.
pub(super) const EACH: [f64; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
/// To those that follow.
pub(super) const BEHIND: [f64; 8] = [8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];
