//! Streaming of grids from leaf files into an ordinary `.vdb` file: per grid the topology, then the values,
//! some blocks at a time, without a tree in memory.

use super::error::FileError;
use super::hash::{ContentHash, GridHead};
use super::leaves::TileView;
use super::write::{VdbWriter, WriteError, WrittenFile, failed};
use super::{Session, ffi};
use crate::band::{
    AttributeStore, LeafBatch, LeafFileError, LeafStore, Region, StoreError, VOXELS,
};
use crate::frame::Coord;
use crate::progress::{Progress, Threads};
use cxx::{CxxString, UniquePtr};
use rayon::prelude::*;
use std::path::Path;
use std::pin::Pin;

mod fog;

pub use fog::StoredFog;

/// Memory of a leaf without its values, including its share of the nodes above, bytes.
const LEAF_OVERHEAD_BYTES: u64 = 192;

/// Memory of the values of the blocks that are read and encoded at once on all threads, bytes.
pub const MAX_BYTES_AT_ONCE: u64 = 8 << 20;

/// A grid on disk.
#[derive(Clone, Copy)]
pub enum StoredGrid<'a> {
    /// A level set.
    Surface(&'a LeafStore),
    /// The fog volume of a level set.
    Fog(&'a StoredFog<'a>),
    /// An attribute at the active voxels of a level set, and a factor on its values: for lengths the conversion
    /// to the file's unit.
    Attribute(&'a LeafStore, &'a AttributeStore, f32),
}

/// A node of 4096^3 voxels: bits of the slots that hold a block, and of those that are inside tiles.
struct BlockNode {
    origin: Coord,
    children: Vec<u64>,
    inside: Vec<u64>,
}

impl BlockNode {
    /// Origins of the blocks, in order of slot, which is the order of origin.
    fn blocks(&self) -> impl Iterator<Item = Coord> + '_ {
        slots(&self.children).map(|n| {
            self.origin
                .offset(slot_offset(n, 10), slot_offset(n, 5), slot_offset(n, 0))
        })
    }
}

/// The numbers of the set bits of a mask.
fn slots(words: &[u64]) -> impl Iterator<Item = usize> + '_ {
    let set = move |n: &usize| words[n >> 6] >> (n & 63) & 1 == 1;
    (0..64 * words.len()).filter(set)
}

/// Offset along an axis of a slot in a node of 4096 voxels; the index on the axis begins at bit `shift`.
fn slot_offset(slot: usize, shift: usize) -> i32 {
    (slot >> shift & 31) as i32 * 128
}

/// The leaves of a block, each with an origin, a mask and 512 values or vectors.
#[derive(Default)]
struct BlockLeaves {
    origins: Vec<Coord>,
    masks: Vec<[u64; 8]>,
    values: Vec<f32>,
}

impl VdbWriter<'_> {
    /// Writes grids from disk to the temporary file `staged`. Name, tags and voxels are those of the grids that were
    /// added, in their order, which must be empty. The file equals that of the grids in memory: same content hash,
    /// nodes and tiles. Another number of grids than of names is an error as well.
    ///
    /// # Errors
    /// As [`VdbWriter::write_to`], and [`FileError::Leaves`].
    pub fn write_streamed_to(
        self,
        staged: &Path,
        grids: &[StoredGrid<'_>],
    ) -> Result<WrittenFile, FileError> {
        let refused = |e: cxx::Exception| failed(&self.path, &e);
        if grids.len() != self.names.len() {
            let (given, named) = (grids.len(), self.names.len());
            return Err(FileError::OpenVdb {
                path: self.path.clone(),
                reason: format!("{given} grids for {named} names"),
            });
        }
        let session = self.session;
        let progress = session.progress;
        let factor = self.scale as f32;
        let mut hash = ContentHash::default();
        let mut named: Vec<_> = self.names.iter().zip(grids).enumerate().collect();
        let mut backgrounds = Vec::with_capacity(named.len());
        for &(index, _) in &named {
            let grid = self.file.grid(index).map_err(refused)?;
            let facts = ffi::grid_facts(grid).map_err(refused)?;
            backgrounds.push(facts.background as f32);
        }
        // The hash takes the grids in order of name, the file in the order in which they were added.
        named.sort_by_key(|(_, (name, _))| *name);
        for (index, (name, grid)) in named {
            progress.stage("hash", None);
            let facts = self.file.grid(index).and_then(ffi::grid_facts);
            let facts = facts.map_err(refused)?;
            hash.begin_grid(&GridHead::new(name, &facts, grid.leaves()));
            grid.hash(&mut hash, facts.half, factor, progress)?;
        }
        // Each block is passed twice: for the topology and for the values.
        let blocks: usize = grids.iter().map(|g| g.shape().blocks().count()).sum();
        progress.stage("write", Some(2 * blocks as u64));
        self.write_with(staged, hash.finish(), |file, descriptor, flags, host| {
            let mut stream = ffi::stream_open(file, descriptor, flags, host)?;
            for (index, (grid, background)) in grids.iter().zip(backgrounds).enumerate() {
                let options = WriteOptions {
                    factor,
                    background,
                    session,
                };
                if !grid.write(stream.pin_mut(), index, &options)? {
                    // Cancelled, which `write_with` then reports whatever this returns.
                    return Ok(0);
                }
            }
            Ok(ffi::stream_close(stream.pin_mut())?)
        })
    }
}

/// Options of the writing of a grid.
#[derive(Clone, Copy)]
struct WriteOptions<'a> {
    /// Factor on the values of level sets, from the store's unit to the file's.
    factor: f32,
    /// Background of the grid, in the file's unit.
    background: f32,
    session: Session<'a>,
}

impl StoredGrid<'_> {
    /// The level set of the grid.
    fn shape(&self) -> &LeafStore {
        match self {
            Self::Surface(store) | Self::Attribute(store, ..) => store,
            Self::Fog(fog) => fog.store(),
        }
    }

    /// Number of leaves with an active voxel.
    fn leaves(&self) -> u64 {
        match self {
            Self::Surface(store) | Self::Attribute(store, ..) => store.leaves(),
            Self::Fog(fog) => fog.leaves(),
        }
    }

    /// Adds the grid to a content hash: its leaves, then its tiles. `half` is whether values are stored with 16 bits;
    /// `factor` converts distances to the file's unit. An attribute has a factor of its own, a fog none.
    fn hash(
        &self,
        hash: &mut ContentHash,
        half: bool,
        factor: f32,
        progress: &dyn Progress,
    ) -> Result<(), StoreError> {
        match self {
            Self::Surface(store) => store.for_each_leaf(progress, |origin, mask, active| {
                let scaled = active.iter().map(|v| v * factor);
                hash.leaf(origin.0, mask, half, scaled);
                Ok(())
            })?,
            Self::Attribute(store, attribute, factor) => {
                attribute.for_each_leaf(store, progress, |origin, mask, own| {
                    hash.leaf(origin.0, mask, half, own.iter().map(|v| v * factor));
                })?;
            }
            Self::Fog(fog) => {
                fog.for_each_leaf(progress, |origin, mask, own| {
                    hash.leaf(origin.0, mask, half, own);
                })?;
                // A fog has active tiles inside; the other grids have none that are active.
                hash.begin_tiles(fog.tiles());
                fog.for_each_tile(|origin, edge| {
                    hash.tile(&TileView {
                        origin,
                        edge,
                        value: 1.0,
                        active: true,
                    });
                });
                return Ok(());
            }
        }
        hash.begin_tiles(0);
        Ok(())
    }

    /// What the tree would have: its box, its counts, its memory, and the value and state of its inside tiles.
    fn facts(&self, options: &WriteOptions) -> ffi::TreeFacts {
        let (bounds, active_voxels, values) = match self {
            Self::Surface(store) => (store.bounds(), store.active_voxels(), 1),
            Self::Fog(fog) => (fog.bounds(), fog.active_voxels(), 1),
            Self::Attribute(store, attribute, _) => {
                (store.bounds(), store.active_voxels(), attribute.width())
            }
        };
        let [low, high] = bounds.unwrap_or([Coord([0; 3]); 2]);
        let (inside, inside_active) = match self {
            Self::Surface(_) => (-options.background, false),
            Self::Fog(_) => (1.0, true),
            Self::Attribute(..) => (0.0, false),
        };
        ffi::TreeFacts {
            box_min: low.0,
            box_max: high.0,
            active_voxels: active_voxels as i64,
            bytes: (self.leaves()
                * (LEAF_OVERHEAD_BYTES + size_of::<[f32; VOXELS]>() as u64 * values as u64))
                as i64,
            inside,
            inside_active,
        }
    }

    /// The nodes of 4096^3 voxels, in order of origin, and the cubes of that size that lie inside.
    fn nodes(&self) -> (Vec<BlockNode>, Vec<Coord>) {
        match self {
            Self::Surface(store) => {
                let upper_nodes = store.upper_nodes().map(|u| BlockNode {
                    origin: u.origin,
                    children: u.children.clone(),
                    inside: u.inside.clone(),
                });
                (upper_nodes.collect(), store.inside_upper_cubes())
            }
            Self::Attribute(store, ..) => {
                let upper_nodes = store.upper_nodes().map(|u| BlockNode {
                    origin: u.origin,
                    children: u.children.clone(),
                    inside: vec![0; u.inside.len()],
                });
                (upper_nodes.collect(), Vec::new())
            }
            Self::Fog(fog) => (fog.upper_nodes(), fog.store().inside_upper_cubes()),
        }
    }

    /// The leaves of a block. Distances are multiplied by `factor` into the file's unit, attributes by a factor of
    /// their own, densities by none.
    fn block(&self, origin: Coord, factor: f32) -> Result<BlockLeaves, LeafFileError> {
        let (attribute, store, factor) = match self {
            Self::Fog(fog) => return fog.block(origin),
            Self::Surface(store) => (None, store, factor),
            Self::Attribute(store, attribute, own) => (Some(attribute), store, *own),
        };
        let LeafBatch {
            origins,
            masks,
            values,
        } = store.read(origin, Region::EVERYWHERE)?;
        let mut values = if let Some(attribute) = attribute {
            // An attribute file holds active voxels only; masks of the level set show which these are.
            drop(values);
            scatter(&masks, &attribute.read(origin)?, attribute.width())
        } else {
            values.into_flattened()
        };
        if factor != 1.0 {
            for v in &mut values {
                *v *= factor;
            }
        }
        Ok(BlockLeaves {
            origins,
            masks,
            values,
        })
    }

    /// The stored form of the topology of a block. Attributes have no inside tiles.
    fn topology(&self, encoding: &ffi::BlockEncoding, origin: Coord) -> EncodedBlock {
        let outside = [0; 64];
        let inside = match self {
            Self::Attribute(..) => None,
            _ => self.shape().inside_slots(origin),
        };
        let (origins, masks) = match self {
            Self::Fog(fog) => {
                let block = fog.block(origin)?;
                (block.origins, block.masks)
            }
            Self::Surface(store) | Self::Attribute(store, ..) => store.masks(origin)?,
        };
        let leaves: Vec<[i32; 3]> = origins.iter().map(|o| o.0).collect();
        let (leaves, masks) = (leaves.as_flattened(), masks.as_flattened());
        let inside = inside.unwrap_or(&outside);
        let bytes = ffi::encode_topology(encoding, leaves, masks, inside)?;
        Ok(bytes)
    }

    /// The stored form of the values of a block.
    fn values(&self, encoding: &ffi::BlockEncoding, origin: Coord, factor: f32) -> EncodedBlock {
        let block = self.block(origin, factor)?;
        let leaves: Vec<[i32; 3]> = block.origins.iter().map(|o| o.0).collect();
        let masks = block.masks.as_flattened();
        let leaves = leaves.as_flattened();
        let bytes = ffi::encode_values(encoding, leaves, masks, &block.values)?;
        Ok(bytes)
    }

    /// Blocks in groups whose values take at most [`MAX_BYTES_AT_ONCE`], or of one block.
    fn groups<'b>(&self, blocks: &'b [Coord]) -> Vec<&'b [Coord]> {
        let components = match self {
            Self::Attribute(_, attribute, _) => attribute.width() as u64,
            Self::Surface(_) | Self::Fog(_) => 1,
        };
        let most = MAX_BYTES_AT_ONCE / (components * size_of::<[f32; VOXELS]>() as u64);
        let leaves = |block: &Coord| self.shape().leaves_of(*block);
        let mut sum = blocks.first().map_or(0, leaves);
        let fits = |_: &Coord, next: &Coord| {
            let fits = sum + leaves(next) <= most;
            sum = leaves(next) + if fits { sum } else { 0 };
            fits
        };
        blocks.chunk_by(fits).collect()
    }

    /// Writes all nodes and leaves; returns false after cancellation. Blocks are read and encoded on all threads,
    /// and written in order.
    fn write(
        &self,
        mut stream: Pin<&mut ffi::Stream>,
        index: usize,
        options: &WriteOptions,
    ) -> Result<bool, WriteError> {
        let encoding = ffi::stream_grid(stream.as_mut(), index, &self.facts(options))?;
        let (upper_nodes, tiles) = self.nodes();
        let tiles: Vec<[i32; 3]> = tiles.iter().map(|c| c.0).collect();
        ffi::stream_root(
            stream.as_mut(),
            tiles.as_flattened(),
            upper_nodes.len() as u32,
        )?;
        let Session {
            threads, progress, ..
        } = options.session;
        // The format has all topology before any value, so that blocks are read twice.
        for upper in &upper_nodes {
            let (at, inside) = (&upper.origin.0, &upper.inside);
            ffi::stream_upper(stream.as_mut(), at, &upper.children, inside)?;
            let blocks: Vec<Coord> = upper.blocks().collect();
            for group in self.groups(&blocks) {
                for block in encoded(threads, group, |b| self.topology(&encoding, b))? {
                    ffi::stream_topology(stream.as_mut(), &block)?;
                }
                progress.advance(group.len() as u64);
                if progress.cancelled() {
                    return Ok(false);
                }
            }
        }
        let blocks: Vec<Coord> = upper_nodes.iter().flat_map(BlockNode::blocks).collect();
        for group in self.groups(&blocks) {
            let values = |b| self.values(&encoding, b, options.factor);
            for block in encoded(threads, group, values)? {
                ffi::stream_values(stream.as_mut(), &block)?;
            }
            progress.advance(group.len() as u64);
            if progress.cancelled() {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// The bytes of a block.
type EncodedBlock = Result<UniquePtr<CxxString>, WriteError>;

/// The bytes of some blocks, in their order.
fn encoded(
    threads: &Threads,
    blocks: &[Coord],
    encode: impl Fn(Coord) -> EncodedBlock + Sync,
) -> Result<Vec<UniquePtr<CxxString>>, WriteError> {
    let all = || blocks.par_iter().with_max_len(1).map(|b| encode(*b));
    threads.install(|| all().collect())
}

/// Scatters the values of active voxels to all voxels of their leaves; 0 elsewhere.
fn scatter(masks: &[[u64; 8]], attribute: &[f32], width: usize) -> Vec<f32> {
    let mut values = vec![0.0; masks.len() * VOXELS * width];
    let mut rows = attribute.chunks_exact(width);
    for (leaf, mask) in values.chunks_exact_mut(VOXELS * width).zip(masks) {
        for n in slots(mask) {
            if let Some(row) = rows.next() {
                leaf[n * width..(n + 1) * width].copy_from_slice(row);
            }
        }
    }
    values
}
