//! Weights of the cubic B-spline and their derivatives, as polynomials of the position in the cell.
//!
//! The position t is from 0 to 1. Derivatives are per spline cell, and the caller scales them to lengths. The arrays
//! are laid out as the sums read them, so that weights and coefficients need no shuffle.
// Small functions of a hot path, inlined because a call costs as much as their work.
#![allow(clippy::inline_always)]

use super::GROUP_SIZE;
use druse_geometry::simd::{Lanes, WideLanes};

/// Coefficients of the four cubic weights, by powers of the position in the cell.
pub(super) const VALUE_POLYNOMIALS: [[f32; 4]; 4] = [
    [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0, 0.0],
    [-0.5, 0.0, 0.5, 0.0],
    [0.5, -1.0, 0.5, 0.0],
    [-1.0 / 6.0, 0.5, -0.5, 1.0 / 6.0],
];
/// Coefficients of the derivatives of the weights.
pub(super) const SLOPE_POLYNOMIALS: [[f32; 4]; 3] = [
    [-0.5, 0.0, 0.5, 0.0],
    [1.0, -2.0, 1.0, 0.0],
    [-0.5, 1.5, -1.5, 0.5],
];
/// Row and offset of each point's pair in two rows of interleaved pairs.
const Y_PAIRS: [[usize; 2]; GROUP_SIZE] = [
    [0, 0],
    [0, 2],
    [1, 0],
    [1, 2],
    [0, 4],
    [0, 6],
    [1, 4],
    [1, 6],
];

/// The four weights at the positions of a row, from their polynomial coefficients.
/// `powers` are the polynomials, lowest power first.
#[inline(always)]
fn row_weights<L: Lanes, const N: usize>(lanes: L, t: L::F, powers: &[[f32; 4]; N]) -> [L::F; 4] {
    let mut all = [t; 4];
    for (i, w) in all.iter_mut().enumerate() {
        // Horner's scheme in t, highest power first.
        *w = lanes.splat(powers[N - 1][i]);
        for p in (0..N - 1).rev() {
            *w = lanes.fused(t, *w, lanes.splat(powers[p][i]));
        }
    }
    all
}

/// As [`row_weights`], for two rows, of y and z, joined in one wide register.
#[inline(always)]
fn two_row_weights<L: Lanes, const N: usize>(
    lanes: L,
    rows: [L::F; 2],
    powers: &[[f32; 4]; N],
) -> [[L::F; 2]; 4] {
    let two = lanes.wide();
    let t = two.join_rows(rows);
    let mut all = [rows; 4];
    for (i, w) in all.iter_mut().enumerate() {
        let mut sum = two.splat_rows([powers[N - 1][i]; 2]);
        for p in (0..N - 1).rev() {
            sum = two.fused(t, sum, two.splat_rows([powers[p][i]; 2]));
        }
        *w = two.split_rows(sum);
    }
    all
}

/// Weights, or their derivatives, of the coefficients around the points of a group, in the layout of the
/// sums.
#[derive(Clone, Copy, Default)]
pub(super) struct Weights {
    /// By neighbour along x and point.
    x: [[f32; GROUP_SIZE]; 4],
    /// By half of a plane: pairs of neighbours along y, in two rows, see [`Y_PAIRS`].
    y: [[[f32; GROUP_SIZE]; 2]; 2],
    /// For two points each: neighbours 0 and 1 along z of both points, then 2 and 3.
    z: [[f32; 8]; GROUP_SIZE / 2],
}

impl Weights {
    /// Sets the weights from their polynomial coefficients and the positions in the spline cell.
    /// `within` are positions by axis, each from 0 to 1; `powers` is one of the two tables above.
    #[inline(always)]
    pub fn set<L: Lanes, const N: usize>(
        &mut self,
        lanes: L,
        within: &[L::F; 3],
        powers: &[[f32; 4]; N],
    ) {
        let [x, y, z] = *within;
        for (to, from) in self.x.iter_mut().zip(row_weights(lanes, x, powers)) {
            lanes.store(from, to);
        }
        // Weights along y and z have the same polynomials and share the wide registers.
        let [[y0, z0], [y1, z1], [y2, z2], [y3, z3]] = two_row_weights(lanes, [y, z], powers);
        // Pairs (w_y0, w_y1) and (w_y2, w_y3) of each point side by side: the layout of the coefficients in a
        // half plane.
        for (to, from) in self.y[0].iter_mut().zip(lanes.interleave(y0, y1)) {
            lanes.store(from, to);
        }
        for (to, from) in self.y[1].iter_mut().zip(lanes.interleave(y2, y3)) {
            lanes.store(from, to);
        }
        // A row has two points: the pairs (`w_z0`, `w_z1`) of both, then their pairs (`w_z2`, `w_z3`).
        let ([a, b], [c, d]) = (lanes.interleave(z0, z1), lanes.interleave(z2, z3));
        let ([first, third], [second, last]) =
            (lanes.regroup_halves(a, c), lanes.regroup_halves(b, d));
        let pairs = [first, second, third, last];
        for (to, from) in self.z.iter_mut().zip(pairs) {
            lanes.store(from, to);
        }
    }

    /// The weight of neighbour `i` along x at point `n`.
    #[inline(always)]
    pub fn x<L: Lanes>(&self, lanes: L, i: usize, n: usize) -> L::F {
        lanes.splat(self.x[i][n])
    }

    /// The weights of the neighbours along y in both halves of a plane at point `n`.
    /// Each result alternates between the two weights of a half, as the coefficients do.
    #[inline(always)]
    pub fn y<L: Lanes>(&self, lanes: L, n: usize) -> [L::F; 2] {
        let [row, offset] = Y_PAIRS[n];
        let (low, high) = (&self.y[0][row], &self.y[1][row]);
        [
            lanes.alternating([low[offset], low[offset + 1]]),
            lanes.alternating([high[offset], high[offset + 1]]),
        ]
    }

    /// Row `n` of the weights along z.
    /// The weights of two points: neighbours 0 and 1 of both, then 2 and 3.
    #[inline(always)]
    pub fn z<L: Lanes>(&self, lanes: L, n: usize) -> L::F {
        lanes.load(&self.z[n])
    }
}
