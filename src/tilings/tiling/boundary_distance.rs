//! Bounding planes of an element: a lower bound of the distance outside it.
//!
//! Each face has the plane with the normal of the face at the reference origin that keeps all control points behind it.
//! The planes contain the element, but only those of affine elements are its faces.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::inverse_map::dot;
use druse_geometry::frame::{Aabb, Element, Mat3, Vec3};
use druse_geometry::simd::Number;

/// A half space that contains an element: `normal . x <= offset`, the normal of unit length.
#[derive(Clone, Copy)]
struct Plane {
    normal: Vec3,
    offset: f64,
}

/// Half spaces at an element's faces, and its bounding box.
pub(super) struct BoundingPlanes {
    planes: [Plane; 6],
    count: usize,
    bounds: Aabb,
}

impl BoundingPlanes {
    /// The planes of an element with these control points; `matrix` is d xi / d x, which turns the face normals. A
    /// degenerate element has planes without normals, which exclude nothing.
    pub fn new(shape: Element, matrix: &Mat3, controls: &[Vec3], bounds: Aabb) -> Self {
        let mut planes = [Plane {
            normal: Vec3::zeros(),
            offset: 0.0,
        }; 6];
        let faces = shape.faces();
        for (plane, face) in planes.iter_mut().zip(&faces) {
            let normal = (matrix.transpose() * face.normal)
                .try_normalize(0.0)
                .unwrap_or_default();
            let offset = controls
                .iter()
                .map(|c| normal.dot(c))
                .fold(f64::NEG_INFINITY, f64::max);
            *plane = Plane { normal, offset };
        }
        Self {
            planes,
            count: faces.len(),
            bounds,
        }
    }

    fn all(&self) -> &[Plane] {
        &self.planes[..self.count]
    }

    /// The largest signed distance to the planes and the box. For affine elements it is the measure m of
    /// blending, for others a lower bound of the distance outside.
    #[inline(always)]
    pub fn outside_distance<T: Number>(&self, x: [T; 3]) -> T {
        let mut m = x[0].splat(f64::NEG_INFINITY);
        for (axis, x) in x.into_iter().enumerate() {
            let (low, high) = (
                x.splat(self.bounds.min[axis]),
                x.splat(self.bounds.max[axis]),
            );
            m = m.max(low - x).max(x - high);
        }
        for plane in self.all() {
            let n = plane.normal;
            let n = [x[0].splat(n.x), x[0].splat(n.y), x[0].splat(n.z)];
            m = m.max(dot(n, x, m.splat(-plane.offset)));
        }
        m
    }

    /// Distance of a point to the plane of a face.
    pub fn face_distance(&self, face: usize, x: Vec3) -> f64 {
        let plane = &self.planes[face];
        (plane.normal.dot(&x) - plane.offset).abs()
    }

    /// Whether every point of a box is certainly more than `margin` outside, by the measure m.
    #[inline]
    pub fn is_box_outside(&self, centre: Vec3, half: Vec3, margin: f64) -> bool {
        self.all().iter().any(|plane| {
            plane.normal.dot(&centre) - plane.normal.abs().dot(&half) - plane.offset > margin
        }) || (0..3).any(|a| {
            centre[a] - half[a] - self.bounds.max[a] > margin
                || self.bounds.min[a] - centre[a] - half[a] > margin
        })
    }
}
