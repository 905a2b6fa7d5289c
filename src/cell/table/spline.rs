//! The tricubic B-spline itself: where a point lies, the value and the gradient there.
//!
//! Plain single-precision code over rows of four coefficients. Nothing here calls the mathematics
//! library: on the x86-64 baseline even rounding down would be a function call.
// Small functions of one hot path: a call each would cost as much as the work.
#![allow(clippy::inline_always)]

/// Four neighbouring coefficients along z.
type Row = [f32; 4];

/// The grid of a spline: samples and period per axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    /// Samples per period; even, but for the one of an axis along which nothing changes.
    pub samples: [usize; 3],
    /// Periods in reference units.
    pub periods: [f64; 3],
}

impl Grid {
    /// Spline cells per unit of reference length.
    pub fn per_unit(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.samples[a] as f64 / self.periods[a])
    }

    /// Sizes of the coefficients with three repeated layers per axis.
    pub fn padded(&self) -> [usize; 3] {
        self.samples.map(|n| n + 3)
    }
}

/// A periodic tricubic B-spline on the box of its periods.
pub(super) struct Spline {
    grid: Grid,
    /// Coefficients with three repeated layers per axis: no index wraps inside.
    coefficients: Vec<f32>,
    inverse_periods: [f64; 3],
    per_unit: [f32; 3],
    /// Offsets of the 16 rows of a spline cell from its first coefficient.
    rows: [usize; 16],
}

/// Cubic B-spline weights at t in [0, 1].
#[inline(always)]
fn weights(t: f32) -> Row {
    let (t2, s) = (t * t, 1.0 - t);
    let t3 = t2 * t;
    [
        s * s * s * (1.0 / 6.0),
        0.5 * t3 - t2 + 2.0 / 3.0,
        -0.5 * t3 + 0.5 * (t2 + t) + 1.0 / 6.0,
        t3 * (1.0 / 6.0),
    ]
}

/// Derivatives of [`weights`].
#[inline(always)]
fn slopes(t: f32) -> Row {
    let s = 1.0 - t;
    [
        -0.5 * s * s,
        1.5 * t * t - 2.0 * t,
        -1.5 * t * t + t + 0.5,
        0.5 * t * t,
    ]
}

#[inline(always)]
fn dot(a: Row, b: Row) -> f32 {
    (a[0] * b[0] + a[2] * b[2]) + (a[1] * b[1] + a[3] * b[3])
}

impl Spline {
    /// From the padded coefficients of one period.
    pub fn new(coefficients: Vec<f32>, grid: Grid) -> Self {
        let [_, sy, sz] = grid.padded();
        Self {
            grid,
            coefficients,
            inverse_periods: grid.periods.map(f64::recip),
            per_unit: grid.per_unit().map(|c| c as f32),
            rows: std::array::from_fn(|n| ((n >> 2) * sy + (n & 3)) * sz),
        }
    }

    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    pub fn coefficients(&self) -> &[f32] {
        &self.coefficients
    }

    /// Number of the spline cell along an axis and the place in it, from 0 to 1.
    #[inline(always)]
    fn along(&self, x: f64, axis: usize) -> (usize, f32) {
        let v = x * self.inverse_periods[axis];
        let fraction = v - v as i64 as f64;
        let turn = if fraction < 0.0 {
            fraction + 1.0
        } else {
            fraction
        };
        let samples = self.grid.samples[axis];
        let w = turn * samples as f64;
        let cell = (w as i32 as usize).min(samples - 1);
        (cell, (w - cell as i32 as f64) as f32)
    }

    /// The coefficients from the first one of the point's spline cell on, and the place in the cell.
    #[inline(always)]
    fn place(&self, x: [f64; 3]) -> (&[f32], [f32; 3]) {
        let [(i, a), (j, b), (k, c)] = [
            self.along(x[0], 0),
            self.along(x[1], 1),
            self.along(x[2], 2),
        ];
        let [_, ny, nz] = self.grid.samples;
        let at = (i * (ny + 3) + j) * (nz + 3) + k;
        (&self.coefficients[at..], [a, b, c])
    }

    /// The value at a point.
    #[inline]
    pub fn value(&self, x: [f64; 3]) -> f32 {
        let (from, t) = self.place(x);
        let (wx, wy, wz) = (weights(t[0]), weights(t[1]), weights(t[2]));
        let mut sum = [0.0; 4];
        for (n, &at) in self.rows.iter().enumerate() {
            let factor = wx[n >> 2] * wy[n & 3];
            let row = &from[at..at + 4];
            for l in 0..4 {
                sum[l] += factor * row[l];
            }
        }
        dot(sum, wz)
    }

    /// The value and its gradient, per unit of reference length.
    ///
    /// Every coefficient takes part in three sums over x and y: weights in both, slopes in x, slopes
    /// in y. Their factors are the lanes (of four, the last is idle), so that a coefficient is
    /// spread once and all sums over one z grow together.
    #[inline]
    pub fn value_and_gradient(&self, x: [f64; 3]) -> (f32, [f32; 3]) {
        let (from, t) = self.place(x);
        let (wx, wy, wz) = (weights(t[0]), weights(t[1]), weights(t[2]));
        let (dx, dy, dz) = (slopes(t[0]), slopes(t[1]), slopes(t[2]));
        let along_x: [Row; 4] = std::array::from_fn(|i| [wx[i], dx[i], wx[i], 0.0]);
        let along_y: [Row; 4] = std::array::from_fn(|j| [wy[j], wy[j], dy[j], 0.0]);
        let mut sums = [[0.0; 4]; 4];
        for (n, &at) in self.rows.iter().enumerate() {
            let (a, b) = (along_x[n >> 2], along_y[n & 3]);
            let factor = [a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]];
            let row = &from[at..at + 4];
            for z in 0..4 {
                for l in 0..4 {
                    sums[z][l] += factor[l] * row[z];
                }
            }
        }
        let mut total = [0.0; 4];
        for z in 0..4 {
            for l in 0..4 {
                total[l] += sums[z][l] * wz[z];
            }
        }
        let along_z = dot([sums[0][0], sums[1][0], sums[2][0], sums[3][0]], dz);
        let [sx, sy, sz] = self.per_unit;
        (total[0], [total[1] * sx, total[2] * sy, along_z * sz])
    }
}
