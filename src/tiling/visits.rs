//! Which elements of a scaffold an evaluation came near.

use std::sync::atomic::{AtomicU64, Ordering};

/// A set of elements, entered by many threads at once.
#[derive(Debug, Default)]
pub struct Visits(Vec<AtomicU64>);

impl Visits {
    /// None of so many elements.
    pub fn new(elements: usize) -> Self {
        Self(
            (0..elements.div_ceil(64))
                .map(|_| AtomicU64::new(0))
                .collect(),
        )
    }

    /// Enters an element.
    pub(super) fn enter(&self, element: usize) {
        let bit = 1 << (element % 64);
        if let Some(word) = self.0.get(element / 64)
            // Most were entered before: a look costs less than a change.
            && word.load(Ordering::Relaxed) & bit == 0
        {
            word.fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// How many elements are in it.
    pub fn count(&self) -> u64 {
        let words = self.0.iter().map(|w| w.load(Ordering::Relaxed));
        words.map(|w| u64::from(w.count_ones())).sum()
    }

    /// Takes all out.
    pub fn clear(&self) {
        for word in &self.0 {
            word.store(0, Ordering::Relaxed);
        }
    }
}
