//! Ranges of value and gradient over single spline cells, from the Bernstein form of the spline.
//!
//! In a spline cell a B-spline is a polynomial. Value and gradient are convex combinations of its Bernstein
//! coefficients, so that the extremes of these coefficients are bounds. The bounds are of second order in
//! the cell size, while the B-spline's own coefficients extend into the neighbouring cells. With the
//! three derivatives raised to one degree, the gradient vectors themselves are combined, whose length is a
//! convex function.
//!
//! Eight cells along z are computed at a time, one per lane, in single precision. The law
//! `table_bounds_contain_every_sample` compares the ranges with values.
// Small functions of a hot path, inlined so that they are compiled for the target features of the caller.
// The compiler does not propagate target features into closures, so this file has none.
#![allow(clippy::inline_always)]

use super::grid::Grid;
use super::window_ranges::Range;
use druse_geometry::simd::{self, Lanes, SimdKernel};

/// Spline cells per batch.
pub(super) const CELLS_PER_BATCH: usize = 8;
/// Bernstein coefficients of a cell, and their strides by axis.
const COEFFICIENTS_PER_CELL: usize = 64;
const STRIDES: [usize; 3] = [16, 4, 1];

/// Ranges over the eight spline cells from `first` on along z, from the padded coefficients. Beyond the
/// grid, the last coefficients are repeated.
/// `first` is a spline cell (x, y, z). Slopes are per unit of reference length.
pub(super) fn cell_ranges(
    coefficients: &[f32],
    grid: &Grid,
    first: [usize; 3],
) -> [Range; CELLS_PER_BATCH] {
    simd::run(CellRanges {
        coefficients,
        grid,
        first,
    })
}

struct CellRanges<'a> {
    coefficients: &'a [f32],
    grid: &'a Grid,
    first: [usize; 3],
}

/// Replaces the B-spline coefficients of eight cells by Bernstein coefficients along one axis.
/// `stride` is that of the axis in the 64 coefficients, one array of eight lanes each.
#[inline(always)]
fn to_bernstein<L: Lanes>(lanes: L, c: &mut [L::F; COEFFICIENTS_PER_CELL], stride: usize) {
    let (sixth, third) = (lanes.splat(1.0 / 6.0), lanes.splat(1.0 / 3.0));
    let four = lanes.splat(4.0);
    for line in 0..COEFFICIENTS_PER_CELL / 4 {
        let n = line / stride * 4 * stride + line % stride;
        // Knot insertion: (p + 4 q + r) / 6, (2 q + r) / 3, (q + 2 r) / 3, (q + 4 r + s) / 6.
        let [p, q, r, s] = [c[n], c[n + stride], c[n + 2 * stride], c[n + 3 * stride]];
        c[n] = lanes.mul(lanes.fused(q, four, lanes.add(p, r)), sixth);
        c[n + stride] = lanes.mul(lanes.add(lanes.add(q, q), r), third);
        c[n + 2 * stride] = lanes.mul(lanes.add(lanes.add(r, r), q), third);
        c[n + 3 * stride] = lanes.mul(lanes.fused(r, four, lanes.add(q, s)), sixth);
    }
}

/// Coefficient `n` of the derivative along an axis, raised to degree three.
/// Per spline cell, not per unit of length.
#[inline(always)]
fn derivative<L: Lanes>(
    lanes: L,
    b: &[L::F; COEFFICIENTS_PER_CELL],
    n: usize,
    stride: usize,
) -> L::F {
    let three = lanes.splat(3.0);
    // Of degree two the coefficients are 3 (b1 - b0), 3 (b2 - b1), 3 (b3 - b2). Raised to degree three, the
    // two inner ones are means with weights 1/3 and 2/3.
    match n / stride % 4 {
        0 => lanes.mul(lanes.sub(b[n + stride], b[n]), three),
        1 => {
            let next = lanes.sub(b[n + stride], b[n]);
            lanes.add(next, lanes.sub(b[n + stride], b[n - stride]))
        }
        2 => {
            let previous = lanes.sub(b[n], b[n - stride]);
            lanes.add(previous, lanes.sub(b[n + stride], b[n - stride]))
        }
        _ => lanes.mul(lanes.sub(b[n], b[n - stride]), three),
    }
}

impl SimdKernel for CellRanges<'_> {
    type Output = [Range; CELLS_PER_BATCH];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> [Range; CELLS_PER_BATCH] {
        let [_, sy, sz] = self.grid.padded();
        let [x, y, z] = self.first;
        let zero = lanes.splat(0.0);
        // The 4^3 coefficients that act in a cell, with the eight cells along z on lanes.
        let mut b = [zero; COEFFICIENTS_PER_CELL];
        for i in 0..4 {
            for j in 0..4 {
                let start = ((x + i) * sy + y + j) * sz;
                let row = &self.coefficients[start..start + sz];
                for k in 0..4 {
                    let c = &mut b[16 * i + 4 * j + k];
                    // Near the end of a row fewer than eight coefficients are left; the last one stands in
                    // for the others.
                    *c = if let Some(eight) = row.get(z + k..).and_then(|r| r.first_chunk()) {
                        lanes.load(eight)
                    } else {
                        let mut eight = [0.0; CELLS_PER_BATCH];
                        for (l, v) in eight.iter_mut().enumerate() {
                            *v = row[(z + k + l).min(sz - 1)];
                        }
                        lanes.load(&eight)
                    };
                }
            }
        }
        // b(x, y, z) in Bernstein form, axis by axis.
        for stride in STRIDES {
            to_bernstein(lanes, &mut b, stride);
        }
        let scale = self.grid.per_unit();
        let scale = [
            lanes.splat(scale[0] as f32),
            lanes.splat(scale[1] as f32),
            lanes.splat(scale[2] as f32),
        ];
        // Values lie between the extremes of b. |grad| is convex, so that its maximum over the coefficient
        // vectors of the gradient is a bound; squares are compared, with one root at the end.
        let (mut least, mut greatest, mut square) = (b[0], b[0], zero);
        for n in 0..COEFFICIENTS_PER_CELL {
            least = lanes.min(least, b[n]);
            greatest = lanes.max(greatest, b[n]);
            let mut gradient_square = zero;
            for (stride, scale) in STRIDES.into_iter().zip(scale) {
                let slope = lanes.mul(derivative(lanes, &b, n, stride), scale);
                gradient_square = lanes.fused(slope, slope, gradient_square);
            }
            square = lanes.max(square, gradient_square);
        }
        let (mut low, mut high, mut slope) = ([0.0; 8], [0.0; 8], [0.0; 8]);
        lanes.store(least, &mut low);
        lanes.store(greatest, &mut high);
        lanes.store(lanes.sqrt(square), &mut slope);
        let mut all = [Range::JOIN_IDENTITY; CELLS_PER_BATCH];
        for (l, range) in all.iter_mut().enumerate() {
            *range = Range {
                least: low[l],
                greatest: high[l],
                max_slope: slope[l],
            };
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_coefficients_have_the_ranges_of_their_function() {
        let (samples, periods) = ([8; 3], [1.0, 2.0, 4.0]);
        let of = |n: usize| (n / 121) as f32 - 2.0 * (n / 11 % 11) as f32 + 3.0 * (n % 11) as f32;
        let coefficients: Vec<f32> = (0..11 * 11 * 11).map(of).collect();
        let ranges = cell_ranges(&coefficients, &Grid { samples, periods }, [2, 1, 0]);
        for (k, r) in ranges.iter().enumerate() {
            // Cell n begins at coefficient n + 1 and is 1/8, 1/4 and 1/2 of a reference length wide.
            let least = 3.0 - 2.0 * 3.0 + 3.0 * (k as f32 + 1.0);
            assert!((r.least - least).abs() + (r.greatest - least - 6.0).abs() < 1e-5);
            assert!((r.max_slope.powi(2) - 164.0).abs() < 1e-3, "{k}: {r:?}");
        }
    }
}
