//! Batches of up to 64 points in rows of eight.
//!
//! Coordinates are stored by axis, then by row, in double precision; sets of points are masks of 64 bits.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use druse_geometry::frame::Vec3;
use druse_geometry::simd::{Eight, Lanes};

/// Greatest number of points of a batch: a bit each in a `u64`.
pub(super) const MAX_SAMPLES: usize = 64;

/// Points of a row.
pub(super) const ROW: usize = 8;
/// A number for each point, by rows.
pub(super) type Row = [[f64; ROW]; MAX_SAMPLES / ROW];

/// Up to 64 points in the world.
pub(super) struct SampleBatch {
    x: [Row; 3],
    len: usize,
    /// The points to evaluate, a bit each; the others only fill up the last row.
    pub active: u64,
}

/// The numbers of the bits that are set, ascending.
pub(super) fn bits(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let n = word.trailing_zeros() as usize;
        word &= word.wrapping_sub(1);
        (n < MAX_SAMPLES).then_some(n)
    })
}

#[inline(always)]
pub(super) fn value_at(row: &Row, n: usize) -> f64 {
    row[n / ROW % (MAX_SAMPLES / ROW)][n % ROW]
}

impl Default for SampleBatch {
    fn default() -> Self {
        Self {
            x: [[[0.0; ROW]; MAX_SAMPLES / ROW]; 3],
            len: 0,
            active: 0,
        }
    }
}

impl SampleBatch {
    pub fn clear(&mut self) {
        self.len = 0;
        self.active = 0;
    }

    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_full(&self) -> bool {
        self.len == MAX_SAMPLES
    }

    /// Adds a point to evaluate, unless the batch is full.
    #[inline(always)]
    pub fn push(&mut self, x: [f64; 3]) {
        if self.is_full() {
            return;
        }
        let n = self.len;
        for (row, x) in self.x.iter_mut().zip(x) {
            row[n / ROW % (MAX_SAMPLES / ROW)][n % ROW] = x;
        }
        self.active |= 1 << n;
        self.len += 1;
    }

    /// Adds the eight corners of a box, unless the batch is full; a bit of `active` for each.
    #[inline(always)]
    pub fn push_block(&mut self, [x, y, z]: [[f64; 2]; 3], active: u64) {
        if !self.len.is_multiple_of(ROW) || self.is_full() {
            return;
        }
        let row = self.len / ROW % (MAX_SAMPLES / ROW);
        let ([a, b], [c, d], [e, f]) = (x, y, z);
        self.x[0][row] = [a, a, a, a, b, b, b, b];
        self.x[1][row] = [c, c, d, d, c, c, d, d];
        self.x[2][row] = [e, f, e, f, e, f, e, f];
        self.active |= active << self.len;
        self.len += 8;
    }

    /// Coordinates of the points of row `row`, by axis.
    #[inline(always)]
    pub fn row<L: Lanes>(&self, lanes: L, row: usize) -> [Eight<L>; 3] {
        [
            Eight::of(lanes, &self.x[0][row]),
            Eight::of(lanes, &self.x[1][row]),
            Eight::of(lanes, &self.x[2][row]),
        ]
    }

    /// The rows in use; the last one is full after [`Self::fill_up`].
    pub fn rows(&self) -> std::ops::Range<usize> {
        0..self.len.div_ceil(ROW).min(MAX_SAMPLES / ROW)
    }

    #[inline]
    pub fn point(&self, n: usize) -> Vec3 {
        Vec3::new(
            value_at(&self.x[0], n),
            value_at(&self.x[1], n),
            value_at(&self.x[2], n),
        )
    }

    /// Moves point `n`.
    pub fn move_point(&mut self, n: usize, x: Vec3) {
        for (row, x) in self.x.iter_mut().zip(x.iter()) {
            row[n / ROW % (MAX_SAMPLES / ROW)][n % ROW] = *x;
        }
    }

    /// Fills up the last row with its last point.
    pub fn fill_up(&mut self) {
        if let Some(last) = self.len.checked_sub(1) {
            let (last, active) = (self.point(last), self.active);
            while !self.len.is_multiple_of(ROW) {
                self.push(last.into());
            }
            self.active = active;
        }
    }
}
