//! A level set divided into its connected pieces, each a level set.

use super::{LevelSet, Session, VdbError, ffi};

impl LevelSet {
    /// The connected pieces of the solid, the largest first: copies.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses (memory).
    pub fn segments(&self, session: Session<'_>) -> Result<Vec<Self>, VdbError> {
        let failed = |e: cxx::Exception| VdbError::of("dividing into pieces", session, &e);
        let mut parts = ffi::grid_segments(&self.grid, &session.host()).map_err(failed)?;
        (0..parts.len())
            .map(|n| {
                let grid = ffi::parts_take(parts.pin_mut(), n).map_err(failed)?;
                Ok(Self { grid, ..*self })
            })
            .collect()
    }
}
