//! Blends the scales of elements near a face to one distance a point: d = F sum(omega s) / sum(omega) by rule Q
//! (see module `rule`), clamped to the band. Data lie in rows of eight points in double precision; F and
//! its gradient come as groups of four single-precision numbers a point and are transposed to rows when loaded.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand. Closures
// are not: no SIMD arithmetic is written in them.
#![allow(clippy::inline_always)]

use super::sample_batch::{MAX_SAMPLES, ROW, Row};
use druse_geometry::field::Interval;
use druse_geometry::simd::{self, Eight, Lanes, Number, SimdKernel};

/// Values and distances of a batch's points in the elements that own them.
pub(super) struct BatchDistances {
    /// Values of the field, and gradients by the owner's reference coordinates.
    pub slopes: [[f32; 4]; MAX_SAMPLES],
    /// Distances, clamped to the band and not cut at the boundary.
    d: Row,
    /// Weighted sums of scales, and sums of the weights.
    scales: Row,
    weights: Row,
}

impl Default for BatchDistances {
    fn default() -> Self {
        let row = [[0.0; ROW]; MAX_SAMPLES / ROW];
        Self {
            slopes: [[0.0; 4]; MAX_SAMPLES],
            d: row,
            scales: row,
            weights: row,
        }
    }
}

impl BatchDistances {
    /// The distance of point `n`.
    #[inline(always)]
    pub fn d(&self, n: usize) -> f64 {
        self.d[n / ROW % (MAX_SAMPLES / ROW)][n % ROW]
    }

    /// The distances of eight points, from point `8 row`.
    #[inline(always)]
    pub fn row(&self, row: usize) -> &[f64; ROW] {
        &self.d[row % (MAX_SAMPLES / ROW)]
    }

    /// Sets the distances of `len` points to the half width with the values' signs. Returns a bit for each point
    /// whose value is within `open`.
    pub fn set_far_distances(&mut self, len: usize, open: Interval, half_width: f64) -> u64 {
        simd::run(FarDistancesKernel {
            distances: self,
            len,
            open,
            half_width,
        })
    }

    /// Resets the sums.
    pub fn clear_sums(&mut self) {
        self.scales.as_flattened_mut().fill(0.0);
        self.weights.as_flattened_mut().fill(0.0);
    }

    /// Adds a scale to those of point `n`.
    #[inline(always)]
    pub fn add(&mut self, n: usize, weight: f64, scale: f64) {
        let row = n / ROW % (MAX_SAMPLES / ROW);
        self.scales[row][n % ROW] += weight * scale; // sum(omega s)
        self.weights[row][n % ROW] += weight; // sum(omega)
    }

    /// Sets the distances of the points that have scales. Returns a bit for each point that is not within the
    /// half width although its value is below `change`.
    pub fn blend_scales(&mut self, len: usize, [half_width, change]: [f64; 2]) -> u64 {
        simd::run(BlendKernel {
            distances: self,
            len,
            half_width,
            change,
        })
    }

    /// Values of row `row`.
    #[inline(always)]
    fn values<L: Lanes>(&self, lanes: L, row: usize) -> Option<Eight<L>> {
        let [f, ..] = lanes.columns_to_rows(self.slopes.as_chunks().0.get(row)?);
        Some(Eight::from_f32(lanes, f))
    }
}

struct FarDistancesKernel<'a> {
    distances: &'a mut BatchDistances,
    len: usize,
    open: Interval,
    half_width: f64,
}

struct BlendKernel<'a> {
    distances: &'a mut BatchDistances,
    len: usize,
    half_width: f64,
    change: f64,
}

impl SimdKernel for FarDistancesKernel<'_> {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> u64 {
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let w = zero.splat(self.half_width);
        let (low, high) = (zero.splat(self.open.lo), zero.splat(self.open.hi));
        let mut open = 0;
        // d = w sign F, kept by points whose F is beyond the wanted values: no scale is computed for them.
        for row in 0..self.len.div_ceil(ROW).min(MAX_SAMPLES / ROW) {
            let Some(f) = self.distances.values(lanes, row) else {
                break;
            };
            self.distances.d[row] = f.select_below(zero, zero - w, w).row();
            open |= u64::from(f.bits_below(high) & low.bits_below(f)) << (ROW * row);
        }
        open
    }
}

impl SimdKernel for BlendKernel<'_> {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> u64 {
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let w = zero.splat(self.half_width);
        // A distance that rounds to the half width in single precision is not within it.
        let (within, change) = (w * zero.splat(1.0 - 1e-6), zero.splat(self.change));
        let mut unproved = 0;
        for row in 0..self.len.div_ceil(ROW).min(MAX_SAMPLES / ROW) {
            let Some(f) = self.distances.values(lanes, row) else {
                break;
            };
            // d = F sum(omega s) / sum(omega), within the band.
            let weights = Eight::of(lanes, &self.distances.weights[row]);
            let d = f * Eight::of(lanes, &self.distances.scales[row]) / weights;
            let d = d.min(w).max(zero - w);
            let other = Eight::of(lanes, &self.distances.d[row]);
            // d left the band although |F| is small: a neighbour may have the other sign.
            let near = f.abs().bits_below(change) & !d.abs().bits_below(within);
            unproved |= u64::from(near) << (ROW * row);
            // Points without weights keep the half width with their sign.
            self.distances.d[row] = zero.select_below(weights, d, other).row();
        }
        unproved
    }
}
