//! Fourier transforms of real samples over one period.
//!
//! Samples stand at u = j/N - 1/2, j = 0..N-1 on each of D axes, the last axis fastest. The
//! coefficient of exp(2 pi i k.u) is (-1)^(sum k) G\[k mod N\] / N^D, where G is the plain transform:
//! the sign is the half cell by which the grid begins before the origin. Only half of G is stored, by
//! its last index, since the samples are real; the stored order is the reverse of that of the samples
//! (first axis fastest), which saves one transposition.

use crate::symmetry::Frequency;
use rayon::prelude::*;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner, num_complex::Complex64};
use std::sync::Arc;

/// Columns that one task transposes at a time.
const BLOCK: usize = 16;

/// Plans for transforms of N^D real samples.
pub struct Transform<const D: usize> {
    n: usize,
    real: Arc<dyn RealToComplex<f64>>,
    back: Arc<dyn ComplexToReal<f64>>,
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
}

/// The half spectrum of real samples; see the head of the module for its order.
pub struct Spectrum<const D: usize> {
    n: usize,
    values: Vec<Complex64>,
}

impl<const D: usize> Spectrum<D> {
    /// The spectrum of nothing.
    pub fn zero(n: usize) -> Self {
        Self {
            n,
            values: vec![Complex64::default(); (n / 2 + 1) * n.pow(D as u32 - 1)],
        }
    }

    /// Samples per axis.
    pub fn samples(&self) -> usize {
        self.n
    }

    /// Greatest index whose wave the samples tell from every other: the Nyquist wave is left out.
    pub fn greatest_index(&self) -> i32 {
        (self.n as i32 - 1) / 2
    }

    /// Place of an index whose last component is not negative, all within half the samples.
    fn place(&self, k: Frequency<D>) -> usize {
        (0..D).rev().fold(0, |place, a| {
            let i = if k[a] < 0 { k[a] + self.n as i32 } else { k[a] };
            place * self.n + i as usize
        })
    }

    /// The plain transform at an index.
    pub fn plain(&self, k: Frequency<D>) -> Complex64 {
        if k[D - 1] < 0 {
            self.values[self.place(k.map(|c| -c))].conj()
        } else {
            self.values[self.place(k)]
        }
    }

    /// Multiplies every value by what `factor` makes of another spectrum's value and its index, whose
    /// components run from 0 to N-1.
    pub fn multiply(
        &mut self,
        other: &Self,
        factor: impl Fn(Complex64, Frequency<D>) -> Complex64 + Sync,
    ) {
        let n = self.n;
        self.values
            .par_iter_mut()
            .zip(&other.values)
            .enumerate()
            .for_each(|(place, (own, other))| {
                let mut rest = place;
                let mut k = [0; D];
                for c in &mut k {
                    *c = (rest % n) as i32;
                    rest /= n;
                }
                *own *= factor(*other, k);
            });
    }

    /// Sets the plain transform at k and its conjugate at -k.
    pub fn set(&mut self, k: Frequency<D>, value: Complex64) {
        if k[D - 1] >= 0 {
            let place = self.place(k);
            self.values[place] = value;
        }
        if k[D - 1] <= 0 {
            let place = self.place(k.map(|c| -c));
            self.values[place] = value.conj();
        }
    }
}

/// The transpose of a matrix stored by rows.
fn transpose(from: &[Complex64], rows: usize) -> Vec<Complex64> {
    let columns = from.len() / rows;
    let mut to = vec![Complex64::default(); from.len()];
    to.par_chunks_mut(BLOCK * rows)
        .enumerate()
        .for_each(|(block, out)| {
            let first = block * BLOCK;
            let width = out.len() / rows;
            for r in 0..rows {
                let row = &from[r * columns + first..][..width];
                for (c, value) in row.iter().enumerate() {
                    out[c * rows + r] = *value;
                }
            }
        });
    to
}

/// Transforms consecutive lines in place.
fn lines(values: &mut [Complex64], fft: &dyn Fft<f64>) {
    values.par_chunks_mut(BLOCK * fft.len()).for_each_init(
        || vec![Complex64::default(); fft.get_inplace_scratch_len()],
        |scratch, chunk| fft.process_with_scratch(chunk, scratch),
    );
}

impl<const D: usize> Transform<D> {
    /// Plans for `n` samples per axis.
    pub fn new(n: usize) -> Self {
        let mut real = RealFftPlanner::new();
        let mut complex = FftPlanner::new();
        Self {
            n,
            real: real.plan_fft_forward(n),
            back: real.plan_fft_inverse(n),
            forward: complex.plan_fft_forward(n),
            inverse: complex.plan_fft_inverse(n),
        }
    }

    /// Rows of a plane across the first axis.
    fn rows(&self) -> usize {
        self.n.pow(D as u32 - 2)
    }

    /// G = sum over j of the samples times exp(-2 pi i k.j/N).
    pub fn forward(&self, samples: &[f64]) -> Spectrum<D> {
        let (n, half, rows) = (self.n, self.n / 2 + 1, self.rows());
        let mut planes = vec![Complex64::default(); n * rows * half];
        planes
            .par_chunks_mut(rows * half)
            .zip(samples.par_chunks(rows * n))
            .for_each_init(
                || (self.real.make_input_vec(), self.real.make_output_vec()),
                |(row, line), (plane, samples)| {
                    for (j, source) in samples.chunks(n).enumerate() {
                        row.copy_from_slice(source);
                        // Cannot fail: the lengths are the plan's own.
                        let _ = self.real.process(row, line);
                        for (k, value) in line.iter().enumerate() {
                            plane[k * rows + j] = *value;
                        }
                    }
                    if rows > 1 {
                        self.forward.process(plane);
                    }
                },
            );
        let mut values = transpose(&planes, n);
        lines(&mut values, self.forward.as_ref());
        Spectrum { n, values }
    }

    /// The samples sum over k of G exp(2 pi i k.j/N): [`Transform::forward`] undone up to the
    /// factor N^D.
    pub fn inverse(&self, mut spectrum: Spectrum<D>) -> Vec<f64> {
        let (n, half, rows) = (self.n, self.n / 2 + 1, self.rows());
        lines(&mut spectrum.values, self.inverse.as_ref());
        let mut planes = transpose(&spectrum.values, half * rows);
        let mut samples = vec![0.0; n * rows * n];
        samples
            .par_chunks_mut(rows * n)
            .zip(planes.par_chunks_mut(rows * half))
            .for_each_init(
                || self.back.make_input_vec(),
                |line, (samples, plane)| {
                    if rows > 1 {
                        self.inverse.process(plane);
                    }
                    for (j, row) in samples.chunks_mut(n).enumerate() {
                        for (k, value) in line.iter_mut().enumerate() {
                            *value = plane[k * rows + j];
                        }
                        // Real samples have real constant and Nyquist terms; rounding is dropped.
                        line[0].im = 0.0;
                        if n % 2 == 0 {
                            line[half - 1].im = 0.0;
                        }
                        let _ = self.back.process(line, row);
                    }
                },
            );
        samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Numbers between -1 and 1 without a pattern.
    fn noise(n: usize) -> Vec<f64> {
        let mut state = 1u64;
        (0..n)
            .map(|_| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
                (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
            })
            .collect()
    }

    fn sum<const D: usize>(samples: &[f64], n: usize, k: [i32; D]) -> Complex64 {
        samples
            .iter()
            .enumerate()
            .map(|(place, v)| {
                let (mut rest, mut phase) = (place, 0);
                for a in (0..D).rev() {
                    phase += (rest % n) as i32 * k[a];
                    rest /= n;
                }
                Complex64::from_polar(*v, -TAU * f64::from(phase) / n as f64)
            })
            .sum()
    }

    #[test]
    fn the_transform_is_the_sum_that_defines_it_and_is_undone() {
        for n in [5, 6] {
            let samples = noise(n * n * n);
            let transform = Transform::<3>::new(n);
            let spectrum = transform.forward(&samples);
            for k in [[0, 0, 0], [1, -2, 2], [-2, 1, -1], [2, 0, -2]] {
                assert!((spectrum.plain(k) - sum(&samples, n, k)).norm() < 1e-12);
            }
            let back = transform.inverse(spectrum);
            let count = (n * n * n) as f64;
            assert!(
                back.iter()
                    .zip(&samples)
                    .all(|(b, s)| (b / count - s).abs() < 1e-14)
            );
            let plane = noise(n * n);
            let transform = Transform::<2>::new(n);
            let spectrum = transform.forward(&plane);
            for k in [[0, 0], [1, -2], [-2, -1]] {
                assert!((spectrum.plain(k) - sum(&plane, n, k)).norm() < 1e-12);
            }
            let back = transform.inverse(spectrum);
            assert!(
                back.iter()
                    .zip(&plane)
                    .all(|(b, s)| (b / (n * n) as f64 - s).abs() < 1e-14)
            );
        }
    }

    #[test]
    fn what_is_set_is_read_and_summed() {
        let mut spectrum = Spectrum::<3>::zero(6);
        let c = Complex64::new(0.25, -0.5);
        spectrum.set([1, -2, -1], c);
        spectrum.set([1, 2, 0], c);
        assert_eq!(spectrum.plain([1, -2, -1]), c);
        assert_eq!(spectrum.plain([-1, -2, 0]), c.conj());
        let samples = Transform::new(6).inverse(spectrum);
        // At the origin of the plain transform: C + conj C for each pair.
        assert!((samples[0] - 1.0).abs() < 1e-14);
    }
}
