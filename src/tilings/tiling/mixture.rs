//! A cell in several turns inside the elements at faces over which no turn of theirs continues.
//!
//! `Phi_e(xi) = sum over turns k of w_k(xi) Phi(Q_k xi)`, with weights that are interpolated between the corners of
//! the element and sum to one. [`super::orient()`] chooses them so that `Phi_e` is continuous over all faces.
//!
//! With a width h, turns are mixed in a layer beside these faces alone. Let b be 1 at the nodes of such faces and 0 at
//! the others, interpolated, `m_k` the weight of turn k at these nodes, interpolated likewise, and S a smooth step from
//! b = 1 - h to b = 1. Then
//!
//! `w_k = S(b) m_k / b + (1 - S(b)) (1 for the element's own turn, else 0)`.
//!
//! On a face b and m depend on the face's nodes alone, so that `Phi_e` stays continuous; on a bad face b = 1.

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
    /// Where turns are mixed; in the whole element if there is none.
    pub layer: Option<Layer>,
}

/// The layer of an element, beside faces over which no turn continues, in which turns are mixed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// Whether each corner is a node of such a face.
    pub corners: [bool; 8],
    /// Its width as a share of the element: above 0, at most 1.
    pub width: f64,
}

impl Layer {
    /// S(b) and its derivative: t^2 (3 - 2 t), t = 1 - (1 - b) / h.
    fn step(&self, b: f64) -> (f64, f64) {
        let t = (1.0 - (1.0 - b) / self.width).clamp(0.0, 1.0);
        (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / self.width)
    }
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
        let corners = CornerFunctions::at(shape, xi, Interpolation::Linear);
        let Some(layer) = &self.layer else {
            return corners.of(|v| self.weights[v]);
        };
        let in_layer = |v: usize| f64::from(u8::from(layer.corners[v]));
        let (b, db) = corners.of(in_layer);
        let (m, dm) = corners.of(|v| in_layer(v) * self.weights[v]);
        let (step, step_slope) = layer.step(b);
        // q = S / b, which is 0 outside the layer.
        let (q, q_slope) = if step > 0.0 {
            (step / b, (step_slope - step / b) / b)
        } else {
            (0.0, 0.0)
        };
        let own = f64::from(u8::from(self.is_own(layer)));
        let slope = dm * q + db * (q_slope * m - step_slope * own);
        (q * m + (1.0 - step) * own, slope)
    }

    /// Whether it is the element's own turn, which all corners outside the layer have.
    fn is_own(&self, layer: &Layer) -> bool {
        let mut corners = self.weights.iter().zip(layer.corners);
        corners.any(|(w, is_in_layer)| !is_in_layer && *w > 0.0)
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
        let slope = (range.hi - range.lo) * CORNER_SLOPE;
        let Some(layer) = &self.layer else {
            return slope;
        };
        // S / b <= 9/8, |S'| <= 3 / (2 h), m <= b max(w), and the range of m's corner values is at most max(w).
        let own = f64::from(u8::from(self.is_own(layer)));
        CORNER_SLOPE * (range.hi * (1.125 + 1.5 / layer.width) + own * 1.5 / layer.width)
    }
}
