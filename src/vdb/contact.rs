//! Level sets that touch in a plane of voxels become one solid.

use super::smooth::{leaf_of, put};
use super::{LevelSet, Session, VdbError};
use crate::band::{LEAF, LeafBatch};
use crate::field::leaf_contacts;
use crate::frame::Coord;
use crate::progress::Cancelled;
use rayon::prelude::*;

/// Leaves that a thread takes at a time, between two looks at whether the user asked to stop.
const CHUNK: usize = 256;

impl LevelSet {
    /// Gives voxels that lie on a contact of two solids the value that they have without it, as the band
    /// does when it samples a union.
    pub(super) fn join_contacts(
        &mut self,
        doing: &'static str,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let joined = session.threads.install(|| self.joined_leaves(session))?;
        if joined.iter().all(LeafBatch::is_empty) {
            return Ok(());
        }
        self.change(doing, session, |mut grid, _| {
            joined
                .iter()
                .try_for_each(|batch| put(grid.as_mut(), batch))
        })
    }

    /// The leaves that have contacts, joined.
    fn joined_leaves(&self, session: Session<'_>) -> Result<Vec<LeafBatch>, VdbError> {
        let leaves = self.leaves()?;
        let origins: Vec<Coord> = leaves.iter().map(|l| l.origin).collect();
        let (step, background) = (self.voxel_size() as f32, self.background() as f32);
        let one = |n: usize, batch: &mut LeafBatch| {
            let own = leaf_of(&leaves, n);
            let Some(values) = own.values.first_chunk() else {
                return;
            };
            // Beyond the leaves there are tiles, whose voxels are no shallower than the nearest one here.
            let layer = |axis: usize, side: usize| {
                let mut origin = own.origin;
                origin.0[axis] += if side == 0 { -LEAF } else { LEAF };
                let other = origins.binary_search(&origin).ok();
                let other = other.map(|n| leaf_of(&leaves, n).values);
                std::array::from_fn(|m| {
                    let mut place = [m >> 3, m & 7, 0];
                    place[axis..].rotate_right(1);
                    let at = |along: usize| {
                        let mut place = place;
                        place[axis] = along;
                        place[0] << 6 | place[1] << 3 | place[2]
                    };
                    match (other, side) {
                        (Some(other), 0) => other[at(7)],
                        (Some(other), _) => other[at(0)],
                        (None, 0) => background.copysign(own.values[at(1)]),
                        (None, _) => background.copysign(own.values[at(6)]),
                    }
                })
            };
            let contacts = leaf_contacts(values, step, layer);
            if contacts.is_empty() {
                return;
            }
            let (mut values, mut mask) = (*values, own.mask);
            for (n, value) in contacts {
                values[n] = value;
                if value.abs() < background {
                    mask[n >> 6] |= 1 << (n & 63);
                }
            }
            batch.push(own.origin, mask, &values);
        };
        let all: Vec<usize> = (0..leaves.len()).collect();
        all.par_chunks(CHUNK)
            .map(|chunk| {
                if session.progress.cancelled() {
                    return Err(VdbError::Cancelled(Cancelled));
                }
                let mut batch = LeafBatch::default();
                for &n in chunk {
                    one(n, &mut batch);
                }
                Ok(batch)
            })
            .collect()
    }
}
