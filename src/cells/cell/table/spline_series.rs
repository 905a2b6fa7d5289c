//! One series of a table: its spline, its bounds and the rotations that complete its symmetry.
//!
//! Values, gradients and ranges are those of the interpolant, with the rounding of single precision in the bounds.
//! [`SplineSeries::errors`] compares it with the series. Lengths are reference lengths.

use super::build::Spectrum;
use super::gradient_bound::{GradientBounds, SurfaceValues, gradient_bounds_over};
use super::grid::Grid;
use super::spline::{POSITION_ERROR, Spline};
use super::window_ranges::WindowRanges;
use druse_geometry::field::Interval;
use druse_geometry::frame::{CellBox, CellPoint, Element, Mat3, Vec3};

/// Bound of the rounding error of a value, relative to the largest coefficient. Rounding of the position
/// adds [`POSITION_ERROR`] times the slope.
const ROUNDING: f64 = 3e-6;
/// Bound of the rounding error of a gradient, relative to the largest coefficient over the sample distance.
/// Rounding of the position adds [`POSITION_ERROR`] times the largest curvature of the spline, which is twice the slope
/// over that distance.
const SLOPE_ROUNDING: f64 = 1e-5;

/// A series as a spline. If operators of its group do not map the grid onto itself (those of order 3 about
/// z on a grid along x and y), the value is the mean over the rotated points.
pub(super) struct SplineSeries {
    pub spline: Spline,
    ranges: WindowRanges,
    /// Bounds of the gradient's length over the element.
    gradient_bounds: GradientBounds,
    /// Bounds of the rounding error of a value and of a gradient component.
    rounding: [f64; 2],
    /// Operators over whose images of a point the value is the mean; the first is the identity.
    rotations: Vec<Mat3>,
    /// Whether the function does not depend on z.
    planar: bool,
    /// |f| of the shortest wave; `None` for a function that is not a sum of waves.
    frequency: Option<f64>,
    /// Bounds of the error of the spline, without rounding: of a value, and of a gradient component.
    error: (f64, f64),
}

/// The grid is not checked here.
impl SplineSeries {
    /// The spline of a series on `grid`, which must be fine enough for its waves, with bounds of the gradient over
    /// `element`. With `whole_group` the cell is independent of the numbering of the nodes. The surface is where the
    /// function has the values `surface`.
    pub fn new(
        spectrum: Spectrum,
        grid: Grid,
        element: Element,
        whole_group: bool,
        surface: SurfaceValues,
    ) -> Self {
        let coefficients = spectrum.coefficients(&grid);
        let ranges = WindowRanges::new(&coefficients, &grid);
        let gradient_bounds = gradient_bounds_over(
            &coefficients,
            ranges.largest(),
            &grid,
            element,
            whole_group,
            surface,
        );
        // The rounding of a position moves the point by `position_error`, over which the value changes by the
        // slope and the gradient by the curvature, at most twice the slope per sample distance. 1e-6 is for single
        // precision.
        let scale = grid.per_unit().into_iter().fold(0.0, f64::max);
        let largest = f64::from(ranges.largest());
        let slope = f64::from(ranges.query([0; 3], grid.samples).max_slope);
        let position_error = POSITION_ERROR * grid.periods.into_iter().fold(0.0, f64::max);
        let gradient_rounding = (SLOPE_ROUNDING * largest + 2.0 * position_error * slope) * scale;
        let rounding = ROUNDING * largest + position_error * slope;
        Self {
            gradient_bounds: gradient_bounds.widened(rounding, 1e-6 * slope + gradient_rounding),
            rounding: [rounding, gradient_rounding],
            ranges,
            spline: Spline::new(&coefficients, grid, spectrum.symmetry),
            error: spectrum.error_bounds(&grid),
            frequency: spectrum.max_frequency(),
            rotations: spectrum.coset_operators,
            planar: spectrum.planar,
        }
    }

    /// Whether the value is that of the spline at a single point.
    /// If not, values and gradients are means over rotated points, or the derivative along z is dropped.
    pub fn is_single_spline(&self) -> bool {
        self.rotations.len() == 1 && !self.planar
    }

    /// Coefficients and windows of bounds in bytes.
    pub fn bytes(&self) -> usize {
        self.spline.bytes() + self.ranges.bytes()
    }

    /// Bound of the rounding error of a value.
    pub fn rounding(&self) -> f64 {
        self.rounding[0]
    }

    /// Bound of the rounding error of a gradient component.
    pub fn gradient_rounding(&self) -> f64 {
        self.rounding[1]
    }

    /// Bounds of the error of a value, of the error of a gradient component, and of the gradient's length.
    /// The first two are against the series. The factor 1e-6 covers the rounding of a slope.
    pub fn errors(&self) -> [f64; 3] {
        let whole_period = self.ranges.query([0; 3], self.spline.grid().samples);
        [
            self.error.0 + self.rounding(),
            self.error.1 + self.gradient_rounding(),
            f64::from(whole_period.max_slope) * (1.0 + 1e-6) + self.gradient_rounding(),
        ]
    }

    /// The mean over the rotations. The level is included if the spectrum has it.
    pub fn value(&self, p: Vec3) -> f64 {
        if self.rotations.len() == 1 {
            return f64::from(self.spline.value(CellPoint(p)));
        }
        let sum: f64 = self
            .rotations
            .iter()
            .map(|q| f64::from(self.spline.value(CellPoint(q * p))))
            .sum();
        sum / self.rotations.len() as f64
    }

    /// The value and the gradient.
    /// The gradient is turned back from each rotated point. Along z it is 0 for a planar series.
    pub fn value_and_gradient(&self, p: Vec3) -> (f64, Vec3) {
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        for q in &self.rotations {
            let (v, g) = self.spline.value_and_gradient(CellPoint(q * p));
            value += f64::from(v);
            gradient += q.tr_mul(&Vec3::from(g.map(f64::from)));
        }
        if self.planar {
            gradient.z = 0.0;
        }
        let n = self.rotations.len() as f64;
        (value / n, gradient / n)
    }

    /// Interval of the values and bound of the gradient's length over a box.
    /// The factor 1e-6 covers the rounding of a slope.
    pub fn range(&self, region: &CellBox<3>) -> (Interval, f64) {
        let (centre, half) = (
            (region.min + region.max) / 2.0,
            // The value is the mean over the rotated points, so that the range is the mean of the ranges over
            // the rotated boxes. A rotated box is enclosed by one along the axes, with the half edges |Q| h.
            (region.max - region.min) / 2.0,
        );
        let (mut lo, mut hi, mut max_slope) = (0.0, 0.0, 0.0);
        for (n, q) in self.rotations.iter().enumerate() {
            let image = if n == 0 {
                *region
            } else {
                let (c, h) = (q * centre, q.abs() * half);
                CellBox {
                    min: c - h,
                    max: c + h,
                }
            };
            let (from, count) = self.spline_cells(&image);
            let range = self.ranges.query(from, count);
            lo += f64::from(range.least);
            hi += f64::from(range.greatest);
            max_slope += f64::from(range.max_slope);
        }
        let n = self.rotations.len() as f64;
        (
            Interval::new(lo / n - self.rounding(), hi / n + self.rounding()),
            max_slope / n * (1.0 + 1e-6) + self.gradient_rounding(),
        )
    }

    /// First spline cell and number of spline cells per axis that a box meets, at most one period.
    /// The counts are at least 1. An infinite or undefined box counts as the whole period.
    fn spline_cells(&self, region: &CellBox<3>) -> ([usize; 3], [usize; 3]) {
        let grid = self.spline.grid();
        let scale = grid.per_unit();
        let (mut from, mut count) = ([0; 3], [0; 3]);
        for a in 0..3 {
            let n = grid.samples[a] as i64;
            // The margin covers points that round into the next cell.
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
    pub fn gradient_bounds(&self) -> &GradientBounds {
        &self.gradient_bounds
    }

    /// |f| of the shortest wave, in cycles per unit of reference length; `None` for a function that is not
    /// a sum of waves.
    pub fn max_frequency(&self) -> Option<f64> {
        self.frequency
    }

    /// The largest number of samples along an axis.
    pub fn samples(&self) -> usize {
        self.spline.grid().samples.into_iter().max().unwrap_or(1)
    }
}
