//! Blocks of a lattice's samples, and what they have in common.

use super::rule::Wanted;
use crate::field::SampleLattice;
use crate::frame::{Vec3, WorldPoint};
use crate::tiling::boundary::Known;
use crate::tiling::fill::BLOCK;
use crate::tiling::near::Near;

/// Samples of a block.
pub(super) const VOLUME: usize = BLOCK * BLOCK * BLOCK;
/// Of boxes with so many edges of one sample's distance, in such distances.
const DIAGONALS: [f64; 4] = [0.0, 1.0, std::f64::consts::SQRT_2, 1.732_050_807_568_877_2];

/// A block of samples: its first, counts by axis, and the part of the lattice that it is of.
#[derive(Clone, Copy)]
pub(super) struct Block {
    pub first: [usize; 3],
    pub count: [usize; 3],
    pub part: usize,
    /// From the centre to the farthest sample, world units.
    pub radius: f64,
    /// Storage index of the first sample.
    pub start: usize,
}

/// What is known of a part of a lattice.
#[derive(Clone, Copy)]
pub(super) struct Part {
    /// Whether it lies deeper under the boundary than the band reaches.
    pub is_deep: bool,
    /// The greatest distance to the boundary.
    pub distance: f64,
    /// How far off the field may be taken.
    pub reach: f64,
    /// Its shore among those of all parts.
    pub shore: [usize; 2],
}

/// The part of a lattice that is being measured.
pub(super) struct Scene<'a> {
    pub component: usize,
    pub near: &'a Near,
    pub lattice: &'a SampleLattice<WorldPoint>,
    pub wanted: Wanted,
    /// Triangles of the boundary that may show, in all of the lattice and part by part.
    pub shore: Option<&'a [u32]>,
    pub shores: &'a [u32],
    /// Coordinates of the lattice's samples along each axis.
    pub at: &'a [Vec<f64>; 3],
    /// Of the eight samples of a block, storage indices from the first one's on.
    pub offsets: [usize; VOLUME],
}

impl<'a> Scene<'a> {
    pub fn known(&self, part: &Part) -> Known<'a> {
        Known {
            constant: None,
            is_deep: part.is_deep,
            distance: part.distance,
            shore: self
                .shore
                .map(|_| &self.shores[part.shore[0]..part.shore[1]]),
        }
    }

    /// Storage index of a block's sample.
    #[inline]
    pub fn index(&self, block: &Block, n: usize) -> usize {
        block.start + self.offsets[n % VOLUME]
    }

    /// Where a block's sample lies.
    pub fn point(&self, block: &Block, n: usize) -> Vec3 {
        let own = place(n);
        let along = |a: usize| self.at[a][block.first[a] + own[a]];
        Vec3::new(along(0), along(1), along(2))
    }
}

impl Block {
    /// Of the block from a sample on, not beyond another one.
    pub fn new(first: [usize; 3], last: [usize; 3], part: usize, scene: &Scene) -> Self {
        let count = [0, 1, 2].map(|a| BLOCK.min(last[a] + 1 - first[a]));
        let edges: usize = count.iter().map(|c| c - 1).sum();
        let [_, ny, nz] = scene.lattice.counts;
        Self {
            first,
            count,
            part,
            radius: scene.lattice.step * DIAGONALS[edges] / 2.0,
            start: (first[0] * ny + first[1]) * nz + first[2],
        }
    }

    /// Coordinates of its first and of its last sample, by axis.
    pub fn ends(&self, scene: &Scene) -> [[f64; BLOCK]; 3] {
        let of = |a: usize| {
            let at = &scene.at[a];
            [at[self.first[a]], at[self.first[a] + self.count[a] - 1]]
        };
        [of(0), of(1), of(2)]
    }

    pub fn is_whole(&self) -> bool {
        self.count == [BLOCK; 3]
    }

    /// Its samples among the eight places of a block: a bit each.
    pub fn places(&self) -> u64 {
        if self.is_whole() {
            return 0xff;
        }
        let has = |n: usize| (0..3).all(|a| place(n)[a] < self.count[a]);
        (0..VOLUME).fold(0, |bits, n| bits | u64::from(has(n)) << n)
    }
}

/// A place of the eight of a block, by axis.
pub(super) fn place(n: usize) -> [usize; 3] {
    [n >> 2 & 1, n >> 1 & 1, n & 1]
}
