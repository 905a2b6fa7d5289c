//! Sinks in memory: one counts leaves, one collects them by origin.
//!
//! Both accept batches from any thread and never fail. The order of the batches leaves no trace in the result.

use super::{LeafBatch, LeafSink, SinkError, VOXELS};
use druse_geometry::frame::Coord;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Numbers of batches, leaves and active voxels received by a sink.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeafCounts {
    /// Batches, each of leaves of one block.
    pub batches: u64,
    /// Leaves.
    pub leaves: u64,
    /// Active voxels.
    pub active_voxels: u64,
}

/// A sink that only counts.
#[derive(Default)]
pub struct LeafCounter(Mutex<LeafCounts>);

impl LeafCounter {
    /// The counts so far.
    pub fn counts(&self) -> LeafCounts {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LeafSink for LeafCounter {
    fn block(&self, _: Coord, leaves: &LeafBatch) -> Result<(), SinkError> {
        let mut counts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        counts.batches += 1;
        counts.leaves += leaves.len() as u64;
        counts.active_voxels += leaves.active_voxels();
        Ok(())
    }
}

/// A leaf: its mask of active voxels and its values.
pub type Leaf = ([u64; 8], [f32; VOXELS]);

/// A sink that collects all leaves by origin.
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
