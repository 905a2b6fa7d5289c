//! The tricubic B-spline itself: where a point lies, the value and the gradient there.
//!
//! Single-precision code over rows of four coefficients, written once and compiled twice: for any
//! processor, where nothing may call the mathematics library (on the x86-64 baseline even rounding
//! down would be a function call), and for those with AVX2 and fused multiplications, which are
//! recognised when the table is made.
// Small functions of one hot path: a call each would cost as much as the work.
#![allow(clippy::inline_always)]

#[cfg(target_arch = "x86_64")]
use pulp::{NullaryFnOnce, x86::V3};

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
    /// Samples along each axis.
    counts: [f64; 3],
    /// Offsets of the rows of a spline cell along x and along y from its first coefficient.
    strides: [usize; 2],
    #[cfg(target_arch = "x86_64")]
    wide: Option<V3>,
}

/// a b + c, fused where that is one instruction.
#[inline(always)]
fn fused<const WIDE: bool>(a: f32, b: f32, c: f32) -> f32 {
    if WIDE { a.mul_add(b, c) } else { a * b + c }
}

/// The sum of four rows times their weights.
#[inline(always)]
fn mixed<const WIDE: bool>(weights: Row, rows: &[Row; 4]) -> Row {
    let mut sum = [0.0; 4];
    for l in 0..4 {
        sum[l] = rows[0][l] * weights[0];
    }
    for y in 1..4 {
        for l in 0..4 {
            sum[l] = fused::<WIDE>(weights[y], rows[y][l], sum[l]);
        }
    }
    sum
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

#[cfg(target_arch = "x86_64")]
struct Value<'a>(&'a Spline, [f64; 3]);

#[cfg(target_arch = "x86_64")]
impl NullaryFnOnce for Value<'_> {
    type Output = f32;
    #[inline(always)]
    fn call(self) -> f32 {
        self.0.value_by::<true>(self.1)
    }
}

#[cfg(target_arch = "x86_64")]
struct Slope<'a>(&'a Spline, [f64; 3]);

#[cfg(target_arch = "x86_64")]
impl NullaryFnOnce for Slope<'_> {
    type Output = (f32, [f32; 3]);
    #[inline(always)]
    fn call(self) -> (f32, [f32; 3]) {
        self.0.slope_by::<true>(self.1)
    }
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
            counts: grid.samples.map(|n| n as f64),
            strides: [sy * sz, sz],
            #[cfg(target_arch = "x86_64")]
            wide: V3::try_new(),
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
    fn along<const WIDE: bool>(&self, x: f64, axis: usize) -> (usize, f32) {
        let v = x * self.inverse_periods[axis];
        let turn = if WIDE {
            v - v.floor()
        } else {
            let fraction = v - v as i64 as f64;
            fraction + f64::from(u8::from(fraction < 0.0))
        };
        let samples = self.grid.samples[axis];
        let w = turn * self.counts[axis];
        let cell = (w as i32 as usize).min(samples - 1);
        (cell, (w - cell as i32 as f64) as f32)
    }

    /// The coefficients from the first one of the point's spline cell on, and the place in the cell.
    #[inline(always)]
    fn place<const WIDE: bool>(&self, x: [f64; 3]) -> (&[f32], [f32; 3]) {
        let [(i, a), (j, b), (k, c)] = [
            self.along::<WIDE>(x[0], 0),
            self.along::<WIDE>(x[1], 1),
            self.along::<WIDE>(x[2], 2),
        ];
        let at = i * self.strides[0] + j * self.strides[1] + k;
        (&self.coefficients[at..], [a, b, c])
    }

    /// The four rows along y of one plane of a spline cell.
    #[inline(always)]
    fn plane(&self, from: &[f32], x: usize) -> [Row; 4] {
        // The last row that there is bounds the place: one comparison, and no way to fail.
        let last = from.len() - 4;
        let mut rows = [[0.0; 4]; 4];
        for (y, row) in rows.iter_mut().enumerate() {
            let at = (x * self.strides[0] + y * self.strides[1]).min(last);
            row.copy_from_slice(&from[at..at + 4]);
        }
        rows
    }

    #[inline(always)]
    fn value_by<const WIDE: bool>(&self, x: [f64; 3]) -> f32 {
        let (from, t) = self.place::<WIDE>(x);
        let (wx, wy, wz) = (weights(t[0]), weights(t[1]), weights(t[2]));
        // Planes by themselves, so that no long chain of sums is waited for. No closures: they would be
        // compiled for any processor.
        let mut planes = [[0.0; 4]; 4];
        for (i, plane) in planes.iter_mut().enumerate() {
            *plane = mixed::<WIDE>(wy, &self.plane(from, i));
        }
        dot(mixed::<WIDE>(wx, &planes), wz)
    }

    #[inline(always)]
    fn slope_by<const WIDE: bool>(&self, x: [f64; 3]) -> (f32, [f32; 3]) {
        let (from, t) = self.place::<WIDE>(x);
        let (wx, wy, wz) = (weights(t[0]), weights(t[1]), weights(t[2]));
        let (dx, dy, dz) = (slopes(t[0]), slopes(t[1]), slopes(t[2]));
        let (mut flat, mut steep) = ([[0.0; 4]; 4], [[0.0; 4]; 4]);
        for i in 0..4 {
            let rows = self.plane(from, i);
            flat[i] = mixed::<WIDE>(wy, &rows);
            steep[i] = mixed::<WIDE>(dy, &rows);
        }
        let along_z = mixed::<WIDE>(wx, &flat);
        let [sx, sy, sz] = self.per_unit;
        (
            dot(along_z, wz),
            [
                dot(mixed::<WIDE>(dx, &flat), wz) * sx,
                dot(mixed::<WIDE>(wx, &steep), wz) * sy,
                dot(along_z, dz) * sz,
            ],
        )
    }

    /// The value at a point.
    #[inline]
    pub fn value(&self, x: [f64; 3]) -> f32 {
        #[cfg(target_arch = "x86_64")]
        if let Some(wide) = self.wide {
            return wide.vectorize(Value(self, x));
        }
        self.value_by::<false>(x)
    }

    /// The value and its gradient, per unit of reference length: along y every plane of rows is summed
    /// with weights and with slopes, the planes likewise along x, and what is left along z.
    #[inline]
    pub fn value_and_gradient(&self, x: [f64; 3]) -> (f32, [f32; 3]) {
        #[cfg(target_arch = "x86_64")]
        if let Some(wide) = self.wide {
            return wide.vectorize(Slope(self, x));
        }
        self.slope_by::<false>(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_of_computing_agree_to_rounding() {
        let grid = Grid {
            samples: [6, 4, 8],
            periods: [1.0, 2.0, 0.5],
        };
        let count: usize = grid.padded().iter().product();
        let noise = |n: usize| ((n * n) as f32 * 0.618).sin();
        let spline = Spline::new((0..count).map(noise).collect(), grid);
        for n in 0..200 {
            let t = f64::from(n) * 0.37 - 20.0;
            let x = [t, 0.7 * t + 0.1, -1.3 * t];
            let (plain, wide) = (spline.slope_by::<false>(x), spline.value_and_gradient(x));
            assert!((plain.0 - wide.0).abs() < 1e-5);
            assert!((spline.value_by::<false>(x) - spline.value(x)).abs() < 1e-5);
            for a in 0..3 {
                assert!((plain.1[a] - wide.1[a]).abs() < 1e-4, "{n} {a}");
            }
        }
    }
}
