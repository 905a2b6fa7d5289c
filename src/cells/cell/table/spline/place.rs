//! Location of points in a folded table, eight at a time.
//!
//! The fraction of a period is computed in double precision, the rest in single precision. The position error
//! is at most [`POSITION_ERROR`] periods.
// Small functions of a hot path, inlined because a call costs as much as their work.
#![allow(clippy::inline_always)]

use super::{GROUP_SIZE, Spline};
use druse_geometry::frame::CellPoint;
use druse_geometry::simd::{Lanes, WideLanes};

/// The first of the two axes that each sorting step compares.
const SORT_STEPS: [usize; 3] = [0, 1, 0];

/// Bound of the rounding error of a position, in periods: the fraction of a period and the spline cell in
/// single precision, half a unit in the last place each.
pub(in super::super) const POSITION_ERROR: f64 = 6e-8;

/// Positions of a group of points in the table.
pub(super) struct Positions<L: Lanes> {
    /// The first plane of the coefficients around each point.
    pub(super) plane: [i32; GROUP_SIZE],
    /// The first entry in that plane.
    pub(super) start: [i32; GROUP_SIZE],
    /// Position in the spline cell, 0 to 1, by axis.
    pub(super) within: [L::F; 3],
    /// 1, or -1 along reversed axes.
    pub(super) signs: [L::F; 3],
    /// The exchanges of axes after the reversal.
    pub(super) order: AxisExchanges<L>,
}

/// Differences of coordinates, positive if the two axes are exchanged: first of y and x, then of z and y,
/// then of y and x again.
pub(super) type AxisExchanges<L> = [<L as Lanes>::F; 3];

/// A group of at most eight points, padded with the last point.
/// `points` is not empty.
#[inline(always)]
pub(in super::super) fn group(points: &[CellPoint<3>]) -> [[f64; 3]; GROUP_SIZE] {
    let mut all = [[0.0; 3]; GROUP_SIZE];
    if let Some(points) = points.first_chunk::<GROUP_SIZE>() {
        for (to, p) in all.iter_mut().zip(points) {
            *to = p.0.into();
        }
        return all;
    }
    let last = points.len() - 1;
    for (n, to) in all.iter_mut().enumerate() {
        *to = points[n.min(last)].0.into();
    }
    all
}

impl Spline {
    /// Locates a group of points.
    /// Coordinates are reference coordinates, anywhere in space; the position is that in the stored part.
    #[inline(always)]
    pub(super) fn locate<L: Lanes>(
        &self,
        lanes: L,
        points: &[[f64; 3]; GROUP_SIZE],
    ) -> Positions<L> {
        let two = lanes.wide();
        let coordinates = two.transpose_eight(points);
        let (zero, half, one) = (lanes.splat(0.0), lanes.splat(0.5), lanes.splat(1.0));
        let mut shifts = two.splat_eight(0.0);
        let mut reversed = one;
        let (mut part, mut signs) = ([one; 3], [one; 3]);
        for a in 0..3 {
            let axis = &self.axes[a];
            // v = x / fold period, in double precision: far from the origin single precision would lose the fraction.
            let mut v = two.mul_eight(coordinates[a], two.splat_eight(axis.rate));
            // Each fold period along x and y of a centred lattice shifts z by half a period.
            if a == 2 {
                v = two.sub_eight(
                    v,
                    two.mul_eight(shifts, two.splat_eight(self.centring_shift)),
                );
            }
            // The fraction of the fold period, about 0 for a halved axis.
            let whole = two.floor_eight(two.add_eight(v, two.splat_eight(axis.offset)));
            shifts = two.add_eight(shifts, whole);
            let mut v = two.narrow_eight(two.sub_eight(v, whole));
            // On a mirrored axis |v| is located, and the sign is kept for the gradient. A twofold rotation
            // reverses two axes at once: z, whose fractions begin at 0, is reversed about 1/2 with either x or y.
            if axis.is_halved {
                signs[a] = lanes.sign(v);
                v = lanes.mul(v, signs[a]);
                reversed = lanes.mul(reversed, signs[a]);
            } else if a == 2 && self.is_twofold {
                signs[a] = reversed;
                v = lanes.fused(lanes.sub(v, half), reversed, half);
            }
            part[a] = v;
        }
        // v N = cell + within.
        let order = self.sort_axes(lanes, &mut part);
        let (mut cells, mut within) = (part, part);
        for a in 0..3 {
            let (axis, v) = (&self.axes[a], part[a]);
            let samples = lanes.splat(axis.samples);
            // A NaN coordinate lies in an arbitrary cell.
            let cell = lanes.min(lanes.floor(lanes.mul(v, samples)), lanes.splat(axis.last));
            cells[a] = lanes.max(cell, zero);
            within[a] = lanes.fused(v, samples, lanes.sub(zero, cells[a]));
        }
        // Index in the plane, exact in single precision for the largest tables.
        let start = lanes.mul(cells[2], lanes.splat(self.strides[1]));
        let start = lanes.fused(cells[1], lanes.splat(self.strides[0]), start);
        Positions {
            plane: lanes.to_integers(cells[0]),
            start: lanes.to_integers(start),
            within,
            signs,
            order,
        }
    }

    /// Sorts the coordinates of exchangeable axes in descending order.
    /// The result lets [`Self::unsort_axes`] undo it.
    #[inline(always)]
    fn sort_axes<L: Lanes>(&self, lanes: L, part: &mut [L::F; 3]) -> AxisExchanges<L> {
        let mut order = [lanes.splat(0.0); 3];
        for (step, first) in SORT_STEPS.into_iter().enumerate() {
            if self.is_step_needed(step) {
                let (a, b) = (part[first], part[first + 1]);
                order[step] = lanes.sub(b, a);
                part[first] = lanes.max(a, b);
                part[first + 1] = lanes.min(a, b);
            }
        }
        order
    }

    /// Undoes the sorting for components along the sorted axes.
    /// `along` is in the order of the sorted axes, and then in that of x, y and z.
    #[inline(always)]
    pub(super) fn unsort_axes<L: Lanes>(
        &self,
        lanes: L,
        order: &AxisExchanges<L>,
        along: &mut [L::F; 3],
    ) {
        let zero = lanes.splat(0.0);
        for (step, first) in SORT_STEPS.into_iter().enumerate().rev() {
            if self.is_step_needed(step) {
                let (a, b) = (along[first], along[first + 1]);
                along[first] = lanes.select_below(zero, order[step], b, a);
                along[first + 1] = lanes.select_below(zero, order[step], a, b);
            }
        }
    }

    /// Whether a step of [`SORT_STEPS`] is needed; the last only if all three axes are sorted.
    #[inline(always)]
    fn is_step_needed(&self, step: usize) -> bool {
        let [xy, yz] = self.is_sorted;
        [xy, yz, xy && yz][step]
    }
}
