//! Merging of solids that touch in a plane of voxels.
//!
//! A Boolean operation of solids that share a face leaves zeros in the plane of that face, which count as outside and
//! part them. They get the values that [`leaf_contacts`] finds, those of a neighbour.

use super::error::VdbError;
use super::smooth::{leaf_batches, leaf_of, write_leaves};
use super::{LevelSet, Session};
use crate::band::{LEAF, LeafBatch};
use crate::field::leaf_contacts;
use crate::frame::Coord;

impl LevelSet {
    /// Gives voxels in a contact plane of two solids the value that they would have without the contact, as the
    /// band does for a sampled union. After a cancellation the level set is empty, since without this step it is no
    /// whole union.
    pub(super) fn merge_contacts(
        &mut self,
        operation: &'static str,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let merged = session.threads.install(|| self.merged_leaves(session));
        let merged = merged.or_else(|e| self.clear().and(Err(e)))?;
        if merged.iter().all(LeafBatch::is_empty) {
            return Ok(());
        }
        self.change(operation, session, |mut grid, _| {
            merged
                .iter()
                .try_for_each(|batch| write_leaves(grid.as_mut(), batch))
        })
    }

    /// The leaves with contact planes, after merging. The batches hold only leaves that change.
    fn merged_leaves(&self, session: Session<'_>) -> Result<Vec<LeafBatch>, VdbError> {
        let leaves = self.leaves()?;
        let origins: Vec<Coord> = leaves.iter().map(|l| l.origin).collect();
        let (step, background) = (self.voxel_size() as f32, self.background() as f32);
        let merge_leaf = |n: usize, batch: &mut LeafBatch| {
            let this_leaf = leaf_of(&leaves, n);
            let Some(values) = this_leaf.values.first_chunk() else {
                return;
            };
            // Absent leaves are tiles: the background, with the sign of the voxel one step inside this leaf. The
            // outermost voxel may be on the contact, where its sign means nothing.
            let layer = |axis: usize, side: usize| {
                let mut origin = this_leaf.origin;
                origin.0[axis] += if side == 0 { -LEAF } else { LEAF };
                let other = origins.binary_search(&origin).ok();
                let other = other.map(|n| leaf_of(&leaves, n).values);
                std::array::from_fn(|m| {
                    let mut voxel = [m >> 3, m & 7, 0];
                    voxel[axis..].rotate_right(1);
                    let at = |along: usize| {
                        let mut voxel = voxel;
                        voxel[axis] = along;
                        voxel[0] << 6 | voxel[1] << 3 | voxel[2]
                    };
                    match (other, side) {
                        (Some(other), 0) => other[at(7)],
                        (Some(other), _) => other[at(0)],
                        (None, 0) => background.copysign(this_leaf.values[at(1)]),
                        (None, _) => background.copysign(this_leaf.values[at(6)]),
                    }
                })
            };
            let contacts = leaf_contacts(values, step, layer);
            if contacts.is_empty() {
                return;
            }
            let (mut values, mut mask) = (*values, this_leaf.mask);
            for (n, value) in contacts {
                values[n] = value;
                if value.abs() < background {
                    mask[n >> 6] |= 1 << (n & 63);
                }
            }
            batch.push(this_leaf.origin, mask, &values);
        };
        let all: Vec<usize> = (0..leaves.len()).collect();
        leaf_batches(&all, session, merge_leaf)
    }
}
