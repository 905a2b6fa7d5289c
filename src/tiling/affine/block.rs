//! Blocks of a lattice's samples, and what they have in common.

use super::rule::Wanted;
use crate::field::{Point, SampleLattice};
use crate::frame::{Vec3, WorldPoint};
use crate::tiling::boundary::Known;
use crate::tiling::fill::BLOCK;
use crate::tiling::locality::Near;

/// Samples of a block.
pub(super) const VOLUME: usize = BLOCK * BLOCK * BLOCK;
/// Of boxes with so many edges of one sample's distance, in such distances.
const DIAGONALS: [f64; 4] = [0.0, 1.0, std::f64::consts::SQRT_2, 1.732_050_807_568_877_2];

/// The places of a block that has a single sample along an axis, by axis.
const SINGLE: [u8; 3] = [0x0f, 0x33, 0x55];

/// The blocks' extent along an axis: coordinates of the first and of the last sample, and between them.
#[derive(Clone, Copy)]
pub(super) struct Along {
    ends: [f64; BLOCK],
    middle: f64,
    /// Whether they are the same sample, the lattice's last one.
    is_single: bool,
}

/// A block of samples, and the part of the lattice that it is of.
#[derive(Clone, Copy)]
pub(super) struct Block {
    /// The how manieth along each axis.
    at: [u32; 3],
    part: u32,
    /// Its samples among the eight places of a block: a bit each.
    pub places: u8,
    /// From the centre to the farthest sample, world units.
    pub radius: f64,
    /// Storage index of the first sample.
    start: usize,
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
    /// Blocks along each axis.
    pub along: &'a [Vec<Along>; 3],
    /// Of the eight samples of a block, storage indices from the first one's on.
    pub offsets: [usize; VOLUME],
}

impl<'a> Scene<'a> {
    #[inline]
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

    /// Writes all samples of a whole block.
    #[inline]
    pub fn fill(&self, block: &Block, values: &[f32; VOLUME], out: &mut [f32]) {
        for (row, offset) in values
            .chunks_exact(BLOCK)
            .zip(self.offsets.iter().step_by(BLOCK))
        {
            let first = block.start + offset;
            out[first..first + BLOCK].copy_from_slice(row);
        }
    }

    /// Where a block's sample lies.
    #[inline]
    pub fn point(&self, block: &Block, n: usize) -> Vec3 {
        let ([x, y, z], [i, j, k]) = (block.ends(self), place(n));
        Vec3::new(x[i], y[j], z[k])
    }
}

impl Along {
    /// Of a lattice, along an axis.
    pub fn all(lattice: &SampleLattice<WorldPoint>, axis: usize) -> impl Iterator<Item = Self> {
        let count = lattice.counts[axis];
        (0..count).step_by(BLOCK).map(move |first| {
            let last = (first + BLOCK - 1).min(count - 1);
            let at = |n| lattice.origin.stepped(lattice.step, [n; 3]).0[axis];
            let ends = [at(first), at(last)];
            Self {
                ends,
                middle: f64::midpoint(ends[0], ends[1]),
                is_single: last == first,
            }
        })
    }
}

impl Block {
    /// Of the block from a sample on, one of a block's size along each axis.
    #[inline]
    pub fn new(first: [usize; 3], part: usize, scene: &Scene) -> Self {
        let [_, ny, nz] = scene.lattice.counts;
        let (mut places, mut edges) = (0xff, 0);
        for (a, own) in SINGLE.into_iter().enumerate() {
            if scene.along[a][first[a] / BLOCK].is_single {
                places &= own;
            } else {
                edges += 1;
            }
        }
        Self {
            at: first.map(|i| (i / BLOCK) as u32),
            part: part as u32,
            places,
            radius: scene.lattice.step * DIAGONALS[edges] / 2.0,
            start: (first[0] * ny + first[1]) * nz + first[2],
        }
    }

    /// The part of the lattice that it is of, by number.
    #[inline]
    pub fn part(&self) -> usize {
        self.part as usize
    }

    /// Coordinates of its first and of its last sample, by axis.
    #[inline]
    pub fn ends(&self, scene: &Scene) -> [[f64; BLOCK]; 3] {
        let [i, j, k] = self.at.map(|i| i as usize);
        let [x, y, z] = scene.along;
        [x[i].ends, y[j].ends, z[k].ends]
    }

    /// Its centre.
    #[inline]
    pub fn middle(&self, scene: &Scene) -> [f64; 3] {
        let [i, j, k] = self.at.map(|i| i as usize);
        let [x, y, z] = scene.along;
        [x[i].middle, y[j].middle, z[k].middle]
    }

    #[inline]
    pub fn is_whole(&self) -> bool {
        self.places == 0xff
    }
}

/// A place of the eight of a block, by axis.
pub(super) fn place(n: usize) -> [usize; 3] {
    [n >> 2 & 1, n >> 1 & 1, n & 1]
}
