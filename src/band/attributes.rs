//! Numbers that go with the active voxels of leaf files, in files beside them.
//!
//! A **number file** has those of one brick: 8 bytes `DRUSENF1`, 32 bytes that say of what they are (a
//! hash of all that decides them), then `f32`, little-endian: block after block in order of origin,
//! leaf after leaf in order of place, of each active voxel in order of offset one number or three. Last
//! 32 bytes: the BLAKE3 of everything before. Where a block's numbers stand follows from the leaf files.

use super::leaf::count;
use super::leaf_file::{digest, read_range};
use super::{BLOCK, LeafFileError, LeafStore, StoreError};
use crate::frame::Coord;
use crate::progress::{Cancelled, Progress, Threads};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"DRUSENF1";
const HEAD: u64 = 40;
const TAIL: u64 = 32;
/// Memory for reading ahead, bytes.
const AHEAD: u64 = 16 << 20;
/// Bytes of the largest leaf's numbers: 512 vectors.
const LARGEST: u64 = 512 * 12;

/// Writes a number file.
pub struct NumberFileWriter<W> {
    out: W,
    hasher: blake3::Hasher,
}

impl<W: Write> NumberFileWriter<W> {
    /// Begins a file of what `of` says.
    ///
    /// # Errors
    /// The system's.
    pub fn new(out: W, of: &[u8; 32]) -> io::Result<Self> {
        let mut file = Self {
            out,
            hasher: blake3::Hasher::new(),
        };
        file.write(MAGIC)?;
        file.write(of)?;
        Ok(file)
    }

    /// Appends numbers.
    ///
    /// # Errors
    /// The system's.
    pub fn put(&mut self, numbers: impl Iterator<Item = f32>) -> io::Result<()> {
        let bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
        self.write(&bytes)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hasher.update(bytes);
        self.out.write_all(bytes)
    }

    /// Completes the file and gives it back, for the caller to sync and to name.
    ///
    /// # Errors
    /// The system's.
    pub fn finish(mut self) -> io::Result<W> {
        let hash = self.hasher.finalize();
        self.out.write_all(hash.as_bytes())?;
        self.out.flush()?;
        Ok(self.out)
    }
}

/// The number files of a store's bricks.
pub struct NumberStore {
    files: Vec<PathBuf>,
    /// Numbers a voxel: 1 or 3.
    width: usize,
    /// Of each block its file, where its numbers begin there, and its active voxels.
    blocks: BTreeMap<Coord, (usize, u64, u64)>,
}

impl NumberStore {
    /// Opens number files after checking each as a whole: one for each leaf file of the store, in its
    /// order, with what it shall be of.
    ///
    /// # Errors
    /// [`StoreError`]: files that are missing or unfit, or cancelling.
    pub fn open(
        files: Vec<(PathBuf, [u8; 32])>,
        width: usize,
        store: &LeafStore,
        threads: &Threads,
        progress: &dyn Progress,
    ) -> Result<Self, StoreError> {
        let mut ends = vec![HEAD; files.len()];
        let mut blocks = BTreeMap::new();
        for block in store.blocks() {
            let Some((file, active)) = store.place_of(block) else {
                continue;
            };
            blocks.insert(block, (file, ends[file], active));
            ends[file] += 4 * width as u64 * active;
        }
        let checked: Vec<Result<(), LeafFileError>> = threads.install(|| {
            let each = files.par_iter().zip(&ends).map(|((path, of), end)| {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                Ok(check(path, of, end + TAIL))
            });
            each.collect::<Result<_, Cancelled>>()
        })?;
        let faults = checked.into_iter().enumerate();
        let faults: Vec<_> = faults.filter_map(|(n, r)| Some((n, r.err()?))).collect();
        if !faults.is_empty() {
            return Err(StoreError::Unfit(faults));
        }
        Ok(Self {
            files: files.into_iter().map(|(path, _)| path).collect(),
            width,
            blocks,
        })
    }

    /// Checks the number file of one brick, of a store whose leaf file with this number is the brick's.
    ///
    /// # Errors
    /// [`LeafFileError`] when it is missing or unfit.
    pub fn check(
        path: &Path,
        of: &[u8; 32],
        width: usize,
        active: u64,
    ) -> Result<(), LeafFileError> {
        check(path, of, HEAD + 4 * width as u64 * active + TAIL)
    }

    /// Numbers a voxel: 1 or 3.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The numbers of a block: of its leaves in order, of their active voxels in order of offset.
    ///
    /// # Errors
    /// [`LeafFileError`] when the file has changed since it was opened.
    pub fn read(&self, block: Coord) -> Result<Vec<f32>, LeafFileError> {
        let Some(&(file, start, active)) = self.blocks.get(&block) else {
            return Ok(Vec::new());
        };
        let bytes = 4 * self.width as u64 * active;
        Ok(floats(&self.bytes(file, start, bytes)?).collect())
    }

    fn bytes(&self, file: usize, start: u64, bytes: u64) -> Result<Vec<u8>, LeafFileError> {
        let path = &self.files[file];
        let read = File::open(path).and_then(|mut f| read_range(&mut f, start, bytes as usize));
        read.map_err(|source| LeafFileError::Io {
            path: path.clone(),
            source,
        })
    }

    /// As [`LeafStore::for_each_leaf`] with the numbers in place of the values; `store` is the one that
    /// they go with.
    ///
    /// # Errors
    /// As there.
    pub fn for_each_leaf(
        &self,
        store: &LeafStore,
        progress: &dyn Progress,
        mut visit: impl FnMut(Coord, &[u64; 8], &[f32]),
    ) -> Result<(), StoreError> {
        let mut slab = None;
        let mut ahead = LARGEST;
        let mut cursors: HashMap<Coord, Cursor> = HashMap::new();
        store.for_each_leaf(progress, |origin, mask, _| {
            let block = origin.aligned(BLOCK);
            if slab != Some(block[0]) {
                slab = Some(block[0]);
                cursors.clear();
                let from = Coord([block[0], i32::MIN, i32::MIN]);
                let to = Coord([block[0], i32::MAX, i32::MAX]);
                let many = self.blocks.range(from..=to).count() as u64;
                ahead = (AHEAD / many.max(1)).clamp(LARGEST, 1 << 18);
            }
            let cursor = cursors.entry(block).or_default();
            let numbers = cursor.next(self, block, 4 * self.width * count(mask) as usize, ahead)?;
            visit(origin, mask, &numbers);
            Ok(())
        })
    }
}

/// Reads a block's numbers one leaf after the other, a little ahead.
#[derive(Default)]
struct Cursor {
    /// Bytes of the block that have been read.
    read: u64,
    buffer: Vec<u8>,
    used: usize,
}

impl Cursor {
    fn next(
        &mut self,
        store: &NumberStore,
        block: Coord,
        bytes: usize,
        ahead: u64,
    ) -> Result<Vec<f32>, LeafFileError> {
        let place = store.blocks.get(&block);
        let (file, start, active) = place.copied().unwrap_or_default();
        if self.buffer.len() - self.used < bytes {
            self.buffer.drain(..self.used);
            self.used = 0;
            let left = 4 * store.width as u64 * active - self.read;
            let more = left.min(ahead);
            self.buffer
                .extend(store.bytes(file, start + self.read, more)?);
            self.read += more;
        }
        let Some(own) = self.buffer.get(self.used..self.used + bytes) else {
            return Err(LeafFileError::Unfit {
                path: store.files[file].clone(),
                found: format!("too few numbers for the block at {:?}", block.0),
                expected: "the numbers of this plan and brick",
            });
        };
        self.used += bytes;
        Ok(floats(own).collect())
    }
}

fn floats(bytes: &[u8]) -> impl Iterator<Item = f32> + '_ {
    let value = |b: &[u8]| b.first_chunk().map_or(0.0, |b| f32::from_le_bytes(*b));
    bytes.chunks_exact(4).map(value)
}

/// Checks a whole file: its length, what it is of, and its hash.
fn check(path: &Path, of: &[u8; 32], length: u64) -> Result<(), LeafFileError> {
    let failed = |source| LeafFileError::Io {
        path: path.to_owned(),
        source,
    };
    let unfit = |found: String| LeafFileError::Unfit {
        path: path.to_owned(),
        found,
        expected: "the numbers of this plan and brick",
    };
    let mut file = File::open(path).map_err(failed)?;
    let found = file.metadata().map_err(failed)?.len();
    if found != length {
        return Err(unfit(format!("{found} bytes instead of {length}")));
    }
    let head = read_range(&mut file, 0, HEAD as usize).map_err(failed)?;
    if head[..8] != MAGIC[..] || head[8..] != of[..] {
        return Err(unfit("another kind of file, plan or brick".into()));
    }
    let tail = read_range(&mut file, length - TAIL, TAIL as usize).map_err(failed)?;
    if tail[..] != digest(&mut file, length - TAIL).map_err(failed)? {
        return Err(unfit("contents that do not match their hash".into()));
    }
    Ok(())
}
