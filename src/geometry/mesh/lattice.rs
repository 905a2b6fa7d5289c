//! Distances of a lattice's samples from many triangles.
//!
//! The lattice is bisected into blocks. For a block of radius r about q whose nearest triangle has the distance
//! d from q, only triangles nearer to q than d + 2 r can be nearest to one of its samples. Their discs are
//! tested in single precision, eight at a time, and oriented boxes around long ones, whose discs are mostly empty;
//! the remaining triangles are measured exactly. Nothing is measured beyond a maximal distance.
// Small functions of a hot path: inlining compiles them for the instruction set of their caller.
#![allow(clippy::inline_always)]

use super::plates::{PlatePack, Plates};
use super::rows;
use super::soup::{DiscPack, PACK_SIZE, Soup};
use crate::field::SampleLattice;
use crate::frame::{Vec3, WorldPoint};
use crate::simd::{self, Lanes, SimdKernel};

/// Relative rounding of squared lower bounds, cancellation included.
const RELATIVE_ROUNDING: f32 = 1e-5;
/// Absolute rounding of coordinates in the tree's frame, where they lie in [-1, 1].
const ABSOLUTE_ROUNDING: f32 = 1e-6;
/// Numbers of samples of the blocks whose triangles are filtered: 4^3, 2^3.
const FILTER_SAMPLES: [usize; 2] = [64, 8];
/// Greatest number of triangles of such a block that are measured from eight samples at a time; a block with more is
/// divided, one of the last level measured point by point.
const MAX_ROW_TRIANGLES: [usize; 2] = [64, 32];

/// Distances of a lattice's samples from the triangles in some packs of a soup, bit for bit those by
/// [`Soup::closest_point`]. The packs must contain the nearest triangle of each sample that is nearer than
/// `max_distance`; other samples get a number of at least `max_distance`. Returns the number of measured samples.
pub(super) fn distances(
    soup: &Soup,
    packs: &[u32],
    lattice: &SampleLattice<WorldPoint>,
    max_distance: f64,
    out: &mut [f64],
) -> usize {
    if packs.is_empty() {
        out.fill(2.0 * max_distance);
        return 0;
    }
    simd::run(LatticeDistances {
        soup,
        discs: soup.packs(),
        plates: soup.plates(),
        packs,
        lattice,
        max_distance,
        out,
    })
}

/// The greatest squared lower bound of a triangle that may be within `reach`.
#[inline(always)]
fn limit(reach: f32) -> f32 {
    let reach = reach * (1.0 + RELATIVE_ROUNDING) + ABSOLUTE_ROUNDING;
    reach * reach
}

/// Squared lower bounds of the distances of eight triangles from a point. A triangle lies in a disc of its plane:
/// d^2 >= height^2 + max(0, across - radius)^2 with across^2 = |q - centre|^2 - height^2.
#[inline(always)]
fn lower_bounds<L: Lanes>(l: L, pack: &DiscPack, q: &[L::F; 3]) -> L::F {
    let (mut d2, mut height) = (l.splat(0.0), l.splat(0.0));
    for a in 0..3 {
        let d = l.sub(q[a], l.load(&pack.centre[a]));
        d2 = l.fused(d, d, d2);
        height = l.fused(d, l.load(&pack.normal[a]), height);
    }
    let height = l.mul(height, height);
    let zero = l.splat(0.0);
    let across = l.sub(
        l.mul(d2, l.splat(1.0 - RELATIVE_ROUNDING)),
        l.mul(height, l.splat(1.0 + RELATIVE_ROUNDING)),
    );
    let across = l.sub(l.sqrt(l.max(across, zero)), l.load(&pack.radius));
    let across = l.max(across, zero);
    l.mul(
        l.fused(across, across, height),
        l.splat(1.0 - RELATIVE_ROUNDING),
    )
}

/// Squared lower bounds of the distances of eight long triangles from a point.
#[inline(always)]
fn plate_bounds<L: Lanes>(l: L, pack: &PlatePack, q: &[L::F; 3]) -> L::F {
    let from = [0, 1, 2].map(|a| l.sub(q[a], l.load(&pack.centre[a])));
    let mut squared = l.splat(0.0);
    for (axis, half) in pack.axes.iter().zip(&pack.half) {
        // |along the axis| - half, where positive.
        let mut along = l.splat(0.0);
        for a in 0..3 {
            along = l.fused(from[a], l.load(&axis[a]), along);
        }
        let beyond = l.sub(l.magnitude(along), l.load(half));
        let beyond = l.max(beyond, l.splat(0.0));
        squared = l.fused(beyond, beyond, squared);
    }
    l.mul(squared, l.splat(1.0 - RELATIVE_ROUNDING))
}

struct LatticeDistances<'a> {
    soup: &'a Soup,
    discs: &'a [DiscPack],
    plates: &'a Plates,
    packs: &'a [u32],
    lattice: &'a SampleLattice<WorldPoint>,
    max_distance: f64,
    out: &'a mut [f64],
}

/// Packs that may contain the nearest triangle of a sample of a block, and their bounds from its centre.
#[derive(Default)]
struct Candidates {
    packs: Vec<u32>,
    /// Squared lower bounds of the distances from the block's centre.
    squared: Vec<[f32; PACK_SIZE]>,
}

/// Per axis the first sample index and the one behind the last.
type Range = [[usize; 2]; 3];

fn sample_count(range: &Range) -> usize {
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

impl SimdKernel for LatticeDistances<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<L: Lanes>(mut self, l: L) -> usize {
        let mut measured = 0;
        let mut levels: [Candidates; 3] = Default::default();
        levels[0].packs.extend_from_slice(self.packs);
        let mut slots: Vec<u32> = Vec::with_capacity(MAX_ROW_TRIANGLES[0]);
        let mut hint = PACK_SIZE as u32 * self.packs[0];
        let mut pending = vec![(self.lattice.counts.map(|c| [0, c]), 0)];
        while let Some((range, level)) = pending.pop() {
            let mut level = level;
            if level < FILTER_SAMPLES.len() && sample_count(&range) <= FILTER_SAMPLES[level] {
                let remaining = self.filter(l, &range, &mut levels, level, &mut hint, &mut slots);
                if remaining <= MAX_ROW_TRIANGLES[level] {
                    if remaining > 0 {
                        measured += sample_count(&range);
                    }
                    // A near triangle first: its distance rules out most others.
                    if let Some(at) = slots.iter().position(|&slot| slot == hint) {
                        slots.swap(0, at);
                    }
                    self.measure_in_rows(&range, &slots);
                    continue;
                }
                level += 1;
                if level == FILTER_SAMPLES.len() {
                    measured += sample_count(&range);
                    self.measure_points(l, &range, &levels[level], &mut hint);
                    continue;
                }
            }
            // A stack: the first half is processed next.
            let [first, second] = halves(&range);
            pending.push((second, level));
            pending.push((first, level));
        }
        measured
    }
}

impl LatticeDistances<'_> {
    #[inline(always)]
    fn index(&self, at: [usize; 3]) -> usize {
        let [_, ny, nz] = self.lattice.counts;
        (at[0] * ny + at[1]) * nz + at[2]
    }

    #[inline(always)]
    fn point(&self, at: [usize; 3]) -> Vec3 {
        use crate::field::Point;
        self.lattice.origin.stepped(self.lattice.step, at).0
    }

    /// A point in the tree's frame.
    #[inline(always)]
    fn local_point<L: Lanes>(&self, l: L, p: Vec3) -> [L::F; 3] {
        let q = self.soup.bvh.local().point(p);
        [
            l.splat(q.x as f32),
            l.splat(q.y as f32),
            l.splat(q.z as f32),
        ]
    }

    /// The greatest squared lower bound of a triangle that may be within a distance.
    #[inline(always)]
    fn limit(&self, distance: f64) -> f32 {
        limit(self.soup.bvh.local().length(distance) as f32)
    }

    /// The squared distance from the triangle in a slot.
    #[inline(always)]
    fn squared(&self, slot: u32, p: Vec3) -> f64 {
        (self.soup.closest_point(slot as usize, p) - p).norm_squared()
    }

    /// The slot of a pack's lane; the last slot for padding lanes.
    #[inline(always)]
    fn slot(&self, pack: u32, lane: u32) -> u32 {
        (PACK_SIZE as u32 * pack + lane).min(self.soup.corners.len() as u32 - 1)
    }

    /// Fills the next level with the packs that may contain the nearest triangle of a sample of the range, and
    /// `slots` with the triangles, up to the limit of the level. Returns the number of triangles. `hint`
    /// becomes the slot of a near triangle.
    #[inline(always)]
    fn filter<L: Lanes>(
        &self,
        l: L,
        range: &Range,
        levels: &mut [Candidates; 3],
        level: usize,
        hint: &mut u32,
        slots: &mut Vec<u32>,
    ) -> usize {
        let ends = [0, 1].map(|k| self.point([0, 1, 2].map(|a| range[a][k] - k)));
        let centre = (ends[0] + ends[1]) / 2.0;
        let radius = (ends[1] - ends[0]).norm() / 2.0;
        let (head, tail) = levels.split_at_mut(level + 1);
        let (from, to) = (&mut head[level], &mut tail[0]);
        to.packs.clear();
        slots.clear();
        let n = from.packs.len();
        if n == 0 {
            return 0;
        }
        from.squared.resize(n, [0.0; PACK_SIZE]);
        let q = self.local_point(l, centre);
        let mut lane_minima = l.splat(f32::INFINITY);
        for i in 0..n {
            let pack = from.packs[i];
            let mut squared = lower_bounds(l, &self.discs[pack as usize], &q);
            if let Some(plates) = self.plates.of_pack(pack) {
                squared = l.max(squared, plate_bounds(l, plates, &q));
            }
            lane_minima = l.min(lane_minima, squared);
            l.store(squared, &mut from.squared[i]);
        }
        let mut row = [0.0; PACK_SIZE];
        l.store(lane_minima, &mut row);
        let (mut lane, mut minimum) = (0, f32::INFINITY);
        for n in 0..PACK_SIZE {
            if row[n] < minimum {
                (lane, minimum) = (n, row[n]);
            }
        }
        // The triangle with the least bound is measured: the nearer the hint, the fewer triangles remain.
        for i in 0..n {
            if from.squared[i][lane] <= minimum {
                let found = self.slot(from.packs[i], lane as u32);
                if self.squared(found, centre) <= self.squared(*hint, centre) {
                    *hint = found;
                }
                break;
            }
        }
        // Nearer than d + 2 r to the centre, see the head of this file.
        let nearest = self.squared(*hint, centre).sqrt();
        let reach = (nearest + 2.0 * radius).min(self.max_distance + radius);
        let limit = l.splat(self.limit(reach));
        let mut remaining = 0;
        for i in 0..n {
            let mut mask = l.below(l.load(&from.squared[i]), limit);
            if mask == 0 {
                continue;
            }
            let pack = from.packs[i];
            to.packs.push(pack);
            remaining += mask.count_ones() as usize;
            // Beyond the level's limit the caller divides the range and needs no slots.
            while mask != 0 && remaining <= MAX_ROW_TRIANGLES[level] {
                slots.push(self.slot(pack, mask.trailing_zeros()));
                mask &= mask - 1;
            }
        }
        remaining
    }

    /// Measures a block's samples against few triangles, eight samples at a time. `slots` are those of the triangles.
    #[inline(always)]
    fn measure_in_rows(&mut self, range: &Range, slots: &[u32]) {
        let samples = sample_count(range);
        let mut points = [Vec3::zeros(); FILTER_SAMPLES[0]];
        let mut indices = [0; FILTER_SAMPLES[0]];
        let mut next = 0;
        // In order of 2^3 cubes: the eight samples of a row are close together.
        for x in (range[0][0]..range[0][1]).step_by(2) {
            for y in (range[1][0]..range[1][1]).step_by(2) {
                for z in (range[2][0]..range[2][1]).step_by(2) {
                    for i in x..(x + 2).min(range[0][1]) {
                        for j in y..(y + 2).min(range[1][1]) {
                            for k in z..(z + 2).min(range[2][1]) {
                                points[next] = self.point([i, j, k]);
                                indices[next] = self.index([i, j, k]);
                                next += 1;
                            }
                        }
                    }
                }
            }
        }
        let indices = &indices[..samples];
        if slots.is_empty() {
            for &n in indices {
                self.out[n] = 2.0 * self.max_distance;
            }
            return;
        }
        let mut distances = [0.0; FILTER_SAMPLES[0]];
        let facets = slots.iter().map(|&s| self.soup.facet(s as usize));
        rows::distances(facets, &points[..samples], &mut distances[..samples]);
        for (&n, distance) in indices.iter().zip(distances) {
            self.out[n] = distance;
        }
    }

    /// Measures the samples of the block `range` one by one against many triangles, those of the packs in `level`.
    /// `hint` is the slot of a triangle near the last sample, where the next search starts.
    #[inline(always)]
    fn measure_points<L: Lanes>(
        &mut self,
        l: L,
        range: &Range,
        level: &Candidates,
        hint: &mut u32,
    ) {
        for x in range[0][0]..range[0][1] {
            for y in range[1][0]..range[1][1] {
                for z in range[2][0]..range[2][1] {
                    let p = self.point([x, y, z]);
                    let q = self.local_point(l, p);
                    let mut nearest2 = self.squared(*hint, p);
                    // Each triangle measured may lower the distance up to which others matter.
                    let mut cutoff = l.splat(self.limit(nearest2.sqrt().min(self.max_distance)));
                    for &pack in &level.packs {
                        let squared = lower_bounds(l, &self.discs[pack as usize], &q);
                        let mut mask = l.below(squared, cutoff);
                        if mask != 0
                            && let Some(plates) = self.plates.of_pack(pack)
                        {
                            mask &= l.below(plate_bounds(l, plates, &q), cutoff);
                        }
                        while mask != 0 {
                            let slot = self.slot(pack, mask.trailing_zeros());
                            mask &= mask - 1;
                            let squared = self.squared(slot, p);
                            if squared < nearest2 {
                                (nearest2, *hint) = (squared, slot);
                                cutoff =
                                    l.splat(self.limit(nearest2.sqrt().min(self.max_distance)));
                            }
                        }
                    }
                    let n = self.index([x, y, z]);
                    self.out[n] = nearest2.sqrt();
                }
            }
        }
    }
}
