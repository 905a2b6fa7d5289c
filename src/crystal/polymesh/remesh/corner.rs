//! Schemes that put points at the corners within every face.
//!
//! The function of a scheme takes the old mesh and the values `p` of its parameters in the order of the table. V, E, F
//! are the numbers of old vertices, edges and faces, with a prime those of the result. Corner c is the half-edge from
//! its vertex to the next one of its face; old vertices keep their numbers where they remain.

use super::weight::{doo_sabin as doo_sabin_weight, honeycomb, weighted};
use super::{MeshBuilder, NO_PARENT, Old, RuleResult};
use druse_geometry::frame::Vec3;

/// Takes one point per corner; makes faces, quads over edges and faces round vertices. Vertices of degree 2 get no
/// face, which would have two corners.
fn over(old: &Old, points: Vec<Vec3>) -> MeshBuilder {
    let mut s = MeshBuilder::new(points);
    s.inner_faces(old, 0);
    for c in old.edge_corners() {
        let t = old.twin(c);
        s.face(
            2,
            NO_PARENT,
            [old.ring.next[c], c as u32, old.ring.next[t], t as u32],
        );
    }
    for v in 0..old.vertices() {
        let around: Vec<u32> = old.ring.around(v).map(|c| c as u32).collect();
        if around.len() > 2 {
            s.face(3, NO_PARENT, around);
        }
    }
    s
}

/// One point per corner: the weighted mean of its face's corners with the own weight `own(n)` of an n-gon.
fn by_weight(old: &Old, own: impl Fn(usize) -> f64) -> Vec<Vec3> {
    let faces = (0..old.faces()).map(|f| old.mesh.points(f));
    faces
        .flat_map(|points| weighted(&points, own(points.len())))
        .collect()
}

/// Doo and Sabin, 1978. V' = 2E, E' = 4E, F' = F + E + V.
pub(super) fn doo_sabin(old: &Old, _: &[f64]) -> RuleResult {
    Ok(over(old, by_weight(old, doo_sabin_weight)))
}

/// Doo and Sabin's rule with the given own weight p = (alpha).
pub(super) fn corner_cutting(old: &Old, p: &[f64]) -> RuleResult {
    Ok(over(old, by_weight(old, |_| p[0])))
}

/// Doo and Sabin's topology, with every edge of a face moved inward by half the thickness p = (thickness), in the
/// model's unit. Reflex corners move outward. Straight ones have no such point: the mesh is then refused as not finite.
pub(super) fn modified_corner_cutting(old: &Old, p: &[f64]) -> RuleResult {
    let point = |c: usize| {
        let v = old.ring.at(c);
        let out = (old.along(c, 1.0) - v).normalize();
        let back = (old.ring.at(old.ring.prior(c)) - v).normalize();
        let sine = (1.0 - out.dot(&back).powi(2)).max(0.0).sqrt();
        v + p[0] / 2.0 / sine * (out + back)
    };
    Ok(over(old, (0..old.corners()).map(point).collect()))
}

/// p = (tension, twist).
///
/// Old vertices and inner corners: inner faces, hexagons over edges. V' = V + 2E, E' = 4E, F' = F + E.
///
/// Inner corners are weighted means of the points at `twist` along the edges. The own weight is that of a
/// honeycomb, w, raised by `tension` to w + tension (1 - w).
pub(super) fn root4(old: &Old, p: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::with_old_vertices(old);
    let mut points = Vec::with_capacity(old.corners());
    for f in 0..old.faces() {
        let start: Vec<Vec3> = old.span(f).map(|c| old.along(c, p[1])).collect();
        let own = honeycomb(start.len());
        points.extend(weighted(&start, own + p[0] * (1.0 - own)));
    }
    let inner = s.points(points);
    s.inner_faces(old, inner);
    for c in old.edge_corners() {
        let t = old.twin(c);
        let (x, y) = (old.ring.vertex(c) as u32, old.ring.vertex(t) as u32);
        // Both inner points of the edge on either side, and its two ends.
        let [f, g] = [c, t].map(|c| [inner + c as u32, inner + old.ring.next[c]]);
        s.face(2, NO_PARENT, [x, g[1], g[0], y, f[1], f[0]]);
    }
    Ok(s)
}

/// The third points of the edges of every face, scaled about their mean: faces with twice the corners, quads
/// over edges, faces of twice the degree round vertices. V' = 4E, E' = 6E, F' = F + E + V.
pub(super) fn dual_twelve_six_four(old: &Old, p: &[f64]) -> RuleResult {
    let mut points = Vec::with_capacity(2 * old.corners());
    for f in 0..old.faces() {
        let thirds: Vec<Vec3> = old
            .span(f)
            .flat_map(|c| [old.along(c, 1.0 / 3.0), old.along(c, 2.0 / 3.0)])
            .collect();
        let mean = thirds.iter().sum::<Vec3>() / thirds.len() as f64;
        points.extend(thirds.iter().map(|t| mean + p[0] * (t - mean)));
    }
    let mut s = MeshBuilder::new(points);
    let (near, far) = (|c: usize| 2 * c as u32, |c: usize| 2 * c as u32 + 1);
    for f in 0..old.faces() {
        s.face(1, f as u32, old.span(f).flat_map(|c| [near(c), far(c)]));
    }
    for c in old.edge_corners() {
        let t = old.twin(c);
        s.face(2, NO_PARENT, [far(c), near(c), far(t), near(t)]);
    }
    for v in 0..old.vertices() {
        let pair = |c: usize| [near(c), far(old.ring.prior(c))];
        s.face(3, NO_PARENT, old.ring.around(v).flat_map(pair));
    }
    Ok(s)
}

/// The dual of [`dual_twelve_six_four`] applied to the dual mesh. V' = V + E + F, E' = 6E, F' = 4E. No face has a
/// parent.
pub(super) fn twelve_six_four(old: &Old, p: &[f64]) -> RuleResult {
    let inner = super::face::dual(old, &[])?.mesh()?;
    let middle = dual_twelve_six_four(&Old::new(&inner), p)?.mesh()?;
    super::face::dual(&Old::new(&middle), &[])
}

/// Every edge split at its midpoint.
fn halved(old: &Old) -> RuleResult {
    let mut s = MeshBuilder::with_old_vertices(old);
    let middle = s.points(old.edge_corners().map(|c| old.along(c, 0.5)));
    for f in 0..old.faces() {
        let pair = |c: usize| [old.ring.vertex(c) as u32, middle + old.edge(c)];
        s.face(1, f as u32, old.span(f).flat_map(pair));
    }
    Ok(s)
}

/// Edges split, then Doo and Sabin's rule, without the faces of two corners at the midpoints.
/// V' = 4E, E' = 7E, F' = F + 2E + V.
pub(super) fn doo_sabin_bc(old: &Old, _: &[f64]) -> RuleResult {
    let mesh = halved(old)?.mesh()?;
    doo_sabin(&Old::new(&mesh), &[])
}

/// [`doo_sabin_bc`] with the old vertices kept: pentagons replace quads and the faces round vertices.
/// V' = V + 4E, E' = 7E, F' = F + 2E.
pub(super) fn doo_sabin_bc_new(old: &Old, _: &[f64]) -> RuleResult {
    let mesh = halved(old)?.mesh()?;
    let split = Old::new(&mesh);
    let mut s = MeshBuilder::with_old_vertices(old);
    let inner = s.points(by_weight(&split, doo_sabin_weight));
    let first_middle = old.vertices();
    s.inner_faces(&split, inner);
    for c in split.edge_corners() {
        // The half edges run from an old vertex to a midpoint, in either direction.
        let c = if split.ring.vertex(c) < first_middle {
            c
        } else {
            split.twin(c)
        };
        let t = split.twin(c);
        let v = split.ring.vertex(c) as u32;
        let [near, far] = [c as u32, split.ring.next[c]].map(|k| inner + k);
        let [other_far, other_near] = [t as u32, split.ring.next[t]].map(|k| inner + k);
        s.face(2, NO_PARENT, [v, other_near, other_far, far, near]);
    }
    Ok(s)
}

/// An inner face in every face, scaled about its centre and lifted, p = (scale, height); the height is in mean edges of
/// the face. V' = V + 2E, E' = 5E, F' = F + 2E.
pub(super) fn loft(old: &Old, p: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::with_old_vertices(old);
    let mut points = Vec::with_capacity(old.corners());
    for f in 0..old.faces() {
        let (centre, top) = (old.mesh.centre(f), old.lifted(f, p[1]));
        points.extend(old.span(f).map(|c| top + p[0] * (old.ring.at(c) - centre)));
    }
    let inner = s.points(points);
    s.inner_faces(old, inner);
    for c in 0..old.corners() {
        let (v, w) = (
            old.ring.vertex(c) as u32,
            old.ring.vertex(old.ring.after(c)) as u32,
        );
        let quad = [v, w, inner + old.ring.next[c], inner + c as u32];
        s.face(2, old.ring.face[c], quad);
    }
    Ok(s)
}
