//! Borrowed meshes for the writers: vertices, triangles or quads, vertex attributes.
//!
//! The writers of PLY, OBJ and 3MF take any `Rows`: a view in memory, or files that were filled part by part; that of
//! STL takes a view. Nothing is copied; a factor scales coordinates while they are written.

use druse_geometry::frame::Vec3;
use druse_geometry::mesh::{QuadMesh, TriMesh};
use std::io;

/// A visitor of a vertex and its attributes.
pub(super) type VisitVertex<'a> = dyn FnMut(Vec3, &[f32]) -> io::Result<()> + 'a;

/// The input of mesh writers, which read it once: vertices, then faces.
pub(super) trait Rows {
    /// The numbers of vertices and faces.
    fn counts(&self) -> [u64; 2];
    /// The names of the vertex attributes.
    fn names(&self) -> Vec<&str>;
    /// Whether coordinates are written in double precision where the format supports it.
    fn is_double(&self) -> bool;
    /// Visits every vertex in order, scaled, with its attributes.
    fn each_vertex(&mut self, visit: &mut VisitVertex) -> io::Result<()>;
    /// Visits the three or four corners of every face in order.
    fn each_face(&mut self, visit: &mut dyn FnMut(&[u32]) -> io::Result<()>) -> io::Result<()>;
}

impl Rows for MeshView<'_> {
    fn counts(&self) -> [u64; 2] {
        [self.vertices.len(), self.faces.len()].map(|n| n as u64)
    }
    fn names(&self) -> Vec<&str> {
        let names = self.attributes.iter().flat_map(|a| &a.names);
        names.map(String::as_str).collect()
    }
    fn is_double(&self) -> bool {
        self.is_double
    }
    fn each_vertex(&mut self, visit: &mut VisitVertex) -> io::Result<()> {
        let mut numbers = Vec::new();
        self.points().enumerate().try_for_each(|(n, point)| {
            numbers.clear();
            for a in self.attributes {
                numbers.extend(&a.values[n * a.names.len()..(n + 1) * a.names.len()]);
            }
            visit(point, &numbers)
        })
    }
    fn each_face(&mut self, visit: &mut dyn FnMut(&[u32]) -> io::Result<()>) -> io::Result<()> {
        (0..self.faces.len()).try_for_each(|face| visit(self.faces.corners(face)))
    }
}

/// Faces over shared vertices, counter-clockwise seen from outside.
#[derive(Clone, Copy, Debug)]
pub enum Faces<'a> {
    /// Triangles.
    Triangles(&'a [[u32; 3]]),
    /// Quadrilaterals; a triangle repeats its last corner.
    Quads(&'a [[u32; 4]]),
}

impl<'a> From<&'a [[u32; 3]]> for Faces<'a> {
    fn from(faces: &'a [[u32; 3]]) -> Self {
        Self::Triangles(faces)
    }
}

impl<'a> From<&'a [[u32; 4]]> for Faces<'a> {
    fn from(faces: &'a [[u32; 4]]) -> Self {
        Self::Quads(faces)
    }
}

impl Faces<'_> {
    /// The number of faces.
    pub fn len(&self) -> usize {
        match self {
            Self::Triangles(t) => t.len(),
            Self::Quads(q) => q.len(),
        }
    }

    /// Whether there are no faces.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The three or four corners of a face.
    pub fn corners(&self, face: usize) -> &[u32] {
        match self {
            Self::Triangles(t) => &t[face],
            Self::Quads(q) if q[face][2] == q[face][3] => &q[face][..3],
            Self::Quads(q) => &q[face],
        }
    }
}

/// An attribute of the vertices of a mesh: one or several numbers per vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct VertexAttribute {
    /// The name of each number, as in `["uvw_x", "uvw_y", "uvw_z"]`.
    pub names: Vec<String>,
    /// The numbers, vertex by vertex.
    pub values: Vec<f32>,
}

/// A borrowed mesh for writing; lengths are scaled during output.
#[derive(Clone, Copy, Debug)]
pub struct MeshView<'a> {
    /// The positions of the vertices.
    pub vertices: &'a [Vec3],
    /// The faces over them.
    pub faces: Faces<'a>,
    /// A factor on every coordinate.
    pub factor: f64,
    /// Vertex attributes; only PLY supports them.
    pub attributes: &'a [VertexAttribute],
    /// Whether PLY and 3MF store coordinates in double precision.
    pub is_double: bool,
}

impl<'a> MeshView<'a> {
    /// The scaled vertices.
    pub fn points(&self) -> impl Iterator<Item = Vec3> + '_ {
        self.vertices.iter().map(|v| v * self.factor)
    }

    /// The scaled corners of every triangle; empty for a mesh of quads.
    pub fn triangle_corners(&self) -> impl Iterator<Item = [Vec3; 3]> + '_ {
        let triangles = match self.faces {
            Faces::Triangles(t) => t,
            Faces::Quads(_) => &[],
        };
        let corner = |v: u32| self.vertices[v as usize] * self.factor;
        triangles.iter().map(move |t| t.map(corner))
    }

    /// The view with all lengths multiplied by a factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            factor: self.factor * factor,
            ..self
        }
    }

    /// Sets whether PLY and 3MF store coordinates in double precision.
    #[must_use]
    pub fn in_double(self, is_double: bool) -> Self {
        Self { is_double, ..self }
    }

    /// The view with vertex attributes.
    #[must_use]
    pub fn with_attributes(self, attributes: &'a [VertexAttribute]) -> Self {
        Self { attributes, ..self }
    }
}

impl<'a> From<&'a TriMesh> for MeshView<'a> {
    fn from(mesh: &'a TriMesh) -> Self {
        Self {
            vertices: mesh.vertices(),
            faces: Faces::Triangles(mesh.triangles()),
            factor: 1.0,
            attributes: &[],
            is_double: false,
        }
    }
}

impl<'a> From<&'a QuadMesh> for MeshView<'a> {
    fn from(mesh: &'a QuadMesh) -> Self {
        Self {
            vertices: mesh.vertices(),
            faces: Faces::Quads(mesh.quads()),
            factor: 1.0,
            attributes: &[],
            is_double: false,
        }
    }
}
