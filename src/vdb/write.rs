//! Writing of `.vdb` files of format 224, and of NanoVDB files, through a stream that reports a full disk.
//!
//! Grids are added by name and written at once. The content hash covers names, types, classes, voxel sizes,
//! backgrounds, topology and active values as they are stored, in the order of names; it depends neither on the order
//! of adding nor on the compression. A regular file appears under its name when it is complete, or not at all.

use super::attribute::Attribute;
use super::error::FileError;
use super::fog::Fog;
use super::hash::ContentHash;
use super::temporary_file::temporary;
use super::{LevelSet, Session, ffi};
use crate::band::{LeafFileError, StoreError};
use crate::progress::Cancelled;
use cxx::UniquePtr;
use std::fs::File;
use std::marker::PhantomData;
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};

/// Compression of values. Only [`Compression::None`] stores inactive values too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// No compression.
    None,
    /// zlib; slower than Blosc and no smaller.
    Zip,
    /// Blosc; OpenVDB's default.
    #[default]
    Blosc,
}

impl Compression {
    /// OpenVDB's flags: 1 zip, 2 active values only, 4 blosc.
    pub(super) fn flags(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Zip => 3,
            Self::Blosc => 6,
        }
    }
}

/// How values are stored.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum FloatBits {
    /// 32 bits.
    Single,
    /// 16 bits.
    Half,
}

/// A written file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrittenFile {
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Content hash over the grids, 64 hexadecimal digits; in the file as `druse.content_hash`.
    pub content_hash: String,
}

/// Writes a file of named grids with metadata.
///
/// `creator` is `druse/<version>` (a creator that begins with "Houdini" makes Blender turn the object). Tags are in the
/// metadata of the file and of every grid. Grids stay borrowed until the file is written.
///
/// ```no_run
/// # use druse::vdb::{LevelSet, Session, VdbWriter};
/// # fn f(solid: &LevelSet, session: Session<'_>) -> Result<(), druse::vdb::FileError> {
/// let path = std::path::Path::new("part.vdb");
/// let mut file = VdbWriter::new(path, session)?.scaled(0.001); // millimetres to metres
/// file.level_set("surface", solid)?;
/// file.tag("druse.unit", "m")?;
/// let written = file.write()?;
/// # Ok(()) }
/// ```
pub struct VdbWriter<'a> {
    pub(super) path: PathBuf,
    pub(super) session: Session<'a>,
    pub(super) file: UniquePtr<ffi::FileOut>,
    pub(super) scale: f64,
    pub(super) compression: Compression,
    pub(super) names: Vec<String>,
    tags: Vec<(String, String)>,
    grids: PhantomData<&'a LevelSet>,
}

impl<'a> VdbWriter<'a> {
    /// A file without grids; `path` is the target of [`VdbWriter::write`] and the name in errors.
    ///
    /// # Errors
    /// Only errors of OpenVDB.
    pub fn new(path: &Path, session: Session<'a>) -> Result<Self, FileError> {
        let file = ffi::initialize()
            .and_then(|()| ffi::file_new())
            .map_err(|e| failed(path, &e))?;
        let version = env!("CARGO_PKG_VERSION");
        Ok(Self {
            path: path.to_owned(),
            session,
            file,
            scale: 1.0,
            compression: Compression::default(),
            names: Vec::new(),
            tags: vec![
                ("creator".into(), format!("druse/{version}")),
                ("druse.version".into(), version.into()),
            ],
            grids: PhantomData,
        })
    }

    /// Multiplies all lengths by `factor` in the grids added afterwards: voxel size, values and background.
    /// Factors other than 1 copy the grid.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.scale = factor;
        self
    }

    /// Sets the compression.
    #[must_use]
    pub fn compression(mut self, compression: Compression) -> Self {
        self.compression = compression;
        self
    }

    /// Adds a level set; its usual name is `surface`.
    ///
    /// # Errors
    /// [`FileError::Name`] for an empty name, one with brackets or one used twice, or errors of OpenVDB (memory).
    pub fn level_set(&mut self, name: &str, level_set: &'a LevelSet) -> Result<(), FileError> {
        self.add(name, &level_set.grid, self.scale, FloatBits::Single)
    }

    /// Adds a level set stored as half floats: a fifth smaller, with distances rounded to 11 bits (up to 1.5
    /// thousandths of a voxel in a band of 3 voxels). The content hash covers the rounded values.
    ///
    /// # Errors
    /// As [`VdbWriter::level_set`].
    pub fn level_set_as_half(
        &mut self,
        name: &str,
        level_set: &'a LevelSet,
    ) -> Result<(), FileError> {
        self.add(name, &level_set.grid, self.scale, FloatBits::Half)
    }

    /// Adds a fog volume, optionally as half floats; its usual name is `density`. Scaling applies to the voxels,
    /// not to densities.
    ///
    /// # Errors
    /// As [`VdbWriter::level_set`].
    pub fn fog(&mut self, name: &str, fog: &'a Fog, half: bool) -> Result<(), FileError> {
        let bits = if half {
            FloatBits::Half
        } else {
            FloatBits::Single
        };
        self.add(name, &fog.grid, self.scale, bits)
    }

    /// Adds an attribute; scaling applies to the voxels, not to the values.
    ///
    /// # Errors
    /// As [`VdbWriter::level_set`].
    pub fn attribute(&mut self, name: &str, attribute: &'a Attribute) -> Result<(), FileError> {
        self.add(name, &attribute.grid, self.scale, FloatBits::Single)
    }

    /// Adds any grid of OpenVDB under a name. `scale` multiplies lengths.
    ///
    /// # Errors
    /// [`FileError::Name`] for an empty name, one used twice, or one with characters of numbered names; errors of
    /// OpenVDB.
    pub(super) fn add(
        &mut self,
        name: &str,
        grid: &ffi::Grid,
        scale: f64,
        bits: FloatBits,
    ) -> Result<(), FileError> {
        let refuse = |problem| FileError::Name {
            path: self.path.clone(),
            what: "grid",
            name: name.to_owned(),
            problem,
        };
        if name.is_empty() {
            return Err(refuse("is empty"));
        }
        // OpenVDB would read such names back as others.
        if name.contains(['[', ']', '\u{1e}']) {
            return Err(refuse(
                "contains a character that OpenVDB uses to number equal names",
            ));
        }
        if self.names.iter().any(|n| n == name) {
            return Err(refuse("is used twice"));
        }
        let host = self.session.host();
        let half = bits == FloatBits::Half;
        ffi::file_add(self.file.pin_mut(), grid, name, scale, half, &host)
            .map_err(|e| failed(&self.path, &e))?;
        self.names.push(name.to_owned());
        Ok(())
    }

    /// Adds a metadata string under a key, as in `druse.unit`; a later value replaces an earlier one.
    ///
    /// # Errors
    /// [`FileError::Name`] for a key that OpenVDB or this writer sets.
    pub fn tag(&mut self, key: &str, value: &str) -> Result<(), FileError> {
        const RESERVED_KEYS: [&str; 8] = [
            "druse.version",
            "name",
            "class",
            "creator",
            "is_saved_as_half_float",
            "is_local_space",
            "vector_type",
            "druse.content_hash",
        ];
        if key.is_empty() || key.starts_with("file_") || RESERVED_KEYS.contains(&key) {
            return Err(FileError::Name {
                path: self.path.clone(),
                what: "metadata key",
                name: key.to_owned(),
                problem: if key.is_empty() {
                    "is empty"
                } else {
                    "is reserved"
                },
            });
        }
        self.tags.retain(|(k, _)| k != key);
        self.tags.push((key.to_owned(), value.to_owned()));
        Ok(())
    }

    /// Writes the file under its path, where it appears complete or not at all. What is no regular file, such as a
    /// pipe, is written directly.
    ///
    /// # Errors
    /// [`FileError::Io`] with the system's error number (28: no space left), cancellation, or errors of OpenVDB.
    pub fn write(self) -> Result<WrittenFile, FileError> {
        let path = self.path.clone();
        let io = |e| FileError::io(&path, e);
        // The file that a link leads to is replaced, not the link.
        let target = path.canonicalize().unwrap_or_else(|_| path.clone());
        if target.metadata().is_ok_and(|m| !m.is_file()) {
            return self.write_to(&path);
        }
        let staged = temporary(&target).map_err(io)?;
        let written = self.write_to(staged.path())?;
        staged.as_file().sync_all().map_err(io)?;
        staged.persist(&target).map_err(|e| io(e.error))?;
        Ok(written)
    }

    /// Writes the file to a temporary path, which the caller renames; errors name the target.
    ///
    /// # Errors
    /// As [`VdbWriter::write`].
    pub fn write_to(self, staged: &Path) -> Result<WrittenFile, FileError> {
        let content_hash = self.content_hash().map_err(|e| failed(&self.path, &e))?;
        self.write_with(staged, content_hash, |file, descriptor, flags, host| {
            ffi::file_write(file, descriptor, flags, host).map_err(Into::into)
        })
    }

    /// Sets the tags and calls `write` with the file, a descriptor and the compression flags. `write` returns the
    /// system's error number, or 0. The file is at `staged`; `content_hash` becomes one of its tags.
    pub(super) fn write_with(
        mut self,
        staged: &Path,
        content_hash: String,
        write: impl FnOnce(&ffi::FileOut, i32, u32, &ffi::Host<'_>) -> Result<i32, WriteError>,
    ) -> Result<WrittenFile, FileError> {
        self.tags
            .push(("druse.content_hash".into(), content_hash.clone()));
        self.set_tags().map_err(|e| failed(&self.path, &e))?;
        let bytes = self.write_descriptor(staged, write)?;
        Ok(WrittenFile {
            bytes,
            content_hash,
        })
    }

    /// As [`VdbWriter::write_to`], as a NanoVDB file (version 32.4) with one segment a grid; it holds no
    /// tags and no half floats.
    ///
    /// # Errors
    /// As [`VdbWriter::write`].
    pub fn write_nano_to(self, staged: &Path) -> Result<WrittenFile, FileError> {
        let content_hash = self.content_hash().map_err(|e| failed(&self.path, &e))?;
        let bytes = self.write_descriptor(staged, |file, descriptor, flags, host| {
            ffi::file_write_nano(file, descriptor, flags, host).map_err(Into::into)
        })?;
        Ok(WrittenFile {
            bytes,
            content_hash,
        })
    }

    /// Creates a file and writes to its descriptor by `write`; returns its size.
    fn write_descriptor(
        &self,
        staged: &Path,
        write: impl FnOnce(&ffi::FileOut, i32, u32, &ffi::Host<'_>) -> Result<i32, WriteError>,
    ) -> Result<u64, FileError> {
        let io = |e| FileError::io(&self.path, e);
        let target = File::create(staged).map_err(io)?;
        let (descriptor, flags) = (target.as_raw_fd(), self.compression.flags());
        let error = write(&self.file, descriptor, flags, &self.session.host());
        if self.session.progress.cancelled() {
            return Err(Cancelled.into());
        }
        let error = error.map_err(|e| match e {
            WriteError::OpenVdb(e) => failed(&self.path, &e),
            WriteError::Store(e) => FileError::from(e),
        })?;
        if error != 0 {
            return Err(io(std::io::Error::from_raw_os_error(error)));
        }
        Ok(target.metadata().map_err(io)?.len())
    }

    fn content_hash(&self) -> Result<String, cxx::Exception> {
        let mut hash = ContentHash::default();
        let mut order: Vec<_> = (0..self.names.len()).collect();
        order.sort_by_key(|&index| &self.names[index]);
        for index in order {
            hash.add(&self.names[index], self.file.grid(index)?)?;
        }
        Ok(hash.finish())
    }

    fn set_tags(&mut self) -> Result<(), cxx::Exception> {
        for (key, value) in &self.tags {
            ffi::file_tag(self.file.pin_mut(), key, value)?;
            for index in 0..self.names.len() {
                ffi::file_tag_grid(self.file.pin_mut(), index, key, value)?;
            }
        }
        Ok(())
    }
}

/// Why the contents of a file could not be written.
pub(super) enum WriteError {
    OpenVdb(cxx::Exception),
    Store(StoreError),
}

impl From<cxx::Exception> for WriteError {
    fn from(e: cxx::Exception) -> Self {
        Self::OpenVdb(e)
    }
}

impl From<StoreError> for WriteError {
    fn from(e: StoreError) -> Self {
        Self::Store(e)
    }
}

impl From<LeafFileError> for WriteError {
    fn from(e: LeafFileError) -> Self {
        Self::Store(e.into())
    }
}

/// The error for an exception of OpenVDB while writing to `path`.
pub(super) fn failed(path: &Path, error: &cxx::Exception) -> FileError {
    FileError::OpenVdb {
        path: path.to_owned(),
        reason: super::error::reason(error),
    }
}

impl LevelSet {
    /// Writes the level set to a `.vdb` file under the name `surface`; [`VdbWriter`] writes several grids, tags
    /// and other units.
    ///
    /// # Errors
    /// As [`VdbWriter::write`].
    pub fn write(
        &self,
        path: impl AsRef<Path>,
        session: Session<'_>,
    ) -> Result<WrittenFile, FileError> {
        let mut file = VdbWriter::new(path.as_ref(), session)?;
        file.level_set("surface", self)?;
        file.write()
    }
}
