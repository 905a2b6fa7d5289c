//! Active voxels next to a change of sign, by bit operations on the signs of a leaf and its neighbours.
//!
//! A field that is no distance may step over the band between two voxels. Voxels with one of their 26 neighbours on the
//! other side become active, so that the surface stays closed there. This file only combines bits; which samples are
//! known is the caller's work.

/// Samples along one axis of a leaf and the layer around it.
pub(super) const SPAN: usize = 10;

/// Signs of the 10^3 samples of a leaf and the layer around it. For each of the ten x and each of the
/// 3 x 3 leaves across (y, z) there is a word with the layout of a mask word. Unknown samples are
/// ignored: the field's bound has proved that they have their neighbours' sign.
#[derive(Clone, Default)]
pub(super) struct Neighbourhood {
    negative: [[u64; 9]; SPAN],
    known: [[u64; 9]; SPAN],
}

/// Bits of a mask word at z = 0.
const Z_MIN_BITS: u64 = 0x0101_0101_0101_0101;
/// Bits of a mask word at z = 7.
const Z_MAX_BITS: u64 = Z_MIN_BITS << 7;
/// Bits of one row along z.
const ROW_BITS: u64 = 0xff;

impl Neighbourhood {
    /// Sets the signs of the leaf in direction `(dx, dy, dz)`, each 0, 1, 2 for -1, 0, 1; (1, 1, 1) is the leaf itself.
    pub fn set_leaf(&mut self, [x, y, z]: [usize; 3], negative: &[u64; 8]) {
        let across = 3 * y + z;
        let mut set = |slab: usize, word: u64| {
            self.negative[slab][across] |= word;
            self.known[slab][across] = u64::MAX;
        };
        match x {
            0 => set(0, negative[7]),
            1 => (0..8).for_each(|n| set(n + 1, negative[n])),
            _ => set(SPAN - 1, negative[0]),
        }
    }

    /// Sets the samples of `known`, a bit each, in a row along z that begins at indices (x, y, z), each 0 to 9; bits of
    /// `negative` are set where samples are negative.
    pub fn set_row(&mut self, [x, y, z]: [usize; 3], known: u64, negative: u64) {
        // Across three leaves there are 24 positions along z, and along y; 8 to 15 are the leaf itself.
        let (z, y) = (z + 7, y + 7);
        let known = known << z;
        let negative = negative << z & known;
        let (across, shift) = (3 * (y >> 3), 8 * (y & 7));
        for part in 0..3 {
            let byte = |bits: u64| (bits >> (8 * part) & ROW_BITS) << shift;
            self.known[x][across + part] |= byte(known);
            self.negative[x][across + part] |= byte(negative);
        }
    }

    /// Voxels of the leaf with one of their 26 neighbours on the other side, laid out as a mask. Neighbours whose sign
    /// is not known count for neither side.
    pub fn next_to_change(&self) -> [u64; 8] {
        let (mut near_negative, mut near_positive) = ([0; SPAN], [0; SPAN]);
        for x in 0..SPAN {
            let (negative, known) = (&self.negative[x], &self.known[x]);
            let mut positive = [0; 9];
            for n in 0..9 {
                positive[n] = known[n] & !negative[n];
            }
            near_negative[x] = dilate(negative);
            near_positive[x] = dilate(&positive);
        }
        let around = |near: &[u64; SPAN], x: usize| near[x] | near[x + 1] | near[x + 2];
        std::array::from_fn(|x| {
            let (negative, known) = (self.negative[x + 1][4], self.known[x + 1][4]);
            negative & around(&near_positive, x) | known & !negative & around(&near_negative, x)
        })
    }
}

/// For one x: voxels of the leaf with a set bit among their 3 x 3 neighbours along y and z, themselves included.
fn dilate(across: &[u64; 9]) -> u64 {
    let along_z = |y: usize| {
        let [before, own, behind] = [across[3 * y], across[3 * y + 1], across[3 * y + 2]];
        let ahead = own >> 1 & !Z_MAX_BITS | (behind & Z_MIN_BITS) << 7;
        own | ahead | own << 1 & !Z_MIN_BITS | (before & Z_MAX_BITS) >> 7
    };
    let [below, own, above] = [along_z(0), along_z(1), along_z(2)];
    own | own << 8 | own >> 8 | below >> 56 | (above & ROW_BITS) << 56
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference: the definition, sample by sample.
    fn by_definition(negative: impl Fn([i32; 3]) -> bool) -> [u64; 8] {
        let mut words = [0; 8];
        for n in 0..512 {
            let v = [n >> 6, n >> 3 & 7, n & 7];
            let changed = (0..27).any(|m| {
                let u = [v[0] + m / 9 - 1, v[1] + m / 3 % 3 - 1, v[2] + m % 3 - 1];
                negative(u) != negative(v)
            });
            words[v[0] as usize] |= u64::from(changed) << (n & 63);
        }
        words
    }

    #[test]
    fn sign_changes_across_faces_edges_and_corners_are_found() {
        for seed in 0u32..200 {
            let negative = |v: [i32; 3]| {
                // A hash of the voxel; a few per cent are negative.
                let mut x = seed ^ v.iter().fold(17, |a: u32, &c| a * 31 + (c + 40) as u32);
                for _ in 0..3 {
                    x = (x ^ x >> 15).wrapping_mul(0x2c1b_3c6d) ^ x >> 12;
                }
                x % 97 < 3
            };
            let mut near = Neighbourhood::default();
            for d in 0..27usize {
                let direction = [d / 9, d / 3 % 3, d % 3];
                let mut words = [0u64; 8];
                for n in 0..512 {
                    let v = [n >> 6, n >> 3 & 7, n & 7];
                    let at = [0, 1, 2].map(|a| v[a] + 8 * (direction[a] as i32 - 1));
                    words[v[0] as usize] |= u64::from(negative(at)) << (n & 63);
                }
                near.set_leaf(direction, &words);
            }
            assert_eq!(near.next_to_change(), by_definition(negative));
        }
    }
}
