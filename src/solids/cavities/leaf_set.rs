//! Sets of the leaves of a block as 4096 bits: word 4 x + y / 4, bit 16 (y % 4) + z.
//!
//! The number of a leaf is 256 x + 16 y + z, so that a set is 64 words. Operations work on whole words; leaves of
//! neighbouring blocks come as sets of their own.

use super::samples::SLOTS;

/// A set of leaves of one block, by the number of the leaf.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LeafSet([u64; 64]);

/// Bits of the leaves at the first z of a block, and at the last one.
const FIRST_Z: u64 = 0x0001_0001_0001_0001;
const LAST_Z: u64 = FIRST_Z << 15;
/// Words of the leaves with the same x.
const LAYER: usize = 4;

impl LeafSet {
    pub const EMPTY: Self = Self([0; 64]);
    pub const ALL: Self = Self([u64::MAX; 64]);

    /// Adds the leaf with a number, 0 to 4095.
    pub fn insert(&mut self, slot: usize) {
        self.0[slot >> 6] |= 1 << (slot & 63);
    }

    /// Removes the leaf with a number, if it is in the set.
    pub fn remove(&mut self, slot: usize) {
        self.0[slot >> 6] &= !(1 << (slot & 63));
    }

    #[cfg(test)]
    pub fn contains(&self, slot: usize) -> bool {
        self.0[slot >> 6] >> (slot & 63) & 1 == 1
    }

    /// Whether there is no leaf in it.
    pub fn is_empty(&self) -> bool {
        *self == Self::EMPTY
    }

    /// The set that `both` makes of the words of two sets.
    fn with(&self, other: &Self, both: impl Fn(u64, u64) -> u64) -> Self {
        let mut out = *self;
        for (own, other) in out.0.iter_mut().zip(&other.0) {
            *own = both(*own, *other);
        }
        out
    }

    /// The leaves of either set.
    pub fn union(&self, other: &Self) -> Self {
        self.with(other, |a, b| a | b)
    }

    /// The leaves of both sets.
    pub fn intersection(&self, other: &Self) -> Self {
        self.with(other, |a, b| a & b)
    }

    /// The leaves that are not in another set.
    pub fn without(&self, other: &Self) -> Self {
        self.with(other, |a, b| a & !b)
    }

    /// The leaves whose neighbour along an axis is in the set, or in the set of the `next` block for those at its face.
    /// `ahead` is whether the neighbour lies at the greater coordinate.
    pub fn before(&self, axis: usize, ahead: bool, next: &Self) -> Self {
        let (own, next) = (&self.0, &next.0);
        Self(std::array::from_fn(|n| {
            let in_layer = n % LAYER;
            match (axis, ahead) {
                (0, true) if n + LAYER < 64 => own[n + LAYER], // x + 1 is four words on
                (0, true) => next[in_layer],
                (0, false) if n >= LAYER => own[n - LAYER],
                (0, false) => next[64 - LAYER + in_layer],
                (1, true) => {
                    let after = if in_layer + 1 < LAYER {
                        own[n + 1]
                    } else {
                        next[n + 1 - LAYER]
                    };
                    own[n] >> 16 | after << 48 // y + 1 is 16 bits on, the last from the next word
                }
                (1, false) => {
                    let before = if in_layer > 0 {
                        own[n - 1]
                    } else {
                        next[n + LAYER - 1]
                    };
                    own[n] << 16 | before >> 48
                }
                // z + 1 is one bit on; at the end of each 16 bits it is the first of the next block.
                (_, true) => (own[n] >> 1 & !LAST_Z) | (next[n] & FIRST_Z) << 15,
                (_, false) => (own[n] << 1 & !FIRST_Z) | (next[n] & LAST_Z) >> 15,
            }
        }))
    }

    /// The leaves with the same x and y: bit z.
    fn row(&self, x: usize, y: usize) -> u64 {
        self.0[LAYER * x + y / 4] >> (16 * (y % 4)) & 0xffff
    }

    /// The leaves of the middle one of 27 blocks, in order (x, y, z), that are at most `ring` leaves, and one block,
    /// away from a leaf of the sets along each axis.
    pub fn near(blocks: &[Option<&Self>; 27], ring: usize) -> Self {
        if blocks.iter().all(Option::is_none) {
            return Self::EMPTY;
        }
        let ring = ring.min(SLOTS);
        let side = SLOTS + 2 * ring;
        // Block and leaf of a layer that is counted from the first one within the ring.
        let layer = |n: usize| ((n + SLOTS - ring) / SLOTS, (n + SLOTS - ring) % SLOTS);
        // First along z: bits of a line of three blocks, 16 each, spread by up to `ring` bits, and the middle 16 taken.
        let mut rows = vec![0u64; side * side];
        for (n, out) in rows.iter_mut().enumerate() {
            let ((block_x, x), (block_y, y)) = (layer(n / side), layer(n % side));
            let line = (0..3).map(|z| {
                let block = blocks[9 * block_x + 3 * block_y + z];
                block.map_or(0, |b| b.row(x, y) << (16 * z))
            });
            let line = line.fold(0, |a, b| a | b);
            let reached = (0..=ring).fold(0, |all, step| all | line << step | line >> step);
            *out = reached >> 16 & 0xffff;
        }
        let mut found = Self::EMPTY;
        for y in 0..SLOTS {
            let along_y = |x: usize| {
                let near = &rows[x * side + y..=x * side + y + 2 * ring];
                near.iter().fold(0, |a, b| a | b)
            };
            let along_y: Vec<u64> = (0..side).map(along_y).collect();
            for (x, near) in along_y.windows(2 * ring + 1).enumerate() {
                let row = near.iter().fold(0, |a, b| a | b);
                found.0[LAYER * x + y / 4] |= row << (16 * (y % 4));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cavities::distances::{place, slot_at};

    /// A set with about one in `rarity` leaves.
    fn random(state: &mut u64, rarity: u64) -> LeafSet {
        let mut set = LeafSet::EMPTY;
        for slot in 0..4096 {
            *state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
            if (*state >> 33).is_multiple_of(rarity) {
                set.insert(slot);
            }
        }
        set
    }

    #[test]
    fn a_leaf_is_before_the_next_one() {
        let mut state = 1;
        let (own, next) = (random(&mut state, 3), random(&mut state, 3));
        for direction in 0..6 {
            let (axis, ahead) = (direction / 2, direction % 2 == 1);
            let found = own.before(axis, ahead, &next);
            for slot in 0..4096 {
                let mut at = place(slot);
                let end = if ahead { SLOTS - 1 } else { 0 };
                let is_end = at[axis] == end;
                at[axis] = (at[axis] + if ahead { 1 } else { SLOTS - 1 }) % SLOTS;
                let from = if is_end { &next } else { &own };
                assert_eq!(found.contains(slot), from.contains(slot_at(at)));
            }
        }
    }

    #[test]
    fn near_leaves_are_those_within_the_ring() {
        let mut state = 1;
        for ring in [1, 2, 5, 13] {
            let sets: Vec<LeafSet> = (0..27).map(|_| random(&mut state, 20_000)).collect();
            let blocks = std::array::from_fn(|n| (n % 4 != 0).then_some(&sets[n]));
            let found = LeafSet::near(&blocks, ring);
            let members: Vec<[usize; 3]> = (0..27)
                .flat_map(|block| (0..4096).map(move |slot| (block, slot)))
                .filter(|&(block, slot)| blocks[block].is_some_and(|b| b.contains(slot)))
                .map(|(block, slot)| {
                    let at = place(slot);
                    let block = [block / 9, block / 3 % 3, block % 3];
                    std::array::from_fn(|a| at[a] + SLOTS * block[a])
                })
                .collect();
            for slot in 0..4096 {
                let at = place(slot).map(|c| c + SLOTS);
                let is_near = |m: &[usize; 3]| (0..3).all(|a| m[a].abs_diff(at[a]) <= ring);
                assert_eq!(found.contains(slot), members.iter().any(is_near));
            }
        }
    }
}
