//! Weighted sums of coefficients: values and gradients of the spline, `sum w_x,i w_y,j w_z,k c_ijk`.
//!
//! A batch of point groups is located and gets its weights first; then the sums are taken. The intermediate weights are
//! in memory, from which a weight is broadcast over a row at no cost. A broadcast from another register would occupy
//! the shuffle unit, which is the bottleneck. In single precision a value errs by at most 3e-6 of the largest
//! coefficient, a derivative by 1e-5 of it over the sample distance (`spline_series`).
// Small functions of a hot path, inlined because a call costs as much as their work.
#![allow(clippy::inline_always)]

use super::place::{Positions, group};
use super::weights::{SLOPE_POLYNOMIALS, VALUE_POLYNOMIALS, Weights};
use super::{GROUP_SIZE, HALF_PLANE_LEN, Spline};
use druse_geometry::frame::CellPoint;
use druse_geometry::simd::{Lanes, SimdKernel};

/// Groups of points per batch: the smallest number whose weights are kept in memory. A larger array takes
/// more time to clear for few points than it saves for many.
const GROUPS_PER_BATCH: usize = 2;

/// Values at points, into a slice of the same length.
pub(super) struct ValueBatch<'a>(pub &'a Spline, pub &'a [CellPoint<3>], pub &'a mut [f32]);

impl SimdKernel for ValueBatch<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        self.0.values_on(lanes, self.1, self.2);
    }
}

/// Values and gradients (per unit of reference length) at points, into a slice of the same length.
pub(super) struct SampleBatch<'a>(
    pub &'a Spline,
    pub &'a [CellPoint<3>],
    pub &'a mut [[f32; 4]],
);

impl SimdKernel for SampleBatch<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        self.0.samples_on(lanes, self.1, self.2);
    }
}

/// The stencils of a group of points: positions of their coefficients, and weights.
#[derive(Clone, Copy, Default)]
struct Stencils {
    plane: [i32; GROUP_SIZE],
    start: [i32; GROUP_SIZE],
    weights: Weights,
}

impl Stencils {
    #[inline(always)]
    fn set<L: Lanes>(&mut self, lanes: L, positions: &Positions<L>) {
        (self.plane, self.start) = (positions.plane, positions.start);
        self.weights
            .set(lanes, &positions.within, &VALUE_POLYNOMIALS);
    }
}

/// The stencils with the weights of the derivatives.
#[derive(Clone, Copy, Default)]
struct GradientStencils {
    stencils: Stencils,
    weights: Weights,
    /// Scale from derivatives per spline cell to derivatives of the points, by axis; negative along reversed
    /// axes.
    scales: [[f32; GROUP_SIZE]; 3],
    /// One row per step of the sort of the axes, see [`super::place::AxisExchanges`].
    exchanges: [[f32; GROUP_SIZE]; 3],
}

impl Spline {
    /// The coefficients around point `n` of a group, by plane and half of a plane.
    /// A half has the 4 z-neighbours of 2 y-neighbours.
    #[inline(always)]
    fn patches<L: Lanes>(&self, lanes: L, stencils: &Stencils, n: usize) -> [[L::F; 2]; 4] {
        // A single bounds check: all accesses below have constant offsets in the window.
        let plane = (stencils.plane[n] as usize).wrapping_mul(self.plane_stride);
        let from = plane.wrapping_add(stencils.start[n] as usize);
        let window =
            &self.table[from..][..3 * self.plane_stride + self.half_stride + HALF_PLANE_LEN];
        let (first, rest) = window.split_at(self.plane_stride);
        let (second, rest) = rest.split_at(self.plane_stride);
        let (third, fourth) = rest.split_at(self.plane_stride);
        [
            self.patch(lanes, first),
            self.patch(lanes, second),
            self.patch(lanes, third),
            self.patch(lanes, fourth),
        ]
    }

    /// The coefficients of both halves at the start of a plane.
    /// The array is at least that long, so that the zeros are no case that occurs.
    #[inline(always)]
    fn patch<L: Lanes>(&self, lanes: L, plane: &[f32]) -> [L::F; 2] {
        let patch = &plane[..self.half_stride + HALF_PLANE_LEN];
        let low = patch.first_chunk::<HALF_PLANE_LEN>();
        let high = patch[self.half_stride..].first_chunk::<HALF_PLANE_LEN>();
        let none = &[0.0; HALF_PLANE_LEN];
        [
            lanes.load(low.unwrap_or(none)),
            lanes.load(high.unwrap_or(none)),
        ]
    }

    /// Sums along x and y at point `n`: two partial sums for each neighbour along z, interleaved.
    /// The two partial sums are those of even and odd y-neighbours.
    #[inline(always)]
    fn sum_xy<L: Lanes>(&self, lanes: L, stencils: &Stencils, n: usize) -> L::F {
        let patches = self.patches(lanes, stencils, n);
        let weights = &stencils.weights;
        let first = weights.x(lanes, 0, n);
        // Over the four planes along x: sum_i w_x,i c_ijk, for the neighbours 0, 1 along y in `low` and 2, 3 in `high`.
        let mut low = lanes.mul(patches[0][0], first);
        let mut high = lanes.mul(patches[0][1], first);
        for i in 1..4 {
            let weight = weights.x(lanes, i, n);
            low = lanes.fused(patches[i][0], weight, low);
            high = lanes.fused(patches[i][1], weight, high);
        }
        // Along y: each half times its pair of weights; the pairs are added by `add_partial_sums`.
        let [y0, y1] = weights.y(lanes, n);
        lanes.fused(low, y0, lanes.mul(high, y1))
    }

    /// As [`Self::sum_xy`]: the sum, that with derivatives along x, and that with derivatives along y.
    #[inline(always)]
    fn sums_xy<L: Lanes>(&self, lanes: L, group: &GradientStencils, n: usize) -> [L::F; 3] {
        let patches = self.patches(lanes, &group.stencils, n);
        let (weights, slopes) = (&group.stencils.weights, &group.weights);
        let (first, dx) = (weights.x(lanes, 0, n), slopes.x(lanes, 0, n));
        // The same planes with the weights w_x and with their derivatives w_x'.
        let mut low = lanes.mul(patches[0][0], first);
        let mut high = lanes.mul(patches[0][1], first);
        let mut dx_low = lanes.mul(patches[0][0], dx);
        let mut dx_high = lanes.mul(patches[0][1], dx);
        for i in 1..4 {
            let (weight, dx) = (weights.x(lanes, i, n), slopes.x(lanes, i, n));
            low = lanes.fused(patches[i][0], weight, low);
            high = lanes.fused(patches[i][1], weight, high);
            dx_low = lanes.fused(patches[i][0], dx, dx_low);
            dx_high = lanes.fused(patches[i][1], dx, dx_high);
        }
        // w_x w_y, w_x' w_y and w_x w_y'.
        let ([y0, y1], [d0, d1]) = (weights.y(lanes, n), slopes.y(lanes, n));
        [
            lanes.fused(low, y0, lanes.mul(high, y1)),
            lanes.fused(dx_low, y0, lanes.mul(dx_high, y1)),
            lanes.fused(low, d0, lanes.mul(high, d1)),
        ]
    }

    /// Values at four points of a group, or only at the first of them.
    /// `quartet` is 0 or 1; `is_single` leaves the other three results equal to the first.
    #[inline(always)]
    fn four_values<L: Lanes>(
        &self,
        lanes: L,
        stencils: &Stencils,
        quartet: usize,
        is_single: bool,
    ) -> [f32; 4] {
        let n = 4 * quartet;
        let first = self.sum_xy(lanes, stencils, n);
        let mut sum_xy = [first; 4];
        if !is_single {
            for i in 1..4 {
                sum_xy[i] = self.sum_xy(lanes, stencils, n + i);
            }
        }
        sum_z(
            lanes,
            add_partial_sums(lanes, sum_xy),
            &stencils.weights,
            quartet,
        )
    }

    /// Values and derivatives at four points of a group, or only at the first of them.
    #[inline(always)]
    fn four_samples<L: Lanes>(
        &self,
        lanes: L,
        group: &GradientStencils,
        quartet: usize,
        is_single: bool,
    ) -> [[f32; 4]; 4] {
        let n = 4 * quartet;
        let [sum_xy, dx, dy] = self.sums_xy(lanes, group, n);
        let (mut sum_xy, mut dx, mut dy) = ([sum_xy; 4], [dx; 4], [dy; 4]);
        if !is_single {
            for i in 1..4 {
                [sum_xy[i], dx[i], dy[i]] = self.sums_xy(lanes, group, n + i);
            }
        }
        // Along z: the weights w_z for the value and the derivatives along x and y, w_z' for the derivative along z.
        let sum_xy = add_partial_sums(lanes, sum_xy);
        let weights = &group.stencils.weights;
        [
            sum_z(lanes, sum_xy, weights, quartet),
            sum_z(lanes, add_partial_sums(lanes, dx), weights, quartet),
            sum_z(lanes, add_partial_sums(lanes, dy), weights, quartet),
            sum_z(lanes, sum_xy, &group.weights, quartet),
        ]
    }

    /// Values in one group at a time for up to eight points, and in batches for more; both give the same bits.
    #[inline(always)]
    pub(super) fn values_on<L: Lanes>(&self, lanes: L, points: &[CellPoint<3>], out: &mut [f32]) {
        if points.len() <= GROUP_SIZE {
            self.values_batched::<L, 1>(lanes, points, out);
        } else {
            self.values_batched::<L, GROUPS_PER_BATCH>(lanes, points, out);
        }
    }

    /// Values, N groups of points at a time.
    /// `points` and `out` have the same length. Padding repeats the last point.
    #[inline(always)]
    fn values_batched<L: Lanes, const N: usize>(
        &self,
        lanes: L,
        points: &[CellPoint<3>],
        out: &mut [f32],
    ) {
        let mut stencils = [Stencils::default(); N];
        for (points, out) in points
            .chunks(N * GROUP_SIZE)
            .zip(out.chunks_mut(N * GROUP_SIZE))
        {
            // Locations and weights of the whole batch come first, its sums second: see the head.
            for (points, stencils) in points.chunks(GROUP_SIZE).zip(&mut stencils) {
                stencils.set(lanes, &self.locate(lanes, &group(points)));
            }
            // Eight points are two quartets. A whole group is stored at once; the last group writes only the
            // points that it has.
            for (stencils, out) in stencils.iter().zip(out.chunks_mut(GROUP_SIZE)) {
                let low = self.four_values(lanes, stencils, 0, out.len() == 1);
                if let Some(out) = out.first_chunk_mut::<GROUP_SIZE>() {
                    let high = self.four_values(lanes, stencils, 1, false);
                    lanes.store(lanes.join_halves(low, high), out);
                    continue;
                }
                let (first, rest) = out.split_at_mut(out.len().min(4));
                first.copy_from_slice(&low[..first.len()]);
                if !rest.is_empty() {
                    let high = self.four_values(lanes, stencils, 1, rest.len() == 1);
                    rest.copy_from_slice(&high[..rest.len()]);
                }
            }
        }
    }

    /// As [`Self::values_on`], with gradients per unit of reference length.
    #[inline(always)]
    pub(super) fn samples_on<L: Lanes>(
        &self,
        lanes: L,
        points: &[CellPoint<3>],
        out: &mut [[f32; 4]],
    ) {
        if points.len() <= GROUP_SIZE {
            self.samples_batched::<L, 1>(lanes, points, out);
        } else {
            self.samples_batched::<L, GROUPS_PER_BATCH>(lanes, points, out);
        }
    }

    /// Values and gradients, N groups of points at a time.
    /// An entry of `out` is the value and three derivatives.
    #[inline(always)]
    fn samples_batched<L: Lanes, const N: usize>(
        &self,
        lanes: L,
        points: &[CellPoint<3>],
        out: &mut [[f32; 4]],
    ) {
        let mut groups = [GradientStencils::default(); N];
        for (points, out) in points
            .chunks(N * GROUP_SIZE)
            .zip(out.chunks_mut(N * GROUP_SIZE))
        {
            for (points, to) in points.chunks(GROUP_SIZE).zip(&mut groups) {
                let positions = self.locate(lanes, &group(points));
                to.stencils.set(lanes, &positions);
                // The derivative along an axis has other weights; its scale is samples per unit of length,
                // negative on a reversed axis.
                to.weights.set(lanes, &positions.within, &SLOPE_POLYNOMIALS);
                for a in 0..3 {
                    let scale = lanes.mul(positions.signs[a], lanes.splat(self.per_unit[a]));
                    lanes.store(scale, &mut to.scales[a]);
                    lanes.store(positions.order[a], &mut to.exchanges[a]);
                }
            }
            for (group, out) in groups.iter().zip(out.chunks_mut(GROUP_SIZE)) {
                // Values and derivatives at two quartets. The second one is computed only if the group has
                // points in it.
                let low = self.four_samples(lanes, group, 0, out.len() == 1);
                let high = match out.len() {
                    5.. => self.four_samples(lanes, group, 1, out.len() == 5),
                    _ => low,
                };
                let mut slopes = [lanes.join_halves(low[1], high[1]); 3];
                let mut exchanges = slopes;
                for a in 0..3 {
                    slopes[a] = lanes.join_halves(low[a + 1], high[a + 1]);
                    exchanges[a] = lanes.load(&group.exchanges[a]);
                }
                // Derivatives of the folded point, which its symmetries move to the stored part of the period, back to
                // the point: first the exchanges, then reversals and scale.
                self.unsort_axes(lanes, &exchanges, &mut slopes);
                for a in 0..3 {
                    slopes[a] = lanes.mul(slopes[a], lanes.load(&group.scales[a]));
                }
                // From one row per component to one point per entry.
                let [x, y, z] = slopes;
                let all = lanes.rows_to_columns([lanes.join_halves(low[0], high[0]), x, y, z]);
                out.copy_from_slice(&all[..out.len()]);
            }
        }
    }
}

/// Adds the two partial sums of each neighbour along z; the result has two points per row.
#[inline(always)]
fn add_partial_sums<L: Lanes>(lanes: L, [a, b, c, d]: [L::F; 4]) -> [L::F; 2] {
    [lanes.add_adjacent(a, b), lanes.add_adjacent(c, d)]
}

/// The sums along z at four points, from rows of two points.
/// Row `n` holds the points 2 n and 2 n + 1 of the quartet.
#[inline(always)]
fn sum_z<L: Lanes>(lanes: L, rows: [L::F; 2], weights: &Weights, quartet: usize) -> [f32; 4] {
    let low = lanes.mul(rows[0], weights.z(lanes, 2 * quartet));
    let high = lanes.mul(rows[1], weights.z(lanes, 2 * quartet + 1));
    lanes.add_halves(lanes.add_adjacent(low, high))
}
