//! Fourier transforms of real samples over one period.
//!
//! Samples lie at u = j/N - 1/2, j = 0..N-1 on each of D axes, the last axis fastest. The coefficient of
//! exp(2 pi i k.u) is (-1)^(sum k) G\[k mod N\] / N^D, where G is the discrete transform; the sign accounts
//! for the first sample at -1/2. The samples are real, so only half of G is stored, by its last index. The
//! storage order is reversed (first axis fastest), which saves one transposition.

use crate::fourier;
use crate::symmetry::Frequency;
use rayon::prelude::*;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, num_complex::Complex64};
use std::sync::Arc;

/// Columns per task of a transposition.
const COLUMNS_PER_TASK: usize = 16;

/// Plans for transforms of N^D real samples.
pub struct Transform<const D: usize> {
    n: usize,
    real: Arc<dyn RealToComplex<f64>>,
    back: Arc<dyn ComplexToReal<f64>>,
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
}

/// The half spectrum of real samples; see the module's head for its order.
pub struct Spectrum<const D: usize> {
    n: usize,
    values: Vec<Complex64>,
}

impl<const D: usize> Spectrum<D> {
    /// The zero spectrum.
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

    /// Largest index below the Nyquist index.
    pub fn max_index(&self) -> i32 {
        (self.n as i32 - 1) / 2
    }

    /// Position of an index whose last component is not negative.
    /// The last component is the slowest. Negative leading components count from the end.
    fn position(&self, k: Frequency<D>) -> usize {
        (0..D).rev().fold(0, |position, a| {
            let i = if k[a] < 0 { k[a] + self.n as i32 } else { k[a] };
            position * self.n + i as usize
        })
    }

    /// The discrete transform G at an index.
    /// Components are at most N/2 in magnitude.
    pub fn at(&self, k: Frequency<D>) -> Complex64 {
        if k[D - 1] < 0 {
            self.values[self.position(k.map(|c| -c))].conj()
        } else {
            self.values[self.position(k)]
        }
    }

    /// Multiplies every value by `factor` of another spectrum's value and of its index, whose components run
    /// from 0 to N-1.
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
            .for_each(|(position, (own, other))| {
                let mut rest = position;
                let mut k = [0; D];
                for c in &mut k {
                    *c = (rest % n) as i32;
                    rest /= n;
                }
                *own *= factor(*other, k);
            });
    }

    /// Sets G at k, and its conjugate at -k.
    /// An index is stored only if its last component is not negative. Components are at most N/2 in magnitude.
    pub fn set(&mut self, k: Frequency<D>, value: Complex64) {
        if k[D - 1] >= 0 {
            let position = self.position(k);
            self.values[position] = value;
        }
        if k[D - 1] <= 0 {
            let position = self.position(k.map(|c| -c));
            self.values[position] = value.conj();
        }
    }
}

/// The transpose of a matrix stored by rows.
/// `rows` is the number of rows of `from`.
fn transpose(from: &[Complex64], rows: usize) -> Vec<Complex64> {
    let columns = from.len() / rows;
    let mut to = vec![Complex64::default(); from.len()];
    to.par_chunks_mut(COLUMNS_PER_TASK * rows)
        .enumerate()
        .for_each(|(block, out)| {
            let first = block * COLUMNS_PER_TASK;
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
/// Each line has the length of the plan.
fn lines(values: &mut [Complex64], fft: &dyn Fft<f64>) {
    values
        .par_chunks_mut(COLUMNS_PER_TASK * fft.len())
        .for_each_init(
            || vec![Complex64::default(); fft.get_inplace_scratch_len()],
            |scratch, chunk| fft.process_with_scratch(chunk, scratch),
        );
}

impl<const D: usize> Transform<D> {
    /// Plans for `n` samples per axis.
    pub fn new(n: usize) -> Self {
        let mut real = RealFftPlanner::new();
        let [forward, inverse] = fourier::transforms(n);
        Self {
            n,
            real: real.plan_fft_forward(n),
            back: real.plan_fft_inverse(n),
            forward,
            inverse,
        }
    }

    /// Rows of a plane perpendicular to the first axis.
    /// 1 in the plane, n in space.
    fn rows(&self) -> usize {
        self.n.pow(D as u32 - 2)
    }

    /// G = sum over j of the samples times exp(-2 pi i k.j/N).
    /// There are N^D samples, last axis fastest.
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
                        // The lengths are those of the plan, so the transform cannot fail.
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

    /// The samples sum over k of G exp(2 pi i k.j/N), the inverse of [`Transform::forward`] times N^D.
    /// The samples have the order of [`Transform::forward`].
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
                        // The constant and Nyquist terms of real samples are real; rounding errors are removed.
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

    /// Pseudo-random numbers between -1 and 1.
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
            .map(|(position, v)| {
                let (mut rest, mut phase) = (position, 0);
                for a in (0..D).rev() {
                    phase += (rest % n) as i32 * k[a];
                    rest /= n;
                }
                Complex64::from_polar(*v, -TAU * f64::from(phase) / n as f64)
            })
            .sum()
    }

    #[test]
    fn forward_transform_is_the_defining_sum_and_inverse_restores_the_samples() {
        for n in [5, 6] {
            let samples = noise(n * n * n);
            let transform = Transform::<3>::new(n);
            let spectrum = transform.forward(&samples);
            for k in [[0, 0, 0], [1, -2, 2], [-2, 1, -1], [2, 0, -2]] {
                assert!((spectrum.at(k) - sum(&samples, n, k)).norm() < 1e-12);
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
                assert!((spectrum.at(k) - sum(&plane, n, k)).norm() < 1e-12);
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
    fn set_values_are_read_back_and_summed() {
        let mut spectrum = Spectrum::<3>::zero(6);
        let c = Complex64::new(0.25, -0.5);
        spectrum.set([1, -2, -1], c);
        spectrum.set([1, 2, 0], c);
        assert_eq!(spectrum.at([1, -2, -1]), c);
        assert_eq!(spectrum.at([-1, -2, 0]), c.conj());
        let samples = Transform::new(6).inverse(spectrum);
        // At the origin of the discrete transform: C + conj C for each pair.
        assert!((samples[0] - 1.0).abs() < 1e-14);
    }
}
