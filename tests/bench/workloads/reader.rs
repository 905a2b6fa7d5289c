//! A sink that reads every value of every leaf.

use druse::band::{LeafBatch, LeafSink, SinkError};
use druse::frame::Coord;
use std::sync::atomic::{AtomicU64, Ordering};

/// Sums over the data that do not depend on its order.
#[derive(Default)]
pub struct Reader {
    /// What the processor can: what reading takes must not be what a build makes of it.
    arch: pulp::Arch,
    sum: AtomicU64,
    leaves: AtomicU64,
}

/// A number that depends on all values of a leaf.
struct SumOf<'a>(&'a [f32; 512]);

#[allow(clippy::inline_always)]
impl pulp::NullaryFnOnce for SumOf<'_> {
    type Output = u64;

    // No closures: they would be compiled for any processor.
    #[inline(always)]
    fn call(self) -> u64 {
        let mut lanes = [0u32; 64];
        for row in self.0.chunks_exact(64) {
            for (lane, v) in lanes.iter_mut().zip(row) {
                *lane = lane.rotate_left(1).wrapping_add(v.to_bits());
            }
        }
        let mut sum = 0u64;
        for (n, &lane) in lanes.iter().enumerate() {
            sum = sum.wrapping_add(u64::from(lane) << (n as u32 & 31));
        }
        sum
    }
}

impl Reader {
    /// The sum over all leaves, and their number.
    pub fn totals(&self) -> (u64, u64) {
        let load = |a: &AtomicU64| a.load(Ordering::Relaxed);
        (load(&self.sum), load(&self.leaves))
    }

    /// Takes a leaf: a number that depends on its place, its mask and all its values.
    pub fn enter(&self, origin: Coord, mask: &[u64; 8], values: &[f32; 512]) {
        let place = origin.0.iter().fold(0u64, |p, &c| {
            p.wrapping_mul(0x9e37_79b9).wrapping_add(c as u32 as u64)
        });
        let values = self.arch.dispatch(SumOf(values));
        let sum = mask
            .iter()
            .fold(place ^ values, |s, &w| s.rotate_left(5).wrapping_add(w));
        self.sum.fetch_add(sum, Ordering::Relaxed);
        self.leaves.fetch_add(1, Ordering::Relaxed);
    }
}

impl LeafSink for Reader {
    fn block(&self, _: Coord, leaves: &LeafBatch) -> Result<(), SinkError> {
        for n in 0..leaves.len() {
            self.enter(leaves.origins[n], &leaves.masks[n], &leaves.values[n]);
        }
        Ok(())
    }
}
