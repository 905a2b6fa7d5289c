//! The nearest points of the voxels of a leaf, by halving the leaf and the list of points.

use super::super::leaf::LEAF;
use super::MovedLeaf;
use super::block::{Block, Move};
use super::candidates::{Cube, List, Middle, Nearest, Places, Reach};
use super::surface_points::Point;
use super::wedge::Wedge;
use crate::simd::run;
use std::cell::Cell;

/// Steps to the leaves that hold a sample less than `reach` voxels away from one of a leaf: ascending.
pub(super) fn around(reach: f32) -> Vec<[i32; 3]> {
    // A point lies in the leaf whose voxel it follows, up to one voxel on.
    let gap = |s: i32| match s.signum() {
        0 => 0.0,
        1 => (LEAF * s) as f32 - 7.0,
        _ => (LEAF * -s) as f32 - 8.0,
    };
    let most = ((reach + 8.0) / LEAF as f32).floor() as i32;
    let all = || -most..=most;
    let steps = all().flat_map(|x| all().flat_map(move |y| all().map(move |z| [x, y, z])));
    let near = |s: &[i32; 3]| {
        // Both ways: the leaf may be the one that looks, or the one that is looked for.
        let [near, far] = [s.map(gap), s.map(|c| gap(-c))];
        let square = |g: [f32; 3]| g.iter().map(|c| c * c).sum::<f32>();
        square(near).min(square(far)) <= reach * reach
    };
    steps.filter(near).collect()
}

/// The lists of a search, whose memory serves the next one.
#[derive(Default)]
struct Lists {
    own: List,
    part: List,
}

thread_local! {
    static LISTS: Cell<Option<Box<Lists>>> = Cell::default();
}

/// A leaf that looks for points.
pub(super) struct Search<'a> {
    inside: &'a [u64; 8],
    lengths: Move,
    /// Points of leaves about this one: where they lie in their leaf, the first one's number, and how far
    /// away the leaf is.
    parts: Vec<(Places<'a>, u32, [f32; 3])>,
}

impl<'a> Search<'a> {
    pub fn new(inside: &'a [u64; 8], lengths: Move) -> Self {
        Self {
            inside,
            lengths,
            parts: Vec::new(),
        }
    }

    /// How far away from the leaf's voxels points can matter, voxels; not positive if they cannot.
    pub fn most(&self) -> f32 {
        self.lengths.most(*self.inside, u64::MAX)
    }

    /// Enters the points of a leaf that is so many voxels away.
    pub fn enter(&mut self, at: Places<'a>, first: u32, away: [i32; 3]) {
        self.parts.push((at, first, away.map(|c| c as f32)));
    }

    /// What may be nearest to a voxel of the leaf.
    fn near(&self, most: f32, list: &mut List) {
        let cube = Cube::new([0; 3], LEAF as usize);
        let mut middle = Middle::NONE;
        for (at, _, away) in &self.parts {
            let cube = cube.seen_from(*away);
            let own = run(Nearest { at: *at, cube });
            if own.square < middle.square {
                middle = own.seen_from(away.map(|c| -c));
            }
        }
        list.clear();
        for (at, first, away) in &self.parts {
            let reach = Reach {
                cube: cube.seen_from(*away),
                middle: middle.seen_from(*away),
                most,
            };
            list.add(*at, reach, *away, *first);
        }
    }

    /// The leaf's values and mask.
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
        self.near(self.most(), own);
        for n in (0..8).filter(|_| !own.of.is_empty()) {
            let corner = [n >> 2, n >> 1 & 1, n & 1].map(|c| 4 * c);
            let most = self.most_of::<4>(corner, 0x0f0f_0f0f);
            if most <= 0.0 {
                continue;
            }
            part.narrow(own, Cube::new(corner, 4), most);
            if !part.of.is_empty() {
                self.part(part, (points, wedges), corner, &mut leaf);
            }
        }
        LISTS.set(Some(lists));
        leaf
    }

    /// [`Search::most`] of N^3 voxels, whose bits in a word are those of `all` when they are the first ones.
    fn most_of<const N: usize>(&self, [x, y, z]: [usize; 3], all: u64) -> f32 {
        let all = all << (8 * y + z);
        let inside: [u64; N] = std::array::from_fn(|n| self.inside[x + n] & all);
        self.lengths.most(inside, all)
    }

    /// The values of 4^3 voxels.
    fn part(
        &self,
        list: &List,
        (points, wedges): (&[Point], &[Wedge]),
        corner: [usize; 3],
        leaf: &mut MovedLeaf,
    ) {
        for n in 0..8 {
            let [x, y, z] = [
                corner[0] + 2 * (n >> 2),
                corner[1] + 2 * (n >> 1 & 1),
                corner[2] + 2 * (n & 1),
            ];
            let most = self.most_of::<2>([x, y, z], 0b11_0000_0011);
            if most <= 0.0 {
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
                most,
                inside: four(x) | four(x + 1) << 4,
                lengths: self.lengths,
            });
            let Some((values, within)) = found else {
                continue;
            };
            for (m, v) in values.into_iter().enumerate() {
                let bit = bit + 8 * (m >> 1 & 1) + (m & 1);
                leaf.values[64 * (x + (m >> 2)) + bit] = v;
                leaf.mask[x + (m >> 2)] |= u64::from(within >> m & 1) << bit;
            }
        }
    }
}
