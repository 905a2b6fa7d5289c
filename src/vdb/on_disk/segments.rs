//! The pieces of a solid on the disk one by one: what is left when all the others are removed.

use super::super::components::Side;
use super::super::remove_components::rings;
use super::super::segments::surroundings;
use super::super::{FileError, LevelSet, Session, VdbError};
use super::StoredPieces;
use super::removal::{Chosen, leaf_at};
use crate::band::{BLOCK, LEAF, LeafStore, Region};
use crate::frame::Coord;
use std::collections::BTreeSet;

/// The pieces of a solid on the disk, the largest first, as [`LevelSet::segments`] has them.
pub struct StoredSegments {
    found: StoredPieces,
    /// Leaves of each piece, ascending.
    own: Vec<Vec<Coord>>,
    half_width: f64,
}

/// One of them.
pub struct StoredSegment<'a> {
    /// Leaves that hold parts of it, ascending.
    own: &'a [Coord],
    /// Leaves beyond these in which its band can be.
    rings: i32,
    /// Parts of others near it.
    others: Chosen,
}

impl StoredSegments {
    /// Finds the pieces of a solid whose band is `half_width` voxels wide on each side.
    ///
    /// # Errors
    /// A leaf file that has changed, or cancelling.
    pub fn find(
        store: &LeafStore,
        (voxel_size, half_width): (f64, f64),
        session: Session<'_>,
    ) -> Result<Self, FileError> {
        let found = StoredPieces::find(store, Side::Solid, voxel_size, true, session)?;
        let mut own = vec![Vec::new(); found.ranking.count];
        for (&block, (first, labels)) in &found.blocks {
            labels.for_each_leaf(|place, components| {
                let leaf = leaf_at(block, place);
                for &component in components {
                    let piece = found.ranking.piece_of[first + component as usize];
                    if let Some(leaves) = own.get_mut(piece)
                        && leaves.last() != Some(&leaf)
                    {
                        leaves.push(leaf);
                    }
                }
            });
        }
        for leaves in &mut own {
            leaves.sort_unstable();
        }
        Ok(Self {
            found,
            own,
            half_width,
        })
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.own.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.own.is_empty()
    }

    /// Piece number `piece` of [`StoredSegments::len`].
    pub fn segment(&self, piece: usize) -> StoredSegment<'_> {
        let own = &self.own[piece];
        let edge = surroundings(self.half_width);
        let cubes: BTreeSet<Coord> = own.iter().map(|leaf| leaf.aligned(edge)).collect();
        let around = |cube: Coord| Region::cube(cube, edge).grown(edge).cubes(BLOCK);
        let near: BTreeSet<Coord> = cubes.into_iter().flat_map(around).collect();
        let mut others = Chosen::new(Side::Solid);
        for block in near {
            others.enter(&self.found, block, |other| other != piece);
        }
        StoredSegment {
            own,
            rings: rings(self.half_width),
            others,
        }
    }
}

impl StoredSegment<'_> {
    /// Blocks that may hold a part of its band, ascending.
    pub fn blocks(&self) -> BTreeSet<Coord> {
        let around = |leaf: &Coord| self.around(*leaf).cubes(BLOCK);
        self.own.iter().flat_map(around).collect()
    }

    /// Whether a leaf may hold a part of its band.
    pub fn holds(&self, leaf: Coord) -> bool {
        let mut around = self.around(leaf).cubes(LEAF);
        around.any(|leaf| self.own.binary_search(&leaf).is_ok())
    }

    fn around(&self, leaf: Coord) -> Region {
        Region::cube(leaf, LEAF).grown(self.rings * LEAF)
    }

    /// Removes the others from a part of the solid, as
    /// [`StoredRemoval::apply`](super::StoredRemoval::apply) does.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn apply(
        &self,
        part: &mut LevelSet,
        first: Coord,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        self.others.remove(part, first, session)
    }
}
