//! How precise the distances of a solid are near its surface.
//!
//! A distance is the root of a sum of products of differences; its rounding grows with the size of the mesh. Signs come
//! from the winding number, whose jump may lie beside the triangles where shells were united.

use crate::frame::Aabb;

/// A bound of the rounding of the distance of a point near a triangle, relative to the half diagonal of the mesh.
const DISTANCE_ROUNDING: f64 = 2e-12;

/// Bounds of the errors of distances.
#[derive(Clone, Copy)]
pub(super) struct Precision {
    /// The rounding of a distance: smaller distances count as zero.
    rounding: f64,
    /// How much the distances of two points together may exceed those from the places where the sign changes.
    pub(super) slack: f64,
}

impl Precision {
    /// The precision of a mesh with a bounding box. `gap` is the greatest distance of its surface from the places
    /// where the sign changes.
    pub(super) fn of(bounds: &Aabb, gap: f64) -> Self {
        if bounds.is_empty() {
            return Self {
                rounding: 0.0,
                slack: 0.0,
            };
        }
        let size = bounds.min.amax().max(bounds.max.amax());
        // Differences of coordinates round by their size.
        let rounding = DISTANCE_ROUNDING * bounds.half_diagonal() + 8.0 * f64::EPSILON * size;
        Self {
            rounding,
            slack: 2.0 * (rounding + gap),
        }
    }

    /// The signed distance of a point. On the surface it is zero: the sign of a rounding error would depend on the
    /// nearest triangle, and the mesh of such samples would be torn.
    pub(super) fn signed(self, distance: f64, is_inside: bool) -> f64 {
        let distance = if distance <= self.rounding {
            0.0
        } else {
            distance
        };
        if is_inside { -distance } else { distance }
    }
}
