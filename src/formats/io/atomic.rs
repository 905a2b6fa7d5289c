//! Atomic output files: they appear complete or not at all.
//!
//! A file is written under a hidden temporary name beside its target (symbolic links resolved first), synced
//! and renamed; then the directory is synced. Dropping it before [`AtomicFile::commit`] removes it; what a killed
//! process left is removed by the next that writes into the folder. A target that exists and is no regular file (a
//! pipe, `/dev/stdout`) is written directly, or refused if the format must seek.
//!
//! ```
//! # extern crate druse_formats as druse;
//! use std::io::Write;
//! let directory = tempfile::tempdir().unwrap();
//! let path = directory.path().join("note.txt");
//! let mut file = druse::io::atomic::AtomicFile::create(&path).unwrap();
//! file.write_all(b"whole").unwrap();
//! assert!(!path.exists());
//! assert_eq!(file.commit().unwrap(), 5);
//! ```

use super::error::WriteError;
use super::partial;
use super::partial::folder_of;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::{fs, io};
use tempfile::{NamedTempFile, PersistError};

/// The buffer of a file: large enough that system calls cost little beside the copying.
pub(super) const BUFFER_BYTES: usize = 256 << 10;

/// The destination of the bytes until the file is committed: a temporary file with the path of its target, or the
/// target itself.
enum Sink {
    Staged(BufWriter<NamedTempFile>, PathBuf),
    Direct(BufWriter<File>),
}

/// An output file: write to it as a [`Write`] (and [`Seek`]), then commit.
pub struct AtomicFile {
    /// The path as the user named it, for messages.
    shown: PathBuf,
    sink: Sink,
    /// The expected size of the whole file, for messages.
    needed: Option<u64>,
    /// Bytes that have been accepted, those in the buffer included.
    written: u64,
    /// Where the next bytes go: after a fault, the answer to seeks.
    position: u64,
    /// The first error of writing. What follows is dropped: writers that end their format when they are dropped (zip)
    /// would meet, and print, further errors.
    fault: Option<(io::ErrorKind, String)>,
}

impl AtomicFile {
    /// Creates a file for sequential writing.
    ///
    /// # Errors
    /// [`WriteError::Create`] when the directory is missing or not writable, or the target is a directory or has no
    /// readable name; [`WriteError::Io`] for a full disk.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, WriteError> {
        let shown = path.as_ref().to_owned();
        let sink = match Target::of(&shown)? {
            Target::Regular(target) => {
                let file = stage(&shown, &target)?;
                Sink::Staged(BufWriter::with_capacity(BUFFER_BYTES, file), target)
            }
            Target::Special => {
                let file = OpenOptions::new().write(true).open(&shown);
                let file = file.map_err(|e| refused(&shown, e.to_string()))?;
                Sink::Direct(BufWriter::with_capacity(BUFFER_BYTES, file))
            }
        };
        Ok(Self {
            shown,
            sink,
            needed: None,
            written: 0,
            position: 0,
            fault: None,
        })
    }

    /// Creates a file whose format must seek.
    ///
    /// # Errors
    /// As [`AtomicFile::create`], and when the target is not a regular file.
    pub fn create_seekable(path: impl AsRef<Path>) -> Result<Self, WriteError> {
        let file = Self::create(path)?;
        match file.sink {
            Sink::Staged(..) => Ok(file),
            Sink::Direct(_) => Err(not_seekable(&file.shown)),
        }
    }

    /// Sets the expected size of the whole file, for the error message when the disk is full.
    #[must_use]
    pub fn expecting(mut self, bytes: u64) -> Self {
        self.needed = Some(bytes);
        self
    }

    /// Converts an error during writing into one with the file and the number of bytes written; the file itself stays
    /// as it is.
    pub fn failed(&self, error: io::Error) -> WriteError {
        WriteError::Io {
            path: self.shown.clone(),
            written: self.stored(),
            needed: self.needed,
            error: plain(error),
        }
    }

    /// The bytes that the system has taken, without those that still wait in memory.
    fn stored(&self) -> u64 {
        match &self.sink {
            Sink::Staged(file, _) => file.get_ref().as_file().metadata().map_or(0, |m| m.len()),
            Sink::Direct(file) => self.written - file.buffer().len() as u64,
        }
    }

    /// Keeps the error of a result; with it all further writing is dropped.
    fn noted<T>(&mut self, result: io::Result<T>) -> io::Result<T> {
        result.map_err(|e| {
            let e = plain(e);
            // A write that a signal interrupts is repeated.
            if e.kind() != io::ErrorKind::Interrupted {
                self.fault = Some((e.kind(), e.to_string()));
            }
            e
        })
    }

    /// Completes the file under its name; returns its size in bytes.
    ///
    /// # Errors
    /// [`WriteError::Io`] when writing, syncing or renaming fails.
    pub fn commit(self) -> Result<u64, WriteError> {
        self.finish(|file, target| file.persist(target))
    }

    /// Completes the file under its name, which no file may have yet; returns its size in bytes.
    ///
    /// # Errors
    /// As [`AtomicFile::commit`], of the kind [`io::ErrorKind::AlreadyExists`] for a name that is taken.
    pub fn commit_new(self) -> Result<u64, WriteError> {
        self.finish(|file, target| file.persist_noclobber(target))
    }

    /// Flushes, syncs and moves the file to its target by `persist`; returns its size in bytes. A file that is written
    /// directly (a pipe, a device) has no other name: `persist` is not called.
    fn finish(
        mut self,
        persist: impl FnOnce(NamedTempFile, &Path) -> Result<File, PersistError>,
    ) -> Result<u64, WriteError> {
        // A write that failed before leaves the file damaged, even if later ones succeeded.
        let flushed = match self.fault.take() {
            Some((kind, text)) => Err(io::Error::new(kind, text)),
            None => self.flush(),
        };
        flushed.map_err(|e| self.failed(e))?;
        let written = self.stored();
        let Self {
            shown,
            sink,
            needed,
            ..
        } = self;
        let failed = |error| WriteError::Io {
            path: shown.clone(),
            written,
            needed,
            error: plain(error),
        };
        // The content is on the disk before it gets its name, and the name when this returns: after a power failure the
        // target is the old file or the whole new one.
        match sink {
            Sink::Direct(file) => {
                sync_special(file.get_ref()).map_err(failed)?;
                Ok(written)
            }
            Sink::Staged(file, target) => {
                let file = file.into_inner().map_err(|e| failed(e.into_error()))?;
                file.as_file().sync_all().map_err(failed)?;
                let size = file.as_file().metadata().map_err(failed)?.len();
                persist(file, &target).map_err(|e| failed(e.error))?;
                sync_directory(&target).map_err(failed)?;
                Ok(size)
            }
        }
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.fault.is_some() {
            self.position += bytes.len() as u64;
            return Ok(bytes.len());
        }
        let result = match &mut self.sink {
            Sink::Staged(file, _) => file.write(bytes),
            Sink::Direct(file) => file.write(bytes),
        };
        let n = self.noted(result)?;
        self.written += n as u64;
        self.position += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.fault.is_some() {
            return Ok(());
        }
        let result = match &mut self.sink {
            Sink::Staged(file, _) => file.flush(),
            Sink::Direct(file) => file.flush(),
        };
        self.noted(result)
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        if self.fault.is_some() {
            let from = |base: u64, by: i64| base.saturating_add_signed(by);
            self.position = match to {
                SeekFrom::Start(at) => at,
                SeekFrom::Current(by) => from(self.position, by),
                SeekFrom::End(by) => from(self.position.max(self.written), by),
            };
            return Ok(self.position);
        }
        let result = match &mut self.sink {
            Sink::Staged(file, _) => file.seek(to),
            Sink::Direct(_) => Err(io::ErrorKind::NotSeekable.into()),
        };
        self.position = self.noted(result)?;
        Ok(self.position)
    }
}

/// A temporary path for other code (OpenVDB) to write, committed afterwards.
///
/// The path keeps the target's extension; an empty file exists from the start.
pub struct StagedPath {
    shown: PathBuf,
    target: PathBuf,
    /// Open, because its lock shows that it is written.
    file: NamedTempFile,
}

impl StagedPath {
    /// Reserves a temporary path beside the target.
    ///
    /// # Errors
    /// As [`AtomicFile::create`], and when the target is not a regular file, since the other code may seek.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, WriteError> {
        let shown = path.as_ref().to_owned();
        match Target::of(&shown)? {
            Target::Special => Err(not_seekable(&shown)),
            Target::Regular(target) => Ok(Self {
                file: stage(&shown, &target)?,
                shown,
                target,
            }),
        }
    }

    /// The path to write to.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Converts an error during writing into one with the file.
    pub fn failed(&self, error: io::Error) -> WriteError {
        WriteError::Io {
            path: self.shown.clone(),
            written: fs::metadata(self.path()).map_or(0, |m| m.len()),
            needed: None,
            error,
        }
    }

    /// Syncs the written file and moves it to the target's name; returns its size in bytes.
    ///
    /// # Errors
    /// [`WriteError::Io`] when syncing or renaming fails.
    pub fn commit(self) -> Result<u64, WriteError> {
        let synced = File::open(self.path()).and_then(|f| f.sync_all().and(f.metadata()));
        let size = synced.map_err(|e| self.failed(e))?.len();
        let Self {
            shown,
            target,
            file,
        } = self;
        let failed = |error| WriteError::Io {
            path: shown.clone(),
            written: size,
            needed: Some(size),
            error: plain(error),
        };
        file.persist(&target).map_err(|e| failed(e.error))?;
        sync_directory(&target).map_err(failed)?;
        Ok(size)
    }
}

/// Writes a whole file atomically from bytes already in memory.
///
/// # Errors
/// As [`AtomicFile::create`] and [`AtomicFile::commit`].
pub fn write_bytes(path: impl AsRef<Path>, bytes: &[u8]) -> Result<u64, WriteError> {
    let mut file = AtomicFile::create(path)?.expecting(bytes.len() as u64);
    file.write_all(bytes).map_err(|e| file.failed(e))?;
    file.commit()
}

/// Refuses a path at which no file can be made, before the work whose result belongs there. Beside a regular
/// target a temporary file is made and removed again; a special one is not tried. The target stays as it is.
///
/// # Errors
/// As [`AtomicFile::create`].
pub fn require_writable(path: impl AsRef<Path>) -> Result<(), WriteError> {
    let shown = path.as_ref();
    match Target::of(shown)? {
        Target::Special => Ok(()),
        Target::Regular(target) => stage(shown, &target).map(drop),
    }
}

/// As [`require_writable`], for files that are made in a directory, which is created.
///
/// # Errors
/// [`WriteError::Create`] names the directory; [`WriteError::Io`] for a full disk.
pub fn require_directory(path: impl AsRef<Path>) -> Result<(), WriteError> {
    let shown = path.as_ref();
    fs::create_dir_all(shown).map_err(|e| refused(shown, e.to_string()))?;
    // Any name will do: the temporary file has its own.
    require_writable(shown.join("x")).map_err(|e| match e {
        WriteError::Create { reason, .. } => refused(shown, reason),
        e => e,
    })
}

/// The kind of the output's target.
enum Target {
    /// No file or a regular file, at this path after symbolic links are resolved.
    Regular(PathBuf),
    /// A pipe, a terminal, a device.
    Special,
}

impl Target {
    fn of(shown: &Path) -> Result<Self, WriteError> {
        match fs::metadata(shown) {
            Ok(meta) if meta.is_dir() => Err(refused(shown, "it is a directory".into())),
            Ok(meta) if !meta.is_file() => Ok(Self::Special),
            Ok(_) => fs::canonicalize(shown)
                .map(Self::Regular)
                .map_err(|e| refused(shown, e.to_string())),
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                resolve_dangling(shown).map(Self::Regular)
            }
            Err(e) => Err(refused(shown, e.to_string())),
        }
    }
}

/// Follows symbolic links to a file that does not exist yet.
fn resolve_dangling(shown: &Path) -> Result<PathBuf, WriteError> {
    let mut path = shown.to_owned();
    // The limit of Linux on links in a path.
    for _ in 0..40 {
        match fs::read_link(&path) {
            Ok(next) => path = path.parent().unwrap_or(Path::new("")).join(next),
            Err(_) => return Ok(path),
        }
    }
    Err(refused(shown, "too many symbolic links".into()))
}

/// Creates the partial file of a target with the permissions of the target, or those that a new file gets.
fn stage(shown: &Path, target: &Path) -> Result<NamedTempFile, WriteError> {
    if target.file_name().and_then(|n| n.to_str()).is_none() {
        return Err(refused(shown, "it has no readable file name".into()));
    }
    let file = partial::create(target).map_err(|e| match e.kind() {
        io::ErrorKind::NotFound if !folder_of(target).is_dir() => {
            let folder = folder_of(target).display();
            refused(shown, format!("the directory {folder} does not exist"))
        }
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => WriteError::Io {
            path: shown.to_owned(),
            written: 0,
            needed: None,
            error: plain(e),
        },
        _ => refused(shown, plain(e).to_string()),
    })?;
    if let Ok(meta) = fs::metadata(target) {
        // Keep the mode of a replaced file; a file system without modes may refuse.
        let _ = file.as_file().set_permissions(meta.permissions());
    }
    Ok(file)
}

/// The error of the system without the name of a temporary file, which is appended to its text.
fn plain(error: io::Error) -> io::Error {
    let text = error.to_string();
    match text.split_once(" at path ") {
        Some((words, _)) => io::Error::new(error.kind(), words),
        None => error,
    }
}

fn refused(path: &Path, reason: String) -> WriteError {
    WriteError::Create {
        path: path.to_owned(),
        reason,
    }
}

fn not_seekable(path: &Path) -> WriteError {
    refused(
        path,
        "it is not a regular file, and this format is not written sequentially".into(),
    )
}

/// Makes a rename durable; directories that cannot be synced (some network file systems) are ignored.
fn sync_directory(target: &Path) -> io::Result<()> {
    match File::open(folder_of(target)).and_then(|d| d.sync_all()) {
        Err(e) if e.kind() == io::ErrorKind::InvalidInput => Ok(()),
        other => other,
    }
}

/// Syncs a file; pipes and terminals, which cannot be synced, are ignored.
fn sync_special(file: &File) -> io::Result<()> {
    match file.sync_all() {
        Err(e)
            if matches!(
                e.kind(),
                io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported
            ) =>
        {
            Ok(())
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The archive is dropped with an error in it: it ends its format in what takes no bytes, and panics nowhere.
    #[test]
    fn an_archive_on_a_full_device_ends_in_one_error() {
        let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
        let directory = tempfile::tempdir().unwrap();
        let mut file = AtomicFile::create(directory.path().join("a.3mf")).unwrap();
        let Sink::Staged(_, target) = &file.sink else {
            unreachable!()
        };
        let staged = NamedTempFile::from_parts(
            full,
            tempfile::TempPath::try_from_path(target.with_extension("x")).unwrap(),
        );
        file.sink = Sink::Staged(BufWriter::with_capacity(64, staged), target.clone());
        let result = (|| -> io::Result<()> {
            let mut zip = zip::ZipWriter::new(&mut file);
            zip.start_file("one", zip::write::SimpleFileOptions::default())?;
            for n in 0..100_000u32 {
                zip.write_all(&n.wrapping_mul(2_654_435_761).to_le_bytes())?; // hard to compress
            }
            zip.finish()?;
            Ok(())
        })();
        assert_eq!(result.unwrap_err().kind(), io::ErrorKind::StorageFull);
        assert!(
            file.commit()
                .unwrap_err()
                .to_string()
                .contains("after 0 bytes")
        );
    }
}
