//! The fog volume of a level set on disk, made leaf by leaf; equal to that of `LevelSet::to_fog`.
//!
//! With m the least value of the level set, a voxel of value v < 0 has density v / m and is active. Other voxels
//! have density 0; leaves without active voxels are omitted. Inside tiles have density 1.

use super::{BlockLeaves, BlockNode, slot_offset, slots};
use crate::band::{LeafFileError, LeafStore, Region, StoreError, VOXELS};
use crate::frame::Coord;
use crate::progress::Cancelled;
use crate::vdb::Session;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// The fog volume of a level set on disk.
pub struct StoredFog<'a> {
    store: &'a LeafStore,
    /// Density per value: 1 / m.
    weight: f32,
    /// Blocks with leaves of the fog.
    blocks: BTreeSet<Coord>,
    counts: FogCounts,
}

/// Counts of leaves, tiles and active voxels, and the box of active voxels.
#[derive(Clone, Copy, Default)]
struct FogCounts {
    leaves: u64,
    tiles: u64,
    active: u64,
    bounds: Option<[Coord; 2]>,
}

impl FogCounts {
    fn extend_bounds(&mut self, low: Coord, high: Coord) {
        let [a, b] = self.bounds.unwrap_or([low, high]);
        self.bounds = Some([
            Coord([0, 1, 2].map(|n| a[n].min(low[n]))),
            Coord([0, 1, 2].map(|n| b[n].max(high[n]))),
        ]);
    }

    fn add_tile(&mut self, origin: Coord, edge: i32) {
        let end = edge - 1;
        self.extend_bounds(origin, origin.offset(end, end, end));
        self.tiles += 1;
        self.active += (edge as u64).pow(3);
    }
}

/// Mask and densities of a leaf; none if no voxel has a density.
fn density(values: &[f32; VOXELS], weight: f32) -> Option<([u64; 8], [f32; VOXELS])> {
    let (mut mask, mut densities) = ([0; 8], [0.0; VOXELS]);
    for (n, &v) in values.iter().enumerate() {
        let d = if v > 0.0 { 0.0 } else { v * weight };
        if d > 0.0 {
            densities[n] = d;
            mask[n >> 6] |= 1 << (n & 63);
        }
    }
    (mask != [0; 8]).then_some((mask, densities))
}

impl<'a> StoredFog<'a> {
    /// Surveys the fog in one pass over all leaves; a solid too thin to have voxels beyond the band needs another pass
    /// before. Nothing is written.
    ///
    /// # Errors
    /// [`StoreError`] if a file has changed since it was opened, or on cancellation.
    pub fn new(store: &'a LeafStore, session: Session<'_>) -> Result<Self, StoreError> {
        let blocks: Vec<Coord> = store.blocks().collect();
        let progress = session.progress;
        progress.stage("fog", Some(blocks.len() as u64));
        let has_deep_voxels = |b: &Coord| {
            store
                .inside_slots(*b)
                .is_some_and(|s| s.iter().any(|&w| w != 0))
        };
        // A voxel beyond the band has the negative background, which is the least value of all.
        let least_value = if blocks.iter().any(has_deep_voxels) {
            -store.background()
        } else {
            let least_of_block = |block: &Coord| {
                if progress.cancelled() {
                    return Err(StoreError::from(Cancelled));
                }
                let leaves = store.read(*block, Region::EVERYWHERE)?;
                let values = leaves.values.as_flattened().iter();
                Ok(values.fold(f32::INFINITY, |a, &v| a.min(v)))
            };
            let all = || {
                blocks
                    .par_iter()
                    .map(least_of_block)
                    .collect::<Result<Vec<_>, _>>()
            };
            let all = session.threads.install(all)?;
            all.into_iter().fold(f32::INFINITY, f32::min)
        };
        let mut fog = Self {
            store,
            // Without leaves the least value is infinite, and the weight 0 is not used.
            weight: 1.0 / least_value,
            blocks: BTreeSet::new(),
            counts: FogCounts::default(),
        };
        let count = |block: &Coord| {
            if progress.cancelled() {
                return Err(StoreError::from(Cancelled));
            }
            let counts = fog.count_block(*block)?;
            progress.advance(1);
            Ok(counts)
        };
        let all = || blocks.par_iter().map(count).collect::<Result<Vec<_>, _>>();
        let all: Vec<FogCounts> = session.threads.install(all)?;
        // Counts are added in order of blocks; blocks without fog are left out.
        for (&block, own) in blocks.iter().zip(all).filter(|(_, own)| own.leaves > 0) {
            fog.blocks.insert(block);
            if let Some([low, high]) = own.bounds {
                fog.counts.extend_bounds(low, high);
            }
            fog.counts.leaves += own.leaves;
            fog.counts.active += own.active;
        }
        let mut counts = fog.counts;
        fog.for_each_tile(|origin, edge| counts.add_tile(origin, edge));
        fog.counts = counts;
        Ok(fog)
    }

    fn count_block(&self, block: Coord) -> Result<FogCounts, LeafFileError> {
        let mut counts = FogCounts::default();
        let leaves = self.store.read(block, Region::EVERYWHERE)?;
        for (origin, values) in leaves.origins.iter().zip(&leaves.values) {
            let Some((mask, _)) = density(values, self.weight) else {
                continue;
            };
            counts.leaves += 1;
            let voxel = |n: usize| {
                let n = n as i32;
                origin.offset(n >> 6, n >> 3 & 7, n & 7)
            };
            for v in slots(&mask).map(voxel) {
                counts.active += 1;
                counts.extend_bounds(v, v);
            }
        }
        Ok(counts)
    }

    /// The leaves of distances from which the densities are made.
    pub(super) fn store(&self) -> &'a LeafStore {
        self.store
    }

    /// Number of leaves with a density above 0.
    pub(super) fn leaves(&self) -> u64 {
        self.counts.leaves
    }

    /// Number of active tiles.
    pub(super) fn tiles(&self) -> u64 {
        self.counts.tiles
    }

    /// Number of active voxels, with those of tiles.
    pub(super) fn active_voxels(&self) -> u64 {
        self.counts.active
    }

    /// Least and greatest active voxel on each axis; `None` without any.
    pub(super) fn bounds(&self) -> Option<[Coord; 2]> {
        self.counts.bounds
    }

    /// Nodes of 4096^3 voxels with leaves of the fog. Inside tiles are those of the store; a node without leaves is
    /// left out.
    pub(super) fn upper_nodes(&self) -> Vec<BlockNode> {
        let kept = self.store.upper_nodes().map(|u| {
            let mut children = vec![0; u.children.len()];
            for n in slots(&u.children) {
                let block =
                    u.origin
                        .offset(slot_offset(n, 10), slot_offset(n, 5), slot_offset(n, 0));
                children[n >> 6] |= u64::from(self.blocks.contains(&block)) << (n & 63);
            }
            BlockNode {
                origin: u.origin,
                children,
                inside: u.inside.clone(),
            }
        });
        kept.filter(|u| u.children.iter().any(|&w| w != 0))
            .collect()
    }

    /// The leaves of a block as densities, by origin; those without a density above 0 are left out.
    pub(super) fn block(&self, origin: Coord) -> Result<BlockLeaves, LeafFileError> {
        let leaves = self.store.read(origin, Region::EVERYWHERE)?;
        let mut fog_leaves = BlockLeaves::default();
        for (origin, values) in leaves.origins.iter().zip(&leaves.values) {
            if let Some((mask, densities)) = density(values, self.weight) {
                fog_leaves.origins.push(*origin);
                fog_leaves.masks.push(mask);
                fog_leaves.values.extend(densities);
            }
        }
        Ok(fog_leaves)
    }

    /// Calls `visit` with every leaf in order of origin: its origin, mask and active densities.
    pub(super) fn for_each_leaf(
        &self,
        progress: &dyn crate::progress::Progress,
        mut visit: impl FnMut(Coord, &[u64; 8], &mut dyn Iterator<Item = f32>),
    ) -> Result<(), StoreError> {
        self.store.for_each_leaf(progress, |origin, mask, active| {
            let values = self.store.leaf_values(mask, active);
            if let Some((mask, densities)) = density(&values, self.weight) {
                visit(origin, &mask, &mut slots(&mask).map(|n| densities[n]));
            }
            Ok(())
        })
    }

    /// Calls `visit` with every tile (origin, edge) in order of origin. Edges are 8, 128 or 4096 voxels.
    pub(super) fn for_each_tile(&self, mut visit: impl FnMut(Coord, i32)) {
        let upper_nodes = self.upper_nodes();
        let whole = self.store.inside_upper_cubes();
        let begins = upper_nodes
            .iter()
            .map(|u| u.origin)
            .chain(whole.iter().copied());
        let slabs: BTreeSet<i32> = begins.map(|c| c[0]).collect();
        // Slabs of 128 voxels along x, and rows of 8 in them: the tiles of one row are sorted together,
        // so that only these are in memory.
        for slab in slabs
            .into_iter()
            .flat_map(|x| (0..32).map(move |n| x + 128 * n))
        {
            let from = Coord([slab, i32::MIN, i32::MIN]);
            let to = Coord([slab, i32::MAX, i32::MAX]);
            let blocks: Vec<Coord> = self.blocks.range(from..=to).copied().collect();
            for row in 0..16 {
                // Tiles of all sizes that begin at the same x.
                let mut tiles: Vec<(Coord, i32)> = Vec::new();
                if row == 0 {
                    let here = whole.iter().filter(|c| c[0] == slab);
                    tiles.extend(here.map(|&c| (c, 4096)));
                    for u in upper_nodes
                        .iter()
                        .filter(|u| (u.origin[0]..u.origin[0] + 4096).contains(&slab))
                    {
                        let upper_tiles = slots(&u.inside).map(|n| {
                            (
                                u.origin.offset(
                                    slot_offset(n, 10),
                                    slot_offset(n, 5),
                                    slot_offset(n, 0),
                                ),
                                128,
                            )
                        });
                        tiles.extend(upper_tiles.filter(|t| t.0[0] == slab));
                    }
                }
                for &block in &blocks {
                    // The 16^2 slots of a row are four words.
                    let inside = self.store.inside_slots(block).into_iter();
                    let inside = inside.flat_map(|words| slots(&words[4 * row..4 * row + 4]));
                    tiles.extend(inside.map(|n| {
                        let (y, z) = ((n >> 4) as i32 * 8, (n & 15) as i32 * 8);
                        (block.offset(row as i32 * 8, y, z), 8)
                    }));
                }
                tiles.sort_unstable();
                for (origin, edge) in tiles {
                    visit(origin, edge);
                }
            }
        }
    }
}
