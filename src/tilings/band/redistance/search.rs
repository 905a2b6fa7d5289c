//! The nearest points to the samples of a leaf, by recursive halving of the leaf and its list of candidates.
//!
//! A leaf has 512 samples and often thousands of points within reach. The list of candidates shrinks with each halving,
//! 8, 4, 2 samples along an edge, and only the last ones are measured against all eight samples (`block`). No candidate
//! is lost, so that the nearest point is exact.

use super::super::leaf::LEAF;
use super::MovedLeaf;
use super::block::{Block, OffsetLengths};
use super::candidates::{CandidateTest, Coordinates, Cube, Nearest, NearestToCentre, PointList};
use super::surface_points::Point;
use super::wedge::Wedge;
use druse_geometry::simd::run;
use std::cell::Cell;

/// Steps to the leaves that hold a sample less than `reach` voxels away from one of a leaf: ascending.
pub(super) fn around(reach: f32) -> Vec<[i32; 3]> {
    // A point belongs to the leaf of the voxel before it, and lies up to one voxel beyond.
    let gap = |s: i32| match s.signum() {
        0 => 0.0,
        1 => (LEAF * s) as f32 - 7.0,
        _ => (LEAF * -s) as f32 - 8.0,
    };
    let max_steps = ((reach + 8.0) / LEAF as f32).floor() as i32;
    let all = || -max_steps..=max_steps;
    let steps = all().flat_map(|x| all().flat_map(move |y| all().map(move |z| [x, y, z])));
    let near = |s: &[i32; 3]| {
        // Both directions: the leaf may contain the voxel or the point.
        let [near, far] = [s.map(gap), s.map(|c| gap(-c))];
        let square = |g: [f32; 3]| g.iter().map(|c| c * c).sum::<f32>();
        square(near).min(square(far)) <= reach * reach
    };
    steps.filter(near).collect()
}

/// The lists of a search, reused to save allocations.
#[derive(Default)]
struct Lists {
    own: PointList,
    part: PointList,
}

thread_local! {
    static LISTS: Cell<Option<Box<Lists>>> = Cell::default();
}

/// The search of the nearest points for a leaf.
pub(super) struct Search<'a> {
    /// Samples inside, as a mask.
    inside: &'a [u64; 8],
    lengths: OffsetLengths,
    /// Points of nearby leaves: coordinates in their leaf, number of the first, and displacement of the leaf.
    parts: Vec<(Coordinates<'a>, u32, [f32; 3])>,
}

impl<'a> Search<'a> {
    /// A search for the samples of a leaf without points; they follow by [`Self::enter`].
    pub fn new(inside: &'a [u64; 8], lengths: OffsetLengths) -> Self {
        Self {
            inside,
            lengths,
            parts: Vec::new(),
        }
    }

    /// Greatest distance of a relevant point from the leaf's samples; not positive if there is none.
    pub fn max_distance(&self) -> f32 {
        self.lengths.max_distance(*self.inside, u64::MAX)
    }

    /// Adds the points of a leaf at a displacement in voxels.
    pub fn enter(&mut self, at: Coordinates<'a>, first: u32, away: [i32; 3]) {
        self.parts.push((at, first, away.map(|c| c as f32)));
    }

    /// Collects the candidates for the samples of the leaf. `max_distance` is in voxels.
    fn near(&self, max_distance: f32, list: &mut PointList) {
        let cube = Cube::new([0; 3], LEAF as usize, self.lengths.spacing);
        let mut nearest_to_centre = NearestToCentre::NO_POINT;
        for (at, _, away) in &self.parts {
            let cube = cube.relative_to(*away);
            let own = run(Nearest { at: *at, cube });
            if own.square < nearest_to_centre.square {
                nearest_to_centre = own.relative_to(away.map(|c| -c));
            }
        }
        list.clear();
        for (at, first, away) in &self.parts {
            let test = CandidateTest {
                cube: cube.relative_to(*away),
                nearest_to_centre: nearest_to_centre.relative_to(*away),
                max_distance,
            };
            list.add(*at, test, *away, *first);
        }
    }

    /// Computes the values and mask of the leaf. Values without a near point are minus or plus the background, and
    /// inactive.
    pub fn leaf(&self, points: &[Point], wedges: &[Wedge]) -> MovedLeaf {
        let background = self.lengths.background;
        let mut leaf = MovedLeaf {
            mask: [0; 8],
            values: std::array::from_fn(|n| {
                let is_inside = self.inside[n >> 6] >> (n & 63) & 1 == 1;
                if is_inside { -background } else { background }
            }),
        };
        let mut lists = LISTS.take().unwrap_or_default();
        let Lists { own, part } = &mut *lists;
        // Candidates of the leaf, then of its eight parts of 4^3 samples; [`Block`] tests these for 2^3 samples.
        self.near(self.max_distance(), own);
        for n in (0..8).filter(|_| !own.numbers.is_empty()) {
            let corner = [n >> 2, n >> 1 & 1, n & 1].map(|c| 4 * c);
            // Bits 8 y + z of four rows of four samples.
            let max_distance = self.most_of::<4>(corner, 0x0f0f_0f0f);
            if max_distance <= 0.0 {
                continue;
            }
            let cube = Cube::new(corner, 4, self.lengths.spacing);
            part.narrow(own, cube, max_distance);
            if !part.numbers.is_empty() {
                self.part(part, points, wedges, corner, &mut leaf);
            }
        }
        LISTS.set(Some(lists));
        leaf
    }

    /// [`Search::max_distance`] for N^3 samples at a corner; `all` holds their bits in a word for corner (0, 0, 0).
    fn most_of<const N: usize>(&self, [x, y, z]: [usize; 3], all: u64) -> f32 {
        let all = all << (8 * y + z);
        let inside: [u64; N] = std::array::from_fn(|n| self.inside[x + n] & all);
        self.lengths.max_distance(inside, all)
    }

    /// Computes the values of 4^3 samples from their least one, `corner`. `list` holds the candidates among `points`. A
    /// part that no point is near keeps its values.
    fn part(
        &self,
        list: &PointList,
        points: &[Point],
        wedges: &[Wedge],
        corner: [usize; 3],
        leaf: &mut MovedLeaf,
    ) {
        // Bits of a word are 8 y + z: two rows of two bits make four samples of one x.
        for n in 0..8 {
            let [x, y, z] = [
                corner[0] + 2 * (n >> 2),
                corner[1] + 2 * (n >> 1 & 1),
                corner[2] + 2 * (n & 1),
            ];
            let max_distance = self.most_of::<2>([x, y, z], 0b11_0000_0011);
            if max_distance <= 0.0 {
                continue;
            }
            let bit = 8 * y + z;
            let four = |slab: usize| {
                let row = self.inside[slab] >> bit;
                (row & 0b11 | row >> 6 & 0b1100) as u8
            };
            let found = run(Block {
                list,
                points,
                wedges,
                first: [x, y, z],
                max_distance,
                inside: four(x) | four(x + 1) << 4,
                lengths: self.lengths,
            });
            let Some((values, within)) = found else {
                continue;
            };
            // Lanes to voxels of the leaf, x slowest.
            for (m, v) in values.into_iter().enumerate() {
                let bit = bit + 8 * (m >> 1 & 1) + (m & 1);
                leaf.values[64 * (x + (m >> 2)) + bit] = v;
                leaf.mask[x + (m >> 2)] |= u64::from(within >> m & 1) << bit;
            }
        }
    }
}
