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
    /// Asks a function for `N` numbers (1 or 3) at every active voxel, in groups and from any thread.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses (memory).
    pub fn attribute<const N: usize>(
        &self,
        numbers: impl Fn(&[WorldPoint]) -> Vec<[f32; N]> + Sync,
        session: Session<'_>,
    ) -> Result<Attribute, VdbError> {
        let leaves = self.leaves()?;
        let order: Vec<usize> = (0..leaves.len()).collect();
        let progress = session.progress;
        let groups: Vec<Vec<[f32; N]>> = session.threads.install(|| {
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
                Ok(numbers(&points))
            });
            groups.collect::<Result<_, _>>()
        })?;
        drop(leaves);
        let values: Vec<[f32; N]> = groups.into_iter().flatten().collect();
        let grid = ffi::grid_attribute(&self.grid, N, values.as_flattened())
            .map_err(|e| VdbError::plain("making an attribute", &e))?;
        Ok(Attribute { grid })
    }
}
