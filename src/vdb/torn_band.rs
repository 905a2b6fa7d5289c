//! Where the surface of a level set is torn: neighbours of different sign of which one has no distance.

use super::index::{FACES, Holder, LeafIndex};
use super::voxel_mask::select;
use super::{LevelSet, VdbError};
use crate::frame::{Coord, Vec3};
use rayon::prelude::*;

/// What was found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Tears {
    /// Neighbours of different sign.
    pub crossings: u64,
    /// Those of which one is inactive.
    pub torn: u64,
    /// Where the first one is, world units.
    pub first: Option<Vec3>,
}

impl Tears {
    fn join(self, other: Self) -> Self {
        Self {
            crossings: self.crossings + other.crossings,
            torn: self.torn + other.torn,
            first: self.first.or(other.first),
        }
    }
}

impl LevelSet {
    /// Counts the places where the surface is torn.
    pub(super) fn tears(&self) -> Result<Tears, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, true)?;
        let place = |voxel: Coord| self.transform.world(voxel).0 + self.origin;
        let of_leaves = (0..index.leaves.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|n| of_leaf(&index, n, place))
            .reduce(Tears::default, Tears::join);
        let mut found = of_leaves;
        for tile in &index.tiles {
            for step in FACES {
                let [x, y, z] = step.map(|s| s * tile.edge);
                let other = match index.holder(tile.origin.offset(x, y, z)) {
                    Holder::Tile(other) if index.tiles[other].edge >= tile.edge => {
                        index.tiles[other].value
                    }
                    Holder::Nothing => 1.0,
                    _ => continue,
                };
                if (tile.value < 0.0) != (other < 0.0) {
                    found.crossings += 1;
                    found.torn += 1;
                    found.first = found.first.or_else(|| Some(place(tile.origin)));
                }
            }
        }
        Ok(found)
    }
}

/// The tears within a leaf and at its faces; those between two leaves count for the lesser one.
fn of_leaf(index: &LeafIndex<'_>, n: usize, place: impl Fn(Coord) -> Vec3) -> Tears {
    let leaf = &index.leaves[n];
    let negative = select(leaf.values, |v| v < 0.0);
    let mut found = Tears::default();
    let mut add = |word: usize, signs: u64, both: u64| {
        let torn = signs & !both;
        found.crossings += u64::from(signs.count_ones());
        found.torn += u64::from(torn.count_ones());
        if torn != 0 && found.first.is_none() {
            found.first = Some(place(
                leaf.voxel(64 * word + torn.trailing_zeros() as usize),
            ));
        }
    };
    for (x, (&signs, &mask)) in negative.iter().zip(&leaf.mask).enumerate() {
        // Along y and z within the word, whose bit is 8 y + z.
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
    for (face, holder) in index.beside(n).into_iter().enumerate() {
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
