//! Distances of a lattice's samples from many triangles.
//!
//! The lattice is halved into blocks down to single samples. A block of radius r about q whose nearest
//! triangle is d away keeps the triangles nearer to q than d + 2 r: no other is the nearest of any of
//! its samples. Whether a triangle may be so near is told by the disc around it, in single precision,
//! eight at a time; what is left is measured exactly. Beyond a distance of interest nothing is measured.
// Small functions of a hot path, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::rows;
use super::soup::{PACK, Pack, Soup};
use super::triangle::closest_point;
use crate::field::SampleLattice;
use crate::frame::{Vec3, WorldPoint};
use crate::simd::{self, Lanes, Work};

/// Relative rounding of squared lower bounds, for the cancellation within them too.
const RELATIVE: f32 = 1e-5;
/// Rounding of places in the tree's frame, where they lie in [-1, 1].
const ABSOLUTE: f32 = 1e-6;
/// Samples of blocks whose triangles are sifted: 4^3, 2^3.
const SIFTED: [usize; 2] = [64, 8];
/// So many triangles of a block are measured from eight samples at a time.
const ROW_TRIANGLES: [usize; 2] = [64, 32];

/// Distances of a lattice's samples from the triangles in some packs of a soup, among which must be the
/// nearest of each sample that is nearer than `near`: to the bit those of [`closest_point`]. Other samples
/// get a number that is not less than `near`.
pub(super) fn distances(
    soup: &Soup,
    packs: &[u32],
    lattice: &SampleLattice<WorldPoint>,
    near: f64,
    out: &mut [f64],
) {
    if packs.is_empty() {
        out.fill(2.0 * near);
        return;
    }
    simd::run(Sampling {
        soup,
        all: soup.packs(),
        packs,
        lattice,
        near,
        out,
    });
}

/// The greatest squared bound of what may be within `reach`.
#[inline(always)]
fn limit(reach: f32) -> f32 {
    let reach = reach * (1.0 + RELATIVE) + ABSOLUTE;
    reach * reach
}

/// Squared lower bounds of the distances of eight triangles from a place.
#[inline(always)]
fn bounds<L: Lanes>(l: L, pack: &Pack, q: &[L::F; 3]) -> L::F {
    let (mut all, mut height) = (l.splat(0.0), l.splat(0.0));
    for a in 0..3 {
        let d = l.sub(q[a], l.load(&pack.centre[a]));
        all = l.fused(d, d, all);
        height = l.fused(d, l.load(&pack.normal[a]), height);
    }
    let height = l.mul(height, height);
    let zero = l.splat(0.0);
    let across = l.sub(
        l.mul(all, l.splat(1.0 - RELATIVE)),
        l.mul(height, l.splat(1.0 + RELATIVE)),
    );
    let across = l.sub(l.sqrt(l.max(across, zero)), l.load(&pack.radius));
    let across = l.max(across, zero);
    l.mul(l.fused(across, across, height), l.splat(1.0 - RELATIVE))
}

struct Sampling<'a> {
    soup: &'a Soup,
    all: &'a [Pack],
    packs: &'a [u32],
    lattice: &'a SampleLattice<WorldPoint>,
    near: f64,
    out: &'a mut [f64],
}

/// Packs that may hold the nearest triangle of a sample of a block, and bounds from the block's centre.
#[derive(Default)]
struct Level {
    packs: Vec<u32>,
    squared: Vec<[f32; PACK]>,
}

/// A range of sample numbers per axis.
type Range = [[usize; 2]; 3];

fn count(range: &Range) -> usize {
    range.iter().map(|r| r[1] - r[0]).product()
}

/// The halves of a range along its longest axis.
fn halves(range: &Range) -> [Range; 2] {
    let mut axis = 0;
    for a in 1..3 {
        if range[a][1] - range[a][0] > range[axis][1] - range[axis][0] {
            axis = a;
        }
    }
    let [from, to] = range[axis];
    let (mut first, mut second) = (*range, *range);
    first[axis][1] = usize::midpoint(from, to);
    second[axis][0] = first[axis][1];
    [first, second]
}

impl Work for Sampling<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self, l: L) {
        let mut levels: [Level; 3] = Default::default();
        levels[0].packs.extend_from_slice(self.packs);
        let mut few: Vec<u32> = Vec::with_capacity(ROW_TRIANGLES[0]);
        let mut hint = PACK as u32 * self.packs[0];
        let mut waiting = vec![(self.lattice.counts.map(|c| [0, c]), 0)];
        while let Some((range, level)) = waiting.pop() {
            let mut level = level;
            if level < SIFTED.len() && count(&range) <= SIFTED[level] {
                let left = self.sift(l, &range, &mut levels, level, &mut hint, &mut few);
                if left <= ROW_TRIANGLES[level] {
                    self.measure_rows(&range, &few);
                    continue;
                }
                level += 1;
                if level == SIFTED.len() {
                    self.measure(l, &range, &levels[level], &mut hint);
                    continue;
                }
            }
            // The second half waits below the first.
            let [first, second] = halves(&range);
            waiting.push((second, level));
            waiting.push((first, level));
        }
    }
}

impl Sampling<'_> {
    #[inline(always)]
    fn number(&self, at: [usize; 3]) -> usize {
        let [_, ny, nz] = self.lattice.counts;
        (at[0] * ny + at[1]) * nz + at[2]
    }

    #[inline(always)]
    fn point(&self, at: [usize; 3]) -> Vec3 {
        use crate::field::Point;
        self.lattice.origin.stepped(self.lattice.step, at).0
    }

    /// In the tree's frame.
    #[inline(always)]
    fn place<L: Lanes>(&self, l: L, p: Vec3) -> [L::F; 3] {
        let q = self.soup.bvh.local().point(p);
        [
            l.splat(q.x as f32),
            l.splat(q.y as f32),
            l.splat(q.z as f32),
        ]
    }

    /// The greatest squared bound of what may be nearer than a distance.
    #[inline(always)]
    fn limit(&self, distance: f64) -> f32 {
        limit(self.soup.bvh.local().length(distance) as f32)
    }

    /// The squared distance from the triangle in a slot.
    #[inline(always)]
    fn squared(&self, slot: u32, p: Vec3) -> f64 {
        (closest_point(&self.soup.corners[slot as usize], p) - p).norm_squared()
    }

    /// The slot of a pack's lane; that of the last triangle beyond the end.
    #[inline(always)]
    fn slot(&self, pack: u32, lane: u32) -> u32 {
        (PACK as u32 * pack + lane).min(self.soup.corners.len() as u32 - 1)
    }

    /// Fills the next level with what may be the nearest of a sample of the range, and `few` with their
    /// slots if they are not too many; gives their number. `hint` becomes the slot of one that is near.
    #[inline(always)]
    fn sift<L: Lanes>(
        &self,
        l: L,
        range: &Range,
        levels: &mut [Level; 3],
        level: usize,
        hint: &mut u32,
        few: &mut Vec<u32>,
    ) -> usize {
        let ends = [0, 1].map(|k| self.point([0, 1, 2].map(|a| range[a][k] - k)));
        let centre = (ends[0] + ends[1]) / 2.0;
        let radius = (ends[1] - ends[0]).norm() / 2.0;
        let (left, right) = levels.split_at_mut(level + 1);
        let (from, to) = (&mut left[level], &mut right[0]);
        to.packs.clear();
        few.clear();
        let n = from.packs.len();
        if n == 0 {
            return 0;
        }
        from.squared.resize(n, [0.0; PACK]);
        let q = self.place(l, centre);
        let mut least = l.splat(f32::INFINITY);
        for i in 0..n {
            let squared = bounds(l, &self.all[from.packs[i] as usize], &q);
            least = l.min(least, squared);
            l.store(squared, &mut from.squared[i]);
        }
        let mut row = [0.0; PACK];
        l.store(least, &mut row);
        let (mut lane, mut first) = (0, f32::INFINITY);
        for n in 0..PACK {
            if row[n] < first {
                (lane, first) = (n, row[n]);
            }
        }
        for i in 0..n {
            if from.squared[i][lane] <= first {
                let found = self.slot(from.packs[i], lane as u32);
                if self.squared(found, centre) <= self.squared(*hint, centre) {
                    *hint = found;
                }
                break;
            }
        }
        let nearest = self.squared(*hint, centre).sqrt();
        let reach = (nearest + 2.0 * radius).min(self.near + radius);
        let limit = l.splat(self.limit(reach));
        let mut left = 0;
        for i in 0..n {
            let mut mask = l.below(l.load(&from.squared[i]), limit);
            if mask == 0 {
                continue;
            }
            let pack = from.packs[i];
            to.packs.push(pack);
            left += mask.count_ones() as usize;
            while mask != 0 && left <= ROW_TRIANGLES[level] {
                few.push(self.slot(pack, mask.trailing_zeros()));
                mask &= mask - 1;
            }
        }
        left
    }

    /// Distances of a block's samples from few triangles.
    #[inline(always)]
    fn measure_rows(&mut self, range: &Range, slots: &[u32]) {
        let samples = count(range);
        let mut points = [Vec3::zeros(); SIFTED[0]];
        let mut numbers = [0; SIFTED[0]];
        let mut next = 0;
        // Cubes of 2^3 follow each other: samples of a row are near each other.
        for x in (range[0][0]..range[0][1]).step_by(2) {
            for y in (range[1][0]..range[1][1]).step_by(2) {
                for z in (range[2][0]..range[2][1]).step_by(2) {
                    for i in x..(x + 2).min(range[0][1]) {
                        for j in y..(y + 2).min(range[1][1]) {
                            for k in z..(z + 2).min(range[2][1]) {
                                points[next] = self.point([i, j, k]);
                                numbers[next] = self.number([i, j, k]);
                                next += 1;
                            }
                        }
                    }
                }
            }
        }
        let numbers = &numbers[..samples];
        if slots.is_empty() {
            for &n in numbers {
                self.out[n] = 2.0 * self.near;
            }
            return;
        }
        let mut distances = [0.0; SIFTED[0]];
        let triangles = slots.iter().map(|&s| self.soup.corners[s as usize]);
        rows::distances(triangles, &points[..samples], &mut distances[..samples]);
        for (&n, distance) in numbers.iter().zip(distances) {
            self.out[n] = distance;
        }
    }

    /// Distances of a block's samples from many triangles.
    #[inline(always)]
    fn measure<L: Lanes>(&mut self, l: L, range: &Range, level: &Level, hint: &mut u32) {
        for x in range[0][0]..range[0][1] {
            for y in range[1][0]..range[1][1] {
                for z in range[2][0]..range[2][1] {
                    let p = self.point([x, y, z]);
                    let q = self.place(l, p);
                    let mut least = self.squared(*hint, p);
                    let mut most = l.splat(self.limit(least.sqrt().min(self.near)));
                    for &pack in &level.packs {
                        let squared = bounds(l, &self.all[pack as usize], &q);
                        let mut mask = l.below(squared, most);
                        while mask != 0 {
                            let slot = self.slot(pack, mask.trailing_zeros());
                            mask &= mask - 1;
                            let squared = self.squared(slot, p);
                            if squared < least {
                                (least, *hint) = (squared, slot);
                                most = l.splat(self.limit(least.sqrt().min(self.near)));
                            }
                        }
                    }
                    let n = self.number([x, y, z]);
                    self.out[n] = least.sqrt();
                }
            }
        }
    }
}
