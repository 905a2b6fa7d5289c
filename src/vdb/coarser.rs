//! Copies of a level set on voxels of twice the edge.
//!
//! This is the case of resampling in which every new voxel is an old one and the band determines the surface: distances
//! come from the surface's points and not from interpolated values. Other cases are resampled as fields.

use super::as_field::Placement;
use super::error::VdbError;
use super::smooth::leaf_of;
use super::{LevelSet, Session};
use crate::band::{FinerBand, LeafBatch, Region, SurfacePoints};
use crate::frame::{Coord, Transform, Vec3};

impl LevelSet {
    /// Whether a resampling takes every second voxel, and the band determines the surface.
    pub(super) fn is_doubling(
        &self,
        transform: Transform,
        placement: Placement,
        session: Session<'_>,
    ) -> bool {
        transform.voxel_size() == 2.0 * self.voxel_size()
            && self.origin == Vec3::zeros()
            && placement == Placement::IDENTITY
            && SurfacePoints::suffices(self.half_width)
            && Self::uses_closest_points(session)
    }

    /// The leaves of the solid on voxels of twice the edge, as [`FinerBand::coarser_leaves`] returns them.
    /// `half_width` is in the new voxels.
    pub(super) fn coarser_leaves(
        &self,
        half_width: f64,
        session: Session<'_>,
    ) -> Result<Vec<LeafBatch>, VdbError> {
        let leaves = self.leaves()?;
        // Where no leaf is, the value is the same in all voxels of one. Reading fails only for unequal lengths.
        let first = |origin: Coord| self.values(&[origin]).unwrap_or_default();
        let finer = FinerBand {
            leaves: (0..leaves.len()).map(|n| leaf_of(&leaves, n)).collect(),
            voxel_size: self.voxel_size(),
            background: self.background() as f32,
            is_inside: &|origin| first(origin).first().is_some_and(|v| *v < 0.0),
        };
        let made = session
            .threads
            .install(|| finer.coarser_leaves(half_width, Region::EVERYWHERE, session.progress));
        Ok(made?)
    }
}
