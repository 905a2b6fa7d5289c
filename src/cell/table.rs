//! Fast evaluation of a cell: a periodic tricubic B-spline for each of its series, in single precision.
//!
//! A spline's coefficients are exact: the spectrum of the series divided by that of the sampled
//! B-spline, prod (2 + cos(2 pi h / N)) / 3 over the axes, transformed back once; the spline interpolates the
//! series at the grid points. The grid lies along the Cartesian axes, with the series' period along
//! each: (1, 1, 1) for the cubic lattice, 2 for `fcc2`, (1, 1, sqrt 2) for `fcc1`, (1, sqrt 3, 1) for the
//! hexagonal ones. Operators that exchange or turn around the axes map it to itself, so that the
//! interpolant is as symmetric as the series and cells stay continuous across faces to rounding;
//! where a group has others (order 3 about z) the mean over the turned points restores it.
//!
//! Of a period a table keeps the part from which mirrors, twofold axes and centring make the rest: an
//! eighth in a hex, a sixteenth in a tet. Points are best looked up together.
//!
//! Conventions: the table holds Phi minus its level (Phi itself for a sheet, whose absolute value is
//! taken after interpolation); as a [`Field`] it is negative inside the solid. An expression of
//! several series is evaluated from one spline each, a function of the ball from samples over a box,
//! for the element that is the cube around the ball. The gradient is that of the interpolant. Bounds
//! come from the coefficients of the spline's Bernstein form, of which it is a convex combination; so
//! bounds are rigorous for what is evaluated, not for the
//! series it approximates. [`Table::error_bound`] ties the two together.

use super::{Cell, CellError, Form, Products, Solid};
use crate::field::{Field, Interval};
use crate::frame::{CellBox, CellPoint, Element, Vec3};

mod build;
mod direct;
mod displacement;
mod gradient_bound;
mod grid;
mod hull;
mod leaf;
mod pyramid;
mod resolution;
mod spline;
mod window;
use build::Spectrum;
use gradient_bound::{Slopes, Zero};
use grid::Grid;
use leaf::Leaf;
use spline::Spline;

/// Greatest number of samples per axis that [`Table::new`] uses: 9 MiB for each series of a hex.
const LARGEST: usize = 160;
/// Least number of samples per axis.
const SMALLEST: usize = 32;
/// Samples per period of the shortest wave that [`Table::new`] asks for.
const SAMPLES_PER_WAVE: usize = 8;
/// What is interpolated.
enum Function {
    /// One series in space on a grid that its group keeps: the hot path.
    Plain(Box<Leaf>),
    /// An expression and its leaves in order.
    Tree(Form, Vec<Leaf>),
}

/// A cell as a table; see the module's head.
pub struct Table {
    element: Element,
    fits_any_numbering: bool,
    solid: Solid,
    /// Half thickness of a sheet; 0 otherwise, since the level is in the coefficients.
    half: f32,
    /// Solid value = sign * interpolant where the solid is one side of the level.
    sign: f32,
    function: Function,
    error_bound: f64,
    gradient_error_bound: f64,
    gradient_sup: f64,
    /// The same, near the surface too, if that is known.
    slopes: Option<Slopes>,
    gradient_rms: f64,
    products: Option<Products>,
    /// Whether values come from the products; the spline is for bounds then.
    is_direct: bool,
    /// How much the products' values and gradients may be beyond the spline's bounds.
    slack: [f64; 2],
    /// Exponentials that were left out.
    dropped: usize,
    error_rms: f64,
    displacement: Option<f64>,
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
    /// represented (more than 79 waves per period along an axis).
    pub fn new(cell: &Cell) -> Result<Self, CellError> {
        let form = function(cell);
        let leaves = spectra(&form)?
            .into_iter()
            .map(|s| {
                let grid = s.grid(wanted);
                s.check(&grid)?;
                Ok((s, grid))
            })
            .collect::<Result<Vec<_>, CellError>>()?;
        Ok(Self::build(cell, form, leaves))
    }

    fn build(cell: &Cell, form: Form, leaves: Vec<(Spectrum, Grid)>) -> Self {
        let whole = cell.fits_any_numbering();
        let element = cell.element();
        let dropped = leaves.iter().map(|(s, _)| s.dropped.count).sum();
        let mut each = leaves.iter();
        let [error_rms, ..] = form.error_by(&mut |_| {
            let square = each
                .next()
                .map_or(0.0, |(s, g)| s.error_square(g, f64::INFINITY));
            [square.sqrt(), 0.0, 0.0]
        });
        let half = if cell.solid().is_symmetric() {
            cell.level() as f32
        } else {
            0.0
        };
        let mut leaves: Vec<Leaf> = leaves
            .into_iter()
            .map(|(s, g)| Leaf::new(s, g, (element, whole), Zero { half }))
            .collect();
        let mut each = leaves.iter();
        let [error_bound, gradient_error_bound, _] =
            form.error_by(&mut |_| each.next().map_or([f64::INFINITY; 3], Leaf::errors));
        let mut each = leaves.iter();
        let around = element.cell_box();
        let (_, gradient_sup) = form.range_by(&mut |_| {
            each.next().map_or((Interval::ALL, f64::INFINITY), |leaf| {
                (leaf.range(&around).0, leaf.slopes().everywhere())
            })
        });
        let products = Products::of(cell, &form);
        let (function, slopes) = if leaves.len() == 1 && leaves[0].is_plain() && form.nodes() == 1 {
            let leaf = leaves.swap_remove(0);
            let slopes = leaf.slopes().clone();
            (Function::Plain(Box::new(leaf)), Some(slopes))
        } else {
            (Function::Tree(form, leaves), None)
        };
        Self {
            // What is sampled about the ball fills the cube around it.
            element: match element {
                Element::Ball => Element::Hex,
                other => other,
            },
            fits_any_numbering: whole,
            solid: cell.solid(),
            half,
            sign: if cell.solid() == Solid::Above {
                -1.0
            } else {
                1.0
            },
            function,
            error_bound,
            gradient_error_bound,
            gradient_sup,
            slopes,
            gradient_rms: cell.gamma(),
            products,
            is_direct: false,
            slack: [0.0; 2],
            dropped,
            error_rms,
            displacement: None,
        }
    }

    /// The same, computed by instructions that every processor has: the same bits on all of them.
    #[must_use]
    pub fn portable(mut self) -> Self {
        let leaves = match &mut self.function {
            Function::Plain(leaf) => std::slice::from_mut(&mut **leaf),
            Function::Tree(_, leaves) => leaves,
        };
        for leaf in leaves {
            leaf.spline.be_portable();
        }
        self
    }

    /// The element the cell fills; of a ball the cube around it.
    pub fn element(&self) -> Element {
        self.element
    }

    /// Whether the cell is the same whatever the numbering of an element's nodes.
    pub fn fits_any_numbering(&self) -> bool {
        self.fits_any_numbering
    }

    fn leaves(&self) -> &[Leaf] {
        match &self.function {
            Function::Plain(leaf) => std::slice::from_ref(leaf),
            Function::Tree(_, leaves) => leaves,
        }
    }

    /// Samples per period along the axis, and of the series, that has most.
    pub fn samples(&self) -> usize {
        self.leaves().iter().map(Leaf::samples).max().unwrap_or(0)
    }

    /// Memory in use.
    pub fn bytes(&self) -> usize {
        self.leaves().iter().map(Leaf::bytes).sum()
    }

    /// Exponentials of the cell's series that the table leaves out, see [`Table::for_displacement`].
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Root mean square of table - cell over a period, in field units, but for rounding to single
    /// precision; of an expression as if all its series erred at once, of a function without periods, and
    /// where values come from products, 0.
    pub fn error_rms(&self) -> f64 {
        self.error_rms
    }

    /// How far the table displaces the surface, in reference lengths, as measured: the greatest
    /// |table - cell| over the mean slope at points spread over the element, and over the slope there at
    /// points of the surface. Known of tables made by [`Table::for_displacement`].
    pub fn displacement(&self) -> Option<f64> {
        self.displacement
    }

    /// Rigorous bound of |table - cell| everywhere, in field units (single precision included).
    pub fn error_bound(&self) -> f64 {
        self.error_bound
    }

    /// Rigorous bound of the difference of the gradients' components, per unit of reference length,
    /// but for points where the parts of an expression change places.
    pub fn gradient_error_bound(&self) -> f64 {
        self.gradient_error_bound
    }

    /// The same function as a few products of sines and cosines, if it is one.
    pub fn products(&self) -> Option<&Products> {
        self.products.as_ref()
    }

    /// Bound of the gradient's length over the element.
    pub fn gradient_sup(&self) -> f64 {
        self.gradient_sup
    }

    /// A bound L of its length over those points of the element where |value| <= L `reach`: points within
    /// `reach` of the surface are among them. Not greater than [`Self::gradient_sup`].
    pub fn gradient_sup_near(&self, reach: f64) -> f64 {
        let near = self.slopes.as_ref().map(|s| s.within(reach));
        near.map_or(self.gradient_sup, |s| s.min(self.gradient_sup))
    }

    /// The gradient's root mean square on the surface inside the element (gamma).
    pub fn gradient_rms(&self) -> f64 {
        self.gradient_rms
    }

    /// Interval of the function and bound of its gradient over a box.
    fn range(&self, region: &CellBox<3>) -> (Interval, f64) {
        match &self.function {
            Function::Plain(leaf) => {
                let (values, steepest) = leaf.range(region);
                let [value, slope] = self.slack;
                let values = Interval::new(values.lo - value, values.hi + value);
                (values, steepest + slope)
            }
            Function::Tree(form, leaves) => {
                let mut each = leaves.iter();
                form.range_by(&mut |_| {
                    each.next()
                        .map_or((Interval::ALL, f64::INFINITY), |leaf| leaf.range(region))
                })
            }
        }
    }

    /// Bound of the gradient's length over a box.
    pub fn gradient_bound(&self, region: &CellBox<3>) -> f64 {
        self.range(region).1
    }

    #[inline]
    fn solid_value(&self, raw: f32) -> f32 {
        match self.solid {
            Solid::Below | Solid::Above => raw * self.sign,
            Solid::Sheet => raw.abs() - self.half,
            Solid::Channels => self.half - raw.abs(),
        }
    }

    /// The products that values come from, and the spline that bounds them.
    #[inline]
    fn direct(&self) -> Option<(&Products, &Spline)> {
        match (&self.products, &self.function) {
            (Some(products), Function::Plain(leaf)) if self.is_direct => {
                Some((products, &leaf.spline))
            }
            _ => None,
        }
    }

    #[inline]
    fn raw(&self, p: CellPoint<3>) -> f32 {
        match &self.function {
            Function::Plain(leaf) => leaf.spline.value(p),
            Function::Tree(form, leaves) => tree_value(form, leaves, p.0),
        }
    }

    /// Values at points, into `out` of the same length: the bits of [`Field::value`].
    pub fn values(&self, points: &[CellPoint<3>], out: &mut [f32]) {
        if let Some((products, spline)) = self.direct() {
            return spline.run(direct::Values(products, points, out));
        }
        match &self.function {
            Function::Plain(leaf) => {
                leaf.spline.values(points, out);
                for v in out {
                    *v = self.solid_value(*v);
                }
            }
            Function::Tree(..) => {
                for (v, &p) in out.iter_mut().zip(points) {
                    *v = self.solid_value(self.raw(p));
                }
            }
        }
    }

    /// Values and gradients (value, by x, by y, by z) at points, into `out` of the same length: the
    /// bits of [`Table::sample`].
    pub fn values_and_gradients(&self, points: &[CellPoint<3>], out: &mut [[f32; 4]]) {
        if let Some((products, spline)) = self.direct() {
            return spline.run(direct::Samples(products, points, out));
        }
        match &self.function {
            Function::Plain(leaf) => {
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
            Function::Tree(..) => {
                for (s, &p) in out.iter_mut().zip(points) {
                    let (v, [x, y, z]) = self.sample(p);
                    *s = [v, x, y, z];
                }
            }
        }
    }

    /// Derivative of the solid's value by the interpolant.
    #[inline]
    fn solid_slope(&self, raw: f32) -> f32 {
        match self.solid {
            Solid::Below | Solid::Above => self.sign,
            Solid::Sheet => 1f32.copysign(raw),
            Solid::Channels => -1f32.copysign(raw),
        }
    }

    /// Value and gradient in single precision, as they are computed.
    #[inline]
    pub fn sample(&self, p: CellPoint<3>) -> (f32, [f32; 3]) {
        if self.is_direct {
            let mut out = [[0.0; 4]];
            self.values_and_gradients(&[p], &mut out);
            let [v, x, y, z] = out[0];
            return (v, [x, y, z]);
        }
        let (raw, g) = match &self.function {
            Function::Plain(leaf) => leaf.spline.value_and_gradient(p),
            Function::Tree(form, leaves) => tree_slope(form, leaves, p.0),
        };
        let slope = self.solid_slope(raw);
        (self.solid_value(raw), g.map(|c| c * slope))
    }
}

/// Samples along an axis that [`Table::new`] asks for, from the greatest index.
fn wanted(index: i32) -> usize {
    (SAMPLES_PER_WAVE * index as usize).clamp(SMALLEST, LARGEST)
}

/// The function that a cell's table holds: Phi minus the level that is solid's border.
fn function(cell: &Cell) -> Form {
    let centre = cell.solid().centre(cell.level());
    if centre == 0.0 {
        return cell.form().clone();
    }
    cell.form().shifted(centre)
}

/// The spectra of a form's leaves, in order.
fn spectra(form: &Form) -> Result<Vec<Spectrum>, CellError> {
    let mut all = Vec::new();
    form.value_by(&mut |leaf| {
        all.push(Spectrum::new(leaf));
        0.0
    });
    all.into_iter().collect()
}

#[inline(never)]
fn tree_value(form: &Form, leaves: &[Leaf], p: Vec3) -> f32 {
    let mut each = leaves.iter();
    form.value_by(&mut |_| each.next().map_or(f64::NAN, |leaf| leaf.value(p))) as f32
}

#[inline(never)]
fn tree_slope(form: &Form, leaves: &[Leaf], p: Vec3) -> (f32, [f32; 3]) {
    let mut each = leaves.iter();
    let (v, g) = form.slope_by(&mut |_| {
        each.next()
            .map_or((f64::NAN, Vec3::zeros()), |leaf| leaf.slope(p))
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
        match self.solid {
            Solid::Below | Solid::Sheet | Solid::Channels => {
                self.solid.interval(raw, f64::from(self.half))
            }
            Solid::Above => raw.negated(),
        }
    }
}
