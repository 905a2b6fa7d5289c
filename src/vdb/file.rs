//! Reading of `.vdb` files: their contents, and level sets.
//!
//! Files are read completely and at once, but for large ones that are viewed: OpenVDB's delayed loading of a damaged
//! file crashes, hangs or exhausts memory. A child process reads untrusted ones, see [`subprocess`](super::subprocess).

use super::error::FileError;
use super::foreign::GridReading;
use super::hash::ContentHash;
use super::index_map::IndexMap;
use super::volume::Volume;
use super::{LevelSet, Session, ffi};
use cxx::UniquePtr;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

/// One grid of a file, of any type.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridInfo {
    /// Name; equal names are numbered, as in `surface[1]`.
    pub name: String,
    /// OpenVDB's type, as in `Tree_float_5_4_3`.
    #[serde(rename = "type")]
    pub grid_type: String,
    /// `level set`, `fog volume`, `staggered` or `unknown`.
    pub class: String,
    /// Edges of a voxel, in the file's unit.
    pub voxel_size: [f64; 3],
    /// World position of voxel (0, 0, 0), in the file's unit.
    pub origin: [f64; 3],
    /// Whether voxels are axis-aligned cubes.
    pub cubic: bool,
    /// The map from index space to the world, for other voxels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<IndexMap>,
    /// Least and greatest active value; only for grids of floats in files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub values: Option<[f32; 2]>,
    /// Number of values that are NaN or infinite; only for grids of floats in files.
    #[serde(default)]
    pub not_finite: u64,
    /// Defects of a level set in a file, and remedies.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Background value, for grids of numbers.
    pub background: Option<f64>,
    /// Active voxels, including those of tiles.
    pub active_voxels: u64,
    /// Active tiles (grids of floats only).
    pub active_tiles: u64,
    /// Leaves of 8^3 voxels.
    pub leaves: u64,
    /// Memory of the tree, bytes.
    pub bytes: u64,
    /// First and last active voxel on each axis.
    pub bbox: Option<[[i32; 3]; 2]>,
    /// Whether floats are stored as half floats.
    pub half: bool,
    /// Compression of the values in the file.
    pub compression: Option<String>,
    /// All metadata, as text.
    pub metadata: Vec<(String, String)>,
}

impl GridInfo {
    /// The description of a grid from what OpenVDB reports of it. Values and notes are empty: they need the grid's
    /// contents.
    pub(super) fn from_facts(facts: ffi::GridFacts) -> Self {
        let metadata: Vec<_> = facts
            .metadata
            .into_iter()
            .map(|m| (m.key, m.value))
            .collect();
        // Axis-aligned cubes are described by edge and origin alone.
        let map = (!facts.plain_transform).then(|| IndexMap::from_corners(&facts.corners));
        Self {
            name: facts.name,
            grid_type: facts.grid_type,
            class: facts.class_name,
            voxel_size: facts.voxel_size,
            origin: facts.origin,
            cubic: facts.plain_transform,
            map,
            values: None,
            not_finite: 0,
            notes: Vec::new(),
            background: (!facts.background.is_nan()).then_some(facts.background),
            active_voxels: facts.active_voxels,
            active_tiles: facts.active_tiles,
            leaves: facts.leaves,
            bytes: facts.bytes,
            bbox: (!facts.empty).then_some([facts.box_min, facts.box_max]),
            half: facts.half,
            compression: lookup(&metadata, "file_compression"),
            metadata,
        }
    }

    /// A metadata value.
    pub fn meta(&self, key: &str) -> Option<String> {
        lookup(&self.metadata, key)
    }
}

/// The description of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FileInfo {
    /// File format: 224 for OpenVDB 4 to 12.
    pub version: u32,
    /// Version of the library and format that wrote it, as in `10.0/224`.
    #[serde(rename = "library")]
    pub writer: String,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Metadata of the file itself.
    pub metadata: Vec<(String, String)>,
    /// Its grids, in order of name.
    pub grids: Vec<GridInfo>,
    /// Content hash over all grids; absent if a grid holds neither floats nor vectors of floats.
    pub content_hash: Option<String>,
}

impl FileInfo {
    /// A metadata value of the file itself.
    pub fn meta(&self, key: &str) -> Option<String> {
        lookup(&self.metadata, key)
    }
}

fn lookup(metadata: &[(String, String)], key: &str) -> Option<String> {
    metadata
        .iter()
        .find(|(k, _)| k == key)
        .map(|(_, v)| v.clone())
}

/// Reads a whole file and describes it, one grid in memory at a time. The content hash is that of the writer, if all
/// grids hold floats or vectors of floats.
///
/// # Errors
/// [`FileError::Io`] for a missing file, [`FileError::Damaged`] for an incomplete one, [`FileError::NotALevelSet`] for
/// floats on voxels without a volume.
pub fn info(path: &Path) -> Result<FileInfo, FileError> {
    let damaged = |e: cxx::Exception| FileError::damaged(path, &e);
    let mut file = open(path, Loading::AtOnce)?;
    let names = file.names().map_err(damaged)?;
    let mut hash = Some(ContentHash::default());
    let mut grids = Vec::with_capacity(names.len());
    let mut order: Vec<_> = names.iter().enumerate().collect();
    // The content hash takes the grids in order of name, as the writer does.
    order.sort_by_key(|&(_, name)| name);
    for (index, name) in order {
        let grid = ffi::file_read(file.pin_mut(), index).map_err(damaged)?;
        let facts = ffi::grid_facts(&grid).map_err(damaged)?;
        if facts.grid_type == FLOAT_GRID_TYPE || facts.grid_type == VECTOR_GRID_TYPE {
            if let Some(hash) = &mut hash {
                hash.add(name, &grid).map_err(damaged)?;
            }
        } else {
            // A grid of another type has no content hash, and so the file has none.
            hash = None;
        }
        let mut info = GridInfo {
            name: name.clone(),
            ..GridInfo::from_facts(facts)
        };
        if info.grid_type == FLOAT_GRID_TYPE {
            let volume = Volume::wrap(path, name, grid)?.surveyed(path)?;
            info.values = volume.info.values;
            info.not_finite = volume.info.not_finite;
            info.notes = volume.notes();
        }
        grids.push(info);
    }
    let metadata = file.metadata().map_err(damaged)?;
    Ok(FileInfo {
        version: file.version(),
        writer: file.writer().map_err(damaged)?,
        bytes: std::fs::metadata(path)
            .map_err(|e| FileError::io(path, e))?
            .len(),
        metadata: metadata.into_iter().map(|m| (m.key, m.value)).collect(),
        grids,
        content_hash: hash.map(ContentHash::finish),
    })
}

/// OpenVDB's names of the types of grids that are read or hashed.
pub(super) const FLOAT_GRID_TYPE: &str = "Tree_float_5_4_3";
const VECTOR_GRID_TYPE: &str = "Tree_vec3s_5_4_3";
pub(super) const DOUBLE_GRID_TYPE: &str = "Tree_double_5_4_3";

/// Reads a level set. Without a name: `surface`, else the only level set, else the only grid of floats or doubles.
///
/// # Errors
/// [`FileError::Io`], [`FileError::Damaged`], [`FileError::NoGrid`], [`FileError::NotALevelSet`] for a grid without
/// the guarantees of a [`LevelSet`] or of the class "fog volume", cancellation, or errors of OpenVDB.
pub fn read(path: &Path, name: Option<&str>, session: Session<'_>) -> Result<LevelSet, FileError> {
    let found = Volume::read(path, name)?;
    if found.info().class == "fog volume" {
        return Err(FileError::NotALevelSet {
            path: path.to_owned(),
            grid: found.name().to_owned(),
            found: "the class fog volume".into(),
            expected: "the class level set".into(),
            hint: String::new(),
        });
    }
    Ok(found.solid(path, &GridReading::default(), session)?.solid)
}

/// When the values of a grid are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Loading {
    /// With the grid.
    AtOnce,
    /// Where they are used; the file must stay.
    Delayed,
}

/// Reads one grid of any type. Without a name: `surface`, else the only level set, else the only grid of floats or
/// doubles, else the only grid; in a .nvdb file `surface` or the only grid. Returns its name and the grid.
///
/// # Errors
/// [`FileError::NoGrid`] with the grids that the file has, and those of reading.
pub(super) fn pick(
    path: &Path,
    name: Option<&str>,
    loading: Loading,
) -> Result<(String, UniquePtr<ffi::Grid>), FileError> {
    if path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("nvdb"))
    {
        return pick_nano(path, name);
    }
    let damaged = |e: cxx::Exception| FileError::damaged(path, &e);
    let mut file = open(path, loading)?;
    let names = file.names().map_err(damaged)?;
    let no_grid = |present| FileError::NoGrid {
        path: path.to_owned(),
        requested: name.unwrap_or("surface").to_owned(),
        present,
    };
    if let Some(index) = names.iter().position(|n| n == name.unwrap_or("surface")) {
        let grid = ffi::file_read(file.pin_mut(), index).map_err(damaged)?;
        return Ok((names[index].clone(), grid));
    }
    let (mut surfaces, mut volumes, mut present) = (Vec::new(), Vec::new(), Vec::new());
    // Without a grid of that name all are read, to find the only one, or to name them in the error.
    for (index, name) in names.iter().enumerate() {
        let grid = ffi::file_read(file.pin_mut(), index).map_err(damaged)?;
        let facts = ffi::grid_facts(&grid).map_err(damaged)?;
        let (kind, class) = (&facts.grid_type, &facts.class_name);
        present.push(format!("{name} ({kind}, {class})"));
        if class == "level set" && (kind == FLOAT_GRID_TYPE || kind == DOUBLE_GRID_TYPE) {
            surfaces.push(index);
        } else if kind == FLOAT_GRID_TYPE || kind == DOUBLE_GRID_TYPE {
            volumes.push(index);
        }
    }
    if name.is_some() {
        return Err(no_grid(present));
    }
    let index = match (&surfaces[..], &volumes[..]) {
        ([index], _) | ([], [index]) => *index,
        // Its other type is reported as the error.
        _ if names.len() == 1 => 0,
        _ => return Err(no_grid(present)),
    };
    let grid = ffi::file_read(file.pin_mut(), index).map_err(damaged)?;
    Ok((names[index].clone(), grid))
}

/// Greatest number of coarser copies of a level set, `surface_lod_1` and so on; each has twice the edge of the last.
const MAX_LOD: u32 = 8;

/// How a level set is read that may be too large for a view.
#[derive(Clone, Copy, Debug)]
pub struct CoarseReading {
    /// Active voxels above which it is read as a coarse copy.
    pub max_voxels: u64,
    /// Threads that inflate leaves, at most 8; 0 for one per core.
    pub threads: usize,
}

/// A level set for views, or a copy of it.
pub(super) struct ViewGrid {
    pub name: String,
    pub grid: UniquePtr<ffi::Grid>,
    /// Voxels of the level set along an edge of its voxels.
    pub step: u32,
    /// Whether its values are means, with a narrower band.
    pub is_averaged: bool,
}

impl ViewGrid {
    fn new(name: String, grid: UniquePtr<ffi::Grid>, step: u32) -> Self {
        Self {
            name,
            grid,
            step,
            is_averaged: false,
        }
    }
}

/// As [`pick`], for views: instead of a level set `surface` of more than `max_voxels`, the finest copy that the
/// file has of it (`surface_lod_1`, ...) with fewer, else its coarsest; without copies an average. With delayed
/// loading, the level set itself is read only without copies. Other names and .nvdb files give the grid itself.
pub(super) fn pick_for_view(
    path: &Path,
    name: Option<&str>,
    reading: CoarseReading,
    loading: Loading,
) -> Result<ViewGrid, FileError> {
    let level_set = || pick(path, name, loading).map(|(name, grid)| ViewGrid::new(name, grid, 1));
    let is_nano = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("nvdb"));
    if is_nano || name.is_some_and(|n| n != "surface") {
        return level_set();
    }
    let damaged = |e: cxx::Exception| FileError::damaged(path, &e);
    let mut file = open(path, loading)?;
    let names = file.names().map_err(damaged)?;
    let index_of = |level: u32| {
        let name = format!("surface_lod_{level}");
        names.iter().position(|n| *n == name)
    };
    // Without coarser copies a mean over cubes of voxels is made while the grid is read.
    if index_of(1).is_none() {
        let own_name = name.unwrap_or("surface");
        if names.iter().any(|n| n == own_name) {
            let (bytes, mut step) = (path.as_os_str().as_bytes(), 1);
            let CoarseReading {
                max_voxels,
                threads,
            } = reading;
            let grid = ffi::file_coarse(bytes, own_name, max_voxels, threads, &mut step)
                .map_err(damaged)?;
            // None for what is no level set, or small enough to be read as it is.
            if !grid.is_null() {
                return Ok(ViewGrid {
                    is_averaged: true,
                    ..ViewGrid::new(own_name.to_owned(), grid, step.unsigned_abs())
                });
            }
        }
        return level_set();
    }
    if loading == Loading::AtOnce {
        let found = level_set()?;
        if ffi::grid_active_voxels(&found.grid).map_err(damaged)? <= reading.max_voxels {
            return Ok(found);
        }
    }
    let mut best = None;
    // From the coarsest copy to finer ones, up to the first that is too large.
    for (level, index) in (1..=MAX_LOD).rev().filter_map(|l| Some((l, index_of(l)?))) {
        let grid = ffi::file_read(file.pin_mut(), index).map_err(damaged)?;
        let is_small = ffi::grid_active_voxels(&grid).map_err(damaged)? <= reading.max_voxels;
        if !is_small && best.is_some() {
            break;
        }
        best = Some(ViewGrid::new(names[index].clone(), grid, 1 << level));
    }
    best.map_or_else(level_set, Ok)
}

/// As [`pick`], from a .nvdb file.
fn pick_nano(path: &Path, name: Option<&str>) -> Result<(String, UniquePtr<ffi::Grid>), FileError> {
    let damaged = |e: cxx::Exception| FileError::damaged(path, &e);
    File::open(path).map_err(|e| FileError::io(path, e))?;
    let bytes = path.as_os_str().as_bytes();
    ffi::initialize().map_err(damaged)?;
    let names = ffi::nano_names(bytes).map_err(damaged)?;
    let index = names.iter().position(|n| n == name.unwrap_or("surface"));
    let index = index.or((name.is_none() && names.len() == 1).then_some(0));
    let Some(index) = index else {
        return Err(FileError::NoGrid {
            path: path.to_owned(),
            requested: name.unwrap_or("surface").to_owned(),
            present: names,
        });
    };
    let grid = ffi::nano_read(bytes, index).map_err(damaged)?;
    Ok((names[index].clone(), grid))
}

/// Opens a file after a check of its first bytes: OpenVDB's messages about them are cryptic. Formats above 224, the
/// newest that this OpenVDB reads, are refused.
fn open(path: &Path, loading: Loading) -> Result<UniquePtr<ffi::FileIn>, FileError> {
    let io = |e| FileError::io(path, e);
    let mut head = Vec::new();
    let file = File::open(path).map_err(io)?;
    if file.metadata().map_err(io)?.is_dir() {
        return Err(io(std::io::ErrorKind::IsADirectory.into()));
    }
    file.take(12).read_to_end(&mut head).map_err(io)?;
    let damaged = |reason: String| FileError::Damaged {
        path: path.to_owned(),
        reason,
    };
    // The magic number 0x56444220 as i64, then the format as u32.
    if !head.starts_with(&[0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0]) {
        return Err(damaged(
            "the first bytes are not those of a .vdb file".into(),
        ));
    }
    let Some(&version) = head.get(8..).and_then(<[u8]>::first_chunk) else {
        return Err(damaged(format!("it ends after {} bytes", head.len())));
    };
    let version = u32::from_le_bytes(version);
    if version > 224 {
        return Err(damaged(format!("it is of format {version}")));
    }
    let opened = ffi::initialize()
        .and_then(|()| ffi::file_open(path.as_os_str().as_bytes(), loading == Loading::Delayed));
    opened.map_err(|e| FileError::damaged(path, &e))
}

impl LevelSet {
    /// Reads a level set; see [`read`].
    ///
    /// # Errors
    /// As [`read`].
    pub fn read(path: &Path, name: Option<&str>, session: Session<'_>) -> Result<Self, FileError> {
        read(path, name, session)
    }
}
