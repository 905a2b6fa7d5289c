//! What a tiling asks of a unit cell.

use crate::cell::Table;
use crate::field::Field;
use crate::frame::{CellPoint, Element, Mat3};

/// A field of the cell frame that can fill a scaffold: smooth, defined beyond its element too (a
/// periodic series is), with known slopes.
pub trait CellField: Field<Point = CellPoint<3>> {
    /// The element it fills.
    fn element(&self) -> Element;
    /// Whether the cell is the same whatever the numbering of an element's nodes.
    fn fits_any_numbering(&self) -> bool {
        true
    }
    /// The cell's own symmetries, the identity among them; asked where it lacks some of its element's.
    fn operators(&self) -> &[Mat3] {
        &[]
    }
    /// Bound of the gradient's length over the element, per unit of reference length.
    fn gradient_sup(&self) -> f64;
    /// The gradient's root mean square on the surface inside the element (gamma).
    fn gradient_rms(&self) -> f64;
}

impl CellField for Table {
    fn element(&self) -> Element {
        Self::element(self)
    }
    fn fits_any_numbering(&self) -> bool {
        Self::fits_any_numbering(self)
    }
    fn operators(&self) -> &[Mat3] {
        Self::operators(self)
    }
    fn gradient_sup(&self) -> f64 {
        Self::gradient_sup(self)
    }
    fn gradient_rms(&self) -> f64 {
        Self::gradient_rms(self)
    }
}
