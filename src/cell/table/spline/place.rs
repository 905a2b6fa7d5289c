//! Where points lie in a folded table, eight at a time.
// Small functions of one hot path: a call each would cost as much as the work.
#![allow(clippy::inline_always)]

use super::{GROUP, Spline};
use crate::frame::CellPoint;
use crate::lanes::{Lanes, Twice};

/// Places of a group of points.
pub(super) struct Places {
    /// Where in the table the coefficients of the first plane start.
    pub(super) at: [i32; GROUP],
    /// Place in the spline cell, by axis.
    pub(super) within: [[f32; GROUP]; 3],
    /// 1, or -1 along axes that were reversed.
    pub(super) signs: [[f32; GROUP]; 3],
}

/// Four of some points; the last one again beyond their end.
#[inline(always)]
pub(in super::super) fn four(points: &[CellPoint<3>], first: usize) -> [[f64; 3]; 4] {
    let last = points.len() - 1;
    [
        points[first.min(last)].0.into(),
        points[(first + 1).min(last)].0.into(),
        points[(first + 2).min(last)].0.into(),
        points[(first + 3).min(last)].0.into(),
    ]
}

impl Spline {
    /// Places a group of at most eight points: beyond their end is the last one again.
    #[inline(always)]
    pub(super) fn places<L: Lanes>(&self, lanes: L, points: &[CellPoint<3>]) -> Places {
        let two = lanes.two();
        let (low, high) = (lanes.turned(four(points, 0)), lanes.turned(four(points, 4)));
        let one = two.all_eight(1.0);
        let mut turns = two.all_eight(0.0);
        let mut reversed = one;
        let mut at = two.all_eight(0.0);
        let (mut within, mut signs) = ([[0.0; GROUP]; 3], [[0.0; GROUP]; 3]);
        for a in 0..3 {
            let axis = &self.axes[a];
            let x = two.eight([low[a], high[a]]);
            let mut v = two.mul_eight(x, two.all_eight(axis.rate));
            if a == 2 {
                v = two.sub_eight(v, two.mul_eight(turns, two.all_eight(self.carry)));
                if self.is_twofold {
                    v = two.mul_eight(v, reversed);
                }
            }
            let mut sign = one;
            if axis.is_halved {
                let whole = two.floor_eight(two.add_eight(v, two.all_eight(0.5)));
                turns = two.add_eight(turns, whole);
                v = two.sub_eight(v, whole);
                sign = two.sign_eight(v);
                v = two.mul_eight(v, sign);
                reversed = two.mul_eight(reversed, sign);
            } else {
                let whole = two.floor_eight(v);
                turns = two.add_eight(turns, whole);
                v = two.sub_eight(v, whole);
                if a == 2 && self.is_twofold {
                    sign = reversed;
                }
            }
            let u = two.mul_eight(v, two.all_eight(axis.samples));
            let cell = two.min_eight(two.floor_eight(u), two.all_eight(axis.last));
            let stride = two.all_eight(self.strides[a]);
            at = two.add_eight(at, two.mul_eight(cell, stride));
            let inside = two.singles_eight(two.sub_eight(u, cell));
            lanes.store(inside, &mut within[a]);
            lanes.store(two.singles_eight(sign), &mut signs[a]);
        }
        // What is no number lies anywhere in the table.
        at = two.min_eight(at, two.all_eight(self.last));
        at = two.max_eight(at, two.all_eight(0.0));
        Places {
            at: two.integers_eight(at),
            within,
            signs,
        }
    }
}
