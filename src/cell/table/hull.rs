//! Extremes over single spline cells, from the spline's Bernstein form.
//!
//! In a cell a B-spline is a polynomial; its Bernstein coefficients are means of the B-spline's, and
//! value and gradient are convex combinations of them, so that the extremes of coefficients bound what
//! lies between: to the second order of the cell's size, where those of the B-spline's own coefficients
//! reach as far as the neighbouring cells'. With the three derivatives raised to one degree the gradients
//! themselves are combined, whose length is convex.
// Small functions of a hot path, which must be compiled for the processor that their caller is for;
// arithmetic on lanes stands in no closure, which would not be.
#![allow(clippy::inline_always)]

use super::grid::Grid;
use super::pyramid::Range;
use crate::simd::{self, Lanes, Work};

/// Cells that are bounded together.
pub(super) const TOGETHER: usize = 8;
/// Coefficients of a cell, and their distances by axis.
const COUNT: usize = 64;
const STRIDES: [usize; 3] = [16, 4, 1];

/// Extremes over the eight spline cells from one on, along z; from the padded coefficients. Those beyond
/// the grid repeat its last coefficients.
pub(super) fn hulls(coefficients: &[f32], grid: &Grid, first: [usize; 3]) -> [Range; TOGETHER] {
    simd::run(Hulls {
        coefficients,
        grid,
        first,
    })
}

struct Hulls<'a> {
    coefficients: &'a [f32],
    grid: &'a Grid,
    first: [usize; 3],
}

/// Of coefficients of eight cells, those of the Bernstein form along an axis in place of the B-spline's.
#[inline(always)]
fn to_bernstein<L: Lanes>(lanes: L, c: &mut [L::F; COUNT], stride: usize) {
    let (sixth, third) = (lanes.splat(1.0 / 6.0), lanes.splat(1.0 / 3.0));
    let four = lanes.splat(4.0);
    for line in 0..COUNT / 4 {
        let n = line / stride * 4 * stride + line % stride;
        let [p, q, r, s] = [c[n], c[n + stride], c[n + 2 * stride], c[n + 3 * stride]];
        c[n] = lanes.mul(lanes.fused(q, four, lanes.add(p, r)), sixth);
        c[n + stride] = lanes.mul(lanes.add(lanes.add(q, q), r), third);
        c[n + 2 * stride] = lanes.mul(lanes.add(lanes.add(r, r), q), third);
        c[n + 3 * stride] = lanes.mul(lanes.fused(r, four, lanes.add(q, s)), sixth);
    }
}

/// Coefficient `n` of the derivative along an axis, raised to the third degree.
#[inline(always)]
fn derivative<L: Lanes>(lanes: L, b: &[L::F; COUNT], n: usize, stride: usize) -> L::F {
    let three = lanes.splat(3.0);
    match n / stride % 4 {
        0 => lanes.mul(lanes.sub(b[n + stride], b[n]), three),
        1 => {
            let ahead = lanes.sub(b[n + stride], b[n]);
            lanes.add(ahead, lanes.sub(b[n + stride], b[n - stride]))
        }
        2 => {
            let back = lanes.sub(b[n], b[n - stride]);
            lanes.add(back, lanes.sub(b[n + stride], b[n - stride]))
        }
        _ => lanes.mul(lanes.sub(b[n], b[n - stride]), three),
    }
}

impl Work for Hulls<'_> {
    type Output = [Range; TOGETHER];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> [Range; TOGETHER] {
        let [_, sy, sz] = self.grid.padded();
        let [x, y, z] = self.first;
        let zero = lanes.splat(0.0);
        let mut b = [zero; COUNT];
        for i in 0..4 {
            for j in 0..4 {
                let start = ((x + i) * sy + y + j) * sz;
                let row = &self.coefficients[start..start + sz];
                for k in 0..4 {
                    let c = &mut b[16 * i + 4 * j + k];
                    *c = if let Some(eight) = row.get(z + k..).and_then(|r| r.first_chunk()) {
                        lanes.load(eight)
                    } else {
                        let mut eight = [0.0; TOGETHER];
                        for (l, v) in eight.iter_mut().enumerate() {
                            *v = row[(z + k + l).min(sz - 1)];
                        }
                        lanes.load(&eight)
                    };
                }
            }
        }
        for stride in STRIDES {
            to_bernstein(lanes, &mut b, stride);
        }
        let scale = self.grid.per_unit();
        let scale = [
            lanes.splat(scale[0] as f32),
            lanes.splat(scale[1] as f32),
            lanes.splat(scale[2] as f32),
        ];
        let (mut least, mut greatest, mut square) = (b[0], b[0], zero);
        for n in 0..COUNT {
            least = lanes.min(least, b[n]);
            greatest = lanes.max(greatest, b[n]);
            let mut own = zero;
            for (stride, scale) in STRIDES.into_iter().zip(scale) {
                let slope = lanes.mul(derivative(lanes, &b, n, stride), scale);
                own = lanes.fused(slope, slope, own);
            }
            square = lanes.max(square, own);
        }
        let (mut low, mut high, mut steep) = ([0.0; 8], [0.0; 8], [0.0; 8]);
        lanes.store(least, &mut low);
        lanes.store(greatest, &mut high);
        lanes.store(lanes.sqrt(square), &mut steep);
        let mut all = [Range::NOTHING; TOGETHER];
        for (l, range) in all.iter_mut().enumerate() {
            *range = Range {
                least: low[l],
                greatest: high[l],
                steepest: steep[l],
            };
        }
        all
    }
}
