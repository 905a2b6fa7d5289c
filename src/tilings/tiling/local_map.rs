//! Second-order Taylor expansion of the inverse map x -> xi of an element about a point.
//!
//! With d = x - x0, xi(x) = xi0 + A d + second order, where A is the inverse Jacobian at x0. It is an estimate: its
//! error grows with the cube of d, and its user bounds or corrects it.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand. Closures
// are not: no SIMD arithmetic is written in them.
#![allow(clippy::inline_always)]

use super::inverse_map::{Matrix, product, rows};
use super::patch::Preimage;
use druse_geometry::frame::{CellPoint, Mat3, Vec3};
use druse_geometry::simd::{self, Lanes, Number, SimdKernel, difference, splat_vector};

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
    /// The expansion about another point, with the same second derivatives.
    pub fn recentred(self, x: Vec3, preimage: &Preimage) -> Self {
        Self {
            x,
            xi: preimage.xi,
            inverse: preimage.inverse,
            ..self
        }
    }

    /// xi at a row of points.
    #[inline(always)]
    pub fn estimate_row<T: Number>(&self, x: [T; 3]) -> [T; 3] {
        let lane = x[0];
        let d = difference(x, splat_vector(lane, self.x));
        let mut xi = product(self.inverse_rows(lane), d, splat_vector(lane, self.xi));
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

    /// d xi / d x at a row of points. Row i holds the derivatives of coordinate i of xi.
    #[inline(always)]
    pub fn inverse_jacobian_row<T: Number>(&self, x: [T; 3]) -> Matrix<T> {
        // The second derivatives that change each column along x, y and z.
        const SECOND_DERIVATIVES: [[usize; 3]; 3] = [[0, 3, 5], [3, 1, 4], [5, 4, 2]];
        let lane = x[0];
        let mut inverse = self.inverse_rows(lane);
        let Some(derivatives) = &self.second_derivatives else {
            return inverse;
        };
        let d = difference(x, splat_vector(lane, self.x));
        for (column, indices) in SECOND_DERIVATIVES.iter().enumerate() {
            for (axis, (&n, d)) in indices.iter().zip(d).enumerate() {
                let d = if axis == column { d + d } else { d };
                for (row, derivative) in inverse.iter_mut().zip(splat_vector(lane, derivatives[n]))
                {
                    row[column] = d.fused(derivative, row[column]);
                }
            }
        }
        inverse
    }

    /// d xi / d x at the centre of the expansion, by rows.
    #[inline(always)]
    pub fn inverse_rows<T: Number>(&self, lane: T) -> Matrix<T> {
        let m = &self.inverse;
        [
            splat_vector(lane, Vec3::new(m[0], m[3], m[6])),
            splat_vector(lane, Vec3::new(m[1], m[4], m[7])),
            splat_vector(lane, Vec3::new(m[2], m[5], m[8])),
        ]
    }

    /// xi at a point.
    pub fn estimate(&self, x: Vec3) -> Vec3 {
        self.estimate_row::<f64>(x.into()).into()
    }

    /// Appends xi at each point to `found`.
    pub fn estimate_all(&self, points: &[Vec3], found: &mut Vec<CellPoint<3>>) {
        simd::run(EstimateKernel(self, points, found));
    }
}

struct EstimateKernel<'a>(&'a LocalMap, &'a [Vec3], &'a mut Vec<CellPoint<3>>);

impl SimdKernel for EstimateKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self(local_map, points, found) = self;
        for points in points.chunks(4) {
            let [x, y, z] = local_map.estimate_row(rows(lanes, points));
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
