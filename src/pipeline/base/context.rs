//! What all stages of a run share: threads, progress, and the voxels of the solid.

use super::error::RunError;
use super::shape::Shape;
use crate::band::{Band, BandStats, Region};
use crate::frame::{Transform, Vec3};
use crate::progress::{Progress, Threads};
use crate::recipe::{Recipe, Scale};
use crate::vdb::{LevelSet, LevelSetBuilder, Session};

/// The voxel lattice of a surface.
#[derive(Clone, Copy)]
pub(crate) struct VoxelLattice {
    /// World position of voxel (0, 0, 0).
    pub origin: Vec3,
    /// Edge of a voxel, world units.
    pub voxel_size: f64,
}

/// The context that all stages of a run share.
#[derive(Clone, Copy)]
pub(crate) struct StageContext<'a> {
    pub threads: &'a Threads,
    pub progress: &'a dyn Progress,
    /// Its voxel size is that of the solid; resampling changes it.
    pub scale: Scale,
    /// Half width of the narrow band, voxels.
    pub half_width: f64,
    /// The region of the level set in voxels, for a part of a solid (a brick with its halo); `None` for the whole
    /// solid. Beyond its border the level set is cut off and wrong, and every operation carries the error further
    /// inward.
    pub region: Option<Region>,
}

impl<'a> StageContext<'a> {
    /// The context of a recipe.
    pub fn new(recipe: &Recipe, threads: &'a Threads, progress: &'a dyn Progress) -> Self {
        let half_width = recipe.sections().band.half_width.0;
        Self::of_solid(Session::new(threads, progress), recipe.scale(), half_width)
    }

    /// The context of a solid without a recipe. `half_width` is in voxels.
    pub fn of_solid(session: Session<'a>, scale: Scale, half_width: f64) -> Self {
        Self {
            threads: session.threads,
            progress: session.progress,
            scale,
            half_width,
            region: None,
        }
    }

    /// The session of calls into OpenVDB.
    pub fn session(&self) -> Session<'a> {
        Session::new(self.threads, self.progress)
    }

    /// The transform of the voxels, with voxel (0, 0, 0) at the world's origin. Fails if the voxel size is not a
    /// valid edge.
    pub fn transform(&self) -> Result<Transform, RunError> {
        Transform::new(self.scale.voxel_size)
            .ok_or_else(|| RunError::Empty(format!("a voxel size of {}", self.scale.voxel_size)))
    }

    /// The narrow band of a shape on the context's voxels; nothing is sampled yet.
    pub fn band<'s>(&self, shape: &'s Shape) -> Result<Band<'s>, RunError> {
        Ok(Band {
            field: &*shape.field,
            transform: self.transform()?,
            half_width: self.half_width,
            extent: shape.extent,
        })
    }

    /// Samples a field into a level set: the whole solid, or the part in `region`, whose voxel (0, 0, 0) is then
    /// the region's lowest. `name` stands in errors, and in progress until sampling begins. Returns the solid
    /// and the counts of the sampling.
    pub fn sample(&self, shape: &Shape, name: &str) -> Result<(LevelSet, BandStats), RunError> {
        let transform = self.transform()?;
        self.progress.stage(name, None);
        let (region, builder) = match self.region {
            Some(region) => (
                region,
                LevelSetBuilder::of_part(transform, self.half_width, region.min),
            ),
            None => (
                Region::EVERYWHERE,
                LevelSetBuilder::new(transform, self.half_width),
            ),
        };
        let builder = builder.map_err(RunError::level_set(name))?;
        let stats = self
            .band(shape)?
            .evaluate_within(region, self.threads, self.progress, &builder)
            .map_err(RunError::band(name))?;
        let solid = builder
            .finish(self.session())
            .map_err(RunError::level_set(name))?;
        Ok((solid, stats))
    }
}

impl StageContext<'_> {
    /// The context for a band of another half width, voxels.
    pub fn with_half_width(self, half_width: f64) -> Self {
        Self { half_width, ..self }
    }
}
