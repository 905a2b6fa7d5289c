//! Memory or threads that run out, as the user sees it. The words are made before the work begins, because nothing
//! can be allocated for them later.

use super::{EXIT_IO, Failure};
use crate::cli::context::{CLEAR_LINE, Session};
use crate::cli::terminal;
use crate::vdb::Exhausted;
use std::io::ErrorKind;

/// What helps where memory runs out.
const MEMORY_HINT: &str = "larger voxels, a run in bricks (--bricks N or --memory SIZE), fewer --threads, or a \
                           higher limit of the process (ulimit -v)";
/// What helps where threads run out: their number is limited, and the memory of their stacks.
pub(super) const THREADS_HINT: &str = "fewer --threads, or a higher limit of processes and threads (ulimit -u) or of \
                                       memory (ulimit -v)";

impl Failure {
    /// An allocation, or a thread, that the system refuses.
    pub(in crate::cli) fn exhausted(cause: Exhausted) -> Self {
        let (what, hint) = match cause {
            Exhausted::Memory => ("memory", MEMORY_HINT),
            Exhausted::Threads => ("threads", THREADS_HINT),
        };
        Self {
            code: EXIT_IO,
            message: format!("not enough {what}: the system grants the program no more"),
            hint: Some(hint.into()),
            ..Self::default()
        }
    }

    /// Has these failures printed, and the program ended with their code, once memory or threads run out: nothing can be
    /// allocated for it then. Without a session they are printed plain.
    pub(in crate::cli) fn print_on_exhaustion(session: Option<&Session>) {
        for cause in [Exhausted::Memory, Exhausted::Threads] {
            let failure = Self::exhausted(cause);
            let mut words = failure.block(session.is_some_and(Session::colored));
            if session.is_some_and(Session::shows_bar) {
                words.insert_str(0, CLEAR_LINE);
            }
            let json = if session.is_some_and(Session::json) {
                format!("{}\n", terminal::json(&failure.json()))
            } else {
                String::new()
            };
            crate::vdb::end_on_exhaustion(cause, &words, &json, failure.code);
        }
    }
}

/// What the system has none of to give, if that is the cause of an error.
pub(super) fn cause(e: &std::io::Error) -> Option<Exhausted> {
    match e.kind() {
        ErrorKind::OutOfMemory => Some(Exhausted::Memory),
        // The system's answer to a thread beyond its limit.
        ErrorKind::WouldBlock => Some(Exhausted::Threads),
        _ => None,
    }
}

/// Whether a panic comes of a thread that the system refuses.
pub(super) fn is_panic(message: &str) -> bool {
    ["ThreadPoolBuildError", "failed to spawn thread"]
        .iter()
        .any(|words| message.contains(words))
}
