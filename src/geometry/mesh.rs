//! Triangle meshes: measures, checks, repair, collapse, projection, skins, point clouds, signed distance.
//!
//! A [`TriMesh`] holds vertices in `f64` and triangles as vertex indices, counter-clockwise seen from
//! outside; its owner defines unit and frame. It may be open, self-intersecting or non-manifold:
//! only indices and finite coordinates are validated.
//!
//! ```
//! # extern crate druse_geometry as druse;
//! use druse::frame::Aabb;
//! use druse::mesh::TriMesh;
//! let cube = TriMesh::cuboid(&Aabb::of([[0.0; 3].into(), [2.0; 3].into()]));
//! assert_eq!((cube.volume(), cube.area()), (8.0, 24.0));
//! assert_eq!(cube.flipped().volume(), -8.0);
//! ```

use crate::frame::{Aabb, Vec3, is_in_range};
use rayon::prelude::*;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

mod boundary_edges;
mod bvh;
mod check;
mod cloud;
mod collapse;
mod components;
mod cracks;
mod crossing;
mod falloff;
mod half_edges;
mod intersect;
mod last_results;
mod lattice;
mod meeting;
mod normals;
mod open_winding;
mod openness;
mod pieces;
mod plates;
mod precision;
mod projection;
mod quads;
mod repair;
mod repeated;
mod rows;
mod shapes;
mod shells;
mod skin;
mod sliver;
mod solid;
mod soup;
mod triangle;
mod unite;
mod winding;

#[doc(hidden)]
pub use bvh::Bvh;
pub use check::{Defect, Finding, MeshReport, check};
#[doc(hidden)]
pub use check::{SelfIntersections, check_with};
pub use cloud::{CloudError, CloudSolid};
#[doc(hidden)]
pub use collapse::{CollapseGoal, collapsed};
#[doc(hidden)]
pub use components::{MeshComponent, is_closed, mesh_components};
pub use openness::{Hole, NoSolidError, Openness};
pub use projection::{ProjectionOptions, ProjectionSummary, VertexProjection};
pub use quads::QuadMesh;
#[doc(hidden)]
pub use quads::split_quads;
pub use repair::{Repair, RepairKind, ShellReport};
#[doc(hidden)]
pub use shells::count_bodies;
pub use skin::{Side, Skin};
pub use solid::MeshSolid;
pub use soup::ClosestPoint;
#[doc(hidden)]
pub use soup::TriangleDistances;
#[doc(hidden)]
pub use triangle::closest_point;

/// Vertices of a parallel task: enough to outweigh its start.
const CHUNK_VERTICES: usize = 1 << 14;

/// Why vertices and triangles form no mesh.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// A triangle or quad refers to a vertex that does not exist.
    #[error("face {face} names vertex {index}; expected one of 0 to {}", *count as i64 - 1)]
    NoSuchVertex {
        /// Number of the triangle or quad, from 0.
        face: usize,
        /// The index of the missing vertex.
        index: u32,
        /// The number of vertices.
        count: usize,
    },
    /// A coordinate is infinite, not a number or too large.
    #[error("vertex {vertex} has the coordinate {value}; expected a finite number below 1e18")]
    NotFinite {
        /// Number of the vertex, from 0.
        vertex: usize,
        /// The coordinate.
        value: f64,
    },
    /// More vertices than 32-bit indices can address.
    #[error("{0} vertices; expected at most 4294967295")]
    TooMany(usize),
}

/// The result of [`TriMesh::measures`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshMeasures {
    /// The bounding box of the triangles; empty for an empty mesh.
    pub bounds: Aabb,
    /// As [`TriMesh::volume`].
    pub volume: f64,
    /// As [`TriMesh::area`].
    pub area: f64,
}

/// Triangles over shared vertices; only indices in range and finite coordinates are guaranteed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// A mesh from vertices and triangles (counter-clockwise seen from outside).
    ///
    /// # Errors
    /// [`MeshError`]: an index out of range, a coordinate not below 1e18, or more vertices than 32 bits can number.
    pub fn new(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        validate(&vertices, &triangles)?;
        Ok(Self {
            vertices,
            triangles,
        })
    }

    /// As [`TriMesh::new`] for indices and coordinates that are known to be valid.
    #[doc(hidden)]
    pub fn new_unchecked(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        debug_assert!(validate(&vertices, &triangles).is_ok());
        Self {
            vertices,
            triangles,
        }
    }

    /// The vertices; some may belong to no triangle.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// The triangles as vertex indices.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Whether the mesh has no triangle.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The three corners of triangle `t`.
    #[inline]
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        // Written out, since `array::map` is slow in loops over large meshes.
        let [a, b, c] = self.triangles[t];
        [
            self.vertices[a as usize],
            self.vertices[b as usize],
            self.vertices[c as usize],
        ]
    }

    /// The corners of every triangle, in order.
    pub fn iter_corners(&self) -> impl ExactSizeIterator<Item = [Vec3; 3]> + '_ {
        (0..self.triangles.len()).map(|t| self.corners(t))
    }

    /// The bounding box of the triangles; empty for an empty mesh.
    pub fn bounds(&self) -> Aabb {
        let corners = self.triangles.iter().flatten();
        Aabb::of(corners.map(|&v| self.vertices[v as usize]))
    }

    /// The bounding box of the vertices, those of no triangle too; empty without any.
    #[doc(hidden)]
    pub fn vertex_bounds(&self) -> Aabb {
        let boxes = self.boxes_of_chunks();
        boxes.into_iter().fold(Aabb::EMPTY, Aabb::union)
    }

    /// The bounding box of each [`CHUNK_VERTICES`] vertices.
    fn boxes_of_chunks(&self) -> Vec<Aabb> {
        let chunks = self.vertices.par_chunks(CHUNK_VERTICES);
        chunks.map(|c| Aabb::of(c.iter().copied())).collect()
    }

    /// As [`TriMesh::bounds`]. The box of all vertices takes less time, and is that of the triangles if at each of its
    /// six sides a vertex belongs to one. Otherwise the corners of all triangles are read.
    fn bounds_in_parallel(&self) -> Aabb {
        let boxes = self.boxes_of_chunks();
        let all = boxes.iter().copied().fold(Aabb::EMPTY, Aabb::union);
        let is_used = |side: usize| {
            let coordinate = |b: &Aabb| [b.min, b.max][side % 2][side / 2];
            let end = coordinate(&all);
            let Some(chunk) = boxes.iter().position(|b| coordinate(b) == end) else {
                return true; // There are no vertices.
            };
            let start = chunk * CHUNK_VERTICES;
            let mut vertices = self.vertices[start..].iter();
            let found = vertices.position(|v| v[side / 2] == end);
            let vertex = found.map(|n| (start + n) as u32);
            vertex.is_some_and(|v| self.triangles.par_iter().any(|t| t.contains(&v)))
        };
        if (0..6).all(is_used) {
            all
        } else {
            self.bounds()
        }
    }

    /// The enclosed signed volume by the divergence theorem: positive when the triangles wind
    /// counter-clockwise seen from outside. Meaningful for closed meshes only.
    pub fn volume(&self) -> f64 {
        let o = self.reference();
        let six_volumes: f64 = self
            .iter_corners()
            .map(|[a, b, c]| (a - o).dot(&(b - o).cross(&(c - o))))
            .sum();
        six_volumes / 6.0
    }

    /// The sum of the triangles' areas.
    pub fn area(&self) -> f64 {
        let two_areas: f64 = self
            .iter_corners()
            .map(|[a, b, c]| (b - a).cross(&(c - a)).norm())
            .sum();
        two_areas / 2.0
    }

    /// Bounding box, volume and area at once, in parallel. Chunks of fixed size are summed in order, so the
    /// result does not depend on the number of threads.
    pub fn measures(&self) -> MeshMeasures {
        self.measures_about(None)
    }

    /// As [`TriMesh::measures`], for a part of a closed surface: volumes of parts about the same point add up to the
    /// volume of the whole. `point` is that common point; `None` takes the middle of the box.
    #[doc(hidden)]
    pub fn measures_about(&self, point: Option<Vec3>) -> MeshMeasures {
        // Chunks of a fixed length: the sums do not depend on the number of threads.
        const CHUNK_TRIANGLES: usize = 1 << 14;
        let chunks = self.triangles.par_chunks(CHUNK_TRIANGLES);
        let bounds = self.bounds_in_parallel();
        // Volumes about a point nearby are small, so that their sum keeps its digits.
        let centre = || {
            if bounds.is_empty() {
                Vec3::zeros()
            } else {
                bounds.centre().0
            }
        };
        let origin = point.unwrap_or_else(centre);
        let sums: Vec<[f64; 2]> = chunks
            .map(|chunk| {
                let corners = chunk.iter().map(|t| t.map(|v| self.vertices[v as usize]));
                corners.fold([0.0; 2], |[six_volumes, two_areas], [a, b, c]| {
                    // (a - o).n / 6 is the volume of the tetrahedron from the origin, |n| / 2 the triangle's area.
                    let normal = (b - a).cross(&(c - a));
                    [
                        six_volumes + (a - origin).dot(&normal),
                        two_areas + normal.norm(),
                    ]
                })
            })
            .collect();
        let [six_volumes, two_areas] = sums
            .iter()
            .fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        MeshMeasures {
            bounds,
            volume: six_volumes / 6.0,
            area: two_areas / 2.0,
        }
    }

    /// The centre of the bounding box: the origin for measures, so that meshes far from zero lose no digits.
    fn reference(&self) -> Vec3 {
        let b = self.bounds();
        if b.is_empty() {
            Vec3::zeros()
        } else {
            b.centre().0
        }
    }

    /// The mesh with every vertex mapped; a reflection also reverses the orientation (see [`TriMesh::flipped`]).
    ///
    /// # Panics
    /// When the map returns a coordinate that is not finite.
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

    /// The mesh with every triangle reversed: inside and outside exchanged.
    #[must_use]
    pub fn flipped(&self) -> Self {
        Self {
            vertices: self.vertices.clone(),
            triangles: self.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect(),
        }
    }

    /// Appends the triangles of another mesh; no vertices are shared.
    ///
    /// # Errors
    /// [`MeshError::TooMany`] when both meshes together have more vertices than 32-bit indices can address.
    pub fn append(&mut self, other: &Self) -> Result<(), MeshError> {
        let total = self.vertices.len() + other.vertices.len();
        if total > u32::MAX as usize {
            return Err(MeshError::TooMany(total));
        }
        let offset = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        let shifted = other.triangles.iter().map(|t| t.map(|v| v + offset));
        self.triangles.extend(shifted);
        Ok(())
    }

    /// The mesh with some triangles reversed; one flag per triangle.
    fn with_flipped(mut self, is_flipped: &[bool]) -> Self {
        for (t, _) in self.triangles.iter_mut().zip(is_flipped).filter(|t| *t.1) {
            t.swap(1, 2);
        }
        self
    }

    /// The mesh with vertices of identical coordinates merged and unused vertices removed, in order
    /// of first use; triangles keep their order and number, degenerate ones included.
    #[must_use]
    pub fn merged(&self) -> Self {
        let mut merger = VertexMerger::default();
        let triangles = self.iter_corners().map(|t| t.map(|p| merger.add(p)));
        let triangles = triangles.collect();
        Self {
            vertices: merger.vertices,
            triangles,
        }
    }

    /// Every undirected edge once, as ascending vertex indices, sorted; edges from a vertex to itself are left out.
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

/// Checks the number of vertices, then the range of coordinates, then that of indices. The first fault is the result.
fn validate<const N: usize>(vertices: &[Vec3], faces: &[[u32; N]]) -> Result<(), MeshError> {
    let count = vertices.len();
    if count > u32::MAX as usize {
        return Err(MeshError::TooMany(count));
    }
    for (vertex, v) in vertices.iter().enumerate() {
        if let Some(&value) = v.iter().find(|c| !is_in_range(**c)) {
            return Err(MeshError::NotFinite { vertex, value });
        }
    }
    for (face, corners) in faces.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|&&i| i as usize >= count) {
            return Err(MeshError::NoSuchVertex { face, index, count });
        }
    }
    Ok(())
}

/// Hashes the bits of coordinates by multiplication with 2^64 over the golden ratio: fast for short keys, without
/// protection against adversarial input.
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

    /// The length of a key, which all keys share.
    fn write_usize(&mut self, _: usize) {}
}

/// Merges vertices of identical coordinates, in order of first appearance.
#[derive(Default)]
#[doc(hidden)]
pub struct VertexMerger {
    index: HashMap<[u64; 3], u32, BuildHasherDefault<BitHasher>>,
    #[doc(hidden)]
    pub vertices: Vec<Vec3>,
}

impl VertexMerger {
    /// The index of the vertex at `p`; there must be fewer than 2^32 vertices.
    #[doc(hidden)]
    pub fn add(&mut self, p: Vec3) -> u32 {
        // Adding zero makes -0 equal to 0.
        let key = [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits());
        *self.index.entry(key).or_insert_with(|| {
            self.vertices.push(p);
            (self.vertices.len() - 1) as u32
        })
    }
}
