//! Memory that serves again: the buffers of batches, one stack of them per thread.
//!
//! Fresh memory costs ten times what writing into warm memory does, since the system clears every page
//! of it. A batch is taken for a stretch of leaves and given back behind it, whatever thread that is
//! on; a stack holds few of them, since a thread works on few blocks at a time.

use super::{LeafBatch, VOXELS};
use std::cell::RefCell;

/// Most buffers that a thread keeps.
const KEPT: usize = 4;

thread_local! {
    static BATCHES: RefCell<Vec<LeafBatch>> = const { RefCell::new(Vec::new()) };
}

/// A batch without origins and masks that has room for so many leaves' values, whatever they hold.
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
