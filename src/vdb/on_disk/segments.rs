//! The connected components of a solid on disk as separate solids: each is made by removal of the others.
//!
//! The components are found once, with the labels of all leaves in memory. A segment is then made part by part: the
//! caller reads a part of the solid and removes the others from it. Lengths are in voxels unless a unit is named.

use super::super::components::Side;
use super::super::remove_components::band_leaves;
use super::super::segments::neighbourhood_edge;
use super::super::{LevelSet, Session};
use super::removal::{SelectedParts, leaf_at};
use super::{BlockLabels, StoredComponents};
use crate::band::{BLOCK, LEAF, LeafStore, Region};
use crate::frame::Coord;
use crate::vdb::error::{FileError, VdbError};
use std::collections::BTreeSet;

/// The components of a solid on disk, largest first, as [`LevelSet::segments`] returns them.
pub struct StoredSegments {
    found: StoredComponents,
    /// Leaves of each component, ascending.
    leaves: Vec<Vec<Coord>>,
    half_width: f64,
}

/// One component.
pub struct StoredSegment<'a> {
    /// Leaves with parts of the component, ascending.
    leaves: &'a [Coord],
    /// Number of leaves beyond these that its band can reach.
    band_leaves: i32,
    /// Parts of other components nearby.
    others: SelectedParts,
}

impl StoredSegments {
    /// Finds the components of a solid whose voxels have the edge `voxel_size` in world units and
    /// whose band is `half_width` voxels wide on each side.
    ///
    /// # Errors
    /// A changed leaf file, or cancellation.
    pub fn find(
        store: &LeafStore,
        voxel_size: f64,
        half_width: f64,
        session: Session<'_>,
    ) -> Result<Self, FileError> {
        let found =
            StoredComponents::find(store, Side::Solid, voxel_size, BlockLabels::Kept, session)?;
        let mut by_component = vec![Vec::new(); found.ranking.count];
        for (&block, (first, labels)) in &found.blocks {
            labels.for_each_leaf(|slot, labels| {
                let leaf = leaf_at(block, slot);
                for &label in labels {
                    let component = found.ranking.component_of[first + label as usize];
                    if let Some(leaves) = by_component.get_mut(component)
                        // Several parts of a leaf may belong to one component.
                        && leaves.last() != Some(&leaf)
                    {
                        leaves.push(leaf);
                    }
                }
            });
        }
        for leaves in &mut by_component {
            // Sorted for binary search.
            leaves.sort_unstable();
        }
        Ok(Self {
            found,
            leaves: by_component,
            half_width,
        })
    }

    /// Number of components.
    pub fn len(&self) -> usize {
        self.leaves.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    /// The component with a number below [`StoredSegments::len`]. Parts of other components near it are listed, to be
    /// removed from what is read of the solid.
    pub fn segment(&self, component: usize) -> StoredSegment<'_> {
        let leaves = &self.leaves[component];
        let edge = neighbourhood_edge(self.half_width);
        let cubes: BTreeSet<Coord> = leaves.iter().map(|leaf| leaf.aligned(edge)).collect();
        let around = |cube: Coord| Region::cube(cube, edge).grown(edge).cubes(BLOCK);
        let near: BTreeSet<Coord> = cubes.into_iter().flat_map(around).collect();
        let mut others = SelectedParts::new(Side::Solid);
        for block in near {
            others.add_block(&self.found, block, |other| other != component);
        }
        StoredSegment {
            leaves,
            band_leaves: band_leaves(self.half_width),
            others,
        }
    }
}

impl StoredSegment<'_> {
    /// Blocks that may hold a part of the component's band, ascending.
    pub fn blocks(&self) -> BTreeSet<Coord> {
        let around = |leaf: &Coord| self.around(*leaf).cubes(BLOCK);
        self.leaves.iter().flat_map(around).collect()
    }

    /// Whether a leaf may hold a part of the component's band.
    pub fn holds(&self, leaf: Coord) -> bool {
        let mut around = self.around(leaf).cubes(LEAF);
        around.any(|leaf| self.leaves.binary_search(&leaf).is_ok())
    }

    fn around(&self, leaf: Coord) -> Region {
        Region::cube(leaf, LEAF).grown(self.band_leaves * LEAF)
    }

    /// Removes the other components from a part of the solid, as
    /// [`StoredRemoval::apply`](super::StoredRemoval::apply) does.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn apply(
        &self,
        part: &mut LevelSet,
        first: Coord,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        self.others.remove(part, first, session)
    }
}
