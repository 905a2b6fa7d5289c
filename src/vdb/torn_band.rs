//! Gaps in a narrow band: pairs of neighbours with different signs and at least one inactive voxel.
//!
//! At a gap one or both of the voxels around the surface have no distance, so that its place is unknown. Operations and
//! meshes need a band without gaps.

use super::LevelSet;
use super::error::VdbError;
use super::ffi::TileChoice;
use super::index::{FACES, Holder, LeafIndex};
use super::leaves::TileView;
use crate::band::{LEAF, Region};
use crate::frame::{Coord, Vec3};
use druse_solids::voxel_mask::{Bits, negative as negative_voxels};
use rayon::prelude::*;

/// Numbers of crossings and of gaps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct BandGaps {
    /// Pairs of neighbours with different signs.
    pub crossings: u64,
    /// Those pairs with at least one inactive voxel.
    pub gaps: u64,
    /// Position of the first gap, world units.
    pub first: Option<Vec3>,
}

impl BandGaps {
    fn merge(self, other: Self) -> Self {
        Self {
            crossings: self.crossings + other.crossings,
            gaps: self.gaps + other.gaps,
            first: self.first.or(other.first),
        }
    }
}

impl LevelSet {
    /// Counts the gaps of the band.
    pub(super) fn band_gaps(&self) -> Result<BandGaps, VdbError> {
        self.band_gaps_within(Region::EVERYWHERE)
    }

    /// Counts the gaps of the leaves in a region. This level set is the whole, or the part of it in the region and the
    /// leaves around.
    pub(crate) fn band_gaps_within(&self, region: Region) -> Result<BandGaps, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, TileChoice::Solid)?;
        let place = |voxel: Coord| self.transform.world(voxel).0 + self.origin;
        let negative: Vec<Bits> = index
            .leaves
            .par_iter()
            .with_min_len(64) // a leaf is quick work
            .map(|leaf| negative_voxels(leaf.values))
            .collect();
        let of_leaves = (0..index.leaves.len())
            .into_par_iter()
            .with_min_len(64) // as above
            .filter(|&n| region.meets(index.leaves[n].origin, LEAF))
            .map(|n| of_leaf(&index, &negative, n, place))
            .reduce(BandGaps::default, BandGaps::merge);
        let mut found = of_leaves;
        // A part may have cut its tiles off.
        if region != Region::EVERYWHERE {
            return Ok(found);
        }
        for tile in index.tiles.iter().filter(|t| t.value < 0.0) {
            let gaps = gaps_around(&index, tile);
            found.crossings += gaps;
            found.gaps += gaps;
            if gaps > 0 {
                found.first = found.first.or_else(|| Some(place(tile.origin)));
            }
        }
        Ok(found)
    }
}

/// Number of faces of a tile inside at which something is outside that belongs to no leaf.
fn gaps_around(index: &LeafIndex<'_>, tile: &TileView) -> u64 {
    let cubes = tile.edge / LEAF;
    let mut count = 0;
    for step in FACES {
        let across = step.map(|s| if s < 0 { -LEAF } else { s * tile.edge });
        let corner = tile.origin.offset(across[0], across[1], across[2]);
        let axis = step.iter().position(|s| *s != 0).unwrap_or(0);
        for n in 0..cubes * cubes {
            let mut along = [n / cubes * LEAF, n % cubes * LEAF, 0];
            along[axis..].rotate_right(1);
            match index.holder(corner.offset(along[0], along[1], along[2])) {
                // A leaf counts its own gaps.
                Holder::Leaf(_) => {}
                Holder::Tile(other) if index.tiles[other].value < 0.0 => {
                    if index.tiles[other].edge >= tile.edge {
                        break;
                    }
                }
                Holder::Tile(_) | Holder::Background => {
                    // One tells enough: a face may have a quarter of a million cubes.
                    count += 1;
                    break;
                }
            }
        }
    }
    count
}

/// The gaps within a leaf and on its faces; a gap between two leaves counts for the lesser one. `negative` holds the
/// inside voxels of all leaves. `n` is the number of the leaf; `place` gives the position of a voxel.
fn of_leaf(
    index: &LeafIndex<'_>,
    negative: &[Bits],
    n: usize,
    place: impl Fn(Coord) -> Vec3,
) -> BandGaps {
    let leaf = &index.leaves[n];
    let inside = &negative[n];
    let mut found = BandGaps::default();
    let mut add = |word: usize, crossings: u64, both_active: u64| {
        let gaps = crossings & !both_active;
        found.crossings += u64::from(crossings.count_ones());
        found.gaps += u64::from(gaps.count_ones());
        if gaps != 0 && found.first.is_none() {
            found.first = Some(place(
                leaf.voxel(64 * word + gaps.trailing_zeros() as usize),
            ));
        }
    };
    for (x, (&signs, &mask)) in inside.iter().zip(&leaf.mask).enumerate() {
        // Along y and z within the word, whose bits are 8 y + z; the last y and the last z have no next one.
        add(x, (signs ^ signs >> 8) & (u64::MAX >> 8), mask & mask >> 8);
        add(
            x,
            (signs ^ signs >> 1) & 0x7f7f_7f7f_7f7f_7f7f,
            mask & mask >> 1,
        );
        if x < 7 {
            add(x, signs ^ inside[x + 1], mask & leaf.mask[x + 1]);
        }
    }
    let all = |is_set: bool| [if is_set { u64::MAX } else { 0 }; 8];
    for (face, holder) in index.face_neighbours(n).into_iter().enumerate() {
        let (axis, ahead) = (face / 2, face % 2 == 1);
        let (signs, mask) = match holder {
            Holder::Leaf(other) if ahead => (negative[other], index.leaves[other].mask),
            Holder::Leaf(_) => continue,
            Holder::Tile(tile) => {
                let tile = &index.tiles[tile];
                (all(tile.value < 0.0), all(tile.active))
            }
            Holder::Background => (all(false), all(false)),
        };
        // The layer of the leaf at the face: words, the shift of its first bit, and its bits without the shift.
        let (words, shift, layer) = match (axis, ahead) {
            (0, true) => (7..8, 0, u64::MAX),
            (0, false) => (0..1, 0, u64::MAX),
            (1, true) => (0..8, 56, 0xff),
            (1, false) => (0..8, 0, 0xff),
            (_, true) => (0..8, 7, 0x0101_0101_0101_0101),
            (_, false) => (0..8, 0, 0x0101_0101_0101_0101),
        };
        for word in words {
            // A leaf ahead faces with its first layer; a tile is uniform.
            let other = if axis == 0 { 7 - word } else { word };
            let crossings = (inside[word] >> shift ^ signs[other]) & layer;
            let both_active = leaf.mask[word] >> shift & mask[other] & layer;
            add(word, crossings << shift, both_active << shift);
        }
    }
    found
}
