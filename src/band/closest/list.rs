//! Lists of points, and which of them are near to a place.
// Small functions of hot paths, which must be compiled for the processor that their caller is for;
// arithmetic on lanes stands in no closure, which would not be.
#![allow(clippy::inline_always)]

use crate::lanes::{Lanes, Work, run};

/// Room for rounding, voxels.
const SLACK: f32 = 1e-3;
/// Coordinates of points.
pub(super) type Places<'a> = [&'a [f32]; 3];

/// Points, by coordinates from a leaf's least voxel on, with their numbers.
#[derive(Default)]
pub(super) struct List {
    pub at: [Vec<f32>; 3],
    pub of: Vec<u32>,
    /// Which points of another list are taken.
    pub taken: Vec<u32>,
}

impl List {
    pub fn clear(&mut self) {
        self.of.clear();
        for at in &mut self.at {
            at.clear();
        }
    }

    pub fn places(&self) -> Places<'_> {
        let [x, y, z] = &self.at;
        [x, y, z]
    }

    /// Takes over what of a list may be nearest to a voxel within `radius` of `centre`, and at most `most`
    /// from it.
    pub fn narrow(&mut self, wide: &Self, centre: [f32; 3], (radius, most): (f32, f32)) {
        let at = wide.places();
        let limit = limit(run(Least { at, centre }), radius, most);
        self.clear();
        let taken = taken(&mut self.taken, at, centre, limit);
        for (to, from) in self.at.iter_mut().zip(at) {
            to.extend(taken.iter().map(|&n| from[n as usize]));
        }
        self.of.extend(taken.iter().map(|&n| wide.of[n as usize]));
    }

    /// Fills the last eight up with points that are nearest to nothing.
    pub fn fill_up(&mut self) {
        let whole = self.of.len().next_multiple_of(8);
        for at in &mut self.at {
            at.resize(whole, f32::INFINITY);
        }
        self.of.resize(whole, 0);
    }
}

/// Which points are nearer to `centre` than the root of `limit`.
pub(super) fn taken<'a>(
    room: &'a mut Vec<u32>,
    at: Places,
    centre: [f32; 3],
    limit: f32,
) -> &'a [u32] {
    if room.len() < at[0].len() {
        room.resize(at[0].len(), 0);
    }
    let count = run(Nearer {
        at,
        centre,
        limit,
        taken: room,
    });
    &room[..count]
}

/// The square of how far from a centre points can be that are nearest to something within `radius` of it,
/// and at most `most` from that, when the nearest to the centre is the root of `least` away.
pub(super) fn limit(least: f32, radius: f32, most: f32) -> f32 {
    let limit = (least.sqrt() + 2.0 * radius).min(most + radius) + SLACK;
    limit * limit
}

/// Squares of the distances of eight points from a centre.
#[inline(always)]
pub(super) fn squares<L: Lanes>(l: L, [x, y, z]: [&[f32; 8]; 3], centre: [L::F; 3]) -> L::F {
    let x = l.sub(l.load(x), centre[0]);
    let y = l.sub(l.load(y), centre[1]);
    let z = l.sub(l.load(z), centre[2]);
    l.fused(x, x, l.fused(y, y, l.mul(z, z)))
}

/// The same of one point.
#[inline(always)]
fn square([x, y, z]: [f32; 3], centre: [f32; 3]) -> f32 {
    let [x, y, z] = [x - centre[0], y - centre[1], z - centre[2]];
    x * x + y * y + z * z
}

/// The least square of the distances of points from a centre.
pub(super) struct Least<'a> {
    pub at: Places<'a>,
    pub centre: [f32; 3],
}

impl Work for Least<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> f32 {
        let [a, b, c] = self.centre;
        let centre = [l.splat(a), l.splat(b), l.splat(c)];
        let [(xs, x), (ys, y), (zs, z)] = self.at.map(|at| at.as_chunks::<8>());
        let mut least = l.splat(f32::INFINITY);
        for ((x, y), z) in xs.iter().zip(ys).zip(zs) {
            least = l.min(squares(l, [x, y, z], centre), least);
        }
        let mut row = [0.0; 8];
        l.store(least, &mut row);
        let mut least = f32::INFINITY;
        for square in row {
            least = least.min(square);
        }
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            least = least.min(square([x, y, z], self.centre));
        }
        least
    }
}

/// The points nearer to a centre than the root of a limit.
struct Nearer<'a> {
    at: Places<'a>,
    centre: [f32; 3],
    limit: f32,
    taken: &'a mut [u32],
}

impl Work for Nearer<'_> {
    /// How many they are.
    type Output = usize;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> usize {
        let [a, b, c] = self.centre;
        let centre = [l.splat(a), l.splat(b), l.splat(c)];
        let limit = l.splat(self.limit);
        let [(xs, x), (ys, y), (zs, z)] = self.at.map(|at| at.as_chunks::<8>());
        let (mut first, mut count) = (0, 0);
        for ((x, y), z) in xs.iter().zip(ys).zip(zs) {
            let mut bits = l.below(squares(l, [x, y, z], centre), limit);
            while bits != 0 {
                self.taken[count] = first + bits.trailing_zeros();
                count += 1;
                bits &= bits - 1;
            }
            first += 8;
        }
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            if square([x, y, z], self.centre) < self.limit {
                self.taken[count] = first;
                count += 1;
            }
            first += 1;
        }
        count
    }
}
