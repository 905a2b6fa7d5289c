//! The parent of a program that reads `.vdb` files: it passes signals and the exit code on, and has the words for a file
//! that ends the program while it is read.

use super::signals::{Relay, is_ignored};
use crate::vdb::FileError;
use crate::vdb::forked::{ForkedProgram, fork};
use rustix::process::{
    Resource, Rlimit, Signal, WaitOptions, getrlimit, kill_process, setrlimit, waitpid,
};
use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGTERM};
use signal_hook::{flag, low_level};
use std::ffi::OsString;
use std::io::Write;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::ExitStatus;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Signals that a parent passes on; those of limits reach the program itself.
const PASSED_ON: [i32; 3] = [SIGINT, SIGTERM, SIGHUP];

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

/// Forks the program, before it starts any thread. Where the system refuses it, a child judges each file instead.
pub(super) fn split() -> Role {
    let Ok(relay) = Relay::new() else {
        return Role::Alone;
    };
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
    /// The file during whose reading the program ended.
    pub(super) fn wait(mut self) -> Result<u8, FileError> {
        let received = self.listen();
        let status = loop {
            self.program.listen();
            for (signal, is_received) in &received {
                if is_received.swap(false, Ordering::Relaxed) {
                    let _ = self.relay.sender.write_all(&[*signal as u8]);
                }
            }
            if let Some(status) = self.status(WaitOptions::NOHANG) {
                break status;
            }
            if let Some(error) = self.program.overtime() {
                let _ = kill_process(self.program.pid, Signal::KILL);
                self.status(WaitOptions::empty());
                return Err(error);
            }
        };
        self.program.catch_up();
        if let Some(error) = self.program.fault(status) {
            return Err(error);
        }
        if let Some(signal) = status.signal() {
            end_by(signal);
            return Ok(128 + signal as u8);
        }
        Ok(status.code().unwrap_or_default() as u8)
    }

    /// Notes the signals to pass on, and the end of the program.
    fn listen(&self) -> Vec<(i32, Arc<AtomicBool>)> {
        // `nohup` keeps both alive.
        let kept = |signal: &i32| *signal != SIGHUP || !is_ignored(SIGHUP);
        let passed_on = PASSED_ON.into_iter().filter(kept);
        let received: Vec<_> = passed_on.map(|s| (s, Arc::default())).collect();
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

    /// How the program has ended; `None` while it runs.
    fn status(&self, options: WaitOptions) -> Option<ExitStatus> {
        let ended = waitpid(Some(self.program.pid), options).ok().flatten();
        ended.map(|(_, status)| ExitStatus::from_raw(status.as_raw()))
    }
}

/// Ends this process by the signal that ended its child, which has left the image of the memory. Returns where that is
/// no signal that ends a process by its name.
fn end_by(signal: i32) {
    let none = Rlimit {
        current: Some(0),
        ..getrlimit(Resource::Core)
    };
    let _ = setrlimit(Resource::Core, none);
    let _ = low_level::emulate_default_handler(signal);
}
