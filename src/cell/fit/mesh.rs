//! Fitting to a triangle mesh: placement, caps, and what the mesh adds to the report.

use super::accuracy::Extra;
use super::{FitError, FitOptions, Placement, SourceReport, fit_with};
use crate::cell::Cell;
use crate::frame::{CellPoint, Element, Vec3};
use crate::mesh::{MeshSolid, TriMesh};
use crate::progress::Progress;

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
    let faces = element.faces();
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

/// Fits a cell to a triangle mesh. Inside is where the winding number exceeds 1/2, so that small
/// holes and self-intersections do no harm.
///
/// The report names the mesh's box after placement and the share of its surface inside the element;
/// what lies outside is not used.
///
/// # Errors
/// As [`super::fit()`], and [`FitError::Placement`].
pub fn fit_mesh(
    name: &str,
    element: Element,
    mesh: &TriMesh,
    placement: &Placement,
    caps: Caps,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    let placed = placement.affine(element, mesh.bounds())?.mesh(mesh);
    let is_cap = match caps {
        Caps::Exclude => find_caps(element, &placed),
        Caps::Keep => vec![false; placed.triangles().len()],
    };
    let bounds = placed.bounds();
    let (mut inside, mut area) = (0.0, 0.0);
    let mut points = Vec::new();
    for (corners, cap) in placed.iter_corners().zip(&is_cap) {
        if *cap {
            continue;
        }
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
    let source = SourceReport {
        triangles: placed.triangles().len(),
        caps: is_cap.iter().filter(|c| **c).count(),
        box_min: bounds.min.into(),
        box_max: bounds.max.into(),
        share_inside: if area > 0.0 { inside / area } else { 0.0 },
    };
    let solid = MeshSolid::with_caps(placed, &is_cap);
    let extra = Extra {
        points,
        source: Some(source),
    };
    let distance = |p: CellPoint<3>| solid.signed_distance(p.0 * (1.0 - PULL));
    fit_with(name, element, &distance, &extra, options, progress)
}
