//! Grids of floats of any class: fog volumes, masks, grids of other programs.
//!
//! A grid is read, surveyed and described here; doubles become floats. For views a large level set is averaged. A
//! level set is made of it by its isosurface, by the foot of a fog's ramp, or in `foreign` by repairs. Grids whose
//! voxels are not axis-aligned cubes stay in index space until they are resampled.

use super::error::{FileError, VdbError};
use super::file::{CoarseReading, GridInfo, Loading};
use super::index_map::IndexMap;
use super::leaves::{Leaves, samples_of, values_of};
use super::refusal::Located;
use super::resample::on_cubes;
use super::value_survey::Survey;
use super::write::{Compression, FloatBits, VdbWriter};
use super::{LevelSet, Session, ffi};
use crate::frame::{Coord, Transform, Vec3, WorldPoint};
use crate::mesh::TriMesh;
use crate::mesher::Mesher;
use crate::progress::{Silent, Threads};
use cxx::UniquePtr;
use std::path::Path;

/// Metadata key of a coarse copy: how many voxels of the file are along an edge of its voxels.
const COARSE_STEP_KEY: &str = "druse.view_step";
/// Greatest such number.
const MAX_COARSE_STEP: u32 = 4096;
/// Size of the largest file that is read at once for a coarse copy, bytes.
const MAX_LOADED_BYTES: u64 = 256 << 20;
/// Voxels of a file's band across the surface, as they usually are.
const BAND_VOXELS: f64 = 6.0;
/// Voxels that an average reaches beyond the band.
const AVERAGE_MARGIN: f64 = 0.6;

/// Active voxels of a band of the usual width on the voxels of an average, which itself has a narrower one: `step`
/// voxels of the file along an edge.
fn full_band(active: u64, step: u32) -> u64 {
    let own = BAND_VOXELS / f64::from(step) + AVERAGE_MARGIN;
    (active as f64 * (BAND_VOXELS / own).max(1.0)) as u64
}

/// A grid of floats without the guarantees of a level set, as in files of other programs.
pub struct Volume {
    pub(super) grid: UniquePtr<ffi::Grid>,
    pub(super) name: String,
    /// Its description when it was read.
    pub(super) info: Box<GridInfo>,
    /// Statistics of its values.
    pub(super) survey: Survey,
}

impl Volume {
    /// Wraps a grid of floats, or of doubles, which become floats, without a survey of its values. A grid whose voxels
    /// are not axis-aligned cubes is kept in index space: edge 1, origin 0.
    ///
    /// # Errors
    /// [`FileError::NotALevelSet`] for values that are no floats or doubles, and for voxels without a volume.
    pub(super) fn wrap(
        path: &Path,
        name: &str,
        mut grid: UniquePtr<ffi::Grid>,
    ) -> Result<Self, FileError> {
        let damaged = |e: cxx::Exception| FileError::damaged(path, &e);
        let mut info = GridInfo::from_facts(ffi::grid_facts(&grid).map_err(damaged)?);
        let refuse = |found: String, expected: &str, hint: String| FileError::NotALevelSet {
            path: path.to_owned(),
            grid: name.to_owned(),
            found,
            expected: expected.to_owned(),
            hint,
        };
        if info.grid_type == super::file::DOUBLE_GRID_TYPE {
            grid = ffi::grid_as_floats(&grid).map_err(damaged)?;
            info.active_tiles = ffi::grid_facts(&grid).map_err(damaged)?.active_tiles;
            super::file::FLOAT_GRID_TYPE.clone_into(&mut info.grid_type);
        }
        if info.grid_type != super::file::FLOAT_GRID_TYPE {
            let (what, hint) = other_type(&info.grid_type);
            return Err(refuse(
                format!("values that are {what} (the type {})", info.grid_type),
                "floats or doubles",
                hint.to_owned(),
            ));
        }
        if let Some(map) = &info.map {
            let [low, high] = info.bbox.unwrap_or_default();
            let corner = |v: [i32; 3]| Vec3::from(v.map(f64::from));
            // A map that folds or flattens voxels has no inverse.
            if !map.is_regular(corner(low), corner(high)) {
                return Err(refuse(
                    format!("{} without a volume", info.shape()),
                    "voxels with a volume",
                    "write the grid again with another transform".to_owned(),
                ));
            }
            ffi::grid_set_transform(grid.pin_mut(), 1.0, &[0.0; 3]).map_err(damaged)?;
        } else if Transform::new(info.voxel_size[0]).is_none() {
            return Err(refuse(
                format!("voxels of {}", info.voxel_size[0]),
                "voxels with a volume",
                String::new(),
            ));
        }
        Ok(Self {
            grid,
            name: name.to_owned(),
            info: Box::new(info),
            survey: Survey::default(),
        })
    }

    fn survey_values(&mut self) -> Result<(), cxx::Exception> {
        self.survey = Survey::of(&self.grid, self.info.bbox)?;
        self.info.values = self.survey.range;
        self.info.not_finite = self.survey.not_finite;
        Ok(())
    }

    /// Edge of the voxels and world position of voxel (0, 0, 0) of the grid; 1 and 0 in index space.
    pub(super) fn frame(&self) -> Result<(Transform, Vec3), VdbError> {
        let edge = self.own_edge();
        let transform = Transform::new(edge).ok_or(VdbError::Parameter {
            name: "voxel size",
            value: edge,
            expected: "a positive, finite number",
        })?;
        let origin = if self.info.cubic {
            Vec3::from(self.info.origin)
        } else {
            Vec3::zeros()
        };
        Ok((transform, origin))
    }

    /// Edge of the voxels of the grid; 1 in index space.
    pub(super) fn own_edge(&self) -> f64 {
        if self.info.cubic {
            self.info.voxel_size[0]
        } else {
            1.0
        }
    }

    /// Requires axis-aligned cubic voxels and finite values, as masks and colours need.
    ///
    /// # Errors
    /// [`FileError::NotALevelSet`]; `path` is the name in errors.
    pub fn require_cubes(self, path: &Path) -> Result<Self, FileError> {
        if !self.info.cubic {
            return Err(self.refuse_voxels(path));
        }
        match self.not_finite() {
            Some(refusal) => Err(Located {
                path,
                grid: &self.name,
            }
            .refuse(refusal)),
            None => Ok(self),
        }
    }

    /// Multiplies lengths by `factor`: voxels and their positions, not values.
    ///
    /// # Errors
    /// Only errors of OpenVDB.
    pub fn rescaled(mut self, factor: f64) -> Result<Self, VdbError> {
        self.info.origin = self.info.origin.map(|c| c * factor);
        self.info.voxel_size = self.info.voxel_size.map(|h| h * factor);
        let (h, origin) = (self.info.voxel_size[0], self.info.origin);
        ffi::grid_set_transform(self.grid.pin_mut(), h, &origin)
            .map_err(|e| VdbError::plain("scaling", &e))?;
        Ok(self)
    }

    /// The name in the file.
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

    /// The leaves, in order of origin.
    ///
    /// # Errors
    /// Only errors of OpenVDB (memory).
    pub fn leaves(&self) -> Result<Leaves<'_>, VdbError> {
        Leaves::of_grid(&self.grid).map_err(|e| VdbError::plain("listing leaves", &e))
    }

    /// Values at world points, trilinear between voxels; the background outside.
    ///
    /// # Errors
    /// Only errors of OpenVDB.
    pub fn samples(&self, points: &[WorldPoint]) -> Result<Vec<f32>, VdbError> {
        samples_of(&self.grid, points)
    }

    /// The level set of the isosurface at `value`. Inside are the values above it if the background is below it, or
    /// equal to it in a fog volume; else the values below it. Distances are measured from the mesh of the isosurface,
    /// which is linear between voxels.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for a value that is not finite or a half width (voxels) below 1, [`VdbError::Open`] if
    /// the values end at the surface, which is then not closed, [`VdbError::Cancelled`], or errors of OpenVDB.
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
        let outside = self.info.background.unwrap_or(0.0);
        // The background lies outside: the solid is on the other side of the value. Where it equals the
        // value, a fog is solid above it.
        let is_above = if outside == value {
            self.info.class == "fog volume"
        } else {
            outside < value
        };
        let sign = if is_above { -1.0 } else { 1.0 };
        let failed = |e| VdbError::of("extracting an isosurface", session, &e);
        let mut grid = ffi::grid_copy(&self.grid).map_err(failed)?;
        // phi = sign (v - value), negative inside.
        let (factor, shift) = (sign as f32, (-sign * value) as f32);
        ffi::grid_scale_values(grid.pin_mut(), factor, shift, &session.host()).map_err(failed)?;
        self.measured(grid, half_width, session)
    }

    /// The level set of a fog whose density rises from 0 at the surface to 1 over `ramp` voxels. Beyond the surface the
    /// density is taken to fall on.
    ///
    /// # Errors
    /// As [`Volume::isosurface`].
    pub fn foot_of_ramp(
        &self,
        ramp: f64,
        half_width: f64,
        session: Session<'_>,
    ) -> Result<LevelSet, VdbError> {
        let failed = |e| VdbError::of("reading a fog", session, &e);
        let grid = ffi::grid_unfogged(&self.grid, ramp, &session.host()).map_err(failed)?;
        self.measured(grid, half_width, session)
    }

    /// The level set of the surface where the values of a grid on this volume's voxels change their sign. Half width in
    /// voxels. The grid's values need no distances: only their signs and zeros count.
    fn measured(
        &self,
        mut grid: UniquePtr<ffi::Grid>,
        half_width: f64,
        session: Session<'_>,
    ) -> Result<LevelSet, VdbError> {
        let (transform, origin) = self.frame()?;
        ffi::grid_set_transform(grid.pin_mut(), transform.voxel_size(), &[0.0; 3])
            .map_err(|e| VdbError::of("extracting an isosurface", session, &e))?;
        let values = LevelSet {
            grid,
            transform,
            origin: Vec3::zeros(),
            // The narrowest band: the mesher then uses the neighbours of active voxels, too.
            half_width: 1.0,
        };
        let identity = IndexMap::axis_aligned([1.0; 3], [0.0; 3]);
        let mut solid = on_cubes(
            &values,
            &identity,
            transform.voxel_size(),
            half_width,
            session,
        )?;
        if origin != Vec3::zeros() {
            solid.set_origin(origin)?;
        }
        Ok(solid)
    }

    /// A level set of at most `max_voxels` active voxels for views: means over cubes of voxels, 2, 4, 8, ... along
    /// each edge. Thinner walls than such a cube vanish. Other grids, and those of fewer voxels, stay as they are. This
    /// volume has `step` voxels of the file's level set along an edge of its voxels; its values are freed on the way.
    ///
    /// # Errors
    /// Only errors of OpenVDB; `path` is the name in them.
    pub(super) fn coarse(
        mut self,
        path: &Path,
        max_voxels: u64,
        mut step: u32,
        is_averaged: bool,
    ) -> Result<Self, FileError> {
        let with_step = |mut volume: Self, step: u32| {
            if step > 1 {
                let entry = (COARSE_STEP_KEY.to_owned(), step.to_string());
                volume.info.metadata.push(entry);
            }
            Ok(volume)
        };
        let mut active = self.info.active_voxels;
        if is_averaged {
            active = full_band(active, step);
        }
        if self.info.class != "level set" || !self.info.cubic || active <= max_voxels {
            return with_step(self, step);
        }
        let failed = |e: cxx::Exception| FileError::damaged(path, &e);
        while active > max_voxels && step < MAX_COARSE_STEP {
            // Halving the resolution leaves about a fifth of the active voxels, halving it again a sixth of these.
            let by = match active / max_voxels.max(1) {
                0..5 => 2,
                5..30 => 4,
                _ => 8,
            };
            self.grid = ffi::grid_coarse(self.grid.pin_mut(), by).map_err(failed)?;
            step *= by as u32;
            active = full_band(ffi::grid_active_voxels(&self.grid).map_err(failed)?, step);
        }
        let facts = GridInfo::from_facts(ffi::grid_facts(&self.grid).map_err(failed)?);
        let metadata = std::mem::take(&mut self.info.metadata);
        *self.info = GridInfo {
            name: self.name.clone(),
            metadata,
            ..facts
        };
        with_step(self, step)
    }

    /// Voxels of the file along an edge of a voxel: more than 1 for a coarse copy.
    pub fn coarse_step(&self) -> u32 {
        self.meta(COARSE_STEP_KEY)
            .and_then(|s| s.parse().ok())
            .unwrap_or(1)
    }

    /// Active voxels; for an average those of a band of the usual width.
    pub fn band_voxels(&self) -> u64 {
        match self.coarse_step() {
            step if self.is_averaged() => full_band(self.info.active_voxels, step),
            _ => self.info.active_voxels,
        }
    }

    /// The triangles of a coarse copy.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], [`VdbError::Mesher`], or errors of OpenVDB.
    pub fn coarse_mesh(&self, session: Session<'_>) -> Result<TriMesh, VdbError> {
        let (transform, origin) = self.frame()?;
        let leaves = self.leaves()?;
        let values = super::mesh::leaf_values(&leaves);
        let mesher = Mesher::new(transform).with_origin(origin).in_double();
        Ok(session
            .threads
            .install(|| mesher.mesh(&values, session.progress))?)
    }

    /// Values at voxels.
    ///
    /// # Errors
    /// Only errors of OpenVDB.
    pub fn values(&self, voxels: &[Coord]) -> Result<Vec<f32>, VdbError> {
        values_of(&self.grid, voxels)
    }

    /// Reads a grid of floats in this process; only for trusted files. Without a name: `surface`, else the only
    /// level set, else the only grid of floats or doubles.
    ///
    /// # Errors
    /// [`FileError::Io`], [`FileError::Damaged`], [`FileError::NoGrid`], or
    /// [`FileError::NotALevelSet`] for other types than floats and doubles.
    pub fn read(path: &Path, name: Option<&str>) -> Result<Self, FileError> {
        Self::open(path, name, None)?.surveyed(path)
    }

    /// With a survey of all values.
    pub(super) fn surveyed(mut self, path: &Path) -> Result<Self, FileError> {
        self.survey_values()
            .map_err(|e| FileError::damaged(path, &e))?;
        Ok(self)
    }

    /// Reads a grid of floats as [`Volume::read`] does, without a survey of its values; with `reading`, a level set of
    /// more voxels as a coarse copy.
    ///
    /// # Errors
    /// As [`Volume::read`].
    pub(super) fn open(
        path: &Path,
        name: Option<&str>,
        reading: Option<CoarseReading>,
    ) -> Result<Self, FileError> {
        let Some(reading) = reading else {
            let (name, grid) = super::file::pick(path, name, Loading::AtOnce)?;
            return Self::wrap(path, &name, grid);
        };
        let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
        let loading = if bytes > MAX_LOADED_BYTES {
            Loading::Delayed
        } else {
            Loading::AtOnce
        };
        let found = super::file::pick_for_view(path, name, reading, loading)?;
        Self::wrap(path, &found.name, found.grid)?.coarse(
            path,
            reading.max_voxels,
            found.step,
            found.is_averaged,
        )
    }

    /// Whether this is a coarse copy that no grid of its file holds.
    pub(super) fn is_averaged(&self) -> bool {
        self.coarse_step() > 1 && !self.is_own_copy()
    }

    /// Whether the file itself has this coarse copy.
    fn is_own_copy(&self) -> bool {
        self.name.starts_with("surface_lod_")
    }

    /// Writes the grid with its tags as a `.vdb`.
    ///
    /// # Errors
    /// [`FileError::Io`] with the system's error number, or errors of OpenVDB.
    pub(super) fn write_coarse_copy(&self, path: &Path) -> Result<(), FileError> {
        let threads = Threads::new(1).map_err(|e| FileError::io(path, std::io::Error::other(e)))?;
        let session = Session::new(&threads, &Silent);
        let mut file = VdbWriter::new(path, session)?.compression(Compression::None);
        file.add(&self.name, &self.grid, 1.0, FloatBits::Single)?;
        for (key, value) in &self.info.metadata {
            if key == COARSE_STEP_KEY || key == "druse.unit" {
                file.tag(key, value)?;
            }
        }
        file.write().map(|_| ())
    }

    /// Reads what [`Volume::write_coarse_copy`] wrote, of the file `path`, which is the name in errors.
    ///
    /// # Errors
    /// As [`Volume::read`].
    pub(super) fn read_coarse_copy(copy: &Path, path: &Path) -> Result<Self, FileError> {
        let (name, grid) = super::file::pick(copy, None, Loading::AtOnce)?;
        Self::wrap(path, &name, grid)?.surveyed(path)
    }
}

/// What the values of a type other than floats and doubles are, and the remedy. `name` is OpenVDB's, as in
/// `Tree_bool_5_4_3`.
fn other_type(name: &str) -> (&'static str, &'static str) {
    let name = name.strip_prefix("Tree_").unwrap_or(name);
    let kind = name.split('_').next().unwrap_or(name);
    match kind {
        "bool" | "mask" => (
            "on or off only",
            "make a level set or fog of floats of it (in OpenVDB topologyToLevelSet, in Houdini Convert VDB)",
        ),
        "int32" | "int64" => (
            "integers",
            "make floats of them (in Houdini Convert VDB) and give the value on the surface with --value",
        ),
        "vec3s" | "vec3d" | "vec3i" | "vec3h" => (
            "vectors",
            "vectors bound no solid: choose another grid with --grid, or make floats of a component or of its length",
        ),
        "ptdataidx32" | "ptidx32" => (
            "points",
            "points bound no solid by themselves: make a level set of them first (in OpenVDB particlesToLevelSet, vdb_tool \
             -points2ls)",
        ),
        _ => (
            "no floats",
            "make floats of them, or choose another grid with --grid",
        ),
    }
}
