//! Leaves in bulk: the unit in which voxels travel.
// Must be compiled for the processor that its caller is for.
#![allow(clippy::inline_always)]

use crate::frame::Coord;
use crate::simd::{Lanes, Work, run};
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
/// word `x`. Inactive voxels hold minus or plus the background.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeafBatch {
    /// Least voxel of each leaf, a multiple of 8 on every axis.
    pub origins: Vec<Coord>,
    /// Which voxels are active.
    pub masks: Vec<[u64; 8]>,
    /// Signed distances in world units.
    pub values: Vec<[f32; VOXELS]>,
}

impl LeafBatch {
    /// Room for `n` leaves.
    pub fn with_capacity(n: usize) -> Self {
        Self {
            origins: Vec::with_capacity(n),
            masks: Vec::with_capacity(n),
            values: Vec::with_capacity(n),
        }
    }

    /// Number of leaves.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    /// Takes all leaves away; the memory stays.
    pub fn clear(&mut self) {
        self.origins.clear();
        self.masks.clear();
        self.values.clear();
    }

    /// Appends a leaf; keep the order of origins.
    pub fn push(&mut self, origin: Coord, mask: [u64; 8], values: &[f32; VOXELS]) {
        self.origins.push(origin);
        self.masks.push(mask);
        self.values.push(*values);
    }

    /// Active voxels of all leaves.
    pub fn active_voxels(&self) -> u64 {
        run(Count(&self.masks))
    }
}

/// Masks whose bits are to be counted, by the instruction that processors have for it.
struct Count<'a>(&'a [[u64; 8]]);

impl Work for Count<'_> {
    type Output = u64;
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) -> u64 {
        let mut bits = 0;
        for mask in self.0 {
            let mut own = 0u32;
            for word in mask {
                own += word.count_ones();
            }
            bits += u64::from(own);
        }
        bits
    }
}

/// Set bits of a leaf's mask.
pub(super) fn count(mask: &[u64; 8]) -> u64 {
    mask.iter().map(|w| u64::from(w.count_ones())).sum()
}

/// A sink's own error, passed through the band.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct SinkError(Box<dyn Error + Send + Sync>);

impl SinkError {
    /// Wraps what went wrong in the sink.
    pub fn new(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self(cause.into())
    }

    /// What went wrong in the sink.
    pub fn into_inner(self) -> Box<dyn Error + Send + Sync> {
        self.0
    }
}

/// Where leaves go: a tree, a file, a hash, statistics.
pub trait LeafSink: Send + Sync {
    /// Takes leaves of the block that starts at `origin`, from any thread; they are lent, since their
    /// memory serves the next batch. Blocks come in no
    /// particular order; a block with many leaves comes in several batches, one after the other,
    /// ascending; a block without leaves does not come.
    ///
    /// # Errors
    /// Whatever ends the evaluation.
    fn block(&self, origin: Coord, leaves: &LeafBatch) -> Result<(), SinkError>;

    /// Takes cubes (least voxel, edge) that lie inside and hold no active voxel; whatever is told of
    /// neither here nor in a leaf lies outside. Of use where a part of a band is evaluated, whose signs
    /// cannot be told from its leaves.
    fn inside(&self, _cubes: &[(Coord, i32)]) {}
}
