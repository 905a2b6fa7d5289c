//! Batches of leaves, and the sinks that receive them.
// Inlined so that the code is compiled for its caller's target features.
#![allow(clippy::inline_always)]

use super::smooth::LeafRef;
use druse_geometry::frame::Coord;
use druse_geometry::simd::{Lanes, SimdKernel, run};
use std::error::Error;

/// Voxels along a leaf's edge.
pub const LEAF: i32 = 8;
/// Voxels along a block's edge: an OpenVDB internal node of 16^3 leaves.
pub const BLOCK: i32 = 128;
/// Voxels in a leaf.
pub const VOXELS: usize = 512;

/// Leaves of one block, as parallel arrays sorted by origin.
///
/// Voxel (x, y, z) of a leaf has offset `(x << 6) | (y << 3) | z`; its mask bit is bit `8 y + z` of
/// word `x`. Inactive voxels hold minus or plus the background (the half width in world units).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeafBatch {
    /// Least voxel of each leaf, a multiple of 8 on every axis.
    pub origins: Vec<Coord>,
    /// Active voxels.
    pub masks: Vec<[u64; 8]>,
    /// Signed distances in world units.
    pub values: Vec<[f32; VOXELS]>,
}

impl LeafBatch {
    /// Room for `n` leaves.
    #[inline]
    pub fn with_capacity(n: usize) -> Self {
        Self {
            origins: Vec::with_capacity(n),
            masks: Vec::with_capacity(n),
            values: Vec::with_capacity(n),
        }
    }

    /// Number of leaves.
    #[inline]
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether there are none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    /// Removes all leaves; keeps the memory.
    #[inline]
    pub fn clear(&mut self) {
        self.origins.clear();
        self.masks.clear();
        self.values.clear();
    }

    /// Appends a leaf; origins must ascend.
    #[inline]
    pub fn push(&mut self, origin: Coord, mask: [u64; 8], values: &[f32; VOXELS]) {
        self.origins.push(origin);
        self.masks.push(mask);
        self.values.push(*values);
    }

    /// The leaves, in their order.
    #[inline]
    pub fn leaves(&self) -> impl Iterator<Item = LeafRef<'_>> {
        let heads = self.origins.iter().zip(&self.masks);
        heads
            .zip(&self.values)
            .map(|((origin, mask), values)| LeafRef {
                origin: *origin,
                mask: *mask,
                values,
            })
    }

    /// Active voxels of all leaves.
    #[inline]
    pub fn active_voxels(&self) -> u64 {
        run(MaskPopulation(&self.masks))
    }
}

/// Counts the bits of masks with the processor's population count.
struct MaskPopulation<'a>(&'a [[u64; 8]]);

impl SimdKernel for MaskPopulation<'_> {
    type Output = u64;
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) -> u64 {
        let mut bits = 0;
        for mask in self.0 {
            let mut active = 0u32;
            for word in mask {
                active += word.count_ones();
            }
            bits += u64::from(active);
        }
        bits
    }
}

/// Number of set bits of a leaf's mask.
pub(super) fn population(mask: &[u64; 8]) -> u64 {
    mask.iter().map(|w| u64::from(w.count_ones())).sum()
}

/// An error of a sink, passed through the evaluation.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct SinkError(Box<dyn Error + Send + Sync>);

impl SinkError {
    /// Wraps the sink's error.
    #[inline]
    pub fn new(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self(cause.into())
    }

    /// The sink's error.
    #[inline]
    pub fn into_inner(self) -> Box<dyn Error + Send + Sync> {
        self.0
    }
}

/// A receiver of leaves: a tree, a file, a hash, a counter.
pub trait LeafSink: Send + Sync {
    /// Receives leaves of the block at `origin`, from any thread. They are borrowed, because their memory
    /// is reused for the next batch. Blocks arrive in any order. A block with many leaves arrives in
    /// several batches, one after another, ascending; a block without leaves does not arrive.
    ///
    /// # Errors
    /// Any error ends the evaluation.
    fn block(&self, origin: Coord, leaves: &LeafBatch) -> Result<(), SinkError>;

    /// Receives cubes (least voxel, edge) that lie inside and hold no active voxel. Everything that is in neither these
    /// cubes nor a leaf lies outside. Needed for a part of a band, whose signs do not follow from its leaves.
    fn inside(&self, _cubes: &[(Coord, i32)]) {}
}
