//! Grids of floats of any class: fog volumes, masks, fields of others.

use super::leaves::{Leaves, samples_of};
use super::{FileError, GridInfo, LevelSet, LevelSetBuilder, Session, VdbError, ffi};
use crate::frame::{Coord, Transform, Vec3, WorldPoint};
use cxx::UniquePtr;
use std::path::Path;

/// A grid of floats of which nothing is promised but finite cubic voxels; what a file of others holds.
pub struct Volume {
    pub(super) grid: UniquePtr<ffi::Grid>,
    pub(super) name: String,
    /// What it is, as found when it was read.
    pub(super) info: Box<GridInfo>,
}

impl Volume {
    /// Takes a grid over if it holds floats on cubic voxels.
    pub(super) fn adopt(
        path: &Path,
        name: &str,
        grid: UniquePtr<ffi::Grid>,
    ) -> Result<Self, FileError> {
        let facts = ffi::grid_facts(&grid).map_err(|e| FileError::damaged(path, &e))?;
        let info = GridInfo::from_facts(facts);
        let refuse = |found: String, expected| FileError::NotALevelSet {
            path: path.to_owned(),
            grid: name.to_owned(),
            found,
            expected,
        };
        if info.grid_type != super::file::FLOATS {
            return Err(refuse(
                format!("the type {}", info.grid_type),
                super::file::FLOATS,
            ));
        }
        if Transform::new(info.voxel_size[0]).is_none() || !info.cubic {
            return Err(refuse(
                format!("voxels of {:?} or a rotation", info.voxel_size),
                "cubic voxels along the axes",
            ));
        }
        super::file::all_finite(&grid)
            .map_err(|e| FileError::damaged(path, &e))?
            .map_err(|found| refuse(found, "finite numbers"))?;
        Ok(Self {
            grid,
            name: name.to_owned(),
            info: Box::new(info),
        })
    }

    /// Multiplies lengths by `factor`: voxels and their places, not values.
    ///
    /// # Errors
    /// Only what OpenVDB itself refuses.
    pub fn rescaled(mut self, factor: f64) -> Result<Self, VdbError> {
        self.info.origin = self.info.origin.map(|c| c * factor);
        self.info.voxel_size = self.info.voxel_size.map(|h| h * factor);
        let (h, origin) = (self.info.voxel_size[0], self.info.origin);
        ffi::grid_place(self.grid.pin_mut(), h, &origin)
            .map_err(|e| VdbError::plain("scaling", &e))?;
        Ok(self)
    }

    /// Its name in the file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A metadata value, as text.
    pub fn meta(&self, key: &str) -> Option<&str> {
        let found = self.info.metadata.iter().find(|(k, _)| k == key);
        found.map(|(_, value)| value.as_str())
    }

    /// Class, voxels, box and metadata.
    pub fn info(&self) -> &GridInfo {
        &self.info
    }

    /// Its leaves, in order of origin.
    ///
    /// # Errors
    /// Only what OpenVDB itself refuses (memory).
    pub fn leaves(&self) -> Result<Leaves<'_>, VdbError> {
        Leaves::of_grid(&self.grid).map_err(|e| VdbError::plain("listing leaves", &e))
    }

    /// Values at points of the world, trilinear between voxels; the background outside.
    ///
    /// # Errors
    /// Only what OpenVDB itself refuses.
    pub fn samples(&self, points: &[WorldPoint]) -> Result<Vec<f32>, VdbError> {
        samples_of(&self.grid, points)
    }

    /// The level set of the surface on which the values are `value`: of a fog the part above it is
    /// inside, of a field of distances the part below. By way of a mesh, so the surface moves by up
    /// to a quarter of a voxel where it is finely curved.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for a value that is not finite or a half width (voxels) below 1,
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn isosurface(
        &self,
        value: f64,
        half_width: f64,
        session: Session<'_>,
    ) -> Result<LevelSet, VdbError> {
        if !value.is_finite() {
            return Err(VdbError::Parameter {
                name: "value of the surface",
                value,
                expected: "a finite number",
            });
        }
        let info = &self.info;
        let transform = Transform::new(info.voxel_size[0]).ok_or(VdbError::Parameter {
            name: "voxel size",
            value: info.voxel_size[0],
            expected: "a positive, finite number",
        })?;
        // The builder knows which half widths a level set may have.
        LevelSetBuilder::new(transform, half_width)?;
        let grid = ffi::grid_isosurface(&self.grid, value, half_width as f32, &session.host())
            .map_err(|e| VdbError::of("finding a surface", session, &e))?;
        Ok(LevelSet {
            grid,
            transform,
            origin: Vec3::from(info.origin),
            half_width,
        })
    }

    /// The same grid as a level set, if it is one.
    ///
    /// # Errors
    /// [`FileError::NotALevelSet`] with what is missing; `path` is its name in errors.
    pub fn into_level_set(self, path: &Path, session: Session<'_>) -> Result<LevelSet, FileError> {
        super::file::adopt_finite(path, &self.name, self.grid, &self.info, session)
    }

    /// Reads a grid of floats in this process: for files that one has made oneself. Without a name:
    /// `surface`, else the only level set, else the only grid of floats.
    ///
    /// # Errors
    /// [`FileError::Io`], [`FileError::Damaged`], [`FileError::NoGrid`], or
    /// [`FileError::NotALevelSet`] for other types and for voxels that are no cubes.
    pub fn read(path: &Path, name: Option<&str>) -> Result<Self, FileError> {
        let (name, grid) = super::file::pick(path, name)?;
        Self::adopt(path, &name, grid)
    }

    /// A volume from its parts, as they come through a pipe.
    pub(super) fn assemble(info: &GridInfo) -> Result<VolumeBuilder, cxx::Exception> {
        let [x, y, z] = info.origin;
        let grid = ffi::grid_raw(
            info.voxel_size[0],
            &[x, y, z],
            info.background.unwrap_or(0.0) as f32,
            &info.class,
        )?;
        Ok(VolumeBuilder { grid })
    }
}

/// A volume in the making.
pub(super) struct VolumeBuilder {
    grid: UniquePtr<ffi::Grid>,
}

impl VolumeBuilder {
    pub fn leaf(
        &mut self,
        origin: Coord,
        mask: &[u64; 8],
        values: &[f32; 512],
    ) -> Result<(), cxx::Exception> {
        ffi::grid_put_leaf(self.grid.pin_mut(), &origin.0, mask, values)
    }

    pub fn tile(
        &mut self,
        origin: Coord,
        edge: i32,
        value: f32,
        active: bool,
    ) -> Result<(), cxx::Exception> {
        ffi::grid_put_tile(self.grid.pin_mut(), &origin.0, edge, value, active)
    }

    pub fn finish(self) -> UniquePtr<ffi::Grid> {
        self.grid
    }
}
