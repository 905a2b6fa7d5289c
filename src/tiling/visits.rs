//! Which elements of a scaffold an evaluation came near, and what it did there.

use std::sync::atomic::{AtomicU64, Ordering};

/// A set of elements, entered by many threads at once, and a number of leaves.
#[derive(Debug, Default)]
pub struct Visits {
    elements: Vec<AtomicU64>,
    /// Leaves told by nodes.
    leaves: AtomicU64,
}

impl Visits {
    /// None of so many elements.
    pub fn new(elements: usize) -> Self {
        let words = 0..elements.div_ceil(64);
        Self {
            elements: words.map(|_| AtomicU64::new(0)).collect(),
            leaves: AtomicU64::new(0),
        }
    }

    /// Enters an element.
    pub(super) fn enter(&self, element: usize) {
        let bit = 1 << (element % 64);
        if let Some(word) = self.elements.get(element / 64)
            // Most were entered before: a look costs less than a change.
            && word.load(Ordering::Relaxed) & bit == 0
        {
            word.fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// Counts a leaf told by nodes.
    pub(super) fn enter_leaf(&self) {
        self.leaves.fetch_add(1, Ordering::Relaxed);
    }

    /// How many leaves were told by the field at a few nodes, see [`by_nodes`](super::TiledSolid::by_nodes).
    pub fn leaves_by_nodes(&self) -> u64 {
        self.leaves.load(Ordering::Relaxed)
    }

    /// How many elements are in it.
    pub fn count(&self) -> u64 {
        let words = self.elements.iter().map(|w| w.load(Ordering::Relaxed));
        words.map(|w| u64::from(w.count_ones())).sum()
    }

    /// Takes all out.
    pub fn clear(&self) {
        for word in &self.elements {
            word.store(0, Ordering::Relaxed);
        }
        self.leaves.store(0, Ordering::Relaxed);
    }
}
