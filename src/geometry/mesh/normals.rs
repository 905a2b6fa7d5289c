//! Vertex normals of a mesh.
//!
//! Normals point outward if the triangles are counter-clockwise seen from outside. The area-weighted sums run in
//! parallel by ranges of vertices, each in the order of the triangles, so that the bits do not depend on the number of
//! threads.

use super::TriMesh;
use crate::frame::Vec3;
use rayon::prelude::*;

/// Triangles whose vertices' numbers are bounded together.
const TRIANGLES_PER_BLOCK: usize = 1 << 12;
/// Parts in which normals are summed: few, as each reads all triangles if vertices are in no order.
const MAX_PARTS: usize = 16;
const MIN_VERTICES_PER_PART: usize = 1 << 14;

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
        normalize(&mut normals);
        normals
    }

    /// As [`TriMesh::vertex_normals`], weighted by area: for meshes whose triangles differ much in size, where
    /// the normals of the smallest are unreliable.
    pub fn vertex_normals_by_area(&self) -> Vec<Vec3> {
        // The least and greatest vertex of a block of triangles, by which parts skip blocks.
        let span = |triangles: &[[u32; 3]]| {
            let all = triangles.as_flattened().iter();
            let ends = (u32::MAX, 0);
            all.fold(ends, |(low, high), &v| (low.min(v), high.max(v)))
        };
        let blocks = self.triangles.par_chunks(TRIANGLES_PER_BLOCK);
        let spans: Vec<(u32, u32)> = blocks.map(span).collect();
        let mut normals = vec![Vec3::zeros(); self.vertices.len()];
        let count = (normals.len() / MAX_PARTS).max(MIN_VERTICES_PER_PART);
        let parts = normals.par_chunks_mut(count).enumerate();
        parts.for_each(|(n, part)| {
            let first = n * count;
            let last = first + part.len() - 1;
            let blocks = self.triangles.chunks(TRIANGLES_PER_BLOCK).zip(&spans);
            let meets = |low: u32, high: u32| low as usize <= last && high as usize >= first;
            for (block, _) in blocks.filter(|(_, span)| meets(span.0, span.1)) {
                for t in block.iter().filter(|t| t.iter().any(|&v| meets(v, v))) {
                    let [a, b, c] = t.map(|v| self.vertices[v as usize]);
                    let normal = (b - a).cross(&(c - a));
                    // Vertices of other parts have no place in this one: those before `first` wrap around.
                    for &v in t {
                        if let Some(sum) = part.get_mut((v as usize).wrapping_sub(first)) {
                            *sum += normal;
                        }
                    }
                }
            }
            normalize(part);
        });
        normals
    }
}

/// Scales vectors to length 1; zero vectors remain zero.
fn normalize(vectors: &mut [Vec3]) {
    for v in vectors {
        *v = v.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
    }
}
