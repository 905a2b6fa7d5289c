//! Leaves of a solid for analyses that read them one by one, from wherever they are.
//!
//! The tree in memory and the leaf files on disk implement it, so that both give the same analysis. A region is a box
//! of voxels, both corners included. Everything that is neither in a leaf nor in an inside cube lies outside.
//! Not promised: leaves and cubes come in no stated order, and may reach beyond the region.

use druse_geometry::frame::Coord;
use druse_geometry::progress::Cancelled;
use druse_tilings::band::{FullLeaf, LEAF, LeafStore, Region, StoreError};

/// A solid that provides its leaves region by region.
pub trait LeafSource: Sync {
    /// What can go wrong while leaves are read.
    type Error: From<Cancelled> + Send;

    /// The least voxels of the blocks with leaves, ascending.
    fn blocks(&self) -> Vec<Coord>;

    /// The box of the leaves; `None` without any.
    fn bounds(&self) -> Option<Region>;

    /// Calls `visit` with the leaves that meet a region.
    ///
    /// # Errors
    /// Those of the source.
    fn visit_leaves(
        &self,
        region: Region,
        visit: &mut dyn FnMut(FullLeaf<'_>),
    ) -> Result<(), Self::Error>;

    /// Cubes without leaves that lie inside and meet a region: least voxel and edge.
    fn inside_cubes(&self, region: Region) -> Vec<(Coord, i32)>;

    /// Whether a block without leaves lies inside: all of it does where its first voxel does.
    fn is_block_inside(&self, block: Coord) -> bool {
        !self.inside_cubes(Region::cube(block, 1)).is_empty()
    }
}

impl LeafSource for LeafStore {
    type Error = StoreError;

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
    ) -> Result<(), StoreError> {
        for block in self.blocks_in(region) {
            self.visit(block, region, &mut *visit)?;
        }
        Ok(())
    }

    fn inside_cubes(&self, region: Region) -> Vec<(Coord, i32)> {
        self.inside_cubes(region)
    }
}
