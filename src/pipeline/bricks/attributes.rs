//! Attributes of a solid in bricks: values at its active voxels, as thickness or cell number, one file per word
//! (the name of an attribute) and brick. They are made once and read for every output.

use super::assemble::missing_bricks;
use super::directory::refuse_foreign;
use super::solid::StoredSolid;
use super::{BrickRun, write_error};
use crate::band::{AttributeFileWriter, AttributeStore, LeafBatch, Region, StoreError};
use crate::frame::{Coord, Transform};
use crate::io::atomic::AtomicFile;
use crate::pipeline::base::error::RunError;
use crate::pipeline::measure::thickness::Thickness;
use crate::pipeline::outputs::attributes::Attributes;
use crate::progress::{CancelOnly, Cancelled};
use crate::recipe::GridWord;
use crate::vdb::FileError;
use rayon::prelude::*;
use std::path::PathBuf;

/// Leaves whose values are in memory at once.
const LEAVES_PER_BATCH: usize = 256;

impl BrickRun<'_> {
    /// Path and identity of the attribute file of a word and a brick. The identity is a hash of plan, brick and
    /// word; a file with another one is made anew.
    fn attribute_file(&self, word: &GridWord, brick: usize) -> (PathBuf, [u8; 32]) {
        let word = blake3::hash(word.to_string().as_bytes());
        let number = (brick as u64).to_le_bytes();
        let identity = [&self.digest[..], &number, word.as_bytes()].concat();
        let name = format!("brick-{brick:06}.{}.numbers", &word.to_hex()[..16]);
        let path = self.directory.join(name);
        (path, *blake3::hash(&identity).as_bytes())
    }

    /// Opens the attribute files of a word, which `make_attributes` must have made.
    pub fn attribute_store(
        &self,
        word: &GridWord,
        solid: &StoredSolid,
    ) -> Result<AttributeStore, RunError> {
        let bricks = 0..solid.bricks.len();
        let files = bricks.map(|n| self.attribute_file(word, n)).collect();
        let width = word.components();
        let found = AttributeStore::open(files, width, &solid.store, self.threads, self.progress);
        found.map_err(|e| match e {
            StoreError::Invalid(faults) => missing_bricks(self, None, &faults),
            e => RunError::File(FileError::from(e)),
        })
    }

    /// Makes the attribute files of some words at all active voxels; bricks with valid files are skipped.
    pub fn make_attributes(
        &self,
        words: &[GridWord],
        solid: &StoredSolid,
        thickness: Option<&Thickness>,
    ) -> Result<(), RunError> {
        if words.is_empty() {
            return Ok(());
        }
        let quiet = CancelOnly(self.progress);
        let context = solid.bricks.context(self, &quiet);
        // In recipe units, factor 1.0; each file converts them when it is written.
        let attributes = Attributes::new(context, self.inputs, words, thickness, 1.0)?;
        let count = solid.bricks.len();
        self.progress.stage("grids", Some(count as u64));
        for brick in 0..count {
            self.make_brick_attributes(brick, &attributes, solid)?;
            self.progress.advance(1);
        }
        Ok(())
    }

    /// Writes the attribute files of one brick: for each word the values at its active voxels, block by block and leaf
    /// by leaf. If all files are complete they stay; else all are written anew.
    fn make_brick_attributes(
        &self,
        brick: usize,
        attributes: &Attributes,
        StoredSolid { bricks, store }: &StoredSolid,
    ) -> Result<(), RunError> {
        let words = attributes.words();
        let files: Vec<_> = words
            .iter()
            .map(|w| self.attribute_file(w, brick))
            .collect();
        let blocks: Vec<Coord> = store.blocks_in(bricks.region(brick)).collect();
        let active = blocks.iter().filter_map(|b| store.file_of(*b));
        // A complete file has its identity and one row per active voxel.
        let active: u64 = active.map(|(_, active)| active).sum();
        let is_there = |(word, (path, identity)): (&GridWord, &(PathBuf, [u8; 32]))| {
            AttributeStore::check(path, identity, word.components(), active).is_ok()
        };
        if words.iter().zip(&files).all(is_there) {
            return Ok(());
        }
        let begin = |(path, identity): &(PathBuf, [u8; 32])| {
            refuse_foreign(path)?;
            let writer = AttributeFileWriter::new(AtomicFile::create(path)?, identity);
            Ok(writer.map_err(|e| write_error(path, e))?)
        };
        let transform = bricks.context(self, self.progress).transform()?;
        let writers: Result<Vec<_>, RunError> = files.iter().map(begin).collect();
        let mut writers = writers?;
        for block in blocks {
            let leaves = store.read(block, Region::EVERYWHERE);
            let leaves = leaves.map_err(|e| FileError::from(StoreError::from(e)))?;
            // Batches of leaves bound the memory for rows of values.
            for first in (0..leaves.len()).step_by(LEAVES_PER_BATCH) {
                let last = leaves.len().min(first + LEAVES_PER_BATCH);
                let rows = self.rows(attributes, transform, &leaves, first..last)?;
                let mut start = 0;
                for ((word, writer), (path, _)) in words.iter().zip(&mut writers).zip(&files) {
                    // A row holds the values of all words; each file takes the columns of its own word.
                    let columns = start..start + word.components();
                    start = columns.end;
                    let rows_of_points = rows
                        .iter()
                        .flat_map(|r| r.chunks_exact(attributes.values_per_point()));
                    let values =
                        rows_of_points.flat_map(|row| row[columns.clone()].iter().copied());
                    writer.put(values).map_err(|e| write_error(path, e))?;
                }
            }
        }
        // Files appear under their names only when all values are written.
        for (writer, (path, _)) in writers.into_iter().zip(&files) {
            writer
                .finish()
                .map_err(|e| write_error(path, e))?
                .commit()?;
        }
        Ok(())
    }

    /// All values at the active voxels of the leaves in `range`: a row of values per voxel, leaf by leaf in the
    /// order of the leaves, voxels with z fastest.
    fn rows(
        &self,
        attributes: &Attributes,
        transform: Transform,
        leaves: &LeafBatch,
        range: std::ops::Range<usize>,
    ) -> Result<Vec<Vec<f32>>, RunError> {
        let of_leaf = |n: usize| {
            if self.progress.cancelled() {
                return Err(Cancelled);
            }
            let (origin, mask) = (leaves.origins[n], leaves.masks[n]);
            // A leaf has 8^3 = 512 voxels: bit n of its mask, in words of 64 bits, is voxel (n / 64, n / 8 mod 8,
            // n mod 8).
            let active = (0..512usize).filter(|n| (mask[n >> 6] >> (n & 63)) & 1 == 1);
            let points = active.map(|n| {
                let n = n as i32;
                let voxel = origin.offset(n >> 6, (n >> 3) & 7, n & 7);
                transform.world(voxel).0
            });
            Ok(attributes.values(points))
        };
        let all = || range.into_par_iter().map(of_leaf).collect::<Result<_, _>>();
        Ok(self.threads.install(all)?)
    }
}
