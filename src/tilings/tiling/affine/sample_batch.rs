//! Batches of up to 64 points in rows of eight, and their locations xi = J^-1 (x - x0) in affine elements.
//!
//! Coordinates are stored by axis, then by row, in double precision; sets of points are masks of 64 bits. m(x), the
//! greatest signed distance to the planes of the element's faces, decides which points it owns or shares.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use crate::tiling::clamp::face_distance_row;
use crate::tiling::inverse_map::product;
use crate::tiling::patch::{FACE_TOLERANCE, Patch};
use druse_geometry::frame::{CellPoint, Vec3};
use druse_geometry::simd::{self, Eight, Lanes, Number, SimdKernel, difference, splat_vector};

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

/// The locations of a batch's points in an element.
pub(super) struct BatchLocations {
    /// Distances outside the element, see [`crate::tiling::patch::Preimage`].
    outside: Row,
    /// Reference coordinates of the points to which the element contributes.
    xi: [Row; 3],
    /// The points less than a voxel outside, to which the element contributes.
    pub shares: u64,
    /// The points in the element.
    pub owns: u64,
    /// The points more than a voxel inside, to which no other element contributes.
    pub deep: u64,
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
fn value_at(row: &Row, n: usize) -> f64 {
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

impl Default for BatchLocations {
    fn default() -> Self {
        Self {
            outside: [[0.0; ROW]; MAX_SAMPLES / ROW],
            xi: [[[0.0; ROW]; MAX_SAMPLES / ROW]; 3],
            shares: 0,
            owns: 0,
            deep: 0,
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

    #[inline]
    pub fn point(&self, n: usize) -> Vec3 {
        Vec3::new(
            value_at(&self.x[0], n),
            value_at(&self.x[1], n),
            value_at(&self.x[2], n),
        )
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

impl BatchLocations {
    /// Distance of point `n` outside the element.
    #[inline(always)]
    pub fn outside(&self, n: usize) -> f64 {
        value_at(&self.outside, n)
    }

    /// Reference coordinates of point `n`, to which the element contributes.
    #[inline(always)]
    pub fn xi(&self, n: usize) -> CellPoint<3> {
        CellPoint(Vec3::new(
            value_at(&self.xi[0], n),
            value_at(&self.xi[1], n),
            value_at(&self.xi[2], n),
        ))
    }
}

impl Patch {
    /// Locates the points of a batch whose rows are full. The element contributes to points less than `delta`
    /// outside; points more than `delta` inside are deep.
    pub(super) fn locate(&self, batch: &SampleBatch, delta: f64, location: &mut BatchLocations) {
        simd::run(LocateKernel {
            patch: self,
            batch,
            delta,
            location,
        });
    }
}

struct LocateKernel<'a> {
    patch: &'a Patch,
    batch: &'a SampleBatch,
    delta: f64,
    location: &'a mut BatchLocations,
}

impl SimdKernel for LocateKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self {
            patch,
            batch,
            delta,
            location,
        } = self;
        let start = patch.origin_map();
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let (delta, on_face) = (zero.splat(delta), zero.splat(FACE_TOLERANCE));
        let inverse = start.inverse_rows(zero);
        let centre = splat_vector(zero, start.x);
        let planes = patch.planes();
        let shape = patch.shape();
        location.shares = 0;
        location.owns = 0;
        location.deep = 0;
        for row in 0..batch.len.div_ceil(ROW).min(MAX_SAMPLES / ROW) {
            let x = [
                Eight::of(lanes, &batch.x[0][row]),
                Eight::of(lanes, &batch.x[1][row]),
                Eight::of(lanes, &batch.x[2][row]),
            ];
            // m(x) <= 0 inside.
            let m = planes.outside_distance(x);
            location.outside[row] = m.row();
            let shares = m.bits_below(delta);
            // No point of the row is near the element: its xi is not needed.
            if shares == 0 {
                continue;
            }
            // xi = J^-1 (x - x0).
            let xi = product(inverse, difference(x, centre), [zero; 3]);
            for (to, xi) in location.xi.iter_mut().zip(xi) {
                to[row] = xi.row();
            }
            // Face tolerance in reference coordinates, so that both elements of a face own its points.
            let owns = shares & !on_face.bits_below(face_distance_row(shape, xi));
            location.shares |= u64::from(shares) << (ROW * row);
            location.owns |= u64::from(owns) << (ROW * row);
            location.deep |= u64::from(m.bits_below(zero - delta)) << (ROW * row);
        }
    }
}
