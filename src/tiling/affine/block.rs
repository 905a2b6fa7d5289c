//! Blocks of a lattice's samples, and the context that they share.

use super::rule::Quantity;
use crate::field::{Point, SampleLattice};
use crate::frame::{Vec3, WorldPoint};
use crate::tiling::boundary::RegionFacts;
use crate::tiling::fill::BLOCK_EDGE;
use crate::tiling::locality::NearElements;

/// Samples of a block.
pub(super) const VOLUME: usize = BLOCK_EDGE * BLOCK_EDGE * BLOCK_EDGE;
/// Diagonals of boxes with 0 to 3 edges of one step, in steps.
const BOX_DIAGONALS: [f64; 4] = [0.0, 1.0, std::f64::consts::SQRT_2, 1.732_050_807_568_877_2];

/// The samples of a block with only one layer along an axis, by axis: a bit each.
const SINGLE_LAYER_MASKS: [u8; 3] = [0x0f, 0x33, 0x55];

/// The extent of a block along an axis: coordinates of the first sample, the last sample and the centre.
#[derive(Clone, Copy)]
pub(super) struct BlockSpan {
    ends: [f64; BLOCK_EDGE],
    centre: f64,
    /// Whether both ends are the same sample, the last one of the lattice.
    has_one_layer: bool,
}

/// A block of samples in a part of the lattice.
#[derive(Clone, Copy)]
pub(super) struct Block {
    /// Index of the block along each axis.
    indices: [u32; 3],
    part: u32,
    /// The samples that exist among the eight of a block: a bit each.
    pub sample_mask: u8,
    /// Distance from the centre to the farthest sample, world units.
    pub radius: f64,
    /// Storage index of the first sample.
    first_index: usize,
}

/// Bounds that hold in a part of a lattice.
#[derive(Clone, Copy)]
pub(super) struct Part {
    /// Whether the part is more than w inside the boundary.
    pub is_deep: bool,
    /// Bound of the distance to the boundary.
    pub max_boundary_distance: f64,
    /// Distance from the part of the points at which the field may be evaluated.
    pub reach: f64,
    /// Range of its boundary triangles among [`FillContext::part_triangles`].
    pub triangle_range: [usize; 2],
}

/// The lattice, or the part of it, that is evaluated.
pub(super) struct FillContext<'a> {
    pub component: usize,
    pub near: &'a NearElements,
    pub lattice: &'a SampleLattice<WorldPoint>,
    pub quantity: Quantity,
    /// Boundary triangles that may affect the lattice, and those of each part.
    pub boundary_triangles: Option<&'a [u32]>,
    pub part_triangles: &'a [u32],
    /// Blocks along each axis.
    pub along: &'a [Vec<BlockSpan>; 3],
    /// Storage indices of a block's eight samples, relative to the first.
    pub offsets: [usize; VOLUME],
}

impl<'a> FillContext<'a> {
    #[inline]
    pub fn known(&self, part: &Part) -> RegionFacts<'a> {
        RegionFacts {
            field_distance: None,
            is_deep: part.is_deep,
            max_boundary_distance: part.max_boundary_distance,
            boundary_triangles: self
                .boundary_triangles
                .map(|_| &self.part_triangles[part.triangle_range[0]..part.triangle_range[1]]),
        }
    }

    /// Storage index of a block's sample.
    #[inline]
    pub fn index(&self, block: &Block, n: usize) -> usize {
        block.first_index + self.offsets[n % VOLUME]
    }

    /// Writes all samples of a full block.
    #[inline]
    pub fn fill(&self, block: &Block, values: &[f32; VOLUME], out: &mut [f32]) {
        for (row, offset) in values
            .chunks_exact(BLOCK_EDGE)
            .zip(self.offsets.iter().step_by(BLOCK_EDGE))
        {
            let first = block.first_index + offset;
            out[first..first + BLOCK_EDGE].copy_from_slice(row);
        }
    }

    /// Position of a block's sample.
    #[inline]
    pub fn point(&self, block: &Block, n: usize) -> Vec3 {
        let ([x, y, z], [i, j, k]) = (block.ends(self), sample_offset(n));
        Vec3::new(x[i], y[j], z[k])
    }
}

impl BlockSpan {
    /// The spans of all blocks of a lattice along an axis.
    pub fn all(lattice: &SampleLattice<WorldPoint>, axis: usize) -> impl Iterator<Item = Self> {
        let count = lattice.counts[axis];
        (0..count).step_by(BLOCK_EDGE).map(move |first| {
            let last = (first + BLOCK_EDGE - 1).min(count - 1);
            let at = |n| lattice.origin.stepped(lattice.step, [n; 3]).0[axis];
            let ends = [at(first), at(last)];
            Self {
                ends,
                centre: f64::midpoint(ends[0], ends[1]),
                has_one_layer: last == first,
            }
        })
    }
}

impl Block {
    /// The block whose first sample has the indices `first`.
    #[inline]
    pub fn new(first: [usize; 3], part: usize, context: &FillContext) -> Self {
        let [_, ny, nz] = context.lattice.counts;
        let (mut sample_mask, mut edges) = (0xff, 0);
        for (a, own) in SINGLE_LAYER_MASKS.into_iter().enumerate() {
            if context.along[a][first[a] / BLOCK_EDGE].has_one_layer {
                sample_mask &= own;
            } else {
                edges += 1;
            }
        }
        Self {
            indices: first.map(|i| (i / BLOCK_EDGE) as u32),
            part: part as u32,
            sample_mask,
            radius: context.lattice.step * BOX_DIAGONALS[edges] / 2.0,
            first_index: (first[0] * ny + first[1]) * nz + first[2],
        }
    }

    /// Number of the part of the lattice that contains it.
    #[inline]
    pub fn part(&self) -> usize {
        self.part as usize
    }

    /// Coordinates of its first and its last sample, by axis.
    #[inline]
    pub fn ends(&self, context: &FillContext) -> [[f64; BLOCK_EDGE]; 3] {
        let [i, j, k] = self.indices.map(|i| i as usize);
        let [x, y, z] = context.along;
        [x[i].ends, y[j].ends, z[k].ends]
    }

    /// Its centre.
    #[inline]
    pub fn centre(&self, context: &FillContext) -> [f64; 3] {
        let [i, j, k] = self.indices.map(|i| i as usize);
        let [x, y, z] = context.along;
        [x[i].centre, y[j].centre, z[k].centre]
    }

    #[inline]
    pub fn is_full(&self) -> bool {
        self.sample_mask == 0xff
    }
}

/// Offsets of one of a block's eight samples, by axis.
pub(super) fn sample_offset(n: usize) -> [usize; 3] {
    [n >> 2 & 1, n >> 1 & 1, n & 1]
}
