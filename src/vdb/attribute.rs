//! Attributes of a surface: one or three values at every active voxel of its band.
//!
//! An attribute is a grid of its own with the active voxels of the level set. It is written beside the level set in a
//! file and is not read back.

use super::error::VdbError;
use super::{LevelSet, Session, ffi};
use crate::frame::WorldPoint;
use crate::progress::Cancelled;
use cxx::UniquePtr;
use rayon::prelude::*;

/// A grid of floats or vectors at the active voxels of a level set; it can only be written.
pub struct Attribute {
    pub(super) grid: UniquePtr<ffi::Grid>,
}

/// Leaves per call of the function.
const GROUP_LEAVES: usize = 64;

impl LevelSet {
    /// Evaluates attributes of 1 or 3 components each at every active voxel. `function` returns all components of all
    /// attributes, point after point; it is called for groups of points, from any thread. One attribute per entry of
    /// `components`, in its order.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB (memory).
    pub fn attributes(
        &self,
        components: &[usize],
        function: impl Fn(&[WorldPoint]) -> Vec<f32> + Sync,
        session: Session<'_>,
    ) -> Result<Vec<Attribute>, VdbError> {
        let leaves = self.leaves()?;
        let order: Vec<usize> = (0..leaves.len()).collect();
        let progress = session.progress;
        let groups: Vec<Vec<f32>> = session.threads.install(|| {
            // Groups of leaves amortise a call of `function`; their order fixes that of the values.
            let groups = order.par_chunks(GROUP_LEAVES).map(|group| {
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
                Ok(function(&points))
            });
            groups.collect::<Result<_, _>>()
        })?;
        drop(leaves);
        let values_per_voxel: usize = components.iter().sum();
        // The values of a voxel lie side by side; each attribute takes its columns.
        let mut start = 0;
        let mut attributes = Vec::with_capacity(components.len());
        for &count in components {
            let mut values = Vec::new();
            for voxel in groups
                .iter()
                .flat_map(|group| group.chunks_exact(values_per_voxel))
            {
                values.extend_from_slice(&voxel[start..start + count]);
            }
            let grid = ffi::grid_attribute(&self.grid, count, &values)
                .map_err(|e| VdbError::plain("making an attribute", &e))?;
            attributes.push(Attribute { grid });
            start += count;
        }
        Ok(attributes)
    }
}
