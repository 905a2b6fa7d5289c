//! Numbers to shade a solid in bricks by: a file for each word and brick, made once and read for every
//! output.

use super::super::attributes::Attributes;
use super::super::error::RunError;
use super::super::thickness::Thickness;
use super::assemble::unfit;
use super::solid::StoredSolid;
use super::{Quiet, Yard, unwritten};
use crate::band::{LeafBatch, NumberFileWriter, NumberStore, Region, StoreError};
use crate::frame::{Coord, Transform};
use crate::io::atomic::AtomicFile;
use crate::progress::Cancelled;
use crate::recipe::GridWord;
use crate::vdb::FileError;
use rayon::prelude::*;
use std::path::PathBuf;

/// Leaves whose numbers are in memory together.
const TOGETHER: usize = 256;

impl Yard<'_> {
    /// The number file of a word and a brick, and what it is of.
    fn number_file(&self, word: &GridWord, brick: usize) -> (PathBuf, [u8; 32]) {
        let word = blake3::hash(word.to_string().as_bytes());
        let number = (brick as u64).to_le_bytes();
        let of = [&self.digest[..], &number, word.as_bytes()].concat();
        let name = format!("brick-{brick:06}.{}.numbers", &word.to_hex()[..16]);
        let path = self.directory.join(name);
        (path, *blake3::hash(&of).as_bytes())
    }

    /// Opens the numbers of a word.
    pub fn numbers(&self, word: &GridWord, solid: &StoredSolid) -> Result<NumberStore, RunError> {
        let bricks = 0..solid.bricks.len();
        let files = bricks.map(|n| self.number_file(word, n)).collect();
        let width = word.components();
        let found = NumberStore::open(files, width, &solid.store, self.threads, self.progress);
        found.map_err(|e| match e {
            StoreError::Unfit(faults) => unfit(self, None, &faults),
            e => RunError::File(FileError::from(e)),
        })
    }

    /// Makes the numbers of some words at all active voxels, but for bricks whose numbers are there.
    pub fn make_numbers(
        &self,
        words: &[GridWord],
        solid: &StoredSolid,
        thickness: Option<&Thickness>,
    ) -> Result<(), RunError> {
        if words.is_empty() {
            return Ok(());
        }
        let quiet = Quiet(self.progress);
        let bench = solid.bricks.bench(self, &quiet);
        let attributes = Attributes::new(bench, self.stock, words, thickness, 1.0)?;
        let count = solid.bricks.len();
        self.progress.stage("grids", Some(count as u64));
        for brick in 0..count {
            self.numbers_of_brick(brick, &attributes, solid)?;
            self.progress.advance(1);
        }
        Ok(())
    }

    fn numbers_of_brick(
        &self,
        brick: usize,
        attributes: &Attributes,
        StoredSolid { bricks, store }: &StoredSolid,
    ) -> Result<(), RunError> {
        let words = attributes.words();
        let files: Vec<_> = words.iter().map(|w| self.number_file(w, brick)).collect();
        let blocks: Vec<Coord> = store.blocks_of(bricks.region(brick)).collect();
        let active = blocks.iter().filter_map(|b| store.place_of(*b));
        let active: u64 = active.map(|(_, active)| active).sum();
        let is_there = |(word, (path, of)): (&GridWord, &(PathBuf, [u8; 32]))| {
            NumberStore::check(path, of, word.components(), active).is_ok()
        };
        if words.iter().zip(&files).all(is_there) {
            return Ok(());
        }
        let begin = |(path, of): &(PathBuf, [u8; 32])| {
            let writer = NumberFileWriter::new(AtomicFile::create(path)?, of);
            Ok(writer.map_err(|e| unwritten(path, e))?)
        };
        let transform = bricks.bench(self, self.progress).transform()?;
        let writers: Result<Vec<_>, RunError> = files.iter().map(begin).collect();
        let mut writers = writers?;
        for block in blocks {
            let leaves = store.read(block, Region::EVERYWHERE);
            let leaves = leaves.map_err(|e| FileError::from(StoreError::from(e)))?;
            for first in (0..leaves.len()).step_by(TOGETHER) {
                let last = leaves.len().min(first + TOGETHER);
                let rows = self.rows(attributes, transform, &leaves, first..last)?;
                let mut start = 0;
                for ((word, writer), (path, _)) in words.iter().zip(&mut writers).zip(&files) {
                    let own = start..start + word.components();
                    start = own.end;
                    let whole = rows.iter().flat_map(|r| r.chunks_exact(attributes.row()));
                    let numbers = whole.flat_map(|row| row[own.clone()].iter().copied());
                    writer.put(numbers).map_err(|e| unwritten(path, e))?;
                }
            }
        }
        for (writer, (path, _)) in writers.into_iter().zip(&files) {
            writer.finish().map_err(|e| unwritten(path, e))?.commit()?;
        }
        Ok(())
    }

    /// All numbers at the active voxels of some leaves, leaf by leaf.
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
            let active = (0..512usize).filter(|n| mask[n >> 6] >> (n & 63) & 1 == 1);
            let points = active.map(|n| {
                let n = n as i32;
                let voxel = origin.offset(n >> 6, n >> 3 & 7, n & 7);
                transform.world(voxel).0
            });
            Ok(attributes.numbers(points))
        };
        let all = || range.into_par_iter().map(of_leaf).collect::<Result<_, _>>();
        Ok(self.threads.install(all)?)
    }
}
