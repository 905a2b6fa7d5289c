//! Second-order Taylor expansion of the inverse map x -> xi of an element about a point.
//!
//! With d = x - x0, xi(x) = xi0 + A d + second order, where A is the inverse Jacobian at x0. It is an estimate: its
//! error grows with the cube of d, and its user bounds or corrects it.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand. Closures
// are not: no SIMD arithmetic is written in them.
#![allow(clippy::inline_always)]

use super::inverse_map::{CurvedMap, Matrix, matrix_rows, product};
use super::patch::Preimage;
use druse_geometry::frame::{Mat3, Vec3};
use druse_geometry::simd::{Eight, Lanes, Number, difference, splat_vector};

/// The expansion of xi(x) about a point: Newton's method for nearby points starts from it.
#[derive(Clone, Copy)]
pub(super) struct LocalMap {
    /// The centre of the expansion, world units.
    pub x: Vec3,
    /// Its preimage.
    pub xi: Vec3,
    /// d xi / d x.
    pub inverse: Mat3,
    /// Half the second derivatives of xi by x: xx / 2, yy / 2, zz / 2, xy, yz, zx; none where they are unknown or 0.
    pub second_derivatives: Option<[Vec3; 6]>,
}

impl LocalMap {
    /// The expansion of first order about a point with this preimage.
    pub fn linear(x: Vec3, preimage: &Preimage) -> Self {
        Self {
            x,
            xi: preimage.xi,
            inverse: preimage.inverse,
            second_derivatives: None,
        }
    }

    /// The same with second derivatives, which change little from point to point: known ones are kept.
    pub fn with_second_derivatives(self, map: CurvedMap) -> Self {
        let known = self.second_derivatives;
        let is_finite = |all: &[Vec3; 6]| all.iter().all(|d| d.sum().is_finite());
        let found = || {
            let all = map.second_derivatives(self.xi.into(), matrix_rows(&self.inverse, 0.0));
            all.map(|all| all.map(Vec3::from)).filter(is_finite)
        };
        Self {
            second_derivatives: known.or_else(found),
            ..self
        }
    }

    /// The same expansion for each point of a row; `lane` is any value of the row type.
    #[inline(always)]
    pub fn in_row<T: Number>(&self, lane: T) -> RowMap<T> {
        RowMap {
            x: splat_vector(lane, self.x),
            xi: splat_vector(lane, self.xi),
            inverse: matrix_rows(&self.inverse, lane),
            second_derivatives: self.second_derivatives,
        }
    }

    /// xi at a point.
    pub fn estimate(&self, x: Vec3) -> Vec3 {
        self.in_row(0.0).estimate(x.into()).into()
    }
}

/// An expansion for each point of a row, see [`LocalMap`].
#[derive(Clone, Copy)]
pub(super) struct RowMap<T> {
    pub x: [T; 3],
    pub xi: [T; 3],
    pub inverse: Matrix<T>,
    /// The same for all points.
    pub second_derivatives: Option<[Vec3; 6]>,
}

impl<T: Number> RowMap<T> {
    /// xi at a row of points.
    #[inline(always)]
    pub fn estimate(&self, x: [T; 3]) -> [T; 3] {
        let d = difference(x, self.x);
        let mut xi = product(self.inverse, d, self.xi);
        let Some(derivatives) = &self.second_derivatives else {
            return xi;
        };
        let [p, q, r] = d;
        let products = [p * p, q * q, r * r, p * q, q * r, r * p];
        for (derivative, product) in derivatives.iter().zip(products) {
            for (to, derivative) in xi.iter_mut().zip(splat_vector(p, *derivative)) {
                *to = product.fused(derivative, *to);
            }
        }
        xi
    }
}

impl<L: Lanes> RowMap<Eight<L>> {
    /// The expansion of one point of the row.
    #[inline(always)]
    pub fn of_lane(&self, lane: usize) -> LocalMap {
        let [a, b, c] = self.inverse;
        let (a, b, c) = (at_lane(a, lane), at_lane(b, lane), at_lane(c, lane));
        LocalMap {
            x: at_lane(self.x, lane),
            xi: at_lane(self.xi, lane),
            inverse: Mat3::new(a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z),
            second_derivatives: self.second_derivatives,
        }
    }
}

/// The vector of one point.
#[inline(always)]
pub(super) fn at_lane<L: Lanes>([x, y, z]: [Eight<L>; 3], lane: usize) -> Vec3 {
    Vec3::new(x.row()[lane % 8], y.row()[lane % 8], z.row()[lane % 8])
}
