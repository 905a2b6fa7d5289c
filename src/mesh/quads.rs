//! Meshes of quadrilaterals, as level sets give them.

use super::{MeshError, TriMesh};
use crate::frame::Vec3;

/// Quadrilaterals over shared vertices, counter-clockwise seen from outside; a triangle repeats its last
/// corner. Each is cut into triangles between its first and its third corner.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QuadMesh {
    vertices: Vec<Vec3>,
    quads: Vec<[u32; 4]>,
}

impl QuadMesh {
    /// A mesh whose quads are turned so that their shorter diagonal comes first.
    ///
    /// # Errors
    /// [`MeshError`] when an index has no vertex or a coordinate is not finite.
    pub fn new(vertices: Vec<Vec3>, mut quads: Vec<[u32; 4]>) -> Result<Self, MeshError> {
        let triangles = |q: &[u32; 4]| [[q[0], q[1], q[2]], [q[1], q[2], q[3]]];
        super::validate(&vertices, quads.iter().flat_map(triangles))?;
        let length = |a: u32, b: u32| (vertices[a as usize] - vertices[b as usize]).norm_squared();
        for q in &mut quads {
            if q[2] != q[3] && length(q[1], q[3]) < length(q[0], q[2]) {
                q.rotate_left(1);
            }
        }
        Ok(Self { vertices, quads })
    }

    /// The vertices.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// The quads as vertex numbers.
    pub fn quads(&self) -> &[[u32; 4]] {
        &self.quads
    }

    /// Whether it has no face.
    pub fn is_empty(&self) -> bool {
        self.quads.is_empty()
    }

    /// The same surface in triangles over the same vertices.
    pub fn triangulated(&self) -> TriMesh {
        TriMesh {
            vertices: self.vertices.clone(),
            triangles: cut(&self.quads),
        }
    }

    /// As [`QuadMesh::triangulated`], without a copy of the vertices.
    pub fn into_triangles(self) -> TriMesh {
        let triangles = cut(&self.quads);
        TriMesh {
            vertices: self.vertices,
            triangles,
        }
    }

    /// Moves the vertices to other places, as many, and cuts some quads along their other diagonal.
    pub(super) fn place(&mut self, places: Vec<Vec3>, turned: &[bool]) {
        debug_assert_eq!(places.len(), self.vertices.len());
        self.vertices = places;
        for (q, _) in self.quads.iter_mut().zip(turned).filter(|t| *t.1) {
            q.rotate_left(1);
        }
    }
}

/// Quads in triangles, between their first and their third corner.
pub(crate) fn cut(quads: &[[u32; 4]]) -> Vec<[u32; 3]> {
    let mut triangles = Vec::with_capacity(2 * quads.len());
    for &[a, b, c, d] in quads {
        triangles.push([a, b, c]);
        if c != d {
            triangles.push([a, c, d]);
        }
    }
    triangles
}
