//! Second-order Taylor expansion of the inverse map x -> xi of an element about a point.
//!
//! With d = x - x0, xi(x) = xi0 + A d + second order, where A is the inverse Jacobian at x0. It is an estimate: its
//! error grows with the cube of d, and its user bounds or corrects it.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand. Closures
// are not: no SIMD arithmetic is written in them.
#![allow(clippy::inline_always)]

use super::inverse_map::{CurvedMap, matrix_rows, product};
use super::patch::Preimage;
use druse_geometry::frame::{Mat3, Vec3};
use druse_geometry::simd::{Number, difference, splat_vector};

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
            map.second_derivatives(self.xi, &self.inverse)
                .filter(is_finite)
        };
        Self {
            second_derivatives: known.or_else(found),
            ..self
        }
    }

    /// xi at a row of points.
    #[inline(always)]
    pub fn estimate_row<T: Number>(&self, x: [T; 3]) -> [T; 3] {
        let lane = x[0];
        let d = difference(x, splat_vector(lane, self.x));
        let mut xi = product(
            matrix_rows(&self.inverse, lane),
            d,
            splat_vector(lane, self.xi),
        );
        let Some(derivatives) = &self.second_derivatives else {
            return xi;
        };
        let [p, q, r] = d;
        let products = [p * p, q * q, r * r, p * q, q * r, r * p];
        for (derivative, product) in derivatives.iter().zip(products) {
            for (to, derivative) in xi.iter_mut().zip(splat_vector(lane, *derivative)) {
                *to = product.fused(derivative, *to);
            }
        }
        xi
    }

    /// xi at a point.
    pub fn estimate(&self, x: Vec3) -> Vec3 {
        self.estimate_row::<f64>(x.into()).into()
    }
}
