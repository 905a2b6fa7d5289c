//! A verdict on untrusted `.vdb` files by a child process with limits of memory and time.
//!
//! OpenVDB 10 crashed on 28 and ran out of memory on 75 of 2,400 corrupted files. The child reads a file just as its
//! parent would. If the child fails, the parent returns one clear error and never opens the file; else the parent
//! reads the file itself. Nothing is transferred but descriptions, and coarse copies of files too large for a view,
//! which would otherwise be averaged twice.
//!
//! A [`Program`] defines the command of the child. It is called with the file, the limits and the request,
//! and must call [`report`] or [`probe`].

use super::error::FileError;
use super::file::{CoarseReading, FileInfo, info};
use super::volume::Volume;
use rustix::process::{
    Resource, Rlimit, Signal, getrlimit, set_parent_process_death_signal, setrlimit,
};
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::fmt;
use std::fs::File;
use std::io::Read;
use std::os::fd::AsRawFd;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Exit code of a child that runs out of memory.
pub(crate) const EXIT_EXHAUSTED: u8 = 71;
/// Exit code of a child that cannot write a coarse copy.
pub(crate) const EXIT_NO_COPY: u8 = 73;
/// Exit code of a child that gets no thread, also before its own code runs.
pub(crate) const EXIT_NO_THREADS: u8 = 74;

/// Limits of the child.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Limits {
    /// Address space in bytes.
    pub memory: u64,
    /// Time from start to end, milliseconds.
    pub milliseconds: u64,
}

impl Limits {
    /// The limits for an existing file.
    fn for_file(path: &Path) -> Result<Self, FileError> {
        let size = std::fs::metadata(path).map_err(|e| FileError::io(path, e))?;
        Ok(Self::for_size(size.len()))
    }

    /// Applies the limits to this process.
    fn impose(self) {
        let limit = |resource, bytes| {
            // Not above a limit that the process has already.
            let bytes = getrlimit(resource)
                .current
                .map_or(bytes, |own| own.min(bytes));
            let limit = Rlimit {
                current: Some(bytes),
                maximum: Some(bytes),
            };
            // If the system refuses, the parent's time limit still holds.
            let _ = setrlimit(resource, limit);
        };
        limit(Resource::As, self.memory);
        // A crash leaves no image of the memory on the disk.
        limit(Resource::Core, 0);
        // A killed parent keeps no time: the child ends with it.
        let _ = set_parent_process_death_signal(Some(Signal::KILL));
    }

    /// Limits for a file of this size, well above what a sound one needs: 2 GiB plus 40 times its size, 10 s plus 1 s
    /// per 20 MB.
    pub fn for_size(bytes: u64) -> Self {
        Self {
            memory: (2 << 30) + bytes.saturating_mul(40),
            milliseconds: 10_000 + bytes / 20_000,
        }
    }
}

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
    limits.impose();
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
    limits.impose();
    match Volume::open(path, name, reading) {
        // A tag of the file alone makes no copy of it.
        Ok(volume) if reading.is_some() && volume.is_averaged() => {
            volume.write_coarse_copy(Path::new("/dev/stdout"))
        }
        _ => Ok(()),
    }
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
    let damaged = |reason: String| FileError::Damaged {
        path: path.to_owned(),
        reason,
    };
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
        None => {
            let seconds = limits.milliseconds as f64 / 1000.0;
            Err(damaged(format!("reading it took more than {seconds} s")))
        }
        Some(status) if status.success() => Ok(text.ok().and_then(Result::ok).unwrap_or_default()),
        Some(status) if status.code() == Some(i32::from(EXIT_NO_THREADS)) => {
            // The kind of error with which the system refuses a thread.
            Err(io(std::io::ErrorKind::WouldBlock.into()))
        }
        Some(status) if status.code() == Some(i32::from(EXIT_NO_COPY)) => {
            let full = std::io::ErrorKind::StorageFull;
            Err(FileError::io(&std::env::temp_dir(), full.into()))
        }
        // The limit of this process, which the child has too, is less than what a sound file may need.
        Some(_) if has_less_memory(limits) => Err(io(std::io::ErrorKind::OutOfMemory.into())),
        Some(status) => Err(damaged(exit_reason(status, limits))),
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

/// Whether the process may use less memory than the child.
fn has_less_memory(limits: Limits) -> bool {
    let own = getrlimit(Resource::As).current;
    own.is_some_and(|bytes| bytes < limits.memory)
}

fn exit_reason(status: ExitStatus, limits: Limits) -> String {
    if status.code() == Some(i32::from(EXIT_EXHAUSTED)) {
        return format!("reading it needs more than {} MiB", limits.memory >> 20);
    }
    match status.signal() {
        Some(signal) => format!(
            "reading it ended the reader with signal {signal} (allowed: {} MiB)",
            limits.memory >> 20
        ),
        None => format!("reading it ended the reader with {status}"),
    }
}
