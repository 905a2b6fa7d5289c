//! Leaves and tiles by place: what lies at a voxel and beside a leaf.

use super::leaves::{LeafView, Leaves, TileView, tiles_of};
use super::{LevelSet, VdbError};
use crate::frame::Coord;
use std::collections::HashMap;

/// What holds a voxel.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Holder {
    /// Leaf of this number.
    Leaf(usize),
    /// Tile of this number.
    Tile(usize),
    /// No node: outside, without end.
    Nothing,
}

/// Edges of tiles, smallest first.
const EDGES: [i32; 3] = [8, 128, 4096];

/// Leaves in order of origin, with a table of places.
pub(super) struct LeafIndex<'a> {
    pub leaves: Vec<LeafView<'a>>,
    pub tiles: Vec<TileView>,
    leaf_at: HashMap<Coord, usize>,
    tile_at: HashMap<Coord, usize>,
    background: f32,
}

impl<'a> LeafIndex<'a> {
    /// Of the inside (`everything` false: only tiles that are inside or active) or of all space that
    /// has nodes.
    pub fn new(
        level_set: &LevelSet,
        leaves: &'a Leaves<'_>,
        everything: bool,
    ) -> Result<Self, VdbError> {
        let tiles = tiles_of(&level_set.grid, everything)
            .map_err(|e| VdbError::plain("listing tiles", &e))?;
        let leaves: Vec<_> = leaves.iter().collect();
        Ok(Self {
            leaf_at: leaves.iter().map(|l| l.origin).zip(0..).collect(),
            tile_at: tiles.iter().map(|t| t.origin).zip(0..).collect(),
            background: level_set.background() as f32,
            leaves,
            tiles,
        })
    }

    /// The leaf that holds a voxel.
    pub fn leaf(&self, voxel: Coord) -> Option<usize> {
        self.leaf_at.get(&voxel.aligned(8)).copied()
    }

    /// What holds a voxel.
    pub fn holder(&self, voxel: Coord) -> Holder {
        if let Some(leaf) = self.leaf(voxel) {
            return Holder::Leaf(leaf);
        }
        for edge in EDGES {
            if let Some(&tile) = self.tile_at.get(&voxel.aligned(edge)) {
                // A tile of this origin may be smaller than the cube asked for.
                if self.tiles[tile].edge == edge {
                    return Holder::Tile(tile);
                }
            }
        }
        Holder::Nothing
    }

    /// Value of a voxel and whether it is active.
    pub fn value(&self, voxel: Coord) -> (f32, bool) {
        match self.holder(voxel) {
            Holder::Leaf(leaf) => {
                let n = offset(voxel);
                let leaf = &self.leaves[leaf];
                (leaf.values[n], leaf.is_active(n))
            }
            Holder::Tile(tile) => (self.tiles[tile].value, self.tiles[tile].active),
            Holder::Nothing => (self.background, false),
        }
    }
}

/// Place of a voxel in its leaf.
pub(super) fn offset(voxel: Coord) -> usize {
    let [x, y, z] = voxel.0.map(|c| (c & 7) as usize);
    x << 6 | y << 3 | z
}

/// The six neighbours that share a face.
pub(super) const FACES: [[i32; 3]; 6] = [
    [-1, 0, 0],
    [1, 0, 0],
    [0, -1, 0],
    [0, 1, 0],
    [0, 0, -1],
    [0, 0, 1],
];
