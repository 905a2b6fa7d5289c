//! Leaves of a level set for analyses that read them one by one: from a tree in memory, or from disk.

use super::error::{FileError, VdbError};
use super::index::LeafIndex;
use super::voxel_mask;
use crate::band::{BLOCK, FullLeaf, LEAF, LeafStore, Region, StoreError};
use crate::frame::Coord;
use crate::progress::Cancelled;
use std::collections::BTreeMap;

/// A solid that provides its leaves region by region.
pub(super) trait LeafSource: Sync {
    type Error: From<Cancelled> + Send;

    /// Blocks with leaves, ascending.
    fn blocks(&self) -> Vec<Coord>;

    /// The box of the leaves.
    fn bounds(&self) -> Option<Region>;

    /// Calls `visit` with the leaves that meet a region.
    fn visit_leaves(
        &self,
        region: Region,
        visit: &mut dyn FnMut(FullLeaf<'_>),
    ) -> Result<(), Self::Error>;

    /// Cubes without leaves that lie inside and meet a region: least voxel and edge.
    fn inside_cubes(&self, region: Region) -> Vec<(Coord, i32)>;

    /// Whether a block without leaves lies inside.
    fn is_block_inside(&self, block: Coord) -> bool {
        !self.inside_cubes(Region::cube(block, 1)).is_empty()
    }
}

/// Leaves and inside tiles of a level set by block.
pub(super) struct MemorySource<'a> {
    index: &'a LeafIndex<'a>,
    leaves: BTreeMap<Coord, Vec<usize>>,
    /// Tiles of at most a block.
    tiles: BTreeMap<Coord, Vec<(Coord, i32)>>,
    large_tiles: Vec<(Coord, i32)>,
}

impl<'a> MemorySource<'a> {
    pub fn new(index: &'a LeafIndex<'a>) -> Self {
        let mut leaves: BTreeMap<Coord, Vec<usize>> = BTreeMap::new();
        for (n, leaf) in index.leaves.iter().enumerate() {
            if leaf.any_active() {
                leaves
                    .entry(leaf.origin.aligned(BLOCK))
                    .or_default()
                    .push(n);
            }
        }
        let mut tiles: BTreeMap<Coord, Vec<(Coord, i32)>> = BTreeMap::new();
        let mut large_tiles = Vec::new();
        for tile in index.tiles.iter().filter(|t| t.value < 0.0) {
            let cube = (tile.origin, tile.edge);
            if tile.edge > BLOCK {
                large_tiles.push(cube);
            } else {
                let block = tile.origin.aligned(BLOCK);
                tiles.entry(block).or_default().push(cube);
            }
        }
        Self {
            index,
            leaves,
            tiles,
            large_tiles,
        }
    }
}

impl LeafSource for MemorySource<'_> {
    type Error = VdbError;

    fn blocks(&self) -> Vec<Coord> {
        self.leaves.keys().copied().collect()
    }

    fn bounds(&self) -> Option<Region> {
        let origins = || {
            self.leaves
                .values()
                .flatten()
                .map(|&n| self.index.leaves[n].origin)
        };
        let cube = |o: Coord| Region::cube(o, LEAF);
        origins().map(cube).reduce(|a, b| Region {
            min: Coord([0, 1, 2].map(|i| a.min[i].min(b.min[i]))),
            max: Coord([0, 1, 2].map(|i| a.max[i].max(b.max[i]))),
        })
    }

    fn visit_leaves(
        &self,
        region: Region,
        visit: &mut dyn FnMut(FullLeaf<'_>),
    ) -> Result<(), VdbError> {
        for block in region.cubes(BLOCK) {
            for &n in self.leaves.get(&block).into_iter().flatten() {
                let leaf = &self.index.leaves[n];
                if region.meets(leaf.origin, LEAF) {
                    visit(FullLeaf {
                        origin: leaf.origin,
                        active: &leaf.mask,
                        inside: &voxel_mask::negative(leaf.values),
                        values: leaf.values,
                    });
                }
            }
        }
        Ok(())
    }

    fn inside_cubes(&self, region: Region) -> Vec<(Coord, i32)> {
        let near = region.cubes(BLOCK).filter_map(|b| self.tiles.get(&b));
        let all = near.flatten().chain(&self.large_tiles).copied();
        all.filter(|&(origin, edge)| region.meets(origin, edge))
            .collect()
    }
}

impl LeafSource for LeafStore {
    type Error = FileError;

    fn blocks(&self) -> Vec<Coord> {
        self.blocks().collect()
    }

    fn bounds(&self) -> Option<Region> {
        let [min, max] = self.bounds()?;
        Some(Region {
            min: min.aligned(LEAF),
            max: Region::cube(max.aligned(LEAF), LEAF).max,
        })
    }

    fn visit_leaves(
        &self,
        region: Region,
        visit: &mut dyn FnMut(FullLeaf<'_>),
    ) -> Result<(), FileError> {
        for block in self.blocks_in(region) {
            let visited = self.visit(block, region, &mut *visit);
            visited.map_err(StoreError::from)?;
        }
        Ok(())
    }

    fn inside_cubes(&self, region: Region) -> Vec<(Coord, i32)> {
        self.inside_cubes(region)
    }
}
