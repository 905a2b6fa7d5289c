//! The connected components of a level set as separate level sets: each is made by removal of the others.
//!
//! Each segment is a level set of its own with the same voxels. Its band is that of the whole where no other component
//! is near; elsewhere distances are found again without the others. Void surfaces go with the component around them.

use super::builder::LevelSetBuilder;
use super::components::{Components, Side};
use super::error::VdbError;
use super::ffi::TileChoice;
use super::index::LeafIndex;
use super::remove_components::{REMOVAL_REACH, Removal, band_leaves};
use super::{LevelSet, Session};
use crate::band::{BLOCK, LEAF, LeafBatch, LeafSink, Region};
use crate::frame::Coord;
use crate::progress::Cancelled;
use druse_solids::voxel_mask;
use druse_solids::voxel_mask::Bits;
use std::collections::{BTreeMap, BTreeSet};

/// Edge of the cubes that bound the neighbourhood of a component, a power of 2: at least the reach of a removal
/// plus the band beyond the component's leaves.
pub(super) fn neighbourhood_edge(half_width: f64) -> i32 {
    let reach = (REMOVAL_REACH * half_width / f64::from(LEAF)).ceil() as i32;
    let leaves = (reach + band_leaves(half_width)) as u32;
    leaves.next_power_of_two() as i32 * LEAF
}

/// Numbers of leaves by the cube that contains them.
struct LeafCubes {
    edge: i32,
    leaves: BTreeMap<Coord, Vec<usize>>,
}

impl LeafCubes {
    fn new(index: &LeafIndex<'_>, edge: i32) -> Self {
        let mut leaves: BTreeMap<Coord, Vec<usize>> = BTreeMap::new();
        for (n, leaf) in index.leaves.iter().enumerate() {
            leaves.entry(leaf.origin.aligned(edge)).or_default().push(n);
        }
        Self { edge, leaves }
    }

    /// Leaves in the cubes of some leaves and in the adjacent cubes, ascending.
    fn around(&self, own: impl Iterator<Item = Coord>) -> Vec<usize> {
        let cubes: BTreeSet<Coord> = own.map(|o| o.aligned(self.edge)).collect();
        let around = |cube: Coord| {
            let region = Region::cube(cube, self.edge).grown(self.edge);
            region.cubes(self.edge)
        };
        let near: BTreeSet<Coord> = cubes.into_iter().flat_map(around).collect();
        let leaves = near.iter().filter_map(|c| self.leaves.get(c));
        let mut all: Vec<usize> = leaves.flatten().copied().collect();
        all.sort_unstable();
        all
    }
}

impl LevelSet {
    /// Copies of the connected components of the solid, largest first. The surface of a void belongs to the
    /// component that encloses it.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB (memory).
    pub fn segments(&self, session: Session<'_>) -> Result<Vec<Self>, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, TileChoice::Solid)?;
        let found = Components::find(&index, Side::Solid, self.voxel_size(), session)?;
        let cubes = LeafCubes::new(&index, neighbourhood_edge(self.half_width()));
        let by_component = found.leaves_by_component();
        (by_component.iter().enumerate())
            .map(|(component, own_leaves)| {
                if session.progress.cancelled() {
                    return Err(VdbError::Cancelled(Cancelled));
                }
                self.segment(&index, &found, &cubes, component, own_leaves, session)
            })
            .collect()
    }

    /// One component, from the leaves with parts of it. `component` is its number, `own` are its
    /// leaves, ascending; `cubes` finds the leaves near them.
    fn segment(
        &self,
        index: &LeafIndex<'_>,
        found: &Components,
        cubes: &LeafCubes,
        component: usize,
        own: &[usize],
        session: Session<'_>,
    ) -> Result<Self, VdbError> {
        let origins = || own.iter().map(|&n| index.leaves[n].origin);
        let near = cubes.around(origins());
        // The component is a copy from which all others near it are removed.
        let others = near.iter().map(|&n| (n, found.others_in(n, component)));
        let edit = Removal::new(self, index, Side::Solid, others).edit();
        let edited: BTreeMap<Coord, usize> =
            edit.origins.iter().map(|o| Coord(*o)).zip(0..).collect();
        let reach = LEAF * band_leaves(self.half_width());
        let is_own = |leaf: &usize| own.binary_search(leaf).is_ok();
        // The outer half of the band may lie in leaves without a voxel of the solid.
        let is_beside = |leaf: &usize| {
            let around = Region::cube(index.leaves[*leaf].origin, LEAF).grown(reach);
            let mut leaves = around.cubes(LEAF).filter_map(|o| index.leaf(o));
            leaves.any(|other| is_own(&other))
        };
        let mut blocks: BTreeMap<Coord, LeafBatch> = BTreeMap::new();
        for &number in near.iter().filter(|n| is_own(n) || is_beside(n)) {
            let leaf = &index.leaves[number];
            let (mask, values): (Bits, &[f32; 512]) = match edited.get(&leaf.origin) {
                Some(&n) => (edit.masks[n], &edit.values[n]),
                None => (leaf.mask, leaf.values),
            };
            if !voxel_mask::is_empty(&mask) {
                let batch = blocks.entry(leaf.origin.aligned(BLOCK)).or_default();
                batch.push(leaf.origin, mask, values);
            }
        }
        let builder = LevelSetBuilder::new(self.transform, self.half_width)?;
        for (block, leaves) in &blocks {
            let refused =
                |e| VdbError::band("separating components", crate::band::BandError::Sink(e));
            builder.block(*block, leaves).map_err(refused)?;
        }
        let mut segment = builder.finish(session)?;
        segment.set_origin(self.origin)?;
        Ok(segment)
    }
}
