//! Fog volumes: density 1 deep inside, a linear ramp over the inner half of the band, 0 outside.
//!
//! A fog shows a solid in renderers that know no level sets. It cannot be read back as exactly: only the inner half of
//! the band has a ramp.

use super::error::VdbError;
use super::{LevelSet, Session, ffi};
use cxx::UniquePtr;

/// A fog volume made from a level set, for renderers; it can only be written.
pub struct Fog {
    pub(super) grid: UniquePtr<ffi::Grid>,
}

impl LevelSet {
    /// A copy of the solid as a fog volume.
    ///
    /// # Errors
    /// Only errors of OpenVDB (memory).
    pub fn to_fog(&self, session: Session<'_>) -> Result<Fog, VdbError> {
        let grid = ffi::grid_fog(&self.grid, &session.host())
            .map_err(|e| VdbError::of("making fog", session, &e))?;
        Ok(Fog { grid })
    }
}
