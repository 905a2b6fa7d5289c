//! One band on disk: several leaf files, read block by block or leaf by leaf in global order.
//!
//! Memory holds the file positions of each block's leaves and the signs of its empty slots, about 1.2 KB
//! per block of 128^3 voxels. Masks and values are read on demand.

use super::flood::{flood, last};
use super::leaf_file::{Chunk, LEAF_HEAD_BYTES, LeafFileError, LeafFileHead, StoredLeaf, inspect};
use super::{BLOCK, LEAF, Region, VOXELS};
use druse_geometry::frame::Coord;
use druse_geometry::progress::{Cancelled, Progress, Threads};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

mod order;
mod reading;

pub use reading::FullLeaf;

/// Voxels along the edge of OpenVDB's upper nodes.
const UPPER_EDGE: i32 = 4096;

/// Why leaf files do not form one band.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file has changed since it was opened.
    #[error(transparent)]
    File(#[from] LeafFileError),
    /// Files are missing or invalid; with their numbers.
    #[error("{} files of bricks cannot be used: {}", .0.len(), first_error(.0))]
    Invalid(Vec<(usize, LeafFileError)>),
    /// The user cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Two files hold the same block.
    #[error("{} and {} both hold the block at {block:?}", .one.display(), .other.display(), block = .block.0)]
    Overlap {
        /// The first file.
        one: PathBuf,
        /// The second file.
        other: PathBuf,
        /// The block's least voxel.
        block: Coord,
    },
}

fn first_error(errors: &[(usize, LeafFileError)]) -> String {
    errors.first().map_or(String::new(), |e| e.1.to_string())
}

/// The index entry of a block.
struct Block {
    file: usize,
    chunks: Vec<Chunk>,
    /// Slots without a leaf that lie inside.
    inside: [u64; 64],
    /// Whether the first and the last voxel are inside.
    ends: [bool; 2],
}

/// Collects the index entry of a block, leaf by leaf.
#[derive(Default)]
struct BlockBuilder {
    chunks: Vec<Chunk>,
    /// Whether the first voxel is inside.
    first: Option<bool>,
    /// Slot of each leaf, and whether its last voxel is inside.
    leaves: Vec<(usize, bool)>,
}

impl BlockBuilder {
    fn add(&mut self, leaf: &StoredLeaf) {
        let signs = active_signs(&leaf.mask, &leaf.active);
        let Some(&(_, begin)) = signs.first() else {
            return;
        };
        self.first.get_or_insert(begin);
        let end = last(LEAF as usize, begin, signs.iter().copied());
        self.leaves.push((usize::from(leaf.slot), end));
    }

    /// `file` is the number of the block's file.
    fn finish(self, file: usize) -> Block {
        let first = self.first.unwrap_or(false);
        let mut inside = [0u64; 64];
        let mut ends = vec![None; 16 * 16 * 16];
        for &(slot, end) in &self.leaves {
            ends[slot] = Some(end);
        }
        flood(
            16,
            first,
            |slot| ends[slot],
            |slot, is_inside| inside[slot >> 6] |= u64::from(is_inside) << (slot & 63),
        );
        let end = last(16, first, self.leaves.iter().copied());
        Block {
            file,
            chunks: self.chunks,
            inside,
            ends: [first, end],
        }
    }
}

/// Offsets of a leaf's active voxels, and whether they are inside. Stored leaves have at least one.
fn active_signs(mask: &[u64; 8], active: &[f32]) -> Vec<(usize, bool)> {
    let offsets = (0..VOXELS).filter(|n| mask[n >> 6] >> (n & 63) & 1 == 1);
    offsets.zip(active).map(|(n, &v)| (n, v < 0.0)).collect()
}

/// An upper internal node of OpenVDB's tree: 4096^3 voxels, 32^3 slots of 128^3.
pub struct UpperNode {
    /// Least voxel.
    pub origin: Coord,
    /// Bits of the slots (x slowest, 32 a side), 512 words, that hold a block.
    pub children: Vec<u64>,
    /// Bits of the other slots that lie inside.
    pub inside: Vec<u64>,
    /// Whether the first and the last voxel are inside.
    pub ends: [bool; 2],
}

/// The leaves of several files that share no block.
pub struct LeafStore {
    files: Vec<PathBuf>,
    blocks: BTreeMap<Coord, Block>,
    upper_nodes: BTreeMap<Coord, UpperNode>,
    background: f32,
    leaves: u64,
    active_voxels: u64,
    bounds: Option<[Coord; 2]>,
}

/// The contents of one file.
struct FileSummary {
    blocks: BTreeMap<Coord, BlockBuilder>,
    leaves: u64,
    active_voxels: u64,
    bounds: Option<[Coord; 2]>,
}

impl LeafStore {
    /// Opens files after a check of each whole file; each must begin with the given head. All heads are expected to
    /// have one half width.
    ///
    /// # Errors
    /// [`StoreError`]: missing or invalid files, two files with one block, or cancellation.
    pub fn open(
        files: Vec<(PathBuf, LeafFileHead)>,
        threads: &Threads,
        progress: &dyn Progress,
    ) -> Result<Self, StoreError> {
        progress.stage("check", Some(files.len() as u64));
        let read: Vec<Result<FileSummary, LeafFileError>> = threads.install(|| {
            let summaries = files.par_iter().map(|(path, head)| {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                let summary = FileSummary::read(path, head);
                progress.advance(1);
                Ok(summary)
            });
            summaries.collect::<Result<_, Cancelled>>()
        })?;
        // Every bad file is named, not only the first.
        let (mut summaries, mut errors) = (Vec::with_capacity(read.len()), Vec::new());
        for (n, summary) in read.into_iter().enumerate() {
            match summary {
                Ok(summary) => summaries.push(summary),
                Err(error) => errors.push((n, error)),
            }
        }
        if !errors.is_empty() {
            return Err(StoreError::Invalid(errors));
        }
        let mut store = Self {
            background: files.first().map_or(0.0, |(_, head)| head.background),
            files: files.into_iter().map(|(path, _)| path).collect(),
            blocks: BTreeMap::new(),
            upper_nodes: BTreeMap::new(),
            leaves: 0,
            active_voxels: 0,
            bounds: None,
        };
        // Files must hold different blocks.
        for (n, summary) in summaries.into_iter().enumerate() {
            store.leaves += summary.leaves;
            store.active_voxels += summary.active_voxels;
            store.bounds = merged(store.bounds, summary.bounds);
            for (origin, block) in summary.blocks {
                if let Some(other) = store.blocks.insert(origin, block.finish(n)) {
                    return Err(StoreError::Overlap {
                        one: store.files[other.file].clone(),
                        other: store.files[n].clone(),
                        block: origin,
                    });
                }
            }
        }
        store.upper_nodes = store.make_upper_nodes();
        Ok(store)
    }

    /// Checks one whole file.
    ///
    /// # Errors
    /// [`LeafFileError`] if it is missing or invalid.
    pub fn check(path: &Path, head: &LeafFileHead) -> Result<(), LeafFileError> {
        inspect(path, head, |_, _| ()).map(|_| ())
    }

    /// The nodes of 32^3 blocks over all blocks: which blocks exist, and which of the others lie inside. `inside` holds
    /// the bits of those.
    fn make_upper_nodes(&self) -> BTreeMap<Coord, UpperNode> {
        let mut groups: BTreeMap<Coord, Vec<(usize, [bool; 2])>> = BTreeMap::new();
        for (origin, block) in &self.blocks {
            let node = origin.aligned(UPPER_EDGE);
            let entry = groups.entry(node).or_default();
            entry.push((slot(*origin, node), block.ends));
        }
        // By the rule of `flood`, blocks without leaves have the end state of one before, or the first one's start.
        let node_of = |(origin, children): (Coord, Vec<(usize, [bool; 2])>)| {
            let first = children[0].1[0];
            let mut node = UpperNode {
                origin,
                children: vec![0; 512],
                inside: vec![0; 512],
                ends: [first; 2],
            };
            let mut ends = vec![None; 32 * 32 * 32];
            for &(slot, is_inside) in &children {
                node.children[slot >> 6] |= 1 << (slot & 63);
                ends[slot] = Some(is_inside[1]);
            }
            let inside = &mut node.inside;
            flood(
                32,
                first,
                |slot| ends[slot],
                |slot, is_inside| inside[slot >> 6] |= u64::from(is_inside) << (slot & 63),
            );
            node.ends[1] = last(32, first, children.iter().map(|c| (c.0, c.1[1])));
            (origin, node)
        };
        groups.into_iter().map(node_of).collect()
    }

    /// Nodes of 4096^3 voxels, in order of origin.
    pub fn upper_nodes(&self) -> impl ExactSizeIterator<Item = &UpperNode> {
        self.upper_nodes.values()
    }

    /// Cubes of 4096^3 voxels that lie inside, between two nodes on a line along z; in order of origin.
    pub fn inside_upper_cubes(&self) -> Vec<Coord> {
        let nodes: Vec<&UpperNode> = self.upper_nodes.values().collect();
        let mut found = Vec::new();
        for pair in nodes.windows(2) {
            let ([x, y, z], [u, v, w]) = (pair[0].origin.0, pair[1].origin.0);
            if (x, y) == (u, v) && pair[0].ends[1] && pair[1].ends[0] {
                let between = (z + UPPER_EDGE..w).step_by(UPPER_EDGE as usize);
                found.extend(between.map(|z| Coord([x, y, z])));
            }
        }
        found
    }

    /// Origins of the blocks that hold leaves, in order.
    pub fn blocks(&self) -> impl Iterator<Item = Coord> {
        self.blocks.keys().copied()
    }

    /// Origins of the blocks that hold leaves and meet a region.
    pub fn blocks_in(&self, region: Region) -> impl Iterator<Item = Coord> {
        let first = region.min.0[0].div_euclid(BLOCK) * BLOCK;
        let from = Coord([first, i32::MIN, i32::MIN]);
        let to = Coord([region.max.0[0], i32::MAX, i32::MAX]);
        let slabs = self.blocks.range(from..=to).map(|(&origin, _)| origin);
        slabs.filter(move |&origin| region.meets(origin, BLOCK))
    }

    /// Bits of a block's slots of 8^3 voxels (x slowest, 16 a side) that hold no leaf and lie inside;
    /// none for a block without leaves.
    pub fn inside_slots(&self, block: Coord) -> Option<&[u64; 64]> {
        self.blocks.get(&block).map(|b| &b.inside)
    }

    /// The number of the file that holds a block, and the block's active voxels; none for a block without leaves.
    pub fn file_of(&self, block: Coord) -> Option<(usize, u64)> {
        let entry = self.blocks.get(&block)?;
        let values =
            |c: &Chunk| (u64::from(c.bytes) - u64::from(c.leaves) * LEAF_HEAD_BYTES as u64) / 4;
        Some((entry.file, entry.chunks.iter().map(values).sum()))
    }

    /// Number of leaves of a block.
    pub fn leaves_of(&self, block: Coord) -> u64 {
        let chunks = self.blocks.get(&block).map_or(&[][..], |b| &b.chunks);
        chunks.iter().map(|c| u64::from(c.leaves)).sum()
    }

    /// Half width of the band, world units.
    pub fn background(&self) -> f32 {
        self.background
    }

    /// Number of leaves.
    pub fn leaves(&self) -> u64 {
        self.leaves
    }

    /// Number of active voxels.
    pub fn active_voxels(&self) -> u64 {
        self.active_voxels
    }

    /// Least and greatest active voxel on each axis; none for an empty store.
    pub fn bounds(&self) -> Option<[Coord; 2]> {
        self.bounds
    }

    fn io_error(&self, file: usize, source: io::Error) -> LeafFileError {
        LeafFileError::Io {
            path: self.files[file].clone(),
            source,
        }
    }

    /// Cubes (least voxel, edge of 8 or 128) without leaves that lie inside and meet a region.
    pub fn inside_cubes(&self, region: Region) -> Vec<(Coord, i32)> {
        let mut found = Vec::new();
        let span = |a: usize| {
            let first = region.min[a].div_euclid(BLOCK) * BLOCK;
            (first..=region.max[a]).step_by(BLOCK as usize)
        };
        for x in span(0) {
            for y in span(1) {
                for z in span(2) {
                    self.inside_cubes_of(Coord([x, y, z]), &mut found);
                }
            }
        }
        found.retain(|&(origin, edge)| region.meets(origin, edge));
        found
    }

    fn inside_cubes_of(&self, origin: Coord, found: &mut Vec<(Coord, i32)>) {
        if let Some(block) = self.blocks.get(&origin) {
            for slot in (0..4096).filter(|s| block.inside[s >> 6] >> (s & 63) & 1 == 1) {
                let at = |shift: usize| (slot >> shift & 15) as i32 * LEAF;
                found.push((origin.offset(at(8), at(4), at(0)), LEAF));
            }
            return;
        }
        if self.is_block_inside(origin) {
            found.push((origin, BLOCK));
        }
    }

    /// Whether a block without leaves lies inside.
    fn is_block_inside(&self, origin: Coord) -> bool {
        let node = origin.aligned(UPPER_EDGE);
        match self.upper_nodes.get(&node) {
            Some(upper) => {
                let slot = slot(origin, node);
                upper.inside[slot >> 6] >> (slot & 63) & 1 == 1
            }
            None => self.is_between_nodes(node),
        }
    }

    /// Whether an absent leaf lies inside.
    pub fn is_inside(&self, leaf: Coord) -> bool {
        let origin = leaf.aligned(BLOCK);
        let Some(block) = self.blocks.get(&origin) else {
            return self.is_block_inside(origin);
        };
        let [x, y, z] = [0, 1, 2].map(|a| ((leaf[a] - origin[a]) / LEAF) as usize);
        let slot = x << 8 | y << 4 | z;
        block.inside[slot >> 6] >> (slot & 63) & 1 == 1
    }

    /// Whether an absent node lies inside: between two nodes on its line along z whose facing ends do.
    fn is_between_nodes(&self, node: Coord) -> bool {
        let same_line = |n: &&UpperNode| n.origin.0[..2] == node.0[..2];
        let before = self.upper_nodes.range(..node).next_back().map(|(_, n)| n);
        let after = self.upper_nodes.range(node..).next().map(|(_, n)| n);
        let ends = before.filter(same_line).zip(after.filter(same_line));
        ends.is_some_and(|(a, b)| a.ends[1] && b.ends[0])
    }
}

/// Slot of a block in its node.
fn slot(block: Coord, node: Coord) -> usize {
    let [x, y, z] = [0, 1, 2].map(|a| ((block[a] - node[a]) / BLOCK) as usize);
    x << 10 | y << 5 | z
}

impl FileSummary {
    fn read(path: &Path, head: &LeafFileHead) -> Result<Self, LeafFileError> {
        let mut summary = Self {
            blocks: BTreeMap::new(),
            leaves: 0,
            active_voxels: 0,
            bounds: None,
        };
        let chunks = inspect(path, head, |chunk, leaf| {
            summary.blocks.entry(chunk.block).or_default().add(leaf);
            summary.leaves += 1;
            summary.active_voxels += leaf.active.len() as u64;
            let leaf_bounds = bounds_beyond(leaf, chunk.block, summary.bounds);
            summary.bounds = merged(summary.bounds, leaf_bounds);
        })?;
        for chunk in chunks {
            if let Some(block) = summary.blocks.get_mut(&chunk.block) {
                block.chunks.push(chunk);
            }
        }
        Ok(summary)
    }
}

/// The box of a leaf's active voxels; none if the leaf lies within `known`, which it cannot extend.
fn bounds_beyond(leaf: &StoredLeaf, block: Coord, known: Option<[Coord; 2]>) -> Option<[Coord; 2]> {
    let origin = leaf.origin(block);
    let top = origin.offset(LEAF - 1, LEAF - 1, LEAF - 1);
    let within = |b: [Coord; 2]| (0..3).all(|a| b[0][a] <= origin[a] && top[a] <= b[1][a]);
    if known.is_some_and(within) {
        return None;
    }
    let voxels = active_signs(&leaf.mask, &leaf.active)
        .into_iter()
        .map(|(n, _)| {
            let v = origin.offset((n >> 6) as i32, (n >> 3 & 7) as i32, (n & 7) as i32);
            [v, v]
        });
    voxels.fold(None, |b, v| merged(b, Some(v)))
}

/// The box around two boxes.
fn merged(a: Option<[Coord; 2]>, b: Option<[Coord; 2]>) -> Option<[Coord; 2]> {
    let (Some([a, b]), Some([c, d])) = (a, b) else {
        return a.or(b);
    };
    let corner =
        |pick: fn(i32, i32) -> i32, p: Coord, q: Coord| Coord([0, 1, 2].map(|n| pick(p[n], q[n])));
    Some([corner(i32::min, a, c), corner(i32::max, b, d)])
}
