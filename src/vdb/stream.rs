//! Grids of any size from files of leaves into one ordinary file: grid after grid, masks first, then
//! values, block by block, so that no tree is ever in memory.

use super::hash::{ContentHash, GridHead};
use super::leaves::TileView;
use super::write::{PutError, failed};
use super::{FileError, VdbWriter, Written, ffi};
use crate::band::{LeafBatch, LeafFileError, LeafStore, NumberStore, Region, StoreError, VOXELS};
use crate::frame::Coord;
use crate::progress::Progress;
use std::path::Path;
use std::pin::Pin;

mod fog;

pub use fog::StoredFog;

/// Bytes that a leaf takes in memory beside its values, with its share of the nodes above.
const LEAF_BYTES: u64 = 192;

/// A grid that lies on the disk.
#[derive(Clone, Copy)]
pub enum Streamed<'a> {
    /// A level set.
    Surface(&'a LeafStore),
    /// Its fog.
    Fog(&'a StoredFog<'a>),
    /// Numbers that go with its active voxels, and a factor on them: of lengths that to the file's unit.
    Numbers(&'a LeafStore, &'a NumberStore, f32),
}

/// A node of 4096^3 voxels: 512 words each of slots that hold a block, and of tiles that are inside.
struct Upper {
    origin: Coord,
    children: Vec<u64>,
    inside: Vec<u64>,
}

impl Upper {
    /// Its blocks in order of slot, which is their order of origin.
    fn blocks(&self) -> impl Iterator<Item = Coord> + '_ {
        slots(&self.children).map(|n| self.origin.offset(along(n, 10), along(n, 5), along(n, 0)))
    }
}

/// The set bits of a mask.
fn slots(words: &[u64]) -> impl Iterator<Item = usize> + '_ {
    let set = move |n: &usize| words[n >> 6] >> (n & 63) & 1 == 1;
    (0..64 * words.len()).filter(set)
}

/// Where a slot of a node of 4096 voxels begins along an axis, whose number stands at `shift`.
fn along(slot: usize, shift: usize) -> i32 {
    (slot >> shift & 31) as i32 * 128
}

/// The leaves of a block: of each 3 coordinates, 8 words and 512 numbers or vectors.
#[derive(Default)]
struct BlockLeaves {
    origins: Vec<Coord>,
    masks: Vec<[u64; 8]>,
    values: Vec<f32>,
}

impl VdbWriter<'_> {
    /// Writes grids from the disk under the names, the tags and the voxels of those that were added,
    /// which must be empty, in their order. The file says what it would say if the grids had been in
    /// memory: the content hash is the same, and so are nodes and tiles.
    ///
    /// # Errors
    /// As [`VdbWriter::write_to`], and [`FileError::Leaves`].
    pub fn write_streamed_to(
        self,
        staged: &Path,
        grids: &[Streamed<'_>],
    ) -> Result<Written, FileError> {
        let refused = |e: cxx::Exception| failed(&self.path, &e);
        if grids.len() != self.names.len() {
            let (given, named) = (grids.len(), self.names.len());
            return Err(FileError::OpenVdb {
                path: self.path.clone(),
                reason: format!("{given} grids for {named} names"),
            });
        }
        let progress = self.session.progress;
        let factor = self.scale as f32;
        let mut hash = ContentHash::default();
        let mut named: Vec<_> = self.names.iter().zip(grids).enumerate().collect();
        let mut backgrounds = Vec::with_capacity(named.len());
        for &(index, _) in &named {
            let grid = self.file.grid(index).map_err(refused)?;
            let facts = ffi::grid_facts(grid).map_err(refused)?;
            backgrounds.push(facts.background as f32);
        }
        named.sort_by_key(|(_, (name, _))| *name);
        for (index, (name, grid)) in named {
            progress.stage("hash", None);
            let facts = self.file.grid(index).and_then(ffi::grid_facts);
            let facts = facts.map_err(refused)?;
            hash.begin(&GridHead::new(name, &facts, grid.leaves()));
            grid.hash(&mut hash, (facts.half, factor), progress)?;
        }
        let blocks: usize = grids.iter().map(|g| g.shape().blocks().count()).sum();
        progress.stage("write", Some(2 * blocks as u64));
        self.write_with(staged, hash.finish(), |file, descriptor, flags, host| {
            let mut stream = ffi::stream_open(file, descriptor, flags, host)?;
            for (index, (grid, background)) in grids.iter().zip(backgrounds).enumerate() {
                let way = Way {
                    factor,
                    background,
                    progress: host.progress,
                };
                if !grid.write(stream.pin_mut(), index, &way)? {
                    return Ok(0);
                }
            }
            Ok(ffi::stream_close(stream.pin_mut())?)
        })
    }
}

/// How a grid is written.
struct Way<'a> {
    /// On the values of level sets: from the store's unit to the file's.
    factor: f32,
    /// The grid's, in the file's unit.
    background: f32,
    progress: &'a dyn Progress,
}

impl Streamed<'_> {
    /// The level set that it goes with.
    fn shape(&self) -> &LeafStore {
        match self {
            Self::Surface(store) | Self::Numbers(store, ..) => store,
            Self::Fog(fog) => fog.store(),
        }
    }

    /// Leaves with an active voxel.
    fn leaves(&self) -> u64 {
        match self {
            Self::Surface(store) | Self::Numbers(store, ..) => store.leaves(),
            Self::Fog(fog) => fog.leaves(),
        }
    }

    fn hash(
        &self,
        hash: &mut ContentHash,
        (half, factor): (bool, f32),
        progress: &dyn Progress,
    ) -> Result<(), StoreError> {
        match self {
            Self::Surface(store) => store.for_each_leaf(progress, |origin, mask, active| {
                let scaled = active.iter().map(|v| v * factor);
                hash.leaf(origin.0, mask, half, scaled);
                Ok(())
            })?,
            Self::Numbers(store, numbers, factor) => {
                numbers.for_each_leaf(store, progress, |origin, mask, own| {
                    hash.leaf(origin.0, mask, half, own.iter().map(|v| v * factor));
                })?;
            }
            Self::Fog(fog) => {
                fog.for_each_leaf(progress, |origin, mask, own| {
                    hash.leaf(origin.0, mask, half, own);
                })?;
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

    fn facts(&self, way: &Way) -> ffi::TreeFacts {
        let (bounds, active_voxels, values) = match self {
            Self::Surface(store) => (store.bounds(), store.active_voxels(), 1),
            Self::Fog(fog) => (fog.bounds(), fog.active_voxels(), 1),
            Self::Numbers(store, numbers, _) => {
                (store.bounds(), store.active_voxels(), numbers.width())
            }
        };
        let [low, high] = bounds.unwrap_or([Coord([0; 3]); 2]);
        let (inside, inside_active) = match self {
            Self::Surface(_) => (-way.background, false),
            Self::Fog(_) => (1.0, true),
            Self::Numbers(..) => (0.0, false),
        };
        ffi::TreeFacts {
            box_min: low.0,
            box_max: high.0,
            active_voxels: active_voxels as i64,
            bytes: (self.leaves() * (LEAF_BYTES + 2048 * values as u64)) as i64,
            inside,
            inside_active,
        }
    }

    /// Its nodes of 4096^3 voxels, in order of origin, and the cubes of that size that lie inside.
    fn nodes(&self) -> (Vec<Upper>, Vec<Coord>) {
        match self {
            Self::Surface(store) => {
                let uppers = store.uppers().map(|u| Upper {
                    origin: u.origin,
                    children: u.children.clone(),
                    inside: u.inside.clone(),
                });
                (uppers.collect(), store.inside_uppers())
            }
            Self::Numbers(store, ..) => {
                let uppers = store.uppers().map(|u| Upper {
                    origin: u.origin,
                    children: u.children.clone(),
                    inside: vec![0; u.inside.len()],
                });
                (uppers.collect(), Vec::new())
            }
            Self::Fog(fog) => (fog.uppers(), fog.store().inside_uppers()),
        }
    }

    /// The leaves of a block, in the file's unit.
    fn block(&self, origin: Coord, factor: f32) -> Result<BlockLeaves, LeafFileError> {
        let (numbers, store, factor) = match self {
            Self::Fog(fog) => return fog.block(origin),
            Self::Surface(store) => (None, store, factor),
            Self::Numbers(store, numbers, own) => (Some(numbers), store, *own),
        };
        let LeafBatch {
            origins,
            masks,
            values,
        } = store.read(origin, Region::EVERYWHERE)?;
        let mut values = if let Some(numbers) = numbers {
            drop(values);
            spread(&masks, &numbers.read(origin)?, numbers.width())
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

    /// Writes all nodes and leaves; false when the user asked to stop.
    fn write(
        &self,
        mut stream: Pin<&mut ffi::Stream>,
        index: usize,
        way: &Way,
    ) -> Result<bool, PutError> {
        ffi::stream_grid(stream.as_mut(), index, &self.facts(way))?;
        let (uppers, tiles) = self.nodes();
        let tiles: Vec<[i32; 3]> = tiles.iter().map(|c| c.0).collect();
        ffi::stream_root(stream.as_mut(), tiles.as_flattened(), uppers.len() as u32)?;
        let outside = [0; 64];
        for upper in &uppers {
            let (at, inside) = (&upper.origin.0, &upper.inside);
            ffi::stream_upper(stream.as_mut(), at, &upper.children, inside)?;
            for origin in upper.blocks() {
                let block = self.block(origin, way.factor)?;
                let inside = match self {
                    Self::Numbers(..) => None,
                    _ => self.shape().inside_slots(origin),
                };
                let leaves: Vec<[i32; 3]> = block.origins.iter().map(|o| o.0).collect();
                ffi::stream_topology(
                    stream.as_mut(),
                    &origin.0,
                    leaves.as_flattened(),
                    block.masks.as_flattened(),
                    inside.unwrap_or(&outside),
                )?;
                way.progress.advance(1);
                if way.progress.cancelled() {
                    return Ok(false);
                }
            }
        }
        for origin in uppers.iter().flat_map(Upper::blocks) {
            let block = self.block(origin, way.factor)?;
            let leaves: Vec<[i32; 3]> = block.origins.iter().map(|o| o.0).collect();
            ffi::stream_values(
                stream.as_mut(),
                &origin.0,
                leaves.as_flattened(),
                block.masks.as_flattened(),
                &block.values,
            )?;
            way.progress.advance(1);
            if way.progress.cancelled() {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Numbers of active voxels at their places among all voxels of their leaves; 0 elsewhere.
fn spread(masks: &[[u64; 8]], numbers: &[f32], width: usize) -> Vec<f32> {
    let mut values = vec![0.0; masks.len() * VOXELS * width];
    let mut rows = numbers.chunks_exact(width);
    for (leaf, mask) in values.chunks_exact_mut(VOXELS * width).zip(masks) {
        for n in slots(mask) {
            if let Some(row) = rows.next() {
                leaf[n * width..(n + 1) * width].copy_from_slice(row);
            }
        }
    }
    values
}
