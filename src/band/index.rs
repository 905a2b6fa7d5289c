//! Leaves by their origins.

use super::leaf::{BLOCK, LEAF};
use crate::frame::Coord;
use std::collections::HashMap;

/// Of a block's table: no leaf.
const ABSENT: u32 = u32::MAX;
/// Leaves along a block's edge.
const EDGE: usize = (BLOCK / LEAF) as usize;

/// The number of a leaf by its origin.
#[derive(Default)]
pub(super) struct Index(HashMap<Coord, Vec<u32>>);

impl Index {
    fn slot(origin: Coord) -> usize {
        (0..3).fold(0, |n, a| {
            n * EDGE + ((origin[a] & (BLOCK - 1)) / LEAF) as usize
        })
    }

    /// Enters a leaf, in the place of another if there is one.
    pub fn enter(&mut self, origin: Coord, leaf: usize) {
        let block = self.0.entry(origin.aligned(BLOCK));
        let block = block.or_insert_with(|| vec![ABSENT; EDGE * EDGE * EDGE]);
        block[Self::slot(origin)] = leaf as u32;
    }

    /// Memory that it takes, bytes.
    pub fn bytes(&self) -> usize {
        self.0.len() * EDGE * EDGE * EDGE * size_of::<u32>()
    }

    /// The leaf at an origin.
    pub fn get(&self, origin: Coord) -> Option<u32> {
        let block = self.0.get(&origin.aligned(BLOCK))?;
        Some(block[Self::slot(origin)]).filter(|&leaf| leaf != ABSENT)
    }
}
