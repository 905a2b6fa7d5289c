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
use pyramid::{Pyramid, scan};
use rayon::prelude::*;

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
    solid: Solid,
    /// Half thickness of a sheet; 0 otherwise, since the level is in the coefficients.
    half: f32,
    /// Solid value = sign * interpolant where the solid is one side of the level.
    sign: f32,
    period: f64,
    samples: usize,
    /// Coefficients with three repeated layers per axis, [samples + 3]^3: no index wraps inside.
    coefficients: Vec<f32>,
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
            .field("samples", &self.samples)
            .field("error_bound", &self.error_bound())
            .finish_non_exhaustive()
    }
}

/// Where a point lies: index of its spline cell's first coefficient, and its place in the cell.
struct Place {
    base: usize,
    t: [f32; 3],
}

/// Cubic B-spline weights at t in [0, 1].
fn weights(t: f32) -> [f32; 4] {
    let (t2, s) = (t * t, 1.0 - t);
    let t3 = t2 * t;
    [
        s * s * s * (1.0 / 6.0),
        0.5 * t3 - t2 + 2.0 / 3.0,
        -0.5 * t3 + 0.5 * (t2 + t) + 1.0 / 6.0,
        t3 * (1.0 / 6.0),
    ]
}

/// Derivatives of [`weights`].
fn slopes(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        -0.5 * s * s,
        1.5 * t * t - 2.0 * t,
        -1.5 * t * t + t + 0.5,
        0.5 * t * t,
    ]
}

fn dot(a: [f32; 4], b: [f32; 4]) -> f32 {
    (a[0] * b[0] + a[2] * b[2]) + (a[1] * b[1] + a[3] * b[3])
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
            solid: cell.solid(),
            half: if symmetric { cell.level() as f32 } else { 0.0 },
            sign: if cell.solid() == Solid::Above {
                -1.0
            } else {
                1.0
            },
            period,
            samples,
            coefficients,
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

    /// Samples per axis of the cubic period.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Length of the cubic period in reference units.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// Memory in use.
    pub fn bytes(&self) -> usize {
        self.coefficients.len() * size_of::<f32>() + self.pyramid.bytes()
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
        self.samples as f64 / self.period
    }

    fn rounding(&self) -> f64 {
        ROUNDING * f64::from(self.pyramid.largest())
    }

    /// First spline cell and number of spline cells per axis that a box meets; at most one period.
    fn spline_cells(&self, region: &CellBox<3>) -> ([usize; 3], [usize; 3]) {
        let (n, scale) = (self.samples as i64, self.cells_per_unit());
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
        let n = self.samples as i64;
        // The group maps the part of the element with x >= |y|, |z| onto the rest.
        let in_slab = |i: i64| {
            let mut steepest = 0f32;
            for j in (-i - 2).max(-half)..half.min(i + 2) {
                for k in (-i - 2).max(-half)..half.min(i + 2) {
                    let lo = Vec3::new(i as f64, j as f64, k as f64) / scale;
                    if self.element != Element::Tet || meets_tet(lo, 1.0 / scale) {
                        let at = [i, j, k].map(|c| c.rem_euclid(n) as usize);
                        let cell = scan(&self.coefficients, self.samples, at, 1);
                        steepest = steepest.max(cell.steepest);
                    }
                }
            }
            steepest
        };
        let steepest = (0..half)
            .into_par_iter()
            .map(in_slab)
            .reduce(|| 0.0, f32::max);
        f64::from(steepest) * scale * (1.0 + 1e-6) + self.rounding() * scale
    }

    fn place(&self, p: CellPoint<3>) -> Place {
        let n = self.samples;
        let (mut index, mut t) = ([0usize; 3], [0f32; 3]);
        for a in 0..3 {
            let v = p.0[a] / self.period;
            let w = (v - v.floor()) * n as f64;
            let cell = (w as usize).min(n - 1);
            index[a] = cell;
            t[a] = (w - cell as f64) as f32;
        }
        let s = n + 3;
        Place {
            base: (index[0] * s + index[1]) * s + index[2],
            t,
        }
    }

    /// The interpolant, before the solid's sign and absolute value.
    fn raw(&self, p: CellPoint<3>) -> f32 {
        let Place { base, t } = self.place(p);
        let s = self.samples + 3;
        let (wx, wy, wz) = (weights(t[0]), weights(t[1]), weights(t[2]));
        let mut sum = [0f32; 4];
        for (i, x) in wx.into_iter().enumerate() {
            let mut plane = [0f32; 4];
            for (j, y) in wy.into_iter().enumerate() {
                let at = base + (i * s + j) * s;
                let row = &self.coefficients[at..at + 4];
                for l in 0..4 {
                    plane[l] += y * row[l];
                }
            }
            for l in 0..4 {
                sum[l] += x * plane[l];
            }
        }
        dot(sum, wz)
    }

    /// The interpolant and its gradient, before the solid's sign and absolute value.
    fn raw_with_gradient(&self, p: CellPoint<3>) -> (f32, [f32; 3]) {
        let Place { base, t } = self.place(p);
        let s = self.samples + 3;
        let (wx, wy, wz) = (weights(t[0]), weights(t[1]), weights(t[2]));
        let (dx, dy, dz) = (slopes(t[0]), slopes(t[1]), slopes(t[2]));
        let (mut sum, mut along_x, mut along_y) = ([0f32; 4], [0f32; 4], [0f32; 4]);
        for i in 0..4 {
            let (mut plane, mut slope) = ([0f32; 4], [0f32; 4]);
            for j in 0..4 {
                let at = base + (i * s + j) * s;
                let row = &self.coefficients[at..at + 4];
                for l in 0..4 {
                    plane[l] += wy[j] * row[l];
                    slope[l] += dy[j] * row[l];
                }
            }
            for l in 0..4 {
                sum[l] += wx[i] * plane[l];
                along_x[l] += dx[i] * plane[l];
                along_y[l] += wx[i] * slope[l];
            }
        }
        let scale = self.cells_per_unit() as f32;
        (
            dot(sum, wz),
            [
                dot(along_x, wz) * scale,
                dot(along_y, wz) * scale,
                dot(sum, dz) * scale,
            ],
        )
    }

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
            *v = self.solid_value(self.raw(p));
        }
    }

    /// Value and gradient in single precision, as they are computed.
    pub fn sample(&self, p: CellPoint<3>) -> (f32, [f32; 3]) {
        let (raw, g) = self.raw_with_gradient(p);
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

    fn value(&self, p: CellPoint<3>) -> f64 {
        f64::from(self.solid_value(self.raw(p)))
    }

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
