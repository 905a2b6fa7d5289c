//! The map from the world to an element's cell about a point, to the second order.
// Small functions of hot paths, which must be compiled for the processor that their caller is for;
// arithmetic on lanes stands in no closure, which would not be.
#![allow(clippy::inline_always)]

use super::inverse_map::{Matrix, product, rows};
use super::patch::Spot;
use crate::frame::{CellPoint, Mat3, Vec3};
use crate::simd::{self, Lanes, Number, Work, alike, difference};

/// A point as an element has placed it: from there others are guessed.
#[derive(Clone, Copy)]
pub(super) struct Trail {
    pub x: Vec3,
    pub xi: Vec3,
    /// d xi / d x.
    pub inverse: Mat3,
    /// Half the second derivatives of xi by x: by x x, y y, z z, and twice that by x y, y z, z x, if they
    /// are known and not 0.
    pub bend: Option<[Vec3; 6]>,
}

impl Trail {
    /// The same second derivatives from another point.
    pub fn moved(self, x: Vec3, spot: &Spot) -> Self {
        Self {
            x,
            xi: spot.xi,
            inverse: spot.inverse,
            ..self
        }
    }

    /// Where points lie, by their reference coordinates.
    #[inline(always)]
    pub fn guess_row<T: Number>(&self, x: [T; 3]) -> [T; 3] {
        let like = x[0];
        let d = difference(x, alike(like, self.x));
        let mut xi = product(self.rows(like), d, alike(like, self.xi));
        let Some(bend) = &self.bend else {
            return xi;
        };
        let [p, q, r] = d;
        let second = [p * p, q * q, r * r, p * q, q * r, r * p];
        for (bend, second) in bend.iter().zip(second) {
            for (to, bend) in xi.iter_mut().zip(alike(like, *bend)) {
                *to = second.fused(bend, *to);
            }
        }
        xi
    }

    /// d xi / d x where points lie.
    #[inline(always)]
    pub fn inverse_row<T: Number>(&self, x: [T; 3]) -> Matrix<T> {
        // Which second derivatives each column grows by, along x, y and z.
        const GROW: [[usize; 3]; 3] = [[0, 3, 5], [3, 1, 4], [5, 4, 2]];
        let like = x[0];
        let mut by = self.rows(like);
        let Some(bend) = &self.bend else {
            return by;
        };
        let d = difference(x, alike(like, self.x));
        for (column, grow) in GROW.iter().enumerate() {
            for (axis, (&n, d)) in grow.iter().zip(d).enumerate() {
                let d = if axis == column { d + d } else { d };
                for (row, bend) in by.iter_mut().zip(alike(like, bend[n])) {
                    row[column] = d.fused(bend, row[column]);
                }
            }
        }
        by
    }

    /// d xi / d x at the trail's start, by rows.
    #[inline(always)]
    pub fn rows<T: Number>(&self, like: T) -> Matrix<T> {
        let m = &self.inverse;
        [
            alike(like, Vec3::new(m[0], m[3], m[6])),
            alike(like, Vec3::new(m[1], m[4], m[7])),
            alike(like, Vec3::new(m[2], m[5], m[8])),
        ]
    }

    /// Where a point lies, by its reference coordinates.
    pub fn guess(&self, x: Vec3) -> Vec3 {
        self.guess_row::<f64>(x.into()).into()
    }

    /// Adds where points lie to `found`.
    pub fn guess_all(&self, points: &[Vec3], found: &mut Vec<CellPoint<3>>) {
        simd::run(Guess(self, points, found));
    }
}

struct Guess<'a>(&'a Trail, &'a [Vec3], &'a mut Vec<CellPoint<3>>);

impl Work for Guess<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self(trail, points, found) = self;
        for points in points.chunks(4) {
            let [x, y, z] = trail.guess_row(rows(lanes, points));
            let (x, y, z) = (x.row(), y.row(), z.row());
            let all = [
                CellPoint(Vec3::new(x[0], y[0], z[0])),
                CellPoint(Vec3::new(x[1], y[1], z[1])),
                CellPoint(Vec3::new(x[2], y[2], z[2])),
                CellPoint(Vec3::new(x[3], y[3], z[3])),
            ];
            found.extend_from_slice(&all[..points.len()]);
        }
    }
}
