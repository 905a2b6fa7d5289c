//! Tables with the resolution that a tolerance requires.
//!
//! The errors of a table, from few samples and omitted waves, displace the surface by the difference of the values over
//! the slope. Waves are orthogonal, so that the mean square of the difference is a sum over waves. An omitted wave adds
//! |C|^2. A wave with index h on N samples along an axis adds |C|^2 (1 - 2 prod a + prod s), where a is the amplitude
//! of the wave in its interpolant and s the sum of the squares of a and of the aliases, a^2 (h / (h + m N))^8. The law
//! `the_mean_square_is_the_sum_over_waves` measures 0.5 to 1.1 of the root of this sum: means over rotated points take
//! aliases away.
//!
//! Waves are omitted by their frequency |f|, which is equal within an orbit. Orbits are therefore omitted
//! as a whole, and the table keeps the symmetry of the cell.

use super::build::{Spectrum, fft_size, interpolant_gain};
use super::displacement::DisplacementProbe;
use super::grid::Grid;
use super::{Cell, CellError, Function, MAX_SAMPLES, MIN_SAMPLES, Table, function, spectra};
use crate::cell::SmoothFunction;
use druse_geometry::frame::CellPoint;
use std::f64::consts::TAU;

/// Rounding error of single precision, relative to the root mean square of the function. No smaller error
/// is requested.
const ROUNDING: f64 = 5e-7;
/// Aliases that are summed on either side.
const ALIASES_PER_SIDE: i32 = 4;
/// The number of samples along an axis is a multiple of this, so that symmetries fold it and the windows of
/// bounds stay aligned.
const SAMPLES_MULTIPLE: usize = 8;

/// Maximal number of samples per axis in [`Table::with_tolerance`].
const MAX_TOLERANCE_SAMPLES: usize = 256;

/// The waves that a spectrum omits.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OmittedWaves {
    /// Number of waves.
    pub count: usize,
    /// Sum of |C|^2.
    pub square: f64,
    /// Sum of |C|, a bound of their contribution to a value.
    pub value: f64,
    /// Bound of their contribution to a gradient component.
    pub slope: f64,
}

impl Table {
    /// The smallest table whose [`Table::error_bound`] is at most `tolerance`, in field units, without
    /// single-precision rounding.
    /// `tolerance` should be positive.
    ///
    /// # Errors
    /// [`CellError::TableTooLarge`] if more than 256 samples per axis are needed.
    pub fn with_tolerance(cell: &Cell, tolerance: f64) -> Result<Self, CellError> {
        let expression = function(cell);
        let spectra = spectra(&expression)?;
        // Ratio of the samples per axis to the minimum that represents every wave.
        let mut excess = 1.0f64;
        loop {
            let samples_for = |index: i32| {
                let least = (2 * index as usize + 1).max(MIN_SAMPLES);
                (least as f64 * excess).ceil() as usize
            };
            let grids: Vec<Grid> = spectra.iter().map(|s| s.grid(samples_for)).collect();
            let mut number = 0;
            let [error, ..] = expression.error_bound_with(&mut |_| {
                let (value, slope) = spectra[number].error_bounds(&grids[number]);
                number += 1;
                [value, slope, 0.0]
            });
            let largest = grids.iter().flat_map(|g| g.samples).max().unwrap_or(0);
            if largest > MAX_TOLERANCE_SAMPLES {
                let index = spectra.iter().map(Spectrum::max_index).max().unwrap_or(0);
                return Err(CellError::TableTooLarge {
                    index,
                    limit: MAX_TOLERANCE_SAMPLES,
                });
            }
            if error <= tolerance {
                let leaves = spectra.into_iter().zip(grids).collect();
                return Ok(Self::build(cell, expression, leaves));
            }
            // Continue with the next larger size of the smallest grid.
            let smallest = grids.iter().flat_map(|g| g.samples).filter(|n| *n > 1);
            let smallest = smallest.min().unwrap_or(MIN_SAMPLES);
            excess *= fft_size(smallest + 1) as f64 / smallest as f64;
        }
    }

    /// The smallest table whose measured displacement of the surface is at most `most` reference lengths;
    /// see [`Table::displacement`]. Waves above the resolution of such a table are omitted. With 0 the
    /// table is as accurate as single precision. Tables have at most 160 samples per axis.
    /// A table whose waves are omitted is found by a few trials of the root mean square; the last trial may miss `most`
    /// if the samples reach their limit. [`Table::displacement`] has what was reached.
    ///
    /// # Errors
    /// As [`Table::new`].
    pub fn for_displacement(cell: &Cell, most: f64) -> Result<Self, CellError> {
        let expression = function(cell);
        let spectra = spectra(&expression)?;
        // The factor by which the expression amplifies errors of its series.
        let [gain, ..] = expression.error_bound_with(&mut |_| [1.0, 0.0, 0.0]);
        let mut rms = most * cell.gamma() / gain;
        let mut probe = None;
        let mut grids: Vec<Grid> = Vec::new();
        let mut best = None;
        loop {
            let resolved_spectra = spectra.iter().map(|s| s.clone().resolved(rms));
            let leaves = match resolved_spectra.collect::<Result<Vec<_>, CellError>>() {
                Ok(leaves) => leaves,
                // A table was found that exceeds the tolerance; a finer one is impossible.
                Err(error) => return best.ok_or(error),
            };
            let last = std::mem::replace(&mut grids, leaves.iter().map(|l| l.1).collect());
            let mut table = Self::build(cell, expression.clone(), leaves);
            table.prefer_products();
            let probe = probe.get_or_insert_with(|| DisplacementProbe::new(cell, &table));
            let found = probe.displacement(&table);
            table.displacement = Some(found);
            // The same grids again mean that a smaller error is not attainable.
            if found <= most || last == grids {
                return Ok(table);
            }
            let error_rms = table.error_rms;
            best = Some(table);
            // Where waves interfere, and where the slope is small, the displacement is several times the
            // root mean square error over the mean slope. The root of the ratio, a cautious step, may still skip sizes.
            rms = error_rms / gain * (most / found).sqrt();
        }
    }

    /// The smooth function that the table holds, if it is one series.
    /// `None` for an expression, a planar series, a mean over rotations, and functions that are sampled.
    pub fn smooth(&self) -> Option<SmoothFunction> {
        let Function::Single(leaf) = &self.function else {
            return None;
        };
        Some(SmoothFunction {
            frequency: leaf.max_frequency()?,
            fold: self.solid.fold(self.half_thickness),
        })
    }

    /// Values of that function at points, into `out` of the same length; values of the solid field if there
    /// is no fold.
    pub fn smooth_values(&self, points: &[CellPoint<3>], out: &mut [f32]) {
        match &self.function {
            Function::Single(leaf) if self.solid.is_symmetric() => leaf.spline.values(points, out),
            _ => self.values(points, out),
        }
    }
}

impl Spectrum {
    /// The smallest grid for a root mean square error of at most `rms`, and the spectrum without the waves that it
    /// cannot represent. With the most samples the error may be greater; [`CellError::TableTooLarge`] if waves are lost.
    fn resolved(mut self, rms: f64) -> Result<(Self, Grid), CellError> {
        // Sampled functions have no exact spectrum to shorten: the default grid holds them.
        if self.sampled.is_some() {
            let grid = self.grid(super::default_samples);
            self.check(&grid)?;
            return Ok((self, grid));
        }
        let whole: f64 = self.terms.iter().map(|t| square_of(t.1)).sum();
        // An error below single precision is not attainable.
        let square = (rms * rms).max(ROUNDING * ROUNDING * whole);
        let axes = if self.planar { 2 } else { 3 };
        let longest = self.periods[..axes].iter().copied().fold(0.0, f64::max);
        // A grid with `samples` along the longest period and the same density along the others.
        let of = |samples: usize| {
            let density = aligned_size(samples) as f64 / longest;
            let samples_for = |axis: usize| (density * self.periods[axis]).ceil() as usize;
            self.grid_with(|axis| aligned_size(samples_for(axis).min(MAX_SAMPLES)))
        };
        // The next size until the waves that the grid holds, and those that it omits, meet the tolerance, or until
        // the samples reach their limit.
        let mut grid = of(MIN_SAMPLES);
        loop {
            let most = grid.max_frequency();
            if self.error_square(&grid, most) <= square {
                self.omit(most);
                return Ok((self, grid));
            }
            let samples = grid.samples.into_iter().max().unwrap_or(1);
            if samples >= MAX_SAMPLES {
                self.check(&grid)?;
                return Ok((self, grid));
            }
            grid = of(samples + 1);
        }
    }

    /// Mean square of the error on a grid if all waves of frequency |f| >= `most` are omitted, including
    /// those that are already omitted. 0 for a function without periods. `most` is in cycles per reference length.
    pub(super) fn error_square(&self, grid: &Grid, most: f64) -> f64 {
        let tables: [Vec<(f64, f64)>; 3] = std::array::from_fn(|a| {
            let n = grid.samples[a] as f64;
            let indices = 0..=self.max_index[a];
            indices.map(|h| gain_and_power(f64::from(h), n)).collect()
        });
        let mut square = self.omitted.square;
        for &(h, c) in &self.terms {
            let off = if self.frequency(h) >= most {
                1.0
            } else {
                let of = |a: usize| tables[a][h[a].unsigned_abs() as usize];
                let [x, y, z] = [of(0), of(1), of(2)];
                1.0 - 2.0 * x.0 * y.0 * z.0 + x.1 * y.1 * z.1
            };
            square += square_of(c) * off.max(0.0);
        }
        square
    }

    /// Omits the waves of frequency |f| >= `most` and adds them to [`OmittedWaves`].
    fn omit(&mut self, most: f64) {
        let terms = std::mem::take(&mut self.terms);
        self.max_index = [0; 3];
        for (h, c) in terms {
            let f = self.frequency(h);
            if f < most {
                for (greatest, h) in self.max_index.iter_mut().zip(h) {
                    *greatest = (*greatest).max(h.abs());
                }
                self.terms.push((h, c));
                continue;
            }
            let size = square_of(c).sqrt();
            self.omitted.count += 1;
            self.omitted.square += size * size;
            self.omitted.value += size;
            self.omitted.slope += TAU * f * size;
        }
    }

    /// |f| of the shortest wave; `None` for a function that is not a sum of waves.
    pub(super) fn max_frequency(&self) -> Option<f64> {
        let all = self.terms.iter().map(|t| self.frequency(t.0));
        let greatest = all.fold(0.0, f64::max);
        self.sampled.is_none().then_some(greatest)
    }

    /// |f| of an index, in cycles per unit of reference length.
    fn frequency(&self, h: [i32; 3]) -> f64 {
        let square = |a: usize| (f64::from(h[a]) / self.periods[a]).powi(2);
        (square(0) + square(1) + square(2)).sqrt()
    }
}

impl Grid {
    /// A frequency |f| below which indices are below half the samples along every axis. It is slightly below
    /// the maximum, so that waves of one orbit, whose |f| differ by rounding, are on the same side.
    fn max_frequency(&self) -> f64 {
        let along = |a: usize| 0.5 * self.samples[a] as f64 / self.periods[a];
        let axes = (0..3).filter(|&a| self.samples[a] > 1);
        axes.map(along).fold(f64::INFINITY, f64::min) * (1.0 - 1e-9)
    }
}

/// The smallest multiple of [`SAMPLES_MULTIPLE`] from `samples` on with no prime factors but 2, 3 and 5.
fn aligned_size(samples: usize) -> usize {
    // FFT sizes are even.
    let unit = SAMPLES_MULTIPLE / 2;
    unit * fft_size(samples.div_ceil(unit))
}

/// |C|^2.
fn square_of([re, im]: [f64; 2]) -> f64 {
    re * re + im * im
}

/// For the wave h on N samples: its amplitude in its interpolant, and the sum of the squares of that and of
/// its aliases.
fn gain_and_power(h: f64, n: f64) -> (f64, f64) {
    let own = interpolant_gain(h, n);
    let mut sum = 1.0;
    for m in 1..=ALIASES_PER_SIDE {
        for m in [f64::from(m), -f64::from(m)] {
            sum += (h / (h + m * n)).powi(8);
        }
    }
    (own, own * own * sum)
}
