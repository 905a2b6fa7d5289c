//! Looking at a file nobody vouches for: in a child process with limits.
//!
//! Of 2,400 corrupted `.vdb` files, OpenVDB 10 crashed on 28 and ran out of memory on 75. The child
//! reads the whole file under a limit of memory and time and either describes it as JSON or hands one
//! grid over through a pipe, leaf by leaf; whatever happens to it, the parent gets what it asked for or
//! one clear error, and never opens the file itself.
//!
//! The program decides how the child is called: a [`Program`] is called with the file, the limits and
//! what is wanted, and must end up in [`report`] or [`send`].

use super::ipc::{self, Loss};
use super::{FileError, FileInfo, Volume, info};
use rustix::process::{Resource, Rlimit, setrlimit};
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::fmt;
use std::io::{Read, Write};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// What the child may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Limits {
    /// Address space in bytes.
    pub memory: u64,
    /// Time from start to end, milliseconds.
    pub milliseconds: u64,
}

impl Limits {
    /// Those for a file that is there.
    fn for_file(path: &Path) -> Result<Self, FileError> {
        let size = std::fs::metadata(path).map_err(|e| FileError::io(path, e))?;
        Ok(Self::for_size(size.len()))
    }

    /// Of this process, from now on.
    fn impose(self) {
        let none = |resource, most| {
            let limit = Rlimit {
                current: Some(most),
                maximum: Some(most),
            };
            // A system that refuses leaves the parent's clock as the guard.
            let _ = setrlimit(resource, limit);
        };
        none(Resource::As, self.memory);
        none(Resource::Core, 0);
    }

    /// Generous for a whole file of this size: 2 GiB and 40 times its size, 10 s and 1 s per 20 MB.
    pub fn for_size(bytes: u64) -> Self {
        Self {
            memory: (2 << 30) + bytes.saturating_mul(40),
            milliseconds: 10_000 + bytes / 20_000,
        }
    }
}

/// What the child says.
#[derive(Serialize, Deserialize)]
enum Report {
    #[serde(rename = "info")]
    Info(FileInfo),
    #[serde(rename = "damaged")]
    Damaged(String),
    #[serde(rename = "errno")]
    Errno(i32),
}

/// How a child is started: the program and the arguments that lead it to [`report`] and [`send`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    /// What is executed.
    pub path: PathBuf,
    /// What it is told before the file.
    pub arguments: Vec<OsString>,
}

impl Program {
    /// The child for a file: `FILE MEMORY MILLISECONDS info`, or `... grid [NAME]`.
    fn command(&self, path: &Path, limits: Limits, wanted: &[&str]) -> Command {
        let mut child = Command::new(&self.path);
        child
            .args(&self.arguments)
            .arg(path)
            .args([limits.memory, limits.milliseconds].map(|n| n.to_string()))
            .args(wanted);
        child
    }

    /// What is in a file.
    ///
    /// # Errors
    /// [`FileError::Io`] when the file is missing or the child cannot be started,
    /// [`FileError::Damaged`] for everything that happened to the child.
    pub fn inspect(&self, path: &Path) -> Result<FileInfo, FileError> {
        let limits = Limits::for_file(path)?;
        inspect(self.command(path, limits, &["info"]), path, limits)
    }

    /// One grid of floats of a file. Without a name: `surface`, else the only level set, else the
    /// only grid of floats.
    ///
    /// # Errors
    /// As [`Program::inspect`]; [`FileError::NoGrid`], and [`FileError::NotALevelSet`] for other types
    /// and for voxels that are no cubes.
    pub fn fetch(&self, path: &Path, name: Option<&str>) -> Result<Volume, FileError> {
        let limits = Limits::for_file(path)?;
        let mut wanted = vec!["grid"];
        wanted.extend(name);
        let child = self.command(path, limits, &wanted);
        attend(child, path, limits, |pipe| ipc::receive(path, pipe, limits))
    }
}

/// A grid that a child has handed over before a run asks for it.
#[derive(Clone)]
pub struct Opened {
    path: PathBuf,
    name: Option<String>,
    /// Taken once; whoever asks again reads the file again.
    volume: Arc<Mutex<Option<Volume>>>,
}

impl Opened {
    /// The grid of a file that a name, or none, stands for.
    pub fn new(path: &Path, name: Option<&str>, volume: Volume) -> Self {
        Self {
            path: path.to_owned(),
            name: name.map(str::to_owned),
            volume: Arc::new(Mutex::new(Some(volume))),
        }
    }

    /// Gives it away, if it is that of a path and a name.
    pub fn take(&self, path: &Path, name: Option<&str>) -> Option<Volume> {
        if path != self.path || name != self.name.as_deref() {
            return None;
        }
        let mut volume = self.volume.lock().unwrap_or_else(PoisonError::into_inner);
        volume.take()
    }
}

impl fmt::Debug for Opened {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Opened({}, {:?})", self.path.display(), self.name)
    }
}

/// The child's part: limits its own memory, reads the whole file and describes the outcome as one
/// line of JSON. Changes the limits of the process: only for a process that does nothing else.
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

/// The child's part: limits its own memory, reads one grid of floats and hands it over through `out`.
/// Changes the limits of the process: only for a process that does nothing else.
///
/// # Errors
/// Those of `out`; what is wrong with the file is told to the receiver.
pub fn send(
    path: &Path,
    name: Option<&str>,
    limits: Limits,
    out: impl Write,
) -> std::io::Result<()> {
    limits.impose();
    ipc::send(path, name, out)
}

/// The parent's part: runs `child` (which must print [`report`] of the same path and limits) and
/// waits for it no longer than the limits say.
///
/// # Errors
/// [`FileError::Io`] when the file is missing or the child cannot be started,
/// [`FileError::Damaged`] for everything that happened to the child.
pub fn inspect(child: Command, path: &Path, limits: Limits) -> Result<FileInfo, FileError> {
    std::fs::metadata(path).map_err(|e| FileError::io(path, e))?;
    let told = attend(child, path, limits, |mut pipe| {
        let mut text = String::new();
        pipe.read_to_string(&mut text)
            .map_err(|e| Loss::Broken(e.to_string()))?;
        let line = text.lines().rev().find(|l| l.starts_with('{'));
        line.and_then(|l| serde_json::from_str(l).ok())
            .ok_or_else(|| Loss::Broken("it said nothing".into()))
    })?;
    match told {
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

/// The parent's part: starts the child, listens to it with `listen`, and waits for it no longer than
/// the limits say.
fn attend<T: Send>(
    mut child: Command,
    path: &Path,
    limits: Limits,
    listen: impl FnOnce(ChildStdout) -> Result<T, Loss> + Send,
) -> Result<T, FileError> {
    let io = |e| FileError::io(path, e);
    let damaged = |reason: String| FileError::Damaged {
        path: path.to_owned(),
        reason,
    };
    let mut running = child
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(io)?;
    let pipe = running.stdout.take();
    let (status, heard) = std::thread::scope(|scope| {
        // What comes may be longer than a pipe holds.
        let listener = scope.spawn(move || match pipe {
            Some(pipe) => listen(pipe),
            None => Err(Loss::Broken("it has no voice".into())),
        });
        let status = wait(&mut running, Duration::from_millis(limits.milliseconds));
        (status, listener.join())
    });
    let Some(status) = status.map_err(io)? else {
        let seconds = limits.milliseconds as f64 / 1000.0;
        return Err(damaged(format!("reading it took more than {seconds} s")));
    };
    match heard {
        Ok(Ok(heard)) => Ok(heard),
        Ok(Err(Loss::Told(error))) => Err(error),
        Ok(Err(Loss::Broken(_))) if !status.success() => Err(damaged(epitaph(status, limits))),
        Ok(Err(Loss::Broken(reason))) => Err(damaged(format!("its reader failed: {reason}"))),
        Err(_) => Err(damaged(epitaph(status, limits))),
    }
}

/// Waits for the child's end, or kills it: `None`.
fn wait(child: &mut Child, most: Duration) -> std::io::Result<Option<ExitStatus>> {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if start.elapsed() > most {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn epitaph(status: ExitStatus, limits: Limits) -> String {
    match status.signal() {
        Some(signal) => format!(
            "reading it ended the reader with signal {signal} (allowed: {} MiB)",
            limits.memory >> 20
        ),
        None => format!("reading it ended the reader with {status}"),
    }
}
