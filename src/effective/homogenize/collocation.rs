//! Trigonometric collocation (Moulinec and Suquet): the gradient of trigonometric polynomials.
//!
//! Displacements and gradients stand at the same points, and the number of voxels along each axis is odd.
//! The scheme serves as a check of the rotated scheme on small grids; it runs in double precision on one thread.

use super::grid::Grid;
use super::stencil::{Frequencies, RowMap};
use druse_cells::fourier;
use rustfft::Fft;
use rustfft::num_complex::Complex64;
use std::sync::Arc;

/// The scheme on a grid.
pub(super) struct Collocation {
    grid: Grid,
    frequencies: Frequencies,
    /// Forward and inverse, of each axis.
    transforms: [[Arc<dyn Fft<f64>>; 2]; 3],
}

// Fields lie layer by layer across x; within a layer one component after the other, each over y and z.
impl Collocation {
    /// Plans the transforms of the three axes, forward and inverse.
    pub fn new(grid: Grid) -> Self {
        Self {
            grid,
            frequencies: Frequencies::trigonometric(grid),
            transforms: grid.counts().map(fourier::transforms),
        }
    }

    /// The frequencies of trigonometric interpolation on the grid.
    pub fn frequencies(&self) -> Frequencies {
        Frequencies::trigonometric(self.grid)
    }

    /// Transforms along all axes in place, forward (`direction` 0) or back (1), without scaling.
    fn transform_in_place(&self, field: &mut [Complex64], direction: usize) {
        let counts = self.grid.counts();
        let strides = [counts[1] * counts[2], counts[2], 1];
        for axis in 0..3 {
            let (n, stride) = (counts[axis], strides[axis]);
            let mut line = vec![Complex64::default(); n];
            for start in 0..field.len() {
                // Only voxels with index 0 along the axis begin a line.
                if start / stride % n != 0 {
                    continue;
                }
                for (i, v) in line.iter_mut().enumerate() {
                    *v = field[start + i * stride];
                }
                self.transforms[axis][direction].process(&mut line);
                for (i, v) in line.iter().enumerate() {
                    field[start + i * stride] = *v;
                }
            }
        }
    }

    /// The voxel (i, j, k) with the number `n`, z fastest.
    fn index(&self, n: usize) -> [usize; 3] {
        let [_, ny, nz] = self.grid.counts();
        [n / (ny * nz), n / nz % ny, n % nz]
    }

    /// Index of component `c` at voxel `n` in a field of so many components.
    fn place(&self, components: usize, c: usize, n: usize) -> usize {
        let layer = self.grid.layer();
        (n / layer * components + c) * layer + n % layer
    }

    /// Gradients over all voxels: field 3 c + a is the derivative of component c along axis a.
    fn gradients<const C: usize, T: Copy + Into<f64>>(&self, input: &[T]) -> Vec<Vec<f64>> {
        let count = self.grid.voxels();
        let mut all = Vec::with_capacity(3 * C);
        for c in 0..C {
            let value = |n| Complex64::new(input[self.place(C, c, n)].into(), 0.0);
            let mut spectrum: Vec<Complex64> = (0..count).map(value).collect();
            self.transform_in_place(&mut spectrum, 0);
            // d/dx_a is the factor i q_a; 1 / count scales the pair of transforms.
            for a in 0..3 {
                let derived = |(n, v): (usize, &Complex64)| {
                    v * Complex64::new(0.0, self.frequencies.at(self.index(n))[a] / count as f64)
                };
                let mut field: Vec<Complex64> = spectrum.iter().enumerate().map(derived).collect();
                self.transform_in_place(&mut field, 1);
                all.push(field.into_iter().map(|v| v.re).collect());
            }
        }
        all
    }

    /// Calls `visit` with the first voxel of each row along z and the gradients of the row, one field after the other.
    /// What `visit` writes replaces them.
    fn rows(&self, gradients: &mut [Vec<f64>], mut visit: impl FnMut(usize, &mut [f64])) {
        let nz = self.grid.counts()[2];
        let mut row = vec![0.0; gradients.len() * nz];
        for first in (0..self.grid.voxels()).step_by(nz) {
            for (part, field) in row.chunks_mut(nz).zip(gradients.iter()) {
                part.copy_from_slice(&field[first..first + nz]);
            }
            visit(first, &mut row);
            for (part, field) in row.chunks(nz).zip(gradients.iter_mut()) {
                field[first..first + nz].copy_from_slice(part);
            }
        }
    }

    /// The transpose of the gradient, applied to `flux` of the gradient of `input`, into `output`. C is the number of
    /// components: 1 for potentials, 3 for displacements.
    pub fn transform<const C: usize, T: Copy + Into<f64>>(
        &self,
        input: &[T],
        output: &mut [f64],
        flux: &impl RowMap,
    ) {
        let count = self.grid.voxels();
        let mut fields = self.gradients::<C, T>(input);
        self.rows(&mut fields, |first, row| flux.map(first, row));
        // The transpose of d/dx_a is -i q_a in Fourier space: output_c = -sum over a of d(flux_ca)/dx_a.
        for c in 0..C {
            let mut sum = vec![Complex64::default(); count];
            for a in 0..3 {
                let flux = &fields[3 * c + a];
                let mut spectrum: Vec<Complex64> =
                    flux.iter().map(|v| Complex64::new(*v, 0.0)).collect();
                self.transform_in_place(&mut spectrum, 0);
                for (n, (s, v)) in sum.iter_mut().zip(&spectrum).enumerate() {
                    let q = self.frequencies.at(self.index(n))[a];
                    *s += v * Complex64::new(0.0, -q / count as f64);
                }
            }
            self.transform_in_place(&mut sum, 1);
            for (n, v) in sum.iter().enumerate() {
                output[self.place(C, c, n)] = v.re;
            }
        }
    }

    /// Sums over all rows what `part` returns for a row: it gets the row's first voxel and its gradients.
    pub fn sum<const C: usize, const M: usize, T: Copy + Into<f64>>(
        &self,
        input: &[T],
        part: &impl Fn(usize, &mut [f64]) -> [f64; M],
    ) -> [f64; M] {
        let mut total = [0.0; M];
        let mut fields = self.gradients::<C, T>(input);
        self.rows(&mut fields, |first, row| {
            for (t, f) in total.iter_mut().zip(part(first, row)) {
                *t += f;
            }
        });
        total
    }
}
