//! A cell in several turns inside the elements at faces over which no turn of theirs continues.
//!
//! `Phi_e(xi) = sum over turns k of w_k(xi) Phi(Q_k xi)`, with weights that are interpolated between the corners of
//! the element and sum to one. [`super::orient()`] chooses them so that `Phi_e` is continuous over all faces.

use super::Interpolation;
use super::corners::CornerFunctions;
use druse_geometry::field::Interval;
use druse_geometry::frame::{CellBox, CellPoint, Element, Mat3, Vec3};
use std::collections::BTreeMap;

/// Bound of the slope of interpolated corner values over their range, by the reference length.
const CORNER_SLOPE: f64 = 2.5;

/// A cell in one turn, with its weight at the corners of an element.
#[derive(Clone, Debug, PartialEq)]
pub struct MixedTurn {
    /// Q: the element shows at xi what the cell is at Q xi.
    pub matrix: Mat3,
    /// Weights at the corners, in VTK order; zeros after the last corner.
    pub weights: [f64; 8],
}

/// The elements that hold a cell in several turns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mixture {
    elements: BTreeMap<u32, Vec<MixedTurn>>,
}

impl Mixture {
    /// From the turns of elements; the weights of an element sum to one at each of its corners.
    pub(super) fn new(elements: BTreeMap<u32, Vec<MixedTurn>>) -> Self {
        Self { elements }
    }

    /// Number of elements that hold several turns.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// Whether no element does.
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// The turns in an element; empty where the cell lies as the element is numbered.
    pub(super) fn turns(&self, element: usize) -> &[MixedTurn] {
        let found = self.elements.get(&(element as u32));
        found.map_or(&[], Vec::as_slice)
    }
}

impl MixedTurn {
    /// w(xi) and its gradient.
    pub fn weight(&self, shape: Element, xi: CellPoint<3>) -> (f64, Vec3) {
        CornerFunctions::at(shape, xi, Interpolation::Linear).of(|v| self.weights[v])
    }

    /// Q xi.
    pub fn point(&self, xi: CellPoint<3>) -> CellPoint<3> {
        CellPoint(self.matrix * xi.0)
    }

    /// A box that contains Q xi for all xi of a box.
    pub fn region(&self, region: &CellBox<3>) -> CellBox<3> {
        // |Q| h contains Q times the box of half sizes h.
        let middle = self.matrix * ((region.min + region.max) / 2.0);
        let half = self.matrix.abs() * ((region.max - region.min) / 2.0);
        CellBox {
            min: middle - half,
            max: middle + half,
        }
    }

    /// Bound of the length of w's gradient in the element, by the reference length.
    pub fn max_slope(&self, corner_count: usize) -> f64 {
        let own = &self.weights[..corner_count];
        let range = own
            .iter()
            .fold(Interval::new(f64::INFINITY, f64::NEG_INFINITY), |r, &w| {
                r.hull(Interval::new(w, w))
            });
        (range.hi - range.lo) * CORNER_SLOPE
    }
}
