//! Which voxels of a leaf are active: near the surface, or next to a change of sign.

/// Samples of a leaf and the layer around it along one axis.
pub(super) const SPAN: usize = 10;

/// Signs of the 10^3 samples of a leaf and the layer around it. For each of the ten places along x and
/// each of 3 x 3 leaves across, (y, z), there is a word laid out as those of masks. A sample that is not
/// known takes no part: the bound has proved that it has its neighbours' sign.
#[derive(Clone, Default)]
pub(super) struct Neighbourhood {
    negative: [[u64; 9]; SPAN],
    known: [[u64; 9]; SPAN],
}

/// The first and the last place along z in every row, and along y all of a row.
const FIRST: u64 = 0x0101_0101_0101_0101;
const LAST: u64 = FIRST << 7;
const ROW: u64 = 0xff;

impl Neighbourhood {
    /// Enters the leaf in direction `(dx, dy, dz)`, each 0, 1, 2 for -1, 0, 1: (1, 1, 1) is the leaf
    /// itself.
    pub fn enter_leaf(&mut self, [x, y, z]: [usize; 3], negative: &[u64; 8]) {
        let across = 3 * y + z;
        let mut enter = |slab: usize, word: u64| {
            self.negative[slab][across] |= word;
            self.known[slab][across] = u64::MAX;
        };
        match x {
            0 => enter(0, negative[7]),
            1 => (0..8).for_each(|n| enter(n + 1, negative[n])),
            _ => enter(SPAN - 1, negative[0]),
        }
    }

    /// Enters a row of samples along z, by the indices (0 to 9) of the first of them; bits set where they
    /// are negative.
    pub fn enter_row(&mut self, [x, y, z]: [usize; 3], count: usize, negative: u64) {
        // Of the 24 places along z those of the leaf itself are 8 to 15, and along y.
        let (z, y) = (z + 7, y + 7);
        let known = ((1u64 << count) - 1) << z;
        let negative = negative << z & known;
        let (across, shift) = (3 * (y >> 3), 8 * (y & 7));
        for part in 0..3 {
            let byte = |bits: u64| (bits >> (8 * part) & ROW) << shift;
            self.known[x][across + part] |= byte(known);
            self.negative[x][across + part] |= byte(negative);
        }
    }

    /// Voxels of the leaf that have one of their 26 neighbours on the other side, in the mask's layout.
    pub fn next_to_change(&self) -> [u64; 8] {
        let (mut near_negative, mut near_positive) = ([0; SPAN], [0; SPAN]);
        for x in 0..SPAN {
            let (negative, known) = (&self.negative[x], &self.known[x]);
            let mut positive = [0; 9];
            for n in 0..9 {
                positive[n] = known[n] & !negative[n];
            }
            near_negative[x] = spread(negative);
            near_positive[x] = spread(&positive);
        }
        let around = |near: &[u64; SPAN], x: usize| near[x] | near[x + 1] | near[x + 2];
        std::array::from_fn(|x| {
            let (negative, known) = (self.negative[x + 1][4], self.known[x + 1][4]);
            negative & around(&near_positive, x) | known & !negative & around(&near_negative, x)
        })
    }
}

/// Of one place along x: voxels of the leaf of whose 9 neighbours along y and z, themselves included,
/// one is set.
fn spread(across: &[u64; 9]) -> u64 {
    let along_z = |y: usize| {
        let [before, own, behind] = [across[3 * y], across[3 * y + 1], across[3 * y + 2]];
        let ahead = own >> 1 & !LAST | (behind & FIRST) << 7;
        own | ahead | own << 1 & !FIRST | (before & LAST) >> 7
    };
    let [below, own, above] = [along_z(0), along_z(1), along_z(2)];
    own | own << 8 | own >> 8 | below >> 56 | (above & ROW) << 56
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rule itself, sample by sample.
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
    fn changes_of_sign_are_found_across_faces_edges_and_corners() {
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
                near.enter_leaf(direction, &words);
            }
            assert_eq!(near.next_to_change(), by_definition(negative));
        }
    }
}
