//! Shape operations: wider bands, walls, trims, blends, fillets, and masked changes.
//!
//! All lengths are in world units but for the widths of bands. Signs are corrected here where OpenVDB's offsets have
//! the other one. After a cancellation the level set is empty, or as before the step that was cancelled.

use super::builder::LevelSetBuilder;
use super::error::VdbError;
use super::ffi::{Csg, Smoothing};
use super::ops::OPENVDB_DEFAULT;
use super::volume::Volume;
use super::{LevelSet, Scheme, Session, ffi};
use crate::band::{Band, Region, SurfacePoints};
use crate::field::BoxSolid;
use crate::frame::Aabb;

/// The weight of an effect at each point, from the values of a grid: 0 below the range, 1 above, linear
/// between. Outside the grid its background counts.
#[derive(Clone, Copy)]
pub struct Mask<'a> {
    /// The grid; its voxels may differ from those of the level set.
    pub by: &'a Volume,
    /// Values of weight 0 and of weight 1.
    pub range: [f64; 2],
    /// Whether the weights are inverted.
    pub inverted: bool,
}

impl Mask<'_> {
    fn range(&self) -> Result<ffi::Range, VdbError> {
        let [low, high] = self.range;
        if !(low.is_finite() && high.is_finite() && high > low) {
            return Err(VdbError::Parameter {
                name: "width of the mask's range",
                value: high - low,
                expected: "a positive, finite number",
            });
        }
        Ok(ffi::Range {
            low,
            high,
            inverted: self.inverted,
        })
    }
}

/// The side of the old surface on which a wall lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WallSide {
    /// Within the solid; its outer surface stays.
    #[default]
    Inside,
    /// Around the solid, which becomes the cavity.
    Outside,
    /// Half the thickness on each side.
    Both,
}

/// Options of OpenVDB's wider bands: the values of new voxels must be distances, which 6 steps of half a voxel restore.
fn widening() -> Smoothing {
    Smoothing {
        width: 1,
        iterations: 1,
        high_order: true,
        normalisations: 6,
    }
}

impl LevelSet {
    /// Makes the band `voxels` wider on each side, without moving the surface: in one step by closest-point
    /// redistancing, or, with OpenVDB's tools, layer by layer.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB (memory).
    pub fn widen(&mut self, voxels: u32, session: Session<'_>) -> Result<(), VdbError> {
        self.widen_within(voxels, Region::EVERYWHERE, session)
    }

    /// Widens the band in a region; elsewhere it may stay as it is.
    pub(super) fn widen_within(
        &mut self,
        voxels: u32,
        region: Region,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let is_determined = SurfacePoints::suffices(self.half_width);
        if voxels > 0 && is_determined && Self::uses_closest_points(session) {
            return self.widen_by_closest_points(voxels, region, session);
        }
        self.resize(i64::from(voxels), session)
    }

    /// Widens the band by so many voxels on each side, or narrows it (negative), by OpenVDB's tools.
    fn resize(&mut self, voxels: i64, session: Session<'_>) -> Result<(), VdbError> {
        if voxels == 0 {
            return Ok(());
        }
        let count = i32::try_from(voxels).unwrap_or(i32::MAX);
        self.change("widening the band", session, |grid, host| {
            ffi::grid_resize(grid, count, widening(), host)
        })?;
        self.half_width += voxels as f64;
        Ok(())
    }

    /// Keeps only a wall of total `thickness` (world units) along the surface.
    ///
    /// # Errors
    /// As [`LevelSet::dilate`].
    pub fn hollow(
        &mut self,
        thickness: f64,
        side: WallSide,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let mut inner = self.duplicate()?;
        match side {
            WallSide::Inside => inner.erode(thickness, session)?,
            WallSide::Outside => self.dilate(thickness, session)?,
            WallSide::Both => {
                inner.erode(thickness / 2.0, session)?;
                self.dilate(thickness / 2.0, session)?;
            }
        }
        self.subtract(inner, session)
    }

    /// Intersects the solid with a box, world units.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for an empty box, [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn trim(&mut self, trim_box: Aabb, session: Session<'_>) -> Result<(), VdbError> {
        if trim_box.is_empty() {
            return Err(VdbError::Parameter {
                name: "least edge of the box",
                value: trim_box.size().min(),
                expected: "a positive length",
            });
        }
        let builder = LevelSetBuilder::new(self.transform, self.half_width)?;
        // From here on relative to voxel (0, 0, 0).
        let shift = -self.origin;
        let trim_box = Aabb {
            min: trim_box.min + shift,
            max: trim_box.max + shift,
        };
        // Only to the end of the band, with two voxels to spare: the box may be far larger.
        let margin = self.background() + 2.0 * self.voxel_size();
        let mut bounds = self.bounds()?;
        if bounds.is_empty() {
            return Ok(());
        }
        bounds = Aabb {
            min: bounds.min + shift,
            max: bounds.max + shift,
        };
        let trim_box = trim_box.intersection(bounds.dilated(margin));
        if trim_box.is_empty() {
            return self.change("trimming", session, |grid, _| ffi::grid_clear(grid));
        }
        let band = Band {
            field: &BoxSolid(trim_box),
            transform: self.transform,
            half_width: self.half_width,
            extent: trim_box,
        };
        band.evaluate(session.threads, session.progress, &builder)
            .map_err(|e| VdbError::band("trimming", e))?;
        let mut operand = builder.finish(session)?;
        operand.set_origin(self.origin)?;
        self.intersect(operand, session)
    }

    /// The union with another solid, with the seam rounded over `radius` (world units): the polynomial smooth
    /// minimum min(a, b) - max(r - |a - b|, 0)^2 / (4 r).
    ///
    /// # Errors
    /// As [`LevelSet::union`], and [`VdbError::Parameter`] unless the radius is positive and finite.
    pub fn blend(
        &mut self,
        mut operand: Self,
        radius: f64,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        check_positive("radius of the blend", radius)?;
        self.check_same_voxels(&operand)?;
        // Both distances are needed up to the radius, with two voxels to spare.
        let extra = (radius / self.voxel_size() + 2.0 - self.half_width).ceil();
        // The band is widened by at most so many voxels; a greater radius is not refused.
        let extra = extra.clamp(0.0, 4096.0) as u32;
        self.widen(extra, session)?;
        operand.widen(extra, session)?;
        let smoothing = tracking(session);
        self.change("blend", session, |grid, host| {
            ffi::grid_blend(grid, operand.grid, radius, smoothing, host)
        })?;
        self.resize(-i64::from(extra), session)
    }

    /// Rounds concave edges to a `radius` (world units): space that a ball of that radius cannot reach from
    /// outside becomes solid, including gaps narrower than twice the radius. Nothing is removed; a convex solid
    /// does not change.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] unless the radius is positive and finite; [`VdbError::Cancelled`], or errors
    /// of OpenVDB.
    pub fn fillet(&mut self, radius: f64, session: Session<'_>) -> Result<(), VdbError> {
        check_positive("radius of the fillet", radius)?;
        if Self::uses_closest_points(session) {
            let before = self.duplicate()?;
            self.close(radius, session)?;
            return self.combine("fillet", Csg::Union, before, session);
        }
        // The first-order scheme would move flat walls by more than the error of the fillet.
        let smoothing = Smoothing {
            high_order: true,
            normalisations: OPENVDB_DEFAULT,
            ..widening()
        };
        self.change("fillet", session, |grid, host| {
            ffi::grid_fillet(grid, radius, smoothing, host)
        })
    }

    /// Moves the surface outwards by `distance` times the mask's weight at each point; inwards for a negative distance.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for an unusable distance or range; else as [`LevelSet::dilate`].
    pub fn offset_masked(
        &mut self,
        distance: f64,
        mask: Mask<'_>,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        if !distance.is_finite() {
            return Err(VdbError::Parameter {
                name: "distance",
                value: distance,
                expected: "a finite number",
            });
        }
        let range = mask.range()?;
        let smoothing = tracking(session);
        // OpenVDB's sign: an addition to the distance shrinks the solid.
        self.change("moving the surface", session, |grid, host| {
            ffi::grid_offset_masked(grid, -distance, &mask.by.grid, range, smoothing, host)
        })
    }

    /// Restricts a change to a mask: where its weight is 0, the level set is again as it was `before`. For
    /// changes that move the surface by less than the half width of the band.
    ///
    /// # Errors
    /// [`VdbError::Mismatch`] for other voxels, [`VdbError::Parameter`] for an unusable range,
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn restrict_change(
        &mut self,
        before: &Self,
        mask: Mask<'_>,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        self.check_same_voxels(before)?;
        let range = mask.range()?;
        let smoothing = tracking(session);
        self.change("masking", session, |grid, host| {
            ffi::grid_restrict_change(grid, &before.grid, &mask.by.grid, range, smoothing, host)
        })
    }

    /// Removes redundant nodes of the tree; the solid does not change.
    ///
    /// # Errors
    /// Only errors of OpenVDB.
    pub fn prune(&mut self, session: Session<'_>) -> Result<(), VdbError> {
        self.change("prune", session, ffi::grid_prune)
    }
}

/// Options of OpenVDB's tracker after a change that moves the surface.
fn tracking(session: Session<'_>) -> Smoothing {
    Smoothing {
        high_order: session.scheme == Scheme::Weno5,
        normalisations: OPENVDB_DEFAULT,
        ..widening()
    }
}

/// Refuses a length that is not positive and finite; `name` is its name in the error.
fn check_positive(name: &'static str, value: f64) -> Result<(), VdbError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(VdbError::Parameter {
        name,
        value,
        expected: "a positive, finite number",
    })
}
