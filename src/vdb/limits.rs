//! Limits of memory and time for the reading of an untrusted `.vdb` file, and what the end of its reader shows.
//!
//! OpenVDB 10 crashed on 28 and ran out of memory on 75 of 2,400 corrupted files. A process that reads one has a
//! parent, which waits for it and has the words for its end.

use super::error::FileError;
use super::ffi;
use rustix::process::{Resource, Rlimit, Signal, getrlimit, setrlimit};
use serde::{Deserialize, Serialize};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::ExitStatus;

/// Exit code of a reader that runs out of memory.
const EXIT_EXHAUSTED: u8 = 71;
/// Exit code of a reader that cannot write a coarse copy.
pub(crate) const EXIT_NO_COPY: u8 = 73;
/// Exit code of a reader that gets no thread, also before its own code runs.
const EXIT_NO_THREADS: u8 = 74;

/// Limits of a reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Limits {
    /// Address space in bytes.
    pub memory: u64,
    /// Time from start to end, milliseconds.
    pub milliseconds: u64,
}

impl Limits {
    /// The limits for an existing file.
    pub(super) fn for_file(path: &Path) -> Result<Self, FileError> {
        let size = std::fs::metadata(path).map_err(|e| FileError::io(path, e))?;
        Ok(Self::for_size(size.len()))
    }

    /// Limits for a file of this size, well above what a sound one needs: 2 GiB plus 40 times its size, 10 s plus 1 s
    /// per 20 MB.
    pub fn for_size(bytes: u64) -> Self {
        Self {
            memory: (2 << 30) + bytes.saturating_mul(40),
            milliseconds: 10_000 + bytes / 20_000,
        }
    }

    /// Limits the memory of this process beyond the `used` bytes of address space that it already has, and has it end
    /// without words where it runs out. The time is the parent's to limit.
    pub(super) fn impose(self, used: u64) -> Imposed {
        let lower = |resource, bytes: u64| {
            let own = getrlimit(resource);
            // Not above a limit that the process has already.
            let current = Some(own.current.map_or(bytes, |own| own.min(bytes)));
            // If the system refuses, the limit of time still holds.
            let _ = setrlimit(resource, Rlimit { current, ..own });
            own
        };
        end_silently();
        Imposed {
            memory: lower(Resource::As, self.memory.saturating_add(used)),
            // A crash leaves no image of the memory on the disk.
            core: lower(Resource::Core, 0),
        }
    }

    /// The error of a file, or of the machine (no thread, a full temporary folder, too little memory for a sound file),
    /// whose reader has ended.
    pub(super) fn error_of(self, status: ExitStatus, path: &Path) -> FileError {
        let io = |kind: std::io::ErrorKind| FileError::io(path, kind.into());
        match status.code() {
            // The kind of error with which the system refuses a thread.
            Some(code) if code == i32::from(EXIT_NO_THREADS) => io(std::io::ErrorKind::WouldBlock),
            Some(code) if code == i32::from(EXIT_NO_COPY) => {
                let full = std::io::ErrorKind::StorageFull;
                FileError::io(&std::env::temp_dir(), full.into())
            }
            // The limit of this process, which the reader has too, is less than what a sound file may need.
            _ if self.is_above_own() => io(std::io::ErrorKind::OutOfMemory),
            _ => FileError::Damaged {
                path: path.to_owned(),
                reason: self.reason_of(status),
            },
        }
    }

    /// As [`Limits::error_of`], for a process that also ends for other reasons than its reading; `None` for those.
    pub(super) fn error_of_reading(self, status: ExitStatus, path: &Path) -> Option<FileError> {
        let codes = [EXIT_EXHAUSTED, EXIT_NO_THREADS].map(|c| Some(i32::from(c)));
        // The system kills a process where memory runs out.
        let is_killed = status.signal() == Some(Signal::KILL.as_raw());
        let is_of_reading = is_crash(status) || is_killed || codes.contains(&status.code());
        is_of_reading.then(|| self.error_of(status, path))
    }

    /// The error of a file whose reader took too long.
    pub(super) fn overtime(self, path: &Path) -> FileError {
        let seconds = self.milliseconds as f64 / 1000.0;
        FileError::Damaged {
            path: path.to_owned(),
            reason: format!("reading it took more than {seconds} s"),
        }
    }

    /// Whether the process may use less memory than a reader.
    fn is_above_own(self) -> bool {
        let own = getrlimit(Resource::As).current;
        own.is_some_and(|bytes| bytes < self.memory)
    }

    fn reason_of(self, status: ExitStatus) -> String {
        if status.code() == Some(i32::from(EXIT_EXHAUSTED)) {
            return format!("reading it needs more than {} MiB", self.memory >> 20);
        }
        match status.signal() {
            Some(signal) => format!(
                "reading it ended the reader with signal {signal} (allowed: {} MiB)",
                self.memory >> 20
            ),
            None => format!("reading it ended the reader with {status}"),
        }
    }
}

/// Whether a process has crashed: by an instruction, memory, arithmetic, or a library that aborts.
pub(super) fn is_crash(status: ExitStatus) -> bool {
    use Signal as S;
    let crashes = [S::ILL, S::ABORT, S::BUS, S::FPE, S::SEGV].map(S::as_raw);
    status.signal().is_some_and(|s| crashes.contains(&s))
}

/// The limits that the process had before [`Limits::impose`].
pub(super) struct Imposed {
    memory: Rlimit,
    core: Rlimit,
}

impl Imposed {
    /// Restores them, and the words for memory and threads that run out.
    pub fn lift(&self) {
        ffi::end_silently(0, 0);
        let _ = setrlimit(Resource::As, self.memory);
        let _ = setrlimit(Resource::Core, self.core);
    }
}

/// Has this process end with exit codes of a reader, and without words, once memory or threads run out.
pub(crate) fn end_silently() {
    ffi::end_silently(EXIT_EXHAUSTED.into(), EXIT_NO_THREADS.into());
}
