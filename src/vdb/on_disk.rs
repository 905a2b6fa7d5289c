//! Connected components of a solid on disk: counted and removed, as in memory.
//!
//! Each block of 128^3 voxels is labelled separately, from the parts of its leaves and the empty cubes of
//! 8^3 voxels between them. Labels are united over the faces of blocks, slab by slab, and with the empty cubes around
//! them, which are labelled per node of 4096^3 voxels. Memory holds a few bytes per label, and per leaf while
//! components are selected.

use super::components::{Component, ComponentStats, Ranking, Side, UNBOUNDED_PLACE};
use super::error::{FileError, VdbError};
use super::remove_components::{ComponentSelection, RemovedComponents};
use super::{LevelSet, Session};
use crate::band::{BLOCK, LeafStore, Region, StoreError};
use crate::frame::Coord;
use crate::mesher::inside_below;
use crate::progress::Cancelled;
use crate::union_find::UnionFind;
use rayon::prelude::*;
use std::collections::BTreeMap;

mod empty_space;
mod labels;
mod removal;
mod segments;

pub use segments::StoredSegments;

use empty_space::{EmptyCube, EmptySpace};
use labels::{Faces, Labels, label};
use removal::SelectedParts;

/// The components of a store, ranked.
struct StoredComponents {
    ranking: Ranking,
    /// For each block its first label and, if kept, the labels of its leaves.
    blocks: BTreeMap<Coord, (usize, Labels)>,
}

/// Whether the labels of leaves stay in memory.
#[derive(Clone, Copy, PartialEq, Eq)]
enum BlockLabels {
    /// For removals and segments, which select voxels by them.
    Kept,
    /// For counts.
    Dropped,
}

impl StoredComponents {
    /// Finds the components of a side. Blocks are labelled slab by slab along x, and joined to the blocks before them
    /// and to empty cubes; two slabs are in memory at once. `voxel_size` is in world units. With [`BlockLabels::Kept`]
    /// the labels of leaves stay, and rounding of 0 counts by its sign.
    fn find(
        store: &LeafStore,
        side: Side,
        voxel_size: f64,
        labels: BlockLabels,
        session: Session<'_>,
    ) -> Result<Self, FileError> {
        let progress = session.progress;
        // Removals, which keep the labels, and voids, whose places drains begin at, need the sign alone; bodies are
        // those of the mesh.
        let is_kept = labels == BlockLabels::Kept;
        let threshold = if is_kept || side == Side::Void {
            0.0
        } else {
            inside_below(voxel_size)
        };
        progress.stage("components", Some(store.blocks().count() as u64));
        // Members of the sets: the outside, empty cubes, then the labels of all blocks.
        let mut sets = UnionFind::new(1);
        let unbounded = (side == Side::Void).then_some(0);
        let mut stats = vec![ComponentStats {
            place: unbounded.map(|_| UNBOUNDED_PLACE),
            ..ComponentStats::default()
        }];
        let empty = EmptySpace::new(store, side, &mut sets, &mut stats);
        let mut blocks = BTreeMap::new();
        let mut previous: BTreeMap<Coord, (usize, Faces)> = BTreeMap::new();
        let origins: Vec<Coord> = store.blocks().collect();
        for slab in origins.chunk_by(|a, b| a[0] == b[0]) {
            let labelled = session.threads.install(|| {
                let found = slab.par_iter().map(|&origin| {
                    if progress.cancelled() {
                        return Err(StoreError::from(Cancelled));
                    }
                    progress.advance(1);
                    Ok(label(store, origin, side, threshold)?)
                });
                found.collect::<Result<Vec<_>, StoreError>>()
            })?;
            let mut current: BTreeMap<Coord, (usize, Faces)> = BTreeMap::new();
            for (&origin, block) in slab.iter().zip(labelled) {
                let first = sets.extend(block.stats.len());
                stats.extend(block.stats);
                if is_kept {
                    blocks.insert(origin, (first, block.labels));
                }
                let block_faces = (first, block.faces);
                for axis in 0..3 {
                    for last in [false, true] {
                        let neighbour = step(origin, axis, last, BLOCK);
                        if store.inside_slots(neighbour).is_none() {
                            if let EmptyCube::Member(other) = empty.at(neighbour) {
                                for item in block_faces.1.of(axis, last) {
                                    sets.union(first + item.label as usize, other);
                                }
                            }
                        } else if !last {
                            // Blocks before this one are labelled already.
                            let slab = if axis == 0 { &previous } else { &current };
                            if let Some((other_first, other)) = slab.get(&neighbour) {
                                block_faces.1.join(axis, other, |mine, theirs| {
                                    sets.union(first + mine, other_first + theirs);
                                });
                            }
                        }
                    }
                }
                current.insert(origin, block_faces);
            }
            previous = current;
        }
        Ok(Self {
            ranking: Ranking::new(&stats, &mut sets, unbounded, voxel_size),
            blocks,
        })
    }
}

/// Origin of the neighbour of a cube of `edge` voxels across its first or last face on an axis.
fn step(origin: Coord, axis: usize, last: bool, edge: i32) -> Coord {
    let mut neighbour = origin;
    neighbour.0[axis] += if last { edge } else { -edge };
    neighbour
}

/// The connected components of a solid on disk, largest first, as [`LevelSet::components`] returns them.
///
/// # Errors
/// A changed leaf file, or cancellation.
pub fn stored_components(
    store: &LeafStore,
    voxel_size: f64,
    session: Session<'_>,
) -> Result<Vec<Component>, FileError> {
    let found = StoredComponents::find(
        store,
        Side::Solid,
        voxel_size,
        BlockLabels::Dropped,
        session,
    )?;
    Ok(found.ranking.counted())
}

/// The voids of a solid on disk, largest first, as [`LevelSet::voids`] returns them.
///
/// # Errors
/// A changed leaf file, or cancellation.
pub fn stored_voids(
    store: &LeafStore,
    voxel_size: f64,
    session: Session<'_>,
) -> Result<Vec<Component>, FileError> {
    let found =
        StoredComponents::find(store, Side::Void, voxel_size, BlockLabels::Dropped, session)?;
    Ok(found.ranking.counted())
}

/// Components of a solid on disk to be removed, part by part.
pub struct StoredRemoval {
    selected: SelectedParts,
    removed: RemovedComponents,
}

impl StoredRemoval {
    /// Finds the components to remove, as [`LevelSet::remove`] does.
    ///
    /// # Errors
    /// A changed leaf file, or cancellation.
    pub fn choose(
        store: &LeafStore,
        selection: ComponentSelection,
        voxel_size: f64,
        session: Session<'_>,
    ) -> Result<Self, FileError> {
        let side = selection.side();
        let found = StoredComponents::find(store, side, voxel_size, BlockLabels::Kept, session)?;
        let (is_removed, removed) = selection.apply(&found.ranking);
        let mut selected = SelectedParts::new(side);
        for &block in found.blocks.keys() {
            selected.add_block(&found, block, |component| {
                is_removed.get(component) == Some(&true)
            });
        }
        Ok(Self { selected, removed })
    }

    /// Number and volume of the removed components.
    pub fn removed(&self) -> RemovedComponents {
        self.removed
    }

    /// Whether a block with removed parts overlaps a region.
    pub fn meets(&self, region: Region) -> bool {
        let mut blocks = self.selected.blocks.iter();
        blocks.any(|&block| region.meets(block, BLOCK))
    }

    /// Removes the components from a part of the solid whose voxel (0, 0, 0) is voxel `first` of the whole.
    /// The part must extend [`REMOVAL_REACH`](super::remove_components::REMOVAL_REACH) half widths beyond the region
    /// that is used afterwards. Only its band is valid afterwards, not the signs beyond.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn apply(
        &self,
        part: &mut LevelSet,
        first: Coord,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        self.selected.remove(part, first, session)
    }
}
