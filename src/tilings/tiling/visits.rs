//! The elements that an evaluation visited, and the number of leaves that it interpolated.
//!
//! Threads add to it without locks. It records the elements near the samples of bulk evaluation, not those of single
//! points.

use std::sync::atomic::{AtomicU64, Ordering};

/// A set of elements and a count of leaves, written by many threads.
#[derive(Debug, Default)]
pub struct Visits {
    elements: Vec<AtomicU64>,
    /// Interpolated leaves.
    leaves: AtomicU64,
}

impl Visits {
    /// An empty set for a scaffold of `elements` elements.
    pub fn new(elements: usize) -> Self {
        let words = 0..elements.div_ceil(64);
        Self {
            elements: words.map(|_| AtomicU64::new(0)).collect(),
            leaves: AtomicU64::new(0),
        }
    }

    /// Adds an element.
    pub(super) fn insert(&self, element: usize) {
        let bit = 1 << (element % 64);
        if let Some(word) = self.elements.get(element / 64)
            // Most elements are present already, and a load is cheaper than a write.
            && word.load(Ordering::Relaxed) & bit == 0
        {
            word.fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// Counts an interpolated leaf.
    pub(super) fn count_leaf(&self) {
        self.leaves.fetch_add(1, Ordering::Relaxed);
    }

    /// Number of interpolated leaves, see [`with_interpolation`](super::TiledSolid::with_interpolation).
    pub fn interpolated_leaves(&self) -> u64 {
        self.leaves.load(Ordering::Relaxed)
    }

    /// Number of elements.
    pub fn count(&self) -> u64 {
        let words = self.elements.iter().map(|w| w.load(Ordering::Relaxed));
        words.map(|w| u64::from(w.count_ones())).sum()
    }

    /// Removes all elements and leaves.
    pub fn clear(&self) {
        for word in &self.elements {
            word.store(0, Ordering::Relaxed);
        }
        self.leaves.store(0, Ordering::Relaxed);
    }
}
