//! Memory that serves again: the buffers of blocks and batches, one stack of them per thread.
//!
//! Fresh memory costs ten times what writing into warm memory does, since the system clears every page
//! of it. A buffer is taken for a block and given back behind it, whatever thread that is on; a stack
//! holds few of them, since a thread works on few blocks at a time.

use super::{LeafBatch, VOXELS};
use std::cell::RefCell;

/// Most buffers that a thread keeps.
const KEPT: usize = 4;

thread_local! {
    static VALUES: RefCell<Vec<Vec<[f32; VOXELS]>>> = const { RefCell::new(Vec::new()) };
    static BATCHES: RefCell<Vec<LeafBatch>> = const { RefCell::new(Vec::new()) };
}

/// Values of at least so many leaves, whatever they hold.
pub(super) fn values(leaves: usize) -> Vec<[f32; VOXELS]> {
    let mut values = VALUES.with_borrow_mut(Vec::pop).unwrap_or_default();
    if values.len() < leaves {
        values.resize(leaves, [0.0; VOXELS]);
    }
    values
}

/// Takes values back.
pub(super) fn give_values(values: Vec<[f32; VOXELS]>) {
    VALUES.with_borrow_mut(|kept| {
        if kept.len() < KEPT {
            kept.push(values);
        }
    });
}

/// An empty batch.
pub(super) fn batch() -> LeafBatch {
    let mut batch = BATCHES.with_borrow_mut(Vec::pop).unwrap_or_default();
    batch.clear();
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
        let first = values(100);
        let at = first.as_ptr();
        give_values(first);
        let again = values(50);
        assert_eq!((again.as_ptr(), again.len()), (at, 100));
        let mut lent = batch();
        lent.push(crate::frame::Coord([0; 3]), [1; 8], &[0.5; VOXELS]);
        let at = lent.values.as_ptr();
        give_batch(lent);
        let again = batch();
        assert!(again.is_empty());
        assert_eq!(again.values.as_ptr(), at);
    }
}
