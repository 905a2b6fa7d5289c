//! Linear maps that are products in Fourier space, applied to real fields of several components.
//!
//! The transforms are real and in single precision: they precondition iterations whose residuals are in
//! double precision, so that rounding here costs no accuracy. Three passes, each over parts of an array that
//! no other writes: layers across x (transforms along z and y), layers across z (transform along x, the
//! product, and back), layers across x again. So the result does not depend on the number of threads.
//!
//! A field of S components lies layer by layer across x, and each layer holds its components over y and z. Of the `nz`
//! frequencies along z of a real field only `nz / 2 + 1` are independent; the others are conjugates. After the first
//! pass the layout is x, component, z, y; after the second z, component, x, y. The unit test
//! `the_identity_gives_the_field_back_and_leaves_the_rest` bounds the error of single precision by 1e-5 for values up
//! to 2.

use rayon::prelude::*;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// Plans and buffers for fields whose first `C` components are transformed.
pub(super) struct Spectral<const C: usize> {
    counts: [usize; 3],
    /// Complex numbers along z.
    half: usize,
    real: Arc<dyn RealToComplex<f32>>,
    back: Arc<dyn ComplexToReal<f32>>,
    along_y: [Arc<dyn Fft<f32>>; 2],
    along_x: [Arc<dyn Fft<f32>>; 2],
    /// After the transforms along z and y: by x, component, z, y.
    layers: Vec<Complex32>,
    /// After the product and the transform back along x: by z, component, x, y.
    planes: Vec<Complex32>,
}

/// Edge of the square parts that are transposed in registers.
const TILE: usize = 8;

/// Transposes a matrix: `from` has rows of `width` numbers, `to` gets rows of as many numbers as `from` has rows.
fn transpose(from: &[Complex32], width: usize, to: &mut [Complex32]) {
    let height = from.len() / width;
    let (whole_height, whole_width) = (height / TILE * TILE, width / TILE * TILE);
    for i0 in (0..whole_height).step_by(TILE) {
        for j0 in (0..whole_width).step_by(TILE) {
            let mut tile = [[Complex32::new(0.0, 0.0); TILE]; TILE];
            for (row, from) in tile.iter_mut().zip(from[i0 * width..].chunks(width)) {
                row.copy_from_slice(&from[j0..j0 + TILE]);
            }
            for (j, to) in to[j0 * height..].chunks_mut(height).take(TILE).enumerate() {
                let column = tile.map(|row| row[j]);
                to[i0..i0 + TILE].copy_from_slice(&column);
            }
        }
    }
    // The margins.
    for (i, row) in from.chunks(width).enumerate() {
        let first = if i < whole_height { whole_width } else { 0 };
        for (j, v) in row.iter().enumerate().skip(first) {
            to[j * height + i] = *v;
        }
    }
}

impl<const C: usize> Spectral<C> {
    /// Plans for a grid.
    pub fn new(counts: [usize; 3]) -> Self {
        let [nx, ny, nz] = counts;
        let half = nz / 2 + 1;
        let mut reals = RealFftPlanner::<f32>::new();
        let mut planner = FftPlanner::<f32>::new();
        let empty = Complex32::new(0.0, 0.0);
        Self {
            counts,
            half,
            real: reals.plan_fft_forward(nz),
            back: reals.plan_fft_inverse(nz),
            along_y: [planner.plan_fft_forward(ny), planner.plan_fft_inverse(ny)],
            along_x: [planner.plan_fft_forward(nx), planner.plan_fft_inverse(nx)],
            layers: vec![empty; C * nx * ny * half],
            planes: vec![empty; C * nx * ny * half],
        }
    }

    /// Bytes of both buffers for each voxel of a grid with many voxels: eight for half of the frequencies, twice.
    pub const BYTES_PER_VOXEL: u64 = 8 * C as u64;

    /// Applies `symbol`, which multiplies the amplitudes at one frequency (its indices along x, y, z) by a matrix, to
    /// the first `C` of the `S` components of `input`, and writes those of `output`. The other components of `output`
    /// stay.
    pub fn apply<const S: usize>(
        &mut self,
        input: &[f64],
        output: &mut [f64],
        symbol: impl Fn([usize; 3], &mut [Complex32; C]) + Sync,
    ) {
        let [nx, ny, nz] = self.counts;
        let half = self.half;
        let empty = Complex32::new(0.0, 0.0);
        let (real, back, along_y, along_x) = (&self.real, &self.back, &self.along_y, &self.along_x);
        let scratch_y = along_y.iter().map(|f| f.get_inplace_scratch_len()).max();
        let scratch_y = vec![empty; scratch_y.unwrap_or(0)];
        let layer = ny * nz;
        // First pass, a layer across x per task: transforms along z, then along y. The transpose between them
        // makes the lines along y contiguous.
        self.layers
            .par_chunks_mut(C * half * ny)
            .zip(input.par_chunks(S * layer))
            .for_each_init(
                || {
                    let rows = vec![empty; ny * half];
                    (
                        vec![0f32; nz],
                        rows,
                        real.make_scratch_vec(),
                        scratch_y.clone(),
                    )
                },
                |(row, rows, scratch_z, scratch_y), (to, from)| {
                    for c in 0..C {
                        let from = &from[c * layer..(c + 1) * layer];
                        // Along z, from real to complex.
                        for (values, out) in from.chunks(nz).zip(rows.chunks_mut(half)) {
                            for (v, w) in row.iter_mut().zip(values) {
                                *v = *w as f32;
                            }
                            // Lengths are those of the plan, so that it cannot fail.
                            let _ = real.process_with_scratch(row, out, scratch_z);
                        }
                        let to = &mut to[c * half * ny..(c + 1) * half * ny];
                        transpose(rows, half, to);
                        along_y[0].process_with_scratch(to, scratch_y);
                    }
                },
            );
        let layers = &self.layers;
        let scratch_x = along_x.iter().map(|f| f.get_inplace_scratch_len()).max();
        let scratch_x = vec![empty; scratch_x.unwrap_or(0)];
        // Second pass, a frequency of z per task: all of x and y of one frequency of z lie together, so that
        // the transform along x, the product and the transform back need no other task's numbers.
        self.planes
            .par_chunks_mut(C * nx * ny)
            .enumerate()
            .for_each_init(
                || {
                    let plane = vec![empty; nx * ny];
                    (plane.clone(), vec![empty; C * nx * ny], scratch_x.clone())
                },
                |(plane, turned, scratch), (k, to)| {
                    for c in 0..C {
                        // The rows of this component and this frequency of z, from all layers.
                        for i in 0..nx {
                            let at = ((i * C + c) * half + k) * ny;
                            plane[i * ny..(i + 1) * ny].copy_from_slice(&layers[at..at + ny]);
                        }
                        let turned = &mut turned[c * nx * ny..(c + 1) * nx * ny];
                        transpose(plane, ny, turned);
                        along_x[0].process_with_scratch(turned, scratch);
                    }
                    // v(k) -> symbol(k) v(k), a product of each frequency's components with a matrix.
                    for j in 0..ny {
                        for i in 0..nx {
                            let at = j * nx + i;
                            let mut v: [Complex32; C] =
                                std::array::from_fn(|c| turned[c * nx * ny + at]);
                            symbol([i, j, k], &mut v);
                            for c in 0..C {
                                turned[c * nx * ny + at] = v[c];
                            }
                        }
                    }
                    // Back along x, and back to rows along y.
                    for c in 0..C {
                        let turned = &mut turned[c * nx * ny..(c + 1) * nx * ny];
                        along_x[1].process_with_scratch(turned, scratch);
                        transpose(turned, nx, &mut to[c * nx * ny..(c + 1) * nx * ny]);
                    }
                },
            );
        let planes = &self.planes;
        let scale = 1.0 / (nx * ny * nz) as f64;
        // Third pass, a layer across x per task: back along y, then along z. The transforms are not normalised;
        // `scale` divides by the number of voxels.
        output.par_chunks_mut(S * layer).enumerate().for_each_init(
            || {
                let rows = vec![empty; half * ny];
                (
                    rows.clone(),
                    rows,
                    vec![0f32; nz],
                    back.make_scratch_vec(),
                    scratch_y.clone(),
                )
            },
            |(columns, rows, row, scratch_z, scratch_y), (i, to)| {
                for c in 0..C {
                    // The rows of this layer, from all frequencies of z.
                    for k in 0..half {
                        let at = ((k * C + c) * nx + i) * ny;
                        columns[k * ny..(k + 1) * ny].copy_from_slice(&planes[at..at + ny]);
                    }
                    along_y[1].process_with_scratch(columns, scratch_y);
                    transpose(columns, ny, rows);
                    let to = &mut to[c * layer..(c + 1) * layer];
                    for (line, out) in rows.chunks_mut(half).zip(to.chunks_mut(nz)) {
                        // Rounding leaves small imaginary parts where they have to be 0.
                        line[0].im = 0.0;
                        if nz % 2 == 0 {
                            line[half - 1].im = 0.0;
                        }
                        let _ = back.process_with_scratch(line, row, scratch_z);
                        for (v, w) in out.iter_mut().zip(row.iter()) {
                            *v = f64::from(*w) * scale;
                        }
                    }
                }
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_of_any_shape_are_transposed() {
        for (height, width) in [(1, 1), (8, 8), (16, 9), (9, 16), (23, 17), (3, 40)] {
            let from: Vec<Complex32> = (0..height * width)
                .map(|n| Complex32::new(n as f32, -1.0))
                .collect();
            let mut to = from.clone();
            transpose(&from, width, &mut to);
            for (n, v) in to.iter().enumerate() {
                let (j, i) = (n / height, n % height);
                assert_eq!(v.re, (i * width + j) as f32, "{height} {width}");
            }
        }
    }

    #[test]
    fn the_identity_gives_the_field_back_and_leaves_the_rest() {
        for counts in [[8, 6, 10], [5, 7, 9], [4, 6, 1]] {
            let [nx, ny, nz] = counts;
            let count = 3 * nx * ny * nz;
            let input: Vec<f64> = (0..count)
                .map(|n| ((n * 7919) % 101) as f64 / 50.0)
                .collect();
            let mut output = vec![9.0; count];
            let mut spectral = Spectral::<2>::new(counts);
            spectral.apply::<3>(&input, &mut output, |_, _| {});
            let layer = ny * nz;
            for (n, (a, b)) in input.iter().zip(&output).enumerate() {
                let is_kept = n / layer % 3 == 2;
                let expected = if is_kept { 9.0 } else { *a };
                assert!(
                    (expected - b).abs() < 1e-5,
                    "{counts:?} {n}: {expected} {b}"
                );
            }
        }
    }
}
