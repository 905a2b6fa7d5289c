//! Signals: the first one cancels the work, the second one ends the program at once.
//!
//! The hang-up of a terminal and the end of the processor time that the process may use cancel the work, too. Work that
//! waits for another program, such as the reader of a pipe, does not see that it is cancelled: the program ends by
//! itself then. A limit on the size of files ends a write with an error, as a full disk does, instead of the program.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use rustix::time::{ClockId, clock_gettime};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXCPU, SIGXFSZ};
use signal_hook::{flag, low_level};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;

/// Time without work after which a cancelled program counts as one that waits for another.
const IDLE_TIME: Duration = Duration::from_secs(2);
/// Processor time that the display of progress uses in it at most.
const MAX_IDLE_WORK: Duration = Duration::from_millis(40);
/// Time for the last message, which may go into a pipe that nothing reads.
const FAREWELL_TIME: Duration = Duration::from_millis(500);
/// Stack of the thread that waits for signals, bytes.
const STACK_BYTES: usize = 1 << 18;

/// Signals that a parent passes on; those of limits reach the program itself.
pub(super) const PASSED_ON: [i32; 3] = [SIGINT, SIGTERM, SIGHUP];

/// The way of signals into a program: bytes of its own handlers, and numbers of signals that its parent passes on.
pub(super) struct Relay {
    pub(super) sender: UnixStream,
    receiver: UnixStream,
}

impl Relay {
    /// A way without anything in it.
    ///
    /// # Errors
    /// The process may open no more files.
    pub(super) fn new() -> std::io::Result<Self> {
        let (receiver, sender) = UnixStream::pair()?;
        // A program that is stopped receives nothing; its parent does not wait for it.
        sender.set_nonblocking(true)?;
        Ok(Self { sender, receiver })
    }
}

/// The signals received so far.
#[derive(Clone)]
pub(super) struct Signals {
    stop: Arc<AtomicBool>,
    which: Arc<AtomicUsize>,
}

impl Signals {
    /// Starts to listen, also to a parent that passes its own signals on through `relay`. Where the system refuses a
    /// handler, its signal keeps its usual effect.
    pub(super) fn listen(relay: Option<Relay>) -> Self {
        let signals = Self {
            stop: Arc::new(AtomicBool::new(false)),
            which: Arc::new(AtomicUsize::new(0)),
        };
        // With a handler of any kind, the write that passes the limit fails.
        let _ = flag::register(SIGXFSZ, Arc::default());
        warn_before_the_end_of_processor_time();
        let relay = relay.or_else(|| Relay::new().ok());
        // Apart from `stop`, which a signal of the parent sets too: one interrupt of a terminal reaches both.
        let handled = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP, SIGXCPU] {
            // `nohup` keeps a program alive by this.
            if signal == SIGHUP && is_ignored(SIGHUP) {
                continue;
            }
            let number = signal as usize;
            // The order matters: the first signal finds `handled` unset, so the shutdown handler ignores it. The system
            // sends SIGXCPU again every second.
            let second = match signal {
                SIGXCPU => Ok(()),
                _ => {
                    flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&handled))
                        .map(drop)
                }
            };
            let _ = second
                .and_then(|()| flag::register_usize(signal, Arc::clone(&signals.which), number))
                .and_then(|_| flag::register(signal, Arc::clone(&handled)))
                .and_then(|_| flag::register(signal, Arc::clone(&signals.stop)));
            if let Some(end) = relay.as_ref().and_then(|r| r.sender.try_clone().ok()) {
                let _ = low_level::pipe::register(signal, end);
            }
        }
        if let Some(relay) = relay {
            let own = signals.clone();
            // Without a thread a second signal is needed, from a parent a third.
            let _ = std::thread::Builder::new()
                .name("signals".into())
                .stack_size(STACK_BYTES)
                .spawn(move || own.end_idle_program(relay.receiver));
        }
        signals
    }

    /// Whether the work has to stop.
    pub(super) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// 128 plus the number of the last signal; `None` before any.
    pub(super) fn exit_code(&self) -> Option<u8> {
        self.stopped()
            .then(|| 128 + self.which.load(Ordering::Relaxed) as u8)
    }

    /// Waits for a signal, then for the work to end by itself; ends the program once it uses almost no processor
    /// time: it waits for another program then.
    fn end_idle_program(&self, mut receiver: UnixStream) {
        let (mut byte, mut before, mut passed_on) = ([0], Duration::ZERO, 0);
        loop {
            let is_idle = match receiver.read_exact(&mut byte) {
                // A second of the parent ends the program as a second of its own does.
                Ok(()) if PASSED_ON.contains(&byte[0].into()) => {
                    passed_on += 1;
                    if passed_on > 1 {
                        low_level::exit(128 + i32::from(byte[0]));
                    }
                    // Its own handler has noted the same one, where both received it.
                    if !self.stop.load(Ordering::Relaxed) {
                        self.which.store(byte[0].into(), Ordering::Relaxed);
                        self.stop.store(true, Ordering::Relaxed);
                    }
                    false
                }
                Ok(()) => false,
                Err(e) if e.kind() == ErrorKind::WouldBlock => {
                    processor_time().saturating_sub(before) < MAX_IDLE_WORK
                }
                Err(_) => return,
            };
            if is_idle {
                break;
            }
            before = processor_time();
            let _ = receiver.set_read_timeout(Some(IDLE_TIME));
        }
        let code = self.exit_code().unwrap_or(128);
        let (sent, received) = channel();
        let _ = std::thread::Builder::new().spawn(move || {
            crate::vdb::forked::restore_outputs();
            let words =
                "error: stopped while waiting for another program, such as the reader of a pipe\n";
            let _ = std::io::stderr().write_all(words.as_bytes());
            let _ = sent.send(());
        });
        let _ = received.recv_timeout(FAREWELL_TIME);
        low_level::exit(i32::from(code));
    }
}

/// Processor time that the process has used.
fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// Moves the limit of processor time a second below the one that kills the process, so that the signal comes first.
fn warn_before_the_end_of_processor_time() {
    let limit = getrlimit(Resource::Cpu);
    if let (Some(soft), Some(hard)) = (limit.current, limit.maximum)
        && soft >= hard
        && hard > 1
    {
        let _ = setrlimit(
            Resource::Cpu,
            Rlimit {
                current: Some(hard - 1),
                ..limit
            },
        );
    }
}

/// Whether the program was started with a signal ignored.
pub(super) fn is_ignored(signal: i32) -> bool {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = text.lines().find_map(|l| l.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|m| u64::from_str_radix(m.trim(), 16).ok());
    mask.is_some_and(|m| (m >> (signal - 1)) & 1 == 1)
}
