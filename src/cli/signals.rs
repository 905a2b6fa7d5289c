//! Signals: the first one cancels the work, the second one ends the program at once.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// The signals received so far.
pub(super) struct Signals {
    stop: Arc<AtomicBool>,
    which: Arc<AtomicUsize>,
}

impl Signals {
    /// Starts to listen. Where the system refuses a handler, its signal keeps its usual effect.
    pub(super) fn listen() -> Self {
        let signals = Self {
            stop: Arc::new(AtomicBool::new(false)),
            which: Arc::new(AtomicUsize::new(0)),
        };
        for signal in [SIGINT, SIGTERM] {
            let number = signal as usize;
            // The order matters: the first signal finds `stop` unset, so the shutdown handler ignores it.
            let _ = flag::register_conditional_shutdown(
                signal,
                128 + signal,
                Arc::clone(&signals.stop),
            )
            .and_then(|_| flag::register_usize(signal, Arc::clone(&signals.which), number))
            .and_then(|_| flag::register(signal, Arc::clone(&signals.stop)));
        }
        signals
    }

    /// Whether the work has to stop.
    pub(super) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// 130 or 143 after a signal.
    pub(super) fn exit_code(&self) -> Option<u8> {
        self.stopped()
            .then(|| 128 + self.which.load(Ordering::Relaxed) as u8)
    }
}
