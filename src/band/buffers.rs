//! Memory that serves again: the buffers of batches and of signs, a stack of each per thread.
//!
//! Fresh memory costs ten times what writing into warm memory does, since the system clears every page
//! of it. A batch is taken for a group of leaves and given back behind it, whatever thread that is
//! on; a stack holds few of them, since a thread works on few blocks at a time.

use super::{LeafBatch, VOXELS};
use std::cell::RefCell;

/// Most buffers that a thread keeps: the batches of two stretches.
const KEPT: usize = 16;

thread_local! {
    static BATCHES: RefCell<Vec<LeafBatch>> = const { RefCell::new(Vec::new()) };
    static SIGNS: RefCell<Vec<Vec<Signs>>> = const { RefCell::new(Vec::new()) };
}

/// What is kept of a leaf for its neighbours: where it is negative.
pub(super) type Signs = [u64; 8];

/// Signs of so many leaves, whatever they hold.
pub(super) fn signs(leaves: usize) -> Vec<Signs> {
    let mut signs = SIGNS.with_borrow_mut(Vec::pop).unwrap_or_default();
    signs.resize(leaves, [0; 8]);
    signs
}

/// Takes signs back.
pub(super) fn give_signs(signs: Vec<Signs>) {
    SIGNS.with_borrow_mut(|kept| {
        if kept.len() < KEPT {
            kept.push(signs);
        }
    });
}

/// A batch without leaves that has room for the values of so many, whatever they hold.
pub(super) fn batch(leaves: usize) -> LeafBatch {
    let mut batch = BATCHES.with_borrow_mut(Vec::pop).unwrap_or_default();
    batch.origins.clear();
    batch.masks.clear();
    batch.values.resize(leaves, [0.0; VOXELS]);
    batch
}

/// Takes a batch back.
pub(super) fn give_batch(batch: LeafBatch) {
    BATCHES.with_borrow_mut(|kept| {
        if kept.len() < KEPT {
            kept.push(batch);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_come_back() {
        let mut lent = batch(100);
        lent.origins.push(crate::frame::Coord([0; 3]));
        let at = lent.values.as_ptr();
        give_batch(lent);
        let again = batch(50);
        assert!(again.is_empty());
        assert_eq!((again.values.as_ptr(), again.values.len()), (at, 50));
    }
}
