//! Closed meshes of simple solids, oriented outward.
//!
//! Positive sizes are assumed, not checked: a box with exchanged corners is turned inside out.

use super::{TriMesh, VertexMerger};
use crate::frame::{Aabb, Vec3};

impl TriMesh {
    /// A box as twelve triangles. They are counter-clockwise seen from outside.
    pub fn cuboid(bounds: &Aabb) -> Self {
        let corner = |i: usize| {
            Vec3::from_fn(|a, _| {
                if i >> a & 1 == 0 {
                    bounds.min[a]
                } else {
                    bounds.max[a]
                }
            })
        };
        // Bit a of a corner's number selects the greater end of axis a.
        let quads = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        Self {
            vertices: (0..8).map(corner).collect(),
            triangles: quads
                .iter()
                .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
                .collect(),
        }
    }

    /// A sphere: an octahedron subdivided `levels` times, `8 * 4^levels` triangles with their corners on the
    /// sphere.
    pub fn ball(centre: Vec3, radius: f64, levels: u32) -> Self {
        let axis = |a: usize, s: f64| Vec3::ith(a, s);
        let mut triangles: Vec<[Vec3; 3]> = Vec::new();
        // The faces of an octahedron, counter-clockwise seen from outside.
        for sx in [1.0, -1.0] {
            for sy in [1.0, -1.0] {
                for sz in [1.0, -1.0] {
                    let (x, y, z) = (axis(0, sx), axis(1, sy), axis(2, sz));
                    triangles.push(if sx * sy * sz > 0.0 {
                        [x, y, z]
                    } else {
                        [x, z, y]
                    });
                }
            }
        }
        // Each triangle becomes four, with the middles of its sides moved to the sphere.
        for _ in 0..levels {
            triangles = triangles
                .into_iter()
                .flat_map(|[a, b, c]| {
                    let [ab, bc, ca] = [a + b, b + c, c + a].map(|m| m.normalize());
                    [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
                })
                .collect();
        }
        // Corners that triangles share become one vertex; equal sums give equal bits.
        let mut merger = VertexMerger::default();
        let triangles = triangles.iter().map(|t| t.map(|p| merger.add(p))).collect();
        Self {
            vertices: merger
                .vertices
                .iter()
                .map(|p| centre + p * radius)
                .collect(),
            triangles,
        }
    }
}
