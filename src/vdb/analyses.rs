//! Cavities, drains and layers of a level set, in memory and on disk.
//!
//! Each analysis exists twice: for a level set in memory, and (`stored_`) for leaf files. Both read leaves through one
//! interface and give the same result. World units, but for voxels, reaches and the radius of channels.

use super::error::{FileError, VdbError};
use super::ffi::TileChoice;
use super::index::LeafIndex;
use super::leaf_source::MemorySource;
use super::on_disk::stored_voids;
use super::{LevelSet, Session};
use crate::band::LeafStore;
use crate::frame::Coord;
use druse_solids::cavities::{
    Cavities, DrainPlan, DrainRequest, Measure, blocked_start, drain_plan, find_cavities,
};
use druse_solids::layers::{BuildLayers, BuildRequest, build_layers};

impl LevelSet {
    /// The cavities of the void that a ball of `reach` voxels cannot leave, narrowest first. The reach is at most
    /// [`MAX_CAVITY_REACH`](super::MAX_CAVITY_REACH).
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn cavities(&self, reach: i32, session: Session<'_>) -> Result<Cavities, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, TileChoice::Solid)?;
        let measure = Measure::new(self.voxel_size(), self.background() as f32, reach);
        find_cavities(&MemorySource::new(&index), measure, session.task())
    }
}

/// The cavities of a solid on disk, as [`LevelSet::cavities`] returns them.
///
/// # Errors
/// As there, and a changed leaf file.
pub fn stored_cavities(
    store: &LeafStore,
    voxel_size: f64,
    reach: i32,
    session: Session<'_>,
) -> Result<Cavities, FileError> {
    let measure = Measure::new(voxel_size, store.background(), reach);
    Ok(find_cavities(store, measure, session.task())?)
}

impl LevelSet {
    /// The channels that drain the cavities. Without `narrow` only the closed cavities are drained, which are found
    /// first.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn drain_channels(
        &self,
        request: &DrainRequest,
        session: Session<'_>,
    ) -> Result<DrainPlan, VdbError> {
        let closed = if request.narrow {
            Vec::new()
        } else {
            self.voids(session)?
        };
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, TileChoice::Solid)?;
        let closed: Vec<Coord> = closed.iter().map(|c| c.place).collect();
        drain_plan(
            &MemorySource::new(&index),
            self.voxel_size(),
            self.background() as f32,
            request,
            &closed,
            session.task(),
        )
    }

    /// The first of some voxels from which a ball of the channels' radius, less the loss by sampling, does not get
    /// outside.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn blocked_start(
        &self,
        request: &DrainRequest,
        starts: &[Coord],
        session: Session<'_>,
    ) -> Result<Option<Coord>, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, TileChoice::Solid)?;
        blocked_start(
            &MemorySource::new(&index),
            self.voxel_size(),
            self.background() as f32,
            request,
            starts,
            session.task(),
        )
    }
}

/// The channels that drain a solid on disk, as [`LevelSet::drain_channels`] returns them. `voxel_size` is in world
/// units.
///
/// # Errors
/// As there, and a changed leaf file.
pub fn stored_drain_channels(
    store: &LeafStore,
    voxel_size: f64,
    request: &DrainRequest,
    session: Session<'_>,
) -> Result<DrainPlan, FileError> {
    let closed = if request.narrow {
        Vec::new()
    } else {
        stored_voids(store, voxel_size, session)?
    };
    let closed: Vec<Coord> = closed.iter().map(|c| c.place).collect();
    let task = session.task();
    Ok(drain_plan(
        store,
        voxel_size,
        store.background(),
        request,
        &closed,
        task,
    )?)
}

/// The first blocked voxel of a solid on disk, as [`LevelSet::blocked_start`] returns it.
///
/// # Errors
/// As there, and a changed leaf file.
pub fn stored_blocked_start(
    store: &LeafStore,
    voxel_size: f64,
    request: &DrainRequest,
    starts: &[Coord],
    session: Session<'_>,
) -> Result<Option<Coord>, FileError> {
    Ok(blocked_start(
        store,
        voxel_size,
        store.background(),
        request,
        starts,
        session.task(),
    )?)
}

impl LevelSet {
    /// The layers of the solid. Layers count from voxel (0, 0, 0), whatever [`LevelSet::origin`] is.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn build_layers(
        &self,
        request: &BuildRequest,
        session: Session<'_>,
    ) -> Result<BuildLayers, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, TileChoice::Solid)?;
        build_layers(
            &MemorySource::new(&index),
            self.voxel_size(),
            self.background() as f32,
            request,
            session.task(),
        )
    }
}

/// The layers of a solid in a leaf file, as [`LevelSet::build_layers`] returns them.
///
/// # Errors
/// [`FileError`]: cancellation, and a leaf file that cannot be read or was changed since it was written.
pub fn stored_build_layers(
    store: &LeafStore,
    voxel_size: f64,
    request: &BuildRequest,
    session: Session<'_>,
) -> Result<BuildLayers, FileError> {
    let (background, task) = (store.background(), session.task());
    Ok(build_layers(store, voxel_size, background, request, task)?)
}
