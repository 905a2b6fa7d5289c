//! A cache of values by position: the first request computes a value, the least recently used ones are dropped.
//!
//! Each value is behind its own lock, so that one thread computes it while others that need it wait, and threads with
//! other positions go on. A value in use stays alive after it is dropped from the cache.

use druse_geometry::frame::Coord;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A value that the first request computes.
pub(super) type SharedValue<T> = Arc<OnceLock<T>>;

/// A cache of values by position. The least recently used ones are dropped when all take too much memory.
pub(super) struct PositionCache<T> {
    state: Mutex<State<T>>,
    /// Values kept per thread, whatever their memory.
    per_thread: usize,
    /// Memory limit beyond those, bytes.
    most: usize,
    bytes: fn(&T) -> usize,
}

struct State<T> {
    /// Values by position, with the number of their last request.
    things: HashMap<Coord, (u64, SharedValue<T>)>,
    requests: u64,
}

impl<T> PositionCache<T> {
    /// An empty cache; `bytes` returns the memory of a value.
    pub fn new(per_thread: usize, most: usize, bytes: fn(&T) -> usize) -> Self {
        let state = State {
            things: HashMap::new(),
            requests: 0,
        };
        Self {
            state: Mutex::new(state),
            per_thread,
            most,
            bytes,
        }
    }

    /// The value at a position. `make` must not wait for other threads except through this cache, hence use no
    /// parallel iterators: a thread that waits here could be the one that computes the value.
    pub fn get(&self, place: Coord, make: impl FnOnce() -> T) -> SharedValue<T> {
        let made = self.entry(place);
        made.get_or_init(make);
        made
    }

    fn entry(&self, place: Coord) -> SharedValue<T> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.requests += 1;
        if !state.things.contains_key(&place) {
            let least = self.per_thread * rayon::current_num_threads();
            while state.things.len() >= least && self.sum(&state) > self.most {
                let oldest = state.things.iter().min_by_key(|(_, (last, _))| *last);
                let Some(oldest) = oldest.map(|(place, _)| *place) else {
                    break;
                };
                state.things.remove(&oldest);
            }
        }
        let now = state.requests;
        let entry = state.things.entry(place).or_default();
        entry.0 = now;
        Arc::clone(&entry.1)
    }

    /// Memory of the computed values.
    fn sum(&self, state: &State<T>) -> usize {
        let made = state.things.values();
        let made = made.filter_map(|(_, thing)| thing.get());
        made.map(self.bytes).sum()
    }
}
