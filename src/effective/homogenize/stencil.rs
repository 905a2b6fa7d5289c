//! The gradient on a grid: Willot's rotated scheme, its transpose, frequencies of both schemes, the Green operator.
//!
//! Displacements stand at the corners of voxels, gradients at their centres: the difference of the means of
//! opposite sides. That is a hexahedral element with one integration point, in Fourier space the frequency
//! `(s_x c_y c_z, ...)` of Willot's rotated scheme (2015), with s = 2 sin(pi k / N) / h and c = cos(pi k / N). Rows
//! along z are the unit of work, so that the inner loops are plain arithmetic on contiguous numbers.

use super::grid::Grid;
use super::spectral::Spectral;
use druse_geometry::simd::run_vectorized;
use rayon::prelude::*;

/// Layers of corners that one task fills; one more layer of voxels is computed twice.
const BLOCK_LAYERS: usize = 8;

/// Fluxes from gradients of one row of voxels.
pub(super) trait RowMap: Sync {
    /// Replaces gradients by fluxes: the first voxel's number, and 3 C rows, of each component the derivatives
    /// along x, y, z in turn.
    fn map(&self, first: usize, rows: &mut [f64]);
}

/// Leaves gradients as they are.
struct Identity;

impl RowMap for Identity {
    #[inline(always)]
    fn map(&self, _: usize, _: &mut [f64]) {}
}

/// The rotated scheme on a grid.
#[derive(Clone, Debug)]
pub(super) struct Stencil {
    grid: Grid,
}

/// Rows that one row of voxels needs.
struct Rows {
    /// 3 C rows of gradients or fluxes.
    values: Vec<f64>,
    /// Sums and differences over the four rows of corners, one number longer.
    sums: [Vec<f64>; 3],
}

impl Rows {
    fn new(components: usize, nz: usize) -> Self {
        Self {
            values: vec![0.0; 3 * components * nz],
            sums: std::array::from_fn(|_| vec![0.0; nz + 1]),
        }
    }
}

/// The gradient of one component on a row of voxels, from the four rows of corners around it: (y, x) low low, high
/// low, low high, high high. `scale` is a quarter of the inverse spacing, `out` gets the rows d/dx, d/dy, d/dz, and
/// `sums` is scratch space.
#[inline(always)]
fn gradient<T: Copy + Into<f64>>(
    corners: [&[T]; 4],
    scale: [f64; 3],
    sums: &mut [Vec<f64>; 3],
    out: &mut [f64],
) {
    let nz = corners[0].len();
    let [a, b, c, d] = corners.map(|r| &r[..nz]);
    let [sx, sy, sz] = sums;
    let (sx, sy, sz) = (&mut sx[..=nz], &mut sy[..=nz], &mut sz[..=nz]);
    // At each k the sums over the four corners with the signs of the differences along x and y, and without
    // signs for z.
    for k in 0..nz {
        let (a, b, c, d): (f64, f64, f64, f64) =
            (a[k].into(), b[k].into(), c[k].into(), d[k].into());
        let (low, high) = (a + b, c + d);
        sx[k] = high - low;
        sz[k] = high + low;
        sy[k] = (b + d) - (a + c);
    }
    // Rows are periodic along z.
    (sx[nz], sy[nz], sz[nz]) = (sx[0], sy[0], sz[0]);
    let (gx, rest) = out.split_at_mut(nz);
    let (gy, gz) = rest.split_at_mut(nz);
    let gz = &mut gz[..nz];
    // Each derivative is the difference of the means over opposite faces of the voxel: the sums of `k` and `k + 1`.
    for k in 0..nz {
        gx[k] = (sx[k] + sx[k + 1]) * scale[0];
        gy[k] = (sy[k] + sy[k + 1]) * scale[1];
        gz[k] = (sz[k + 1] - sz[k]) * scale[2];
    }
}

/// The contributions of the fluxes of one component on a row of voxels to the corners, as sums over z in `sums`: those
/// of the fluxes along x, y, z. `fluxes` holds these three rows, `scale` is that of [`gradient`].
#[inline(always)]
fn flux_sums(fluxes: &[f64], scale: [f64; 3], sums: &mut [Vec<f64>; 3]) {
    let nz = fluxes.len() / 3;
    let (fx, rest) = fluxes.split_at(nz);
    let (fy, fz) = rest.split_at(nz);
    let fz = &fz[..nz];
    let [sx, sy, sz] = sums;
    let (sx, sy, sz) = (&mut sx[..nz], &mut sy[..nz], &mut sz[..nz]);
    let last = nz - 1;
    sx[0] = (fx[last] + fx[0]) * scale[0];
    sy[0] = (fy[last] + fy[0]) * scale[1];
    sz[0] = (fz[last] - fz[0]) * scale[2];
    for k in 1..nz {
        sx[k] = (fx[k - 1] + fx[k]) * scale[0];
        sy[k] = (fy[k - 1] + fy[k]) * scale[1];
        sz[k] = (fz[k - 1] - fz[k]) * scale[2];
    }
}

/// Adds `signs` (along x and y) times the sums to a row of corners.
#[inline(always)]
fn add_to_corners(sums: &[Vec<f64>; 3], signs: [f64; 2], out: &mut [f64]) {
    let nz = out.len();
    let [sx, sy, sz] = sums;
    let (sx, sy, sz) = (&sx[..nz], &sy[..nz], &sz[..nz]);
    for k in 0..nz {
        out[k] += signs[0] * sx[k] + signs[1] * sy[k] + sz[k];
    }
}

impl Stencil {
    /// The stencil on a grid of voxels.
    pub fn new(grid: Grid) -> Self {
        Self { grid }
    }

    /// A quarter of the inverse spacing: each derivative is a mean of four differences.
    fn scale(&self) -> [f64; 3] {
        self.grid.spacing().map(|h| 0.25 / h)
    }

    /// The transpose of the gradient, applied to `flux` of the gradient of `input`, into `output`. Fields have C
    /// components and lie layer by layer across x, and each layer holds its components over y and z.
    pub fn transform<const C: usize, T: Copy + Into<f64> + Sync>(
        &self,
        input: &[T],
        output: &mut [f64],
        flux: &impl RowMap,
    ) {
        let [nx, ny, nz] = self.grid.counts();
        let layer = C * ny * nz;
        let scale = self.scale();
        output
            .par_chunks_mut(BLOCK_LAYERS * layer)
            .enumerate()
            .for_each_init(
                || Rows::new(C, nz),
                |rows, (block, out)| {
                    out.fill(0.0);
                    let first = block * BLOCK_LAYERS;
                    let count = out.len() / layer;
                    // Voxels i lie between the corners i and i + 1.
                    for step in 0..=count {
                        let i = (first + step + nx - 1) % nx;
                        for j in 0..ny {
                            run_vectorized(
                                #[inline(always)]
                                || {
                                    let next = (j + 1) % ny;
                                    self.row::<C, T>(input, [i, j], rows, flux);
                                    for c in 0..C {
                                        let fluxes = &rows.values[3 * c * nz..3 * (c + 1) * nz];
                                        flux_sums(fluxes, scale, &mut rows.sums);
                                        // The transpose: a voxel gives its fluxes back to its eight corners,
                                        // with the signs of the gradient.
                                        let mut give =
                                            |layer_of: usize, signs: [f64; 2], j: usize| {
                                                let at = layer_of * layer + (c * ny + j) * nz;
                                                add_to_corners(
                                                    &rows.sums,
                                                    signs,
                                                    &mut out[at..at + nz],
                                                );
                                            };
                                        // The layer of corners before the voxels lies in this block except at
                                        // its start, the layer behind them except at its end.
                                        if step > 0 {
                                            give(step - 1, [-1.0, -1.0], j);
                                            give(step - 1, [-1.0, 1.0], next);
                                        }
                                        if step < count {
                                            give(step, [1.0, -1.0], j);
                                            give(step, [1.0, 1.0], next);
                                        }
                                    }
                                },
                            );
                        }
                    }
                },
            );
    }

    /// Gradients and fluxes of the row of voxels with the indices `i` along x and `j` along y, left in `rows.values`:
    /// row 3 c + a belongs to component c and axis a.
    #[inline(always)]
    fn row<const C: usize, T: Copy + Into<f64>>(
        &self,
        input: &[T],
        [i, j]: [usize; 2],
        rows: &mut Rows,
        flux: &impl RowMap,
    ) {
        let [nx, ny, nz] = self.grid.counts();
        let scale = self.scale();
        let (after, next) = ((i + 1) % nx, (j + 1) % ny);
        for c in 0..C {
            let corners = [[i, j], [i, next], [after, j], [after, next]].map(|[i, j]| {
                let at = ((i * C + c) * ny + j) * nz;
                &input[at..at + nz]
            });
            let out = &mut rows.values[3 * c * nz..3 * (c + 1) * nz];
            gradient(corners, scale, &mut rows.sums, out);
        }
        flux.map((i * ny + j) * nz, &mut rows.values);
    }

    /// Sums of `part` of the gradients over all voxels, row by row in a fixed order. `part` gets the first voxel of a
    /// row and its gradients.
    pub fn sum<const C: usize, const M: usize, T: Copy + Into<f64> + Sync>(
        &self,
        input: &[T],
        part: &(impl Fn(usize, &mut [f64]) -> [f64; M] + Sync),
    ) -> [f64; M] {
        let [nx, ny, nz] = self.grid.counts();
        // A sum per layer, then the layers in order: the result does not depend on the threads.
        let layers: Vec<[f64; M]> = (0..nx)
            .into_par_iter()
            .map_init(
                || Rows::new(C, nz),
                |rows, i| {
                    let mut total = [0.0; M];
                    for j in 0..ny {
                        self.row::<C, T>(input, [i, j], rows, &Identity);
                        let found = part((i * ny + j) * nz, &mut rows.values);
                        for (t, f) in total.iter_mut().zip(found) {
                            *t += f;
                        }
                    }
                    total
                },
            )
            .collect();
        let mut total = [0.0; M];
        for found in layers {
            for (t, f) in total.iter_mut().zip(found) {
                *t += f;
            }
        }
        total
    }

    /// The frequencies of the scheme: the symbols of the derivatives along the axes at an index, up to a common phase.
    pub fn frequencies(&self) -> Frequencies {
        Frequencies::rotated(self.grid)
    }
}

/// Factors of the frequencies along each axis.
pub(super) struct Frequencies {
    /// Of the derivative along the axis.
    own: [Vec<f64>; 3],
    /// Of those along the other axes.
    others: [Vec<f64>; 3],
}

impl Frequencies {
    /// The frequencies of the rotated scheme: `own` is 2 sin(pi k / N) / h along an axis, `others` the means cos(pi k
    /// / N) over the two other axes.
    fn rotated(grid: Grid) -> Self {
        let (counts, spacing) = (grid.counts(), grid.spacing());
        let angle = |a: usize, k: usize| std::f64::consts::PI * k as f64 / counts[a] as f64;
        Self {
            own: std::array::from_fn(|a| {
                let value = |k| 2.0 / spacing[a] * libm::sin(angle(a, k));
                (0..counts[a]).map(value).collect()
            }),
            others: std::array::from_fn(|a| {
                // At Nyquist the means over opposite corners vanish; the cosine of pi/2 has a rounding error.
                let value = |k: usize| {
                    if 2 * k == counts[a] {
                        0.0
                    } else {
                        libm::cos(angle(a, k))
                    }
                };
                (0..counts[a]).map(value).collect()
            }),
        }
    }

    /// Those of trigonometric polynomials: 2 pi k / L with k in (-N / 2, N / 2], and no means over the other axes.
    pub fn trigonometric(grid: Grid) -> Self {
        let (counts, size) = (grid.counts(), grid.size());
        Self {
            own: std::array::from_fn(|a| {
                let signed = |k: usize| {
                    let n = counts[a] as f64;
                    if 2 * k > counts[a] {
                        k as f64 - n
                    } else {
                        k as f64
                    }
                };
                let value = |k| std::f64::consts::TAU * signed(k) / size[a];
                (0..counts[a]).map(value).collect()
            }),
            others: std::array::from_fn(|a| vec![1.0; counts[a]]),
        }
    }

    /// The frequency q at an index (i, j, k): the derivative along axis a multiplies by i `q_a`, up to a common phase.
    #[inline]
    pub fn at(&self, [i, j, k]: [usize; 3]) -> [f64; 3] {
        let [x, y, z] = [self.others[0][i], self.others[1][j], self.others[2][k]];
        [
            self.own[0][i] * y * z,
            x * self.own[1][j] * z,
            x * y * self.own[2][k],
        ]
    }
}

/// Applies the inverse of an isotropic operator in Fourier space, into `output`. `across` is the modulus of waves
/// across their direction (mu), `along` that of waves along it (lambda + 2 mu); for a scalar both are its
/// coefficient. With the frequency q it is (v - (1 - across / along) q (q . v) / |q|^2) / (across |q|^2); 0 where q is.
pub(super) fn green<const C: usize>(
    spectral: &mut Spectral<C>,
    frequencies: &Frequencies,
    [across, along]: [f64; 2],
    input: &[f64],
    output: &mut [f64],
) {
    spectral.apply::<C>(input, output, |index, v| {
        let q = frequencies.at(index);
        let square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2];
        // Zero up to rounding: the mean, and frequencies at Nyquist along two axes.
        if square < 1e-20 {
            // Compatible fields have no component at this frequency.
            v.fill(rustfft::num_complex::Complex32::new(0.0, 0.0));
            return;
        }
        let inverse = (1.0 / (across * square)) as f32;
        if C == 3 {
            let q = q.map(|c| c as f32);
            let share = ((1.0 - across / along) / square) as f32;
            let dot = (v[0] * q[0] + v[1] * q[1] + v[2] * q[2]) * share;
            for c in 0..C {
                v[c] = (v[c] - dot * q[c]) * inverse;
            }
        } else {
            for c in v.iter_mut() {
                *c *= inverse;
            }
        }
    });
}
