//! Values and distances of a bundle's points.
// Small functions of hot paths, which must be compiled for the processor that their caller is for;
// arithmetic on lanes stands in no closure, which would not be.
#![allow(clippy::inline_always)]

use super::sample_batch::{MOST, ROW, Row};
use crate::simd::{self, Eight, Lanes, Number, Work};

/// What is found of points in the elements that own them.
pub(super) struct Found {
    /// Values of the field, and gradients by the owner's reference coordinates.
    pub slopes: [[f32; 4]; MOST],
    /// Distances, clamped to the band; the boundary not regarded.
    d: Row,
    /// Sums of scales by their weights, and of these.
    scales: Row,
    weights: Row,
}

impl Default for Found {
    fn default() -> Self {
        let row = [[0.0; ROW]; MOST / ROW];
        Self {
            slopes: [[0.0; 4]; MOST],
            d: row,
            scales: row,
            weights: row,
        }
    }
}

impl Found {
    /// The distance of point `n`.
    #[inline(always)]
    pub fn d(&self, n: usize) -> f64 {
        self.d[n / ROW % (MOST / ROW)][n % ROW]
    }

    /// The distances of eight points, from `8 row` on.
    #[inline(always)]
    pub fn row(&self, row: usize) -> &[f64; ROW] {
        &self.d[row % (MOST / ROW)]
    }

    /// Takes for the distances of `len` points half the band's width with the values' signs; those whose
    /// values are below the first number are told: a bit each.
    pub fn decide(&mut self, len: usize, [most, half_width]: [f64; 2]) -> u64 {
        simd::run(Decide {
            found: self,
            len,
            most,
            half_width,
        })
    }

    /// Forgets the sums.
    pub fn clear_sums(&mut self) {
        self.scales.as_flattened_mut().fill(0.0);
        self.weights.as_flattened_mut().fill(0.0);
    }

    /// Adds a scale to those of point `n`.
    #[inline(always)]
    pub fn add(&mut self, n: usize, weight: f64, scale: f64) {
        let row = n / ROW % (MOST / ROW);
        self.scales[row][n % ROW] += weight * scale;
        self.weights[row][n % ROW] += weight;
    }

    /// Distances of those of `len` points for which scales have been added; those are told which are not
    /// within the half width though their values are at most `change`: a bit each.
    pub fn finish(&mut self, len: usize, [half_width, change]: [f64; 2]) -> u64 {
        simd::run(Finish {
            found: self,
            len,
            half_width,
            change,
        })
    }

    /// Values of row `row`.
    #[inline(always)]
    fn values<L: Lanes>(&self, lanes: L, row: usize) -> Option<Eight<L>> {
        let [f, ..] = lanes.by_row(self.slopes.as_chunks().0.get(row)?);
        Some(Eight::singles_of(lanes, f))
    }
}

struct Decide<'a> {
    found: &'a mut Found,
    len: usize,
    most: f64,
    half_width: f64,
}

struct Finish<'a> {
    found: &'a mut Found,
    len: usize,
    half_width: f64,
    change: f64,
}

impl Work for Decide<'_> {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> u64 {
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let (most, w) = (zero.like(self.most), zero.like(self.half_width));
        let mut low = 0;
        for row in 0..self.len.div_ceil(ROW).min(MOST / ROW) {
            let Some(f) = self.found.values(lanes, row) else {
                break;
            };
            self.found.d[row] = f.below(zero, zero - w, w).row();
            low |= u64::from(f.abs().bits_below(most)) << (ROW * row);
        }
        low
    }
}

impl Work for Finish<'_> {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> u64 {
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let w = zero.like(self.half_width);
        // What rounds to it in single precision is not within it.
        let (within, change) = (w * zero.like(1.0 - 1e-6), zero.like(self.change));
        let mut told = 0;
        for row in 0..self.len.div_ceil(ROW).min(MOST / ROW) {
            let Some(f) = self.found.values(lanes, row) else {
                break;
            };
            let weights = Eight::of(lanes, &self.found.weights[row]);
            let d = f * Eight::of(lanes, &self.found.scales[row]) / weights;
            let d = d.min(w).max(zero - w);
            let other = Eight::of(lanes, &self.found.d[row]);
            let near = f.abs().bits_below(change) & !d.abs().bits_below(within);
            told |= u64::from(near) << (ROW * row);
            self.found.d[row] = zero.below(weights, d, other).row();
        }
        told
    }
}
