//! Orthogonal projection of a spectrum onto the symmetric functions.
//!
//! C of an orbit is the mean of g^ over the orbit, where g^ is the coefficient of exp(2 pi i k.u) in the
//! samples' interpolant. This follows from the conjugate in c = int g conj(phi). The result is the transform
//! of the samples averaged over their images, hence exact for symmetric samples with a band limit below half
//! the number of samples. Orbits that reach the Nyquist index are dropped.

use super::transform::{Spectrum, Transform};
use crate::symmetry::{Frequency, Lattice, PointGroup};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use std::f64::consts::PI;

/// Representatives and coefficients of every orbit pair with |f| <= `radius`, or of all orbit pairs.
/// The order is that of the first index. `radius` is in cycles per unit of reference length; 1e-9 more is accepted.
/// A coefficient is (re, im), and real where the orbit holds k and -k.
fn project<const D: usize>(
    group: &PointGroup<D>,
    lattice: &Lattice<D>,
    spectrum: &Spectrum<D>,
    radius: Option<f64>,
) -> Vec<(Frequency<D>, [f64; 2])> {
    let h = spectrum.max_index();
    let scale = (spectrum.samples() as f64).powi(D as i32).recip();
    let operators = group.operators();
    // The mean over the operators, if k is the largest member of its orbit pair.
    let coefficient = |k: Frequency<D>| -> Option<[f64; 2]> {
        let opposite = k.map(|c| -c);
        let mut paired = false;
        for op in operators {
            let image = op.apply_to_frequency(k);
            if image > k || image < opposite || image.iter().any(|c| c.abs() > h) {
                return None;
            }
            paired |= image == opposite;
        }
        if radius.is_some_and(|r| lattice.frequency_norm(k) > r + 1e-9) {
            return None;
        }
        // The spectrum is read last, since its values are far apart in memory. Odd indices change sign, as the first
        // sample lies at -1/2.
        let mut sum = Complex64::default();
        for op in operators {
            let image = op.apply_to_frequency(k);
            let odd = image.iter().sum::<i32>().rem_euclid(2) == 1;
            let value = spectrum.at(image);
            sum += if odd { -value } else { value };
        }
        let mean = sum * (scale / operators.len() as f64);
        Some([mean.re, if paired { 0.0 } else { mean.im }])
    };
    // The first index of the largest member of a pair is not negative.
    let slabs: Vec<Vec<_>> = (0..=h)
        .into_par_iter()
        .map(|first| {
            let mut found = Vec::new();
            let mut k = [-h; D];
            k[0] = first;
            loop {
                if let Some(c) = coefficient(k) {
                    found.push((k, c));
                }
                let Some(axis) = (1..D).rev().find(|&a| k[a] < h) else {
                    return found;
                };
                k[axis] += 1;
                for c in &mut k[axis + 1..] {
                    *c = -h;
                }
            }
        })
        .collect();
    slabs.concat()
}

/// Multiplies coefficients by Lanczos' sigma factors for `n` samples per axis (see [`Filter::Lanczos`]),
/// which are equal within an orbit.
/// Each term is an index and (re, im), which are changed in place.
///
/// [`Filter::Lanczos`]: crate::cell::Filter::Lanczos
pub fn lanczos<const D: usize>(
    lattice: &Lattice<D>,
    n: usize,
    terms: &mut [(Frequency<D>, [f64; 2])],
) {
    let sinc = |x: f64| {
        if x == 0.0 {
            1.0
        } else {
            (PI * x).sin() / (PI * x)
        }
    };
    // Sigma = sinc(k / (h + 1)) with h = floor((n - 1) / 2), the largest index of the grid.
    let end = (n.max(1) - 1) as f64 / 2.0;
    let end = end.floor() + 1.0;
    let is_orthogonal = matches!(lattice.name(), Some("square" | "cubic"));
    let longest = (0..D).map(|a| lattice.columns().column(a).norm());
    let longest = longest.fold(0.0, f64::max);
    // A product over the axes is equal within an orbit only where the group permutes and reverses axes.
    // Elsewhere the factor depends on |f| alone, and is 0 beyond its first zero.
    for (k, c) in terms {
        let factor: f64 = if is_orthogonal {
            k.iter().map(|k| sinc(f64::from(*k) / end)).product()
        } else {
            sinc((lattice.frequency_norm(*k) * longest / end).min(1.0))
        };
        *c = c.map(|v| v * factor);
    }
}

/// Coefficients C of the symmetric part of samples over the period cell, by Fourier transform.
///
/// Samples lie at u = j/N - 1/2 with the last axis fastest. Each orbit pair within |f| <= `radius` (each one
/// below the Nyquist index, without a radius) is listed once, by its lexicographically largest member, as
/// [`crate::cell::Series::new`] requires.
///
/// # Panics
/// If there are not `n`^D samples.
///
/// ```
/// # extern crate druse_cells as druse;
/// use druse::cell::fourier_coefficients;
/// use druse::symmetry::{Lattice, PointGroup};
/// let lattice = Lattice::<2>::named("square").unwrap();
/// let group = PointGroup::named("D4", &lattice).unwrap();
/// let wave = |i: usize| (std::f64::consts::TAU * (i as f64 / 4.0 - 0.5)).cos();
/// let samples: Vec<f64> = (0..16).map(|j| wave(j / 4)).collect();
/// let found = fourier_coefficients(&group, &lattice, &samples, 4, None);
/// // cos(2 pi x) averaged with cos(2 pi y): a quarter on each of four exponentials.
/// assert!(found.iter().any(|(k, c)| *k == [1, 0] && (c[0] - 0.25).abs() < 1e-15));
/// ```
pub fn fourier_coefficients<const D: usize>(
    group: &PointGroup<D>,
    lattice: &Lattice<D>,
    samples: &[f64],
    n: usize,
    radius: Option<f64>,
) -> Vec<(Frequency<D>, [f64; 2])> {
    assert_eq!(samples.len(), n.pow(D as u32), "n samples along every axis");
    let spectrum = Transform::new(n).forward(samples);
    project(group, lattice, &spectrum, radius)
}
