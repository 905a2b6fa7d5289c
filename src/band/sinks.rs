//! Sinks without OpenVDB: counting, and keeping everything.

use super::{LeafBatch, LeafSink, SinkError, VOXELS};
use crate::frame::Coord;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Counts of what came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// Batches.
    pub batches: u64,
    /// Leaves.
    pub leaves: u64,
    /// Active voxels.
    pub active_voxels: u64,
}

/// A sink that counts.
#[derive(Default)]
pub struct Statistics(Mutex<Totals>);

impl Statistics {
    /// The counts so far.
    pub fn totals(&self) -> Totals {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LeafSink for Statistics {
    fn block(&self, _: Coord, leaves: &LeafBatch) -> Result<(), SinkError> {
        let mut t = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        t.batches += 1;
        t.leaves += leaves.len() as u64;
        t.active_voxels += leaves.active_voxels();
        Ok(())
    }
}

/// A leaf: its mask of active voxels and its values.
pub type Leaf = ([u64; 8], [f32; VOXELS]);

/// A sink that keeps all leaves, by origin.
#[derive(Default)]
pub struct LeafMap(Mutex<BTreeMap<Coord, Leaf>>);

impl LeafMap {
    /// The leaves, in order of origin.
    pub fn into_leaves(self) -> BTreeMap<Coord, Leaf> {
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LeafSink for LeafMap {
    fn block(&self, _: Coord, leaves: &LeafBatch) -> Result<(), SinkError> {
        let mut map = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for n in 0..leaves.len() {
            map.insert(leaves.origins[n], (leaves.masks[n], leaves.values[n]));
        }
        Ok(())
    }
}
