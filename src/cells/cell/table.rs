//! Fast evaluation of a cell: a periodic tricubic B-spline per series, in single precision.
//!
//! A spline interpolates its series at the grid points. Its coefficients are exact: the spectrum of the
//! series divided by that of the sampled B-spline, prod (2 + cos(2 pi h / N)) / 3 over the axes, and one
//! inverse transform. The grid lies along the Cartesian axes with the series' period along each: (1, 1, 1)
//! for the cubic lattice, 2 for `fcc2`, (1, 1, sqrt 2) for `fcc1`, (1, sqrt 3, 1) for the hexagonal ones.
//! Operators that permute or reverse axes map the grid onto itself, so that the interpolant has the
//! symmetry of the series and cells stay continuous across faces up to rounding. For other operators
//! (order 3 about z) the mean over the rotated points restores the symmetry.
//!
//! A table stores the part of a period from which mirrors, twofold axes and centring generate the rest: an eighth in a
//! hex, a sixteenth in a tet. It holds Phi minus its level, or Phi itself for a sheet, whose absolute value is taken
//! after interpolation. Values err by at most [`Table::error_bound`], rounding included, as the law
//! `table_is_within_its_error_bound` checks; a value alone and one with its gradient agree within 1e-6.

use super::{Cell, CellError, Expression, Products, Solid};
use druse_geometry::field::{Field, Interval};
use druse_geometry::frame::{CellBox, CellPoint, Element, Vec3};

mod build;
mod direct;
mod displacement;
mod gradient_bound;
mod grid;
mod hull;
mod resolution;
mod spline;
mod spline_series;
mod window;
mod window_ranges;
use build::Spectrum;
use gradient_bound::{GradientBounds, SurfaceValues};
use grid::Grid;
use spline::Spline;
use spline_series::SplineSeries;

/// Maximal number of samples per axis in [`Table::new`]: for each series of a hex under Oh 4.5 MiB of coefficients and
/// 12 MiB of windows of bounds.
const MAX_SAMPLES: usize = 160;
/// Minimal number of samples per axis.
const MIN_SAMPLES: usize = 32;
/// Samples per period of the shortest wave in [`Table::new`], up to [`MAX_SAMPLES`].
const SAMPLES_PER_WAVE: usize = 8;

/// The interpolated function.
enum Function {
    /// One series in space, on a grid that its group maps onto itself: the fast path.
    Single(Box<SplineSeries>),
    /// An expression and its leaves from left to right.
    Expression(Expression, Vec<SplineSeries>),
}

/// A tabulated cell. As a [`Field`] it is negative inside the solid.
///
/// A single series is evaluated from one spline, an expression from one spline per series. A cell of the
/// ball is sampled over a box; its table is for the hex that is the cube around the ball. The gradient is
/// that of the interpolant. Bounds follow from the Bernstein coefficients of the spline and hold for the
/// interpolant; [`Table::error_bound`] bounds its difference from the series.
pub struct Table {
    element: Element,
    fits_any_numbering: bool,
    solid: Solid,
    /// Half thickness of a sheet; otherwise 0, since the level is included in the coefficients.
    half_thickness: f32,
    /// Solid value = sign * interpolant, for a solid that is one side of the level.
    sign: f32,
    function: Function,
    error_bound: f64,
    gradient_error_bound: f64,
    gradient_sup: f64,
    /// Bounds near the surface, for a single series.
    gradient_bounds: Option<GradientBounds>,
    gradient_rms: f64,
    products: Option<Products>,
    /// Whether values are computed from the products; the spline then only bounds them.
    is_direct: bool,
    /// How far values and gradients of the products may exceed the bounds of the spline.
    slack: [f64; 2],
    /// Number of omitted exponentials.
    dropped: usize,
    error_rms: f64,
    displacement: Option<f64>,
}

impl std::fmt::Debug for Table {
    /// Shows sizes and bounds; the coefficients are omitted.
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
    /// The table of a cell, with at least 8 samples per shortest wave, but at most 160 samples per axis.
    /// An expression has one spline for each of its series.
    ///
    /// # Errors
    /// [`CellError::TableTooLarge`] if the band needs more than 160 samples per axis to be represented at all
    /// (more than 79 waves per period along an axis).
    pub fn new(cell: &Cell) -> Result<Self, CellError> {
        let expression = function(cell);
        let leaves = spectra(&expression)?
            .into_iter()
            .map(|s| {
                let grid = s.grid(default_samples);
                s.check(&grid)?;
                Ok((s, grid))
            })
            .collect::<Result<Vec<_>, CellError>>()?;
        Ok(Self::build(cell, expression, leaves))
    }

    /// Builds the table of a cell from the spectra of its series, each on its grid; bounds of the expression follow
    /// from those of the series.
    /// `leaves` are in the order of the expression's leaves.
    fn build(cell: &Cell, expression: Expression, leaves: Vec<(Spectrum, Grid)>) -> Self {
        let any_numbering = cell.fits_any_numbering();
        let element = cell.element();
        let dropped = leaves.iter().map(|(s, _)| s.omitted.count).sum();
        // Closures are called once per series, in the order of the leaves: an iterator gives each its own spline.
        let mut remaining = leaves.iter();
        let [error_rms, ..] = expression.error_bound_with(&mut |_| {
            let square = remaining
                .next()
                .map_or(0.0, |(s, g)| s.error_square(g, f64::INFINITY));
            [square.sqrt(), 0.0, 0.0]
        });
        // A sheet |Phi| - half and channels half - |Phi| are folded after interpolation; other solids have
        // their level in the series.
        let half_thickness = if cell.solid().is_symmetric() {
            cell.level() as f32
        } else {
            0.0
        };
        let mut leaves: Vec<SplineSeries> = leaves
            .into_iter()
            .map(|(s, g)| {
                SplineSeries::new(
                    s,
                    g,
                    element,
                    any_numbering,
                    SurfaceValues {
                        half: half_thickness,
                    },
                )
            })
            .collect();
        let mut remaining = leaves.iter();
        let [error_bound, gradient_error_bound, _] = expression.error_bound_with(&mut |_| {
            remaining
                .next()
                .map_or([f64::INFINITY; 3], SplineSeries::errors)
        });
        let mut remaining = leaves.iter();
        // The bound of the gradient from ranges and slopes of the series over the element.
        let bounding_box = element.cell_box();
        let (_, gradient_sup) = expression.bound_with(&mut |_| {
            remaining
                .next()
                .map_or((Interval::REAL_LINE, f64::INFINITY), |leaf| {
                    (
                        leaf.range(&bounding_box).0,
                        leaf.gradient_bounds().over_element(),
                    )
                })
        });
        let products = Products::of(cell, &expression);
        // One series without further nodes whose value is that of its spline at a single point needs no tree, and
        // has bounds near its surface too.
        let (function, gradient_bounds) =
            if leaves.len() == 1 && leaves[0].is_single_spline() && expression.nodes() == 1 {
                let leaf = leaves.swap_remove(0);
                let gradient_bounds = leaf.gradient_bounds().clone();
                (Function::Single(Box::new(leaf)), Some(gradient_bounds))
            } else {
                (Function::Expression(expression, leaves), None)
            };
        let table = Self {
            // A cell of the ball is tabulated over the cube around the ball.
            element: match element {
                Element::Ball => Element::Hex,
                other => other,
            },
            fits_any_numbering: any_numbering,
            solid: cell.solid(),
            half_thickness,
            sign: if cell.solid() == Solid::Above {
                -1.0
            } else {
                1.0
            },
            function,
            error_bound,
            gradient_error_bound,
            gradient_sup,
            gradient_bounds,
            gradient_rms: cell.gamma(),
            products,
            is_direct: false,
            slack: [0.0; 2],
            dropped,
            error_rms,
            displacement: None,
        };
        log::debug!(target: "druse::cell",
            "table of a cell of {}: {} samples along an axis, {} bytes, {dropped} waves left out, error at most {error_bound:.1e}",
            element.name(),
            table.samples(),
            table.bytes()
        );
        table
    }

    /// The same table, evaluated with baseline instructions only: slower, but bit-identical on every processor.
    #[must_use]
    pub fn portable(mut self) -> Self {
        let leaves = match &mut self.function {
            Function::Single(leaf) => std::slice::from_mut(&mut **leaf),
            Function::Expression(_, leaves) => leaves,
        };
        for leaf in leaves {
            leaf.spline.be_portable();
        }
        self
    }

    /// The element that the cell fills; for the ball, the hex around it.
    #[inline]
    pub fn element(&self) -> Element {
        self.element
    }

    /// Whether the cell is independent of the numbering of an element's nodes.
    #[inline]
    pub fn fits_any_numbering(&self) -> bool {
        self.fits_any_numbering
    }

    fn leaves(&self) -> &[SplineSeries] {
        match &self.function {
            Function::Single(leaf) => std::slice::from_ref(leaf),
            Function::Expression(_, leaves) => leaves,
        }
    }

    /// The largest number of samples per period over all axes and series.
    /// 0 for a table without series.
    #[inline]
    pub fn samples(&self) -> usize {
        self.leaves()
            .iter()
            .map(SplineSeries::samples)
            .max()
            .unwrap_or(0)
    }

    /// Memory of the table in bytes.
    #[inline]
    pub fn bytes(&self) -> usize {
        self.leaves().iter().map(SplineSeries::bytes).sum()
    }

    /// Number of exponentials of the cell that the table omits, see [`Table::for_displacement`].
    #[inline]
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Root mean square of table - cell over a period, in field units, without single-precision rounding. For
    /// an expression it assumes that the errors of all series coincide. It is 0 for a function without
    /// periods and for values computed from products.
    #[inline]
    pub fn error_rms(&self) -> f64 {
        self.error_rms
    }

    /// The measured displacement of the surface by the table, in reference lengths: the largest |table -
    /// cell| over the mean slope at points of the element, and over the local slope at points of the
    /// surface. `None` for tables that are not made by [`Table::for_displacement`].
    #[inline]
    pub fn displacement(&self) -> Option<f64> {
        self.displacement
    }

    /// Rigorous bound of |table - cell|, in field units, single-precision rounding included.
    #[inline]
    pub fn error_bound(&self) -> f64 {
        self.error_bound
    }

    /// Rigorous bound of the difference of each gradient component, per unit of reference length. It does not
    /// hold where the minimum or maximum of an expression switches between operands.
    #[inline]
    pub fn gradient_error_bound(&self) -> f64 {
        self.gradient_error_bound
    }

    /// The same function as a sum of products of sines and cosines, if it has few of them.
    #[inline]
    pub fn products(&self) -> Option<&Products> {
        self.products.as_ref()
    }

    /// Bound of the gradient's length over the element.
    #[inline]
    pub fn gradient_sup(&self) -> f64 {
        self.gradient_sup
    }

    /// A bound L of the gradient's length over the points of the element where |value| <= L `reach`, which
    /// include all points within `reach` of the surface. At most [`Self::gradient_sup`].
    /// `reach` is a reference length. For an expression it is the bound of the whole element.
    #[inline]
    pub fn gradient_sup_near(&self, reach: f64) -> f64 {
        let near = self.gradient_bounds.as_ref().map(|s| s.near_surface(reach));
        near.map_or(self.gradient_sup, |s| s.min(self.gradient_sup))
    }

    /// The gradient's root mean square on the surface inside the element (gamma).
    #[inline]
    pub fn gradient_rms(&self) -> f64 {
        self.gradient_rms
    }

    /// Range of the function and bound of its gradient's length over a box.
    /// Without the solid's sign and fold; it bounds the interpolant, or the products that replace it.
    fn range(&self, region: &CellBox<3>) -> (Interval, f64) {
        match &self.function {
            Function::Single(leaf) => {
                let (values, max_slope) = leaf.range(region);
                let [value, slope] = self.slack;
                let values = Interval::new(values.lo - value, values.hi + value);
                (values, max_slope + slope)
            }
            Function::Expression(expression, leaves) => {
                let mut remaining = leaves.iter();
                expression.bound_with(&mut |_| {
                    remaining
                        .next()
                        .map_or((Interval::REAL_LINE, f64::INFINITY), |leaf| {
                            leaf.range(region)
                        })
                })
            }
        }
    }

    /// Bound of the gradient's length over a box.
    #[inline]
    pub fn gradient_bound(&self, region: &CellBox<3>) -> f64 {
        self.range(region).1
    }

    /// The solid's value from the interpolant: its sign, or its fold for a sheet or channels.
    #[inline]
    fn solid_value(&self, raw: f32) -> f32 {
        match self.solid {
            Solid::Below | Solid::Above => raw * self.sign,
            Solid::Sheet => raw.abs() - self.half_thickness,
            Solid::Channels => self.half_thickness - raw.abs(),
        }
    }

    /// The products that give the values, and the spline that bounds them.
    #[inline]
    fn direct(&self) -> Option<(&Products, &Spline)> {
        match (&self.products, &self.function) {
            (Some(products), Function::Single(leaf)) if self.is_direct => {
                Some((products, &leaf.spline))
            }
            _ => None,
        }
    }

    /// The interpolant's value, before the solid's sign and fold.
    #[inline]
    fn raw(&self, p: CellPoint<3>) -> f32 {
        match &self.function {
            Function::Single(leaf) => leaf.spline.value(p),
            Function::Expression(expression, leaves) => expression_value(expression, leaves, p.0),
        }
    }

    /// Values at points, into `out` of the same length; bit-identical to [`Field::value`].
    pub fn values(&self, points: &[CellPoint<3>], out: &mut [f32]) {
        if let Some((products, spline)) = self.direct() {
            return spline.run(direct::Values(products, points, out));
        }
        match &self.function {
            Function::Single(leaf) => {
                leaf.spline.values(points, out);
                for v in out {
                    *v = self.solid_value(*v);
                }
            }
            Function::Expression(..) => {
                for (v, &p) in out.iter_mut().zip(points) {
                    *v = self.solid_value(self.raw(p));
                }
            }
        }
    }

    /// Values and gradients (value, d/dx, d/dy, d/dz) at points, into `out` of the same length;
    /// bit-identical to [`Table::sample`].
    pub fn values_and_gradients(&self, points: &[CellPoint<3>], out: &mut [[f32; 4]]) {
        if let Some((products, spline)) = self.direct() {
            return spline.run(direct::Samples(products, points, out));
        }
        match &self.function {
            Function::Single(leaf) => {
                leaf.spline.samples(points, out);
                for s in out {
                    let slope = self.solid_slope(s[0]);
                    *s = [
                        self.solid_value(s[0]),
                        s[1] * slope,
                        s[2] * slope,
                        s[3] * slope,
                    ];
                }
            }
            Function::Expression(..) => {
                for (s, &p) in out.iter_mut().zip(points) {
                    let (v, [x, y, z]) = self.sample(p);
                    *s = [v, x, y, z];
                }
            }
        }
    }

    /// Derivative of the solid's value with respect to the interpolant.
    #[inline]
    fn solid_slope(&self, raw: f32) -> f32 {
        match self.solid {
            Solid::Below | Solid::Above => self.sign,
            Solid::Sheet => 1f32.copysign(raw),
            Solid::Channels => -1f32.copysign(raw),
        }
    }

    /// Value and gradient in single precision.
    /// Gradient per unit of reference length, in the direction of growing values.
    #[inline]
    pub fn sample(&self, p: CellPoint<3>) -> (f32, [f32; 3]) {
        if self.is_direct {
            let mut out = [[0.0; 4]];
            self.values_and_gradients(&[p], &mut out);
            let [v, x, y, z] = out[0];
            return (v, [x, y, z]);
        }
        let (raw, g) = match &self.function {
            Function::Single(leaf) => leaf.spline.value_and_gradient(p),
            Function::Expression(expression, leaves) => {
                expression_gradient(expression, leaves, p.0)
            }
        };
        let slope = self.solid_slope(raw);
        (self.solid_value(raw), g.map(|c| c * slope))
    }
}

/// Samples along an axis in [`Table::new`], from the largest index.
/// From 32 to 160; `index` is the largest index of a wave along the axis.
fn default_samples(index: i32) -> usize {
    (SAMPLES_PER_WAVE * index as usize).clamp(MIN_SAMPLES, MAX_SAMPLES)
}

/// The tabulated function: Phi minus the level, or Phi for a sheet or channels.
fn function(cell: &Cell) -> Expression {
    let centre = cell.solid().centre(cell.level());
    if centre == 0.0 {
        return cell.expression().clone();
    }
    cell.expression().shifted(centre)
}

/// The spectra of the leaves of an expression, from left to right as in every other walk, or the first failure.
fn spectra(expression: &Expression) -> Result<Vec<Spectrum>, CellError> {
    let mut all = Vec::new();
    expression.value_with(&mut |leaf| {
        all.push(Spectrum::new(leaf));
        0.0
    });
    all.into_iter().collect()
}

/// The expression's value from one spline per leaf. Not inlined, to keep the fast path small. A spline is missing
/// only if the lists differ in length, which cannot occur; NaN would show it.
#[inline(never)]
fn expression_value(expression: &Expression, leaves: &[SplineSeries], p: Vec3) -> f32 {
    let mut remaining = leaves.iter();
    expression.value_with(&mut |_| remaining.next().map_or(f64::NAN, |leaf| leaf.value(p))) as f32
}

/// As [`expression_value`], with the gradient per unit of reference length.
#[inline(never)]
fn expression_gradient(
    expression: &Expression,
    leaves: &[SplineSeries],
    p: Vec3,
) -> (f32, [f32; 3]) {
    let mut remaining = leaves.iter();
    let (v, g) = expression.gradient_with(&mut |_| {
        remaining
            .next()
            .map_or((f64::NAN, Vec3::zeros()), |leaf| leaf.value_and_gradient(p))
    });
    (v as f32, g.map(|c| c as f32).into())
}

impl Field for Table {
    type Point = CellPoint<3>;

    #[inline]
    fn value(&self, p: CellPoint<3>) -> f64 {
        if self.is_direct {
            let mut out = [0.0];
            self.values(&[p], &mut out);
            return f64::from(out[0]);
        }
        f64::from(self.solid_value(self.raw(p)))
    }

    #[inline]
    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        let (v, g) = self.sample(p);
        (f64::from(v), Vec3::from(g.map(f64::from)))
    }

    fn bound(&self, region: &CellBox<3>) -> Interval {
        let (raw, _) = self.range(region);
        let half = f64::from(self.half_thickness);
        match self.solid {
            Solid::Below | Solid::Sheet | Solid::Channels => self.solid.interval(raw, half),
            Solid::Above => raw.negated(),
        }
    }
}
