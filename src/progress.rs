//! Progress and cancelling as one object; threads as a value. The library owns no process state.

/// Receives progress and answers whether to go on. One object serves a whole run.
pub trait Progress: Sync {
    /// A stage begins; `total` is in the stage's own units (blocks, triangles), if known.
    fn stage(&self, name: &str, total: Option<u64>);
    /// `n` more units of the current stage are done. Called from any thread.
    fn advance(&self, n: u64);
    /// Whether the user asked to stop; long work asks at least every 0.1 s.
    fn cancelled(&self) -> bool;
}

/// No display, no cancelling.
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn cancelled(&self) -> bool {
        false
    }
}

/// Work stopped because [`Progress::cancelled`] said so; nothing half-done remains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// A pool of worker threads; its size is also the width given to OpenVDB's own tasks.
pub struct Threads {
    pool: rayon::ThreadPool,
}

impl Threads {
    /// A pool of `count` threads; 0 means one per available core.
    ///
    /// # Errors
    /// When the system refuses the threads.
    pub fn new(count: usize) -> Result<Self, rayon::ThreadPoolBuildError> {
        Ok(Self {
            pool: rayon::ThreadPoolBuilder::new().num_threads(count).build()?,
        })
    }

    /// How many threads there are.
    pub fn count(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Runs `work` inside the pool: rayon iterators in it use these threads.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.pool.install(work)
    }
}
