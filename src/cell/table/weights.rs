//! Weights of the cubic B-spline and their derivatives, as polynomials of the place in the cell.
// Small functions of one hot path: a call each would cost as much as the work.
#![allow(clippy::inline_always)]

use super::spline::GROUP;
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
fn weights<L: Lanes, const N: usize>(
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

/// Weights of the coefficients around the points of a group, or their derivatives.
pub(super) struct Weights {
    /// By plane and point.
    x: [[f32; GROUP]; 4],
    /// By point.
    y: [[f32; 4]; GROUP],
    z: [[f32; 4]; GROUP],
}

impl Weights {
    /// From their coefficients by powers of the place in the spline cell.
    #[inline(always)]
    pub fn new<L: Lanes, const N: usize>(
        lanes: L,
        within: &[[f32; GROUP]; 3],
        powers: &[[f32; 4]; N],
    ) -> Self {
        let [x, y, z] = within;
        let mut by_plane = [[0.0; GROUP]; 4];
        let along_x = weights(lanes, x, powers);
        for (to, from) in by_plane.iter_mut().zip(along_x) {
            lanes.store(from, to);
        }
        Self {
            x: by_plane,
            y: lanes.by_place(weights(lanes, y, powers)),
            z: lanes.by_place(weights(lanes, z, powers)),
        }
    }

    /// Of the four planes.
    #[inline(always)]
    pub fn x(&self, n: usize) -> [f32; 4] {
        [self.x[0][n], self.x[1][n], self.x[2][n], self.x[3][n]]
    }

    /// Of the neighbours along y in the halves of a plane.
    #[inline(always)]
    pub fn y<L: Lanes>(&self, lanes: L, n: usize) -> [L::F; 2] {
        let [a, b, c, d] = self.y[n];
        [lanes.alternating([a, b]), lanes.alternating([c, d])]
    }

    /// Of the pairs along z.
    #[inline(always)]
    pub fn z<L: Lanes>(&self, lanes: L, n: usize) -> L::F {
        lanes.doubled(self.z[n])
    }
}
