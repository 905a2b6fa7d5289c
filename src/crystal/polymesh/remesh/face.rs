//! Schemes that put a point in every face: duals, stellations, quads and pentagons at corners, pyramids on midpoints.
//!
//! The function of a scheme takes the old mesh and the values `p` of its parameters in the order of the table. V, E, F
//! are the numbers of old vertices, edges and faces, with a prime those of the result. Corner c is the half-edge from
//! its vertex to the next one of its face; lifted points are in mean edges of their face.

use super::{MeshBuilder, NO_PARENT, Old, RuleResult};
use druse_geometry::frame::Vec3;
use std::f64::consts::TAU;

/// The dual mesh: a vertex for each face, a face for each vertex. V' = F, E' = E, F' = V.
pub(super) fn dual(old: &Old, _: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::new(old.centres().collect());
    for v in 0..old.vertices() {
        s.face(1, NO_PARENT, old.ring.around(v).map(|c| old.ring.face[c]));
    }
    Ok(s)
}

/// A pyramid on every face. V' = V + F, E' = 3E, F' = 2E.
pub(super) fn stellate(old: &Old, p: &[f64]) -> RuleResult {
    stellated(old, |_| true, p[0])
}

/// A pyramid of height 0 on every face that is not a triangle; groups stay.
pub(super) fn triangulate(old: &Old, _: &[f64]) -> RuleResult {
    stellated(old, |n| n > 3, 0.0)
}

/// A pyramid of a height, in mean edges of the face, on every face whose number of corners `which` selects.
fn stellated(old: &Old, which: fn(usize) -> bool, height: f64) -> RuleResult {
    let mut s = MeshBuilder::with_old_vertices(old);
    for f in 0..old.faces() {
        let corners = old.span(f);
        let loops = old.mesh.face(f);
        if !which(corners.len()) {
            s.face(1, f as u32, loops.iter().copied());
            continue;
        }
        let centre = s.points([old.lifted(f, height)]);
        for (k, &v) in loops.iter().enumerate() {
            s.face(1, f as u32, [v, loops[(k + 1) % loops.len()], centre]);
        }
    }
    Ok(s)
}

/// Stellated twice, the first apexes lifted by p = (height), the second not. V' = V + F + 2E, E' = 9E, F' = 6E.
pub(super) fn star(old: &Old, p: &[f64]) -> RuleResult {
    let first = stellate(old, p)?;
    let parents = first.parents.clone();
    let mesh = first.mesh()?;
    let mut s = stellate(&Old::new(&mesh), &[0.0])?;
    for p in &mut s.parents {
        *p = parents[*p as usize];
    }
    Ok(s)
}

/// Stellated, then every old edge flipped: triangles (a, `c_g`, `c_f`). V' = V + F, E' = 3E, F' = 2E.
///
/// With `smooth` (p above 1/2) old vertices move to (1 - w) v + w mean(neighbours), w = (4 - 2 cos(2 pi/k))/9 (Kobbelt,
/// *sqrt(3)-subdivision*, 2000).
pub(super) fn root3(old: &Old, p: &[f64]) -> RuleResult {
    let mut vertices = old.mesh.vertices().to_vec();
    if p[0] > 0.5 {
        for (v, point) in vertices.iter_mut().enumerate() {
            let (mean, k) = neighbours(old, v);
            let w = (4.0 - 2.0 * (TAU / k).cos()) / 9.0;
            *point = (1.0 - w) * *point + w * mean;
        }
    }
    let mut s = MeshBuilder::new(vertices);
    let centre = s.points(old.centres());
    for c in old.edge_corners() {
        let (f, g) = (old.ring.face[c], old.ring.face[old.twin(c)]);
        let (a, b) = (
            old.ring.vertex(c) as u32,
            old.ring.vertex(old.twin(c)) as u32,
        );
        s.face(1, f, [a, centre + g, centre + f]);
        s.face(1, g, [b, centre + f, centre + g]);
    }
    Ok(s)
}

/// Stellated, then every old edge removed: quads (a, `c_g`, b, `c_f`). V' = V + F, E' = 2E, F' = E.
pub(super) fn edge_removal(old: &Old, p: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::with_old_vertices(old);
    let centre = s.points((0..old.faces()).map(|f| old.lifted(f, p[0])));
    for c in old.edge_corners() {
        let (f, g) = (old.ring.face[c], old.ring.face[old.twin(c)]);
        let (a, b) = (
            old.ring.vertex(c) as u32,
            old.ring.vertex(old.twin(c)) as u32,
        );
        s.face(1, NO_PARENT, [a, centre + g, b, centre + f]);
    }
    Ok(s)
}

/// Stellated, then edges removed from the stellation. V' = V + F + 2E, E' = 6E, F' = 3E.
pub(super) fn double_stellate(old: &Old, p: &[f64]) -> RuleResult {
    let mesh = stellate(old, p)?.mesh()?;
    edge_removal(&Old::new(&mesh), &[0.0])
}

/// The mean of the neighbours of a vertex along its edges, and their number.
pub(super) fn neighbours(old: &Old, v: usize) -> (Vec3, f64) {
    let mut sum = Vec3::zeros();
    let mut count = 0.0;
    for c in old.ring.around(v) {
        sum += old.along(c, 1.0);
        count += 1.0;
    }
    (sum / count, count)
}

/// Quads (v, midpoint, centre, midpoint). V' = V + E + F, E' = 4E, F' = 2E.
pub(super) fn linear(old: &Old, _: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::with_old_vertices(old);
    let middle = s.points(old.edge_corners().map(|c| old.along(c, 0.5)));
    let centre = s.points(old.centres());
    quads(&mut s, old, middle, centre);
    Ok(s)
}

/// Adds a quad (v, midpoint, centre, midpoint) at each corner; `middle` and `centre` are the numbers of the first
/// midpoint and the first centre.
fn quads(s: &mut MeshBuilder, old: &Old, middle: u32, centre: u32) {
    for c in 0..old.corners() {
        let f = old.ring.face[c];
        let v = old.ring.vertex(c) as u32;
        let (out, back) = (old.edge(c), old.edge(old.ring.prior(c)));
        s.face(1, f, [v, middle + out, centre + f, middle + back]);
    }
}

/// Catmull and Clark's scheme (1978): edge points are means of both ends and both centres, vertices are
/// (Q + 2R + (k - 3) v)/k with Q the mean of the adjacent centres and R that of the adjacent midpoints.
pub(super) fn catmull_clark(old: &Old, _: &[f64]) -> RuleResult {
    let centres: Vec<Vec3> = old.centres().collect();
    let centre_of = |c: usize| centres[old.ring.face[c] as usize];
    let vertices = (0..old.vertices()).map(|v| {
        let (mean, k) = neighbours(old, v);
        let p = old.mesh.vertices()[v];
        let q: Vec3 = old.ring.around(v).map(centre_of).sum::<Vec3>() / k;
        (q + (mean + p) + (k - 3.0) * p) / k
    });
    let mut s = MeshBuilder::new(vertices.collect());
    let middle = s.points(
        old.edge_corners()
            .map(|c| (2.0 * old.along(c, 0.5) + centre_of(c) + centre_of(old.twin(c))) / 4.0),
    );
    let centre = s.points(centres.iter().copied());
    quads(&mut s, old, middle, centre);
    Ok(s)
}

/// Pentagons (centre, third, third, v, third): left-handed or right-handed. V' = V + 2E + F, E' = 5E, F' = 2E.
///
/// `offset` moves the first third of each half-edge towards the centre of its face.
pub(super) fn pentagonal(old: &Old, p: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::with_old_vertices(old);
    let centres: Vec<Vec3> = old.centres().collect();
    let third = s.points(old.edge_corners().flat_map(|c| {
        [c, old.twin(c)].map(|c| {
            let q = old.along(c, 1.0 / 3.0);
            q + p[0] * (centres[old.ring.face[c] as usize] - q)
        })
    }));
    let centre = s.points(centres.iter().copied());
    for c in 0..old.corners() {
        let (f, after) = (old.ring.face[c], old.ring.after(c));
        let far = third + old.side(old.twin(c));
        let v = old.ring.vertex(after) as u32;
        let face = [
            centre + f,
            third + old.side(c),
            far,
            v,
            third + old.side(after),
        ];
        s.face(1, f, face);
    }
    Ok(s)
}

/// [`pentagonal`], then every vertex, old or new, moved to the mean of the centres of its faces.
pub(super) fn cubic_pentagonal(old: &Old, p: &[f64]) -> RuleResult {
    let mut s = pentagonal(old, p)?;
    let mesh = MeshBuilder {
        vertices: s.vertices.clone(),
        faces: s.faces.clone(),
        classes: Vec::new(),
        parents: Vec::new(),
    }
    .mesh()?;
    let inner = Old::new(&mesh);
    let centres: Vec<Vec3> = inner.centres().collect();
    for (v, point) in s.vertices.iter_mut().enumerate() {
        let around: Vec<Vec3> = inner
            .ring
            .around(v)
            .map(|c| centres[inner.ring.face[c] as usize])
            .collect();
        *point = around.iter().sum::<Vec3>() / around.len() as f64;
    }
    Ok(s)
}

/// Midpoints joined in every face, with a pyramid on the inner polygon. V' = V + E + F, E' = 6E, F' = 4E.
///
/// The height of the pyramid is p = (offset) times sqrt(max(0, m^2 - a^2)), with m the mean distance of neighbouring
/// midpoints and a half the mean distance from a midpoint to the opposite midpoint or corner.
pub(super) fn fractal(old: &Old, p: &[f64]) -> RuleResult {
    let mut s = MeshBuilder::with_old_vertices(old);
    let middle = s.points(old.edge_corners().map(|c| old.along(c, 0.5)));
    let tips: Vec<Vec3> = (0..old.faces())
        .map(|f| {
            let corners: Vec<usize> = old.span(f).collect();
            let n = corners.len();
            let half = |k: usize| old.along(corners[k % n], 0.5);
            // Opposite a midpoint is a midpoint, or with an odd number of edges a corner.
            let opposite = |k: usize| match n % 2 {
                0 => half(k + n / 2),
                _ => old.ring.at(corners[(k + n.div_ceil(2)) % n]),
            };
            let mean = |g: &dyn Fn(usize) -> f64| (0..n).map(g).sum::<f64>() / n as f64;
            let side = mean(&|k| (half(k + 1) - half(k)).norm());
            let across = mean(&|k| (opposite(k) - half(k)).norm()) / 2.0;
            let square = side * side - across * across;
            // The square root would amplify rounding errors of a zero.
            let square = if square > 1e-12 * side * side {
                square
            } else {
                0.0
            };
            let height = p[0] * square.sqrt();
            old.mesh.centre(f) + height * old.mesh.normal(f)
        })
        .collect();
    let tip = s.points(tips);
    let edge = |c: usize| middle + old.edge(c);
    // The pyramid on the inner polygon, then the triangles at the corners.
    for c in 0..old.corners() {
        let f = old.ring.face[c];
        s.face(1, f, [edge(c), edge(old.ring.after(c)), tip + f]);
    }
    for c in 0..old.corners() {
        let v = old.ring.vertex(c) as u32;
        s.face(2, old.ring.face[c], [v, edge(c), edge(old.ring.prior(c))]);
    }
    Ok(s)
}
