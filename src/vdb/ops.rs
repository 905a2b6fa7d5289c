//! Offsets, filters and boolean operations.
//!
//! The sign of offsets is corrected here: OpenVDB's `offset(+d)` adds d to the distance, which shrinks the
//! solid.
//!
//! Operations change the level set in place. After a failure of OpenVDB or a cancellation it is empty, or as before the
//! step that failed; after a refused parameter it is unchanged. Distances are in world units, widths of filters in
//! voxels. By default offsets and the mean, Gaussian and Laplacian filters are those of this crate; the others, and all
//! on request of the session, are OpenVDB's.

use super::error::VdbError;
use super::ffi::{Csg, Filter, Smoothing};
use super::smooth::is_native;
use super::{LevelSet, Scheme, Session, ffi};
use std::pin::Pin;

/// Greatest width of a filter, voxels to either side; far below 645, where OpenVDB's median begins to fail.
pub(crate) const MAX_FILTER_WIDTH: u32 = 64;
/// Greatest number of iterations of a filter: far more than any smoothing needs.
const MAX_FILTER_ITERATIONS: u32 = 1000;

/// Greatest distance outwards, voxels: a point that is dilated this far has a band of some 2e10 voxels.
const MAX_DILATION: f64 = 16_384.0;

/// Keeps OpenVDB's own number of normalisations after each step.
pub(super) const OPENVDB_DEFAULT: i32 = -1;

/// Options of a filter of the bridge, with the session's scheme and OpenVDB's number of normalisations.
fn smoothing(width: u32, iterations: u32, session: Session<'_>) -> Smoothing {
    Smoothing {
        width: i32::try_from(width).unwrap_or(i32::MAX),
        iterations: i32::try_from(iterations).unwrap_or(i32::MAX),
        high_order: session.scheme == Scheme::Weno5,
        normalisations: OPENVDB_DEFAULT,
    }
}

impl LevelSet {
    /// Moves the surface outwards by `distance` (world units): in one step by closest-point redistancing, or,
    /// with OpenVDB's tools, in time proportional to distance / voxel size.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] unless the distance is finite, not negative and, outwards, at most 16,384 voxels,
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn dilate(&mut self, distance: f64, session: Session<'_>) -> Result<(), VdbError> {
        self.check_dilation(distance)?;
        self.move_surface("dilate", checked(distance)?, session)
    }

    /// Moves the surface inwards by `distance` (world units); parts thinner than twice the distance vanish.
    ///
    /// # Errors
    /// As [`LevelSet::dilate`].
    pub fn erode(&mut self, distance: f64, session: Session<'_>) -> Result<(), VdbError> {
        self.move_surface("erode", -checked(distance)?, session)
    }

    /// Erodes, then dilates by `distance` (world units): removes parts thinner than twice the distance.
    ///
    /// # Errors
    /// As [`LevelSet::dilate`].
    pub fn open(&mut self, distance: f64, session: Session<'_>) -> Result<(), VdbError> {
        // Checked first, so that a refused operation leaves the level set unchanged.
        self.check_dilation(distance)?;
        self.erode(distance, session)?;
        self.dilate(distance, session)
    }

    /// Dilates, then erodes by `distance` (world units): closes gaps narrower than twice the distance.
    ///
    /// # Errors
    /// As [`LevelSet::dilate`].
    pub fn close(&mut self, distance: f64, session: Session<'_>) -> Result<(), VdbError> {
        self.dilate(distance, session)?;
        self.erode(distance, session)
    }

    /// Refuses a distance outwards beyond [`MAX_DILATION`] voxels.
    fn check_dilation(&self, distance: f64) -> Result<(), VdbError> {
        let voxels = distance / self.voxel_size();
        if voxels > MAX_DILATION {
            return Err(VdbError::Parameter {
                name: "distance in voxels",
                value: voxels,
                expected: "at most 16384",
            });
        }
        Ok(())
    }

    /// Offsets the surface; `outwards` > 0 grows the solid, the opposite of OpenVDB's sign. World units.
    fn move_surface(
        &mut self,
        operation: &'static str,
        outwards: f64,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        if Self::uses_closest_points(session) {
            return self.offset_by_closest_points(operation, outwards, session);
        }
        // An offset takes its scheme and its normalisations from these.
        let options = smoothing(1, 1, session);
        self.change(operation, session, |grid, host| {
            ffi::grid_offset(grid, -outwards, options, host)
        })
    }

    /// Smooths by a Gaussian of `width` voxels (four passes of a box filter), `iterations` times.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] unless the width is 1 to 64 and the iterations at most 1000,
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn gaussian(
        &mut self,
        width: u32,
        iterations: u32,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        self.filter("gaussian", Filter::Gaussian, width, iterations, session)
    }

    /// Replaces each value by the mean over the cube of `2 width + 1` voxels a side around it, `iterations` times.
    ///
    /// # Errors
    /// As [`LevelSet::gaussian`].
    pub fn mean(
        &mut self,
        width: u32,
        iterations: u32,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        self.filter("mean", Filter::Mean, width, iterations, session)
    }

    /// Replaces each value by the median over the cube of `2 width + 1` voxels a side around it, `iterations` times.
    ///
    /// # Errors
    /// As [`LevelSet::gaussian`].
    pub fn median(
        &mut self,
        width: u32,
        iterations: u32,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        self.filter("median", Filter::Median, width, iterations, session)
    }

    /// Laplacian flow, `iterations` explicit steps of h^2 / 6: removes the finest roughness.
    ///
    /// # Errors
    /// As [`LevelSet::gaussian`].
    pub fn laplacian(&mut self, iterations: u32, session: Session<'_>) -> Result<(), VdbError> {
        self.filter("laplacian", Filter::Laplacian, 1, iterations, session)
    }

    /// Mean-curvature flow, `iterations` explicit steps of h^2 / 3: every point moves by its mean curvature.
    ///
    /// # Errors
    /// As [`LevelSet::gaussian`].
    pub fn curvature(&mut self, iterations: u32, session: Session<'_>) -> Result<(), VdbError> {
        self.filter("curvature", Filter::Curvature, 1, iterations, session)
    }

    fn filter(
        &mut self,
        operation: &'static str,
        kind: Filter,
        width: u32,
        iterations: u32,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        if !(1..=MAX_FILTER_WIDTH).contains(&width) {
            return Err(VdbError::Parameter {
                name: "width of the filter in voxels",
                value: width.into(),
                expected: "1 to 64",
            });
        }
        check_iterations(iterations)?;
        if is_native(kind, session) {
            return self.smooth(operation, kind, width, iterations, session);
        }
        let options = smoothing(width, iterations, session);
        self.change(operation, session, |grid, host| {
            ffi::grid_filter(grid, kind, options, host)
        })
    }

    /// Restores distances in the band without moving the surface: `iterations` steps of half a voxel each, so
    /// that 6 steps cover a band of 3 voxels.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for more than 1000 iterations, [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn renormalise(&mut self, iterations: u32, session: Session<'_>) -> Result<(), VdbError> {
        check_iterations(iterations)?;
        let options = Smoothing {
            normalisations: i32::try_from(iterations).unwrap_or(i32::MAX),
            ..smoothing(1, 1, session)
        };
        self.change("renormalise", session, |grid, host| {
            ffi::grid_renormalise(grid, options, host)
        })
    }

    /// The union with another solid. Solids that touch in a plane of voxels merge.
    ///
    /// # Errors
    /// [`VdbError::Mismatch`] if voxel size, origin or half width differ; errors of OpenVDB.
    pub fn union(&mut self, operand: Self, session: Session<'_>) -> Result<(), VdbError> {
        self.combine("union", Csg::Union, operand, session)?;
        self.merge_contacts("union", session)
    }

    /// The intersection with another solid.
    ///
    /// # Errors
    /// As [`LevelSet::union`].
    pub fn intersect(&mut self, operand: Self, session: Session<'_>) -> Result<(), VdbError> {
        self.combine("intersect", Csg::Intersection, operand, session)
    }

    /// The difference: this solid without the operand.
    ///
    /// # Errors
    /// As [`LevelSet::union`].
    pub fn subtract(&mut self, operand: Self, session: Session<'_>) -> Result<(), VdbError> {
        self.combine("subtract", Csg::Difference, operand, session)
    }

    /// Combines the solid with an operand of the same voxels and half width by OpenVDB's CSG. `operation` names it in
    /// errors; after a failure of OpenVDB the solid is empty.
    pub(super) fn combine(
        &mut self,
        operation: &'static str,
        kind: Csg,
        operand: Self,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        self.check_same_voxels(&operand)?;
        self.change(operation, session, |grid, host| {
            ffi::grid_csg(grid, operand.grid, kind, host)
        })
    }

    /// Checks that two level sets have the same voxels and half width. Tolerances are 1e-9 of the edge, 1e-4 voxels for
    /// the half width, and 1e-6 voxels for the origin; the error names the first difference.
    pub(super) fn check_same_voxels(&self, other: &Self) -> Result<(), VdbError> {
        let mismatch = |what, left: f64, right: f64, tolerance: f64| {
            let differ = (left - right).abs() > tolerance;
            let error = VdbError::Mismatch { what, left, right };
            if differ { Err(error) } else { Ok(()) }
        };
        let h = self.voxel_size();
        mismatch("voxel size", h, other.voxel_size(), 1e-9 * h)?;
        mismatch("half width", self.half_width, other.half_width, 1e-4)?;
        for a in 0..3 {
            mismatch("origin", self.origin[a], other.origin[a], 1e-6 * h)?;
        }
        Ok(())
    }

    /// Changes the grid by a function of the bridge; after a failure the level set is empty. `operation` is its name in
    /// errors.
    pub(super) fn change(
        &mut self,
        operation: &'static str,
        session: Session<'_>,
        work: impl FnOnce(Pin<&mut ffi::Grid>, &ffi::Host<'_>) -> Result<(), cxx::Exception>,
    ) -> Result<(), VdbError> {
        match work(self.grid.pin_mut(), &session.host()) {
            Ok(()) => Ok(()),
            Err(error) => {
                self.clear()?;
                Err(VdbError::of(operation, session, &error))
            }
        }
    }

    /// Removes all voxels, so that nothing half-made stays.
    pub(super) fn clear(&mut self) -> Result<(), VdbError> {
        ffi::grid_clear(self.grid.pin_mut())
            .map_err(|e| VdbError::plain("clearing a level set", &e))
    }
}

fn check_iterations(iterations: u32) -> Result<(), VdbError> {
    if iterations <= MAX_FILTER_ITERATIONS {
        return Ok(());
    }
    Err(VdbError::Parameter {
        name: "number of iterations",
        value: iterations.into(),
        expected: "at most 1000",
    })
}

/// Checks a distance of an offset.
fn checked(distance: f64) -> Result<f64, VdbError> {
    if distance.is_finite() && distance >= 0.0 {
        return Ok(distance);
    }
    Err(VdbError::Parameter {
        name: "distance",
        value: distance,
        expected: "a finite number that is not negative",
    })
}
