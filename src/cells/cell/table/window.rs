//! Tables of functions without a period, sampled over a box around the ball.
//!
//! A sum of products of cosines is even along every axis, and so is its spline, whose period is slightly
//! longer than the ball's diameter. At the faces of the box the function is continued by reflection and has
//! a kink. Interpolation propagates the kink inwards with the factor 0.268 per sample (the root of
//! z^2 + 4 z + 1).

use super::super::icosahedral::Products;
use super::build::{aliases, attenuation, interpolant_gain, inverse_transform};
use super::grid::Grid;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Edge of the box around the ball of diameter 1.
pub(super) const WINDOW_EDGE: f64 = 1.25;
/// Decay of a disturbance of the interpolant per sample.
const KINK_DECAY: f64 = 0.268;

/// Coefficients of the spline that interpolates the samples.
/// The order is x, y, z, the last fastest. All axes have the same number of samples.
pub(super) fn coefficients(products: &Products, grid: &Grid) -> Vec<Complex64> {
    let n = grid.samples[0];
    let half = n / 2 + 1;
    // Even along every axis: one octant with both faces is sampled, the others mirror it.
    let coordinates: Vec<f64> = (0..half)
        .map(|i| i as f64 * WINDOW_EDGE / n as f64)
        .collect();
    let part = products.on_grid(&coordinates);
    let mirrored = |i: usize| i.min(n - i);
    let mut values: Vec<Complex64> = (0..n * n * n)
        .map(|at| {
            let [i, j, k] = [at / (n * n), at / n % n, at % n].map(mirrored);
            Complex64::new(part[(i * half + j) * half + k], 0.0)
        })
        .collect();
    // For even samples, forward and inverse transforms are equal.
    inverse_transform(&mut values, grid.samples);
    // As in a periodic table, c_h = value_h / prod (2 + cos(2 pi h / N)) / 3; N normalises both transforms.
    let gains: Vec<f64> = (0..n)
        .map(|h| n as f64 * attenuation(h as f64, n as f64))
        .collect();
    for (at, v) in values.iter_mut().enumerate() {
        *v /= gains[at / (n * n)] * gains[at / n % n] * gains[at % n];
    }
    inverse_transform(&mut values, grid.samples);
    values
}

/// Bounds of the error of the value and of each gradient component inside the ball.
/// Both include the kink at the faces of the box, damped by its distance.
pub(super) fn error_bounds(products: &Products, grid: &Grid) -> (f64, f64) {
    let n = grid.samples[0] as f64;
    let (mut value, mut slope) = (0.0, 0.0);
    let mut steepest = 0.0;
    for (f, weight) in products.terms_with_frequencies() {
        let of = f.map(|f| {
            (
                interpolant_gain(f * WINDOW_EDGE, n),
                aliases(f * WINDOW_EDGE, n),
            )
        });
        let product: f64 = of.iter().map(|o| o.0).product();
        // The interpolant keeps `product` of a wave, and its aliases add up to 1 - product (`Spectrum::error_bounds`).
        value += weight.abs() * 2.0 * (1.0 - product);
        for (axis, f) in f.into_iter().enumerate() {
            let (gain, aliases) = of[axis];
            let lost = (1.0 - product) + (gain - product) + gain * aliases;
            slope += weight.abs() * TAU * f * lost;
            steepest += weight.abs() * TAU * f;
        }
    }
    // The kink is a jump of the slope by twice the steepest; over one sample it changes the value. `margin` are the
    // samples between the ball and the face of the box, over which it decays.
    let margin = (WINDOW_EDGE - 1.0) / 2.0 * n / WINDOW_EDGE;
    let kink = 2.0 * steepest * libm::pow(KINK_DECAY, margin.floor());
    (value + kink * WINDOW_EDGE / n, slope + kink)
}
