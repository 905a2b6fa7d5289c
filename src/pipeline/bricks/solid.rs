//! A solid on disk: its leaves and the bricks that contain them. Bricks are cubes of whole blocks of 128^3 voxels
//! at multiples of their edge; they do not overlap.

use super::BrickRun;
use super::plan::BrickPlan;
use crate::band::{BLOCK, LEAF, LeafStore, Region};
use crate::frame::Coord;
use crate::pipeline::base::context::StageContext;
use crate::pipeline::ops::voxels::Voxels;
use crate::progress::Progress;
use std::collections::BTreeSet;

/// Bricks on voxels of one size.
#[derive(Clone)]
pub(super) struct Bricks {
    pub voxels: Voxels,
    /// Lowest voxels, ascending.
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
    /// The greatest magnitude of a coordinate of its leaves, world units, as the mesher defines it for a whole
    /// solid; one leaf's edge for an empty one.
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

    /// All bricks of an edge in blocks that meet any of some regions of voxels.
    pub fn around(voxels: Voxels, edge: u32, regions: impl Iterator<Item = Region>) -> Self {
        let edge = edge as i32 * BLOCK;
        let origins: BTreeSet<Coord> = regions.flat_map(|r| r.cubes(edge)).collect();
        Self {
            voxels,
            origins: origins.into_iter().collect(),
            edge,
        }
    }

    /// These bricks and all others that meet any of some regions.
    pub fn including(&self, regions: impl Iterator<Item = Region>) -> Self {
        let own = self.origins.iter().copied();
        let origins: BTreeSet<Coord> = regions
            .flat_map(|r| r.cubes(self.edge))
            .chain(own)
            .collect();
        Self {
            origins: origins.into_iter().collect(),
            ..self.clone()
        }
    }

    /// The lowest voxels of all bricks, ascending.
    pub fn origins(&self) -> impl Iterator<Item = Coord> {
        self.origins.iter().copied()
    }

    /// Number of bricks; they are numbered from 0 in the order of `origins`.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// The voxels of a brick.
    pub fn region(&self, brick: usize) -> Region {
        Region::cube(self.origins[brick], self.edge)
    }

    /// The context for their voxels.
    pub fn context<'b>(
        &self,
        brick_run: &'b BrickRun<'_>,
        progress: &'b dyn Progress,
    ) -> StageContext<'b> {
        brick_run.context(self.voxels, progress)
    }

    /// Half width of the band, world units.
    pub fn background(&self) -> f32 {
        (self.voxels.half_width * self.voxels.scale.voxel_size) as f32
    }
}

impl BrickRun<'_> {
    /// The context for some voxels.
    pub fn context<'b>(&'b self, voxels: Voxels, progress: &'b dyn Progress) -> StageContext<'b> {
        StageContext {
            scale: voxels.scale,
            half_width: voxels.half_width,
            ..StageContext::new(self.inputs.recipe, self.threads, progress)
        }
    }
}
