//! Domes: edges quartered, then seven rings after Doo and Sabin's rule, each scaled and lifted.
//!
//! `old` is the mesh with its connectivity; corner c is the half-edge from its vertex to the next one of its face.
//! Faces of class 1 are the caps, those of class 2 the quads between rings.

use super::weight::{doo_sabin, weighted};
use super::{MeshBuilder, Old, RuleResult};
use druse_geometry::frame::Vec3;

/// Rings from the base upward: lift above the ring below in mean edges of the face, and scale about the ring's centre.
/// Doo and Sabin's rule shrinks a ring, which scales above 1 undo. The last ring closes the dome almost to a point.
const RINGS: [(f64, f64); 7] = [
    (0.0, 1.6),
    (0.3, 1.7),
    (0.18, 1.6),
    (0.1, 1.4),
    (0.05, 1.2),
    (0.025, 1.1),
    (0.01, 0.01),
];

/// A dome over every face, `p` = (factor on heights, factor on scales): V' = V + 59E, E' = 116E, F' = F + 56E.
pub(super) fn dome(old: &Old, p: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::with_old_vertices(old);
    let quarter = s.points(
        old.edge_corners()
            .flat_map(|c| [0.25, 0.5, 0.75].map(|t| old.along(c, t))),
    );
    let mut caps = Vec::new();
    let mut sides = Vec::new();
    for f in 0..old.faces() {
        let (normal, length) = (old.mesh.normal(f), old.length(f));
        // The loop of the face with three points on each edge. The second face of an edge runs through them backwards.
        let mut below: Vec<u32> = old
            .span(f)
            .flat_map(|c| {
                let first = quarter + 3 * old.edge(c);
                let forward = old.side(c).is_multiple_of(2);
                let [a, b] = if forward {
                    [first, first + 2]
                } else {
                    [first + 2, first]
                };
                [old.ring.vertex(c) as u32, a, first + 1, b]
            })
            .collect();
        // Each ring is a Doo-Sabin image of the one below, scaled about its centre and lifted along the
        // normal by a share of the mean edge. Quads join the two.
        for (height, scale) in RINGS {
            let points: Vec<Vec3> = below.iter().map(|&v| s.vertices[v as usize]).collect();
            let n = points.len();
            let ring = weighted(&points, doo_sabin(n));
            let centre = ring.iter().sum::<Vec3>() / n as f64;
            let lift = height * p[0] * length * normal;
            let first = s.points(
                ring.iter()
                    .map(|r| centre + p[1] * scale * (r - centre) + lift),
            );
            let above: Vec<u32> = (0..n as u32).map(|k| first + k).collect();
            for k in 0..n {
                let j = (k + 1) % n;
                sides.push((f as u32, [below[k], below[j], above[j], above[k]]));
            }
            below = above;
        }
        caps.push(below);
    }
    // Classes in order: all caps, then all sides.
    for (f, cap) in caps.into_iter().enumerate() {
        s.face(1, f as u32, cap);
    }
    for (f, side) in sides {
        s.face(2, f, side);
    }
    Ok(s)
}
