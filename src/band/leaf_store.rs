//! Leaf files put together: one band on disk, read block by block or leaf by leaf in global order.
//!
//! Of each block the places of its leaves and the signs between them stay in memory (about 1.2 KB a
//! block of 128^3 voxels); masks and values are read again when they are wanted.

use super::flood::{flood, last};
use super::leaf_file::{
    Chunk, LEAF_HEAD, LeafFileError, LeafFileHead, StoredLeaf, inspect, leaf_at, read_range,
};
use super::{BLOCK, LEAF, LeafBatch, Region, VOXELS};
use crate::frame::Coord;
use crate::progress::{Cancelled, Progress, Threads};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

mod order;

/// Voxels along the edge of OpenVDB's upper nodes.
const UPPER: i32 = 4096;

/// Why leaf files could not be put together.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file that has changed since it was opened.
    #[error(transparent)]
    File(#[from] LeafFileError),
    /// Files that are missing or unfit, with their numbers.
    #[error("{} files of bricks cannot be used: {}", .0.len(), first_of(.0))]
    Unfit(Vec<(usize, LeafFileError)>),
    /// The user asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Two files hold the same block.
    #[error("{} and {} both hold the block at {block:?}", .one.display(), .other.display(), block = .block.0)]
    Overlap {
        /// A file.
        one: PathBuf,
        /// Another.
        other: PathBuf,
        /// The block's least voxel.
        block: Coord,
    },
}

fn first_of(faults: &[(usize, LeafFileError)]) -> String {
    faults.first().map_or(String::new(), |f| f.1.to_string())
}

/// A block of a store.
struct Block {
    file: usize,
    chunks: Vec<Chunk>,
    /// Places without a leaf that lie inside.
    inside: [u64; 64],
    /// Whether its first and its last voxel are inside.
    ends: [bool; 2],
}

/// What is known of a block while its leaves pass.
#[derive(Default)]
struct Sketch {
    chunks: Vec<Chunk>,
    first: Option<bool>,
    /// Place of each leaf, and whether its last voxel is inside.
    leaves: Vec<(usize, bool)>,
}

impl Sketch {
    fn enter(&mut self, leaf: &StoredLeaf) {
        let signs = leaf_signs(&leaf.mask, &leaf.active);
        let Some(&(_, begin)) = signs.first() else {
            return;
        };
        self.first.get_or_insert(begin);
        let end = last(LEAF as usize, begin, signs.iter().copied());
        self.leaves.push((usize::from(leaf.place), end));
    }

    fn finish(self, file: usize) -> Block {
        let first = self.first.unwrap_or(false);
        let mut inside = [0u64; 64];
        let mut ends = vec![None; VOXELS * 8];
        for &(place, end) in &self.leaves {
            ends[place] = Some(end);
        }
        flood(
            16,
            first,
            |place| ends[place],
            |place, is_inside| inside[place >> 6] |= u64::from(is_inside) << (place & 63),
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

/// Offsets of a leaf's active voxels, and whether they are inside; never empty.
fn leaf_signs(mask: &[u64; 8], active: &[f32]) -> Vec<(usize, bool)> {
    let offsets = (0..VOXELS).filter(|n| mask[n >> 6] >> (n & 63) & 1 == 1);
    offsets.zip(active).map(|(n, &v)| (n, v < 0.0)).collect()
}

/// A node of 4096^3 voxels as OpenVDB's tree has it.
pub struct UpperNode {
    /// Its least voxel.
    pub origin: Coord,
    /// Slots (x slowest, 32 a side) that hold a block.
    pub children: Vec<u64>,
    /// Other slots that lie inside.
    pub inside: Vec<u64>,
    /// Whether its first and its last voxel are inside.
    pub ends: [bool; 2],
}

/// The leaves of several files that share no block.
pub struct LeafStore {
    files: Vec<PathBuf>,
    blocks: BTreeMap<Coord, Block>,
    uppers: BTreeMap<Coord, UpperNode>,
    background: f32,
    leaves: u64,
    active_voxels: u64,
    bounds: Option<[Coord; 2]>,
}

/// What one file adds to a store.
struct Part {
    blocks: BTreeMap<Coord, Sketch>,
    leaves: u64,
    active: u64,
    bounds: Option<[Coord; 2]>,
}

impl LeafStore {
    /// Opens files after checking each as a whole; `heads` are what they shall begin with.
    ///
    /// # Errors
    /// [`StoreError`]: files that are missing or unfit, two that overlap, or cancelling.
    pub fn open(
        files: Vec<(PathBuf, LeafFileHead)>,
        threads: &Threads,
        progress: &dyn Progress,
    ) -> Result<Self, StoreError> {
        progress.stage("check", Some(files.len() as u64));
        let read: Vec<Result<Part, LeafFileError>> = threads.install(|| {
            let parts = files.par_iter().map(|(path, head)| {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                let part = Part::read(path, head);
                progress.advance(1);
                Ok(part)
            });
            parts.collect::<Result<_, Cancelled>>()
        })?;
        let (mut parts, mut faults) = (Vec::with_capacity(read.len()), Vec::new());
        for (n, part) in read.into_iter().enumerate() {
            match part {
                Ok(part) => parts.push(part),
                Err(fault) => faults.push((n, fault)),
            }
        }
        if !faults.is_empty() {
            return Err(StoreError::Unfit(faults));
        }
        let mut store = Self {
            background: files.first().map_or(0.0, |(_, head)| head.background),
            files: files.into_iter().map(|(path, _)| path).collect(),
            blocks: BTreeMap::new(),
            uppers: BTreeMap::new(),
            leaves: 0,
            active_voxels: 0,
            bounds: None,
        };
        for (n, part) in parts.into_iter().enumerate() {
            store.leaves += part.leaves;
            store.active_voxels += part.active;
            store.bounds = merged(store.bounds, part.bounds);
            for (origin, sketch) in part.blocks {
                if let Some(other) = store.blocks.insert(origin, sketch.finish(n)) {
                    return Err(StoreError::Overlap {
                        one: store.files[other.file].clone(),
                        other: store.files[n].clone(),
                        block: origin,
                    });
                }
            }
        }
        store.uppers = store.upper_nodes();
        Ok(store)
    }

    /// Checks one file, without keeping anything of it.
    ///
    /// # Errors
    /// [`LeafFileError`] when it is missing or unfit.
    pub fn check(path: &Path, head: &LeafFileHead) -> Result<(), LeafFileError> {
        inspect(path, head, |_, _| ()).map(|_| ())
    }

    fn upper_nodes(&self) -> BTreeMap<Coord, UpperNode> {
        let mut groups: BTreeMap<Coord, Vec<(usize, [bool; 2])>> = BTreeMap::new();
        for (origin, block) in &self.blocks {
            let node = origin.aligned(UPPER);
            let entry = groups.entry(node).or_default();
            entry.push((slot(*origin, node), block.ends));
        }
        let make = |(origin, children): (Coord, Vec<(usize, [bool; 2])>)| {
            let first = children[0].1[0];
            let mut node = UpperNode {
                origin,
                children: vec![0; 512],
                inside: vec![0; 512],
                ends: [first; 2],
            };
            let mut ends = vec![None; 32 * 32 * 32];
            for &(slot, sign) in &children {
                node.children[slot >> 6] |= 1 << (slot & 63);
                ends[slot] = Some(sign[1]);
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
        groups.into_iter().map(make).collect()
    }

    /// Nodes of 4096^3 voxels, in order of origin.
    pub fn uppers(&self) -> impl ExactSizeIterator<Item = &UpperNode> {
        self.uppers.values()
    }

    /// Cubes of 4096 voxels that lie inside between two nodes on a line along z, in order of origin.
    pub fn inside_uppers(&self) -> Vec<Coord> {
        let nodes: Vec<&UpperNode> = self.uppers.values().collect();
        let mut found = Vec::new();
        for pair in nodes.windows(2) {
            let ([x, y, z], [u, v, w]) = (pair[0].origin.0, pair[1].origin.0);
            if (x, y) == (u, v) && pair[0].ends[1] && pair[1].ends[0] {
                let between = (z + UPPER..w).step_by(UPPER as usize);
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
    pub fn blocks_of(&self, region: Region) -> impl Iterator<Item = Coord> {
        let first = region.min.0[0].div_euclid(BLOCK) * BLOCK;
        let from = Coord([first, i32::MIN, i32::MIN]);
        let to = Coord([region.max.0[0], i32::MAX, i32::MAX]);
        let slabs = self.blocks.range(from..=to).map(|(&origin, _)| origin);
        slabs.filter(move |&origin| region.meets(origin, BLOCK))
    }

    /// Slots of 8^3 voxels (x slowest, 16 a side) of a block that hold no leaf and lie inside; none
    /// where no leaf is.
    pub fn inside_slots(&self, block: Coord) -> Option<&[u64; 64]> {
        self.blocks.get(&block).map(|b| &b.inside)
    }

    /// The file that holds a block, and the block's active voxels; none where no leaf is.
    pub fn place_of(&self, block: Coord) -> Option<(usize, u64)> {
        let entry = self.blocks.get(&block)?;
        let values = |c: &Chunk| (u64::from(c.bytes) - u64::from(c.leaves) * LEAF_HEAD as u64) / 4;
        Some((entry.file, entry.chunks.iter().map(values).sum()))
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

    /// Least and greatest active voxel on each axis; none in an empty store.
    pub fn bounds(&self) -> Option<[Coord; 2]> {
        self.bounds
    }

    /// Reads the leaves of a block that meet a region; inactive voxels get minus or plus the
    /// background by the signs of the active ones.
    ///
    /// # Errors
    /// [`LeafFileError`] when the file has changed since it was opened.
    pub fn read(&self, block: Coord, region: Region) -> Result<LeafBatch, LeafFileError> {
        let mut batch = LeafBatch::default();
        let Some(entry) = self.blocks.get(&block) else {
            return Ok(batch);
        };
        let path = &self.files[entry.file];
        let failed = |e| self.failed(entry.file, e);
        let mut file = File::open(path).map_err(failed)?;
        for chunk in &entry.chunks {
            let bytes = read_range(&mut file, chunk.start, chunk.bytes as usize).map_err(failed)?;
            let mut rest = &bytes[..];
            while let Some((leaf, used)) = leaf_at(rest) {
                rest = &rest[used..];
                let origin = leaf.origin(block);
                if region.meets(origin, LEAF) {
                    batch.push(origin, leaf.mask, &self.filled(&leaf.mask, &leaf.active));
                }
            }
        }
        Ok(batch)
    }

    fn failed(&self, file: usize, source: io::Error) -> LeafFileError {
        LeafFileError::Io {
            path: self.files[file].clone(),
            source,
        }
    }

    /// All 512 values of a leaf from its active ones: the others get minus or plus the background.
    pub fn filled(&self, mask: &[u64; 8], active: &[f32]) -> [f32; VOXELS] {
        let mut values = [0.0; VOXELS];
        let mut ends = [None; VOXELS];
        let signs = leaf_signs(mask, active);
        for (&(n, inside), &v) in signs.iter().zip(active) {
            values[n] = v;
            ends[n] = Some(inside);
        }
        let first = signs.first().is_some_and(|s| s.1);
        let background = self.background;
        flood(
            LEAF as usize,
            first,
            |n| ends[n],
            |n, inside| {
                values[n] = if inside { -background } else { background };
            },
        );
        values
    }

    /// Cubes (least voxel, edge of 8 or 128) without leaves that lie inside and meet a region.
    pub fn inside(&self, region: Region) -> Vec<(Coord, i32)> {
        let mut found = Vec::new();
        let span = |a: usize| {
            let first = region.min[a].div_euclid(BLOCK) * BLOCK;
            (first..=region.max[a]).step_by(BLOCK as usize)
        };
        for x in span(0) {
            for y in span(1) {
                for z in span(2) {
                    self.inside_of(Coord([x, y, z]), &mut found);
                }
            }
        }
        found.retain(|&(origin, edge)| region.meets(origin, edge));
        found
    }

    fn inside_of(&self, origin: Coord, found: &mut Vec<(Coord, i32)>) {
        if let Some(block) = self.blocks.get(&origin) {
            for place in (0..4096).filter(|p| block.inside[p >> 6] >> (p & 63) & 1 == 1) {
                let at = |shift: usize| (place >> shift & 15) as i32 * LEAF;
                found.push((origin.offset(at(8), at(4), at(0)), LEAF));
            }
            return;
        }
        let node = origin.aligned(UPPER);
        let is_inside = match self.uppers.get(&node) {
            Some(upper) => {
                let slot = slot(origin, node);
                upper.inside[slot >> 6] >> (slot & 63) & 1 == 1
            }
            None => self.between_uppers(node),
        };
        if is_inside {
            found.push((origin, BLOCK));
        }
    }

    fn between_uppers(&self, node: Coord) -> bool {
        let same_line = |n: &&UpperNode| n.origin.0[..2] == node.0[..2];
        let before = self.uppers.range(..node).next_back().map(|(_, n)| n);
        let after = self.uppers.range(node..).next().map(|(_, n)| n);
        let ends = before.filter(same_line).zip(after.filter(same_line));
        ends.is_some_and(|(a, b)| a.ends[1] && b.ends[0])
    }
}

/// Slot of a block in its node.
fn slot(block: Coord, node: Coord) -> usize {
    let [x, y, z] = [0, 1, 2].map(|a| ((block[a] - node[a]) / BLOCK) as usize);
    x << 10 | y << 5 | z
}

impl Part {
    fn read(path: &Path, head: &LeafFileHead) -> Result<Self, LeafFileError> {
        let mut part = Self {
            blocks: BTreeMap::new(),
            leaves: 0,
            active: 0,
            bounds: None,
        };
        let chunks = inspect(path, head, |chunk, leaf| {
            part.blocks.entry(chunk.block).or_default().enter(leaf);
            part.leaves += 1;
            part.active += leaf.active.len() as u64;
            part.bounds = merged(part.bounds, reach(leaf, chunk.block, part.bounds));
        })?;
        for chunk in chunks {
            if let Some(sketch) = part.blocks.get_mut(&chunk.block) {
                sketch.chunks.push(chunk);
            }
        }
        Ok(part)
    }
}

/// The box of a leaf's active voxels; none if the leaf lies within the box that is known.
fn reach(leaf: &StoredLeaf, block: Coord, known: Option<[Coord; 2]>) -> Option<[Coord; 2]> {
    let origin = leaf.origin(block);
    let top = origin.offset(LEAF - 1, LEAF - 1, LEAF - 1);
    let within = |b: [Coord; 2]| (0..3).all(|a| b[0][a] <= origin[a] && top[a] <= b[1][a]);
    if known.is_some_and(within) {
        return None;
    }
    let voxels = leaf_signs(&leaf.mask, &leaf.active)
        .into_iter()
        .map(|(n, _)| {
            let v = origin.offset((n >> 6) as i32, (n >> 3 & 7) as i32, (n & 7) as i32);
            [v, v]
        });
    voxels.fold(None, |b, v| merged(b, Some(v)))
}

fn merged(a: Option<[Coord; 2]>, b: Option<[Coord; 2]>) -> Option<[Coord; 2]> {
    let (Some([a, b]), Some([c, d])) = (a, b) else {
        return a.or(b);
    };
    let corner =
        |pick: fn(i32, i32) -> i32, p: Coord, q: Coord| Coord([0, 1, 2].map(|n| pick(p[n], q[n])));
    Some([corner(i32::min, a, c), corner(i32::max, b, d)])
}
