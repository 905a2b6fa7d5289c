//! Where points lie in a folded table, eight at a time.
// Small functions of one hot path: a call each would cost as much as the work.
#![allow(clippy::inline_always)]

use super::{GROUP, Spline};
use crate::frame::CellPoint;
use crate::lanes::Lanes;

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
    /// Places four points: where their coefficients start, and their places and signs by axis.
    #[inline(always)]
    fn place<L: Lanes>(&self, lanes: L, x: [L::D; 3]) -> ([i32; 4], [[f32; 4]; 3], [[f32; 4]; 3]) {
        let one = lanes.all_four(1.0);
        let mut turns = lanes.all_four(0.0);
        let mut reversed = one;
        let mut at = lanes.all_four(0.0);
        let (mut within, mut signs) = ([[0.0; 4]; 3], [[0.0; 4]; 3]);
        for a in 0..3 {
            let axis = &self.axes[a];
            let mut v = lanes.mul_four(x[a], lanes.all_four(axis.rate));
            if a == 2 {
                v = lanes.sub_four(v, lanes.mul_four(turns, lanes.all_four(self.carry)));
                if self.is_twofold {
                    v = lanes.mul_four(v, reversed);
                }
            }
            let mut sign = one;
            if axis.is_halved {
                let whole = lanes.floor_four(lanes.add_four(v, lanes.all_four(0.5)));
                turns = lanes.add_four(turns, whole);
                v = lanes.sub_four(v, whole);
                sign = lanes.sign_four(v);
                v = lanes.mul_four(v, sign);
                reversed = lanes.mul_four(reversed, sign);
            } else {
                let whole = lanes.floor_four(v);
                turns = lanes.add_four(turns, whole);
                v = lanes.sub_four(v, whole);
                if a == 2 && self.is_twofold {
                    sign = reversed;
                }
            }
            let u = lanes.mul_four(v, lanes.all_four(axis.samples));
            let cell = lanes.min_four(lanes.floor_four(u), lanes.all_four(axis.last));
            let stride = lanes.all_four(self.strides[a]);
            at = lanes.add_four(at, lanes.mul_four(cell, stride));
            within[a] = lanes.singles(lanes.sub_four(u, cell));
            signs[a] = lanes.singles(sign);
        }
        // What is no number lies anywhere in the table.
        at = lanes.min_four(at, lanes.all_four(self.last));
        at = lanes.max_four(at, lanes.all_four(0.0));
        (lanes.integers(at), within, signs)
    }

    /// Places a group of at most eight points.
    #[inline(always)]
    pub(super) fn places<L: Lanes>(&self, lanes: L, points: &[CellPoint<3>]) -> Places {
        let mut places = Places {
            at: [0; GROUP],
            within: [[0.0; GROUP]; 3],
            signs: [[0.0; GROUP]; 3],
        };
        let (at, within, signs) = self.place(lanes, lanes.turned(four(points, 0)));
        places.at[..4].copy_from_slice(&at);
        if points.len() <= 4 {
            for a in 0..3 {
                places.within[a][..4].copy_from_slice(&within[a]);
                places.signs[a][..4].copy_from_slice(&signs[a]);
            }
            return places;
        }
        let (at, others, beside) = self.place(lanes, lanes.turned(four(points, 4)));
        places.at[4..].copy_from_slice(&at);
        for a in 0..3 {
            lanes.store(lanes.both(within[a], others[a]), &mut places.within[a]);
            lanes.store(lanes.both(signs[a], beside[a]), &mut places.signs[a]);
        }
        places
    }
}
