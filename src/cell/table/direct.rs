//! Short series without a look-up: products of sines and cosines at points anywhere, eight at a time.
//!
//! A point's parts of its period are found in double precision, sines and cosines of the first harmonic by
//! polynomials in single, the others by their sums' theorems. A point gives the same bits alone and among
//! others.
// Small functions of one hot path: a call each would cost as much as the work.
#![allow(clippy::inline_always)]

use super::super::Products;
use super::super::trig_products::Along;
use super::spline::{GROUP, group};
use super::{Function, Table};
use crate::frame::CellPoint;
use crate::simd::{Lanes, Twice, Work};
use std::f32::consts::TAU;

/// Most products that are taken instead of a look-up: up to six took less time, more were not tried
/// (`cargo bench --bench workloads P6`).
const WORTH: usize = 8;

impl Table {
    /// Takes values from the products, if the function is as few of them as take less time than a look-up.
    pub(super) fn prefer_products(&mut self) {
        let (Some(products), Function::Plain(leaf)) = (&self.products, &self.function) else {
            return;
        };
        if !products.is_single() || products.terms() > WORTH {
            return;
        }
        let [value, slope, _] = leaf.errors();
        self.slack = [value, 3f64.sqrt() * slope];
        (self.error_bound, self.gradient_error_bound) = (leaf.rounding(), leaf.slope_rounding());
        self.gradient_sup += self.slack[1];
        let [value, slope] = self.slack;
        self.slopes = self.slopes.take().map(|s| s.of_another(value, slope));
        self.error_rms = 0.0;
        self.is_direct = true;
    }

    /// Whether values come from products of sines and cosines, not from look-ups.
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

/// The functions along each axis at a group of at most eight points.
#[inline(always)]
fn functions<L: Lanes>(l: L, products: &Products, points: &[CellPoint<3>]) -> [Along<L::F>; 3] {
    let two = l.two();
    let half = two.all_eight(0.5);
    let [x, y, z] = two.turned_eight(&group(points));
    // Parts of a period, from -1/2 to 1/2.
    let x = two.sub_eight(x, two.floor_eight(two.add_eight(x, half)));
    let y = two.sub_eight(y, two.floor_eight(two.add_eight(y, half)));
    let z = two.sub_eight(z, two.floor_eight(two.add_eight(z, half)));
    [
        products.along_of(l, two.singles_eight(x)),
        products.along_of(l, two.singles_eight(y)),
        products.along_of(l, two.singles_eight(z)),
    ]
}

impl Work for Values<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self(products, points, out) = self;
        for (points, out) in points.chunks(GROUP).zip(out.chunks_mut(GROUP)) {
            let [x, y, z] = functions(l, products, points);
            let value = products.value(l, [&x, &y, &z]);
            if let Some(out) = out.first_chunk_mut() {
                l.store(value, out);
                continue;
            }
            let mut values = [0.0; GROUP];
            l.store(value, &mut values);
            out.copy_from_slice(&values[..out.len()]);
        }
    }
}

impl Work for Samples<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self(products, points, out) = self;
        let turn = l.splat(TAU);
        for (points, out) in points.chunks(GROUP).zip(out.chunks_mut(GROUP)) {
            let [x, y, z] = functions(l, products, points);
            let (value, slope) = products.slope(l, [&x, &y, &z]);
            let mut rows = [[0.0; GROUP]; 4];
            l.store(value, &mut rows[0]);
            for a in 0..3 {
                l.store(l.mul(slope[a], turn), &mut rows[a + 1]);
            }
            for (n, out) in out.iter_mut().enumerate() {
                *out = [rows[0][n], rows[1][n], rows[2][n], rows[3][n]];
            }
        }
    }
}
