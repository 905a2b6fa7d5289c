//! The parent of a program that reads `.vdb` files.
//!
//! It passes signals and the exit code on, and has the words for a file that ends the program.

use super::failure::Failure;
use super::kind::FileKind;
use super::signals::{PASSED_ON, Relay, is_ignored};
use crate::io::ReadError;
use crate::vdb::forked::{ForkedProgram, fork};
use rustix::io::Errno;
use rustix::process::{
    Resource, Rlimit, Signal, WaitOptions, getrlimit, kill_process, setrlimit, waitpid,
};
use signal_hook::consts::{SIGCHLD, SIGHUP};
use signal_hook::{flag, low_level};
use std::ffi::OsString;
use std::io::Write;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::ExitStatus;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

/// Time after a signal in which further ones, of any kind, are taken for the same.
const MERGED_TIME: Duration = Duration::from_millis(500);

/// What a process is after [`split`].
pub(super) enum Role {
    /// The program, without a parent that waits for it.
    Alone,
    /// The program, with the way of its parent's signals.
    Child(Relay),
    /// The parent.
    Parent(Parent),
}

/// The parent of a program that runs.
pub(super) struct Parent {
    program: ForkedProgram,
    relay: Relay,
}

/// Whether an argument is a file of OpenVDB, or of `NanoVDB`.
pub(super) fn is_volume(argument: &OsString) -> bool {
    let path = Path::new(argument);
    let is_named_so = path.extension().is_some_and(|e| {
        ["vdb", "nvdb"]
            .iter()
            .any(|known| e.eq_ignore_ascii_case(known))
    });
    is_named_so && path.is_file()
}

/// Forks the program, before it starts a thread of its own: those of libraries are idle. Where the system refuses it, a
/// child judges each file instead.
pub(super) fn split() -> Role {
    let Ok(relay) = Relay::new() else {
        return Role::Alone;
    };
    // A process that was started with this signal ignored would not learn how its child ended.
    let _ = flag::register(SIGCHLD, Arc::default());
    match fork() {
        Ok(None) => Role::Child(relay),
        Ok(Some(program)) => Role::Parent(Parent { program, relay }),
        Err(_) => Role::Alone,
    }
}

impl Parent {
    /// Waits for the end of the program, and returns its exit code. A signal that ended it ends this process too.
    ///
    /// # Errors
    /// The error of the file that ended the program.
    pub(super) fn wait(mut self) -> Result<u8, Failure> {
        let received = self.register_handlers();
        let (mut count, mut latest) = (0, None);
        let status = loop {
            for (signal, _) in received.iter().filter(|r| r.1.swap(false, Relaxed)) {
                // `timeout` sends one to this process, and at once to its group.
                if latest.is_some_and(|t: Instant| t.elapsed() < MERGED_TIME) {
                    continue;
                }
                latest = Some(Instant::now());
                let _ = self.relay.sender.write_all(&[*signal as u8]);
                count += 1;
                // The program may have got no thread that receives it.
                if count > 1
                    && let Some(signal) = Signal::from_named_raw(*signal)
                {
                    let _ = kill_process(self.program.pid, signal);
                }
            }
            match waitpid(Some(self.program.pid), WaitOptions::NOHANG) {
                Ok(None) | Err(Errno::INTR) => {}
                Ok(Some((_, status))) => break ExitStatus::from_raw(status.as_raw()),
                Err(e) => return Err(ReadError::io(Path::new("the program"), e.into()).into()),
            }
            if let Some(error) = self.program.overtime() {
                let _ = kill_process(self.program.pid, Signal::KILL);
                return Err(error.into());
            }
            self.program.wait_for_notice();
        };
        // What it sent before its end.
        self.program.take_notices();
        if let Some(error) = self.program.fault(status) {
            return Err(error.into());
        }
        // A sound file is not at fault, nor one that cannot be judged any more. A signal ends this process from now on.
        for (signal, _) in &received {
            let _ = flag::register_conditional_default(*signal, Arc::new(true.into()));
        }
        let suspects = self.program.suspects(status).iter().map(Path::new);
        for path in suspects.filter(|path| FileKind::of(path, &[FileKind::Vdb]).is_ok()) {
            match super::vdb::inspect(path) {
                Err(failure) if failure.is_of_data() => return Err(failure),
                _ => {}
            }
        }
        if let Some(signal) = status.signal() {
            end_by(signal);
            return Ok(128 + signal as u8);
        }
        Ok(status.code().unwrap_or_default() as u8)
    }

    /// Has the signals to pass on noted, each in its flag, and the wait for notices end by them and by the end of the
    /// program.
    fn register_handlers(&self) -> Vec<(i32, Arc<AtomicBool>)> {
        // One that `nohup` has the program ignore is no signal to pass on.
        let is_heard = |signal: &i32| *signal != SIGHUP || !is_ignored(SIGHUP);
        let heard = PASSED_ON.into_iter().filter(is_heard);
        let received: Vec<_> = heard.map(|s| (s, Arc::default())).collect();
        for (signal, is_received) in &received {
            let _ = flag::register(*signal, Arc::clone(is_received));
        }
        for signal in received.iter().map(|r| r.0).chain([SIGCHLD]) {
            if let Ok(waker) = self.program.waker() {
                let _ = low_level::pipe::register(signal, waker);
            }
        }
        received
    }
}

/// Ends this process by the signal that ended its child, without an image of the memory, which the child has left.
/// Returns for signals without a name, such as those of real time.
fn end_by(signal: i32) {
    let none = Rlimit {
        current: Some(0),
        ..getrlimit(Resource::Core)
    };
    let _ = setrlimit(Resource::Core, none);
    let _ = low_level::emulate_default_handler(signal);
}
