//! Lookup of leaves by origin.
//!
//! A band has thousands of leaves in a block or none, so that a table per block is smaller and faster than an entry per
//! leaf. Numbers are the caller's; a block takes 16 KiB.

use super::leaf::{BLOCK, LEAF};
use druse_geometry::frame::Coord;
use std::collections::HashMap;

/// Entry of a block's table without a leaf.
const NO_LEAF: u32 = u32::MAX;
/// Leaves along a block's edge.
const BLOCK_EDGE_LEAVES: usize = (BLOCK / LEAF) as usize;

/// Leaf numbers by origin: a table of 16^3 slots for each block.
#[derive(Default)]
pub(super) struct LeafIndex(HashMap<Coord, Vec<u32>>);

impl LeafIndex {
    fn slot(origin: Coord) -> usize {
        (0..3).fold(0, |n, a| {
            n * BLOCK_EDGE_LEAVES + ((origin[a] & (BLOCK - 1)) / LEAF) as usize
        })
    }

    /// Inserts a leaf; replaces another at the same origin.
    #[inline]
    pub fn insert(&mut self, origin: Coord, leaf: usize) {
        let block = self.0.entry(origin.aligned(BLOCK));
        let block = block.or_insert_with(|| {
            vec![NO_LEAF; BLOCK_EDGE_LEAVES * BLOCK_EDGE_LEAVES * BLOCK_EDGE_LEAVES]
        });
        block[Self::slot(origin)] = leaf as u32;
    }

    /// Memory in use, bytes.
    #[inline]
    pub fn bytes(&self) -> usize {
        self.0.len() * BLOCK_EDGE_LEAVES * BLOCK_EDGE_LEAVES * BLOCK_EDGE_LEAVES * size_of::<u32>()
    }

    /// The leaf at an origin.
    #[inline]
    pub fn get(&self, origin: Coord) -> Option<u32> {
        let block = self.0.get(&origin.aligned(BLOCK))?;
        Some(block[Self::slot(origin)]).filter(|&leaf| leaf != NO_LEAF)
    }
}
