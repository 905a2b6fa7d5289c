//! Tables as fine as the voxels that they are for.
//!
//! How few samples a table has, and what waves it leaves out because of that, shows as a displacement of
//! the surface: the difference of the values over the slope. Waves are orthogonal, so that the mean square
//! of the whole difference is a sum over them. A wave that is left out adds |C|^2; one that is kept, with
//! index h of N samples along an axis, |C|^2 (1 - 2 prod a + prod s), where a is what its interpolant
//! keeps of it and s the sum of the squares of that and of its aliases, a^2 (h / (h + m N))^8.
//!
//! Waves are left out by their frequency |f|, which is alike in an orbit: orbits go whole, and the table
//! stays as symmetric as the cell.

use super::build::{Spectrum, good_size, kept};
use super::displacement::Probe;
use super::grid::Grid;
use super::{Cell, CellError, Function, LARGEST, SMALLEST, Table, function, spectra};
use crate::cell::Smooth;
use crate::frame::CellPoint;
use std::f64::consts::TAU;

/// What single precision adds, relative to the root mean square of the function: less need not be asked
/// for.
const ROUNDING: f64 = 5e-7;
/// Aliases on either side that count.
const ALIASES: i32 = 4;
/// Samples along an axis are a multiple of this: then their symmetries fold them, and windows of bounds
/// stay aligned, as far as they go.
const MULTIPLE: usize = 8;

/// Greatest number of samples per axis that [`Table::with_tolerance`] uses.
const LIMIT: usize = 256;

/// Waves that a spectrum has left out.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Dropped {
    /// How many.
    pub count: usize,
    /// Sum of |C|^2.
    pub square: f64,
    /// Sum of |C|: bound of what they add to a value.
    pub value: f64,
    /// Bound of what they add to a component of the gradient.
    pub slope: f64,
}

impl Table {
    /// The smallest table whose [`Table::error_bound`] is at most `tolerance`, in field units, but
    /// for rounding to single precision.
    ///
    /// # Errors
    /// [`CellError::TableTooLarge`] if that takes more than 256 samples per axis.
    pub fn with_tolerance(cell: &Cell, tolerance: f64) -> Result<Self, CellError> {
        let form = function(cell);
        let spectra = spectra(&form)?;
        // Samples per axis beyond the least that holds every wave.
        let mut excess = 1.0f64;
        loop {
            let wanted = |index: i32| {
                let least = (2 * index as usize + 1).max(SMALLEST);
                (least as f64 * excess).ceil() as usize
            };
            let grids: Vec<Grid> = spectra.iter().map(|s| s.grid(wanted)).collect();
            let mut number = 0;
            let [error, ..] = form.error_by(&mut |_| {
                let (value, slope) = spectra[number].error_bounds(&grids[number]);
                number += 1;
                [value, slope, 0.0]
            });
            let largest = grids.iter().flat_map(|g| g.samples).max().unwrap_or(0);
            if largest > LIMIT {
                let index = spectra.iter().map(Spectrum::greatest).max().unwrap_or(0);
                return Err(CellError::TableTooLarge {
                    index,
                    limit: LIMIT,
                });
            }
            if error <= tolerance {
                let leaves = spectra.into_iter().zip(grids).collect();
                return Ok(Self::build(cell, form, leaves));
            }
            // The next larger size of the smallest grid.
            let smallest = grids.iter().flat_map(|g| g.samples).filter(|n| *n > 1);
            let smallest = smallest.min().unwrap_or(SMALLEST);
            excess *= good_size(smallest + 1) as f64 / smallest as f64;
        }
    }

    /// The smallest table that displaces the surface by at most so much, in reference lengths, as measured
    /// at points of the element and of the surface: see [`Table::displacement`]. Waves that such a table is
    /// too coarse for are left out. 0 asks for as much as single precision holds. At most 160 samples per
    /// axis, whatever is asked.
    ///
    /// # Errors
    /// As [`Table::new`].
    pub fn for_displacement(cell: &Cell, most: f64) -> Result<Self, CellError> {
        let form = function(cell);
        let spectra = spectra(&form)?;
        // How many times over errors of the series count in the form.
        let [gain, ..] = form.error_by(&mut |_| [1.0, 0.0, 0.0]);
        let mut rms = most * cell.gamma() / gain;
        let mut probe = None;
        let mut grids: Vec<Grid> = Vec::new();
        let mut best = None;
        loop {
            let finer = spectra.iter().map(|s| s.clone().resolved(rms));
            let leaves = match finer.collect::<Result<Vec<_>, CellError>>() {
                Ok(leaves) => leaves,
                // What there is does not keep to the tolerance, but it is a table.
                Err(error) => return best.ok_or(error),
            };
            let last = std::mem::replace(&mut grids, leaves.iter().map(|l| l.1).collect());
            let mut table = Self::build(cell, form.clone(), leaves);
            table.prefer_products();
            let probe = probe.get_or_insert_with(|| Probe::new(cell, &table));
            let found = probe.displacement(&table);
            table.displacement = Some(found);
            if found <= most || last == grids {
                return Ok(table);
            }
            let error_rms = table.error_rms;
            best = Some(table);
            // Where waves meet, and where the slope is small, the displacement is several times the root
            // mean square over the mean slope. The next size may do; it need not be the one after.
            rms = error_rms / gain * (most / found).sqrt();
        }
    }

    /// The function without kinks that the table holds, if it is one series.
    pub fn smooth(&self) -> Option<Smooth> {
        let Function::Plain(leaf) = &self.function else {
            return None;
        };
        Some(Smooth {
            frequency: leaf.greatest_frequency()?,
            fold: self.solid.fold(self.half),
        })
    }

    /// Values of that function at points, into `out` of the same length; those of the solid field where there is
    /// no fold.
    pub fn smooth_values(&self, points: &[CellPoint<3>], out: &mut [f32]) {
        match &self.function {
            Function::Plain(leaf) if self.solid.is_symmetric() => leaf.spline.values(points, out),
            _ => self.values(points, out),
        }
    }
}

impl Spectrum {
    /// The smallest grid for such a root mean square of the error, and the spectrum without the waves that
    /// it is too coarse for.
    fn resolved(mut self, rms: f64) -> Result<(Self, Grid), CellError> {
        if self.sampled.is_some() {
            let grid = self.grid(super::wanted);
            self.check(&grid)?;
            return Ok((self, grid));
        }
        let whole: f64 = self.terms.iter().map(|t| square_of(t.1)).sum();
        let square = (rms * rms).max(ROUNDING * ROUNDING * whole);
        let axes = if self.planar { 2 } else { 3 };
        let longest = self.periods[..axes].iter().copied().fold(0.0, f64::max);
        let of = |samples: usize| {
            let density = aligned(samples) as f64 / longest;
            let wanted = |axis: usize| (density * self.periods[axis]).ceil() as usize;
            self.grid_by(|axis| aligned(wanted(axis).min(LARGEST)))
        };
        let mut grid = of(SMALLEST);
        loop {
            let most = grid.greatest_frequency();
            if self.error_square(&grid, most) <= square {
                self.leave_out(most);
                return Ok((self, grid));
            }
            let samples = grid.samples.into_iter().max().unwrap_or(1);
            if samples >= LARGEST {
                self.check(&grid)?;
                return Ok((self, grid));
            }
            grid = of(samples + 1);
        }
    }

    /// Mean square of the error on a grid, with what was left out, if waves of the frequency |f| = `most`
    /// and more are left out, too. Of a function without periods 0.
    pub(super) fn error_square(&self, grid: &Grid, most: f64) -> f64 {
        let tables: [Vec<(f64, f64)>; 3] = std::array::from_fn(|a| {
            let n = grid.samples[a] as f64;
            let indices = 0..=self.greatest[a];
            indices.map(|h| interpolated(f64::from(h), n)).collect()
        });
        let mut square = self.dropped.square;
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

    /// Leaves out waves of the frequency |f| = `most` and more.
    fn leave_out(&mut self, most: f64) {
        let terms = std::mem::take(&mut self.terms);
        self.greatest = [0; 3];
        for (h, c) in terms {
            let f = self.frequency(h);
            if f < most {
                for (greatest, h) in self.greatest.iter_mut().zip(h) {
                    *greatest = (*greatest).max(h.abs());
                }
                self.terms.push((h, c));
                continue;
            }
            let size = square_of(c).sqrt();
            self.dropped.count += 1;
            self.dropped.square += size * size;
            self.dropped.value += size;
            self.dropped.slope += TAU * f * size;
        }
    }

    /// |f| of the shortest wave; `None` of a function that is no sum of waves.
    pub(super) fn greatest_frequency(&self) -> Option<f64> {
        let all = self.terms.iter().map(|t| self.frequency(t.0));
        let greatest = all.fold(0.0, f64::max);
        self.sampled.is_none().then_some(greatest)
    }

    /// |f| of an index, cycles per unit of reference length.
    fn frequency(&self, h: [i32; 3]) -> f64 {
        let square = |a: usize| (f64::from(h[a]) / self.periods[a]).powi(2);
        (square(0) + square(1) + square(2)).sqrt()
    }
}

impl Grid {
    /// A frequency |f| below which indices are below half the samples along every axis. A hair less
    /// than the greatest, so that waves of one orbit, whose |f| differ by rounding, lie on one side.
    fn greatest_frequency(&self) -> f64 {
        let along = |a: usize| 0.5 * self.samples[a] as f64 / self.periods[a];
        let axes = (0..3).filter(|&a| self.samples[a] > 1);
        axes.map(along).fold(f64::INFINITY, f64::min) * (1.0 - 1e-9)
    }
}

/// The least multiple of [`MULTIPLE`] from `samples` on whose only prime factors are 2, 3 and 5.
fn aligned(samples: usize) -> usize {
    // Good sizes are even by themselves.
    let unit = MULTIPLE / 2;
    unit * good_size(samples.div_ceil(unit))
}

fn square_of([re, im]: [f64; 2]) -> f64 {
    re * re + im * im
}

/// Of the wave h on N samples: what its interpolant keeps of it, and the sum of the squares of that and of
/// its aliases.
fn interpolated(h: f64, n: f64) -> (f64, f64) {
    let own = kept(h, n);
    let mut sum = 1.0;
    for m in 1..=ALIASES {
        for m in [f64::from(m), -f64::from(m)] {
            sum += (h / (h + m * n)).powi(8);
        }
    }
    (own, own * own * sum)
}
