//! Parts of leaves on the disk that are to be removed, and their removal from a part of the solid.

use super::super::components::{Part, Side};
use super::super::leaves::LeafView;
use super::super::voxel_mask::{self, Bits};
use super::super::{LevelSet, Session, VdbError};
use super::StoredPieces;
use crate::band::LEAF;
use crate::frame::Coord;
use std::collections::HashMap;

/// Parts on one side of the surface.
pub(super) struct Chosen {
    side: Side,
    /// Their numbers, by leaf.
    parts: HashMap<Coord, Vec<u16>>,
    /// Blocks that hold such a leaf.
    pub blocks: Vec<Coord>,
}

impl Chosen {
    pub fn new(side: Side) -> Self {
        Self {
            side,
            parts: HashMap::new(),
            blocks: Vec::new(),
        }
    }

    /// Enters the parts of a block that belong to pieces which go.
    pub fn enter(&mut self, found: &StoredPieces, block: Coord, goes: impl Fn(usize) -> bool) {
        let Some((first, labels)) = found.blocks.get(&block) else {
            return;
        };
        let before = self.parts.len();
        labels.for_each_leaf(|place, components| {
            let is_one = |&n: &usize| goes(found.ranking.piece_of[first + components[n] as usize]);
            let numbers = (0..components.len()).filter(is_one).map(|n| n as u16);
            let numbers: Vec<u16> = numbers.collect();
            if !numbers.is_empty() {
                self.parts.insert(leaf_at(block, place), numbers);
            }
        });
        if self.parts.len() > before {
            self.blocks.push(block);
        }
    }

    /// Removes them from a part of the solid whose voxel (0, 0, 0) is `first` of the whole.
    pub fn remove(
        &self,
        part: &mut LevelSet,
        first: Coord,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let chosen = |leaf: &LeafView<'_>| {
            let mut out: Bits = [0; 8];
            let origin = leaf.origin.offset(first[0], first[1], first[2]);
            if let Some(numbers) = self.parts.get(&origin) {
                let parts = Part::all_of(leaf, self.side);
                for part in numbers.iter().filter_map(|&n| parts.get(usize::from(n))) {
                    voxel_mask::add(&mut out, &part.bits);
                }
            }
            out
        };
        part.remove_chosen(self.side, chosen, session)
    }
}

/// The leaf at a place of a block.
pub(super) fn leaf_at(block: Coord, place: u16) -> Coord {
    let at = |shift: u16| i32::from(place >> shift & 15) * LEAF;
    block.offset(at(8), at(4), at(0))
}
