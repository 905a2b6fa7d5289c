//! Boundary edges of a surface, and how much they let the winding number vary.
//!
//! The boundary is a chain of edges; it is empty exactly when the triangles form a cycle (every side as often forward
//! as backward). Then the winding number w is an integer that changes only at the surface. Otherwise, at distance r,
//! |grad w| is at most the sum of length / (4 pi r^2) over the boundary edges (the law of Biot and Savart), and at most
//! the sum of area / (2 pi r^3) over any triangles with this boundary, which are a layer of dipoles.

use super::falloff::Falloff;
use super::half_edges::BoundaryEdge;
use crate::frame::Vec3;
use std::f64::consts::PI;

/// A bound on the variation of the winding number below which no tighter bound is computed: far below the 1/2 that
/// decides inside or outside.
const MAX_ACCEPTED_VARIATION: f64 = 0.1;

/// Boundary edges weighted by length, and triangles that span them weighted by area.
pub(crate) struct BoundaryEdges {
    edges: Falloff,
    spanning: Falloff,
}

impl BoundaryEdges {
    /// Boundary edges over merged vertices, and triangles with the same boundary; `None` without boundary. `edges` are
    /// directed and carry their multiplicity; `spanning` only needs the same boundary, in any orientation.
    pub(crate) fn new(
        vertices: &[Vec3],
        edges: &[BoundaryEdge],
        spanning: &[[Vec3; 3]],
    ) -> Option<Self> {
        let at = |v: u32| vertices[v as usize];
        let weighted: Vec<_> = edges
            .iter()
            .map(|s| {
                let (from, to) = (at(s.from), at(s.to));
                (
                    // An edge is a triangle with two equal corners.
                    [from, to, to],
                    (from - to).norm() * f64::from(s.multiplicity),
                )
            })
            .collect();
        let area = |[a, b, c]: [Vec3; 3]| (b - a).cross(&(c - a)).norm() / 2.0;
        (!weighted.is_empty()).then(|| Self {
            edges: Falloff::new(weighted),
            spanning: Falloff::new(spanning.iter().map(|&t| (t, area(t))).collect()),
        })
    }

    /// A bound on the variation of the winding number within `radius` of `centre`, without its jumps at the
    /// surface, plus the error of its approximation; infinite if the boundary comes that near or both bounds exceed 1.
    pub(crate) fn winding_variation(&self, centre: Vec3, radius: f64) -> f64 {
        // Well above the error of the expansions of distant groups, 0.004 with `ACCURATE_BETA`.
        const FAR_FIELD_ERROR: f64 = 0.05;
        if radius == 0.0 {
            return FAR_FIELD_ERROR;
        }
        // The radius times |grad w|; a sum of more than 1 is infinite.
        let (edge_factor, area_factor) = (radius / (4.0 * PI), radius / (2.0 * PI));
        let by_edges = edge_factor * self.edges.sum(centre, radius, 2, 1.0 / edge_factor);
        if by_edges < MAX_ACCEPTED_VARIATION {
            return by_edges + FAR_FIELD_ERROR;
        }
        let by_area = area_factor * self.spanning.sum(centre, radius, 3, 1.0 / area_factor);
        by_edges.min(by_area) + FAR_FIELD_ERROR
    }
}
