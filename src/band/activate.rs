//! Which voxels of a leaf are active: near the surface, or next to a change of sign.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::VOXELS;
use crate::lanes::{Lanes, Work, run};

/// Samples of a leaf and the layer around it along one axis.
pub(super) const SPAN: usize = 10;

/// Signs of the 10^3 samples of a leaf and the layer around it, as bits: row `[x + 1][y + 1]`, bit
/// `z + 1`. A sample of neither sign is unknown and takes no part: the bound has proved that it
/// has its neighbours' sign.
#[derive(Clone, Default)]
pub(super) struct Neighbourhood {
    negative: [[u16; SPAN]; SPAN],
    positive: [[u16; SPAN]; SPAN],
}

/// What the values of a leaf say, one bit per voxel in the mask's layout.
#[derive(Clone, Copy, Default)]
pub(super) struct Bits {
    /// Where the value is negative.
    pub negative: [u64; 8],
    /// Where it is nearer to zero than the background.
    pub within: [u64; 8],
    /// Whether all values are finite.
    pub finite: bool,
}

impl Bits {
    /// Of the values of a leaf.
    pub fn of(values: &[f32; VOXELS], background: f32) -> Self {
        run(Look { values, background })
    }
}

struct Look<'a> {
    values: &'a [f32; VOXELS],
    background: f32,
}

impl Work for Look<'_> {
    type Output = Bits;
    // No closures: they would be compiled for any processor.
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Bits {
        let (zero, background) = (l.splat(0.0), l.splat(self.background));
        let endless = l.splat(f32::INFINITY);
        let mut bits = Bits::default();
        let mut finite = u8::MAX;
        for (n, row) in self.values.chunks_exact(8).enumerate() {
            let Some(row) = row.first_chunk() else { break };
            let v = l.load(row);
            let size = l.magnitude(v);
            let shift = 8 * (n & 7);
            bits.negative[n >> 3] |= u64::from(l.below(v, zero)) << shift;
            bits.within[n >> 3] |= u64::from(l.below(size, background)) << shift;
            // NaN is not below anything.
            finite &= l.below(size, endless);
        }
        bits.finite = finite == u8::MAX;
        bits
    }
}

/// Along one axis: samples of the neighbour in direction -1, 0, 1 that lie in the neighbourhood, as
/// (first sample of the neighbour, first sample of the neighbourhood, how many).
const OVERLAP: [(usize, usize, usize); 3] = [(7, 0, 1), (0, 1, 8), (0, 9, 1)];

impl Neighbourhood {
    /// Enters the leaf in direction `(dx, dy, dz)`, each 0, 1, 2 for -1, 0, 1: (1, 1, 1) is the leaf
    /// itself.
    pub fn enter_leaf(&mut self, direction: [usize; 3], negative: &[u64; 8]) {
        let [(x0, i0, nx), (y0, j0, ny), (z0, k0, nz)] = direction.map(|d| OVERLAP[d]);
        let some = ((1u16 << nz) - 1) << k0;
        for x in 0..nx {
            let rows = negative[x0 + x].to_le_bytes();
            let slab = (&mut self.negative[i0 + x], &mut self.positive[i0 + x]);
            let mut enter = |y: usize, j: usize| {
                let row = u16::from(rows[y]) >> z0 << k0 & some;
                slab.0[j] |= row;
                slab.1[j] |= !row & some;
            };
            // A loop of known length becomes wide instructions.
            if ny == 8 {
                (0..8).for_each(|y| enter(y, y + 1));
            } else {
                enter(y0, j0);
            }
        }
    }

    /// Enters one sample, by its indices in the neighbourhood (0 to 9).
    pub fn enter_sample(&mut self, i: [usize; 3], negative: bool) {
        let rows = if negative {
            &mut self.negative
        } else {
            &mut self.positive
        };
        rows[i[0]][i[1]] |= 1 << i[2];
    }

    /// Voxels of the leaf that have one of their 26 neighbours on the other side, in the mask's layout.
    pub fn next_to_change(&self) -> [u64; 8] {
        let [wide_negative, wide_positive] = [&self.negative, &self.positive].map(widen);
        let mut words = [0; 8];
        for x in 0..8 {
            let mut rows = [0; 8];
            for y in 0..8 {
                let row = self.negative[x + 1][y + 1] & wide_positive[x][y]
                    | self.positive[x + 1][y + 1] & wide_negative[x][y];
                rows[y] = (row >> 1) as u8;
            }
            words[x] = u64::from_le_bytes(rows);
        }
        words
    }
}

/// Rows of the inner 8^2 in which a bit is set if any of its 27 is: spread along z, y and x in turn.
fn widen(rows: &[[u16; SPAN]; SPAN]) -> [[u16; 8]; 8] {
    let mut slabs = [[0; 8]; SPAN];
    for (slab, rows) in slabs.iter_mut().zip(rows) {
        let along_z = rows.map(|r| r | r << 1 | r >> 1);
        for y in 0..8 {
            slab[y] = along_z[y] | along_z[y + 1] | along_z[y + 2];
        }
    }
    let mut wide = [[0; 8]; 8];
    for x in 0..8 {
        for y in 0..8 {
            wide[x][y] = slabs[x][y] | slabs[x + 1][y] | slabs[x + 2][y];
        }
    }
    wide
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
