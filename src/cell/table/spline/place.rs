//! Where points lie in a folded table, eight at a time.
//!
//! Which part of a period a point is in is found in double precision, the rest in single: a place is off
//! by at most [`PLACING`] of a period.
// Small functions of one hot path: a call each would cost as much as the work.
#![allow(clippy::inline_always)]

use super::{GROUP, Spline};
use crate::frame::CellPoint;
use crate::simd::{Lanes, Twice};

/// The first of the two axes that each step puts in order.
const STEPS: [usize; 3] = [0, 1, 0];

/// How far rounding moves a place, in periods: a part of a period and its spline cells in single
/// precision, half a unit of the last place each.
pub(in super::super) const PLACING: f64 = 6e-8;

/// Places of a group of points.
pub(super) struct Places<L: Lanes> {
    /// The first plane of the coefficients around a point.
    pub(super) plane: [i32; GROUP],
    /// Where in a plane they start.
    pub(super) start: [i32; GROUP],
    /// Place in the spline cell, by axis.
    pub(super) within: [L::F; 3],
    /// 1, or -1 along axes that were reversed.
    pub(super) signs: [L::F; 3],
    /// What made axes change places after that.
    pub(super) order: Order<L>,
}

/// Differences of coordinates, each positive where the two changed places: first of y and x, then of z and
/// y, then of y and x again.
pub(super) type Order<L> = [<L as Lanes>::F; 3];

/// A group of at most eight points; beyond their end the last one again.
#[inline(always)]
pub(in super::super) fn group(points: &[CellPoint<3>]) -> [[f64; 3]; GROUP] {
    let mut all = [[0.0; 3]; GROUP];
    if let Some(points) = points.first_chunk::<GROUP>() {
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
    /// Places a group of points.
    #[inline(always)]
    pub(super) fn places<L: Lanes>(&self, lanes: L, points: &[[f64; 3]; GROUP]) -> Places<L> {
        let two = lanes.two();
        let turned = two.turned_eight(points);
        let (zero, half, one) = (lanes.splat(0.0), lanes.splat(0.5), lanes.splat(1.0));
        let mut turns = two.all_eight(0.0);
        let mut reversed = one;
        let (mut part, mut signs) = ([one; 3], [one; 3]);
        for a in 0..3 {
            let axis = &self.axes[a];
            let mut v = two.mul_eight(turned[a], two.all_eight(axis.rate));
            if a == 2 {
                v = two.sub_eight(v, two.mul_eight(turns, two.all_eight(self.carry)));
            }
            let whole = two.floor_eight(two.add_eight(v, two.all_eight(axis.ahead)));
            turns = two.add_eight(turns, whole);
            let mut v = two.singles_eight(two.sub_eight(v, whole));
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
        let order = self.put_in_order(lanes, &mut part);
        let (mut cells, mut within) = (part, part);
        for a in 0..3 {
            let (axis, v) = (&self.axes[a], part[a]);
            let samples = lanes.splat(axis.samples);
            // What is no number lies in any cell.
            let cell = lanes.min(lanes.floor(lanes.mul(v, samples)), lanes.splat(axis.last));
            cells[a] = lanes.max(cell, zero);
            within[a] = lanes.fused(v, samples, lanes.sub(zero, cells[a]));
        }
        let start = lanes.mul(cells[2], lanes.splat(self.strides[1]));
        let start = lanes.fused(cells[1], lanes.splat(self.strides[0]), start);
        Places {
            plane: lanes.integers(cells[0]),
            start: lanes.integers(start),
            within,
            signs,
            order,
        }
    }

    /// Puts coordinates of axes that may be exchanged in order, the greatest first.
    #[inline(always)]
    fn put_in_order<L: Lanes>(&self, lanes: L, part: &mut [L::F; 3]) -> Order<L> {
        let mut order = [lanes.splat(0.0); 3];
        for (step, first) in STEPS.into_iter().enumerate() {
            if self.takes(step) {
                let (a, b) = (part[first], part[first + 1]);
                order[step] = lanes.sub(b, a);
                part[first] = lanes.max(a, b);
                part[first + 1] = lanes.min(a, b);
            }
        }
        order
    }

    /// Numbers along the axes in order, each for its own axis again.
    #[inline(always)]
    pub(super) fn put_back<L: Lanes>(&self, lanes: L, order: &Order<L>, along: &mut [L::F; 3]) {
        let zero = lanes.splat(0.0);
        for (step, first) in STEPS.into_iter().enumerate().rev() {
            if self.takes(step) {
                let (a, b) = (along[first], along[first + 1]);
                along[first] = lanes.select_below(zero, order[step], b, a);
                along[first + 1] = lanes.select_below(zero, order[step], a, b);
            }
        }
    }

    /// Whether a step of [`STEPS`] is taken: the last only where all three axes are put in order.
    #[inline(always)]
    fn takes(&self, step: usize) -> bool {
        let [xy, yz] = self.is_ordered;
        [xy, yz, xy && yz][step]
    }
}
