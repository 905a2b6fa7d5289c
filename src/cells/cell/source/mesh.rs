//! Triangle meshes as sources: placement, caps, and the share of the surface that lies inside.
//!
//! The mesh is placed first; then inside, distance and repairs are those of [`MeshSolid`] in reference coordinates. So
//! the values are exact distances even where the placement shears. The share inside is estimated from four points per
//! triangle.

use super::{Source, SourceKind};
use crate::cell::fit::{FitError, Placement, SourceReport};
use druse_geometry::frame::{CellPoint, Element, Vec3};
use druse_geometry::mesh::{MeshSolid, TriMesh};

/// Treatment of triangles that lie in a face plane of the element.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Caps {
    /// They count for the inside test but not for the distance, so that struts cut at the faces join
    /// across them.
    #[default]
    Exclude,
    /// They belong to the surface like any other triangle.
    Keep,
}

/// A triangle is a cap if its corners lie this close to a face plane, in reference units.
const CAP_TOLERANCE: f64 = 1e-6;
/// Samples are moved towards the origin by this share of their distance from it, so that none lies in a cap, where
/// inside and outside meet, except in one through the origin (base of the pyramid).
const CENTROID_PULL: f64 = 1e-5;

/// For each triangle of a placed mesh, whether it lies in a face plane of the element.
/// All three corners must lie within [`CAP_TOLERANCE`] of the same plane.
fn find_caps(element: Element, mesh: &TriMesh) -> Vec<bool> {
    // The ball has no caps, since it has no neighbours.
    let faces = match element {
        Element::Ball => Vec::new(),
        other => other.faces(),
    };
    mesh.iter_corners()
        .map(|corners| {
            faces.iter().any(|f| {
                corners
                    .iter()
                    .all(|c| (f.normal.dot(c) - f.offset).abs() <= CAP_TOLERANCE)
            })
        })
        .collect()
}

impl Source {
    /// A triangle mesh. A point is inside where the winding number exceeds 1/2, so that meshes with holes,
    /// loose triangles and self-intersections still define a solid. Triangles and shells that wind inward
    /// are reversed, and overlapping shells are united. Every repair adds a warning.
    /// The report counts triangles and caps after the repairs. With `Caps::Exclude` caps carry no distance.
    ///
    /// # Errors
    /// [`FitError::Placement`]; [`FitError::Mesh`] for a mesh without triangles or without an inside.
    pub fn mesh(
        element: Element,
        mesh: &TriMesh,
        placement: &Placement,
        caps: Caps,
    ) -> Result<Self, FitError> {
        if mesh.is_empty() {
            return Err(FitError::Mesh("no triangles".to_owned()));
        }
        let placed = placement.affine(element, mesh.bounds())?.mesh(mesh);
        let find = |placed: &TriMesh| match caps {
            Caps::Exclude => find_caps(element, placed),
            Caps::Keep => vec![false; placed.triangles().len()],
        };
        let (solid, repairs) = MeshSolid::repaired_with_caps(placed, find)
            .map_err(|e| FitError::Mesh(e.to_string()))?;
        let warnings = repairs.into_iter().map(|r| r.message).collect();
        let placed = solid.mesh();
        let is_cap = find(placed);
        let bounds = placed.bounds();
        let (mut inside, mut area) = (0.0, 0.0);
        let mut points = Vec::new();
        let mut surface: Vec<_> = solid.surface().collect();
        // The order of the mesh's triangles is independent of the search tree.
        surface.sort_by_key(|t| t.1);
        for (corners, _) in surface {
            let [a, b, c] = corners;
            let size = (b - a).cross(&(c - a)).norm() / 2.0;
            area += size;
            let within = |p: Vec3| element.face_distance(CellPoint(p)) <= CAP_TOLERANCE;
            // The corners and the centre sample how much of a triangle lies inside the element.
            let centre = (a + b + c) / 3.0;
            let hits = [a, b, c, centre].into_iter().filter(|p| within(*p)).count();
            inside += size * hits as f64 / 4.0;
            points.extend([a, b, c].into_iter().filter(|p| within(*p)));
        }
        let report = SourceReport {
            kind: SourceKind::Mesh,
            triangles: placed.triangles().len(),
            caps: is_cap.iter().filter(|c| **c).count(),
            box_min: bounds.min.into(),
            box_max: bounds.max.into(),
            share_inside: if area > 0.0 { inside / area } else { 0.0 },
            points: 0,
        };
        Ok(Self {
            value: Box::new(move |p| solid.signed_distance(p * (1.0 - CENTROID_PULL))),
            points,
            exact: true,
            resolution: None,
            report,
            warnings,
        })
    }
}
