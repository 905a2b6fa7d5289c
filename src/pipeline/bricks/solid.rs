//! A solid on the disk: its leaves, and the bricks that they are kept in.

use super::super::level_set_ops::Bench;
use super::super::voxels::Voxels;
use super::Yard;
use super::plan::BrickPlan;
use crate::band::{BLOCK, LEAF, LeafStore, Region};
use crate::frame::Coord;
use crate::progress::Progress;
use std::collections::BTreeSet;

/// Bricks on voxels of one size.
#[derive(Clone)]
pub(super) struct Bricks {
    pub voxels: Voxels,
    /// Least voxels, ascending.
    origins: Vec<Coord>,
    /// Edge of a brick, voxels.
    edge: i32,
}

/// A solid in bricks.
pub(super) struct StoredSolid {
    pub bricks: Bricks,
    pub store: LeafStore,
}

impl StoredSolid {
    /// The greatest coordinate of its leaves in magnitude, world units, as the mesher takes it for a whole.
    pub fn far(&self) -> f64 {
        let [min, max] = self.store.bounds().unwrap_or([Coord([0; 3]); 2]);
        let ends = (0..3).flat_map(|a| [min.aligned(LEAF)[a], max.aligned(LEAF)[a] + LEAF]);
        let size = self.bricks.voxels.scale.voxel_size;
        let far = ends.map(|c| (f64::from(c) * size).abs());
        far.fold(0.0, f64::max)
    }

    /// The middle of its leaves, world units.
    pub fn centre(&self) -> [f64; 3] {
        let [min, max] = self.store.bounds().unwrap_or([Coord([0; 3]); 2]);
        let size = self.bricks.voxels.scale.voxel_size;
        [0, 1, 2].map(|a| 0.5 * (f64::from(min[a]) + f64::from(max[a])) * size)
    }
}

impl Bricks {
    /// The bricks of a plan.
    pub fn of_plan(plan: &BrickPlan, voxels: Voxels) -> Self {
        Self {
            voxels,
            origins: plan.bricks.iter().map(|&b| Coord(b)).collect(),
            edge: plan.edge as i32 * BLOCK,
        }
    }

    /// Bricks of so many blocks a side wherever one of some regions is.
    pub fn around(voxels: Voxels, edge: u32, regions: impl Iterator<Item = Region>) -> Self {
        let edge = edge as i32 * BLOCK;
        let origins: BTreeSet<Coord> = regions.flat_map(|r| r.cubes(edge)).collect();
        Self {
            voxels,
            origins: origins.into_iter().collect(),
            edge,
        }
    }

    /// Least voxels of all, ascending.
    pub fn origins(&self) -> impl Iterator<Item = Coord> {
        self.origins.iter().copied()
    }

    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// The voxels of a brick.
    pub fn region(&self, brick: usize) -> Region {
        Region::cube(self.origins[brick], self.edge)
    }

    /// A bench for their voxels.
    pub fn bench<'b>(&self, yard: &'b Yard<'_>, progress: &'b dyn Progress) -> Bench<'b> {
        yard.bench(self.voxels, progress)
    }

    /// Half width of the band, world units.
    pub fn background(&self) -> f32 {
        (self.voxels.half_width * self.voxels.scale.voxel_size) as f32
    }
}

impl Yard<'_> {
    /// A bench for some voxels.
    pub fn bench<'b>(&'b self, voxels: Voxels, progress: &'b dyn Progress) -> Bench<'b> {
        Bench {
            scale: voxels.scale,
            half_width: voxels.half_width,
            ..Bench::new(self.stock.recipe, self.threads, progress)
        }
    }
}
