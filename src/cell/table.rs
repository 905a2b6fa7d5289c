//! Fast evaluation of a cell: a periodic tricubic B-spline on the cubic period, in single precision.
//!
//! The spline's coefficients are exact: the spectrum of the series divided by that of the sampled
//! B-spline, prod (2 + cos(2 pi h / N)) / 3 over the axes, transformed back once; the spline interpolates the
//! series at the N^3 grid points. The grid's axes are the Cartesian ones, so that every operator of
//! the element's group maps it to itself and the interpolant is as symmetric as the series: cells
//! stay continuous across faces to rounding.
//!
//! Conventions: the table holds Phi minus its level (Phi itself for a sheet, whose absolute value is
//! taken after interpolation); as a [`Field`] it is negative inside the solid. The gradient is that
//! of the interpolant. Bounds come from the coefficients: a B-spline is a convex combination of its
//! 4^3 nearest ones, a derivative one of their differences; so bounds are rigorous for what is
//! evaluated, not for the series it approximates. [`Table::error_bound`] ties the two together.

use super::{Cell, CellError, Solid};
use crate::field::{Field, Interval};
use crate::frame::{CellBox, CellPoint, Element, Vec3};

mod build;
mod pyramid;
mod spline;
use pyramid::{Pyramid, scan};
use rayon::prelude::*;
use spline::Spline;

/// Greatest number of samples per axis that [`Table::new`] uses: 17 MB.
const LARGEST: usize = 160;
/// Least number of samples per axis.
const SMALLEST: usize = 32;
/// Samples per period of the shortest wave that [`Table::new`] asks for.
const SAMPLES_PER_WAVE: usize = 8;
/// Single precision: what rounding adds to an interval, relative to the largest coefficient.
const ROUNDING: f64 = 2e-6;

/// A cell as a table; see the module's head.
pub struct Table {
    element: Element,
    fits_any_numbering: bool,
    solid: Solid,
    /// Half thickness of a sheet; 0 otherwise, since the level is in the coefficients.
    half: f32,
    /// Solid value = sign * interpolant where the solid is one side of the level.
    sign: f32,
    spline: Spline,
    pyramid: Pyramid,
    error_bound: f64,
    gradient_error_bound: f64,
    gradient_sup: f64,
    gradient_rms: f64,
}

impl std::fmt::Debug for Table {
    /// Its size and bounds; the coefficients are left out.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Table")
            .field("element", &self.element)
            .field("solid", &self.solid)
            .field("samples", &self.samples())
            .field("error_bound", &self.error_bound())
            .finish_non_exhaustive()
    }
}

impl Table {
    /// The table of a cell, with at least 8 samples per shortest wave as far as 160 samples per
    /// axis go.
    ///
    /// # Errors
    /// [`CellError::TableTooLarge`] if the band needs more than 160 samples per axis merely to be
    /// represented (more than 79 waves per cubic period).
    pub fn new(cell: &Cell) -> Result<Self, CellError> {
        let index = build::greatest_index(cell)?;
        let wanted = (SAMPLES_PER_WAVE * index as usize).clamp(SMALLEST, LARGEST);
        Self::with_samples(cell, build::good_size(wanted))
    }

    /// The smallest table whose [`Table::error_bound`] is at most `tolerance`, in field units.
    ///
    /// # Errors
    /// [`CellError::TableTooLarge`] if that takes more than 256 samples per axis.
    pub fn with_tolerance(cell: &Cell, tolerance: f64) -> Result<Self, CellError> {
        const LIMIT: usize = 256;
        let index = build::greatest_index(cell)?;
        let mut samples = build::good_size((2 * index as usize + 1).max(SMALLEST));
        while build::error_bounds(cell, samples)?.0 > tolerance {
            if samples >= LIMIT {
                return Err(CellError::TableTooLarge {
                    index,
                    limit: LIMIT,
                });
            }
            samples = build::good_size(samples + 1);
        }
        Self::with_samples(cell, samples)
    }

    /// The table with this many samples per axis of the cubic period.
    fn with_samples(cell: &Cell, samples: usize) -> Result<Self, CellError> {
        let index = build::greatest_index(cell)?;
        if samples <= 2 * index as usize {
            return Err(CellError::TableTooLarge {
                index,
                limit: samples,
            });
        }
        let (period, coefficients) = build::coefficients(cell, samples)?;
        let (error_bound, gradient_error_bound) = build::error_bounds(cell, samples)?;
        let pyramid = Pyramid::new(&coefficients, samples);
        let symmetric = cell.solid().is_symmetric();
        let mut table = Self {
            element: cell.element(),
            fits_any_numbering: cell.fits_any_numbering(),
            solid: cell.solid(),
            half: if symmetric { cell.level() as f32 } else { 0.0 },
            sign: if cell.solid() == Solid::Above {
                -1.0
            } else {
                1.0
            },
            spline: Spline::new(coefficients, samples, period),
            pyramid,
            error_bound,
            gradient_error_bound,
            gradient_sup: 0.0,
            gradient_rms: cell.gamma(),
        };
        table.gradient_sup = table.sup_over_element();
        Ok(table)
    }

    /// The element the cell fills.
    pub fn element(&self) -> Element {
        self.element
    }

    /// Whether the cell is the same whatever the numbering of an element's nodes.
    pub fn fits_any_numbering(&self) -> bool {
        self.fits_any_numbering
    }

    /// Samples per axis of the cubic period.
    pub fn samples(&self) -> usize {
        self.spline.samples()
    }

    /// Length of the cubic period in reference units.
    pub fn period(&self) -> f64 {
        self.spline.period()
    }

    /// Memory in use.
    pub fn bytes(&self) -> usize {
        size_of_val(self.spline.coefficients()) + self.pyramid.bytes()
    }

    /// Rigorous bound of |table - cell| everywhere, in field units (single precision included).
    pub fn error_bound(&self) -> f64 {
        self.error_bound + self.rounding()
    }

    /// Rigorous bound of the difference of the gradients' components, per unit of reference length.
    pub fn gradient_error_bound(&self) -> f64 {
        self.gradient_error_bound + self.rounding() * self.cells_per_unit()
    }

    /// Bound of the gradient's length over the element.
    pub fn gradient_sup(&self) -> f64 {
        self.gradient_sup
    }

    /// The gradient's root mean square on the surface inside the element (gamma).
    pub fn gradient_rms(&self) -> f64 {
        self.gradient_rms
    }

    /// Bound of the gradient's length over a box.
    pub fn gradient_bound(&self, region: &CellBox<3>) -> f64 {
        let (from, count) = self.spline_cells(region);
        let difference = f64::from(self.pyramid.query(from, count).steepest);
        difference * self.cells_per_unit() * (1.0 + 1e-6) + self.rounding() * self.cells_per_unit()
    }

    fn cells_per_unit(&self) -> f64 {
        self.spline.per_unit()
    }

    fn rounding(&self) -> f64 {
        ROUNDING * f64::from(self.pyramid.largest())
    }

    /// First spline cell and number of spline cells per axis that a box meets; at most one period.
    fn spline_cells(&self, region: &CellBox<3>) -> ([usize; 3], [usize; 3]) {
        let (n, scale) = (self.spline.samples() as i64, self.cells_per_unit());
        let (mut from, mut count) = ([0; 3], [0; 3]);
        for a in 0..3 {
            // A hair wider, so that a point that rounds into the next cell is still covered.
            let lo = (region.min[a] * scale - 1e-6).floor();
            let hi = (region.max[a] * scale + 1e-6).floor();
            if hi - lo >= n as f64 - 1.0 || !(hi - lo).is_finite() {
                count[a] = n as usize;
            } else {
                from[a] = (lo as i64).rem_euclid(n) as usize;
                count[a] = (hi - lo) as usize + 1;
            }
        }
        (from, count)
    }

    /// The largest gradient bound among the spline cells that meet the element.
    fn sup_over_element(&self) -> f64 {
        let scale = self.cells_per_unit();
        let half = (0.5 * scale).ceil() as i64;
        let n = self.spline.samples() as i64;
        // The whole group maps the part of the element with x >= |y|, |z| onto the rest.
        let reach = |i: i64| {
            if self.fits_any_numbering {
                (-i - 2).max(-half)..half.min(i + 2)
            } else {
                -half..half
            }
        };
        let first = if self.fits_any_numbering { 0 } else { -half };
        let in_slab = |i: i64| {
            let mut steepest = 0f32;
            for j in reach(i) {
                for k in reach(i) {
                    let lo = Vec3::new(i as f64, j as f64, k as f64) / scale;
                    if self.element != Element::Tet || meets_tet(lo, 1.0 / scale) {
                        let at = [i, j, k].map(|c| c.rem_euclid(n) as usize);
                        let cell = scan(self.spline.coefficients(), self.spline.samples(), at, 1);
                        steepest = steepest.max(cell.steepest);
                    }
                }
            }
            steepest
        };
        let steepest = (first..half)
            .into_par_iter()
            .map(in_slab)
            .reduce(|| 0.0, f32::max);
        f64::from(steepest) * scale * (1.0 + 1e-6) + self.rounding() * scale
    }

    #[inline]
    fn solid_value(&self, raw: f32) -> f32 {
        match self.solid {
            Solid::Below | Solid::Above => raw * self.sign,
            Solid::Sheet => raw.abs() - self.half,
            Solid::Channels => self.half - raw.abs(),
        }
    }

    /// Values at points, into `out` of the same length.
    pub fn values(&self, points: &[CellPoint<3>], out: &mut [f32]) {
        for (v, &p) in out.iter_mut().zip(points) {
            *v = self.solid_value(self.spline.value(p.0.into()));
        }
    }

    /// Value and gradient in single precision, as they are computed.
    #[inline]
    pub fn sample(&self, p: CellPoint<3>) -> (f32, [f32; 3]) {
        let (raw, g) = self.spline.value_and_gradient(p.0.into());
        let slope = match self.solid {
            Solid::Below | Solid::Above => self.sign,
            Solid::Sheet => 1f32.copysign(raw),
            Solid::Channels => -1f32.copysign(raw),
        };
        (self.solid_value(raw), g.map(|c| c * slope))
    }
}

/// Whether the cube of edge `h` at `lo` meets the reference tetrahedron.
fn meets_tet(lo: Vec3, h: f64) -> bool {
    [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]]
        .iter()
        .all(|n| {
            let least: f64 = (0..3)
                .map(|a| n[a] * if n[a] > 0.0 { lo[a] } else { lo[a] + h })
                .sum();
            least <= 0.5 + 1e-9
        })
}

impl Field for Table {
    type Point = CellPoint<3>;

    #[inline]
    fn value(&self, p: CellPoint<3>) -> f64 {
        f64::from(self.solid_value(self.spline.value(p.0.into())))
    }

    #[inline]
    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        let (v, g) = self.sample(p);
        (f64::from(v), Vec3::from(g.map(f64::from)))
    }

    fn bound(&self, region: &CellBox<3>) -> Interval {
        let (from, count) = self.spline_cells(region);
        let range = self.pyramid.query(from, count);
        let raw = Interval::new(
            f64::from(range.least) - self.rounding(),
            f64::from(range.greatest) + self.rounding(),
        );
        match self.solid {
            Solid::Below | Solid::Sheet | Solid::Channels => {
                self.solid.interval(raw, f64::from(self.half))
            }
            Solid::Above => Interval::new(-raw.hi, -raw.lo),
        }
    }
}
