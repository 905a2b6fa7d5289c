//! Leaf files: the leaves of one brick of blocks on disk, complete or not there.
//!
//! Little-endian. A head of 96 bytes: `DRUSELF1`, the plan (32 bytes: a hash of all that decides the
//! values), the brick's number (u64), half width of the band in world units (f32), 44 zeros. Then
//! **chunks**, each the leaves of a batch of one block, ascending; a leaf is its place in the block
//! (u16: `x << 8 | y << 4 | z` in leaves), its mask (8 x u64, never empty) and its active values
//! (f32, world units). Then the index, per chunk: block (3 x i32), where it begins (u64), bytes (u32),
//! leaves (u32). Last 48 bytes: number of chunks (u64), where the index begins (u64), and the BLAKE3 of
//! everything before the hash. Inactive voxels are not kept: their signs follow from the active ones.

use super::leaf::count;
use super::{BLOCK, LEAF, LeafBatch, LeafSink, SinkError};
use crate::frame::Coord;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

pub(super) const HEAD: u64 = 96;
const TAIL: u64 = 48;
const ENTRY: usize = 28;
const MAGIC: &[u8; 8] = b"DRUSELF1";
/// Bytes of a leaf before its values.
pub(super) const LEAF_HEAD: usize = 66;
/// Bytes of the largest leaf.
pub(super) const LARGEST_LEAF: usize = LEAF_HEAD + 2048;
/// Leaves of a full block.
const FULL: u32 = 4096;

/// What a leaf file says about itself first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeafFileHead {
    /// Hash of all that decides the values.
    pub plan: [u8; 32],
    /// Number of the brick.
    pub brick: u64,
    /// Half width of the band, world units: inactive voxels are that far inside or outside.
    pub background: f32,
}

impl LeafFileHead {
    fn bytes(&self) -> [u8; HEAD as usize] {
        let mut bytes = [0; HEAD as usize];
        bytes[..8].copy_from_slice(MAGIC);
        bytes[8..40].copy_from_slice(&self.plan);
        bytes[40..48].copy_from_slice(&self.brick.to_le_bytes());
        bytes[48..52].copy_from_slice(&self.background.to_le_bytes());
        bytes
    }
}

/// Why a leaf file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LeafFileError {
    /// The system failed: missing file, full disk.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Its error.
        source: io::Error,
    },
    /// It is not whole, or not what was asked for.
    #[error("{}: {found}; expected a whole file of {expected}", .path.display())]
    Unfit {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: String,
        /// Of what.
        expected: &'static str,
    },
}

/// Leaves of one block in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Chunk {
    pub block: Coord,
    pub start: u64,
    pub bytes: u32,
    pub leaves: u32,
}

struct State<W> {
    out: W,
    hasher: blake3::Hasher,
    chunks: Vec<Chunk>,
    at: u64,
}

impl<W: Write> State<W> {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.out.write_all(bytes)?;
        self.hasher.update(bytes);
        self.at += bytes.len() as u64;
        Ok(())
    }
}

/// Writes a leaf file as a [`LeafSink`]; batches of different blocks may come in any order.
pub struct LeafFileWriter<W>(Mutex<State<W>>);

impl<W: Write + Send> LeafFileWriter<W> {
    /// Begins a file.
    ///
    /// # Errors
    /// The system's.
    pub fn new(out: W, head: &LeafFileHead) -> io::Result<Self> {
        let mut state = State {
            out,
            hasher: blake3::Hasher::new(),
            chunks: Vec::new(),
            at: 0,
        };
        state.put(&head.bytes())?;
        Ok(Self(Mutex::new(state)))
    }

    /// Writes the index and gives the file back, for the caller to sync and to name.
    ///
    /// # Errors
    /// The system's.
    pub fn finish(self) -> io::Result<W> {
        let mut state = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        let index = state.at;
        for chunk in std::mem::take(&mut state.chunks) {
            let mut entry = Vec::with_capacity(ENTRY);
            entry.extend(chunk.block.0.iter().flat_map(|c| c.to_le_bytes()));
            entry.extend(chunk.start.to_le_bytes());
            entry.extend(chunk.bytes.to_le_bytes());
            entry.extend(chunk.leaves.to_le_bytes());
            state.put(&entry)?;
        }
        let count = (state.at - index) / ENTRY as u64;
        state.put(&count.to_le_bytes())?;
        state.put(&index.to_le_bytes())?;
        let hash = state.hasher.finalize();
        state.out.write_all(hash.as_bytes())?;
        state.out.flush()?;
        Ok(state.out)
    }
}

impl<W: Write + Send> LeafSink for LeafFileWriter<W> {
    fn block(&self, origin: Coord, leaves: &LeafBatch) -> Result<(), SinkError> {
        let mut bytes = Vec::with_capacity(leaves.len() * LARGEST_LEAF / 2);
        for ((leaf, mask), values) in leaves.origins.iter().zip(&leaves.masks).zip(&leaves.values) {
            let [x, y, z] = [0, 1, 2].map(|a| ((leaf[a] - origin[a]) / LEAF) as u16);
            bytes.extend((x << 8 | y << 4 | z).to_le_bytes());
            bytes.extend(mask.iter().flat_map(|w| w.to_le_bytes()));
            for (n, v) in values.iter().enumerate() {
                if mask[n >> 6] >> (n & 63) & 1 == 1 {
                    bytes.extend(v.to_le_bytes());
                }
            }
        }
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let chunk = Chunk {
            block: origin,
            start: state.at,
            bytes: bytes.len() as u32,
            leaves: leaves.len() as u32,
        };
        state.put(&bytes).map_err(SinkError::new)?;
        state.chunks.push(chunk);
        Ok(())
    }
}

/// One leaf out of a chunk.
pub(super) struct StoredLeaf {
    /// Its place in the block.
    pub place: u16,
    pub mask: [u64; 8],
    /// Active values in order of offset.
    pub active: Vec<f32>,
}

impl StoredLeaf {
    /// Its least voxel.
    pub fn origin(&self, block: Coord) -> Coord {
        let at = |shift: u16| i32::from(self.place >> shift & 15) * LEAF;
        block.offset(at(8), at(4), at(0))
    }
}

/// Bytes of the leaf whose head stands at the beginning of `bytes`.
pub(super) fn leaf_length(bytes: &[u8]) -> Option<usize> {
    let mask = bytes.get(2..LEAF_HEAD)?;
    let set: u32 = mask.iter().map(|b| b.count_ones()).sum();
    Some(LEAF_HEAD + 4 * set as usize)
}

/// The leaf at the beginning of `bytes` and its length; none if it does not end within them.
pub(super) fn leaf_at(bytes: &[u8]) -> Option<(StoredLeaf, usize)> {
    let length = leaf_length(bytes)?;
    let values = bytes.get(LEAF_HEAD..length)?;
    let mut mask = [0; 8];
    for (word, b) in mask.iter_mut().zip(bytes[2..LEAF_HEAD].chunks_exact(8)) {
        *word = b.first_chunk().map_or(0, |b| u64::from_le_bytes(*b));
    }
    let value = |b: &[u8]| b.first_chunk().map_or(0.0, |b| f32::from_le_bytes(*b));
    let leaf = StoredLeaf {
        place: u16::from_le_bytes([bytes[0], bytes[1]]),
        mask,
        active: values.chunks_exact(4).map(value).collect(),
    };
    Some((leaf, length))
}

/// Reads a range of a file.
pub(super) fn read_range(file: &mut File, start: u64, bytes: usize) -> io::Result<Vec<u8>> {
    let mut buffer = vec![0; bytes];
    file.seek(SeekFrom::Start(start))?;
    file.read_exact(&mut buffer)?;
    Ok(buffer)
}

/// Checks a whole file against what it shall be, and gives its chunks in order of block and place.
/// `visit` sees every leaf with the number of its chunk.
pub(super) fn inspect(
    path: &Path,
    expected: &LeafFileHead,
    mut visit: impl FnMut(&Chunk, &StoredLeaf),
) -> Result<Vec<Chunk>, LeafFileError> {
    let failed = |source| LeafFileError::Io {
        path: path.to_owned(),
        source,
    };
    let unfit = |found: String| LeafFileError::Unfit {
        path: path.to_owned(),
        found,
        expected: "this plan and brick",
    };
    let mut file = File::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    if length < HEAD + TAIL {
        return Err(unfit(format!("{length} bytes")));
    }
    let head = read_range(&mut file, 0, HEAD as usize).map_err(failed)?;
    if head[..8] != MAGIC[..] {
        return Err(unfit("another kind of file".into()));
    }
    if head != expected.bytes() {
        return Err(unfit("another plan, brick or half width".into()));
    }
    let tail = read_range(&mut file, length - TAIL, TAIL as usize).map_err(failed)?;
    if tail[16..] != digest(&mut file, length - 32).map_err(failed)? {
        return Err(unfit("contents that do not match their hash".into()));
    }
    let word = |at: usize| {
        tail[at..]
            .first_chunk()
            .map_or(0, |b| u64::from_le_bytes(*b))
    };
    let (entries, index) = (word(0), word(8));
    let end = length - TAIL;
    if index < HEAD || index > end || !(end - index).is_multiple_of(ENTRY as u64) {
        return Err(unfit(format!("an index at byte {index} of {length}")));
    }
    if (end - index) / ENTRY as u64 != entries {
        return Err(unfit(format!("an index that is not of {entries} chunks")));
    }
    let bytes = read_range(&mut file, index, (end - index) as usize).map_err(failed)?;
    let mut chunks: Vec<Chunk> = bytes.chunks_exact(ENTRY).map(entry).collect();
    for c in &chunks {
        let fits = c.start >= HEAD && c.start <= index && u64::from(c.bytes) <= index - c.start;
        let small = c.leaves <= FULL && c.bytes as usize <= c.leaves as usize * LARGEST_LEAF;
        let far = c.block.0.iter().any(|c| c.unsigned_abs() > 1 << 30);
        if !fits || !small || far || c.block.aligned(BLOCK) != c.block {
            return Err(unfit(format!("an index entry {c:?}")));
        }
    }
    chunks.sort_by_key(|c| (c.block, c.start));
    // Rounding of the level set's own background.
    let most = expected.background * (1.0 + 1e-5);
    let mut before: Option<(Coord, u16)> = None;
    for chunk in &chunks {
        let bytes = read_range(&mut file, chunk.start, chunk.bytes as usize).map_err(failed)?;
        let mut rest = &bytes[..];
        for _ in 0..chunk.leaves {
            let (leaf, used) =
                leaf_at(rest).ok_or_else(|| unfit(format!("a leaf cut off in {chunk:?}")))?;
            rest = &rest[used..];
            let here = Some((chunk.block, leaf.place));
            let far = |v: &f32| v.is_nan() || v.abs() > most;
            if here <= before || leaf.place >= 4096 || count(&leaf.mask) == 0 {
                return Err(unfit(format!("leaves out of order in {chunk:?}")));
            }
            if leaf.active.iter().any(far) {
                return Err(unfit(format!("values beyond the band in {chunk:?}")));
            }
            before = here;
            visit(chunk, &leaf);
        }
        if !rest.is_empty() {
            return Err(unfit(format!("{} bytes too many in {chunk:?}", rest.len())));
        }
    }
    Ok(chunks)
}

fn entry(bytes: &[u8]) -> Chunk {
    let int = |at: usize| {
        bytes[at..]
            .first_chunk()
            .map_or(0, |b| i32::from_le_bytes(*b))
    };
    let long = |at: usize| {
        bytes[at..]
            .first_chunk()
            .map_or(0, |b| u64::from_le_bytes(*b))
    };
    Chunk {
        block: Coord([int(0), int(4), int(8)]),
        start: long(12),
        bytes: int(20) as u32,
        leaves: int(24) as u32,
    }
}

pub(super) fn digest(file: &mut File, bytes: u64) -> io::Result<[u8; 32]> {
    file.seek(SeekFrom::Start(0))?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; 1 << 18];
    let mut left = bytes;
    while left > 0 {
        let n = buffer
            .len()
            .min(usize::try_from(left).unwrap_or(usize::MAX));
        file.read_exact(&mut buffer[..n])?;
        hasher.update(&buffer[..n]);
        left -= n as u64;
    }
    Ok(*hasher.finalize().as_bytes())
}
