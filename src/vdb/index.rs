//! Lookup of the leaf or tile at a voxel, and of the neighbours of a leaf.
//!
//! Two hash tables by origin, made once for a level set that must not change meanwhile: the index borrows its leaves. A
//! voxel in no leaf and no listed tile counts as the unbounded outside.

use super::LevelSet;
use super::error::VdbError;
use super::ffi::TileChoice;
use super::leaves::{LeafView, Leaves, TileView, tiles_of};
use crate::frame::Coord;
use druse_solids::voxel_mask::offset;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// The node of a tree that holds a voxel.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Holder {
    /// The leaf with this number.
    Leaf(usize),
    /// The tile with this number.
    Tile(usize),
    /// No node: the unbounded outside.
    Background,
}

/// Edges of tiles, smallest first.
const TILE_EDGES: [i32; 3] = [8, 128, 4096];

/// Hashes node origins with one multiplication per coordinate; `SipHash` would take longer than the lookup.
#[derive(Default)]
struct CoordHasher(u64);

impl CoordHasher {
    /// Adds a number; the odd factor, 2^64 over the golden ratio, spreads it over all higher bits.
    fn mix(&mut self, number: u64) {
        self.0 = (self.0.rotate_left(5) ^ number).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
}

impl Hasher for CoordHasher {
    fn finish(&self) -> u64 {
        // The table uses the lowest bits; those of a product depend on the lowest bits alone.
        self.0 ^ self.0 >> 32
    }

    fn write(&mut self, bytes: &[u8]) {
        for number in bytes.chunks(4) {
            let mut word = [0; 4];
            word[..number.len()].copy_from_slice(number);
            self.mix(u32::from_le_bytes(word).into());
        }
    }

    fn write_usize(&mut self, number: usize) {
        self.mix(number as u64);
    }
}

/// Numbers of nodes by origin.
type ByOrigin = HashMap<Coord, usize, BuildHasherDefault<CoordHasher>>;

/// Leaves and tiles of a level set with lookup tables by origin.
pub(super) struct LeafIndex<'a> {
    pub leaves: Vec<LeafView<'a>>,
    pub tiles: Vec<TileView>,
    leaf_at: ByOrigin,
    tile_at: ByOrigin,
    background: f32,
}

impl<'a> LeafIndex<'a> {
    /// Indexes the leaves, and the tiles of a choice.
    pub fn new(
        level_set: &LevelSet,
        leaves: &'a Leaves<'_>,
        choice: TileChoice,
    ) -> Result<Self, VdbError> {
        let tiles =
            tiles_of(&level_set.grid, choice).map_err(|e| VdbError::plain("listing tiles", &e))?;
        let leaves: Vec<_> = leaves.iter().collect();
        Ok(Self {
            leaf_at: leaves.iter().map(|l| l.origin).zip(0..).collect(),
            tile_at: tiles.iter().map(|t| t.origin).zip(0..).collect(),
            background: level_set.background() as f32,
            leaves,
            tiles,
        })
    }

    /// The number of the leaf that holds a voxel; `None` if a tile or the background does.
    pub fn leaf(&self, voxel: Coord) -> Option<usize> {
        self.leaf_at.get(&voxel.aligned(8)).copied()
    }

    /// The leaf or tile that holds a voxel.
    pub fn holder(&self, voxel: Coord) -> Holder {
        if let Some(leaf) = self.leaf(voxel) {
            return Holder::Leaf(leaf);
        }
        for edge in TILE_EDGES {
            if let Some(&tile) = self.tile_at.get(&voxel.aligned(edge)) {
                // A tile with this origin may be smaller than the cube.
                if self.tiles[tile].edge == edge {
                    return Holder::Tile(tile);
                }
            }
        }
        Holder::Background
    }

    /// The neighbours of a leaf across its six faces.
    pub fn face_neighbours(&self, leaf: usize) -> [Holder; 6] {
        let origin = self.leaves[leaf].origin;
        FACES.map(|s| self.holder(origin.offset(8 * s[0], 8 * s[1], 8 * s[2])))
    }

    /// Row `number` along z, 8 x + y, of a leaf or of a tile's voxels.
    pub fn row(&self, holder: Holder, number: usize) -> [f32; 8] {
        match holder {
            Holder::Leaf(leaf) => self.leaves[leaf].values.as_chunks().0[number],
            Holder::Tile(tile) => [self.tiles[tile].value; 8],
            Holder::Background => [self.background; 8],
        }
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
            Holder::Background => (self.background, false),
        }
    }
}

/// Steps to the six face neighbours.
pub(super) const FACES: [[i32; 3]; 6] = [
    [-1, 0, 0],
    [1, 0, 0],
    [0, -1, 0],
    [0, 1, 0],
    [0, 0, -1],
    [0, 0, 1],
];
