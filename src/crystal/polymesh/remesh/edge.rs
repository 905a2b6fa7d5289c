//! Schemes that put points on the edges, some of them with further points in the faces that follow from these.
//!
//! The function of a scheme takes the old mesh and the values `p` of its parameters in the order of the table. V, E, F
//! are the numbers of old vertices, edges and faces, with a prime those of the result. Corner c is the half-edge from
//! its vertex to the next one of its face.

use super::face::neighbours;
use super::weight::{honeycomb as honeycomb_weight, weighted};
use super::{MeshBuilder, NO_PARENT, Old, RuleResult};
use druse_geometry::frame::Vec3;
use std::f64::consts::TAU;

/// Midpoints of edges joined round faces and vertices. V' = E, E' = 2E, F' = F + V.
pub(super) fn simplest(old: &Old, _: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::new(old.edge_corners().map(|c| old.along(c, 0.5)).collect());
    for f in 0..old.faces() {
        s.face(1, f as u32, old.span(f).map(|c| old.edge(c)));
    }
    for v in 0..old.vertices() {
        s.face(2, NO_PARENT, old.ring.around(v).map(|c| old.edge(c)));
    }
    Ok(s)
}

/// Corners cut off at the share p = (offset) of each edge, from either end. V' = 2E, E' = 3E, F' = F + V.
pub(super) fn vertex_truncation(old: &Old, p: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::new(old.edge_point_pairs(p[0]).collect());
    for f in 0..old.faces() {
        let ends = |c: usize| [old.side(c), old.side(old.twin(c))];
        s.face(1, f as u32, old.span(f).flat_map(ends));
    }
    for v in 0..old.vertices() {
        s.face(2, NO_PARENT, old.ring.around(v).map(|c| old.side(c)));
    }
    Ok(s)
}

/// A polygon from weighted middles in every face, polygons of twice the degree round vertices.
/// V' = 2E, E' = 3E, F' = F + V.
pub(super) fn honeycomb(old: &Old, _: &[f64]) -> RuleResult {
    let mut vertices = Vec::with_capacity(old.corners());
    for f in 0..old.faces() {
        let middles: Vec<Vec3> = old.span(f).map(|c| old.along(c, 0.5)).collect();
        vertices.extend(weighted(&middles, honeycomb_weight(middles.len())));
    }
    let mut s = MeshBuilder::new(vertices);
    s.inner_faces(old, 0);
    for v in 0..old.vertices() {
        let pair = |c: usize| [c as u32, old.ring.prior(c) as u32];
        s.face(2, NO_PARENT, old.ring.around(v).flat_map(pair));
    }
    Ok(s)
}

/// Midpoints joined in every face: triangles at the corners. V' = V + E, E' = 4E, F' = F + 2E.
///
/// Old vertices move to `length` v + (1 - `length`) mean(middles around), p = (length).
pub(super) fn loop_style(old: &Old, p: &[f64]) -> RuleResult {
    let vertices = (0..old.vertices()).map(|v| {
        let point = old.mesh.vertices()[v];
        let mean = (neighbours(old, v).0 + point) / 2.0;
        p[0] * point + (1.0 - p[0]) * mean
    });
    let mut s = MeshBuilder::new(vertices.collect());
    let middle = s.points(old.edge_corners().map(|c| old.along(c, 0.5)));
    split(&mut s, old, middle);
    Ok(s)
}

/// Adds n + 1 faces per n-gon: the inner face of midpoints (class 1) and a triangle at each corner (class 2).
/// `middle` is the number of the first midpoint; midpoints have the order of edges.
fn split(s: &mut MeshBuilder, old: &Old, middle: u32) {
    for f in 0..old.faces() {
        s.face(1, f as u32, old.span(f).map(|c| middle + old.edge(c)));
    }
    for c in 0..old.corners() {
        let v = old.ring.vertex(c) as u32;
        let (out, back) = (old.edge(c), old.edge(old.ring.prior(c)));
        s.face(2, old.ring.face[c], [v, middle + out, middle + back]);
    }
}

/// Loop's scheme (1987): edge points 3/8 (a + b) + 1/16 of the four face neighbours, vertices of k neighbours
/// (1 - w) v + w mean(neighbours), w = 5/8 - (3/8 + cos(2 pi/k)/4)^2.
pub(super) fn loop_smooth(old: &Old, _: &[f64]) -> RuleResult {
    let vertices = (0..old.vertices()).map(|v| {
        let (mean, k) = neighbours(old, v);
        let w = 0.625 - (0.375 + 0.25 * (TAU / k).cos()).powi(2);
        (1.0 - w) * old.mesh.vertices()[v] + w * mean
    });
    let mut s = MeshBuilder::new(vertices.collect());
    let middle = s.points(old.edge_corners().map(|c| {
        let beside = |c: usize| {
            let (before, after) = (old.ring.prior(c), old.ring.after(old.ring.after(c)));
            old.ring.at(before) + old.ring.at(after)
        };
        0.75 * old.along(c, 0.5) + (beside(c) + beside(old.twin(c))) / 16.0
    }));
    split(&mut s, old, middle);
    Ok(s)
}

/// Two points an edge, an inner polygon in every face, quads between: a checkerboard.
/// V' = V + 4E, E' = 9E, F' = F + 4E.
///
/// The inner corner of v is v + t (before - v) + t (after - v), p = (t). At a reflex corner the shift is reversed; at
/// a straight corner it points inward, normal to the edge, by t times the mean length of its two edges.
pub(super) fn checkerboard(old: &Old, p: &[f64]) -> RuleResult {
    let t = p[0];
    let mut s = MeshBuilder::with_old_vertices(old);
    let point = s.points(old.edge_point_pairs(t));
    let mut inner_points = Vec::with_capacity(old.corners());
    // Inner corners of each face, by the rules above.
    for f in 0..old.faces() {
        let normal = old.mesh.normal(f);
        for c in old.span(f) {
            let v = old.ring.at(c);
            let out = old.along(c, 1.0) - v;
            let back = old.ring.at(old.ring.prior(c)) - v;
            let turn = out.cross(&back).dot(&normal);
            let scale = out.norm() * back.norm();
            // Straight: a sine below 1e-9 with edges that run apart.
            let shift = if turn.abs() <= 1e-9 * scale && out.dot(&back) < 0.0 {
                let length = f64::midpoint(out.norm(), back.norm());
                normal.cross(&(out - back)).normalize() * length
            } else if turn < 0.0 {
                -(out + back)
            } else {
                out + back
            };
            inner_points.push(v + t * shift);
        }
    }
    let inner = s.points(inner_points);
    // The point on edge c near its first corner; that of the twin is near the other end.
    let near = |c: usize| point + old.side(c);
    s.inner_faces(old, inner);
    // Per corner a quad along the edge and one around the corner.
    for c in 0..old.corners() {
        let after = old.ring.after(c) as u32;
        let quad = [near(c), near(old.twin(c)), inner + after, inner + c as u32];
        s.face(2, old.ring.face[c], quad);
    }
    for c in 0..old.corners() {
        let v = old.ring.vertex(c) as u32;
        let back = near(old.twin(old.ring.prior(c)));
        s.face(2, old.ring.face[c], [v, near(c), inner + c as u32, back]);
    }
    Ok(s)
}

/// Midpoints, and the midpoints scaled by p = (scale) about their mean, in every face: pentagons at the corners.
/// V' = V + 3E, E' = 6E, F' = F + 2E.
pub(super) fn pentagon_preserving(old: &Old, p: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::with_old_vertices(old);
    let middle = s.points(old.edge_corners().map(|c| old.along(c, 0.5)));
    let mut inner_points = Vec::with_capacity(old.corners());
    for f in 0..old.faces() {
        let middles: Vec<Vec3> = old.span(f).map(|c| old.along(c, 0.5)).collect();
        let mean = middles.iter().sum::<Vec3>() / middles.len() as f64;
        inner_points.extend(middles.iter().map(|m| mean + p[0] * (m - mean)));
    }
    let inner = s.points(inner_points);
    s.inner_faces(old, inner);
    for c in 0..old.corners() {
        let (v, before) = (old.ring.vertex(c) as u32, old.ring.prior(c));
        let (out, back) = (middle + old.edge(c), middle + old.edge(before));
        let face = [v, out, inner + c as u32, inner + before as u32, back];
        s.face(2, old.ring.face[c], face);
    }
    Ok(s)
}
