//! Coefficients of a table from the spectrum of a series, and the error it makes.

use super::super::{Cell, CellError, Series};
use crate::symmetry::{Frequency, Lattice};
use rayon::prelude::*;
use rustfft::{FftPlanner, num_complex::Complex64};
use std::f64::consts::{PI, TAU};

/// Indices beyond this on the cubic period have no table.
const GREATEST_INDEX: i32 = 127;

/// The series of a cell and its cubic period.
fn cubic(cell: &Cell) -> Result<(&Series<3>, f64), CellError> {
    let no_table = |reason: &str| CellError::NoTable {
        reason: reason.to_owned(),
    };
    let series = cell
        .series()
        .ok_or_else(|| no_table("its function is not one series in space"))?;
    match series.lattice().periods() {
        Some([x, y, z]) if x == y && y == z => Ok((series, x)),
        _ => Err(no_table("its lattice has no cubic period")),
    }
}

/// The index of a wave on the cubic period: h = P f.
fn cubic_index(lattice: &Lattice<3>, period: f64, k: Frequency<3>) -> [i32; 3] {
    let f = lattice.frequency(k) * period;
    std::array::from_fn(|a| f[a].round() as i32)
}

/// The exponentials of a cell on its cubic period, without the zero ones.
fn spectrum(cell: &Cell) -> Result<impl Iterator<Item = ([i32; 3], [f64; 2])> + '_, CellError> {
    let (series, period) = cubic(cell)?;
    let lattice = series.lattice();
    Ok(series
        .exponentials()
        .iter()
        .filter(|(_, c)| *c != [0.0; 2])
        .map(move |&(k, c)| (cubic_index(lattice, period, k), c)))
}

/// Largest index along an axis of the cubic period.
pub(super) fn greatest_index(cell: &Cell) -> Result<i32, CellError> {
    let index = spectrum(cell)?
        .flat_map(|(h, _)| h)
        .map(i32::abs)
        .max()
        .unwrap_or(0);
    if index > GREATEST_INDEX {
        return Err(CellError::TableTooLarge {
            index,
            limit: 2 * GREATEST_INDEX as usize + 2,
        });
    }
    Ok(index)
}

/// The least even size >= `n` whose only prime factors are 2, 3 and 5.
pub(super) fn good_size(n: usize) -> usize {
    let smooth = |mut m: usize| {
        for p in [2, 3, 5] {
            while m % p == 0 {
                m /= p;
            }
        }
        m == 1
    };
    let mut m = n.max(2).next_multiple_of(2);
    while !smooth(m) {
        m += 2;
    }
    m
}

/// Spectrum of the sampled cubic B-spline.
fn attenuation(h: i32, n: f64) -> f64 {
    (2.0 + (TAU * f64::from(h) / n).cos()) / 3.0
}

/// sinc^4 / attenuation: how much of a wave its interpolant keeps.
fn kept(h: i32, n: f64) -> f64 {
    let x = PI * f64::from(h) / n;
    let sinc = if h == 0 { 1.0 } else { x.sin() / x };
    sinc.powi(4) / attenuation(h, n)
}

/// Bounds of the interpolation error of the value and of each component of the gradient.
///
/// Along an axis the interpolant of the wave h is a sum of waves h + m N of sizes a(m) >= 0 that add
/// up to 1, where a(0) is `kept` and a(m) = a(0) (h / (h + m N))^4. So the value's error is at most
/// 2 (1 - prod a), and that of the derivative along axis i at most 2 pi |h| / P times what the
/// wave loses, 1 - prod a, what aliases across the axis add, a (1 - the product of the others),
/// and those along it, a times the sum over m of |h / (h + m N)|^3.
pub(super) fn error_bounds(cell: &Cell, samples: usize) -> Result<(f64, f64), CellError> {
    let greatest = greatest_index(cell)?;
    let n = samples as f64;
    let (_, period) = cubic(cell)?;
    let table: Vec<(f64, f64)> = (0..=greatest)
        .map(|h| (kept(h, n), aliases(h, n)))
        .collect();
    let (mut value, mut slope) = (0.0, [0.0; 3]);
    for (h, [re, im]) in spectrum(cell)? {
        let size = re.hypot(im);
        let mu = h.map(|c| table[c.unsigned_abs() as usize].0);
        let product: f64 = mu.iter().product();
        value += size * 2.0 * (1.0 - product);
        for axis in 0..3 {
            let (gain, aliases) = table[h[axis].unsigned_abs() as usize];
            let lost = (1.0 - product) + (gain - product) + gain * aliases;
            slope[axis] += size * TAU * f64::from(h[axis].abs()) / period * lost;
        }
    }
    Ok((value, slope.into_iter().fold(0.0, f64::max)))
}

/// Bound of the sum over m != 0 of |h / (h + m N)|^3.
fn aliases(h: i32, n: f64) -> f64 {
    const TERMS: i32 = 20;
    let ratio = f64::from(h) / n;
    let near: f64 = (1..=TERMS)
        .flat_map(|m| [f64::from(m), -f64::from(m)])
        .map(|m| (ratio / (ratio + m)).abs().powi(3))
        .sum();
    // The rest is below the integral of 2 (ratio / (m - 1/2))^3 from m = TERMS on.
    near + (ratio / (f64::from(TERMS) - 0.5)).powi(2) * ratio
}

/// Period and padded coefficients of the spline that interpolates Phi minus its centre.
pub(super) fn coefficients(cell: &Cell, n: usize) -> Result<(f64, Vec<f32>), CellError> {
    greatest_index(cell)?;
    let mut grid = vec![Complex64::default(); n * n * n];
    for (h, [re, im]) in spectrum(cell)? {
        let gain: f64 = h.iter().map(|&c| attenuation(c, n as f64)).product();
        let [x, y, z] = h.map(|c| c.rem_euclid(n as i32) as usize);
        grid[(x * n + y) * n + z] += Complex64::new(re, im) / gain;
    }
    grid[0] -= cell.solid().centre(cell.level());
    inverse_transform(&mut grid, n);
    let s = n + 3;
    let mut padded = vec![0f32; s * s * s];
    padded
        .par_chunks_mut(s * s)
        .enumerate()
        .for_each(|(i, plane)| {
            let wrap = |c: usize| (c + n - 1) % n;
            for j in 0..s {
                let from = (wrap(i) * n + wrap(j)) * n;
                for k in 0..s {
                    plane[j * s + k] = grid[from + wrap(k)].re as f32;
                }
            }
        });
    Ok((cubic(cell)?.1, padded))
}

/// Unnormalised inverse transform of a cube, one axis after the other; the axes rotate so that each
/// in turn is the contiguous one.
fn inverse_transform(grid: &mut Vec<Complex64>, n: usize) {
    let fft = FftPlanner::new().plan_fft_inverse(n);
    for _ in 0..3 {
        grid.par_chunks_mut(n * n).for_each(|plane| {
            let mut scratch = vec![Complex64::default(); fft.get_inplace_scratch_len()];
            for row in plane.chunks_exact_mut(n) {
                fft.process_with_scratch(row, &mut scratch);
            }
        });
        // (x, y, z) -> (z, x, y)
        let mut turned = vec![Complex64::default(); grid.len()];
        turned
            .par_chunks_mut(n * n)
            .enumerate()
            .for_each(|(z, plane)| {
                for (xy, v) in plane.iter_mut().enumerate() {
                    *v = grid[xy * n + z];
                }
            });
        *grid = turned;
    }
}
