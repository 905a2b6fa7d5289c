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

/// Rows whose lane l holds entry `first` + l % 2: weights along y.
const fn along_y<const N: usize>(powers: [[f32; 4]; N], first: usize) -> [[f32; 8]; N] {
    let mut rows = [[0.0; 8]; N];
    let mut p = 0;
    while p < N {
        let mut l = 0;
        while l < 8 {
            rows[p][l] = powers[p][first + l % 2];
            l += 1;
        }
        p += 1;
    }
    rows
}

/// Rows whose lane l holds entry l / 2: weights along z.
const fn along_z<const N: usize>(powers: [[f32; 4]; N]) -> [[f32; 8]; N] {
    let mut rows = [[0.0; 8]; N];
    let mut p = 0;
    while p < N {
        let mut l = 0;
        while l < 8 {
            rows[p][l] = powers[p][l / 2];
            l += 1;
        }
        p += 1;
    }
    rows
}

pub(super) const Y: [[[f32; 8]; 4]; 2] = [along_y(CUBIC, 0), along_y(CUBIC, 2)];
pub(super) const Y_SLOPES: [[[f32; 8]; 3]; 2] = [along_y(SLOPES, 0), along_y(SLOPES, 2)];
pub(super) const Z: [[f32; 8]; 4] = along_z(CUBIC);
pub(super) const Z_SLOPES: [[f32; 8]; 3] = along_z(SLOPES);

/// A cubic with these coefficients.
#[inline(always)]
pub(super) fn cubic<L: Lanes>(lanes: L, t: L::F, c: &[[f32; 8]; 4]) -> L::F {
    let mut sum = lanes.fused(t, lanes.load(&c[3]), lanes.load(&c[2]));
    sum = lanes.fused(t, sum, lanes.load(&c[1]));
    lanes.fused(t, sum, lanes.load(&c[0]))
}

/// A square polynomial with these coefficients.
#[inline(always)]
pub(super) fn square<L: Lanes>(lanes: L, t: L::F, c: &[[f32; 8]; 3]) -> L::F {
    let sum = lanes.fused(t, lanes.load(&c[2]), lanes.load(&c[1]));
    lanes.fused(t, sum, lanes.load(&c[0]))
}
