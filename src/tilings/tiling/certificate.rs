//! The continuity certificate: the jumps of a tiling's field across all shared faces.
//!
//! Points of a face are mapped to the world by one side's map and back by each element's own inverse map; both
//! elements evaluate the filling independently. The jump of the value measures C0 continuity. Where the zero
//! set crosses the face, the angle between both sides' normals measures C1. Jumps are relative to the range of
//! the field's values on all faces.

use super::interface::{corner_weights, joined_vertices, shared_faces, weighted_point};
use super::source::Filling;
use crate::scaffold::{FaceRef, Scaffold};
use druse_geometry::frame::{CellPoint, Vec3, WorldPoint};
use rayon::prelude::*;
use serde::Serialize;

/// Measurements on faces of one kind.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FaceStatistics {
    /// "triangle" or "quad".
    pub kind: &'static str,
    /// Number of faces.
    pub faces: usize,
    /// Number of points.
    pub points: usize,
    /// Number of points where the zero set crosses a face.
    pub crossings: usize,
    /// Greatest jump of the value, over the field's range.
    pub value_jump_max: f64,
    /// Its 99th percentile over the points.
    pub value_jump_p99: f64,
    /// Greatest angle between both sides' normals, degrees.
    pub crease_degrees_max: f64,
    /// Its 99th percentile over the crossings.
    pub crease_degrees_p99: f64,
}

/// A point of a face with the difference between its sides.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Discontinuity {
    /// Numbers of the elements in the file.
    pub elements: [u64; 2],
    /// The point, world coordinates.
    pub at: [f64; 3],
    /// The jump of the value over the field's range.
    pub value_jump: f64,
    /// Bound of the point's distance from the other element's face, world units.
    pub gap: f64,
}

/// The continuity of a tiling's field, see [`certify`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Certificate {
    /// Least and greatest value on the faces, by the first element of each.
    pub range: [f64; 2],
    /// Triangles, then quads, if there are such faces.
    pub kinds: Vec<FaceStatistics>,
    /// Greatest jump over all faces, over the field's range.
    pub value_jump_max: f64,
    /// 99th percentile of the jumps, likewise.
    pub value_jump_p99: f64,
    /// 99th percentile of the creases, degrees.
    pub crease_degrees_p99: f64,
    /// Greatest crease, degrees.
    pub crease_degrees_max: f64,
    /// The points with the largest jumps of at most five faces, one of each, the worst first.
    pub worst: Vec<Discontinuity>,
    /// Greatest jump on the faces of each element, over the field's range.
    pub jump_of_element: Vec<f64>,
    /// Greatest crease on the faces of each element, degrees.
    pub crease_of_element: Vec<f64>,
}

/// Points along an edge of a face.
const EDGE_POINTS: usize = 5;

/// The difference between both sides of a face at a point.
struct Jump {
    /// Of the value.
    size: f64,
    /// The point, world coordinates; for an infinite jump the middle of the first element's box.
    at: Vec3,
    /// Bound of the point's distance from the other element's face, world units.
    gap: f64,
}

/// Measurements on one face.
struct Face {
    sides: [FaceRef; 2],
    corners: usize,
    range: (f64, f64),
    jumps: Vec<Jump>,
    /// Angles between both sides' normals where the zero set crosses the face, degrees.
    creases: Vec<f64>,
}

/// Measures the continuity of a filling over all shared faces of a scaffold. Faces are measured in parallel; a face
/// whose corners do not correspond is left out. Without shared faces all numbers are 0.
pub fn certify<F: Filling>(scaffold: &Scaffold, filling: &F) -> Certificate {
    let faces: Vec<(FaceRef, FaceRef)> = shared_faces(scaffold).collect();
    let measured: Vec<Face> = faces
        .into_par_iter()
        .filter_map(|(f, g)| face(scaffold, filling, f, g))
        .collect();
    // Jumps are relative to the range of F over all faces.
    let (low, high) = measured
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), f| {
            (a.min(f.range.0), b.max(f.range.1))
        });
    let mut certificate = Certificate {
        range: [low, high],
        jump_of_element: vec![0.0; scaffold.len()],
        crease_of_element: vec![0.0; scaffold.len()],
        ..Certificate::default()
    };
    // Without a shared face, and where no point of one has a preimage on both sides.
    if low > high {
        certificate.range = [0.0; 2];
    }
    if measured.is_empty() {
        return certificate;
    }
    let scale = 1.0 / (high - low).max(f64::MIN_POSITIVE);
    let mut jumps = Vec::new();
    // The worst point of each face stands for it among the worst of all.
    for face in &measured {
        let mut worst: Option<Discontinuity> = None;
        for jump in &face.jumps {
            let value_jump = jump.size * scale;
            if worst.is_none_or(|w| value_jump > w.value_jump) {
                worst = Some(Discontinuity {
                    elements: face.sides.map(|f| scaffold.number(f.element as usize)),
                    at: jump.at.into(),
                    value_jump,
                    gap: jump.gap,
                });
            }
        }
        let crease = face.creases.iter().copied().fold(0.0, f64::max);
        for side in face.sides {
            let e = side.element as usize;
            let jump = worst.map_or(0.0, |w| w.value_jump);
            certificate.jump_of_element[e] = certificate.jump_of_element[e].max(jump);
            certificate.crease_of_element[e] = certificate.crease_of_element[e].max(crease);
        }
        jumps.extend(worst);
    }
    jumps.sort_by(|a, b| {
        let by_jump = b.value_jump.total_cmp(&a.value_jump);
        by_jump.then(a.elements.cmp(&b.elements))
    });
    jumps.truncate(5);
    certificate.worst = jumps;
    // Statistics over the points of some faces, in the order of the faces: the same at any number of threads.
    let statistics = |kind: &'static str, faces: &[&Face]| {
        let mut jumps: Vec<f64> = faces
            .iter()
            .flat_map(|f| f.jumps.iter().map(|j| j.size * scale))
            .collect();
        let mut creases: Vec<f64> = faces.iter().flat_map(|f| f.creases.clone()).collect();
        let (jump_max, jump_p99) = percentiles(&mut jumps);
        // The largest values and their 99th percentiles.
        let (crease_max, crease_p99) = percentiles(&mut creases);
        FaceStatistics {
            kind,
            faces: faces.len(),
            points: jumps.len(),
            crossings: creases.len(),
            value_jump_max: jump_max,
            value_jump_p99: jump_p99,
            crease_degrees_max: crease_max,
            crease_degrees_p99: crease_p99,
        }
    };
    for (kind, corners) in [("triangle", 3), ("quad", 4)] {
        let of_kind: Vec<&Face> = measured.iter().filter(|f| f.corners == corners).collect();
        if !of_kind.is_empty() {
            certificate.kinds.push(statistics(kind, &of_kind));
        }
    }
    let all = statistics("all", &measured.iter().collect::<Vec<_>>());
    certificate.value_jump_max = all.value_jump_max;
    certificate.value_jump_p99 = all.value_jump_p99;
    certificate.crease_degrees_p99 = all.crease_degrees_p99;
    certificate.crease_degrees_max = all.crease_degrees_max;
    certificate
}

/// The greatest value and the 99th percentile by the nearest rank; zeros if there are no values.
fn percentiles(values: &mut [f64]) -> (f64, f64) {
    values.sort_unstable_by(f64::total_cmp);
    let Some(&greatest) = values.last() else {
        return (0.0, 0.0);
    };
    let rank = (values.len() * 99).div_ceil(100).max(1) - 1;
    (greatest, values[rank])
}

/// Measures one shared face; `f` and `g` are its two sides. `None` if their corners do not correspond. A point without
/// preimage or with a singular Jacobian in one of the elements counts as an infinite jump.
fn face<F: Filling>(scaffold: &Scaffold, filling: &F, f: FaceRef, g: FaceRef) -> Option<Face> {
    let (own_vertices, neighbour_vertices) = joined_vertices(scaffold, f, g)?;
    let elements = [f, g].map(|f| f.element as usize);
    let maps = elements.map(|e| scaffold.element(e));
    let corners = own_vertices.len();
    let mut measured = Face {
        sides: [f, g],
        corners,
        range: (f64::INFINITY, f64::NEG_INFINITY),
        jumps: Vec::new(),
        creases: Vec::new(),
    };
    let plane = maps[1].shape().faces()[g.face as usize];
    // The point at parameters uv of the face, from both sides.
    let both = |uv: [f64; 2]| {
        let w = corner_weights(corners, uv);
        let x = maps[0].map(weighted_point(maps[0].shape(), &own_vertices, w));
        let estimate = [
            weighted_point(maps[0].shape(), &own_vertices, w),
            weighted_point(maps[1].shape(), &neighbour_vertices, w),
        ];
        let mut sides = [(0.0, Vec3::zeros()); 2];
        let mut gap = 0.0;
        for i in 0..2 {
            // Start off the point, so that the inverse map is really solved.
            let start = CellPoint(estimate[i].0 * 0.98);
            let xi = maps[i].inverse_from(WorldPoint(x.0), start).ok()?;
            if i == 1 {
                gap = (plane.normal.dot(&xi.0) - plane.offset).abs() * maps[1].stretch().1;
            }
            let (value, slope) = filling.value_and_gradient(elements[i], xi);
            let inverse = maps[i].jacobian(xi).try_inverse()?;
            sides[i] = (value, inverse.tr_mul(&slope));
        }
        Some(FacePoint {
            sides,
            at: x.0,
            gap,
        })
    };
    // A grid of points off the symmetry lines, where cells often agree by symmetry alone.
    let step = |i: usize| (i as f64 + 0.37) / EDGE_POINTS as f64;
    // The row before, with nothing where a point has no preimage.
    let mut row: [Option<([f64; 2], f64)>; EDGE_POINTS] = [None; EDGE_POINTS];
    for j in 0..EDGE_POINTS {
        let mut last: Option<([f64; 2], f64)> = None;
        for i in 0..EDGE_POINTS {
            let mut uv = [step(i), step(j)];
            if corners == 3 {
                // The triangle's rows shrink towards its last corner.
                uv[0] *= 1.0 - uv[1];
            }
            let Some(FacePoint { sides, at, gap }) = both(uv) else {
                // A point without a preimage, where an inverse map does not converge, counts as a gap in the mesh.
                measured.jumps.push(Jump {
                    size: f64::INFINITY,
                    at: maps[0].bounds().centre().0,
                    gap: f64::INFINITY,
                });
                (last, row[i]) = (None, None);
                continue;
            };
            let value = sides[0].0;
            measured.range = (measured.range.0.min(value), measured.range.1.max(value));
            measured.jumps.push(Jump {
                size: (value - sides[1].0).abs(),
                at,
                gap,
            });
            // Where the value changes sign between this point and the one before along either direction, the crease is
            // measured.
            let before = [last, row[i]];
            for (other, v) in before.into_iter().flatten() {
                if (v < 0.0) != (value < 0.0) {
                    measured.creases.extend(crease(&both, other, v, uv, value));
                }
            }
            last = Some((uv, value));
            row[i] = last;
        }
    }
    Some(measured)
}

/// A point of a face, evaluated in both of its elements.
struct FacePoint {
    /// Values and world gradients.
    sides: [(f64, Vec3); 2],
    /// World coordinates.
    at: Vec3,
    /// Bound of the point's distance from the other element's face, world units.
    gap: f64,
}

/// The angle between both sides' normals where the value vanishes between two points of a face, degrees. `fa` and `fb`
/// are values of one side at the parameters `a` and `b`, of different signs. `None` where a point has no preimage or a
/// gradient vanishes.
fn crease(
    both: &dyn Fn([f64; 2]) -> Option<FacePoint>,
    mut a: [f64; 2],
    mut fa: f64,
    mut b: [f64; 2],
    mut fb: f64,
) -> Option<f64> {
    let mut gradients = None;
    // Eight steps suffice, since normals change slowly; shares of 5 to 95 % keep both ends moving.
    for _ in 0..8 {
        let t = (fa / (fa - fb)).clamp(0.05, 0.95);
        let c = [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t];
        let FacePoint { sides, .. } = both(c)?;
        gradients = Some(sides.map(|s| s.1));
        if (sides[0].0 < 0.0) == (fa < 0.0) {
            (a, fa) = (c, sides[0].0);
        } else {
            (b, fb) = (c, sides[0].0);
        }
    }
    let [g, h] = gradients?;
    let (g, h) = (g.try_normalize(1e-12)?, h.try_normalize(1e-12)?);
    // By both sine and cosine, exact for small angles too.
    Some(g.cross(&h).norm().atan2(g.dot(&h)).to_degrees())
}
