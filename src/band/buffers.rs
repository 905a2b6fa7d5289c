//! Buffer pools: leaf batches and sign words are reused, one stack of each per thread.
//!
//! The system clears every page of fresh memory, which costs ten times as much as a write to warm memory.
//! A batch is taken for a group of leaves and recycled afterwards, on whatever thread that happens. A
//! thread works on few blocks at a time, so that few buffers suffice.

use super::{LeafBatch, VOXELS};
use std::cell::RefCell;

/// Greatest number of buffers in a thread's pool: the batches of two slabs.
const MAX_POOLED_BUFFERS: usize = 16;

thread_local! {
    static BATCHES: RefCell<Vec<LeafBatch>> = const { RefCell::new(Vec::new()) };
    static SIGNS: RefCell<Vec<Vec<Signs>>> = const { RefCell::new(Vec::new()) };
}

/// The negative voxels of a leaf, laid out as its mask.
pub(super) type Signs = [u64; 8];

/// Signs of `leaves` leaves with unspecified contents.
pub(super) fn take_signs(leaves: usize) -> Vec<Signs> {
    let mut signs = SIGNS.with_borrow_mut(Vec::pop).unwrap_or_default();
    signs.resize(leaves, [0; 8]);
    signs
}

/// Returns signs to the pool.
pub(super) fn recycle_signs(signs: Vec<Signs>) {
    SIGNS.with_borrow_mut(|pool| {
        if pool.len() < MAX_POOLED_BUFFERS {
            pool.push(signs);
        }
    });
}

/// A batch without leaves; `values` has room for `leaves` leaves with unspecified contents.
pub(super) fn take_batch(leaves: usize) -> LeafBatch {
    let mut batch = BATCHES.with_borrow_mut(Vec::pop).unwrap_or_default();
    batch.origins.clear();
    batch.masks.clear();
    batch.values.resize(leaves, [0.0; VOXELS]);
    batch
}

/// Returns a batch to the pool.
pub(super) fn recycle_batch(batch: LeafBatch) {
    BATCHES.with_borrow_mut(|pool| {
        if pool.len() < MAX_POOLED_BUFFERS {
            pool.push(batch);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recycled_buffers_are_reused() {
        let mut first = take_batch(100);
        first.origins.push(crate::frame::Coord([0; 3]));
        let address = first.values.as_ptr();
        recycle_batch(first);
        let second = take_batch(50);
        assert!(second.is_empty());
        assert_eq!((second.values.as_ptr(), second.values.len()), (address, 50));
    }
}
