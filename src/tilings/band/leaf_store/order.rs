//! Iteration over the leaves of a store in global order, with one cursor per block of an x slab.
//!
//! A slab is all blocks with one x. The order, that of origins (x, y, z), differs from that of the files, where a
//! block's leaves lie together. No leaf is read twice.

use super::super::leaf_file::{
    LeafFileError, MAX_LEAF_BYTES, StoredLeaf, leaf_at, leaf_length, read_range,
};
use super::{Block, LeafStore, StoreError};
use druse_geometry::frame::Coord;
use druse_geometry::progress::{Cancelled, Progress};
use std::fs::File;

/// Memory for read-ahead over all cursors, bytes.
const READ_AHEAD_BYTES: usize = 16 << 20;

impl LeafStore {
    /// Calls `visit` with every leaf in order of origin (x, y, z): its origin, mask and active values.
    /// The read-ahead buffers have a fixed total size, whatever the number of leaves.
    ///
    /// # Errors
    /// [`StoreError`] if a file has changed since it was opened, on cancellation, or from `visit`.
    pub fn for_each_leaf(
        &self,
        progress: &dyn Progress,
        mut visit: impl FnMut(Coord, &[u64; 8], &[f32]) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        // A slab is all blocks with one x; its leaves alternate between the blocks.
        let mut slab: Vec<Cursor> = Vec::new();
        let mut blocks = self.blocks.iter().peekable();
        while let Some((&origin, block)) = blocks.next() {
            slab.push(Cursor::new(origin, block));
            if blocks.peek().is_some_and(|(next, _)| next[0] == origin[0]) {
                continue;
            }
            // At least a whole leaf, at most 256 KiB for each cursor.
            let ahead = (READ_AHEAD_BYTES / slab.len()).clamp(MAX_LEAF_BYTES, 1 << 18);
            // x first, then the blocks' rows of one y, then y within the blocks: the order of origins.
            for x in 0..16 {
                if progress.cancelled() {
                    return Err(Cancelled.into());
                }
                let mut rows = &mut slab[..];
                while let Some(first) = rows.first() {
                    let y = first.origin[1];
                    let row_blocks = rows.iter().take_while(|c| c.origin[1] == y).count();
                    let (row, rest) = rows.split_at_mut(row_blocks);
                    for column in (0..16).map(|y| x << 4 | y) {
                        for cursor in &mut *row {
                            while let Some(leaf) = cursor.next_in(self, column, ahead)? {
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

/// Reads a block's leaves one after another, with read-ahead.
struct Cursor<'a> {
    origin: Coord,
    block: &'a Block,
    /// Number of the current chunk, and its bytes read so far.
    position: (usize, u32),
    buffer: Vec<u8>,
    /// Bytes of the buffer that leaves were read from.
    used: usize,
}

impl<'a> Cursor<'a> {
    fn new(origin: Coord, block: &'a Block) -> Self {
        Self {
            origin,
            block,
            position: (0, 0),
            buffer: Vec::new(),
            used: 0,
        }
    }

    /// The next leaf, if the upper eight bits (x and y) of its slot equal `column`. `ahead` is the number of bytes read
    /// at a time; `None` at the end of the block too.
    fn next_in(
        &mut self,
        store: &LeafStore,
        column: u16,
        ahead: usize,
    ) -> Result<Option<StoredLeaf>, LeafFileError> {
        let is_whole = |bytes: &[u8]| leaf_length(bytes).is_some_and(|n| n <= bytes.len());
        // Read on until a whole leaf is in the buffer, at a chunk's end in the next chunk.
        while !is_whole(&self.buffer[self.used..]) {
            let Some(chunk) = self.block.chunks.get(self.position.0) else {
                return Ok(None);
            };
            let left = chunk.bytes - self.position.1;
            if left == 0 {
                self.position = (self.position.0 + 1, 0);
                continue;
            }
            self.buffer.drain(..self.used);
            self.used = 0;
            let failed = |e| store.io_error(self.block.file, e);
            // No cursor keeps its file open: a slab may have thousands of cursors.
            let mut file = File::open(&store.files[self.block.file]).map_err(failed)?;
            let more = (left as usize).min(ahead);
            let start = chunk.start + u64::from(self.position.1);
            let bytes = read_range(&mut file, start, more).map_err(failed)?;
            self.buffer.extend(bytes);
            self.position.1 += more as u32;
        }
        let bytes = &self.buffer[self.used..];
        if u16::from_le_bytes([bytes[0], bytes[1]]) >> 4 != column {
            return Ok(None);
        }
        let found = leaf_at(bytes);
        self.used += found.as_ref().map_or(0, |f| f.1);
        Ok(found.map(|f| f.0))
    }
}
