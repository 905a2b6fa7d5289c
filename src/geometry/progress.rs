//! Progress, cancellation and thread pools, passed as values: none of them is state of the process.
//!
//! The caller owns the object that receives progress and the pool; work borrows both. Cancellation is cooperative: work
//! checks it and returns [`Cancelled`], and leaves no partial result. Not promised: units of a stage may take unlike
//! times, and a stage may end before its total; parallel loops outside [`Threads::install`] run in rayon's own pool.
//!
//! ```
//! # extern crate druse_geometry as druse;
//! use druse::progress::{Cancelled, Progress, Threads};
//! use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
//! struct UpToThree(AtomicU64);
//! impl Progress for UpToThree {
//!     fn stage(&self, _: &str, _: Option<u64>) {}
//!     fn advance(&self, n: u64) { self.0.fetch_add(n, Relaxed); }
//!     fn cancelled(&self) -> bool { self.0.load(Relaxed) >= 3 }
//! }
//! let units = UpToThree(AtomicU64::new(0));
//! let unit = |_| if units.cancelled() { Err(Cancelled) } else { Ok(units.advance(1)) };
//! let work = Threads::new(2).unwrap().install(|| (0..10).try_for_each(unit));
//! assert_eq!((work, units.0.into_inner()), (Err(Cancelled), 3));
//! ```

/// Receives progress and reports cancellation. One object serves a whole run.
pub trait Progress: Sync {
    /// A stage begins; `total` counts the stage's units of work (blocks, triangles), if known.
    fn stage(&self, name: &str, total: Option<u64>);
    /// Another `n` units of the current stage are done. Any thread may call this.
    fn advance(&self, n: u64);
    /// Whether the user has cancelled the run; long work checks at least every 0.1 s.
    fn cancelled(&self) -> bool;
}

/// A [`Progress`] that displays nothing and never cancels.
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn cancelled(&self) -> bool {
        false
    }
}

/// A [`Progress`] that forwards cancellation and hides stages, for work that is one unit of a stage.
pub struct CancelOnly<'a>(pub &'a dyn Progress);

impl Progress for CancelOnly<'_> {
    fn stage(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

/// The error of work that stopped because [`Progress::cancelled`] returned true; no partial result remains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// A pool of worker threads; its size also limits the threads of OpenVDB.
pub struct Threads {
    pool: rayon::ThreadPool,
}

impl Threads {
    /// A pool of `count` threads; 0 means one per available core.
    ///
    /// # Errors
    /// When the system cannot create the threads.
    pub fn new(count: usize) -> Result<Self, rayon::ThreadPoolBuildError> {
        Ok(Self {
            pool: rayon::ThreadPoolBuilder::new().num_threads(count).build()?,
        })
    }

    /// The number of threads.
    pub fn count(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Runs `work` in the pool: its rayon iterators use these threads.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.pool.install(work)
    }
}
