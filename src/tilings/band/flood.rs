//! Signed flood fill: the signs of voxels outside the band, by the rule of OpenVDB.
//!
//! In a cube of n^3 slots (x slowest, z fastest) the signs of some slots are known: the active voxels of a
//! leaf, or the child nodes of a node. Every other slot takes the sign of the last known slot before it on
//! its line along z; else that of the last known first slot of a line along y; else the same along x; else
//! the sign at which the first known slot begins. In a closed narrow band this is the correct sign.

/// Calls `fill` with every unknown slot and whether it is inside. `known` gives whether a known slot ends
/// inside; `first` is whether the first known slot begins inside.
pub(super) fn flood(
    edge: usize,
    first: bool,
    known: impl Fn(usize) -> Option<bool>,
    mut fill: impl FnMut(usize, bool),
) {
    let mut along_x = first;
    for x in 0..edge {
        along_x = known(x * edge * edge).unwrap_or(along_x);
        let mut along_y = along_x;
        for y in 0..edge {
            let row = (x * edge + y) * edge;
            along_y = known(row).unwrap_or(along_y);
            let mut along_z = along_y;
            for slot in row..row + edge {
                match known(slot) {
                    Some(inside) => along_z = inside,
                    None => fill(slot, along_z),
                }
            }
        }
    }
}

/// As [`flood`] for the voxels of a leaf (word x, bit 8 y + z), which end as they begin: all voxels inside, from those
/// that are known, and those of them that are inside.
pub(super) fn flood_leaf(first: bool, known: &[u64; 8], inside: &[u64; 8]) -> [u64; 8] {
    let mut all = [0; 8];
    let mut along_x = first;
    // A row or slice begins with the state of the first voxel of the one before; known voxels set it from there on.
    for x in 0..8 {
        if known[x] & 1 == 1 {
            along_x = inside[x] & 1 == 1;
        }
        let mut along_y = along_x;
        let (known, inside) = (known[x].to_le_bytes(), inside[x].to_le_bytes());
        let mut rows = [0; 8];
        for y in 0..8 {
            if known[y] & 1 == 1 {
                along_y = inside[y] & 1 == 1;
            }
            // Rows whose voxels are all known, or all unknown, need no loop.
            rows[y] = match known[y] {
                u8::MAX => inside[y],
                0 if along_y => u8::MAX,
                0 => 0,
                some => {
                    let mut along_z = along_y;
                    (0..8).fold(0, |row, z| {
                        if some >> z & 1 == 1 {
                            along_z = inside[y] >> z & 1 == 1;
                        }
                        row | u8::from(along_z) << z
                    })
                }
            };
        }
        all[x] = u64::from_le_bytes(rows);
    }
    all
}

/// Whether the last slot of a filled cube ends inside, from the known slots in ascending order and whether
/// each ends inside.
pub(super) fn last(
    edge: usize,
    first: bool,
    known: impl DoubleEndedIterator<Item = (usize, bool)>,
) -> bool {
    // The last known slot of the last line; else that of the first slots of its slice's lines; else of the slices'.
    let determines_last = |slot: usize| {
        let (x, y, z) = (slot / (edge * edge), slot / edge % edge, slot % edge);
        z == 0 && (y == 0 || x + 1 == edge) || x + 1 == edge && y + 1 == edge
    };
    let mut candidates = known.rev().filter(|&(slot, _)| determines_last(slot));
    candidates.next().map_or(first, |(_, inside)| inside)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn last_equals_the_flood_fill_of_the_last_slot() {
        let edge = 4;
        let mut state = 1u64;
        for _ in 0..500 {
            let mut known = BTreeMap::new();
            for slot in 0..edge * edge * edge {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
                if (state >> 33).is_multiple_of(8) {
                    known.insert(slot, state >> 40 & 1 == 0);
                }
            }
            let first = state >> 50 & 1 == 0;
            let mut signs = known.clone();
            flood(
                edge,
                first,
                |s| known.get(&s).copied(),
                |s, inside| {
                    signs.insert(s, inside);
                },
            );
            let found = last(edge, first, known.iter().map(|(&s, &i)| (s, i)));
            assert_eq!(signs[&(edge * edge * edge - 1)], found);
        }
    }

    #[test]
    fn leaves_are_filled_as_other_cubes() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
            state ^ state >> 29
        };
        for n in 0..500 {
            // Whole rows too, known or not.
            let bytes = |word: u64| {
                let whole = |b: u8| {
                    if b.trailing_zeros() >= 2 {
                        0
                    } else if b & 3 == 1 {
                        u8::MAX
                    } else {
                        b
                    }
                };
                u64::from_le_bytes(word.to_le_bytes().map(whole))
            };
            let known: [u64; 8] = std::array::from_fn(|_| bytes(next() & next()));
            let inside: [u64; 8] = std::array::from_fn(|x| bytes(next()) & known[x]);
            let has = |bits: &[u64; 8], slot: usize| bits[slot >> 6] >> (slot & 63) & 1 == 1;
            let mut expected = inside;
            flood(
                8,
                n % 2 == 0,
                |slot| has(&known, slot).then(|| has(&inside, slot)),
                |slot, is_inside| expected[slot >> 6] |= u64::from(is_inside) << (slot & 63),
            );
            assert_eq!(flood_leaf(n % 2 == 0, &known, &inside), expected);
        }
    }
}
