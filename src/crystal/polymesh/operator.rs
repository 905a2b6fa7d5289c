//! Archimedean extrusions: an operator on an extrusion of a derived polygon, the base polygon kept.
//!
//! The base polygon b is the image of a polygon q under the operator. The kind is extruded on q, the operator
//! is applied to the closed solid, the image of its base is removed and b takes its place. With p the number of
//! corners of the kind's regular face, m that of q and delta the dihedral angle:
//!
//! | operator | base | constant |
//! |---|---|---|
//! | truncate | q with its corners cut; corners of b come in pairs | c = 1/(2 + 2 cos(pi/m)) of an edge |
//! | rectify | midpoints of q's edges | none |
//! | cantellate | q shrunk by s about its centre | s = K/(1+K), K = sin(delta/2)/tan(pi/p) |
//! | omnitruncate | q's edges shortened and moved inward | u = cos(pi/p)/2 / (1 + cos(pi/p) + sin(pi/p)/sin(delta/2)), inward u/sin(delta/2) |
//! | snub | q shrunk by s and rotated by theta | s, theta from equal edges, by Newton's method |

use super::extrude::{Cap, Diagnostics, Extrusion};
use super::kind::{Kind, Operator};
use super::polygon::{Polygon, doubled_area_vector, mean, unit};
use super::topology::Ring;
use super::{Faces, PolyMesh};
use druse_geometry::frame::Vec3;
use std::f64::consts::PI;

/// The cap that `operator` makes on a base polygon: the faces of the operated solid without the image of its base.
/// Observations go to `diagnostics`. The error is a reason: a number of corners that does not suit, parallel edges,
/// a polygon without a normal, an angle of no snub solid, or an extrusion of q that is no valid mesh.
pub(super) fn cap(
    extrusion: &Extrusion,
    operator: Operator,
    base: &Polygon,
    diagnostics: &mut Diagnostics,
) -> Result<Cap, String> {
    let kind = extrusion.kind;
    let n = base.len();
    let paired = matches!(operator, Operator::Truncate | Operator::Omnitruncate);
    if paired && n % 2 == 1 {
        return Err(format!(
            "found {n} corners; {} takes them in pairs and expects an even number",
            extrusion.name()
        ));
    }
    // Pairs of fewer than six corners give q fewer than three.
    if paired && n < 6 {
        return Err(format!(
            "found {n} corners; {} expects at least 6",
            extrusion.name()
        ));
    }
    // q has one corner for each pair of the base's corners (`odd` pairs corner 1 with corner 2), or for each
    // corner where the operator takes no pairs.
    let m = if paired { n / 2 } else { n };
    let delta = kind.dihedral(extrusion.dihedral, m);
    let rule = Rule::new(operator, kind, delta, m)?;
    let start = usize::from(paired && extrusion.odd);
    let q = Polygon::new(rule.derived(base, start)?)?;
    let solid = closed(&extrusion.kind_cap(&q, delta, diagnostics)?, &q)?;
    // The image of q's face has the corners of a regular base, up to rounding, and may differ from others:
    // it is replaced by the base itself.
    let image_mesh = rule.apply(&solid);
    Ok(replace_base(
        &image_mesh,
        base,
        operator,
        start,
        kind.has_top(),
    ))
}

/// Applies the operator to the regular solid whose faces the kind makes; all faces are in group 1. Points that no face
/// uses are dropped.
pub(super) fn on_solid(operator: Operator, kind: Kind, solid: &PolyMesh) -> PolyMesh {
    let rule = Rule::new(operator, kind, kind.regular_dihedral(), kind.corners())
        .unwrap_or_else(|e| unreachable!("a regular solid: {e}"));
    let image_mesh = rule.apply(solid);
    let mut number = vec![u32::MAX; image_mesh.points.len()];
    let mut points = Vec::new();
    let mut faces = Faces::default();
    for face in &image_mesh.faces {
        faces.push(face.iter().map(|&v| {
            let slot = &mut number[v as usize];
            if *slot == u32::MAX {
                *slot = points.len() as u32;
                points.push(image_mesh.points[v as usize]);
            }
            *slot
        }));
    }
    PolyMesh::in_one_group(points, faces).unwrap_or_else(|e| unreachable!("a regular solid: {e}"))
}

/// The closed solid of the cap on `q`; face 0 is its base, with reversed orientation.
fn closed(cap: &Cap, q: &Polygon) -> Result<PolyMesh, String> {
    let vertices = q.points.iter().chain(&cap.points).copied().collect();
    let m = q.len() as u32;
    let mut faces = Faces::default();
    faces.push((0..m).rev());
    cap.faces.iter().for_each(|f| faces.push(f.iter().copied()));
    PolyMesh::in_one_group(vertices, faces).map_err(|e| e.to_string())
}

/// An operator with its constants.
struct Rule {
    operator: Operator,
    /// What the operator moves: the share of an edge that is cut, the factor about the centre, or half an edge's share.
    share: f64,
    /// Inward shift of omnitruncate, angle of snub.
    shift_or_angle: f64,
}

impl Rule {
    /// The constants of an operator for the dihedral angle `delta` in radians and polygons q of `m` corners; the file
    /// head has the formulas.
    fn new(operator: Operator, kind: Kind, delta: f64, m: usize) -> Result<Self, String> {
        let p = PI / kind.corners() as f64;
        let half = (delta / 2.0).sin();
        let (share, shift_or_angle) = match operator {
            Operator::Truncate => (1.0 / (2.0 + 2.0 * (PI / m as f64).cos()), 0.0),
            Operator::Rectify => (0.5, 0.0),
            Operator::Cantellate => {
                let k = half / p.tan();
                (k / (1.0 + k), 0.0)
            }
            Operator::Omnitruncate => {
                let u = 0.5 * p.cos() / (1.0 + p.cos() + p.sin() / half);
                (u, u / half)
            }
            Operator::Snub => snub(p, delta)?,
        };
        Ok(Self {
            operator,
            share,
            shift_or_angle,
        })
    }

    /// The polygon q whose image is the base; the pairs of paired operators begin at corner `start` (0 or 1). The error
    /// is a reason, where edges that have to meet are parallel.
    fn derived(&self, base: &Polygon, start: usize) -> Result<Vec<Vec3>, String> {
        let n = base.len();
        let at = |i: usize| base.points[i % n];
        let centre = mean(&base.points);
        match self.operator {
            Operator::Truncate => {
                // Corner k is the intersection of the long edges before and after pair k.
                let long = |k: usize| {
                    let i = (start + 2 * k + 1) % n;
                    Line {
                        point: at(i),
                        direction: base.edge(i),
                    }
                };
                (0..n / 2)
                    .map(|k| crossing(long((k + n / 2 - 1) % (n / 2)), long(k), k))
                    .collect()
            }
            Operator::Rectify => {
                // Corner i is the intersection of the tangents at corners i and i+1.
                let tangent = |i: usize| {
                    let i = i % n;
                    let along = |j: usize| base.edge(j).normalize();
                    Line {
                        point: at(i),
                        direction: along((i + n - 1) % n) + along(i),
                    }
                };
                (0..n)
                    .map(|i| crossing(tangent(i), tangent(i + 1), i))
                    .collect()
            }
            Operator::Cantellate => Ok(base
                .points
                .iter()
                .map(|b| centre + (b - centre) / self.share)
                .collect()),
            Operator::Omnitruncate => {
                // Corner k is the intersection of edges 2k-2 and 2k, moved outward; an edge here is 2 u of the solid's.
                let shift = base.mean_edge * self.shift_or_angle / (2.0 * self.share);
                let moved = |k: usize| {
                    let i = (start + 2 * k) % n;
                    Line {
                        point: at(i) + shift * base.outward[i],
                        direction: base.edge(i),
                    }
                };
                (0..n / 2)
                    .map(|k| crossing(moved((k + n / 2 - 1) % (n / 2)), moved(k), k))
                    .collect()
            }
            // By +theta: face 0 of the closed solid runs the other way.
            Operator::Snub => Ok(base
                .points
                .iter()
                .map(|b| {
                    centre + rotated((b - centre) / self.share, base.normal, self.shift_or_angle)
                })
                .collect()),
        }
    }

    /// Applies the operator to a closed solid: one or two points per half-edge, and new faces in the order of
    /// old faces, edges, vertices. Image face f comes from old face f.
    fn apply(&self, solid: &PolyMesh) -> Image {
        let ring = Ring::new(solid);
        let count = ring.next.len();
        let centres: Vec<Vec3> = (0..solid.face_count()).map(|f| solid.centre(f)).collect();
        let normals: Vec<Vec3> = (0..solid.face_count())
            .map(|f| unit(doubled_area_vector(&solid.points(f))).unwrap_or_else(Vec3::zeros))
            .collect();
        let ends = |c: usize| (ring.at(c), ring.at(ring.after(c)));
        let id = |c: usize| c as u32;
        let second = |c: usize| (count + c) as u32;
        let mut points = Vec::with_capacity(count);
        let mut faces: Vec<Vec<u32>> = Vec::new();
        let loops = |f: usize| solid.faces().span(f);
        // A half-edge c runs from corner x to corner y of face f; its twin, from y to x, belongs to the face beyond the
        // edge. Faces of old faces come first.
        match self.operator {
            Operator::Truncate => {
                for c in 0..count {
                    let (x, y) = ends(c);
                    points.push(x + self.share * (y - x));
                }
                for f in 0..solid.face_count() {
                    let corners = loops(f);
                    faces.push(corners.flat_map(|c| [id(c), id(solid.twin(c))]).collect());
                }
            }
            Operator::Rectify => {
                for c in 0..count {
                    // Both half-edges of an edge have its middle; faces take that of the first.
                    let (x, y) = ends(c);
                    points.push((x + y) / 2.0);
                }
                for f in 0..solid.face_count() {
                    faces.push(
                        loops(f)
                            .map(|c| ring.edges[ring.edge[c] as usize])
                            .collect(),
                    );
                }
            }
            Operator::Cantellate | Operator::Snub => {
                let turn = self.operator == Operator::Snub;
                for c in 0..count {
                    let f = ring.face[c] as usize;
                    let arm = self.share * (ring.at(c) - centres[f]);
                    let arm = if turn {
                        rotated(arm, normals[f], self.shift_or_angle)
                    } else {
                        arm
                    };
                    points.push(centres[f] + arm);
                }
                faces.extend((0..solid.face_count()).map(|f| loops(f).map(id).collect()));
                // Each edge becomes a face between the images of both its faces: a quad, which a snub cuts
                // into two triangles.
                for &edge in &ring.edges {
                    let c = edge as usize;
                    let t = solid.twin(c);
                    let (fx, fy) = (id(c), ring.next[c]);
                    let (gy, gx) = (id(t), ring.next[t]);
                    if turn {
                        faces.push(vec![fy, fx, gy]);
                        faces.push(vec![fx, gx, gy]);
                    } else {
                        faces.push(vec![fy, fx, gx, gy]);
                    }
                }
            }
            Operator::Omnitruncate => {
                // Two points per half-edge, before and behind its middle, moved into the face.
                let place = |c: usize, side: f64| {
                    let f = ring.face[c] as usize;
                    let (x, y) = ends(c);
                    let edge = y - x;
                    let inward = unit(normals[f].cross(&edge)).unwrap_or_else(Vec3::zeros);
                    (x + y) / 2.0
                        + side * self.share * edge
                        + self.shift_or_angle * edge.norm() * inward
                };
                points.extend((0..count).map(|c| place(c, -1.0)));
                points.extend((0..count).map(|c| place(c, 1.0)));
                for f in 0..solid.face_count() {
                    faces.push(loops(f).flat_map(|c| [id(c), second(c)]).collect());
                }
                // Each edge becomes a quad between the two faces.
                for &edge in &ring.edges {
                    let c = edge as usize;
                    let t = solid.twin(c);
                    faces.push(vec![second(c), id(c), second(t), id(t)]);
                }
            }
        }
        // Each vertex becomes a face of the points around it.
        for v in 0..solid.vertex_count() {
            let around = ring.around(v);
            faces.push(match self.operator {
                Operator::Rectify => around.map(|c| ring.edges[ring.edge[c] as usize]).collect(),
                Operator::Omnitruncate => around
                    .flat_map(|c| [id(c), second(ring.prior(c))])
                    .collect(),
                _ => around.map(id).collect(),
            });
        }
        Image { points, faces }
    }
}

/// The image of a solid: points, some of them unused, and faces. Where the solid is closed over a base, face 0 is the
/// image of that base.
struct Image {
    points: Vec<Vec3>,
    faces: Vec<Vec<u32>>,
}

/// Removes the image of the base and puts the corners of the base in its place. `start` is the corner at which pairs
/// begin; the numbers of base corners are those of a cap, below n.
fn replace_base(
    image_mesh: &Image,
    base: &Polygon,
    operator: Operator,
    start: usize,
    has_top: bool,
) -> Cap {
    let n = base.len();
    // The image has reversed orientation; `first` is the corner of the base at its first corner.
    let image = &image_mesh.faces[0];
    let first = match operator {
        // The first point lies on the last edge of q next to its last corner: the end of long edge m-2.
        Operator::Truncate => n - 2 + start,
        // The midpoint of the edge from q's last corner to the one before it, or the corner that
        // corresponds to q's last one.
        Operator::Rectify | Operator::Cantellate | Operator::Snub => n - 1,
        // Along the edge from q's last corner to the one before it, beginning at the last corner.
        Operator::Omnitruncate => n - 3 + start,
    };
    let mut number = vec![u32::MAX; image_mesh.points.len()];
    for (k, &v) in image.iter().enumerate() {
        number[v as usize] = ((first + 2 * n - k) % n) as u32;
    }
    let mut points = Vec::new();
    let mut faces = Vec::with_capacity(image_mesh.faces.len() - 1);
    for face in &image_mesh.faces[1..] {
        let place = |&v: &u32| {
            let slot = &mut number[v as usize];
            if *slot == u32::MAX {
                *slot = (n + points.len()) as u32;
                points.push(image_mesh.points[v as usize]);
            }
            *slot
        };
        faces.push(face.iter().map(place).collect());
    }
    Cap {
        points,
        faces,
        has_top,
    }
}

/// A vector rotated about a unit axis by an angle in radians, counter-clockwise (Rodrigues).
fn rotated(v: Vec3, axis: Vec3, angle: f64) -> Vec3 {
    let along = axis * axis.dot(&v);
    let across = v - along;
    along + angle.cos() * across + angle.sin() * axis.cross(&across)
}

/// A line in space.
#[derive(Clone, Copy)]
struct Line {
    point: Vec3,
    /// Of any length but 0.
    direction: Vec3,
}

/// The point nearest to two lines; `corner` is the number of the corner for messages. The error states that the lines
/// are parallel: the sine of their angle is below 1e-8.
fn crossing(a: Line, b: Line, corner: usize) -> Result<Vec3, String> {
    // The feet a + s u and b + t v of the common normal u x v; their middle where the lines do not meet.
    let (u, v) = (a.direction.normalize(), b.direction.normalize());
    let cross = u.cross(&v);
    let square = cross.norm_squared();
    if square < 1e-16 || !square.is_finite() {
        return Err(format!(
            "the edges at corner {corner} of the derived polygon are parallel; expected edges that meet"
        ));
    }
    let w = b.point - a.point;
    let s = w.cross(&v).dot(&cross) / square;
    let t = w.cross(&u).dot(&cross) / square;
    Ok(((a.point + s * u) + (b.point + t * v)) / 2.0)
}

/// The shrinking s and rotation theta (radians) of regular faces that make all edges of a snub solid equal, for the
/// dihedral angle `delta` in radians; `p` is pi over the number of a face's corners. Two edges across a pair of faces
/// have to equal the edge of a face. The error: Newton's method finds none with 0 < s < 1, |theta| < 1; larger turns of
/// regular faces only repeat these.
fn snub(p: f64, delta: f64) -> Result<(f64, f64), String> {
    // Two faces over the edge from (-1/2, 0, 0) to (1/2, 0, 0), the first in the plane z = 0 on y > 0.
    let radius = 0.5 / p.sin();
    let height = 0.5 / p.tan();
    let place = |s: f64, theta: f64, corner: f64, second: bool| {
        // Corner at -1/2 or 1/2, seen from the face's centre, rotated counter-clockwise.
        let angle = (-height).atan2(0.5 * corner) + theta;
        let (x, y) = (s * radius * angle.cos(), height + s * radius * angle.sin());
        // The second face is the first rotated by 180 degrees about the normal at the common edge's
        // midpoint, then about that edge to the dihedral angle delta; the interior of the solid lies below.
        if second {
            Vec3::new(-x, y * delta.cos(), -y * delta.sin())
        } else {
            Vec3::new(x, y, 0.0)
        }
    };
    let residual = |s: f64, theta: f64| {
        let [a, b] = [-1.0, 1.0].map(|c| place(s, theta, c, false));
        let [d, e] = [-1.0, 1.0].map(|c| place(s, theta, c, true));
        // Corner 1 of the second face lies at corner -1 of the first.
        let edge = (b - a).norm_squared();
        [(a - e).norm_squared() - edge, (a - d).norm_squared() - edge]
    };
    // Newton's method with a numerical Jacobian (its step near the root of the rounding error) from s = 1/2,
    // theta = 1/4; the solutions for regular solids are near it. 60 steps bound the time where there is none.
    let (mut s, mut theta) = (0.5, 0.25);
    for _ in 0..60 {
        let f = residual(s, theta);
        let h = 1e-7;
        let ds = residual(s + h, theta);
        let dt = residual(s, theta + h);
        let j = nalgebra::Matrix2::new(
            (ds[0] - f[0]) / h,
            (dt[0] - f[0]) / h,
            (ds[1] - f[1]) / h,
            (dt[1] - f[1]) / h,
        );
        let Some(step) = j
            .try_inverse()
            .map(|i| i * nalgebra::Vector2::new(f[0], f[1]))
        else {
            break;
        };
        s -= step.x;
        theta -= step.y;
        if step.norm() < 1e-15 {
            break;
        }
    }
    let f = residual(s, theta);
    if f[0].hypot(f[1]) < 1e-12 && s > 0.0 && s < 1.0 && theta.abs() < 1.0 {
        Ok((s, theta))
    } else {
        Err(format!(
            "no snub solid has the dihedral angle {} degrees; expected that of a regular solid",
            delta.to_degrees()
        ))
    }
}
