//! Leaves in global order: one cursor for each block of a slab of blocks across x.

use super::super::leaf_file::{
    LARGEST_LEAF, LeafFileError, StoredLeaf, leaf_at, leaf_length, read_range,
};
use super::{Block, LeafStore, StoreError};
use crate::frame::Coord;
use crate::progress::{Cancelled, Progress};
use std::fs::File;

/// Memory for reading ahead, bytes.
const AHEAD: usize = 16 << 20;

impl LeafStore {
    /// Calls `visit` with every leaf in order of origin (x, y, z): its origin, mask and active values.
    /// Memory is bounded by [`LeafStore`]'s own, whatever the number of leaves.
    ///
    /// # Errors
    /// [`StoreError`] when a file has changed since it was opened, on cancelling, or of `visit`.
    pub fn for_each_leaf(
        &self,
        progress: &dyn Progress,
        mut visit: impl FnMut(Coord, &[u64; 8], &[f32]) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        let mut slab: Vec<Cursor> = Vec::new();
        let mut blocks = self.blocks.iter().peekable();
        while let Some((&origin, block)) = blocks.next() {
            slab.push(Cursor::new(origin, block));
            if blocks.peek().is_some_and(|(next, _)| next[0] == origin[0]) {
                continue;
            }
            let ahead = (AHEAD / slab.len()).clamp(LARGEST_LEAF, 1 << 18);
            for x in 0..16 {
                if progress.cancelled() {
                    return Err(Cancelled.into());
                }
                let mut rows = &mut slab[..];
                while let Some(first) = rows.first() {
                    let y = first.origin[1];
                    let many = rows.iter().take_while(|c| c.origin[1] == y).count();
                    let (row, rest) = rows.split_at_mut(many);
                    for place in (0..16).map(|y| x << 4 | y) {
                        for cursor in &mut *row {
                            while let Some(leaf) = cursor.next_at(self, place, ahead)? {
                                visit(leaf.origin(cursor.origin), &leaf.mask, &leaf.active)?;
                            }
                        }
                    }
                    rows = rest;
                }
            }
            slab.clear();
        }
        Ok(())
    }
}

/// Reads a block's leaves one after the other, a little ahead.
struct Cursor<'a> {
    origin: Coord,
    block: &'a Block,
    /// Chunk, and bytes of it that have been read.
    at: (usize, u32),
    buffer: Vec<u8>,
    used: usize,
}

impl<'a> Cursor<'a> {
    fn new(origin: Coord, block: &'a Block) -> Self {
        Self {
            origin,
            block,
            at: (0, 0),
            buffer: Vec::new(),
            used: 0,
        }
    }

    /// The next leaf if its place has these upper eight bits (x and y).
    fn next_at(
        &mut self,
        store: &LeafStore,
        place: u16,
        ahead: usize,
    ) -> Result<Option<StoredLeaf>, LeafFileError> {
        let whole = |bytes: &[u8]| leaf_length(bytes).is_some_and(|n| n <= bytes.len());
        while !whole(&self.buffer[self.used..]) {
            let Some(chunk) = self.block.chunks.get(self.at.0) else {
                return Ok(None);
            };
            let left = chunk.bytes - self.at.1;
            if left == 0 {
                self.at = (self.at.0 + 1, 0);
                continue;
            }
            self.buffer.drain(..self.used);
            self.used = 0;
            let failed = |e| store.failed(self.block.file, e);
            let mut file = File::open(&store.files[self.block.file]).map_err(failed)?;
            let more = (left as usize).min(ahead);
            let start = chunk.start + u64::from(self.at.1);
            let bytes = read_range(&mut file, start, more).map_err(failed)?;
            self.buffer.extend(bytes);
            self.at.1 += more as u32;
        }
        let bytes = &self.buffer[self.used..];
        if u16::from_le_bytes([bytes[0], bytes[1]]) >> 4 != place {
            return Ok(None);
        }
        let found = leaf_at(bytes);
        self.used += found.as_ref().map_or(0, |f| f.1);
        Ok(found.map(|f| f.0))
    }
}
