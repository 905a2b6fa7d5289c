//! Gaps in a narrow band: pairs of neighbours with different signs and at least one inactive voxel.

use super::index::{FACES, Holder, LeafIndex};
use super::voxel_mask::select;
use super::{LevelSet, VdbError};
use crate::frame::{Coord, Vec3};
use rayon::prelude::*;

/// Numbers of crossings and of gaps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct BandGaps {
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
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, true)?;
        let place = |voxel: Coord| self.transform.world(voxel).0 + self.origin;
        let of_leaves = (0..index.leaves.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|n| of_leaf(&index, n, place))
            .reduce(BandGaps::default, BandGaps::merge);
        let mut found = of_leaves;
        for tile in &index.tiles {
            for step in FACES {
                let [x, y, z] = step.map(|s| s * tile.edge);
                let other = match index.holder(tile.origin.offset(x, y, z)) {
                    Holder::Tile(other) if index.tiles[other].edge >= tile.edge => {
                        index.tiles[other].value
                    }
                    Holder::Background => 1.0,
                    _ => continue,
                };
                if (tile.value < 0.0) != (other < 0.0) {
                    found.crossings += 1;
                    found.gaps += 1;
                    found.first = found.first.or_else(|| Some(place(tile.origin)));
                }
            }
        }
        Ok(found)
    }
}

/// The gaps within a leaf and on its faces; a gap between two leaves counts for the lesser one.
fn of_leaf(index: &LeafIndex<'_>, n: usize, place: impl Fn(Coord) -> Vec3) -> BandGaps {
    let leaf = &index.leaves[n];
    let negative = select(leaf.values, |v| v < 0.0);
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
    for (x, (&signs, &mask)) in negative.iter().zip(&leaf.mask).enumerate() {
        // Along y and z within the word; its bits are 8 y + z.
        add(x, (signs ^ signs >> 8) & (u64::MAX >> 8), mask & mask >> 8);
        add(
            x,
            (signs ^ signs >> 1) & 0x7f7f_7f7f_7f7f_7f7f,
            mask & mask >> 1,
        );
        if x < 7 {
            add(x, signs ^ negative[x + 1], mask & leaf.mask[x + 1]);
        }
    }
    for (face, holder) in index.face_neighbours(n).into_iter().enumerate() {
        let (stride, ahead) = ([64, 8, 1][face / 2], face % 2 == 1);
        let other = match holder {
            Holder::Leaf(other) if ahead => Some(&index.leaves[other]),
            Holder::Leaf(_) => continue,
            _ => None,
        };
        let (tile, is_active) = match holder {
            Holder::Tile(tile) => (index.tiles[tile].value, index.tiles[tile].active),
            _ => (1.0, false),
        };
        for m in 0..512usize {
            if m / stride % 8 != if ahead { 7 } else { 0 } {
                continue;
            }
            let (value, active) = match other {
                Some(other) => (
                    other.values[m - 7 * stride],
                    other.is_active(m - 7 * stride),
                ),
                None => (tile, is_active),
            };
            let differs = (leaf.values[m] < 0.0) != (value < 0.0);
            let both = leaf.is_active(m) && active;
            let bit = 1u64 << (m & 63);
            if differs {
                add(m >> 6, bit, if both { bit } else { 0 });
            }
        }
    }
    found
}
