//! A level set of any size, streamed into a `.vdb` file: its tree is never in memory.
//!
//! Leaves go to a temporary file beside the target as they come, 4 bytes an active voxel and 66 a leaf, then
//! block by block into the target. The result has the bytes of a level set written from memory.

use super::error::{FileError, VdbError};
use super::stream::StoredGrid;
use super::temporary_file::temporary;
use super::write::{VdbWriter, WrittenFile};
use super::{LevelSet, Session};
use crate::band::{LeafBatch, LeafFileHead, LeafFileWriter, LeafSink, LeafStore, SinkError};
use crate::frame::{Coord, Transform};
use std::path::{Path, PathBuf};
use tempfile::{NamedTempFile, TempPath};

/// A `.vdb` file that takes the leaves of a band.
///
/// ```
/// use druse::band::Band;
/// use druse::field::Sphere;
/// use druse::frame::{Aabb, Vec3};
/// use druse::progress::{Silent, Threads};
/// use druse::vdb::{LevelSetFile, Session, info};
///
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("ball.vdb");
/// let ball = Sphere { centre: Vec3::zeros(), radius: 10.0 };
/// let extent = Aabb { min: Vec3::repeat(-10.0), max: Vec3::repeat(10.0) };
/// let band = Band::new(&ball, extent, 0.5).unwrap();
/// let threads = Threads::new(2).unwrap();
/// let file = LevelSetFile::create(&path, band.transform, band.half_width).unwrap();
/// let stats = band.evaluate(&threads, &Silent, &file).unwrap();
/// let written = file.finish(Session::new(&threads, &Silent)).unwrap();
/// assert_eq!(info(&path).unwrap().grids[0].active_voxels, stats.active_voxels);
/// assert_eq!(info(&path).unwrap().content_hash, Some(written.content_hash));
/// ```
pub struct LevelSetFile {
    path: PathBuf,
    transform: Transform,
    half_width: f64,
    head: LeafFileHead,
    leaves: LeafFileWriter<NamedTempFile>,
}

impl LevelSetFile {
    /// Begins a file whose grid is called `surface`. `path` stays untouched until [`LevelSetFile::finish`].
    ///
    /// # Errors
    /// [`FileError::Io`]: the folder is missing or not writable, or the disk is full.
    pub fn create(
        path: impl AsRef<Path>,
        transform: Transform,
        half_width: f64,
    ) -> Result<Self, FileError> {
        let path = path.as_ref().to_owned();
        // Plan and brick mark the files of a resumable run; this one is read at once.
        let head = LeafFileHead {
            plan: [0; 32],
            brick: 0,
            background: (half_width * transform.voxel_size()) as f32,
        };
        let leaves = temporary(&path).and_then(|file| LeafFileWriter::new(file, &head));
        Ok(Self {
            leaves: leaves.map_err(|e| FileError::io(&path, e))?,
            path,
            transform,
            half_width,
            head,
        })
    }

    /// Writes the file under its path and removes the temporary ones. If it fails, what the path names stays as it was.
    ///
    /// # Errors
    /// [`FileError::Io`], [`FileError::Leaves`], cancellation, or what OpenVDB refuses, such as a half width below 1.
    pub fn finish(self, session: Session<'_>) -> Result<WrittenFile, FileError> {
        let io = |e| FileError::io(&self.path, e);
        let leaves: TempPath = self.leaves.finish().map_err(io)?.into_temp_path();
        let files = vec![(leaves.to_path_buf(), self.head)];
        let store = LeafStore::open(files, session.threads, session.progress)?;
        // It gives the grid its name, transform and half width; the values come from `store`.
        let empty =
            LevelSet::empty(self.transform, self.half_width, session).map_err(|e| match e {
                VdbError::Cancelled(c) => FileError::Cancelled(c),
                e => FileError::OpenVdb {
                    path: self.path.clone(),
                    reason: e.to_string(),
                },
            })?;
        let staged = temporary(&self.path).map_err(io)?.into_temp_path();
        let mut file = VdbWriter::new(&self.path, session)?;
        file.level_set("surface", &empty)?;
        let written = file.write_streamed_to(&staged, &[StoredGrid::Surface(&store)])?;
        staged.persist(&self.path).map_err(|e| io(e.error))?;
        Ok(written)
    }
}

impl LeafSink for LevelSetFile {
    fn block(&self, origin: Coord, leaves: &LeafBatch) -> Result<(), SinkError> {
        self.leaves.block(origin, leaves)
    }
}
