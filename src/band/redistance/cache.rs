//! A cache of values by position: the first request computes a value, the least recently used ones are dropped.

use crate::frame::Coord;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A thing that is made by the first who asks for it.
pub(super) type Made<T> = Arc<OnceLock<T>>;

/// A cache of values by position. The least recently used ones are dropped when all take too much memory.
pub(super) struct Kept<T> {
    state: Mutex<State<T>>,
    /// How many are kept for each thread, whatever memory they take.
    per_thread: usize,
    /// Memory that more than those may take, bytes.
    most: usize,
    bytes: fn(&T) -> usize,
}

struct State<T> {
    /// With the number of the last request.
    things: HashMap<Coord, (u64, Made<T>)>,
    requests: u64,
}

impl<T> Kept<T> {
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

    /// What belongs to a place. `make` must wait for no other thread than by asking for something kept: no
    /// parallel iterators, else a thread that waits here could be the one that makes it.
    pub fn get(&self, place: Coord, make: impl FnOnce() -> T) -> Made<T> {
        let made = self.entry(place);
        made.get_or_init(make);
        made
    }

    fn entry(&self, place: Coord) -> Made<T> {
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

    /// Memory of what is made.
    fn sum(&self, state: &State<T>) -> usize {
        let made = state.things.values();
        let made = made.filter_map(|(_, thing)| thing.get());
        made.map(self.bytes).sum()
    }
}
