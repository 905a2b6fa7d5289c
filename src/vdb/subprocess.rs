//! A verdict on untrusted `.vdb` files by a child process with limits of memory and time.
//!
//! The child reads a file just as its parent would. If the child fails, the parent returns one clear error and never
//! opens the file; else the parent reads the file itself. Nothing is transferred but descriptions, and coarse copies of
//! files too large for a view, which would otherwise be averaged twice. A forked program needs no child: it has a
//! parent for the case that it fails, and reads the file at once.
//!
//! A [`Program`] defines the command of the child. It is called with the file, the limits and the request,
//! and must call [`report`] or [`probe`].

use super::error::FileError;
use super::file::{CoarseReading, FileInfo, info};
use super::forked::Reading;
pub use super::limits::Limits;
use super::volume::Volume;
use rustix::process::{Signal, set_parent_process_death_signal};
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::fmt;
use std::fs::File;
use std::io::Read;
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The child's result.
#[derive(Serialize, Deserialize)]
enum Report {
    #[serde(rename = "info")]
    Info(FileInfo),
    #[serde(rename = "damaged")]
    Damaged(String),
    #[serde(rename = "errno")]
    Errno(i32),
}

/// The program of the child, with the arguments that make it call [`report`] or [`probe`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    /// The executable.
    pub path: PathBuf,
    /// Its arguments before the file.
    pub arguments: Vec<OsString>,
}

impl Program {
    /// The command of a child: arguments `FILE MEMORY MILLISECONDS info`, or `... grid [NAME]`.
    fn command(&self, path: &Path, limits: Limits, request: &[&str]) -> Command {
        let mut child = Command::new(&self.path);
        child
            .args(&self.arguments)
            .arg(path)
            .args([limits.memory, limits.milliseconds].map(|n| n.to_string()))
            .args(request);
        child
    }

    /// Describes the contents of a file.
    ///
    /// # Errors
    /// [`FileError::Io`] if the file is missing or the child cannot be started, [`FileError::Damaged`] if
    /// the child fails.
    pub fn inspect(&self, path: &Path) -> Result<FileInfo, FileError> {
        let limits = Limits::for_file(path)?;
        if let Some(_watched) = Reading::begin(path, limits) {
            return info(path);
        }
        inspect(self.command(path, limits, &["info"]), path, limits)
    }

    /// Reads one grid of floats of a file. Without a name: `surface`, else the only level set, else the
    /// only grid of floats or doubles.
    ///
    /// # Errors
    /// As [`Program::inspect`]; [`FileError::NoGrid`], and [`FileError::NotALevelSet`] for other types than floats and
    /// doubles and for voxels without a volume.
    pub fn fetch(&self, path: &Path, name: Option<&str>) -> Result<Volume, FileError> {
        self.fetch_with(path, name, None)
    }

    /// Reads one grid of floats, as [`Program::fetch`] does; a large level set as a coarse copy
    /// ([`Volume::coarse_step`]). Values of a large file are read when they are used, so that it may be
    /// larger than memory.
    ///
    /// # Errors
    /// As [`Program::fetch`].
    pub fn fetch_coarse(
        &self,
        path: &Path,
        name: Option<&str>,
        reading: CoarseReading,
    ) -> Result<Volume, FileError> {
        self.fetch_with(path, name, Some(reading))
    }

    /// `reading` is that of a coarse copy.
    fn fetch_with(
        &self,
        path: &Path,
        name: Option<&str>,
        reading: Option<CoarseReading>,
    ) -> Result<Volume, FileError> {
        let limits = Limits::for_file(path)?;
        if let Some(_watched) = Reading::begin(path, limits) {
            return Volume::open(path, name, reading)?.surveyed(path);
        }
        let coarse = reading.map(|r| {
            let (voxels, threads) = (r.max_voxels, r.threads);
            [format!("--voxels={voxels}"), format!("--threads={threads}")]
        });
        let mut request = vec!["grid"];
        request.extend(coarse.iter().flatten().map(String::as_str));
        request.extend(name);
        // Without a name in any folder: nothing of it stays, however the two processes end.
        let copy = tempfile::tempfile().map_err(|e| FileError::io(&std::env::temp_dir(), e))?;
        let copied = copy.try_clone().map_err(|e| FileError::io(path, e))?;
        let child = self.command(path, limits, &request);
        run_child(child, path, limits, Stdio::from(copied))?;
        // The child wrote an average: the file itself need not be read again.
        if copy.metadata().is_ok_and(|m| m.len() > 0) {
            return Volume::read_coarse_copy(&copy_path(&copy), path);
        }
        Volume::open(path, name, reading)?.surveyed(path)
    }
}

/// The path of an open file for a library that opens files by their paths.
fn copy_path(copy: &File) -> PathBuf {
    PathBuf::from(format!("/proc/self/fd/{}", copy.as_raw_fd()))
}

/// A grid that was read before the run that uses it.
#[derive(Clone)]
pub struct PrefetchedGrid {
    path: PathBuf,
    name: Option<String>,
    /// Taken once; a second use reads the file again.
    volume: Arc<Mutex<Option<Volume>>>,
}

impl PrefetchedGrid {
    /// Stores the grid that a file and an optional name stand for.
    pub fn new(path: &Path, name: Option<&str>, volume: Volume) -> Self {
        Self {
            path: path.to_owned(),
            name: name.map(str::to_owned),
            volume: Arc::new(Mutex::new(Some(volume))),
        }
    }

    /// Takes the grid, if it is the one of this path and name.
    pub fn take(&self, path: &Path, name: Option<&str>) -> Option<Volume> {
        if path != self.path || name != self.name.as_deref() {
            return None;
        }
        let mut volume = self.volume.lock().unwrap_or_else(PoisonError::into_inner);
        volume.take()
    }
}

impl fmt::Debug for PrefetchedGrid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "PrefetchedGrid({}, {:?})",
            self.path.display(),
            self.name
        )
    }
}

/// Child: limits its memory, reads the whole file and describes the result as one line of JSON. Changes the
/// limits of the process; only for a process that does nothing else.
pub fn report(path: &Path, limits: Limits) -> String {
    limit_child(limits);
    let report = match info(path) {
        Ok(info) => Report::Info(info),
        Err(FileError::Io { source, .. }) if source.raw_os_error().is_some() => {
            Report::Errno(source.raw_os_error().unwrap_or_default())
        }
        Err(FileError::Damaged { reason, .. }) => Report::Damaged(reason),
        Err(other) => Report::Damaged(other.to_string()),
    };
    serde_json::to_string(&report).unwrap_or_default()
}

/// Child: limits its memory and reads one grid of floats as [`Program::fetch`] will; with `reading`, a coarse copy that
/// had to be averaged goes to stdout as a `.vdb`. Changes the limits of the process; only for a process that does
/// nothing else.
///
/// # Errors
/// Errors of writing the copy. An error of the file is none: the parent meets it again, without harm.
pub fn probe(
    path: &Path,
    name: Option<&str>,
    reading: Option<CoarseReading>,
    limits: Limits,
) -> Result<(), FileError> {
    limit_child(limits);
    match Volume::open(path, name, reading) {
        // A tag of the file alone makes no copy of it.
        Ok(volume) if reading.is_some() && volume.is_averaged() => {
            volume.write_coarse_copy(Path::new("/dev/stdout"))
        }
        _ => Ok(()),
    }
}

/// Child: limits its memory to the end, which comes with that of its parent.
fn limit_child(limits: Limits) {
    limits.impose(0);
    // A killed parent keeps no time.
    let _ = set_parent_process_death_signal(Some(Signal::KILL));
}

/// Parent: runs `child`, which must print [`report`] of the same path and limits; kills it at the time limit.
///
/// # Errors
/// [`FileError::Io`] if the file is missing or the child cannot be started, [`FileError::Damaged`] if the
/// child fails.
pub fn inspect(child: Command, path: &Path, limits: Limits) -> Result<FileInfo, FileError> {
    std::fs::metadata(path).map_err(|e| FileError::io(path, e))?;
    let text = run_child(child, path, limits, Stdio::piped())?;
    let line = text.lines().rev().find(|l| l.starts_with('{'));
    let report = line
        .and_then(|l| serde_json::from_str(l).ok())
        .ok_or_else(|| FileError::Damaged {
            path: path.to_owned(),
            reason: "its reader failed: it wrote no report".into(),
        })?;
    match report {
        Report::Info(info) => Ok(info),
        Report::Damaged(reason) => Err(FileError::Damaged {
            path: path.to_owned(),
            reason,
        }),
        Report::Errno(number) => Err(FileError::io(
            path,
            std::io::Error::from_raw_os_error(number),
        )),
    }
}

/// Parent: starts the child, kills it at the time limit, and returns what it wrote if `out` is a pipe. A child that
/// ends by itself with success is believed; any other end is an error of the file, or of the machine: no thread, a full
/// temporary folder, or too little memory for a sound file.
fn run_child(
    mut child: Command,
    path: &Path,
    limits: Limits,
    out: Stdio,
) -> Result<String, FileError> {
    let io = |e| FileError::io(path, e);
    let mut running = child
        .stdin(Stdio::null())
        .stdout(out)
        .stderr(Stdio::null())
        .spawn()
        .map_err(io)?;
    let pipe = running.stdout.take();
    let (status, text) = std::thread::scope(|scope| {
        // Read in parallel: the output may be longer than the pipe's buffer.
        let receiver = std::thread::Builder::new().spawn_scoped(scope, move || {
            let mut text = String::new();
            pipe.map_or(Ok(0), |mut pipe| pipe.read_to_string(&mut text))
                .map(|_| text)
        });
        let receiver = match receiver {
            Ok(receiver) => receiver,
            Err(e) => {
                let _ = running.kill();
                let _ = running.wait();
                return Err(e);
            }
        };
        let status = wait(&mut running, Duration::from_millis(limits.milliseconds));
        Ok((status, receiver.join()))
    })
    .map_err(io)?;
    match status.map_err(io)? {
        None => Err(limits.overtime(path)),
        Some(status) if status.success() => Ok(text.ok().and_then(Result::ok).unwrap_or_default()),
        Some(status) => Err(limits.error_of(status, path)),
    }
}

/// Waits for the child's exit; after the time limit kills it and returns `None`.
fn wait(child: &mut Child, limit: Duration) -> std::io::Result<Option<ExitStatus>> {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if start.elapsed() > limit {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
