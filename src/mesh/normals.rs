//! Normals at the vertices of a mesh.

use super::TriMesh;
use crate::frame::Vec3;

impl TriMesh {
    /// Unit normals at the vertices, outward: means of the triangles around, weighted by their angles;
    /// zero where a vertex has none.
    pub fn vertex_normals(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::zeros(); self.vertices.len()];
        for (t, corners) in self.triangles.iter().zip(self.iter_corners()) {
            for (i, &v) in t.iter().enumerate() {
                let [a, b, c] = [corners[i], corners[(i + 1) % 3], corners[(i + 2) % 3]];
                let normal = (b - a).cross(&(c - a));
                if let Some(unit) = normal.try_normalize(0.0) {
                    normals[v as usize] += unit * (b - a).angle(&(c - a));
                }
            }
        }
        of_unit_length(normals)
    }

    /// The same weighted by area: of meshes whose triangles differ much in size, where the smallest say
    /// little about the surface.
    pub fn vertex_normals_by_area(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::zeros(); self.vertices.len()];
        for (t, [a, b, c]) in self.triangles.iter().zip(self.iter_corners()) {
            let normal = (b - a).cross(&(c - a));
            for &v in t {
                normals[v as usize] += normal;
            }
        }
        of_unit_length(normals)
    }
}

/// Vectors of length 1, or zero where they are.
fn of_unit_length(mut vectors: Vec<Vec3>) -> Vec<Vec3> {
    for v in &mut vectors {
        *v = v.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
    }
    vectors
}
