//! Operations that make a shape of a shape: walls, blends, fillets, masks, trims.

use super::ffi::{self, Csg, Smoothing};
use super::{LevelSet, LevelSetBuilder, Scheme, Session, VdbError, Volume};
use crate::band::{Band, Region};
use crate::field::BoxSolid;
use crate::frame::Aabb;

/// Where an effect acts: nowhere below the range of a grid's values, wholly above it, linearly
/// between. Outside the grid its background counts.
#[derive(Clone, Copy)]
pub struct Mask<'a> {
    /// The grid; it may have voxels of its own.
    pub by: &'a Volume,
    /// Values that mean "not at all" and "wholly".
    pub range: [f64; 2],
    /// Whether they mean the opposite.
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

/// On which side of the old surface a wall lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WallSide {
    /// Within the solid: its outer surface stays.
    #[default]
    Inside,
    /// Around the solid: it becomes the hole.
    Outside,
    /// Half the thickness on each side.
    Both,
}

/// How OpenVDB makes bands wider: the values of the new voxels must be distances.
fn widening() -> Smoothing {
    Smoothing {
        width: 1,
        iterations: 1,
        high_order: true,
        normalisations: 6,
    }
}

impl LevelSet {
    /// Makes the band `voxels` wider on each side, without moving the surface: at once by points of the
    /// surface, or, with OpenVDB's tools, ring by ring.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses (memory).
    pub fn widen(&mut self, voxels: u32, session: Session<'_>) -> Result<(), VdbError> {
        self.widen_within(voxels, Region::EVERYWHERE, session)
    }

    /// The same where only what lies in a region will be looked at: elsewhere the band may stay as it is.
    pub(super) fn widen_within(
        &mut self,
        voxels: u32,
        region: Region,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        if voxels > 0 && self.moves_by_points(session) {
            return self.widen_by_points(voxels, region, session);
        }
        self.resize(i64::from(voxels), session)
    }

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

    /// Leaves only a wall of full `thickness` (world units) along the surface.
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

    /// The solid within a box, world units.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for an empty box, [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn trim(&mut self, room: Aabb, session: Session<'_>) -> Result<(), VdbError> {
        if room.is_empty() {
            return Err(VdbError::Parameter {
                name: "least edge of the box",
                value: room.size().min(),
                expected: "a positive length",
            });
        }
        let builder = LevelSetBuilder::new(self.transform, self.half_width)?;
        let shift = -self.origin;
        let room = Aabb {
            min: room.min + shift,
            max: room.max + shift,
        };
        // Only where the solid is: a box may be far larger.
        let reach = self.background() + 2.0 * self.voxel_size();
        let mut own = self.bounds()?;
        if own.is_empty() {
            return Ok(());
        }
        own = Aabb {
            min: own.min + shift,
            max: own.max + shift,
        };
        let room = room.intersection(own.dilated(reach));
        if room.is_empty() {
            return self.change("trimming", session, |grid, _| ffi::grid_clear(grid));
        }
        let band = Band {
            field: &BoxSolid(room),
            transform: self.transform,
            half_width: self.half_width,
            extent: room,
        };
        band.evaluate(session.threads, session.progress, &builder)
            .map_err(|e| VdbError::band("trimming", e))?;
        let mut operand = builder.finish(session)?;
        operand.place_at(self.origin)?;
        self.intersect(operand, session)
    }

    /// The solid that is in either, the seam between them rounded over `radius` (world units): the
    /// polynomial smooth minimum min(a, b) - max(r - |a - b|, 0)^2 / (4 r). Uses the operand up.
    ///
    /// # Errors
    /// As [`LevelSet::union`], and [`VdbError::Parameter`] unless the radius is positive and finite.
    pub fn blend(
        &mut self,
        mut operand: Self,
        radius: f64,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        positive("radius of the blend", radius)?;
        self.assert_same_voxels(&operand)?;
        // Both distances must be known as far as the blend reaches.
        let wider = (radius / self.voxel_size() + 2.0 - self.half_width).ceil();
        let wider = wider.clamp(0.0, 4096.0) as u32;
        self.widen(wider, session)?;
        operand.widen(wider, session)?;
        let how = Smoothing {
            high_order: session.scheme == Scheme::Weno5,
            normalisations: -1,
            ..widening()
        };
        self.change("blend", session, |grid, host| {
            ffi::grid_blend(grid, operand.grid, radius, how, host)
        })?;
        self.resize(-i64::from(wider), session)
    }

    /// Fills concave edges to a `radius` (world units): whatever a ball of that radius, rolled around
    /// the outside, cannot reach becomes solid; so do gaps narrower than twice the radius. Nothing is
    /// taken away. A convex solid stays as it is.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] unless the radius is positive and finite; [`VdbError::Cancelled`], or
    /// what OpenVDB refuses.
    pub fn fillet(&mut self, radius: f64, session: Session<'_>) -> Result<(), VdbError> {
        positive("radius of the fillet", radius)?;
        if self.moves_by_points(session) {
            let before = self.duplicate()?;
            self.close(radius, session)?;
            return self.combine("fillet", Csg::Union, before, session);
        }
        // The scheme of first order moves flat walls by more than the fillet's own error.
        let how = Smoothing {
            high_order: true,
            normalisations: -1,
            ..widening()
        };
        self.change("fillet", session, |grid, host| {
            ffi::grid_fillet(grid, radius, how, host)
        })
    }

    /// Moves the surface outwards by `distance` times the mask's share at each place; a negative
    /// distance moves it inwards.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for an unusable distance or range; else as [`LevelSet::dilate`].
    pub fn move_by(
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
        let how = Smoothing {
            high_order: session.scheme == Scheme::Weno5,
            normalisations: -1,
            ..widening()
        };
        // OpenVDB's sign: adding to the distance shrinks.
        self.change("moving the surface", session, |grid, host| {
            ffi::grid_vary(grid, -distance, &mask.by.grid, range, how, host)
        })
    }

    /// Keeps of a change only what a mask lets through: where its share is 0 the level set is again
    /// as it was `before`. For changes that move the surface by less than the band's half width.
    ///
    /// # Errors
    /// [`VdbError::Mismatch`] for other voxels, [`VdbError::Parameter`] for an unusable range,
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn mix(
        &mut self,
        before: &Self,
        mask: Mask<'_>,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        self.assert_same_voxels(before)?;
        let range = mask.range()?;
        let how = Smoothing {
            high_order: session.scheme == Scheme::Weno5,
            normalisations: -1,
            ..widening()
        };
        self.change("masking", session, |grid, host| {
            ffi::grid_mix(grid, &before.grid, &mask.by.grid, range, how, host)
        })
    }

    /// Drops nodes that say nothing; the shape and its surface stay.
    ///
    /// # Errors
    /// Only what OpenVDB itself refuses.
    pub fn prune(&mut self, session: Session<'_>) -> Result<(), VdbError> {
        self.change("prune", session, ffi::grid_prune)
    }
}

fn positive(name: &'static str, value: f64) -> Result<(), VdbError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(VdbError::Parameter {
        name,
        value,
        expected: "a positive, finite number",
    })
}
