//! Selected parts of leaves on disk, and their removal from a part of the solid.
//!
//! A selection is by number of the part in its leaf, in the order in which parts are found. So the leaf of a part of
//! the solid in memory has the same numbers as that on disk, as long as its signs are the same.

use super::super::components::{Part, Side};
use super::super::leaves::LeafView;
use super::super::{LevelSet, Session};
use super::StoredComponents;
use crate::band::LEAF;
use crate::frame::Coord;
use crate::vdb::error::VdbError;
use druse_solids::voxel_mask;
use druse_solids::voxel_mask::Bits;
use std::collections::HashMap;

/// Selected parts on one side of the surface.
pub(super) struct SelectedParts {
    side: Side,
    /// Numbers of the parts, by leaf origin.
    parts: HashMap<Coord, Vec<u16>>,
    /// Blocks with such a leaf.
    pub blocks: Vec<Coord>,
}

impl SelectedParts {
    /// A selection without parts.
    pub fn new(side: Side) -> Self {
        Self {
            side,
            parts: HashMap::new(),
            blocks: Vec::new(),
        }
    }

    /// Adds the parts of a block that belong to selected components.
    pub fn add_block(
        &mut self,
        found: &StoredComponents,
        block: Coord,
        is_selected: impl Fn(usize) -> bool,
    ) {
        let Some((first, labels)) = found.blocks.get(&block) else {
            return;
        };
        let before = self.parts.len();
        labels.for_each_leaf(|slot, labels| {
            let is_part =
                |&n: &usize| is_selected(found.ranking.component_of[first + labels[n] as usize]);
            let numbers = (0..labels.len()).filter(is_part).map(|n| n as u16);
            let numbers: Vec<u16> = numbers.collect();
            if !numbers.is_empty() {
                self.parts.insert(leaf_at(block, slot), numbers);
            }
        });
        if self.parts.len() > before {
            self.blocks.push(block);
        }
    }

    /// Removes them from a part of the solid whose voxel (0, 0, 0) is voxel `first` of the whole.
    pub fn remove(
        &self,
        part: &mut LevelSet,
        first: Coord,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let selected = |leaf: &LeafView<'_>| {
            let mut out: Bits = [0; 8];
            let origin = leaf.origin.offset(first[0], first[1], first[2]);
            if let Some(numbers) = self.parts.get(&origin) {
                let parts = Part::all_of(leaf, self.side, 0.0);
                for part in numbers.iter().filter_map(|&n| parts.get(usize::from(n))) {
                    voxel_mask::add(&mut out, &part.bits);
                }
            }
            out
        };
        part.remove_voxels(self.side, selected, session)
    }
}

/// Origin of the leaf in a slot of a block.
pub(super) fn leaf_at(block: Coord, slot: u16) -> Coord {
    let offset = |shift: u16| i32::from(slot >> shift & 15) * LEAF;
    block.offset(offset(8), offset(4), offset(0))
}
