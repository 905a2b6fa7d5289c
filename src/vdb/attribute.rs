//! Numbers that go with a surface: one or three at every voxel of its band, to shade it by.

use super::{LevelSet, Session, VdbError, ffi};
use crate::frame::WorldPoint;
use crate::progress::Cancelled;
use cxx::UniquePtr;
use rayon::prelude::*;

/// A grid of floats or of vectors on the voxels of a level set's band; only to be written.
pub struct Attribute {
    pub(super) grid: UniquePtr<ffi::Grid>,
}

/// Leaves that one call of the function is asked for.
const GROUP: usize = 64;

impl LevelSet {
    /// Attributes of so many numbers each (1 or 3): a function gives all of them at points, one after the
    /// other, and is asked at every active voxel, in groups and from any thread.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses (memory).
    pub fn attributes(
        &self,
        components: &[usize],
        numbers: impl Fn(&[WorldPoint]) -> Vec<f32> + Sync,
        session: Session<'_>,
    ) -> Result<Vec<Attribute>, VdbError> {
        let leaves = self.leaves()?;
        let order: Vec<usize> = (0..leaves.len()).collect();
        let progress = session.progress;
        let groups: Vec<Vec<f32>> = session.threads.install(|| {
            let groups = order.par_chunks(GROUP).map(|group| {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                let mut points = Vec::new();
                for leaf in group.iter().filter_map(|&n| leaves.get(n)) {
                    let active = (0..512).filter(|&n| leaf.is_active(n));
                    points.extend(active.map(|n| {
                        let p = self.transform.world(leaf.voxel(n)).0 + self.origin;
                        WorldPoint(p)
                    }));
                }
                progress.advance(group.len() as u64);
                Ok(numbers(&points))
            });
            groups.collect::<Result<_, _>>()
        })?;
        drop(leaves);
        let row: usize = components.iter().sum();
        let mut start = 0;
        let mut made = Vec::with_capacity(components.len());
        for &count in components {
            let mut values = Vec::new();
            for numbers in groups.iter().flat_map(|group| group.chunks_exact(row)) {
                values.extend_from_slice(&numbers[start..start + count]);
            }
            let grid = ffi::grid_attribute(&self.grid, count, &values)
                .map_err(|e| VdbError::plain("making an attribute", &e))?;
            made.push(Attribute { grid });
            start += count;
        }
        Ok(made)
    }
}
