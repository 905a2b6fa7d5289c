//! A level set divided into its connected pieces, each a level set: what is left of the band when all the
//! others are removed.

use super::components::{Pieces, Side};
use super::index::LeafIndex;
use super::remove_components::{REMOVAL_REACH, Removal, rings};
use super::voxel_mask::{self, Bits};
use super::{LevelSet, LevelSetBuilder, Session, VdbError};
use crate::band::{BLOCK, LEAF, LeafBatch, LeafSink, Region};
use crate::frame::Coord;
use crate::progress::Cancelled;
use std::collections::{BTreeMap, BTreeSet};

/// Edge of the cubes of leaves that a piece's surroundings are told by, a power of 2: no less than how far a
/// removal looks, and the band beyond a piece's leaves.
pub(super) fn surroundings(half_width: f64) -> i32 {
    let reach = (REMOVAL_REACH * half_width / f64::from(LEAF)).ceil() as i32;
    let leaves = (reach + rings(half_width)) as u32;
    leaves.next_power_of_two() as i32 * LEAF
}

/// Numbers of leaves by cubes of an edge.
struct Cubes {
    edge: i32,
    leaves: BTreeMap<Coord, Vec<usize>>,
}

impl Cubes {
    fn new(index: &LeafIndex<'_>, edge: i32) -> Self {
        let mut leaves: BTreeMap<Coord, Vec<usize>> = BTreeMap::new();
        for (n, leaf) in index.leaves.iter().enumerate() {
            leaves.entry(leaf.origin.aligned(edge)).or_default().push(n);
        }
        Self { edge, leaves }
    }

    /// Leaves in the cubes of some leaves and in those about them, ascending.
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
    /// The connected pieces of the solid, the largest first: copies. A surface within another's is of the
    /// piece whose hollow it bounds.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses (memory).
    pub fn segments(&self, session: Session<'_>) -> Result<Vec<Self>, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, false)?;
        let found = Pieces::find(&index, Side::Solid, self.voxel_size(), session)?;
        let cubes = Cubes::new(&index, surroundings(self.half_width()));
        let own = found.leaves_by_piece();
        (own.iter().enumerate())
            .map(|(piece, own)| {
                if session.progress.cancelled() {
                    return Err(VdbError::Cancelled(Cancelled));
                }
                self.segment(&index, &found, &cubes, (piece, own), session)
            })
            .collect()
    }

    /// One piece, which has parts in these leaves.
    fn segment(
        &self,
        index: &LeafIndex<'_>,
        found: &Pieces,
        cubes: &Cubes,
        (piece, own): (usize, &[usize]),
        session: Session<'_>,
    ) -> Result<Self, VdbError> {
        let origins = || own.iter().map(|&n| index.leaves[n].origin);
        let near = cubes.around(origins());
        let others = near.iter().map(|&n| (n, found.others_in(n, piece)));
        let edit = Removal::new(self, index, Side::Solid, others).edit();
        let edited: BTreeMap<Coord, usize> =
            edit.origins.iter().map(|o| Coord(*o)).zip(0..).collect();
        let rings = LEAF * rings(self.half_width());
        let is_own = |leaf: &usize| own.binary_search(leaf).is_ok();
        let is_beside = |leaf: &usize| {
            let around = Region::cube(index.leaves[*leaf].origin, LEAF).grown(rings);
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
                |e| VdbError::band("dividing into pieces", crate::band::BandError::Sink(e));
            builder.block(*block, leaves).map_err(refused)?;
        }
        let mut segment = builder.finish(session)?;
        segment.place_at(self.origin)?;
        Ok(segment)
    }
}
