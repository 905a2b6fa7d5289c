//! Changes in proportion to the weights of a mask.

use super::ffi::{self, Smoothing};
use super::redistance::Rebuild;
use super::shape_ops::widening;
use super::{LevelSet, Scheme, Session, VdbError, Volume};
use crate::band::{Region, SurfacePoints};

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

impl LevelSet {
    /// Moves the surface outwards by `distance` times the mask's weight at each point; inwards for a negative
    /// distance.
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
        if Self::uses_closest_points(session) {
            return self.offset_masked_by_closest_points(distance, mask, session);
        }
        let range = mask.range()?;
        let smoothing = Smoothing {
            high_order: session.scheme == Scheme::Weno5,
            normalisations: -1,
            ..widening()
        };
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
        self.assert_same_voxels(before)?;
        let range = mask.range()?;
        let smoothing = Smoothing {
            high_order: session.scheme == Scheme::Weno5,
            normalisations: -1,
            ..widening()
        };
        self.change("masking", session, |grid, host| {
            ffi::grid_restrict_change(grid, &before.grid, &mask.by.grid, range, smoothing, host)
        })
    }

    /// Blends the level set with its offset, by the mask's weights: distances of both reach over the whole move.
    fn offset_masked_by_closest_points(
        &mut self,
        distance: f64,
        mask: Mask<'_>,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        const NAME: &str = "moving the surface";
        let range = mask.range()?;
        let h = self.voxel_size();
        let [own, before] = [self.half_width, self.background()];
        let wide = own.max(SurfacePoints::MIN_HALF_WIDTH) + (distance.abs() / h).ceil();
        let rebuild = |half_width: f64, known: f64| Rebuild {
            outwards: 0.0,
            background: (half_width * h) as f32,
            known: known as f32,
            within: Region::EVERYWHERE,
        };
        let mut moved = self.duplicate()?;
        moved.offset_by_closest_points(NAME, distance, session)?;
        for solid in [&mut *self, &mut moved] {
            solid.rebuild(NAME, rebuild(wide, before), session)?;
            solid.half_width = wide;
        }
        let unmoved = std::mem::replace(self, moved);
        self.change(NAME, session, |grid, host| {
            ffi::grid_mix(grid, &unmoved.grid, &mask.by.grid, range, host)
        })?;
        // Blended values are no distances where the weights vary.
        self.rebuild(NAME, rebuild(own, wide * h), session)?;
        self.half_width = own;
        let background = (own * h) as f32;
        self.change(NAME, session, |mut grid, host| {
            ffi::grid_set_background(grid.as_mut(), background, host)?;
            ffi::grid_prune(grid, host)
        })
    }
}
