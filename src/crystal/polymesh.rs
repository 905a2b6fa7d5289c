//! Polygon meshes with face groups, and their modelling operations.
//!
//! Faces are selected, extruded and remeshed, and scripts replay these steps (Landreneau, *Crystal-Like
//! Geometric Modeling*, 2005).
//!
//! A [`PolyMesh`] is a closed oriented 2-manifold of polygons with any number of corners. It may touch
//! or cross itself in space; its topology may not: every directed edge `(a, b)` occurs once and
//! `(b, a)` once, and the faces round a vertex make one fan.
//!
//! - A face is a loop of vertex numbers, counter-clockwise seen from outside, from its **start vertex** on.
//! - Every face has a **group**, a number from 1; primitives have group 1.
//! - `delta`, the **dihedral angle** of an extrusion, is the interior angle between the base face and the
//!   side planes, in degrees: 90 makes a prism, more flares out, less tapers in.
//! - **Tiers** are ratios of the mean edge length of the base face; negative ones make pits.
//!
//! ```
//! # extern crate druse_crystal as druse;
//! use druse::polymesh::{Extrusion, Kind, PolyMesh, seed};
//! let cube = seed::platonic("cube", 1.0).unwrap();
//! let star = Extrusion::regular(Kind::Tetrahedral).of_group(&cube, 1).unwrap();
//! assert_eq!((star.mesh.vertex_count(), star.mesh.edge_count(), star.mesh.face_count()), (14, 36, 24));
//! assert_eq!(star.mesh.euler(), 2);
//! ```

use druse_geometry::frame::{Aabb, Vec3};
use std::collections::BTreeMap;

mod archimedean;
mod error;
mod expression;
mod extrude;
pub mod form;
mod history;
mod kind;
mod measure;
mod operator;
mod picture;
mod polygon;
mod remesh;
mod script;
pub mod seed;
mod select;
mod subdivide;
mod surface;
mod symmetrize;
mod tier;
mod topology;
mod triangulate;

pub use error::{ExtrudeError, PolyError};
pub use extrude::{Extruded, Extrusion};
pub use history::{History, Model};
pub use kind::{Dihedral, Kind, Operator, from_name as extrusion_named, names as extrusion_names};
pub use measure::Summary;
#[doc(hidden)]
pub use picture::DepthBuffer;
pub use picture::group_color;
pub use remesh::{Grouping, Parameter, Remesh, RemeshError, scheme_names};
#[doc(hidden)]
pub use script::VERBS;
pub use script::{
    Files, GroupBy, Interpreter, LoadOptions, Loaded, NoFiles, Note, Script, ScriptError,
};
pub use subdivide::Parts;
pub use surface::SurfaceError;
pub use symmetrize::Symmetry;
pub use triangulate::Triangulated;

/// Maximum number of corners that a remeshing, extrusion or subdivision makes: a list of them takes half a GiB.
const MAX_CORNERS: u64 = 1 << 27;

/// The faces of a mesh: loops of vertex numbers in one array.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Faces {
    /// Vertex numbers of all loops, one loop after the other.
    corners: Vec<u32>,
    /// Where each face begins in `corners`, and the end of the last.
    starts: Vec<u32>,
}

impl Faces {
    /// An empty list with capacity for this many faces and corners.
    pub fn with_capacity(faces: usize, corners: usize) -> Self {
        let mut starts = Vec::with_capacity(faces + 1);
        starts.push(0);
        Self {
            corners: Vec::with_capacity(corners),
            starts,
        }
    }

    /// Appends a face.
    pub fn push(&mut self, face: impl IntoIterator<Item = u32>) {
        if self.starts.is_empty() {
            self.starts.push(0);
        }
        self.corners.extend(face);
        self.starts.push(self.corners.len() as u32);
    }

    /// Number of faces.
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Whether there are no faces.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The loop of face `f`, from its start vertex. Panics where there is no such face, as all access by number does.
    pub fn get(&self, f: usize) -> &[u32] {
        &self.corners[self.span(f)]
    }

    /// The range of face `f` in the list of all corners.
    pub fn span(&self, f: usize) -> std::ops::Range<usize> {
        self.starts[f] as usize..self.starts[f + 1] as usize
    }

    /// Every loop, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[u32]> {
        (0..self.len()).map(|f| self.get(f))
    }
}

impl<F: IntoIterator<Item = u32>> FromIterator<F> for Faces {
    fn from_iter<I: IntoIterator<Item = F>>(faces: I) -> Self {
        let mut all = Self::default();
        faces.into_iter().for_each(|f| all.push(f));
        all
    }
}

/// A closed oriented 2-manifold of polygons with groups. [`PolyMesh::new`] checks that it is one.
#[derive(Clone, Debug, PartialEq)]
pub struct PolyMesh {
    vertices: Vec<Vec3>,
    faces: Faces,
    groups: Vec<u32>,
    /// For each corner the corner of the opposite half-edge. The half-edge of a corner runs from its vertex
    /// to the next vertex of its face.
    twins: Vec<u32>,
}

impl PolyMesh {
    /// A mesh of these vertices and loops, in group 1.
    pub(crate) fn in_one_group(vertices: Vec<Vec3>, faces: Faces) -> Result<Self, PolyError> {
        let groups = vec![1; faces.len()];
        Self::new(vertices, faces, groups)
    }

    /// A mesh of these vertices, loops and groups.
    ///
    /// # Errors
    /// [`PolyError`] names the first face, edge or vertex that breaks a rule of the [module](self).
    pub fn new(vertices: Vec<Vec3>, faces: Faces, groups: Vec<u32>) -> Result<Self, PolyError> {
        let twins = topology::twins(&vertices, &faces, &groups)?;
        Ok(Self {
            vertices,
            faces,
            groups,
            twins,
        })
    }

    /// A mesh from lists of vertex numbers, all in group 1.
    ///
    /// # Errors
    /// As [`PolyMesh::new`].
    pub fn from_lists<F: AsRef<[u32]>>(
        vertices: Vec<Vec3>,
        faces: impl IntoIterator<Item = F>,
    ) -> Result<Self, PolyError> {
        let mut list = Faces::default();
        for face in faces {
            list.push(face.as_ref().iter().copied());
        }
        Self::in_one_group(vertices, list)
    }

    /// The vertices; every one belongs to a face.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// The loops of all faces.
    pub fn faces(&self) -> &Faces {
        &self.faces
    }

    /// The loop of face `f`, from its start vertex.
    pub fn face(&self, f: usize) -> &[u32] {
        self.faces.get(f)
    }

    /// The positions of the corners of face `f`.
    pub fn points(&self, f: usize) -> Vec<Vec3> {
        self.face(f)
            .iter()
            .map(|&v| self.vertices[v as usize])
            .collect()
    }

    /// The group of each face.
    pub fn groups(&self) -> &[u32] {
        &self.groups
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len()
    }

    /// Number of edges.
    pub fn edge_count(&self) -> usize {
        self.twins.len() / 2
    }

    /// Number of faces.
    pub fn face_count(&self) -> usize {
        self.faces.len()
    }

    /// Number of corners of all faces.
    fn corner_count(&self) -> usize {
        self.twins.len()
    }

    /// Euler characteristic V - E + F: 2 for each component, less 2 for each handle. The mesh may have several
    /// components.
    pub fn euler(&self) -> i64 {
        self.vertex_count() as i64 - self.edge_count() as i64 + self.face_count() as i64
    }

    /// The greatest group in use; a mesh has a face, so that it is at least 1.
    pub fn greatest_group(&self) -> u32 {
        self.groups.iter().copied().max().unwrap_or(0)
    }

    /// The number of faces of each group in use.
    pub fn group_counts(&self) -> BTreeMap<u32, usize> {
        let mut counts = BTreeMap::new();
        for &g in &self.groups {
            *counts.entry(g).or_insert(0) += 1;
        }
        counts
    }

    /// The box around the vertices.
    pub fn bounds(&self) -> Aabb {
        Aabb::of(self.vertices.iter().copied())
    }

    /// The same mesh with other groups.
    ///
    /// # Panics
    /// When the number of groups is not the number of faces, or a group is 0.
    #[must_use]
    pub fn with_groups(mut self, groups: Vec<u32>) -> Self {
        assert!(groups.len() == self.groups.len() && !groups.contains(&0));
        self.groups = groups;
        self
    }

    /// The same mesh with every vertex moved by an orientation-preserving map. This is not checked: a mirror
    /// image has its faces inside out.
    ///
    /// # Errors
    /// [`PolyError::NotFinite`] where the map gives a point that is not finite or beyond 1e18.
    pub fn mapped(&self, map: impl Fn(Vec3) -> Vec3) -> Result<Self, PolyError> {
        let vertices: Vec<Vec3> = self.vertices.iter().map(|&v| map(v)).collect();
        topology::finite(&vertices)?;
        Ok(Self {
            vertices,
            ..self.clone()
        })
    }

    /// The same mesh where face `f` starts at its corner `shift[f]`, counted from its old start vertex.
    ///
    /// # Panics
    /// When the length of `shift` is not the number of faces.
    #[must_use]
    pub fn with_starts(&self, shift: &[usize]) -> Self {
        assert_eq!(shift.len(), self.face_count());
        let mut mesh = self.clone();
        for (f, &by) in shift.iter().enumerate() {
            let span = self.faces.span(f);
            let n = span.len();
            if by % n == 0 {
                continue;
            }
            mesh.faces.corners[span.clone()].rotate_left(by % n);
            mesh.twins[span].rotate_left(by % n);
        }
        // The rotation moved corners, so their twins point to new positions.
        let mut new_position: Vec<u32> = vec![0; self.twins.len()];
        for (f, &by) in shift.iter().enumerate() {
            let span = self.faces.span(f);
            let n = span.len();
            for k in 0..n {
                new_position[span.start + k] = (span.start + (k + n - by % n) % n) as u32;
            }
        }
        mesh.twins
            .iter_mut()
            .for_each(|t| *t = new_position[*t as usize]);
        mesh
    }

    /// The mesh with reversed orientation; each face keeps its start vertex.
    #[must_use]
    pub fn flipped(&self) -> Self {
        let mut faces = Faces::with_capacity(self.face_count(), self.twins.len());
        for face in self.faces.iter() {
            let first = face.first().copied();
            faces.push(first.into_iter().chain(face.iter().skip(1).rev().copied()));
        }
        // Reversing the orientation of a valid mesh keeps it valid.
        Self::new(self.vertices.clone(), faces, self.groups.clone())
            .unwrap_or_else(|e| unreachable!("a flipped mesh is invalid: {e}"))
    }

    /// The corner of the opposite half-edge, which runs the other way along the edge of `corner` in the face beyond it.
    pub(crate) fn twin(&self, corner: usize) -> usize {
        self.twins[corner] as usize
    }
}
