//! Leaf files: the leaves of one brick on disk.
//!
//! Little-endian. A head of 96 bytes: `DRUSELF1`, the plan (32 bytes: a hash of everything that determines the values),
//! the brick's number (u64), the half width of the band in world units (f32), 44 zeros. Then **chunks**, each the
//! leaves of one batch of a block, ascending. A leaf is its slot in the block (u16: `x << 8 | y << 4 | z` in leaves),
//! its mask (8 x u64, never empty) and its active values (f32, world units). Then the index, per chunk: block (3 x
//! i32), start (u64), bytes (u32), leaves (u32). Last 48 bytes: number of chunks (u64), start of the index (u64),
//! BLAKE3 of everything before the hash. Inactive values are not stored: their signs follow from the active ones.

use super::leaf::population;
use super::{BLOCK, LEAF, LeafBatch, LeafSink, SinkError};
use druse_geometry::frame::Coord;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

const HEAD_BYTES: u64 = 96;
const TAIL_BYTES: u64 = 48;
const INDEX_ENTRY_BYTES: usize = 28;
/// First bytes of a file.
#[doc(hidden)]
pub const LEAF_FILE_MAGIC: &[u8; 8] = b"DRUSELF1";
/// Bytes of a leaf before its values: slot and mask.
pub(super) const LEAF_HEAD_BYTES: usize = 66;
/// Bytes of a leaf with 512 values.
pub(super) const MAX_LEAF_BYTES: usize = LEAF_HEAD_BYTES + 2048;
/// Leaves of a full block.
const BLOCK_LEAVES: u32 = 4096;

/// The identity of a leaf file, in its head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeafFileHead {
    /// Hash of everything that determines the values.
    pub plan: [u8; 32],
    /// Number of the brick.
    pub brick: u64,
    /// Half width of the band, world units: the magnitude of inactive values.
    pub background: f32,
}

impl LeafFileHead {
    fn to_bytes(self) -> [u8; HEAD_BYTES as usize] {
        let mut bytes = [0; HEAD_BYTES as usize];
        bytes[..8].copy_from_slice(LEAF_FILE_MAGIC);
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
        /// The system's error.
        source: io::Error,
    },
    /// The file is incomplete or belongs to something else.
    #[error("{}: {found}; expected a complete file of {expected}", .path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: String,
        /// What the file should hold.
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
    /// Least and greatest x of its leaves, counted in leaves from the block's origin.
    pub layers: [u16; 2],
}

struct WriterState<W> {
    out: W,
    hasher: blake3::Hasher,
    chunks: Vec<Chunk>,
    position: u64,
}

impl<W: Write> WriterState<W> {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.out.write_all(bytes)?;
        self.hasher.update(bytes);
        self.position += bytes.len() as u64;
        Ok(())
    }
}

/// Writes a leaf file as a [`LeafSink`]; batches of different blocks may come in any order.
pub struct LeafFileWriter<W>(Mutex<WriterState<W>>);

impl<W: Write + Send> LeafFileWriter<W> {
    /// Begins a file. Writes the head at once.
    ///
    /// # Errors
    /// I/O errors.
    pub fn new(out: W, head: &LeafFileHead) -> io::Result<Self> {
        let mut state = WriterState {
            out,
            hasher: blake3::Hasher::new(),
            chunks: Vec::new(),
            position: 0,
        };
        state.put(&head.to_bytes())?;
        Ok(Self(Mutex::new(state)))
    }

    /// Writes the index and returns the file, for the caller to sync and rename.
    ///
    /// # Errors
    /// I/O errors.
    pub fn finish(self) -> io::Result<W> {
        let mut state = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        let index = state.position;
        for chunk in std::mem::take(&mut state.chunks) {
            let mut entry = Vec::with_capacity(INDEX_ENTRY_BYTES);
            entry.extend(chunk.block.0.iter().flat_map(|c| c.to_le_bytes()));
            entry.extend(chunk.start.to_le_bytes());
            entry.extend(chunk.bytes.to_le_bytes());
            entry.extend(chunk.leaves.to_le_bytes());
            state.put(&entry)?;
        }
        let count = (state.position - index) / INDEX_ENTRY_BYTES as u64;
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
        let mut bytes = Vec::with_capacity(leaves.len() * MAX_LEAF_BYTES / 2);
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
            start: state.position,
            bytes: bytes.len() as u32,
            leaves: leaves.len() as u32,
            layers: [leaves.origins.first(), leaves.origins.last()]
                .map(|leaf| leaf.map_or(0, |leaf| ((leaf[0] - origin[0]) / LEAF) as u16)),
        };
        state.put(&bytes).map_err(SinkError::new)?;
        state.chunks.push(chunk);
        Ok(())
    }
}

/// One leaf of a chunk.
pub(super) struct StoredLeaf {
    /// Slot in the block: `x << 8 | y << 4 | z` in leaves.
    pub slot: u16,
    pub mask: [u64; 8],
    /// Active values in order of offset.
    pub active: Vec<f32>,
}

impl StoredLeaf {
    /// Least voxel.
    pub fn origin(&self, block: Coord) -> Coord {
        slot_origin(block, self.slot)
    }
}

/// Slot of the leaf at the beginning of `bytes`; none if its head is incomplete.
pub(super) fn leaf_slot(bytes: &[u8]) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.first_chunk()?))
}

/// Least voxel of the leaf in a slot of a block.
pub(super) fn slot_origin(block: Coord, slot: u16) -> Coord {
    let at = |shift: u16| i32::from(slot >> shift & 15) * LEAF;
    block.offset(at(8), at(4), at(0))
}

/// Length of the leaf at the beginning of `bytes`; none if its head is incomplete. Head and active values, bytes.
pub(super) fn leaf_length(bytes: &[u8]) -> Option<usize> {
    let mask = bytes.get(2..LEAF_HEAD_BYTES)?;
    let set: u32 = mask.iter().map(|b| b.count_ones()).sum();
    Some(LEAF_HEAD_BYTES + 4 * set as usize)
}

/// The leaf at the beginning of `bytes` and its length; none if it is incomplete.
pub(super) fn leaf_at(bytes: &[u8]) -> Option<(StoredLeaf, usize)> {
    let length = leaf_length(bytes)?;
    let values = bytes.get(LEAF_HEAD_BYTES..length)?;
    let mut mask = [0; 8];
    for (word, b) in mask
        .iter_mut()
        .zip(bytes[2..LEAF_HEAD_BYTES].chunks_exact(8))
    {
        *word = b.first_chunk().map_or(0, |b| u64::from_le_bytes(*b));
    }
    let value = |b: &[u8]| b.first_chunk().map_or(0.0, |b| f32::from_le_bytes(*b));
    let leaf = StoredLeaf {
        slot: u16::from_le_bytes([bytes[0], bytes[1]]),
        mask,
        active: values.chunks_exact(4).map(value).collect(),
    };
    Some((leaf, length))
}

pub(super) fn read_range(file: &mut File, start: u64, bytes: usize) -> io::Result<Vec<u8>> {
    let mut buffer = vec![0; bytes];
    file.seek(SeekFrom::Start(start))?;
    file.read_exact(&mut buffer)?;
    Ok(buffer)
}

/// Checks a whole file against the expected head; returns its chunks in order of block and slot. Calls `visit` with
/// every leaf and its chunk. Leaves of a chunk come in order of slot. An error names the first fault; `visit` may have
/// been called for leaves before it.
pub(super) fn inspect(
    path: &Path,
    expected: &LeafFileHead,
    mut visit: impl FnMut(&Chunk, &StoredLeaf),
) -> Result<Vec<Chunk>, LeafFileError> {
    let failed = |source| LeafFileError::Io {
        path: path.to_owned(),
        source,
    };
    let invalid = |found: String| LeafFileError::Invalid {
        path: path.to_owned(),
        found,
        expected: "this plan and brick",
    };
    let mut file = File::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    if length < HEAD_BYTES + TAIL_BYTES {
        return Err(invalid(format!("{length} bytes")));
    }
    let head = read_range(&mut file, 0, HEAD_BYTES as usize).map_err(failed)?;
    if head[..8] != LEAF_FILE_MAGIC[..] {
        return Err(invalid("another kind of file".into()));
    }
    if head != expected.to_bytes() {
        return Err(invalid("another plan, brick or half width".into()));
    }
    let tail = read_range(&mut file, length - TAIL_BYTES, TAIL_BYTES as usize).map_err(failed)?;
    if tail[16..] != digest(&mut file, length - 32).map_err(failed)? {
        return Err(invalid("contents that do not match their hash".into()));
    }
    let word = |at: usize| {
        tail[at..]
            .first_chunk()
            .map_or(0, |b| u64::from_le_bytes(*b))
    };
    let (entries, index) = (word(0), word(8));
    let end = length - TAIL_BYTES;
    if index < HEAD_BYTES || index > end || !(end - index).is_multiple_of(INDEX_ENTRY_BYTES as u64)
    {
        return Err(invalid(format!("an index at byte {index} of {length}")));
    }
    if (end - index) / INDEX_ENTRY_BYTES as u64 != entries {
        return Err(invalid(format!("an index without {entries} chunks")));
    }
    let bytes = read_range(&mut file, index, (end - index) as usize).map_err(failed)?;
    let mut chunks: Vec<Chunk> = bytes
        .chunks_exact(INDEX_ENTRY_BYTES)
        .map(index_entry)
        .collect();
    for c in &chunks {
        let is_in_file =
            c.start >= HEAD_BYTES && c.start <= index && u64::from(c.bytes) <= index - c.start;
        let is_small =
            c.leaves <= BLOCK_LEAVES && c.bytes as usize <= c.leaves as usize * MAX_LEAF_BYTES;
        // Half of the range of indices: arithmetic on neighbours cannot overflow.
        let is_out_of_range = c.block.0.iter().any(|c| c.unsigned_abs() > 1 << 30);
        if !is_in_file || !is_small || is_out_of_range || c.block.aligned(BLOCK) != c.block {
            return Err(invalid(format!("an index entry {c:?}")));
        }
    }
    chunks.sort_by_key(|c| (c.block, c.start));
    // Allows for the rounding of the level set's background.
    let max_value = expected.background * (1.0 + 1e-5);
    let mut previous: Option<(Coord, u16)> = None;
    for chunk in &mut chunks {
        let bytes = read_range(&mut file, chunk.start, chunk.bytes as usize).map_err(failed)?;
        let mut rest = &bytes[..];
        for n in 0..chunk.leaves {
            let (leaf, used) =
                leaf_at(rest).ok_or_else(|| invalid(format!("a leaf cut off in {chunk:?}")))?;
            rest = &rest[used..];
            let current = Some((chunk.block, leaf.slot));
            let is_out_of_band = |v: &f32| v.is_nan() || v.abs() > max_value;
            let is_in_block = u32::from(leaf.slot) < BLOCK_LEAVES;
            if current <= previous || !is_in_block || population(&leaf.mask) == 0 {
                let found = format!("leaves out of order, out of the block or empty in {chunk:?}");
                return Err(invalid(found));
            }
            if leaf.active.iter().any(is_out_of_band) {
                return Err(invalid(format!("values beyond the band in {chunk:?}")));
            }
            previous = current;
            let layer = leaf.slot >> 8;
            chunk.layers = [if n == 0 { layer } else { chunk.layers[0] }, layer];
            visit(chunk, &leaf);
        }
        if !rest.is_empty() {
            return Err(invalid(format!(
                "{} bytes too many in {chunk:?}",
                rest.len()
            )));
        }
    }
    Ok(chunks)
}

fn index_entry(bytes: &[u8]) -> Chunk {
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
        layers: [0; 2], // `inspect` takes them from the leaves.
    }
}

/// BLAKE3 of the first `bytes` bytes of a file.
pub(super) fn digest(file: &mut File, bytes: u64) -> io::Result<[u8; 32]> {
    file.seek(SeekFrom::Start(0))?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; 1 << 18]; // 256 KiB: few calls, and no memory to speak of.
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
