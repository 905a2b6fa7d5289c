//! Memory or threads that run out, as the user sees it.

use super::{EXIT_IO, Failure};
use crate::cli::context::Session;
use crate::cli::terminal;
use std::io::ErrorKind;

/// What helps where memory or threads run out.
pub(super) const HINT: &str = "larger voxels, a run in bricks (--bricks N or --memory SIZE), fewer --threads, or a \
                               higher limit of the process (ulimit -v, ulimit -u)";
/// Removes the progress bar from a terminal.
const CLEAR_LINE: &str = "\r\x1b[2K";

impl Failure {
    /// An allocation, or a thread, that the system refuses.
    pub(in crate::cli) fn exhausted() -> Self {
        Self {
            code: EXIT_IO,
            message: "not enough memory: the system grants the program no more".into(),
            hint: Some(HINT.into()),
            ..Self::default()
        }
    }

    /// Has this failure printed, and the program ended with its code, once memory runs out: nothing can be allocated for
    /// it then. Without a session it is printed plain.
    pub(in crate::cli) fn print_on_exhaustion(&self, session: Option<&Session>) {
        let mut words = self.block(session.is_some_and(Session::colored));
        if session.is_some_and(Session::shows_bar) {
            words.insert_str(0, CLEAR_LINE);
        }
        let json = if session.is_some_and(Session::json) {
            format!("{}\n", terminal::json(&self.json()))
        } else {
            String::new()
        };
        crate::vdb::end_on_exhaustion(&words, &json, self.code);
    }
}

/// Whether the system has no memory, or no thread or process, to give.
pub(super) fn is_cause(e: &std::io::Error) -> bool {
    matches!(e.kind(), ErrorKind::OutOfMemory | ErrorKind::WouldBlock)
}

/// Whether a panic comes of a thread that the system refuses.
pub(super) fn is_panic(message: &str) -> bool {
    ["ThreadPoolBuildError", "failed to spawn thread"]
        .iter()
        .any(|words| message.contains(words))
}
