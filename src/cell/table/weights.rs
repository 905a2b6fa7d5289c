//! Weights of the cubic B-spline and their derivatives, as polynomials of the place in the cell.
// Small functions of one hot path: a call each would cost as much as the work.
#![allow(clippy::inline_always)]

use crate::lanes::Lanes;

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

/// The four weights at eight places in their cells, from their coefficients by powers.
#[inline(always)]
pub(super) fn weights<L: Lanes, const N: usize>(
    lanes: L,
    within: &[f32; 8],
    powers: &[[f32; 4]; N],
) -> [L::F; 4] {
    let t = lanes.load(within);
    let mut all = [t; 4];
    for (i, w) in all.iter_mut().enumerate() {
        *w = lanes.splat(powers[N - 1][i]);
        for p in (0..N - 1).rev() {
            *w = lanes.fused(t, *w, lanes.splat(powers[p][i]));
        }
    }
    all
}
