//! Attribute files: values at the active voxels of leaf files.
//!
//! An attribute file belongs to one brick: 8 bytes `DRUSENF1`, 32 bytes of identity (a hash of everything
//! that determines the values), then `f32`, little-endian: blocks in order of origin, their leaves in order
//! of slot, their active voxels in order of offset, one or three values each. Last 32 bytes: the BLAKE3 of
//! everything before. The position of a block's values follows from the leaf files.

use super::leaf::population;
use super::leaf_file::{digest, read_range};
use super::{BLOCK, LeafFileError, LeafStore, StoreError};
use druse_geometry::frame::Coord;
use druse_geometry::progress::{Cancelled, Progress, Threads};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// First bytes of a file.
#[doc(hidden)]
pub const ATTRIBUTE_FILE_MAGIC: &[u8; 8] = b"DRUSENF1";
const HEAD_BYTES: u64 = 40;
const TAIL_BYTES: u64 = 32;
/// Memory for read-ahead over all cursors, bytes.
const READ_AHEAD_BYTES: u64 = 16 << 20;
/// Bytes of a leaf's values at most: 512 vectors.
const MAX_LEAF_BYTES: u64 = 512 * 12;

/// Writes an attribute file.
pub struct AttributeFileWriter<W> {
    out: W,
    hasher: blake3::Hasher,
}

impl<W: Write> AttributeFileWriter<W> {
    /// Begins a file with an identity.
    ///
    /// # Errors
    /// I/O errors.
    pub fn new(out: W, identity: &[u8; 32]) -> io::Result<Self> {
        let mut file = Self {
            out,
            hasher: blake3::Hasher::new(),
        };
        file.write(ATTRIBUTE_FILE_MAGIC)?;
        file.write(identity)?;
        Ok(file)
    }

    /// Appends values. They are the values at active voxels, in the order of the file.
    ///
    /// # Errors
    /// I/O errors.
    pub fn put(&mut self, values: impl Iterator<Item = f32>) -> io::Result<()> {
        let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
        self.write(&bytes)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hasher.update(bytes);
        self.out.write_all(bytes)
    }

    /// Completes the file and returns it, for the caller to sync and rename.
    ///
    /// # Errors
    /// I/O errors.
    pub fn finish(mut self) -> io::Result<W> {
        let hash = self.hasher.finalize();
        self.out.write_all(hash.as_bytes())?;
        self.out.flush()?;
        Ok(self.out)
    }
}

/// The attribute files of a store's bricks.
pub struct AttributeStore {
    files: Vec<PathBuf>,
    /// Values per voxel: 1 or 3.
    width: usize,
    /// For each block its file, the start of its values there, and its active voxels.
    blocks: BTreeMap<Coord, (usize, u64, u64)>,
}

impl AttributeStore {
    /// Opens attribute files after a check of each whole file: one for each leaf file of the store, in its order, with
    /// the expected identity. `files` are paths and identities; `width` is 1 or 3 values per voxel.
    ///
    /// # Errors
    /// [`StoreError`]: missing or invalid files, or cancellation.
    pub fn open(
        files: Vec<(PathBuf, [u8; 32])>,
        width: usize,
        store: &LeafStore,
        threads: &Threads,
        progress: &dyn Progress,
    ) -> Result<Self, StoreError> {
        // In a file the values of blocks follow each other in the order of blocks: their places are sums.
        let mut ends = vec![HEAD_BYTES; files.len()];
        let mut blocks = BTreeMap::new();
        for block in store.blocks() {
            let Some((file, active)) = store.file_of(block) else {
                continue;
            };
            blocks.insert(block, (file, ends[file], active));
            ends[file] += 4 * width as u64 * active;
        }
        // All files are checked before any error is returned, so that one run names every bad file.
        let checked: Vec<Result<(), LeafFileError>> = threads.install(|| {
            let checks = files.par_iter().zip(&ends).map(|((path, identity), end)| {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                Ok(check(path, identity, end + TAIL_BYTES))
            });
            checks.collect::<Result<_, Cancelled>>()
        })?;
        let results = checked.into_iter().enumerate();
        let errors: Vec<_> = results.filter_map(|(n, r)| Some((n, r.err()?))).collect();
        if !errors.is_empty() {
            return Err(StoreError::Invalid(errors));
        }
        Ok(Self {
            files: files.into_iter().map(|(path, _)| path).collect(),
            width,
            blocks,
        })
    }

    /// Checks the attribute file of one brick with `active` active voxels. `width` is 1 or 3 values per voxel.
    ///
    /// # Errors
    /// [`LeafFileError`] if it is missing or invalid.
    pub fn check(
        path: &Path,
        identity: &[u8; 32],
        width: usize,
        active: u64,
    ) -> Result<(), LeafFileError> {
        check(
            path,
            identity,
            HEAD_BYTES + 4 * width as u64 * active + TAIL_BYTES,
        )
    }

    /// Values per voxel: 1 or 3.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The values of a block: leaves in order, their active voxels in order of offset.
    ///
    /// # Errors
    /// [`LeafFileError`] if the file has changed since it was opened.
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

    /// As [`LeafStore::for_each_leaf`], with attribute values in place of distances; `store` holds the leaves. `visit`
    /// gets a leaf's origin, its mask of active voxels, and their values, `width` for each.
    ///
    /// # Errors
    /// As [`LeafStore::for_each_leaf`].
    pub fn for_each_leaf(
        &self,
        store: &LeafStore,
        progress: &dyn Progress,
        mut visit: impl FnMut(Coord, &[u64; 8], &[f32]),
    ) -> Result<(), StoreError> {
        // Leaves come in slabs of blocks with one x. Only the cursors of a slab are open; they share the memory for
        // reading ahead: at least a leaf and at most 256 KiB each.
        let mut slab = None;
        let mut ahead = MAX_LEAF_BYTES;
        let mut cursors: HashMap<Coord, Cursor> = HashMap::new();
        store.for_each_leaf(progress, |origin, mask, _| {
            let block = origin.aligned(BLOCK);
            if slab != Some(block[0]) {
                slab = Some(block[0]);
                cursors.clear();
                let from = Coord([block[0], i32::MIN, i32::MIN]);
                let to = Coord([block[0], i32::MAX, i32::MAX]);
                let blocks = self.blocks.range(from..=to).count() as u64;
                ahead = (READ_AHEAD_BYTES / blocks.max(1)).clamp(MAX_LEAF_BYTES, 1 << 18);
            }
            let cursor = cursors.entry(block).or_default();
            let bytes = 4 * self.width * population(mask) as usize;
            let values = cursor.next(self, block, bytes, ahead)?;
            visit(origin, mask, &values);
            Ok(())
        })
    }
}

/// Reads a block's values one leaf after another, with read-ahead.
#[derive(Default)]
struct Cursor {
    /// Bytes of the block read so far.
    read: u64,
    buffer: Vec<u8>,
    /// Bytes of the buffer returned so far.
    used: usize,
}

impl Cursor {
    /// The next `bytes` bytes of a block's values as numbers. The file is read at most `ahead` bytes at a time. Slices
    /// of a block come in order; an error is a file that is shorter than the leaf files promise.
    fn next(
        &mut self,
        store: &AttributeStore,
        block: Coord,
        bytes: usize,
        ahead: u64,
    ) -> Result<Vec<f32>, LeafFileError> {
        let entry = store.blocks.get(&block);
        let (file, start, active) = entry.copied().unwrap_or_default();
        // Read bytes are dropped before more are added.
        if self.buffer.len() - self.used < bytes {
            self.buffer.drain(..self.used);
            self.used = 0;
            let left = 4 * store.width as u64 * active - self.read;
            let more = left.min(ahead);
            self.buffer
                .extend(store.bytes(file, start + self.read, more)?);
            self.read += more;
        }
        let Some(leaf_bytes) = self.buffer.get(self.used..self.used + bytes) else {
            return Err(LeafFileError::Invalid {
                path: store.files[file].clone(),
                found: format!("too few values for the block at {:?}", block.0),
                expected: "the attribute values of this plan and brick",
            });
        };
        self.used += bytes;
        Ok(floats(leaf_bytes).collect())
    }
}

fn floats(bytes: &[u8]) -> impl Iterator<Item = f32> + '_ {
    let value = |b: &[u8]| b.first_chunk().map_or(0.0, |b| f32::from_le_bytes(*b));
    bytes.chunks_exact(4).map(value)
}

/// Checks a whole file: its length, identity and hash. `length` is the expected number of bytes. An error is about the
/// file, never about the values.
fn check(path: &Path, identity: &[u8; 32], length: u64) -> Result<(), LeafFileError> {
    let failed = |source| LeafFileError::Io {
        path: path.to_owned(),
        source,
    };
    let invalid = |found: String| LeafFileError::Invalid {
        path: path.to_owned(),
        found,
        expected: "the attribute values of this plan and brick",
    };
    let mut file = File::open(path).map_err(failed)?;
    let found = file.metadata().map_err(failed)?.len();
    if found != length {
        return Err(invalid(format!("{found} bytes instead of {length}")));
    }
    let head = read_range(&mut file, 0, HEAD_BYTES as usize).map_err(failed)?;
    if head[..8] != ATTRIBUTE_FILE_MAGIC[..] || head[8..] != identity[..] {
        return Err(invalid("another kind of file, plan or brick".into()));
    }
    let tail = read_range(&mut file, length - TAIL_BYTES, TAIL_BYTES as usize).map_err(failed)?;
    if tail[..] != digest(&mut file, length - TAIL_BYTES).map_err(failed)? {
        return Err(invalid("contents that do not match their hash".into()));
    }
    Ok(())
}
