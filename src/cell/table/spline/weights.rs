//! Weights of the cubic B-spline and their derivatives, as polynomials of the place in the cell.
// Small functions of one hot path: a call each would cost as much as the work.
#![allow(clippy::inline_always)]

use super::GROUP;
use crate::simd::{Lanes, Twice};

/// Coefficients of the four cubic weights by powers of the place in the cell.
pub(super) const CUBIC: [[f32; 4]; 4] = [
    [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0, 0.0],
    [-0.5, 0.0, 0.5, 0.0],
    [0.5, -1.0, 0.5, 0.0],
    [-1.0 / 6.0, 0.5, -0.5, 1.0 / 6.0],
];
/// Of their derivatives.
pub(super) const SLOPES: [[f32; 4]; 3] = [
    [-0.5, 0.0, 0.5, 0.0],
    [1.0, -2.0, 1.0, 0.0],
    [-0.5, 1.5, -1.5, 0.5],
];
/// Row and place of each point's pair in two rows of interleaved pairs.
const PAIRS: [[usize; 2]; GROUP] = [
    [0, 0],
    [0, 2],
    [1, 0],
    [1, 2],
    [0, 4],
    [0, 6],
    [1, 4],
    [1, 6],
];

/// The four weights at the places of a row, from their coefficients by powers.
#[inline(always)]
fn of_row<L: Lanes, const N: usize>(lanes: L, t: L::F, powers: &[[f32; 4]; N]) -> [L::F; 4] {
    let mut all = [t; 4];
    for (i, w) in all.iter_mut().enumerate() {
        *w = lanes.splat(powers[N - 1][i]);
        for p in (0..N - 1).rev() {
            *w = lanes.fused(t, *w, lanes.splat(powers[p][i]));
        }
    }
    all
}

/// The same of two rows.
#[inline(always)]
fn of_rows<L: Lanes, const N: usize>(
    lanes: L,
    rows: [L::F; 2],
    powers: &[[f32; 4]; N],
) -> [[L::F; 2]; 4] {
    let two = lanes.two();
    let t = two.pair(rows);
    let mut all = [rows; 4];
    for (i, w) in all.iter_mut().enumerate() {
        let mut sum = two.each([powers[N - 1][i]; 2]);
        for p in (0..N - 1).rev() {
            sum = two.fused(t, sum, two.each([powers[p][i]; 2]));
        }
        *w = two.rows(sum);
    }
    all
}

/// Weights of the coefficients around the points of a group, or their derivatives, as sums take them.
#[derive(Clone, Copy, Default)]
pub(super) struct Weights {
    /// By plane and point.
    x: [[f32; GROUP]; 4],
    /// Pairs of neighbours: those of each half of a plane, in two rows, see [`PAIRS`].
    y: [[[f32; GROUP]; 2]; 2],
    /// Of two points each: 0 and 1 of one and of the other, then 2 and 3.
    z: [[f32; 8]; GROUP / 2],
}

impl Weights {
    /// From their coefficients by powers of the place in the spline cell.
    #[inline(always)]
    pub fn set<L: Lanes, const N: usize>(
        &mut self,
        lanes: L,
        within: &[L::F; 3],
        powers: &[[f32; 4]; N],
    ) {
        let [x, y, z] = *within;
        for (to, from) in self.x.iter_mut().zip(of_row(lanes, x, powers)) {
            lanes.store(from, to);
        }
        let [[y0, z0], [y1, z1], [y2, z2], [y3, z3]] = of_rows(lanes, [y, z], powers);
        for (to, from) in self.y[0].iter_mut().zip(lanes.interleaved(y0, y1)) {
            lanes.store(from, to);
        }
        for (to, from) in self.y[1].iter_mut().zip(lanes.interleaved(y2, y3)) {
            lanes.store(from, to);
        }
        let ([a, b], [c, d]) = (lanes.interleaved(z0, z1), lanes.interleaved(z2, z3));
        let ([first, third], [second, last]) = (lanes.halves(a, c), lanes.halves(b, d));
        let pairs = [first, second, third, last];
        for (to, from) in self.z.iter_mut().zip(pairs) {
            lanes.store(from, to);
        }
    }

    /// Of plane `i` at point `n`.
    #[inline(always)]
    pub fn x<L: Lanes>(&self, lanes: L, i: usize, n: usize) -> L::F {
        lanes.splat(self.x[i][n])
    }

    /// Of the neighbours along y in the halves of a plane at point `n`.
    #[inline(always)]
    pub fn y<L: Lanes>(&self, lanes: L, n: usize) -> [L::F; 2] {
        let [row, place] = PAIRS[n];
        let (low, high) = (&self.y[0][row], &self.y[1][row]);
        [
            lanes.alternating([low[place], low[place + 1]]),
            lanes.alternating([high[place], high[place + 1]]),
        ]
    }

    /// Of the neighbours along z at points 2 `n` and 2 `n` + 1.
    #[inline(always)]
    pub fn z<L: Lanes>(&self, lanes: L, n: usize) -> L::F {
        lanes.load(&self.z[n])
    }
}
