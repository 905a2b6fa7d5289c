//! Leaves of a level set in memory, for analyses that read them one by one.
//!
//! The cavities, drains and layers of `analyses` read a level set through it. Leaves without active voxels are left
//! out: their voxels count as outside.

use super::error::VdbError;
use super::index::LeafIndex;
use crate::band::{BLOCK, FullLeaf, LEAF, Region};
use crate::frame::Coord;
use druse_solids::leaf_source::LeafSource;
use druse_solids::voxel_mask;
use std::collections::BTreeMap;

/// Leaves and inside tiles of a level set by block.
pub(super) struct MemorySource<'a> {
    index: &'a LeafIndex<'a>,
    leaves: BTreeMap<Coord, Vec<usize>>,
    /// Tiles of at most a block.
    tiles: BTreeMap<Coord, Vec<(Coord, i32)>>,
    large_tiles: Vec<(Coord, i32)>, // origins and edges
}

impl<'a> MemorySource<'a> {
    /// Groups the active leaves and the inner tiles by blocks of 128 voxels, in which analyses read them.
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
            // A tile larger than a block would have to be listed in many blocks.
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
