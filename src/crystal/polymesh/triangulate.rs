//! Triangulation of the faces, for export and for level sets.
//!
//! Triangular faces stay. Planar convex faces, and those without a normal, become fans from their start vertex.
//! Non-planar faces all of whose edges are visible from their centre become fans about it. Other faces are triangulated
//! by ear clipping in their mean plane; where that fails, as a fan about a centre that sees all edges, else from the
//! start vertex. Triangles without area are kept: closed surfaces stay closed.

use super::PolyMesh;
use super::polygon::{doubled_area_vector, mean, unit};
use druse_geometry::frame::Vec3;
use druse_geometry::mesh::{MeshError, TriMesh};

/// Triangles of a polygon mesh.
pub struct Triangulated {
    /// The triangles; the mesh's vertices come first, in their order, then centres of faces.
    pub mesh: TriMesh,
    /// The face of each triangle.
    pub faces: Vec<u32>,
}

/// Largest distance of a corner of a planar face from its plane, as a share of the size of the face.
const PLANARITY_TOLERANCE: f64 = 1e-9;

impl PolyMesh {
    /// The mesh as triangles.
    ///
    /// # Errors
    /// [`MeshError`] when there are more points than an index can name.
    pub fn triangulated(&self) -> Result<Triangulated, MeshError> {
        let mut vertices = self.vertices().to_vec();
        let mut triangles = Vec::with_capacity(2 * self.edge_count());
        let mut faces = Vec::with_capacity(2 * self.edge_count());
        for f in 0..self.face_count() {
            let face = self.face(f);
            match cut(&self.points(f)) {
                Cut::Into(list) => {
                    for [a, b, c] in list {
                        triangles.push([a, b, c].map(|k| face[k]));
                        faces.push(f as u32);
                    }
                }
                // A fan about the centre, which is a new vertex.
                Cut::About(centre) => {
                    let c = vertices.len() as u32;
                    vertices.push(centre);
                    for (&a, &b) in face.iter().zip(face.iter().cycle().skip(1)) {
                        triangles.push([a, b, c]);
                        faces.push(f as u32);
                    }
                }
            }
        }
        let mesh = TriMesh::new(vertices, triangles)?;
        Ok(Triangulated { mesh, faces })
    }
}

/// The triangles of a face by its corners (numbers in its loop), or a fan about a new point.
enum Cut {
    Into(Vec<[usize; 3]>),
    About(Vec3),
}

/// How a face with these corners is triangulated, without changing its orientation; the file head lists the cases.
fn cut(points: &[Vec3]) -> Cut {
    let n = points.len();
    let fan = || (1..n - 1).map(|k| [0, k, k + 1]).collect();
    let area_vector = doubled_area_vector(points);
    let Some(normal) = unit(area_vector).filter(|_| n > 3) else {
        return Cut::Into(fan());
    };
    let centre = mean(points);
    let size = points
        .iter()
        .map(|p| (p - centre).norm())
        .fold(0.0, f64::max);
    let off = points.iter().map(|p| (p - centre).dot(&normal).abs());
    let planar = off.fold(0.0, f64::max) <= PLANARITY_TOLERANCE * size;
    let turn = |a: Vec3, b: Vec3, c: Vec3| (b - a).cross(&(c - b)).dot(&normal);
    let convex = (0..n).all(|i| turn(points[i], points[(i + 1) % n], points[(i + 2) % n]) > 0.0);
    if planar && convex {
        return Cut::Into(fan());
    }
    // Whether the centre sees edge i from the front.
    let sees = |i: usize| {
        let (a, b) = (points[i] - centre, points[(i + 1) % n] - centre);
        a.cross(&b).dot(&normal) > 0.0
    };
    if !planar && (0..n).all(sees) {
        return Cut::About(centre);
    }
    // Ear clipping in the mean plane.
    let across = unit(points[1] - points[0]).unwrap_or_else(Vec3::x);
    let (x, y) = (across, normal.cross(&across));
    let flat = points.iter().map(|p| {
        let p = p - centre;
        [p.dot(&x), p.dot(&y)]
    });
    let mut corners: Vec<usize> = Vec::new();
    earcut::Earcut::new().earcut(flat, &[], &mut corners);
    let list: Vec<[usize; 3]> = corners
        .chunks_exact(3)
        .map(|t| [t[0], t[1], t[2]])
        .collect();
    let covered: f64 = list
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|k| points[k]);
            (b - a).cross(&(c - a)).dot(&normal)
        })
        .sum();
    // Ear clipping fails for self-intersecting polygons and drops straight corners; a fan keeps the surface closed.
    let all = list.len() == n - 2
        && (covered.abs() - area_vector.norm()).abs() <= 1e-9 * area_vector.norm();
    if !all {
        return if (0..n).all(sees) {
            Cut::About(centre)
        } else {
            Cut::Into(fan())
        };
    }
    Cut::Into(if covered < 0.0 {
        list.into_iter().map(|[a, b, c]| [a, c, b]).collect()
    } else {
        list
    })
}
