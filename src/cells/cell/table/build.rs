//! Spline coefficients from the spectrum of a series, and bounds of the interpolation error.
//!
//! A [`Spectrum`] has the waves of one series by their integer indices h on the box of its periods, the classes of axes
//! that need equal grids, and the symmetries that fold the stored coefficients. From it and a [`Grid`] come the
//! coefficients and rigorous bounds of the error, both without the rounding of single precision.

use super::super::compatibility::embedded;
use super::super::expression::Node;
use super::super::icosahedral::Products;
use super::super::{CellError, Series};
use super::grid::{Grid, GridSymmetry};
use super::resolution::OmittedWaves;
use super::window;
use druse_geometry::frame::Mat3;
use druse_geometry::simd;
use rayon::prelude::*;
use rustfft::{FftPlanner, FftPlannerScalar, num_complex::Complex64};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Largest index along an axis that a table supports: its waves need 2 * 127 + 1 samples, and the most are 256.
const MAX_INDEX: i32 = 127;

/// The spectrum of a series on the box of its periods, with edges along the Cartesian axes.
#[derive(Clone)]
pub(super) struct Spectrum {
    /// Indices per axis with their coefficients; zero coefficients are removed.
    pub terms: Vec<([i32; 3], [f64; 2])>,
    pub periods: [f64; 3],
    /// Largest index along each axis.
    pub max_index: [i32; 3],
    /// Axes that operators exchange share a class, the smallest of their numbers. Their grids are equal.
    axis_class: [usize; 3],
    /// The identity, and one operator per coset of the operators that map the grid onto itself. The mean of
    /// the interpolant over them has the symmetry of the series.
    pub coset_operators: Vec<Mat3>,
    /// Whether the function is constant along z.
    pub planar: bool,
    /// Symmetries that permute or reverse the axes.
    pub symmetry: GridSymmetry,
    /// The omitted waves.
    pub omitted: OmittedWaves,
    /// In place of terms: a function without a period, sampled over a box.
    pub sampled: Option<Arc<Products>>,
}

/// The permutation of the axes by an operator that only permutes and reverses axes, up to 1e-9; `None` for others.
fn axis_permutation(q: &Mat3) -> Option<[usize; 3]> {
    let mut permutation = [0; 3];
    for (axis, to) in permutation.iter_mut().enumerate() {
        *to = (0..3).find(|&i| (q[(i, axis)].abs() - 1.0).abs() < 1e-9)?;
    }
    Some(permutation)
}

impl Spectrum {
    /// The spectrum of a leaf of an expression.
    pub fn new(leaf: &Node) -> Result<Self, CellError> {
        match leaf {
            Node::Planar(s) => Self::of(s),
            Node::Series(s) => Self::of(s),
            Node::Icosahedral(s) => Ok(Self::sampled(s.products())),
            _ => Err(CellError::NoTable {
                reason: "it is not a series".to_owned(),
            }),
        }
    }

    /// A function without a period, sampled over the box around the ball; it is even along every axis.
    fn sampled(products: &Arc<Products>) -> Self {
        let index = (products.max_frequency() * window::WINDOW_EDGE).ceil() as i32;
        Self {
            terms: Vec::new(),
            periods: [window::WINDOW_EDGE; 3],
            max_index: [index; 3],
            axis_class: [0; 3],
            coset_operators: vec![Mat3::identity()],
            planar: false,
            symmetry: GridSymmetry {
                mirrored: [true; 3],
                ..GridSymmetry::default()
            },
            omitted: OmittedWaves::default(),
            sampled: Some(Arc::clone(products)),
        }
    }

    /// The spectrum of a series on the box of its periods, with the symmetries that its grid keeps.
    fn of<const D: usize>(series: &Series<D>) -> Result<Self, CellError> {
        let lattice = series.lattice();
        let series_periods = lattice.periods().ok_or_else(|| CellError::NoTable {
            reason: format!(
                "its lattice {:?} has no period along the axes",
                lattice.vectors()
            ),
        })?;
        // A planar series has one sample along z; any period serves.
        let periods = std::array::from_fn(|a| if a < D { series_periods[a] } else { 1.0 });
        let mut max_index = [0; 3];
        let mut terms = Vec::with_capacity(series.exponentials().len());
        // Indices on the grid: h = f times the period along each axis, an integer for every wave of the lattice.
        for &(k, c) in series.exponentials() {
            if c == [0.0; 2] {
                continue;
            }
            let f = lattice.frequency(k);
            let mut h = [0; 3];
            for a in 0..D {
                h[a] = (f[a] * series_periods[a]).round() as i32;
                max_index[a] = max_index[a].max(h[a].abs());
            }
            terms.push((h, c));
        }
        if let Some(&index) = max_index.iter().find(|&&g| g > MAX_INDEX) {
            return Err(CellError::TableTooLarge {
                index,
                limit: 2 * MAX_INDEX as usize + 2,
            });
        }
        let operators = embedded(series.group(), lattice);
        // Axes that an operator exchanges need equal numbers of samples. A class has the number of its least
        // axis; an operator merges the classes of the axes that it maps onto each other.
        let mut axis_class = [0, 1, 2];
        for permutation in operators.iter().filter_map(axis_permutation) {
            for (axis, to) in permutation.into_iter().enumerate() {
                let least = axis_class[axis].min(axis_class[to]);
                let (a, b) = (axis_class[axis], axis_class[to]);
                for c in &mut axis_class {
                    if *c == a || *c == b {
                        *c = least;
                    }
                }
            }
        }
        // Operators that permute or reverse axes map the grid onto itself. One operator of each coset of the
        // others completes the symmetry by a mean over rotated points.
        let mut coset_operators = vec![Mat3::identity()];
        for q in &operators {
            if coset_operators
                .iter()
                .all(|t| axis_permutation(&(q * t.transpose())).is_none())
            {
                coset_operators.push(*q);
            }
        }
        // Symmetries that fold the table: mirrors, twofold axes about z and x, exchanges of x, y and of y, z.
        let has = |wanted: Mat3| operators.iter().any(|q| (q - wanted).amax() < 1e-9);
        let keeps = |signs: [f64; 3]| has(Mat3::from_diagonal(&signs.into()));
        let even = |h: &[i32; 3], a: usize, b: usize| (h[a] + h[b]) % 2 == 0;
        let symmetry = GridSymmetry {
            mirrored: [
                keeps([-1.0, 1.0, 1.0]),
                keeps([1.0, -1.0, 1.0]),
                keeps([1.0, 1.0, -1.0]),
            ],
            twofold: keeps([-1.0, -1.0, 1.0]) && keeps([1.0, -1.0, -1.0]),
            // All h of one parity: the translations by half a period along two axes leave the function
            // unchanged, as those of the lattice `fcc2` do.
            face_centred: D == 3 && terms.iter().all(|(h, _)| even(h, 0, 1) && even(h, 1, 2)),
            exchanged: [
                has(Mat3::new(0., 1., 0., 1., 0., 0., 0., 0., 1.)),
                has(Mat3::new(1., 0., 0., 0., 0., 1., 0., 1., 0.)),
            ],
        };
        Ok(Self {
            terms,
            periods,
            max_index,
            axis_class,
            coset_operators,
            planar: D == 2,
            symmetry,
            omitted: OmittedWaves::default(),
            sampled: None,
        })
    }

    /// The grid whose axes have at least the number of samples that `samples_for` gives for the largest
    /// index. Axes that operators exchange get equal numbers.
    pub fn grid(&self, samples_for: impl Fn(i32) -> usize) -> Grid {
        self.grid_with(|axis| fft_size(samples_for(self.max_index[axis])))
    }

    /// The grid with the given number of samples per axis. Axes that operators exchange get the maximum of
    /// theirs.
    pub fn grid_with(&self, size: impl Fn(usize) -> usize) -> Grid {
        let largest = |axis: usize| {
            let same_class = (0..3).filter(|&a| self.axis_class[a] == self.axis_class[axis]);
            same_class.map(&size).max().unwrap_or(1)
        };
        let samples = std::array::from_fn(|a| if self.planar && a == 2 { 1 } else { largest(a) });
        Grid {
            samples,
            periods: self.periods,
        }
    }

    /// Largest index over all axes.
    pub fn max_index(&self) -> i32 {
        self.max_index.into_iter().max().unwrap_or(0)
    }

    /// Checks that the grid can represent every wave.
    pub fn check(&self, grid: &Grid) -> Result<(), CellError> {
        for (index, limit) in self.max_index.into_iter().zip(grid.samples) {
            if limit <= 2 * index as usize {
                return Err(CellError::TableTooLarge { index, limit });
            }
        }
        Ok(())
    }

    /// Bounds of the interpolation error of the value and of each component of the gradient.
    ///
    /// Along an axis the interpolant of the wave h is a sum of waves h + m N with amplitudes a(m) >= 0 that
    /// add up to 1. Here a(0) is [`interpolant_gain`] and a(m) = a(0) (h / (h + m N))^4. The error of the
    /// value is therefore at most 2 (1 - prod a). The error of the derivative along axis i is at most 2 pi
    /// |h| / P times the sum of the loss of the wave itself, 1 - prod a; the aliases across the axis, a
    /// minus prod a; and the aliases along it, a times the sum over m of |h / (h + m N)|^3.
    pub fn error_bounds(&self, grid: &Grid) -> (f64, f64) {
        let tables: [Vec<(f64, f64)>; 3] = std::array::from_fn(|a| {
            let n = grid.samples[a] as f64;
            (0..=self.max_index[a])
                .map(|h| (interpolant_gain(f64::from(h), n), aliases(f64::from(h), n)))
                .collect()
        });
        if let Some(products) = &self.sampled {
            return window::error_bounds(products, grid);
        }
        let (mut value, mut slope) = (self.omitted.value, [self.omitted.slope; 3]);
        for &(h, [re, im]) in &self.terms {
            let size = libm::hypot(re, im);
            let of = |axis: usize| tables[axis][h[axis].unsigned_abs() as usize];
            let product: f64 = (0..3).map(|a| of(a).0).product();
            value += size * 2.0 * (1.0 - product);
            for axis in 0..3 {
                let (gain, aliases) = of(axis);
                let lost = (1.0 - product) + (gain - product) + gain * aliases;
                slope[axis] += size * TAU * f64::from(h[axis].abs()) / self.periods[axis] * lost;
            }
        }
        let max_slope = if self.coset_operators.len() == 1 {
            slope.into_iter().fold(0.0, f64::max)
        } else {
            // A component of a rotated gradient combines several components.
            slope.iter().map(|s| s * s).sum::<f64>().sqrt()
        };
        (value, max_slope)
    }

    /// Unpadded coefficients of one period, in double precision.
    fn transformed(&self, grid: &Grid) -> Vec<Complex64> {
        let [nx, ny, nz] = grid.samples;
        let mut values = vec![Complex64::default(); nx * ny * nz];
        for &(h, [re, im]) in &self.terms {
            // c_h = C_h / prod_a ((2 + cos(2 pi h_a / N_a)) / 3): the sampled spline then has the values of
            // the series at the grid points.
            let gain: f64 = (0..3)
                .map(|a| attenuation(f64::from(h[a]), grid.samples[a] as f64))
                .product();
            let [x, y, z] = [0, 1, 2].map(|a| h[a].rem_euclid(grid.samples[a] as i32) as usize);
            values[(x * ny + y) * nz + z] += Complex64::new(re, im) / gain;
        }
        inverse_transform(&mut values, grid.samples);
        values
    }

    /// Padded coefficients of the spline that interpolates the series.
    pub fn coefficients(&self, grid: &Grid) -> Vec<f32> {
        let [nx, ny, nz] = grid.samples;
        let values = match &self.sampled {
            Some(products) => window::coefficients(products, grid),
            None => self.transformed(grid),
        };
        let [sx, sy, sz] = grid.padded();
        let mut padded = vec![0f32; sx * sy * sz];
        padded
            .par_chunks_mut(sy * sz)
            .enumerate()
            .for_each(|(i, plane)| {
                // The padding starts one sample before 0, so that the four coefficients of cell i begin at index i.
                let wrap = |c: usize, n: usize| (c + n - 1) % n;
                for j in 0..sy {
                    let from = (wrap(i, nx) * ny + wrap(j, ny)) * nz;
                    for k in 0..sz {
                        plane[j * sz + k] = values[from + wrap(k, nz)].re as f32;
                    }
                }
            });
        padded
    }
}

/// The smallest even size >= `n` with no prime factors but 2, 3 and 5.
pub(super) fn fft_size(n: usize) -> usize {
    let smooth = |mut m: usize| {
        for p in [2, 3, 5] {
            while m.is_multiple_of(p) {
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
pub(super) fn attenuation(h: f64, n: f64) -> f64 {
    (2.0 + libm::cos(TAU * h / n)) / 3.0
}

/// sinc^4 / attenuation: the amplitude of a wave in its interpolant.
pub(super) fn interpolant_gain(h: f64, n: f64) -> f64 {
    let x = PI * h / n;
    let sinc = if h == 0.0 { 1.0 } else { libm::sin(x) / x };
    sinc.powi(4) / attenuation(h, n)
}

/// Bound of the sum over m != 0 of |h / (h + m N)|^3.
pub(super) fn aliases(h: f64, n: f64) -> f64 {
    const TERMS: i32 = 20;
    let ratio = h / n;
    let partial: f64 = (1..=TERMS)
        .flat_map(|m| [f64::from(m), -f64::from(m)])
        .map(|m| (ratio / (ratio + m)).abs().powi(3))
        .sum();
    // The remainder is below the integral of 2 (ratio / (m - 1/2))^3 from m = TERMS on.
    partial + (ratio / (f64::from(TERMS) - 0.5)).powi(2) * ratio
}

/// Unnormalised inverse transform of a box, one axis after the other. The axes are rotated so that each in
/// turn is contiguous.
pub(super) fn inverse_transform(grid: &mut Vec<Complex64>, mut sizes: [usize; 3]) {
    let mut planner = FftPlanner::new();
    // Gives the same bits on all processors; the other takes the instructions of this one.
    let mut portable = FftPlannerScalar::new();
    for _ in 0..3 {
        let [nx, ny, nz] = sizes;
        let fft = if simd::is_portable() {
            portable.plan_fft_inverse(nz)
        } else {
            planner.plan_fft_inverse(nz)
        };
        grid.par_chunks_mut(ny * nz).for_each(|plane| {
            let mut scratch = vec![Complex64::default(); fft.get_inplace_scratch_len()];
            for row in plane.chunks_exact_mut(nz) {
                fft.process_with_scratch(row, &mut scratch);
            }
        });
        // (x, y, z) -> (z, x, y)
        let mut rotated = vec![Complex64::default(); grid.len()];
        rotated
            .par_chunks_mut(nx * ny)
            .enumerate()
            .for_each(|(z, plane)| {
                for (xy, v) in plane.iter_mut().enumerate() {
                    *v = grid[xy * nz + z];
                }
            });
        *grid = rotated;
        sizes = [nz, nx, ny];
    }
}
