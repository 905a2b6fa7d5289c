//! The pieces of a solid on the disk one by one: what is left when all the others are removed.

use super::super::bits::{self, Bits};
use super::super::drop::rings;
use super::super::leaves::LeafView;
use super::super::pieces::{Part, Side};
use super::super::segments::surroundings;
use super::super::{FileError, LevelSet, Session, VdbError};
use super::StoredPieces;
use crate::band::{BLOCK, LEAF, LeafStore, Region};
use crate::frame::Coord;
use std::collections::{BTreeSet, HashMap};

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
    /// Numbers of the parts of others, by leaf near it.
    others: HashMap<Coord, Vec<u16>>,
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
        let mut others = HashMap::new();
        for block in near {
            let Some((first, labels)) = self.found.blocks.get(&block) else {
                continue;
            };
            labels.for_each_leaf(|place, components| {
                let is_other = |&n: &usize| {
                    self.found.ranking.piece_of[first + components[n] as usize] != piece
                };
                let those: Vec<u16> = (0..components.len())
                    .filter(is_other)
                    .map(|n| n as u16)
                    .collect();
                if !those.is_empty() {
                    others.insert(leaf_at(block, place), those);
                }
            });
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
        let chosen = |leaf: &LeafView<'_>| {
            let origin = leaf.origin.offset(first[0], first[1], first[2]);
            let numbers = self.others.get(&origin);
            numbers.map_or([0; 8], |numbers| parts_of(leaf, Side::Solid, numbers))
        };
        part.remove_chosen(Side::Solid, chosen, session)
    }
}

/// The voxels of those parts of a leaf that have these numbers.
pub(super) fn parts_of(leaf: &LeafView<'_>, side: Side, numbers: &[u16]) -> Bits {
    let mut out: Bits = [0; 8];
    let parts = Part::all_of(leaf, side);
    for part in numbers.iter().filter_map(|&n| parts.get(usize::from(n))) {
        bits::add(&mut out, &part.bits);
    }
    out
}

/// The leaf at a place of a block.
pub(super) fn leaf_at(block: Coord, place: u16) -> Coord {
    let at = |shift: u16| i32::from(place >> shift & 15) * LEAF;
    block.offset(at(8), at(4), at(0))
}
