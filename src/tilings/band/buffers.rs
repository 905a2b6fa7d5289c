//! Keeps the buffers of evaluated leaves for reuse, in pools of each thread.
//!
//! A band is evaluated by blocks of 16^3 leaves. A block has one buffer of signs, and is divided along x into slabs of
//! at most 256 leaves. A slab is divided into 8 batches of at most 32 leaves, each with a buffer of values.
//!
//! The system clears every page of fresh memory, which costs ten times as much as a write to memory in the caches. A
//! buffer goes to the pool of the thread that returns it, which need not be the one that took it. Buffers that find
//! the pool full are dropped.

use super::{LeafBatch, VOXELS};
use std::cell::RefCell;

/// Greatest number of buffers in a pool: the batches of two slabs, since a slab is complete only after the next one.
const MAX_POOLED_BUFFERS: usize = 16;

thread_local! {
    static BATCHES: RefCell<Vec<LeafBatch>> = const { RefCell::new(Vec::new()) };
    static SIGNS: RefCell<Vec<Vec<Signs>>> = const { RefCell::new(Vec::new()) };
}

/// The negative voxels of a leaf: voxel (x, y, z) has bit 8 y + z of word x, as in the mask of active voxels.
pub(super) type Signs = [u64; 8];

/// Signs of `leaf_count` leaves with unspecified contents.
pub(super) fn take_signs(leaf_count: usize) -> Vec<Signs> {
    let mut signs = SIGNS.with_borrow_mut(Vec::pop).unwrap_or_default();
    signs.resize(leaf_count, [0; 8]);
    signs
}

/// Returns signs to the pool of this thread.
pub(super) fn recycle_signs(signs: Vec<Signs>) {
    SIGNS.with_borrow_mut(|pool| {
        if pool.len() < MAX_POOLED_BUFFERS {
            pool.push(signs);
        }
    });
}

/// A batch without origins and masks, but with values of `leaf_count` leaves whose contents are unspecified.
pub(super) fn take_batch(leaf_count: usize) -> LeafBatch {
    let mut batch = BATCHES.with_borrow_mut(Vec::pop).unwrap_or_default();
    batch.origins.clear();
    batch.masks.clear();
    batch.values.resize(leaf_count, [0.0; VOXELS]);
    batch
}

/// Returns a batch to the pool of this thread.
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
        first.origins.push(druse_geometry::frame::Coord([0; 3]));
        let address = first.values.as_ptr();
        recycle_batch(first);
        let second = take_batch(50);
        assert!(second.is_empty());
        assert_eq!((second.values.as_ptr(), second.values.len()), (address, 50));
    }
}
