//! A level set of any size from leaf files into one ordinary file: masks first, then values, block by
//! block, so that no tree is ever in memory.

use super::hash::{ContentHash, GridHead};
use super::write::{PutError, failed};
use super::{FileError, VdbWriter, Written, ffi};
use crate::band::{LeafBatch, LeafStore, Region};
use crate::frame::Coord;
use cxx::UniquePtr;
use std::path::Path;

/// Bytes that a leaf takes in memory, with its share of the nodes above.
const LEAF_BYTES: u64 = 2240;

impl VdbWriter<'_> {
    /// Writes the leaves of a store under the name, the tags and the voxels of the one level set that
    /// was added, which must be empty. The file says what it would say if the level set had been in
    /// memory: the content hash is the same, and so are nodes and tiles.
    ///
    /// # Errors
    /// As [`VdbWriter::write_to`], and [`FileError::Leaves`].
    pub fn write_leaves_to(self, staged: &Path, leaves: &LeafStore) -> Result<Written, FileError> {
        let refused = |e: cxx::Exception| failed(&self.path, &e);
        let facts = ffi::grid_facts(self.file.grid(0).map_err(refused)?).map_err(refused)?;
        let progress = self.session.progress;
        let factor = self.scale as f32;
        let mut hash = ContentHash::default();
        hash.begin(&GridHead::new(&self.names[0], &facts, leaves.leaves()));
        progress.stage("hash", None);
        leaves.for_each_leaf(progress, |origin, mask, active| {
            let scaled = active.iter().map(|v| v * factor);
            hash.leaf(origin.0, mask, facts.half, scaled);
        })?;
        hash.tiles(&[]);
        let stream = BlockStream {
            leaves,
            factor,
            background: facts.background as f32,
        };
        progress.stage("write", Some(2 * leaves.blocks().count() as u64));
        self.write_with(staged, hash.finish(), |file, descriptor, flags, host| {
            stream.write(file, descriptor, flags, host)
        })
    }
}

/// The blocks of a store, scaled to a file's unit.
struct BlockStream<'a> {
    leaves: &'a LeafStore,
    factor: f32,
    background: f32,
}

impl BlockStream<'_> {
    fn write(
        &self,
        file: &ffi::FileOut,
        descriptor: i32,
        flags: u32,
        host: &ffi::Host<'_>,
    ) -> Result<i32, PutError> {
        let [low, high] = self.leaves.bounds().unwrap_or([Coord([0; 3]); 2]);
        let facts = ffi::TreeFacts {
            box_min: low.0,
            box_max: high.0,
            active_voxels: self.leaves.active_voxels() as i64,
            bytes: (self.leaves.leaves() * LEAF_BYTES) as i64,
        };
        let mut stream = ffi::stream_open(file, descriptor, flags, &facts, host)?;
        let tiles: Vec<[i32; 3]> = self.leaves.inside_uppers().iter().map(|c| c.0).collect();
        let uppers = self.leaves.uppers();
        ffi::stream_root(stream.pin_mut(), tiles.as_flattened(), uppers.len() as u32)?;
        // Blocks of a node in order of slot, which is their order of origin.
        let blocks = || {
            self.leaves.uppers().flat_map(|u| {
                let own = move |n: &usize| u.children[n >> 6] >> (n & 63) & 1 == 1;
                (0..32 * 32 * 32)
                    .filter(own)
                    .enumerate()
                    .map(move |(k, n)| {
                        let at = |shift: usize| (n >> shift & 31) as i32 * 128;
                        ((k == 0).then_some(u), u.origin.offset(at(10), at(5), at(0)))
                    })
            })
        };
        for (first_of, origin) in blocks() {
            if let Some(u) = first_of {
                let origin = &u.origin.0;
                ffi::stream_upper(stream.pin_mut(), origin, &u.children, &u.inside)?;
            }
            ffi::stream_topology(stream.pin_mut(), self.block(origin)?)?;
            if host.progress.cancelled() {
                return Ok(0);
            }
            host.progress.advance(1);
        }
        for (_, origin) in blocks() {
            ffi::stream_values(stream.pin_mut(), self.block(origin)?)?;
            if host.progress.cancelled() {
                return Ok(0);
            }
            host.progress.advance(1);
        }
        Ok(ffi::stream_close(stream.pin_mut())?)
    }

    /// A block with its leaves, in the file's unit.
    fn block(&self, origin: Coord) -> Result<UniquePtr<ffi::Block>, PutError> {
        let LeafBatch {
            origins,
            masks,
            mut values,
        } = self.leaves.read(origin, Region::EVERYWHERE)?;
        if self.factor != 1.0 {
            for v in values.as_flattened_mut() {
                *v *= self.factor;
            }
        }
        let [x, y, z] = origin.0;
        let mut block = ffi::block_new(x, y, z, self.background)?;
        let flat: Vec<[i32; 3]> = origins.iter().map(|o| o.0).collect();
        ffi::block_add_leaves(
            block.pin_mut(),
            flat.as_flattened(),
            masks.as_flattened(),
            values.as_flattened(),
        )?;
        Ok(block)
    }
}
