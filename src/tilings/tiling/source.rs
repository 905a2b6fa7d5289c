//! The field in the elements of a tiling: one cell, or a filling of several.
//!
//! [`CellField`] is one field of the cell frame, [`Filling`] one such field for each element. Values are the field's
//! own, negative inside; gradients are by reference coordinates. Bounds hold over the element only, although the fields
//! are defined beyond it.

use super::{TilingError, interface};
use crate::scaffold::Scaffold;
use druse_cells::cell::{Cell, Products, SmoothFunction, Table};
use druse_geometry::field::{Field, Interval};
use druse_geometry::frame::{CellBox, CellPoint, Element, Vec3};

/// A field of the cell frame that can fill a scaffold: smooth, defined beyond its element too (as a periodic
/// series is), with bounds of its gradient.
pub trait CellField: Field<Point = CellPoint<3>> {
    /// The element that it fills.
    fn element(&self) -> Element;
    /// Whether the cell is the same whatever the numbering of an element's nodes.
    fn fits_any_numbering(&self) -> bool {
        true
    }
    /// Bound of the gradient's length over the element, per unit of reference length.
    fn gradient_sup(&self) -> f64;
    /// A bound L of the gradient's length over the points of the element where |value| <= L `reach`. It does not
    /// decrease with `reach`.
    fn gradient_sup_near(&self, _reach: f64) -> f64 {
        self.gradient_sup()
    }
    /// gamma: root mean square of the gradient on the surface inside the element.
    fn gradient_rms(&self) -> f64;
    /// The function as a short sum of products of sines and cosines, if it is one.
    fn products(&self) -> Option<&Products> {
        None
    }
    /// The smooth function that the field is made of, if there is one of known frequency. (A sheet is made of
    /// the function whose zeros it surrounds.)
    fn smooth(&self) -> Option<SmoothFunction> {
        None
    }
    /// Values of the smooth function at points, into `out` of the same length.
    fn smooth_values(&self, points: &[CellPoint<3>], out: &mut [f64]) {
        self.values(points, out);
    }
    /// Values at points, into `out` of the same length.
    fn values(&self, points: &[CellPoint<3>], out: &mut [f64]) {
        for (v, &p) in out.iter_mut().zip(points) {
            *v = Field::value(self, p);
        }
    }
    /// Values and gradients at points, into `out` of the same length.
    fn values_and_gradients(&self, points: &[CellPoint<3>], out: &mut [(f64, Vec3)]) {
        for (s, &p) in out.iter_mut().zip(points) {
            *s = Field::value_and_gradient(self, p);
        }
    }
    /// Values and derivatives by x, y and z in single precision, into `out` of the same length.
    fn values_and_gradients_f32(&self, points: &[CellPoint<3>], out: &mut [[f32; 4]]) {
        for (s, &p) in out.iter_mut().zip(points) {
            *s = single(Field::value_and_gradient(self, p));
        }
    }
}

/// Value and gradient in single precision.
pub(super) fn single((value, slope): (f64, Vec3)) -> [f32; 4] {
    [value, slope.x, slope.y, slope.z].map(|v| v as f32)
}

/// Points per call to a table.
const CHUNK: usize = 16;

/// Evaluates `f32` values in chunks of points, into `out`.
#[inline]
fn in_chunks(
    points: &[CellPoint<3>],
    out: &mut [f64],
    evaluate: impl Fn(&[CellPoint<3>], &mut [f32]),
) {
    let mut found = [0.0; CHUNK];
    for (points, out) in points.chunks(CHUNK).zip(out.chunks_mut(CHUNK)) {
        let found = &mut found[..points.len()];
        evaluate(points, found);
        for (v, &f) in out.iter_mut().zip(&*found) {
            *v = f64::from(f);
        }
    }
}

impl CellField for Table {
    fn element(&self) -> Element {
        Self::element(self)
    }
    fn fits_any_numbering(&self) -> bool {
        Self::fits_any_numbering(self)
    }
    fn gradient_sup(&self) -> f64 {
        Self::gradient_sup(self)
    }
    fn gradient_sup_near(&self, reach: f64) -> f64 {
        Self::gradient_sup_near(self, reach)
    }
    fn gradient_rms(&self) -> f64 {
        Self::gradient_rms(self)
    }
    fn products(&self) -> Option<&Products> {
        Self::products(self)
    }
    fn smooth(&self) -> Option<SmoothFunction> {
        Self::smooth(self)
    }
    fn smooth_values(&self, points: &[CellPoint<3>], out: &mut [f64]) {
        in_chunks(points, out, |points, out| {
            Self::smooth_values(self, points, out);
        });
    }
    fn values(&self, points: &[CellPoint<3>], out: &mut [f64]) {
        in_chunks(points, out, |points, out| Self::values(self, points, out));
    }
    fn values_and_gradients(&self, points: &[CellPoint<3>], out: &mut [(f64, Vec3)]) {
        let mut found = [[0.0; 4]; CHUNK];
        for (points, out) in points.chunks(CHUNK).zip(out.chunks_mut(CHUNK)) {
            let found = &mut found[..points.len()];
            self.values_and_gradients(points, found);
            for (s, f) in out.iter_mut().zip(&*found) {
                let [v, x, y, z] = f.map(f64::from);
                *s = (v, Vec3::new(x, y, z));
            }
        }
    }
    fn values_and_gradients_f32(&self, points: &[CellPoint<3>], out: &mut [[f32; 4]]) {
        self.values_and_gradients(points, out);
    }
}

/// Exact evaluation, for verification: slow, with a gradient bound from the series.
impl CellField for Cell {
    fn element(&self) -> Element {
        Self::element(self)
    }
    fn fits_any_numbering(&self) -> bool {
        Self::fits_any_numbering(self)
    }
    fn gradient_sup(&self) -> f64 {
        // By Bernstein's inequality |grad| <= 2 pi R sup |Phi| for a function of band limit R.
        let range = Field::bound(self, &Self::element(self).cell_box());
        let sup = range.hi.max(-range.lo);
        std::f64::consts::TAU * self.expression().band_limit() * sup
    }
    fn gradient_rms(&self) -> f64 {
        self.gamma()
    }
}

/// Whether a cell of one element fills elements of a shape: its own; cells of planar elements fill
/// the prisms over them, the same at every height.
pub fn fills(cell: Element, shape: Element) -> bool {
    cell == shape
        || matches!(
            (cell, shape),
            (Element::Tri, Element::Wedge) | (Element::Quad, Element::Hex)
        )
}

/// A function of the element and the reference point, that fills a scaffold.
pub trait Filling: Send + Sync {
    /// Checks that every element of the scaffold has a cell, and that both sides of every shared face agree.
    ///
    /// # Errors
    /// [`TilingError`] of the first element or face that does not, and of a cell without slope or blends' weights.
    fn check(&self, scaffold: &Scaffold) -> Result<(), TilingError>;

    /// Value (negative inside) and gradient by reference coordinates. Defined beyond the element too.
    fn value_and_gradient(&self, element: usize, xi: CellPoint<3>) -> (f64, Vec3);

    /// The value alone.
    fn value(&self, element: usize, xi: CellPoint<3>) -> f64 {
        self.value_and_gradient(element, xi).0
    }

    /// Values at points of one element, into `out` of the same length.
    fn values(&self, element: usize, points: &[CellPoint<3>], out: &mut [f64]) {
        for (v, &p) in out.iter_mut().zip(points) {
            *v = self.value(element, p);
        }
    }

    /// Values and derivatives by reference coordinates in single precision, into `out` of the same length.
    fn values_and_gradients_f32(
        &self,
        element: usize,
        points: &[CellPoint<3>],
        out: &mut [[f32; 4]],
    ) {
        for (s, &p) in out.iter_mut().zip(points) {
            *s = single(self.value_and_gradient(element, p));
        }
    }

    /// Contains every value over a box within the reference cell.
    fn bound(&self, element: usize, region: &CellBox<3>) -> Interval;

    /// Bound of the gradient's length over an element, per unit of reference length.
    fn gradient_sup(&self, element: usize) -> f64;

    /// A bound L of the gradient's length over the points of an element where |value| <= L `reach`, in reference
    /// lengths. It holds over the whole element, or it is one bound for all elements that does not decrease with
    /// `reach`: where elements differ in size only, the bound of the steepest one then holds for all.
    fn gradient_sup_near(&self, element: usize, _reach: f64) -> f64 {
        self.gradient_sup(element)
    }

    /// Root mean square of the gradient on the surface in an element.
    fn gradient_rms(&self, element: usize) -> f64;

    /// The smooth function that the field is made of in an element, if there is one of known frequency.
    fn smooth(&self, _element: usize) -> Option<SmoothFunction> {
        None
    }

    /// Values of the smooth function at points of one element, into `out` of the same length.
    fn smooth_values(&self, element: usize, points: &[CellPoint<3>], out: &mut [f64]) {
        self.values(element, points, out);
    }

    /// The function as a short sum of products of sines and cosines, if it is the same in all elements.
    fn products(&self) -> Option<&Products> {
        None
    }
}

/// One cell in every element.
impl<C: CellField> Filling for C {
    fn check(&self, scaffold: &Scaffold) -> Result<(), TilingError> {
        let (sup, rms) = (self.gradient_sup(), self.gradient_rms());
        if !(sup.is_finite() && rms.is_finite() && sup > 0.0 && rms > 0.0) {
            return Err(TilingError::Slope { rms, sup });
        }
        for number in 0..scaffold.len() {
            let found = scaffold.element(number).shape();
            if !fills(self.element(), found) {
                return Err(TilingError::Shape {
                    cell: self.element().name(),
                    number: scaffold.number(number),
                    found: found.name(),
                });
            }
        }
        // All faces of a tet or of a hex are equivalent; those of wedges and pyramids are not.
        let alike = matches!(self.element(), Element::Tet | Element::Hex);
        if alike && self.fits_any_numbering() {
            return Ok(());
        }
        let value = |_: Element, xi| Field::value(self, xi);
        interface::check(scaffold, &value, rms)
    }

    fn value_and_gradient(&self, _: usize, xi: CellPoint<3>) -> (f64, Vec3) {
        Field::value_and_gradient(self, xi)
    }

    fn value(&self, _: usize, xi: CellPoint<3>) -> f64 {
        Field::value(self, xi)
    }

    fn values(&self, _: usize, points: &[CellPoint<3>], out: &mut [f64]) {
        CellField::values(self, points, out);
    }

    fn values_and_gradients_f32(&self, _: usize, points: &[CellPoint<3>], out: &mut [[f32; 4]]) {
        CellField::values_and_gradients_f32(self, points, out);
    }

    fn bound(&self, _: usize, region: &CellBox<3>) -> Interval {
        Field::bound(self, region)
    }

    fn gradient_sup(&self, _: usize) -> f64 {
        CellField::gradient_sup(self)
    }

    fn gradient_sup_near(&self, _: usize, reach: f64) -> f64 {
        CellField::gradient_sup_near(self, reach)
    }

    fn gradient_rms(&self, _: usize) -> f64 {
        CellField::gradient_rms(self)
    }

    fn smooth(&self, _: usize) -> Option<SmoothFunction> {
        CellField::smooth(self)
    }

    fn smooth_values(&self, _: usize, points: &[CellPoint<3>], out: &mut [f64]) {
        CellField::smooth_values(self, points, out);
    }

    fn products(&self) -> Option<&Products> {
        CellField::products(self)
    }
}

/// A filling, borrowed or owned by the tiling.
pub(super) enum FillingRef<'a> {
    Borrowed(&'a dyn Filling),
    Owned(Box<dyn Filling + 'a>),
}

impl<'a> std::ops::Deref for FillingRef<'a> {
    type Target = dyn Filling + 'a;
    fn deref(&self) -> &Self::Target {
        match self {
            Self::Borrowed(f) => *f,
            Self::Owned(f) => &**f,
        }
    }
}
