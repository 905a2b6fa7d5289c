//! Work outside the interpreter's lock: threads, progress and interruption.
//!
//! The work runs on a thread of its own and in a pool. The calling thread waits without the lock, and takes it a few
//! times a second to deliver progress and to let the interpreter handle signals. An exception there, such as
//! `KeyboardInterrupt`, cancels the work and is raised once it has stopped.

use crate::fault::Fault;
use druse::progress::{Progress, Threads};
use druse::vdb::Session;
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Time between two checks for signals and progress.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// The pool, with the process that it belongs to.
static POOL: Mutex<Option<(u32, Arc<Threads>)>> = Mutex::new(None);
/// Number of its threads; 0 means one per core.
static THREAD_COUNT: AtomicUsize = AtomicUsize::new(0);

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
pub(crate) fn threads(py: Python<'_>) -> PyResult<usize> {
    pool().map(|p| p.count()).map_err(|e| e.raise(py))
}

/// A thread of its own.
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

/// What the work and the waiting thread share.
#[derive(Default)]
struct Monitor {
    stage: Mutex<Stage>,
    done: AtomicU64,
    cancelled: AtomicBool,
    finished: Mutex<bool>,
    signal: Condvar,
}

impl Monitor {
    fn stage(&self) -> Stage {
        let mut stage = lock(&self.stage).clone();
        stage.done = self.done.load(Ordering::Relaxed);
        stage
    }

    fn finish(&self) {
        *lock(&self.finished) = true;
        self.signal.notify_all();
    }

    /// Waits a moment for the end of the work.
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

/// Does the work of a call. `progress` is called with stage, done and total.
pub(crate) fn work<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    job: impl FnOnce(Session<'_>) -> Result<T, Fault> + Send,
) -> PyResult<T> {
    let threads = if rayon::current_thread_index().is_some() {
        // A function of the user, called by a thread of the pool: its other threads may wait for the same.
        single_thread().map_err(|e| e.raise(py))?
    } else {
        pool().map_err(|e| e.raise(py))?
    };
    let monitor = Monitor::default();
    let (outcome, raised) = std::thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let session = Session::new(&threads, &monitor);
            let outcome = catch_unwind(AssertUnwindSafe(|| threads.install(|| job(session))));
            monitor.finish();
            outcome
        });
        let mut raised = None;
        let mut shown = Stage::default();
        while !py.detach(|| monitor.wait()) {
            if raised.is_some() {
                continue;
            }
            let delivered = py
                .check_signals()
                .and_then(|()| report(progress, &monitor.stage(), &mut shown));
            if let Err(e) = delivered {
                raised = Some(e);
                monitor.cancelled.store(true, Ordering::Relaxed);
            }
        }
        (py.detach(|| worker.join()), raised)
    });
    if let Some(e) = raised {
        return Err(e);
    }
    match outcome {
        Ok(Ok(outcome)) => outcome.map_err(|e| e.raise(py)),
        Ok(Err(panic)) | Err(panic) => Err(bug(&*panic).raise(py)),
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

fn bug(panic: &(dyn std::any::Any + Send)) -> Fault {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
    Fault::Text(format!(
        "this is a bug of druse {}: {}",
        env!("CARGO_PKG_VERSION"),
        text.unwrap_or_else(|| "a panic without a message".into())
    ))
}
