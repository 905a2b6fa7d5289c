//! Work outside the interpreter's lock: threads, progress and interruption.
//!
//! The work runs on a thread of its own and in a pool. The calling thread waits without the lock, and takes it 20
//! times a second to deliver progress and to let the interpreter handle signals. An exception there, such as
//! `KeyboardInterrupt`, cancels the work and is raised once it has stopped, or soon after.

use crate::fault::Fault;
use druse::progress::{Progress, Threads};
use druse::vdb::Session;
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, Once, PoisonError};
use std::time::{Duration, Instant};

/// Time between two checks for signals and progress.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Time that interrupted work has to end before the call returns without it.
const MAX_STOP_TIME: Duration = Duration::from_millis(400);

/// The pool, with the process that it belongs to.
static POOL: Mutex<Option<(u32, Arc<Threads>)>> = Mutex::new(None);
/// Number of its threads; 0 means one per core.
static THREAD_COUNT: AtomicUsize = AtomicUsize::new(0);

/// Locks a mutex, also after a thread has panicked while it held it.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Sets the number of threads of all later work; 0 means one per core.
#[pyfunction]
pub(crate) fn set_threads(count: usize) {
    THREAD_COUNT.store(count, Ordering::Relaxed);
    let own = std::process::id();
    let mut slot = lock(&POOL);
    // A pool of a parent process has no threads here and cannot be dropped.
    if slot.as_ref().is_some_and(|(pid, _)| *pid == own) {
        *slot = None;
    }
}

/// The number of threads.
#[pyfunction]
pub(crate) fn threads() -> Result<usize, Fault> {
    Ok(pool()?.count())
}

/// A pool of one thread.
fn single_thread() -> Result<Arc<Threads>, Fault> {
    let made = Threads::new(1);
    made.map(Arc::new)
        .map_err(|e| Fault::Text(format!("cannot start a thread: {e}")))
}

/// The pool of this process.
pub(crate) fn pool() -> Result<Arc<Threads>, Fault> {
    let own = std::process::id();
    let mut slot = lock(&POOL);
    if let Some((pid, threads)) = &*slot
        && *pid == own
    {
        return Ok(Arc::clone(threads));
    }
    let made = Threads::new(THREAD_COUNT.load(Ordering::Relaxed));
    let threads = Arc::new(made.map_err(|e| Fault::Text(format!("cannot start threads: {e}")))?);
    // The threads of a parent process do not exist in its fork, so that their pool cannot be dropped.
    std::mem::forget(slot.replace((own, Arc::clone(&threads))));
    Ok(threads)
}

/// The current stage of some work.
#[derive(Default, PartialEq, Clone)]
struct Stage {
    name: String,
    done: u64,
    total: Option<u64>,
}

/// What the work and the waiting thread share; `signal` wakes the latter once `finished` is set.
#[derive(Default)]
struct Monitor {
    stage: Mutex<Stage>,
    done: AtomicU64,
    cancelled: AtomicBool,
    finished: Mutex<bool>,
    signal: Condvar,
}

impl Monitor {
    /// The stage with the number of its steps that are done.
    fn stage(&self) -> Stage {
        let mut stage = lock(&self.stage).clone();
        stage.done = self.done.load(Ordering::Relaxed);
        stage
    }

    /// Marks the end of the work and wakes the waiting thread.
    fn finish(&self) {
        *lock(&self.finished) = true;
        self.signal.notify_all();
    }

    /// Waits at most `POLL_INTERVAL` for the end of the work; whether it has ended.
    fn wait(&self) -> bool {
        let finished = lock(&self.finished);
        let waited = self
            .signal
            .wait_timeout_while(finished, POLL_INTERVAL, |f| !*f);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

impl Progress for Monitor {
    fn stage(&self, name: &str, total: Option<u64>) {
        *lock(&self.stage) = Stage {
            name: name.to_owned(),
            done: 0,
            total,
        };
        self.done.store(0, Ordering::Relaxed);
    }
    fn advance(&self, n: u64) {
        self.done.fetch_add(n, Ordering::Relaxed);
    }
    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

/// The pool of a call; from the first one on, Python's `logging` has the library's records.
fn own_pool(py: Python<'_>) -> PyResult<Arc<Threads>> {
    // Not when the module is loaded: the command line program, which it contains, prints records itself.
    static LOGGING: Once = Once::new();
    LOGGING.call_once(|| {
        // Levels are not kept: a program may change them at any time. It fails where something else has the records.
        let logger = pyo3_log::Logger::new(py, pyo3_log::Caching::Loggers);
        let _ = logger.map(pyo3_log::Logger::install);
    });
    // A call from a user's function that a thread of the pool has called gets its own thread, since the pool may be
    // waiting for that function.
    let is_nested = rayon::current_thread_index().is_some();
    let threads = if is_nested { single_thread() } else { pool() };
    Ok(threads?)
}

/// Does the work of a call, which may borrow from the caller: after an interrupt the call returns once the work
/// has stopped. `progress` is called with stage, done and total.
pub(crate) fn work<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    job: impl FnOnce(Session<'_>) -> Result<T, Fault> + Send,
) -> PyResult<T> {
    let threads = own_pool(py)?;
    let monitor = Monitor::default();
    let (outcome, raised) = std::thread::scope(|scope| {
        let worker = scope.spawn(|| run_job(&threads, &monitor, job));
        let raised = wait(py, progress, &monitor, None);
        (py.detach(|| worker.join()), raised)
    });
    match raised {
        Some(raised) => Err(raised),
        None => result(outcome),
    }
}

/// Does work that may take seconds from one check of cancellation to the next, such as the factorisation of a
/// matrix. After an interrupt the call returns within `MAX_STOP_TIME` all the same: the work, which owns what it
/// uses, ends by itself.
pub(crate) fn work_owned<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    job: impl FnOnce(Session<'_>) -> Result<T, Fault> + Send + 'static,
) -> PyResult<T> {
    let threads = own_pool(py)?;
    let monitor = Arc::new(Monitor::default());
    let own = Arc::clone(&monitor);
    let worker = std::thread::spawn(move || run_job(&threads, &own, job));
    match wait(py, progress, &monitor, Some(MAX_STOP_TIME)) {
        Some(raised) => Err(raised),
        None => result(py.detach(|| worker.join())),
    }
}

/// The outcome of a job, or its panic.
type Outcome<T> = std::thread::Result<Result<T, Fault>>;

/// Does the job in the pool and marks its end, also after a panic.
fn run_job<T: Send>(
    threads: &Threads,
    monitor: &Monitor,
    job: impl FnOnce(Session<'_>) -> Result<T, Fault> + Send,
) -> Outcome<T> {
    let session = Session::new(threads, monitor);
    let outcome = catch_unwind(AssertUnwindSafe(|| threads.install(|| job(session))));
    monitor.finish();
    outcome
}

/// Waits until the work ends. Returns the exception that cancelled it, if any; after one it waits for at most `limit`.
fn wait(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    monitor: &Monitor,
    limit: Option<Duration>,
) -> Option<PyErr> {
    let mut raised: Option<(PyErr, Instant)> = None;
    let mut shown = Stage::default();
    while !py.detach(|| monitor.wait()) {
        if let Some((_, since)) = &raised {
            if limit.is_some_and(|limit| since.elapsed() > limit) {
                break;
            }
            continue;
        }
        let delivered = py
            .check_signals()
            .and_then(|()| report(progress, &monitor.stage(), &mut shown));
        if let Err(e) = delivered {
            raised = Some((e, Instant::now()));
            monitor.cancelled.store(true, Ordering::Relaxed);
        }
    }
    raised.map(|(e, _)| e)
}

/// The result of a job; a panic is an exception that requests a report.
fn result<T>(outcome: std::thread::Result<Outcome<T>>) -> PyResult<T> {
    match outcome {
        Ok(Ok(outcome)) => Ok(outcome?),
        Ok(Err(panic)) | Err(panic) => Err(bug(&*panic).into()),
    }
}

/// Calls the progress function if the stage has moved on.
fn report(progress: Option<&Bound<'_, PyAny>>, stage: &Stage, shown: &mut Stage) -> PyResult<()> {
    let Some(function) = progress.filter(|_| stage != shown && !stage.name.is_empty()) else {
        return Ok(());
    };
    *shown = stage.clone();
    function.call1((&stage.name, stage.done, stage.total))?;
    Ok(())
}

/// The error for a panic, with its message.
fn bug(panic: &(dyn std::any::Any + Send)) -> Fault {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
    Fault::Text(format!(
        "this is a bug of druse {}: {}",
        env!("CARGO_PKG_VERSION"),
        text.unwrap_or_else(|| "a panic without a message".into())
    ))
}
