//! Triangle meshes: measures, checks, winding number, signed distance.
//!
//! A [`TriMesh`] is vertices in `f64` and triangles of vertex numbers, counter-clockwise seen from
//! outside; its unit and frame are its owner's. It may be open, self-intersecting or non-manifold:
//! only indices and numbers are validated.
//!
//! ```
//! use druse::frame::Aabb;
//! use druse::mesh::TriMesh;
//! let cube = TriMesh::cuboid(&Aabb::of([[0.0; 3].into(), [2.0; 3].into()]));
//! assert_eq!((cube.volume(), cube.area()), (8.0, 24.0));
//! assert_eq!(cube.flipped().volume(), -8.0);
//! ```

use crate::frame::{Aabb, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

mod boundary_edges;
mod bvh;
mod check;
mod cloud;
mod crossing;
mod falloff;
mod intersect;
mod lattice;
mod normals;
mod open_winding;
mod openness;
mod projection;
mod quads;
mod repair;
mod rows;
mod shapes;
mod shells;
mod sides;
mod skin;
mod solid;
mod soup;
mod triangle;
mod unite;
mod winding;

pub(crate) use bvh::Bvh;
pub use check::{Defect, Finding, MeshReport, check, check_with};
pub use cloud::{CloudError, CloudSolid};
pub use openness::{Hole, HopelessMesh, Openness};
pub use projection::{Fate, Projected, Projection};
pub use quads::QuadMesh;
pub(crate) use quads::cut;
pub use repair::{Repair, RepairKind, ShellReport};
pub use shells::bodies;
pub use skin::{Side, Skin};
pub use solid::MeshSolid;
pub use soup::Closest;
pub(crate) use soup::Distances;

/// Why vertices and triangles do not make a mesh.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {index}; expected one of 0 to {}", *count as i64 - 1)]
    NoSuchVertex {
        /// Number of the triangle, from 0.
        triangle: usize,
        /// The vertex it names.
        index: u32,
        /// How many vertices there are.
        count: usize,
    },
    /// A coordinate is infinite or not a number.
    #[error("vertex {vertex} has the coordinate {value}; expected a finite number")]
    NotFinite {
        /// Number of the vertex, from 0.
        vertex: usize,
        /// The coordinate.
        value: f64,
    },
    /// More vertices than a 32-bit index can name.
    #[error("{0} vertices; expected at most 4294967295")]
    TooMany(usize),
}

/// What [`TriMesh::measures`] found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshMeasures {
    /// The box around the triangles; empty for an empty mesh.
    pub bounds: Aabb,
    /// As [`TriMesh::volume`].
    pub volume: f64,
    /// As [`TriMesh::area`].
    pub area: f64,
}

/// Triangles over shared vertices; indices in range and coordinates finite, nothing else promised.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// A mesh from vertices and triangles (counter-clockwise seen from outside).
    ///
    /// # Errors
    /// [`MeshError`] when an index has no vertex or a coordinate is not finite.
    pub fn new(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        validate(&vertices, triangles.iter().copied())?;
        Ok(Self {
            vertices,
            triangles,
        })
    }

    /// The same of what is known to be in range and finite.
    pub(crate) fn known(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        debug_assert!(validate(&vertices, triangles.iter().copied()).is_ok());
        Self {
            vertices,
            triangles,
        }
    }

    /// The vertices, some of which may belong to no triangle.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// The triangles as vertex numbers.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Whether it has no triangle.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The three corners of triangle `t`.
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        self.triangles[t].map(|v| self.vertices[v as usize])
    }

    /// The corners of every triangle, in order.
    pub fn iter_corners(&self) -> impl ExactSizeIterator<Item = [Vec3; 3]> + '_ {
        (0..self.triangles.len()).map(|t| self.corners(t))
    }

    /// The box around the triangles; empty for an empty mesh.
    pub fn bounds(&self) -> Aabb {
        Aabb::of(self.iter_corners().flatten())
    }

    /// Signed volume enclosed, by the divergence theorem: positive when the triangles wind
    /// counter-clockwise seen from outside. Means little for an open mesh.
    pub fn volume(&self) -> f64 {
        let o = self.reference();
        let six: f64 = self
            .iter_corners()
            .map(|[a, b, c]| (a - o).dot(&(b - o).cross(&(c - o))))
            .sum();
        six / 6.0
    }

    /// Sum of the triangles' areas.
    pub fn area(&self) -> f64 {
        let two: f64 = self
            .iter_corners()
            .map(|[a, b, c]| (b - a).cross(&(c - a)).norm())
            .sum();
        two / 2.0
    }

    /// Box, volume and area at once, by the threads of the pool that it is called in. Sums of parts of fixed
    /// size, in order: no number depends on the threads.
    pub fn measures(&self) -> MeshMeasures {
        const PART: usize = 1 << 14;
        let parts = self.triangles.par_chunks(PART);
        let boxes: Vec<Aabb> = parts
            .clone()
            .map(|part| {
                let corners = part.iter().flatten();
                Aabb::of(corners.map(|&v| self.vertices[v as usize]))
            })
            .collect();
        let bounds = boxes.into_iter().fold(Aabb::EMPTY, Aabb::union);
        let middle = if bounds.is_empty() {
            Vec3::zeros()
        } else {
            bounds.centre().0
        };
        let sums: Vec<[f64; 2]> = parts
            .map(|part| {
                let corners = part.iter().map(|t| t.map(|v| self.vertices[v as usize]));
                corners.fold([0.0; 2], |[six, two], [a, b, c]| {
                    let normal = (b - a).cross(&(c - a));
                    [six + (a - middle).dot(&normal), two + normal.norm()]
                })
            })
            .collect();
        let [six, two] = sums
            .iter()
            .fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        MeshMeasures {
            bounds,
            volume: six / 6.0,
            area: two / 2.0,
        }
    }

    /// The middle of the box: measures are taken from here so that far-away meshes lose no digits.
    fn reference(&self) -> Vec3 {
        let b = self.bounds();
        if b.is_empty() {
            Vec3::zeros()
        } else {
            b.centre().0
        }
    }

    /// The mesh with every vertex moved; a map that mirrors also turns the winding (see
    /// [`TriMesh::flipped`]).
    ///
    /// # Panics
    /// When the map gives a coordinate that is not finite.
    #[must_use]
    pub fn mapped(&self, map: impl Fn(Vec3) -> Vec3) -> Self {
        let vertices: Vec<Vec3> = self.vertices.iter().map(|&v| map(v)).collect();
        assert!(
            vertices.iter().flatten().all(|c| c.is_finite()),
            "a map of vertices must keep them finite"
        );
        Self {
            vertices,
            triangles: self.triangles.clone(),
        }
    }

    /// The mesh with every triangle wound the other way: inside and outside exchanged.
    #[must_use]
    pub fn flipped(&self) -> Self {
        Self {
            vertices: self.vertices.clone(),
            triangles: self.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect(),
        }
    }

    /// Adds the triangles of another mesh; no vertices are shared.
    ///
    /// # Errors
    /// [`MeshError::TooMany`] when together they have more vertices than an index can name.
    pub fn append(&mut self, other: &Self) -> Result<(), MeshError> {
        let total = self.vertices.len() + other.vertices.len();
        if total > u32::MAX as usize {
            return Err(MeshError::TooMany(total));
        }
        let shift = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        let moved = other.triangles.iter().map(|t| t.map(|v| v + shift));
        self.triangles.extend(moved);
        Ok(())
    }

    /// The mesh with some triangles wound the other way; one flag per triangle.
    fn with_turned(mut self, turned: &[bool]) -> Self {
        for (t, _) in self.triangles.iter_mut().zip(turned).filter(|t| *t.1) {
            t.swap(1, 2);
        }
        self
    }

    /// The mesh with vertices of identical coordinates made one and unused ones left out, in order
    /// of first use; triangles keep their order and number, those that collapse included.
    #[must_use]
    pub fn merged(&self) -> Self {
        let mut merger = Merger::default();
        let triangles = self.iter_corners().map(|t| t.map(|p| merger.add(p)));
        let triangles = triangles.collect();
        Self {
            vertices: merger.vertices,
            triangles,
        }
    }

    /// Every undirected edge once, as vertex numbers in rising order, sorted; edges of zero length
    /// by index are left out.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let sides = self
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let mut edges: Vec<[u32; 2]> = sides
            .filter(|e| e[0] != e[1])
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }
}

/// Whether triangles name vertices that are there, with finite coordinates.
fn validate(vertices: &[Vec3], triangles: impl Iterator<Item = [u32; 3]>) -> Result<(), MeshError> {
    let count = vertices.len();
    if count > u32::MAX as usize {
        return Err(MeshError::TooMany(count));
    }
    for (vertex, v) in vertices.iter().enumerate() {
        if let Some(&value) = v.iter().find(|c| !c.is_finite()) {
            return Err(MeshError::NotFinite { vertex, value });
        }
    }
    for (triangle, t) in triangles.enumerate() {
        if let Some(&index) = t.iter().find(|&&i| i as usize >= count) {
            return Err(MeshError::NoSuchVertex {
                triangle,
                index,
                count,
            });
        }
    }
    Ok(())
}

/// Mixes the bits of coordinates: keys are few words, and nobody chooses them to collide.
#[derive(Clone, Copy, Default)]
struct BitHasher(u64);

impl Hasher for BitHasher {
    fn finish(&self) -> u64 {
        self.0 ^ self.0 >> 32
    }

    fn write(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.write_u64(u64::from_ne_bytes(word));
        }
    }

    fn write_u64(&mut self, word: u64) {
        let mixed = (self.0.rotate_left(5) ^ word ^ word >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ mixed >> 29;
    }

    fn write_usize(&mut self, _: usize) {}
}

/// Makes vertices of identical coordinates one, in order of first appearance.
#[derive(Default)]
pub(crate) struct Merger {
    index: HashMap<[u64; 3], u32, BuildHasherDefault<BitHasher>>,
    pub(crate) vertices: Vec<Vec3>,
}

impl Merger {
    /// The number of the vertex at `p`; there must be fewer than 2^32 of them.
    pub(crate) fn add(&mut self, p: Vec3) -> u32 {
        // Adding zero makes -0 equal to 0.
        let key = [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits());
        *self.index.entry(key).or_insert_with(|| {
            self.vertices.push(p);
            (self.vertices.len() - 1) as u32
        })
    }
}
