//! Vertex normals of a mesh.

use super::TriMesh;
use crate::frame::Vec3;

impl TriMesh {
    /// Outward unit normals at the vertices: means over the adjacent triangles, weighted by angle; zero where a
    /// vertex has no triangle with area.
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
        normalized(normals)
    }

    /// As [`TriMesh::vertex_normals`], weighted by area: for meshes whose triangles differ much in size, where
    /// the normals of the smallest are unreliable.
    pub fn vertex_normals_by_area(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::zeros(); self.vertices.len()];
        for (t, [a, b, c]) in self.triangles.iter().zip(self.iter_corners()) {
            let normal = (b - a).cross(&(c - a));
            for &v in t {
                normals[v as usize] += normal;
            }
        }
        normalized(normals)
    }
}

/// Vectors scaled to length 1; zero vectors remain zero.
fn normalized(mut vectors: Vec<Vec3>) -> Vec<Vec3> {
    for v in &mut vectors {
        *v = v.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
    }
    vectors
}
