//! Quadrilateral meshes, as extracted from level sets.
//!
//! A quad may be bent: its triangles are those of the diagonal from its first to its third corner. Nothing promises
//! that a mesh is closed or free of intersections.

use super::{MeshError, TriMesh};
use crate::frame::Vec3;

/// Quadrilaterals over shared vertices, counter-clockwise seen from outside; a triangle repeats its last
/// corner. The diagonal from the first to the third corner splits a quad into triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QuadMesh {
    vertices: Vec<Vec3>,
    quads: Vec<[u32; 4]>,
}

impl QuadMesh {
    /// A mesh whose quads are rotated so that the shorter diagonal comes first.
    ///
    /// # Errors
    /// As [`TriMesh::new`].
    pub fn new(vertices: Vec<Vec3>, mut quads: Vec<[u32; 4]>) -> Result<Self, MeshError> {
        super::validate(&vertices, &quads)?;
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

    /// The quads as vertex indices.
    pub fn quads(&self) -> &[[u32; 4]] {
        &self.quads
    }

    /// Whether the mesh has no face.
    pub fn is_empty(&self) -> bool {
        self.quads.is_empty()
    }

    /// The same surface as triangles over the same vertices.
    pub fn triangulated(&self) -> TriMesh {
        TriMesh {
            vertices: self.vertices.clone(),
            triangles: split_quads(&self.quads),
        }
    }

    /// As [`QuadMesh::triangulated`], without a copy of the vertices.
    pub fn into_triangles(self) -> TriMesh {
        let triangles = split_quads(&self.quads);
        TriMesh {
            vertices: self.vertices,
            triangles,
        }
    }

    /// Replaces the positions of the vertices, and swaps the diagonal of some quads.
    pub(super) fn set_vertices(&mut self, vertices: Vec<Vec3>, is_swapped: &[bool]) {
        debug_assert_eq!(vertices.len(), self.vertices.len());
        self.vertices = vertices;
        for (q, _) in self.quads.iter_mut().zip(is_swapped).filter(|t| *t.1) {
            q.rotate_left(1);
        }
    }
}

/// Splits quads into triangles along the diagonal from the first to the third corner.
#[doc(hidden)]
pub fn split_quads(quads: &[[u32; 4]]) -> Vec<[u32; 3]> {
    let mut triangles = Vec::with_capacity(2 * quads.len());
    for &[a, b, c, d] in quads {
        triangles.push([a, b, c]);
        if c != d {
            triangles.push([a, c, d]);
        }
    }
    triangles
}
