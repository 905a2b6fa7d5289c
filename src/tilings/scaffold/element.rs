//! One element of a scaffold: the map between the cell frame and the world.
//!
//! [`ElementMap`] borrows the scaffold and is cheap to copy. The map is in closed form; its inverse is closed for
//! affine elements and Newton's method for others, which may fail with [`InverseError`].

use super::kind::Kind;
use super::map::{Affine, Geometry, Map};
use super::polynomial::Polynomial;
use druse_geometry::frame::{Aabb, CellPoint, Element, Mat3, Vec3, WorldPoint};

/// A world point without a preimage near the element.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "element {element} ({}): no preimage of ({}, {}, {}) near the element; closest residual {residual:e}",
    kind.name(), point[0], point[1], point[2]
)]
pub struct InverseError {
    /// The element's number.
    pub element: usize,
    /// Its kind.
    pub kind: Kind,
    /// The world point.
    pub point: [f64; 3],
    /// Distance left in world units.
    pub residual: f64,
}

/// One element of a scaffold: its map between the cell frame and the world.
#[derive(Clone, Copy)]
pub struct ElementMap<'a> {
    pub(super) index: usize,
    pub(super) kind: Kind,
    pub(super) nodes: &'a [u32],
    pub(super) geometry: &'a Geometry,
}

impl<'a> ElementMap<'a> {
    /// Its number in the scaffold.
    pub fn index(&self) -> usize {
        self.index
    }

    /// Its kind.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The reference shape of its cell.
    pub fn shape(&self) -> Element {
        self.kind.shape()
    }

    /// Its node numbers, VTK order.
    pub fn nodes(&self) -> &'a [u32] {
        self.nodes
    }

    /// Whether the map is affine: constant Jacobian, closed-form inverse.
    pub fn is_affine(&self) -> bool {
        matches!(self.geometry.map, Map::Affine(_))
    }

    /// A box that contains the element, curved edges and all.
    pub fn bounds(&self) -> Aabb {
        self.geometry.bounds
    }

    /// Bernstein control points: the element lies in their convex hull.
    pub fn control_points(&self) -> Vec<Vec3> {
        match &self.geometry.map {
            Map::Curved(c) => c.net.coefficients.clone(),
            Map::Twisted(t) => t.corners(),
            Map::Collapsed(c) => c.net.coefficients.clone(),
            Map::Affine(a) => {
                let vertices = self.shape().vertices();
                vertices.into_iter().map(|v| a.map(CellPoint(v))).collect()
            }
        }
    }

    /// Bounds of the singular values of dx/dxi over the element, world units: every length in the
    /// cell is stretched by a factor between them. The lower one is 0 where none could be proved.
    pub fn stretch(&self) -> (f64, f64) {
        self.geometry.stretch
    }

    /// The world point at xi; outside the cell the polynomial is extrapolated.
    pub fn map(&self, xi: CellPoint<3>) -> WorldPoint {
        WorldPoint(match &self.geometry.map {
            Map::Affine(a) => a.map(xi),
            Map::Curved(c) => c.evaluate(xi).0,
            Map::Twisted(t) => t.evaluate(xi).0,
            Map::Collapsed(c) => c.evaluate(xi).0,
        })
    }

    /// The map in powers of xi; `None` for affine elements and pyramids.
    pub fn polynomial(&self) -> Option<&'a Polynomial> {
        match &self.geometry.map {
            Map::Curved(c) => Some(&c.polynomial),
            Map::Affine(_) | Map::Twisted(_) | Map::Collapsed(_) => None,
        }
    }

    /// dx/dxi.
    pub fn jacobian(&self, xi: CellPoint<3>) -> Mat3 {
        self.map_and_jacobian(xi).1
    }

    /// The world point and dx/dxi.
    pub fn map_and_jacobian(&self, xi: CellPoint<3>) -> (WorldPoint, Mat3) {
        match &self.geometry.map {
            Map::Affine(a) => (WorldPoint(a.map(xi)), a.jacobian),
            Map::Curved(c) => {
                let (x, j) = c.evaluate(xi);
                (WorldPoint(x), j)
            }
            Map::Twisted(t) => {
                let (x, j) = t.evaluate(xi);
                (WorldPoint(x), j)
            }
            Map::Collapsed(c) => {
                let (x, j) = c.evaluate(xi);
                (WorldPoint(x), j)
            }
        }
    }

    /// The point of the cell frame that maps to `x`. It may lie outside the cell; the inverse of a curved map
    /// reaches one cell beyond it.
    ///
    /// # Errors
    /// The element is degenerate, or no preimage was found near it.
    pub fn inverse(&self, x: WorldPoint) -> Result<CellPoint<3>, InverseError> {
        match &self.geometry.map {
            Map::Affine(a) => self.affine(a, x),
            Map::Curved(c) => c
                .newton(x.0, c.initial_guess(x.0))
                .or_else(|_| c.newton(x.0, CellPoint(Vec3::zeros())))
                .map_err(|residual| self.lost(x, residual)),
            Map::Twisted(t) => t.inverse(x.0, None).map_err(|r| self.lost(x, r)),
            Map::Collapsed(c) => c.inverse(x.0, None).map_err(|r| self.lost(x, r)),
        }
    }

    /// As [`Self::inverse`], with Newton's method started at `start`, for example at the preimage of a
    /// neighbouring voxel.
    ///
    /// # Errors
    /// As [`Self::inverse`].
    pub fn inverse_from(
        &self,
        x: WorldPoint,
        start: CellPoint<3>,
    ) -> Result<CellPoint<3>, InverseError> {
        match &self.geometry.map {
            Map::Affine(a) => self.affine(a, x),
            Map::Curved(c) => c.newton(x.0, start).or_else(|_| self.inverse(x)),
            Map::Twisted(t) => t.inverse(x.0, Some(start)).or_else(|_| self.inverse(x)),
            Map::Collapsed(c) => c.inverse(x.0, Some(start)).or_else(|_| self.inverse(x)),
        }
    }

    /// The preimage inside the closed cell, within `tolerance` of its face planes, if there is one.
    /// Unlike [`Self::inverse`] it never finds another branch of a strongly curved map.
    pub fn inverse_inside(&self, x: WorldPoint, tolerance: f64) -> Option<CellPoint<3>> {
        let inside = |xi: &CellPoint<3>| self.shape().face_distance(*xi) <= tolerance;
        let found = self.inverse(x).ok().filter(inside);
        if found.is_some() || self.is_affine() {
            return found;
        }
        // A proof that x is not in the element, or a start near its preimage; 1e-9 covers rounding.
        let margin = (tolerance + 1e-9) * self.geometry.stretch.1;
        let at = Aabb::of([x.0]).dilated(margin);
        let part = self.cell_box(&at)?;
        let start = CellPoint((part.min + part.max) / 2.0);
        self.inverse_from(x, start).ok().filter(inside)
    }

    fn affine(&self, a: &Affine, x: WorldPoint) -> Result<CellPoint<3>, InverseError> {
        let xi = a.inverse * (x.0 - a.origin);
        if xi.iter().all(|c| c.is_finite()) {
            Ok(CellPoint(xi))
        } else {
            Err(self.lost(x, (x.0 - a.origin).norm()))
        }
    }

    fn lost(&self, x: WorldPoint, residual: f64) -> InverseError {
        InverseError {
            element: self.index,
            kind: self.kind,
            point: x.0.into(),
            residual,
        }
    }
}
