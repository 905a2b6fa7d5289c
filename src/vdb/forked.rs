//! A program that reads untrusted `.vdb` files as the child of a process that only waits for it.
//!
//! The child tells its parent which file it reads, by [`Reading`], and has limits of memory and time meanwhile. If it
//! ends then, or crashes later, the file is at fault: [`ForkedProgram::fault`] is the one clear error. Nothing is read twice.

use super::error::FileError;
use super::ffi;
use super::limits::{Imposed, Limits};
use super::memory::address_space;
use rustix::process::{
    Pid, Signal, getpid, getppid, kill_process, set_parent_process_death_signal,
};
use rustix::stdio::dup2_stderr;
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::fs::File;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixDatagram;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::ExitStatus;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Bytes of the longest notice: each byte of the longest path as a number and a comma.
const NOTICE_BYTES: usize = 1 << 16;

/// Signals of a crash: those of instructions, memory and arithmetic, and of a library that aborts.
const CRASHES: [i32; 5] = [
    Signal::ILL.as_raw(),
    Signal::ABORT.as_raw(),
    Signal::BUS.as_raw(),
    Signal::FPE.as_raw(),
    Signal::SEGV.as_raw(),
];

/// What the child sends its parent.
#[derive(Serialize, Deserialize)]
enum Notice {
    /// It begins to read this file.
    Begins(OsString, Limits),
    /// It has read it.
    Ends,
}

/// The child's end of the notices; empty in all other processes.
static NOTICES: OnceLock<Mutex<UnixDatagram>> = OnceLock::new();

/// A forked program, as its parent sees it.
pub(crate) struct ForkedProgram {
    /// The process.
    pub pid: Pid,
    notices: UnixDatagram,
    waker: UnixDatagram,
    /// The file that it reads, since when, and its limits.
    reading: Option<(OsString, Instant, Limits)>,
    /// The last file that it has read.
    has_read: Option<OsString>,
}

/// Forks the process: `None` in the child, which is the program from then on and ends with its parent. Of all threads it
/// has the calling one alone.
///
/// # Errors
/// The system refuses another process, or a socket.
pub(crate) fn fork() -> io::Result<Option<ForkedProgram>> {
    let (notices, waker) = UnixDatagram::pair()?;
    let parent = getpid();
    match ffi::fork_process() {
        0 => {
            let _ = set_parent_process_death_signal(Some(Signal::KILL));
            // A parent that has died already sends no signal.
            if getppid() != Some(parent) {
                let _ = kill_process(getpid(), Signal::KILL);
            }
            let _ = NOTICES.set(Mutex::new(waker));
            Ok(None)
        }
        number => {
            let pid = Pid::from_raw(number).filter(|_| number > 0);
            Ok(Some(ForkedProgram {
                pid: pid.ok_or_else(|| io::Error::from_raw_os_error(-number))?,
                notices,
                waker,
                reading: None,
                has_read: None,
            }))
        }
    }
}

impl ForkedProgram {
    /// A socket that ends [`ForkedProgram::listen`] by any byte, for handlers of signals.
    ///
    /// # Errors
    /// The process may open no more files.
    pub fn waker(&self) -> io::Result<UnixDatagram> {
        self.waker.try_clone()
    }

    /// Receives one notice, or a byte of a handler. Waits until there is one, or until the limit of time.
    pub fn listen(&mut self) {
        // A wait of no time would be one without an end.
        let left = self.time_left().map(|t| t.max(Duration::from_millis(1)));
        let _ = self.notices.set_read_timeout(left);
        self.receive();
    }

    /// Receives the notices that have been sent.
    pub fn catch_up(&mut self) {
        let _ = self.notices.set_nonblocking(true);
        while self.receive() {}
    }

    /// Whether there was something to receive.
    fn receive(&mut self) -> bool {
        let mut bytes = vec![0; NOTICE_BYTES];
        let Ok(count) = self.notices.recv(&mut bytes) else {
            return false;
        };
        match serde_json::from_slice(&bytes[..count]) {
            Ok(Notice::Begins(path, limits)) => self.reading = Some((path, Instant::now(), limits)),
            Ok(Notice::Ends) => self.has_read = self.reading.take().map(|r| r.0),
            // A byte of a handler.
            Err(_) => {}
        }
        true
    }

    /// The time that the program may go on reading; `None` while it reads nothing.
    fn time_left(&self) -> Option<Duration> {
        let (_, start, limits) = self.reading.as_ref()?;
        Some(Duration::from_millis(limits.milliseconds).saturating_sub(start.elapsed()))
    }

    /// The error of the file that the program has been reading for too long.
    pub fn overtime(&self) -> Option<FileError> {
        let (path, _, limits) = self.reading.as_ref()?;
        let is_over = self.time_left().is_some_and(|t| t.is_zero());
        is_over.then(|| limits.overtime(Path::new(path)))
    }

    /// The error of the file that the program was reading when it ended so, or had read before it crashed: a damaged one
    /// may destroy the heap without being noticed at once. `None` if the program ended for another reason.
    pub fn fault(&self, status: ExitStatus) -> Option<FileError> {
        if let Some((path, _, limits)) = &self.reading {
            return limits.error_of_reading(status, Path::new(path));
        }
        let signal = status.signal().filter(|s| CRASHES.contains(s))?;
        Some(FileError::Damaged {
            path: self.has_read.as_ref()?.into(),
            reason: format!("the program that read it crashed later, with signal {signal}"),
        })
    }
}

/// A file that a forked program reads: from the first notice to the second. The C library prints nothing meanwhile, when
/// it finds the heap destroyed.
pub(super) struct Reading {
    notices: MutexGuard<'static, UnixDatagram>,
    limits: Imposed,
    stderr: Option<OwnedFd>,
}

impl Reading {
    /// Begins to read a file; `None` in a process that is no forked program.
    pub fn begin(path: &Path, limits: Limits) -> Option<Self> {
        // One file at a time.
        let notices = NOTICES.get()?;
        let notices = notices.lock().unwrap_or_else(PoisonError::into_inner);
        send(&notices, &Notice::Begins(path.into(), limits));
        Some(Self {
            notices,
            limits: limits.impose(address_space().unwrap_or(0)),
            stderr: silence_stderr().ok(),
        })
    }
}

impl Drop for Reading {
    fn drop(&mut self) {
        self.limits.lift();
        if let Some(stderr) = &self.stderr {
            let _ = dup2_stderr(stderr);
        }
        send(&self.notices, &Notice::Ends);
    }
}

/// Leads stderr nowhere, and returns where it led.
fn silence_stderr() -> io::Result<OwnedFd> {
    let own = io::stderr().as_fd().try_clone_to_owned()?;
    dup2_stderr(File::options().write(true).open("/dev/null")?)?;
    Ok(own)
}

/// A parent that does not receive has ended, and its child with it.
fn send(notices: &UnixDatagram, notice: &Notice) {
    let _ = notices.send(&serde_json::to_vec(notice).unwrap_or_default());
}
