//! Evaluation of short series from products of sines and cosines, without a table look-up.
//!
//! Eight points are evaluated at a time. The fractions of the period are computed in double precision, sines and
//! cosines of the first harmonic by polynomials in single precision, the other harmonics by addition theorems. The
//! value at a point is bit-identical alone and in a batch. The law `products_are_their_series` allows errors of 2e-6 of
//! the sum of the waves' sizes in values, 4e-5 in gradients.
// Small functions of a hot path, inlined because a call costs as much as their work.
#![allow(clippy::inline_always)]

use super::super::Products;
use super::super::trig_products::Along;
use super::spline::{GROUP_SIZE, group};
use super::{Function, Table};
use druse_geometry::frame::CellPoint;
use druse_geometry::simd::{Lanes, SimdKernel, WideLanes};
use std::f32::consts::TAU;

/// Maximal number of products that replace a look-up. Up to six are measured to be faster; more are
/// not measured (`cargo bench --bench workloads P6`).
const MAX_DIRECT_PRODUCTS: usize = 8;

impl Table {
    /// Selects evaluation from products if the function is a sum of few products.
    pub(super) fn prefer_products(&mut self) {
        let (Some(products), Function::Single(leaf)) = (&self.products, &self.function) else {
            return;
        };
        if !products.is_single() || products.terms() > MAX_DIRECT_PRODUCTS {
            return;
        }
        let [value, slope, _] = leaf.errors();
        // Ranges and bounds stay those of the spline: they are widened by its error, a gradient by that of
        // its three components.
        self.slack = [value, 3f64.sqrt() * slope];
        (self.error_bound, self.gradient_error_bound) = (leaf.rounding(), leaf.gradient_rounding());
        self.gradient_sup += self.slack[1];
        let [value, slope] = self.slack;
        self.gradient_bounds = self.gradient_bounds.take().map(|s| s.widened(value, slope));
        self.error_rms = 0.0;
        self.is_direct = true;
        log::debug!(target: "druse::cell", "{} products of sines and cosines replace the look-up", products.terms());
    }

    /// Whether values are computed from products of sines and cosines, not from the spline.
    pub fn is_direct(&self) -> bool {
        self.is_direct
    }
}

/// Values at points, into a slice of the same length.
pub(super) struct Values<'a>(pub &'a Products, pub &'a [CellPoint<3>], pub &'a mut [f32]);

/// Values and gradients (per unit of reference length) at points, into a slice of the same length.
pub(super) struct Samples<'a>(
    pub &'a Products,
    pub &'a [CellPoint<3>],
    pub &'a mut [[f32; 4]],
);

/// The functions along each axis for a group of at most eight points.
/// Positions are in periods; missing points are copies of the last.
#[inline(always)]
fn functions<L: Lanes>(l: L, products: &Products, points: &[CellPoint<3>]) -> [Along<L::F>; 3] {
    let wide = l.wide();
    let half = wide.splat_eight(0.5);
    let [x, y, z] = wide.transpose_eight(&group(points));
    // Fractions of a period, from -1/2 to 1/2.
    let x = wide.sub_eight(x, wide.floor_eight(wide.add_eight(x, half)));
    let y = wide.sub_eight(y, wide.floor_eight(wide.add_eight(y, half)));
    let z = wide.sub_eight(z, wide.floor_eight(wide.add_eight(z, half)));
    [
        products.axis_functions_of(l, wide.narrow_eight(x)),
        products.axis_functions_of(l, wide.narrow_eight(y)),
        products.axis_functions_of(l, wide.narrow_eight(z)),
    ]
}

impl SimdKernel for Values<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self(products, points, out) = self;
        for (points, out) in points.chunks(GROUP_SIZE).zip(out.chunks_mut(GROUP_SIZE)) {
            let [x, y, z] = functions(l, products, points);
            let value = products.value(l, [&x, &y, &z]);
            if let Some(out) = out.first_chunk_mut() {
                l.store(value, out);
                continue;
            }
            let mut values = [0.0; GROUP_SIZE];
            l.store(value, &mut values);
            out.copy_from_slice(&values[..out.len()]);
        }
    }
}

impl SimdKernel for Samples<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self(products, points, out) = self;
        let radians_per_period = l.splat(TAU);
        for (points, out) in points.chunks(GROUP_SIZE).zip(out.chunks_mut(GROUP_SIZE)) {
            let [x, y, z] = functions(l, products, points);
            let (value, slope) = products.slope(l, [&x, &y, &z]);
            let mut rows = [[0.0; GROUP_SIZE]; 4];
            l.store(value, &mut rows[0]);
            for a in 0..3 {
                l.store(l.mul(slope[a], radians_per_period), &mut rows[a + 1]);
            }
            for (n, out) in out.iter_mut().enumerate() {
                *out = [rows[0][n], rows[1][n], rows[2][n], rows[3][n]];
            }
        }
    }
}
