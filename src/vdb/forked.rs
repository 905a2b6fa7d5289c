//! A program that reads untrusted `.vdb` files as the child of a process that only waits for it.
//!
//! The child sends its parent a notice of each file that it reads, by [`Reading`], and has limits of memory and time
//! meanwhile. If it ends then, the file is at fault: [`ForkedProgram::fault`] is the one clear error.

use super::error::FileError;
use super::ffi;
use super::limits::{Imposed, Limits, is_crash};
use super::memory::address_space;
use rustix::process::{
    Pid, Signal, getpid, getppid, kill_process, set_parent_process_death_signal,
};
use rustix::stdio::{dup2_stderr, dup2_stdout};
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::fs::File;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::ExitStatus;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Bytes of the longest notice: each byte of the longest path as a number and a comma.
const NOTICE_BYTES: usize = 1 << 16;

/// Longest wait for a notice. A parent whose handlers of signals fail sees the end of its child that much later.
const LONGEST_WAIT: Duration = Duration::from_secs(1);

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
    /// The file that it reads.
    current: Option<CurrentFile>,
    /// The files that it has read.
    has_read: Vec<OsString>,
}

/// A file that is being read.
struct CurrentFile {
    path: OsString,
    limits: Limits,
    /// Time of its reading, without the time for which the processes were stopped.
    spent: Duration,
}

/// Forks the process: `None` in the child, which is the program from then on and ends with its parent. It has the
/// calling thread alone.
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
            let pid = pid.ok_or_else(|| io::Error::from_raw_os_error(-number))?;
            Ok(Some(ForkedProgram::new(pid, notices, waker)))
        }
    }
}

impl ForkedProgram {
    fn new(pid: Pid, notices: UnixDatagram, waker: UnixDatagram) -> Self {
        Self {
            pid,
            notices,
            waker,
            current: None,
            has_read: Vec::new(),
        }
    }

    /// A socket for handlers of signals: any byte ends a wait for notices.
    ///
    /// # Errors
    /// The process may open no more files.
    pub fn waker(&self) -> io::Result<UnixDatagram> {
        self.waker.try_clone()
    }

    /// Waits for a notice or a byte of a handler, at most for [`LONGEST_WAIT`].
    pub fn wait_for_notice(&mut self) {
        let start = Instant::now();
        let _ = self.notices.set_read_timeout(Some(LONGEST_WAIT));
        let was_reading = self.current.is_some();
        self.receive();
        if let Some(current) = self.current.as_mut().filter(|_| was_reading) {
            // A longer wait is the time for which a terminal stopped both processes.
            current.spent += start.elapsed().min(LONGEST_WAIT);
        }
        self.take_notices();
    }

    /// Takes the notices that have come.
    pub fn take_notices(&mut self) {
        let _ = self.notices.set_nonblocking(true);
        while self.receive() {}
        let _ = self.notices.set_nonblocking(false);
    }

    /// Whether there was something to receive.
    fn receive(&mut self) -> bool {
        let mut bytes = vec![0; NOTICE_BYTES];
        let Ok(count) = self.notices.recv(&mut bytes) else {
            return false;
        };
        match serde_json::from_slice(&bytes[..count]) {
            Ok(Notice::Begins(path, limits)) => {
                self.current = Some(CurrentFile {
                    path,
                    limits,
                    spent: Duration::ZERO,
                });
            }
            Ok(Notice::Ends) => {
                let read = self.current.take().map(|c| c.path);
                let is_new = |path: &OsString| !self.has_read.contains(path);
                self.has_read.extend(read.filter(is_new));
            }
            // A byte of a handler.
            Err(_) => {}
        }
        true
    }

    /// The error of the file that the program has been reading for too long.
    pub fn overtime(&self) -> Option<FileError> {
        let current = self.current.as_ref()?;
        let is_over = current.spent >= Duration::from_millis(current.limits.milliseconds);
        is_over.then(|| current.limits.overtime(Path::new(&current.path)))
    }

    /// The error of the file that the program was reading when it ended so; `None` if it ended for another reason.
    pub fn fault(&self, status: ExitStatus) -> Option<FileError> {
        let current = self.current.as_ref()?;
        current
            .limits
            .error_of_reading(status, Path::new(&current.path))
    }

    /// The files that a program has read before it crashed; empty after any other end. A damaged file may destroy the
    /// heap, which is noticed later.
    pub fn suspects(&self, status: ExitStatus) -> &[OsString] {
        if is_crash(status) {
            &self.has_read
        } else {
            &[]
        }
    }
}

/// A file that a forked program reads: from the first notice to the second. Meanwhile nothing is printed, and a bar
/// stands still: libraries have words of their own where memory runs out or the heap is destroyed.
pub(super) struct Reading {
    notices: MutexGuard<'static, UnixDatagram>,
    limits: Imposed,
}

/// Where stdout and stderr lead, while a file is read.
static OUTPUTS: Mutex<Option<[OwnedFd; 2]>> = Mutex::new(None);

impl Reading {
    /// Begins to read a file; `None` in a process that is no forked program.
    pub fn begin(path: &Path, limits: Limits) -> Option<Self> {
        // One file at a time.
        let notices = NOTICES.get()?;
        let notices = notices.lock().unwrap_or_else(PoisonError::into_inner);
        send(&notices, &Notice::Begins(path.into(), limits));
        // Without it a library may print, no more.
        let _ = silence_outputs();
        Some(Self {
            notices,
            limits: limits.impose(address_space().unwrap_or(u64::MAX)),
        })
    }
}

impl Drop for Reading {
    fn drop(&mut self) {
        self.limits.lift();
        send(&self.notices, &Notice::Ends);
        // Last, since the notice is allocated, in a heap that may be destroyed.
        restore_outputs();
    }
}

/// Leads stdout and stderr nowhere.
fn silence_outputs() -> io::Result<()> {
    let own = [
        io::stdout().as_fd().try_clone_to_owned()?,
        io::stderr().as_fd().try_clone_to_owned()?,
    ];
    let nowhere = File::options().write(true).open("/dev/null")?;
    let mut outputs = OUTPUTS.lock().unwrap_or_else(PoisonError::into_inner);
    *outputs = Some(own);
    dup2_stdout(&nowhere)?;
    dup2_stderr(&nowhere)?;
    Ok(())
}

/// Leads stdout and stderr where they led before a file was read; for a program that ends meanwhile, too.
pub(crate) fn restore_outputs() {
    let mut outputs = OUTPUTS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some([stdout, stderr]) = outputs.take() {
        let _ = dup2_stdout(stdout);
        let _ = dup2_stderr(stderr);
    }
}

/// A parent that does not receive has ended, and its child with it.
fn send(notices: &UnixDatagram, notice: &Notice) {
    let _ = notices.send(&serde_json::to_vec(notice).unwrap_or_default());
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::process::ExitStatusExt;

    /// A program that exists by its notices alone, and the end that sends them.
    fn program() -> (ForkedProgram, UnixDatagram) {
        let (notices, waker) = UnixDatagram::pair().unwrap();
        let sender = waker.try_clone().unwrap();
        (ForkedProgram::new(getpid(), notices, waker), sender)
    }

    #[test]
    fn the_end_of_a_reader_is_the_error_of_its_file() {
        let (mut program, sender) = program();
        let limits = Limits::for_size(100);
        let by_signal = ExitStatus::from_raw(11);
        let by_code = |code: i32| ExitStatus::from_raw(code << 8);
        assert!(program.fault(by_signal).is_none());
        send(&sender, &Notice::Begins("a.vdb".into(), limits));
        program.take_notices();
        for (status, words) in [
            (by_signal, "ended the reader with signal 11"),
            (by_code(71), "needs more than 2048 MiB"),
            (by_code(74), "a.vdb"),
        ] {
            let error = program.fault(status).unwrap().to_string();
            assert!(error.contains(words), "{error}");
        }
        // The program's own ends, such as that by a second interrupt.
        assert!(program.fault(by_code(130)).is_none() && program.fault(by_code(65)).is_none());
        assert!(program.suspects(by_signal).is_empty());
        send(&sender, &Notice::Ends);
        program.take_notices();
        assert!(program.fault(by_signal).is_none());
        assert_eq!(program.suspects(by_signal), ["a.vdb"]);
        assert!(program.suspects(ExitStatus::from_raw(9)).is_empty());
    }

    #[test]
    fn a_reader_has_its_time_and_no_more() {
        let (mut program, sender) = program();
        let limits = Limits {
            milliseconds: 1500,
            ..Limits::for_size(100)
        };
        send(&sender, &Notice::Begins("a.vdb".into(), limits));
        program.take_notices();
        program.wait_for_notice();
        assert!(program.overtime().is_none());
        program.wait_for_notice();
        let error = program.overtime().unwrap().to_string();
        assert!(error.contains("took more than 1.5 s"), "{error}");
        send(&sender, &Notice::Ends);
        program.take_notices();
        assert!(program.overtime().is_none());
    }
}
