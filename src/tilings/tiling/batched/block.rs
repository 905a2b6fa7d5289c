//! Divides a lattice of samples into blocks of 2^3 and gives their positions and storage indices.
//!
//! Sample n of a block has the offset (n >> 2 & 1, n >> 1 & 1, n & 1) along x, y, z from the first sample; masks of a
//! block's samples have bit n for sample n. A lattice is stored with z fastest. Blocks belong to parts of the lattice,
//! boxes that bounds may decide as a whole.

use crate::tiling::boundary::RegionFacts;
use crate::tiling::locality::NearElements;
use druse_geometry::field::{Interval, Point, SampleLattice, ValueLimits};
use druse_geometry::frame::{Vec3, WorldPoint};

/// Samples along the edge of a block; parts are made of blocks.
pub(super) const BLOCK_EDGE: usize = 2;

// The masks of eight bits, the offsets of one bit and the spans of two ends hold for this edge only.
const _: () = assert!(BLOCK_EDGE == 2);

/// Number of samples of a block.
pub(super) const BLOCK_VOLUME: usize = BLOCK_EDGE * BLOCK_EDGE * BLOCK_EDGE;
/// Mask of all samples of a block.
const ALL_SAMPLES: u8 = 0xff;
/// Diagonals of the boxes that a block's samples span, in steps of the lattice, by the number of axes along which the
/// block has two samples.
const BOX_DIAGONALS: [f64; 4] = [0.0, 1.0, std::f64::consts::SQRT_2, 1.732_050_807_568_877_2];

/// By axis, the mask of the samples with offset 0 along it: those of a block with only one sample along the axis.
const SINGLE_LAYER_MASKS: [u8; 3] = [0x0f, 0x33, 0x55];

/// The extent of a block along an axis: coordinates of the first sample, the last sample and the centre.
#[derive(Clone, Copy)]
pub(super) struct BlockSpan {
    /// World coordinates of the first and of the last sample.
    ends: [f64; BLOCK_EDGE],
    /// The mean of the ends.
    centre: f64,
    /// Whether both ends are the same sample, the last one of a lattice with an odd number of samples.
    has_one_layer: bool,
}

/// A block of samples in a part of the lattice.
#[derive(Clone, Copy)]
pub(super) struct Block {
    /// Index of the block along each axis of the lattice.
    indices: [u32; 3],
    /// Number of its part, see [`Block::part`].
    part: u32,
    /// The needed samples that the lattice has among the eight of a block: a bit each.
    pub sample_mask: u8,
    /// Distance from the centre to the farthest sample, world units.
    pub radius: f64,
    /// Storage index of the first sample.
    first_index: usize,
}

/// Bounds that hold in a part of a lattice; lengths are in world units.
#[derive(Clone, Copy)]
pub(super) struct Part {
    /// Whether the part is so far inside the boundary of the scaffold that the boundary has no effect.
    pub is_deep: bool,
    /// Whether the part lies outside the boundary.
    pub is_outside: bool,
    /// Greatest distance of a point of the part to the boundary.
    pub max_boundary_distance: f64,
    /// Greatest distance from the part of the points at which the field is evaluated for its samples.
    pub reach: f64,
    /// Range of its boundary triangles among [`FillContext::part_triangles`].
    pub triangle_range: [usize; 2],
    /// Distances beyond its ends need only their side.
    pub wanted: Interval,
}

/// What the blocks share while a lattice, or a part of it, is evaluated.
pub(super) struct FillContext<'a> {
    /// Number of the connected component of the scaffold whose field is evaluated.
    pub component: usize,
    /// The elements that may affect the lattice or the part.
    pub near: &'a NearElements,
    /// Whether all of them are affine.
    pub is_affine: bool,
    /// The positions of the samples.
    pub lattice: &'a SampleLattice<WorldPoint>,
    /// The limits of the samples, where not all distances in the band are needed.
    pub limits: Option<&'a ValueLimits>,
    /// Boundary triangles that may affect the lattice; `None` if they have not been collected.
    pub boundary_triangles: Option<&'a [u32]>,
    /// Boundary triangles that may affect a part, part by part; empty before the parts are added.
    pub part_triangles: &'a [u32],
    /// By axis, the spans of the blocks along it.
    pub block_spans: &'a [Vec<BlockSpan>; 3],
    /// Storage indices of a block's eight samples, relative to the first.
    pub offsets: [usize; BLOCK_VOLUME],
}

impl<'a> FillContext<'a> {
    /// What is proved of all points of a part.
    #[inline]
    pub fn region_facts(&self, part: &Part) -> RegionFacts<'a> {
        RegionFacts {
            field_distance: None,
            is_deep: part.is_deep,
            max_boundary_distance: part.max_boundary_distance,
            boundary_triangles: self
                .boundary_triangles
                .map(|_| &self.part_triangles[part.triangle_range[0]..part.triangle_range[1]]),
            wanted: part.wanted,
        }
    }

    /// Storage index of sample `n` of a block.
    #[inline]
    pub fn storage_index(&self, block: &Block, n: usize) -> usize {
        // The remainder, which is n, spares the check of the index.
        block.first_index + self.offsets[n % BLOCK_VOLUME]
    }

    /// Writes the values of all samples of a full block to `out`, the lattice's values.
    #[inline]
    pub fn fill(&self, block: &Block, values: &[f32; BLOCK_VOLUME], out: &mut [f32]) {
        for (row, offset) in values
            .chunks_exact(BLOCK_EDGE)
            .zip(self.offsets.iter().step_by(BLOCK_EDGE))
        {
            let first = block.first_index + offset;
            out[first..first + BLOCK_EDGE].copy_from_slice(row);
        }
    }

    /// World position of sample `n` of a block.
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
            let coordinate = |n| lattice.origin.stepped(lattice.step, [n; 3]).0[axis];
            let ends = [coordinate(first), coordinate(last)];
            Self {
                ends,
                centre: f64::midpoint(ends[0], ends[1]),
                has_one_layer: last == first,
            }
        })
    }
}

impl Block {
    /// The block of part number `part` whose first sample has the indices `first` in the lattice.
    #[inline]
    pub fn new(first: [usize; 3], part: usize, context: &FillContext) -> Self {
        let [_, ny, nz] = context.lattice.counts;
        let (mut sample_mask, mut edges) = (ALL_SAMPLES, 0);
        for (axis, layer_mask) in SINGLE_LAYER_MASKS.into_iter().enumerate() {
            if context.block_spans[axis][first[axis] / BLOCK_EDGE].has_one_layer {
                sample_mask &= layer_mask;
            } else {
                edges += 1;
            }
        }
        let first_index = (first[0] * ny + first[1]) * nz + first[2];
        if let Some(limits) = context.limits {
            for (n, offset) in context.offsets.iter().enumerate() {
                // The lattice has the samples of the mask only.
                let bit = sample_mask & 1 << n;
                if bit != 0 && !limits.is_needed(first_index + offset) {
                    sample_mask &= !bit;
                }
            }
        }
        Self {
            indices: first.map(|i| (i / BLOCK_EDGE) as u32),
            part: part as u32,
            sample_mask,
            radius: context.lattice.step * BOX_DIAGONALS[edges] / 2.0,
            first_index,
        }
    }

    /// Number of the part of the lattice that contains it.
    #[inline]
    pub fn part(&self) -> usize {
        self.part as usize
    }

    /// World coordinates of its first and its last sample, by axis.
    #[inline]
    pub fn ends(&self, context: &FillContext) -> [[f64; BLOCK_EDGE]; 3] {
        let [i, j, k] = self.indices.map(|i| i as usize);
        let [x, y, z] = context.block_spans;
        [x[i].ends, y[j].ends, z[k].ends]
    }

    /// World position of the centre of the box of its samples.
    #[inline]
    pub fn centre(&self, context: &FillContext) -> [f64; 3] {
        let [i, j, k] = self.indices.map(|i| i as usize);
        let [x, y, z] = context.block_spans;
        [x[i].centre, y[j].centre, z[k].centre]
    }

    /// Whether the lattice has all eight samples, and all are needed.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.sample_mask == ALL_SAMPLES
    }
}

/// Offset of sample `n` of a block from the first one, by axis, in steps of the lattice.
pub(super) fn sample_offset(n: usize) -> [usize; 3] {
    [n >> 2 & 1, n >> 1 & 1, n & 1]
}
