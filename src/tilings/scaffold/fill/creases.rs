//! Creases and corners of a surface.
//!
//! A crease is an edge at which the surface turns by more than 30 degrees, or at which not two triangles
//! meet. Creases are joined to lines; their ends, branchings and sharp turns are corners.

use druse_geometry::frame::{Aabb, Vec3};
use druse_geometry::mesh::{Bvh, MeshSolid, TriMesh};
use std::collections::BTreeMap;

/// Cosine of the angle above which a surface has a crease and a crease a corner: 30 degrees.
const CREASE_COSINE: f64 = 0.866_025_403_784_438_6;
/// Triangles of less height, as a share of their longest side, have no reliable normal.
const MIN_HEIGHT: f64 = 1e-5;

/// A crease between two corners, or a closed one.
pub(super) struct Line {
    /// The points along it; a closed one ends at its first point.
    pub points: Vec<Vec3>,
    /// The length from the first point to each, world units.
    pub lengths: Vec<f64>,
    /// Whether its ends are no corners but one point.
    pub is_closed: bool,
}

impl Line {
    fn new(points: Vec<Vec3>, is_closed: bool) -> Self {
        let mut lengths = vec![0.0];
        for pair in points.windows(2) {
            lengths.push(lengths[lengths.len() - 1] + (pair[1] - pair[0]).norm());
        }
        Self {
            points,
            lengths,
            is_closed,
        }
    }

    pub fn length(&self) -> f64 {
        self.lengths[self.lengths.len() - 1]
    }

    /// The point at a length along the line. Lengths beyond an end give the end.
    pub fn at(&self, length: f64) -> Vec3 {
        let above = self.lengths.partition_point(|&l| l < length);
        let i = above.clamp(1, self.points.len() - 1);
        let (from, to) = (self.lengths[i - 1], self.lengths[i]);
        let t = ((length - from) / (to - from)).clamp(0.0, 1.0);
        // The ends exactly, because corners are shared.
        if t <= 0.0 {
            self.points[i - 1]
        } else if t >= 1.0 {
            self.points[i]
        } else {
            self.points[i - 1] + (self.points[i] - self.points[i - 1]) * t
        }
    }
}

/// The creases and corners of a surface.
pub(super) struct Creases {
    pub lines: Vec<Line>,
    pub corners: Vec<Vec3>,
    /// The straight parts of all lines, with the numbers of their lines.
    parts: Vec<([Vec3; 2], u32)>,
    tree: Bvh,
}

impl Creases {
    /// The creases of a solid's surface. Lines begin at corners; a closed line without one begins at its lowest vertex.
    pub(super) fn of(solid: &MeshSolid) -> Self {
        let (edges, places) = crease_edges(solid);
        // The crease edges at each vertex.
        let mut neighbours: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for &[a, b] in &edges {
            neighbours.entry(a).or_default().push(b);
            neighbours.entry(b).or_default().push(a);
        }
        let at = |n: u32| places[n as usize];
        // A corner has another number of edges than two, or a sharp turn.
        let is_corner = |n: u32| {
            let [a, b] = neighbours[&n][..] else {
                return true;
            };
            let (u, v) = (at(n) - at(a), at(b) - at(n));
            u.dot(&v) <= CREASE_COSINE * u.norm() * v.norm()
        };
        let corners: Vec<u32> = neighbours
            .keys()
            .copied()
            .filter(|&n| is_corner(n))
            .collect();
        let mut lines = Vec::new();
        let mut is_used: BTreeMap<[u32; 2], bool> = edges.iter().map(|&e| (e, false)).collect();
        // First from every corner, then the rest: closed lines without corners.
        let starts = corners.iter().copied().chain(neighbours.keys().copied());
        for start in starts {
            // Follow the edges to the next corner, or around to the start; each edge is used once.
            for &first in &neighbours[&start] {
                let mut points = vec![start];
                let (mut here, mut next) = (start, first);
                loop {
                    let used = is_used.get_mut(&[here.min(next), here.max(next)]);
                    if std::mem::replace(used.expect("it is an edge"), true) {
                        break;
                    }
                    points.push(next);
                    if next == start || corners.binary_search(&next).is_ok() {
                        break;
                    }
                    let around_next = &neighbours[&next];
                    let after = if around_next[0] == here {
                        around_next[1]
                    } else {
                        around_next[0]
                    };
                    (here, next) = (next, after);
                }
                if points.len() > 1 {
                    let is_closed = points[0] == points[points.len() - 1]
                        && corners.binary_search(&points[0]).is_err();
                    lines.push(Line::new(points.into_iter().map(at).collect(), is_closed));
                }
            }
        }
        let parts: Vec<([Vec3; 2], u32)> = (0u32..)
            .zip(&lines)
            .flat_map(|(n, line)| line.points.windows(2).map(move |p| ([p[0], p[1]], n)))
            .collect();
        Self {
            tree: Bvh::new(parts.len(), |i| Aabb::of(parts[i].0)),
            corners: corners.into_iter().map(at).collect(),
            lines,
            parts,
        }
    }

    /// Whether there is no crease.
    pub(super) fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// The nearest point of the creases, or of one line; `p` itself if there is none.
    pub(super) fn nearest(&self, p: Vec3, line: Option<u32>) -> Vec3 {
        let mut best = (f64::INFINITY, p);
        self.tree.nearest(p, best.0, |slot| {
            let ([a, b], part_line) = self.parts[self.tree.order()[slot] as usize];
            if line.is_some_and(|l| l != part_line) {
                return None;
            }
            let along = b - a;
            let t = ((p - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            let q = a + along * t;
            let distance = (p - q).norm();
            (distance < best.0).then(|| {
                best = (distance, q);
                distance
            })
        });
        best.1
    }
}

/// The unit normal of a triangle, zero for one that is too thin.
pub(super) fn normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    let n = (b - a).cross(&(c - a));
    let longest = [b - a, c - b, a - c]
        .iter()
        .fold(0.0, |l: f64, s| l.max(s.norm_squared()));
    if n.norm() > MIN_HEIGHT * longest {
        n.normalize()
    } else {
        Vec3::zeros()
    }
}

/// Edges with a crease or without exactly two triangles, as ascending numbers of vertices, and the places of all
/// vertices. Corners of equal coordinates count as one vertex.
fn crease_edges(solid: &MeshSolid) -> (Vec<[u32; 2]>, Vec<Vec3>) {
    let corners: Vec<Vec3> = solid.surface().flat_map(|(c, _)| c).collect();
    let triangles = (0..corners.len() as u32 / 3)
        .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
        .collect();
    let mesh = TriMesh::new_unchecked(corners, triangles).merged();
    let mut normals: Vec<Vec3> = mesh.iter_corners().map(normal).collect();
    // Each edge of each triangle; sorted, the triangles at an edge are beside each other.
    let mut sides: Vec<([u32; 2], u32)> = Vec::new();
    for (t, &[a, b, c]) in (0u32..).zip(mesh.triangles()) {
        let triangle_edges = [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)]);
        sides.extend(
            triangle_edges
                .into_iter()
                .filter(|[p, q]| p < q)
                .map(|e| (e, t)),
        );
    }
    sides.sort_unstable();
    // A needle has the normal of the triangle beyond its longest side; needles may lie in rows.
    // Four passes suffice for rows of needles as triangulations of CAD make them.
    for _ in 0..4 {
        let before = normals.clone();
        for pair in sides.chunk_by(|a, b| a.0 == b.0) {
            let [(edge, s), (_, t)] = pair[..] else {
                continue;
            };
            for (needle, other) in [(s, t), (t, s)] {
                let length = |[a, b]: [u32; 2]| {
                    (mesh.vertices()[a as usize] - mesh.vertices()[b as usize]).norm()
                };
                let [a, b, c] = mesh.triangles()[needle as usize];
                let longest = length([a, b]).max(length([b, c])).max(length([c, a]));
                if before[needle as usize] == Vec3::zeros() && length(edge) == longest {
                    normals[needle as usize] = before[other as usize];
                }
            }
        }
    }
    let is_crease = |pair: &[([u32; 2], u32)]| match *pair {
        [(_, s), (_, t)] => {
            // An angle of 30 degrees up to rounding is none.
            normals[s as usize].dot(&normals[t as usize]) < CREASE_COSINE - 1e-9
                && normals[s as usize] != Vec3::zeros()
                && normals[t as usize] != Vec3::zeros()
        }
        _ => true,
    };
    let pairs = sides.chunk_by(|a, b| a.0 == b.0);
    let edges = pairs.filter(|p| is_crease(p)).map(|p| p[0].0).collect();
    (edges, mesh.vertices().to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_has_twelve_creases_and_eight_corners() {
        let block = TriMesh::cuboid(&Aabb::of([Vec3::zeros(), Vec3::new(1.0, 2.0, 3.0)]));
        let creases = Creases::of(&MeshSolid::new(block));
        assert_eq!((creases.lines.len(), creases.corners.len()), (12, 8));
        let total: f64 = creases.lines.iter().map(Line::length).sum();
        assert!((total - 24.0).abs() < 1e-12);
        let near = creases.nearest(Vec3::new(0.1, 1.0, -0.2), None);
        assert!((near - Vec3::new(0.0, 1.0, 0.0)).norm() < 1e-12);
    }
}
