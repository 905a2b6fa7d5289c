//! One series of a table: its spline, its bounds, and the turns that make it symmetric.

use super::build::Spectrum;
use super::gradient_bound::{Slopes, Zero, steepest_over};
use super::grid::Grid;
use super::pyramid::Pyramid;
use super::spline::{PLACING, Spline};
use crate::field::Interval;
use crate::frame::{CellBox, CellPoint, Element, Mat3, Vec3};

/// Single precision: what rounded sums add to an interval, relative to the largest coefficient. Rounded
/// places add to it by the slope.
const ROUNDING: f64 = 3e-6;
/// The same of a gradient, relative to the largest coefficient over the distance of samples; places, by
/// twice the slope over the same, the greatest curvature of such a spline.
const SLOPE_ROUNDING: f64 = 1e-5;

/// A series as a spline. Where operators of its group do not keep the grid (those of order 3 about z,
/// on a grid along x and y), the value is the mean over the turned points.
pub(super) struct Leaf {
    pub spline: Spline,
    pyramid: Pyramid,
    /// Bounds of the gradient's length over the element.
    slopes: Slopes,
    /// What single precision adds to an interval and to a gradient.
    rounding: [f64; 2],
    turns: Vec<Mat3>,
    planar: bool,
    /// |f| of the shortest wave; `None` if it is no sum of waves.
    frequency: Option<f64>,
    error: (f64, f64),
}

impl Leaf {
    /// The leaf on a grid that holds its waves, for an element; `whole_group` if the cell is the same
    /// in all its numberings. The surface is where values are those of `zero`.
    pub fn new(
        spectrum: Spectrum,
        grid: Grid,
        (element, whole_group): (Element, bool),
        zero: Zero,
    ) -> Self {
        let coefficients = spectrum.coefficients(&grid);
        let pyramid = Pyramid::new(&coefficients, &grid);
        let all = (&*coefficients, pyramid.largest());
        let steepest = steepest_over(all, &grid, (element, whole_group), zero);
        let scale = grid.per_unit().into_iter().fold(0.0, f64::max);
        let largest = f64::from(pyramid.largest());
        let slope = f64::from(pyramid.query([0; 3], grid.samples).steepest);
        let placing = PLACING * grid.periods.into_iter().fold(0.0, f64::max);
        let slope_rounding = (SLOPE_ROUNDING * largest + 2.0 * placing * slope) * scale;
        let rounding = ROUNDING * largest + placing * slope;
        Self {
            slopes: steepest.of_another(rounding, 1e-6 * slope + slope_rounding),
            rounding: [rounding, slope_rounding],
            pyramid,
            spline: Spline::new(&coefficients, grid, spectrum.fold),
            error: spectrum.error_bounds(&grid),
            frequency: spectrum.greatest_frequency(),
            turns: spectrum.turns,
            planar: spectrum.planar,
        }
    }

    /// Whether the spline alone is the leaf.
    pub fn is_plain(&self) -> bool {
        self.turns.len() == 1 && !self.planar
    }

    pub fn bytes(&self) -> usize {
        self.spline.bytes() + self.pyramid.bytes()
    }

    /// Single precision's part of the error of a value.
    pub fn rounding(&self) -> f64 {
        self.rounding[0]
    }

    /// The same of a component of the gradient.
    pub fn slope_rounding(&self) -> f64 {
        self.rounding[1]
    }

    /// Bounds of the errors of a value and of a gradient's component, and of the gradient.
    pub fn errors(&self) -> [f64; 3] {
        let everywhere = self.pyramid.query([0; 3], self.spline.grid().samples);
        [
            self.error.0 + self.rounding(),
            self.error.1 + self.slope_rounding(),
            f64::from(everywhere.steepest) * (1.0 + 1e-6) + self.slope_rounding(),
        ]
    }

    pub fn value(&self, p: Vec3) -> f64 {
        if self.turns.len() == 1 {
            return f64::from(self.spline.value(CellPoint(p)));
        }
        let sum: f64 = self
            .turns
            .iter()
            .map(|q| f64::from(self.spline.value(CellPoint(q * p))))
            .sum();
        sum / self.turns.len() as f64
    }

    pub fn slope(&self, p: Vec3) -> (f64, Vec3) {
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        for q in &self.turns {
            let (v, g) = self.spline.value_and_gradient(CellPoint(q * p));
            value += f64::from(v);
            gradient += q.tr_mul(&Vec3::from(g.map(f64::from)));
        }
        if self.planar {
            gradient.z = 0.0;
        }
        let n = self.turns.len() as f64;
        (value / n, gradient / n)
    }

    /// Interval of the values and bound of the gradient's length over a box.
    pub fn range(&self, region: &CellBox<3>) -> (Interval, f64) {
        let (centre, half) = (
            (region.min + region.max) / 2.0,
            (region.max - region.min) / 2.0,
        );
        let (mut lo, mut hi, mut steepest) = (0.0, 0.0, 0.0);
        for (n, q) in self.turns.iter().enumerate() {
            let turned = if n == 0 {
                *region
            } else {
                let (c, h) = (q * centre, q.abs() * half);
                CellBox {
                    min: c - h,
                    max: c + h,
                }
            };
            let (from, count) = self.spline_cells(&turned);
            let range = self.pyramid.query(from, count);
            lo += f64::from(range.least);
            hi += f64::from(range.greatest);
            steepest += f64::from(range.steepest);
        }
        let n = self.turns.len() as f64;
        (
            Interval::new(lo / n - self.rounding(), hi / n + self.rounding()),
            steepest / n * (1.0 + 1e-6) + self.slope_rounding(),
        )
    }

    /// First spline cell and number of spline cells per axis that a box meets; at most one period.
    fn spline_cells(&self, region: &CellBox<3>) -> ([usize; 3], [usize; 3]) {
        let grid = self.spline.grid();
        let scale = grid.per_unit();
        let (mut from, mut count) = ([0; 3], [0; 3]);
        for a in 0..3 {
            let n = grid.samples[a] as i64;
            // A hair wider, so that a point that rounds into the next cell is still covered.
            let lo = (region.min[a] * scale[a] - 1e-6).floor();
            let hi = (region.max[a] * scale[a] + 1e-6).floor();
            if hi - lo >= n as f64 - 1.0 || !(hi - lo).is_finite() {
                count[a] = n as usize;
            } else {
                from[a] = (lo as i64).rem_euclid(n) as usize;
                count[a] = (hi - lo) as usize + 1;
            }
        }
        (from, count)
    }

    /// Bounds of the gradient's length over the element.
    pub fn slopes(&self) -> &Slopes {
        &self.slopes
    }

    /// Of its shortest wave, cycles per unit of reference length; `None` if it is no sum of waves.
    pub fn greatest_frequency(&self) -> Option<f64> {
        self.frequency
    }

    /// Samples along the axis that has most.
    pub fn samples(&self) -> usize {
        self.spline.grid().samples.into_iter().max().unwrap_or(1)
    }
}
