//! Tables of functions without a period: sampled over a box about the ball.
//!
//! A sum of products of cosines is even along every axis; so is its spline, whose period is a little
//! longer than the ball. Where the box ends the function is continued by reflection: there it has a
//! kink, which the interpolation carries inwards by the factor 0.268 (the root of z^2 + 4 z + 1) for
//! each sample.

use super::super::icosahedral::Products;
use super::build::{aliases, attenuation, inverse_transform, kept};
use super::grid::Grid;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Edge of the box about the ball of diameter 1.
pub(super) const EDGE: f64 = 1.25;
/// How much of a disturbance is left one sample farther.
const DECAY: f64 = 0.268;

/// Spectrum of the samples' spline: what the periodic case knows from its series.
pub(super) fn coefficients(products: &Products, grid: &Grid) -> Vec<Complex64> {
    let n = grid.samples[0];
    let half = n / 2 + 1;
    let places: Vec<f64> = (0..half).map(|i| i as f64 * EDGE / n as f64).collect();
    let part = products.on_grid(&places);
    let fold = |i: usize| i.min(n - i);
    let mut values: Vec<Complex64> = (0..n * n * n)
        .map(|at| {
            let [i, j, k] = [at / (n * n), at / n % n, at % n].map(fold);
            Complex64::new(part[(i * half + j) * half + k], 0.0)
        })
        .collect();
    // Of even samples the inverse transform is the transform.
    inverse_transform(&mut values, grid.samples);
    let gains: Vec<f64> = (0..n)
        .map(|h| n as f64 * attenuation(h as f64, n as f64))
        .collect();
    for (at, v) in values.iter_mut().enumerate() {
        *v /= gains[at / (n * n)] * gains[at / n % n] * gains[at % n];
    }
    inverse_transform(&mut values, grid.samples);
    values
}

/// Bounds of the error of the value and of each component of the gradient inside the ball.
pub(super) fn error_bounds(products: &Products, grid: &Grid) -> (f64, f64) {
    let n = grid.samples[0] as f64;
    let (mut value, mut slope) = (0.0, 0.0);
    let mut steepest = 0.0;
    for (f, weight) in products.all() {
        let of = f.map(|f| (kept(f * EDGE, n), aliases(f * EDGE, n)));
        let product: f64 = of.iter().map(|o| o.0).product();
        value += weight.abs() * 2.0 * (1.0 - product);
        for (axis, f) in f.into_iter().enumerate() {
            let (gain, aliases) = of[axis];
            let lost = (1.0 - product) + (gain - product) + gain * aliases;
            slope += weight.abs() * TAU * f * lost;
            steepest += weight.abs() * TAU * f;
        }
    }
    // The kink is twice the slope; half a sample of it reaches the value.
    let margin = (EDGE - 1.0) / 2.0 * n / EDGE;
    let kink = 2.0 * steepest * libm::pow(DECAY, margin.floor());
    (value + kink * EDGE / n, slope + kink)
}
