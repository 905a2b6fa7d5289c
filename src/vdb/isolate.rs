//! Looking at a file nobody vouches for: in a child process with limits.
//!
//! Of 2,400 corrupted `.vdb` files, OpenVDB 10 crashed on 28 and ran out of memory on 75. The child
//! reads the whole file under a limit of memory and time and reports as JSON; whatever happens to it,
//! the parent gets a description or one clear error. Only what the child has read wholly is worth
//! opening here.
//!
//! The program decides how the child is called: [`inspect`] takes the command, which must end up in
//! [`report`] and print what that returns.

use super::{FileError, FileInfo, info};
use rustix::process::{Resource, Rlimit, setrlimit};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
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

/// The child's part: limits its own memory, reads the whole file and describes the outcome as one
/// line of JSON. Changes the limits of the process: only for a process that does nothing else.
pub fn report(path: &Path, limits: Limits) -> String {
    let none = |resource, most| {
        let limit = Rlimit {
            current: Some(most),
            maximum: Some(most),
        };
        // A system that refuses leaves the parent's clock as the guard.
        let _ = setrlimit(resource, limit);
    };
    none(Resource::As, limits.memory);
    none(Resource::Core, 0);
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

/// The parent's part: runs `child` (which must print [`report`] of the same path and limits) and
/// waits for it no longer than the limits say.
///
/// # Errors
/// [`FileError::Io`] when the file is missing or the child cannot be started,
/// [`FileError::Damaged`] for everything that happened to the child.
pub fn inspect(mut child: Command, path: &Path, limits: Limits) -> Result<FileInfo, FileError> {
    let io = |e| FileError::io(path, e);
    let damaged = |reason: String| FileError::Damaged {
        path: path.to_owned(),
        reason,
    };
    std::fs::metadata(path).map_err(io)?;
    let mut running = child
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(io)?;
    let pipe = running.stdout.take();
    let (status, text) = std::thread::scope(|scope| {
        // The report may be longer than a pipe holds.
        let reader = scope.spawn(move || {
            let mut text = String::new();
            pipe.map(|mut p| p.read_to_string(&mut text)).transpose()?;
            Ok::<_, std::io::Error>(text)
        });
        let status = wait(&mut running, Duration::from_millis(limits.milliseconds));
        (status, reader.join())
    });
    let Some(status) = status.map_err(io)? else {
        let seconds = limits.milliseconds as f64 / 1000.0;
        return Err(damaged(format!("reading it took more than {seconds} s")));
    };
    let text = text.ok().and_then(Result::ok).unwrap_or_default();
    let line = text.lines().rev().find(|l| l.starts_with('{'));
    match line.and_then(|l| serde_json::from_str(l).ok()) {
        Some(Report::Info(info)) => Ok(info),
        Some(Report::Damaged(reason)) => Err(damaged(reason)),
        Some(Report::Errno(number)) => Err(io(std::io::Error::from_raw_os_error(number))),
        None => Err(damaged(epitaph(status, limits))),
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
