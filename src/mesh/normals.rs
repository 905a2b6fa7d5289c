//! Normals at the vertices of a mesh.

use super::TriMesh;
use crate::frame::Vec3;

impl TriMesh {
    /// Unit normals at the vertices, outward: means of the triangles around, weighted by their angles;
    /// zero where a vertex has none.
    pub fn vertex_normals(&self) -> Vec<Vec3> {
        self.weighted_normals(|[a, b, c], unit, _| unit * (b - a).angle(&(c - a)))
    }

    /// The same weighted by area: of meshes whose triangles differ much in size, where the smallest say
    /// little about the surface.
    pub fn vertex_normals_by_area(&self) -> Vec<Vec3> {
        self.weighted_normals(|_, unit, length| unit * length)
    }

    /// Normals by the share of a corner, the first of three, given its triangle's unit normal and twice
    /// its area.
    fn weighted_normals(&self, share: impl Fn([Vec3; 3], Vec3, f64) -> Vec3) -> Vec<Vec3> {
        let mut normals = vec![Vec3::zeros(); self.vertices.len()];
        for (t, corners) in self.triangles.iter().zip(self.iter_corners()) {
            for (i, &v) in t.iter().enumerate() {
                let [a, b, c] = [corners[i], corners[(i + 1) % 3], corners[(i + 2) % 3]];
                let normal = (b - a).cross(&(c - a));
                if let Some(unit) = normal.try_normalize(0.0) {
                    normals[v as usize] += share([a, b, c], unit, normal.norm());
                }
            }
        }
        for n in &mut normals {
            *n = n.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
        }
        normals
    }
}
