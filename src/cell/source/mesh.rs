//! Triangle meshes as sources: placement, caps, and the share of the surface that lies inside.

use super::{Source, SourceKind};
use crate::cell::fit::{FitError, Placement, SourceReport};
use crate::frame::{CellPoint, Element, Vec3};
use crate::mesh::{MeshSolid, TriMesh};

/// What becomes of triangles that lie in a face plane of the element.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Caps {
    /// They count for the inside test, not for the distance: struts cut at the faces join through
    /// them.
    #[default]
    Exclude,
    /// They are surface like any other.
    Keep,
}

/// A triangle is a cap if its corners lie this close to a face plane, in reference units.
const CAP_TOLERANCE: f64 = 1e-6;
/// Samples are drawn towards the centroid by this share, so that none lies in a cap, where inside
/// and outside meet.
const PULL: f64 = 1e-5;

/// Which triangles of a placed mesh lie in a face plane of the element.
fn find_caps(element: Element, mesh: &TriMesh) -> Vec<bool> {
    // A ball has none: nothing joins there.
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
    /// A triangle mesh. Inside is where the winding number exceeds 1/2, so that holes, loose
    /// triangles and self-intersections leave a solid; triangles and shells that wind inward are turned,
    /// and overlapping shells united. Every such repair is a warning.
    ///
    /// # Errors
    /// [`FitError::Placement`]; [`FitError::Mesh`] for one without triangles or that bounds no solid.
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
        // In the order of the mesh's triangles, not of the tree.
        surface.sort_by_key(|t| t.1);
        for (corners, _) in surface {
            let [a, b, c] = corners;
            let size = (b - a).cross(&(c - a)).norm() / 2.0;
            area += size;
            let within = |p: Vec3| element.face_distance(CellPoint(p)) <= CAP_TOLERANCE;
            // Large triangles that cross a face count by their corners and centre.
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
            value: Box::new(move |p| solid.signed_distance(p * (1.0 - PULL))),
            points,
            exact: true,
            resolution: None,
            report,
            warnings,
        })
    }
}
