//! The outer faces of a component as a closed triangle mesh.
//!
//! Curved faces are bisected until no point of the mesh is further from the face point with the
//! same parameters than a given chordal error. Let m bound |F''\[e, e\]| over the face for the
//! parameter vectors e of a triangle's edges. The linear interpolant is off by at most m/6 where F''
//! is constant (triangles of quadratic elements), m/2 in general (quads): a triangle is fine when
//! every edge is. Whether an edge is bisected depends on that edge alone, for the sides of a face on
//! both faces that meet there, so the mesh has no cracks. In a plane only the sides count: any
//! triangles between them are the face, so long as none is turned over.

use super::{FaceRef, Kind, Scaffold};
use druse_geometry::frame::{CellPoint, Vec3};
use druse_geometry::mesh::TriMesh;
use std::collections::HashMap;

/// Minimum length of the parts that a side is divided into, as a share of the side.
const MIN_PART_LENGTH: f64 = 1.0 / 1024.0;

/// Nodes this far from a plane count as in it, as a share of the chordal error: they are rounded, and add little to it.
const PLANE_TOLERANCE: f64 = 1.0 / 64.0;

/// A component's surface.
#[derive(Clone, Debug)]
pub struct Boundary {
    /// Closed, counter-clockwise seen from outside, world units.
    pub mesh: TriMesh,
    /// The face that each triangle approximates.
    pub faces: Vec<FaceRef>,
}

impl Scaffold {
    /// The outer faces of a component (see [`Scaffold::components`]), curved ones subdivided until they differ from the
    /// mesh by less than `chordal_error` (world units, positive) or their edges are a 1024th of a side. Vertices are
    /// numbered as they are made, so that the mesh cannot be invalid.
    ///
    /// # Panics
    /// If there is no such component.
    pub fn boundary(&self, component: usize, chordal_error: f64) -> Boundary {
        let outer: Vec<Surface> = self.components()[component]
            .iter()
            .flat_map(|&e| self.faces_of(e as usize))
            .filter(|f| self.neighbour(*f) == super::Neighbour::Outside)
            .map(|f| Surface::new(self, f, chordal_error))
            .collect();
        // Two faces share a side. The greater error of both decides how often it is cut, so that no gap opens.
        let mut sides: HashMap<[u32; 2], f64> = HashMap::new();
        for s in &outer {
            for i in 0..s.count() {
                let error = sides.entry(s.side(i)).or_default();
                *error = error.max(s.error(s.step(i)));
            }
        }
        let mut builder = Builder {
            scaffold: self,
            tolerance: chordal_error,
            sides,
            numbers: HashMap::new(),
            points: Vec::new(),
            triangles: Vec::new(),
            faces: Vec::new(),
        };
        for s in &outer {
            builder.add(s);
        }
        Boundary {
            mesh: TriMesh::new(builder.points, builder.triangles)
                .expect("vertices are numbered as they are made"),
            faces: builder.faces,
        }
    }
}

/// Parameters on a face: barycentrics of corners 1 and 2 of a triangle, `[0, 1]^2` of a quad.
type Spot = [f64; 2];

/// One outer face.
struct Surface {
    face: FaceRef,
    kind: Kind,
    /// Node numbers of the corners, counter-clockwise seen from outside.
    corners: Vec<u32>,
    /// Node numbers of the mid nodes, beside them.
    mids: Vec<u32>,
    /// The corners in the cell frame.
    xi: Vec<Vec3>,
    /// Second derivatives: exact for triangles; bounds along x for quads.
    second: [Vec3; 3],
    /// The outward unit normal of a face in a plane; `None` for others and for those without area.
    plane_normal: Option<Vec3>,
}

impl Surface {
    /// The face with its corners counter-clockwise seen from outside, and its second derivatives. Mid node i lies on
    /// the side from corner i to the next.
    fn new(scaffold: &Scaffold, face: FaceRef, chordal_error: f64) -> Self {
        let e = scaffold.element(face.element as usize);
        let kind = e.kind();
        let local = kind.faces()[face.face as usize];
        let reference = kind.reference_nodes();
        let mut corners = local.corners.to_vec();
        let mut mids = local.mids.to_vec();
        // A mirrored element shows its faces the other way round.
        if e.volume() < 0.0 {
            corners.reverse();
            // The side from corner i to i + 1 keeps its mid node.
            mids.reverse();
            if !mids.is_empty() {
                mids.rotate_left(1);
            }
        }
        let number = |n: &u8| e.nodes()[*n as usize];
        let point = |n: &u8| scaffold.nodes()[number(n) as usize];
        let c: Vec<Vec3> = corners.iter().map(point).collect();
        let m: Vec<Vec3> = mids.iter().map(point).collect();
        let centre = local.centre.map(|n| point(&n));
        let second = if c.len() == 3 {
            triangle_bend(&c, &m)
        } else {
            quad_bend(&c, &m, centre)
        };
        // The diagonals of a quad, two sides of a triangle.
        let [u, v] = [c[2] - c[0], c[c.len() - 1] - c[1]];
        let normal = u.cross(&v).try_normalize(0.0);
        let is_in_plane = |n: &Vec3| {
            let mut all = c.iter().chain(&m).chain(&centre);
            all.all(|p| n.dot(&(p - c[0])).abs() <= PLANE_TOLERANCE * chordal_error)
        };
        Self {
            face,
            kind,
            xi: corners.iter().map(|&n| reference[n as usize].0).collect(),
            corners: corners.iter().map(number).collect(),
            mids: mids.iter().map(number).collect(),
            second,
            plane_normal: normal.filter(is_in_plane),
        }
    }

    fn count(&self) -> usize {
        self.corners.len()
    }

    /// The corner nodes of side i in ascending order: its name on both faces.
    fn side(&self, i: usize) -> [u32; 2] {
        let mut ends = [self.corners[i], self.corners[(i + 1) % self.count()]];
        ends.sort_unstable();
        ends
    }

    fn spot(&self, corner: usize) -> Spot {
        match (self.count(), corner) {
            (_, 0) => [0.0, 0.0],
            (_, 1) => [1.0, 0.0],
            (4, 2) => [1.0, 1.0],
            _ => [0.0, 1.0],
        }
    }

    fn step(&self, side: usize) -> Spot {
        let (a, b) = (self.spot(side), self.spot((side + 1) % self.count()));
        [b[0] - a[0], b[1] - a[1]]
    }

    /// What an edge with this parameter vector adds to the chordal error at most.
    fn error(&self, e: Spot) -> f64 {
        let [ss, tt, st] = self.second;
        if self.count() == 3 {
            (ss * (e[0] * e[0]) + tt * (e[1] * e[1]) + st * (2.0 * e[0] * e[1])).norm() / 6.0
        } else {
            (ss.x * e[0] * e[0] + tt.x * e[1] * e[1] + 2.0 * st.x * (e[0] * e[1]).abs()) / 2.0
        }
    }

    fn place(&self, [s, t]: Spot) -> CellPoint<3> {
        let x = &self.xi;
        CellPoint(if self.count() == 3 {
            x[0] * (1.0 - s - t) + x[1] * s + x[2] * t
        } else {
            (x[0] * (1.0 - s) + x[1] * s) * (1.0 - t) + (x[3] * (1.0 - s) + x[2] * s) * t
        })
    }
}

/// Second derivatives ss, tt, st of a triangle with (or without) mid nodes.
fn triangle_bend(c: &[Vec3], m: &[Vec3]) -> [Vec3; 3] {
    if m.is_empty() {
        return [Vec3::zeros(); 3];
    }
    let control = |i: usize| m[i] * 2.0 - (c[i] + c[(i + 1) % 3]) / 2.0;
    let (e01, e12, e20) = (control(0), control(1), control(2));
    [
        (c[0] - e01 * 2.0 + c[1]) * 2.0,
        (c[0] - e20 * 2.0 + c[2]) * 2.0,
        (c[0] - e01 - e20 + e12) * 2.0,
    ]
}

/// Bounds of the lengths of the second derivatives ss, tt, st over a quad, each in x. `c` are its corners, `m` its mid
/// nodes if it is quadratic; without `centre` its middle follows from them. Order of `c`: around the quad; `m[i]` is
/// between corners i and i + 1.
fn quad_bend(c: &[Vec3], m: &[Vec3], centre: Option<Vec3>) -> [Vec3; 3] {
    let length = |l: f64| Vec3::new(l, 0.0, 0.0);
    if m.is_empty() {
        let twist = (c[0] - c[1] + c[2] - c[3]).norm();
        return [length(0.0), length(0.0), length(twist)];
    }
    // A quadratic's Bernstein coefficients by row and column; second derivatives are means of their second differences.
    let centre =
        centre.unwrap_or_else(|| m.iter().sum::<Vec3>() / 2.0 - c.iter().sum::<Vec3>() / 4.0);
    let bernstein = |[a, b, c]: [Vec3; 3]| [a, b * 2.0 - (a + c) / 2.0, c];
    // Rows of constant t, then columns.
    let rows = [
        bernstein([c[0], m[0], c[1]]),
        bernstein([m[3], centre, m[1]]),
        bernstein([c[3], m[2], c[2]]),
    ];
    let columns = [0, 1, 2].map(|i| bernstein([rows[0][i], rows[1][i], rows[2][i]]));
    let at = |s: usize, t: usize| columns[s][t];
    let greatest = |lengths: &mut dyn Iterator<Item = f64>| length(lengths.fold(0.0, f64::max));
    [
        greatest(&mut (0..3).map(|t| 2.0 * (at(0, t) - at(1, t) * 2.0 + at(2, t)).norm())),
        greatest(&mut (0..3).map(|s| 2.0 * (at(s, 0) - at(s, 1) * 2.0 + at(s, 2)).norm())),
        greatest(&mut (0..4).map(|i| {
            let (s, t) = (i % 2, i / 2);
            4.0 * (at(s + 1, t + 1) - at(s, t + 1) - at(s + 1, t) + at(s, t)).norm()
        })),
    ]
}

/// What names a vertex, so that faces that meet there share it.
#[derive(PartialEq, Eq, Hash)]
enum Name {
    Node(u32),
    /// Between two nodes, at a dyadic fraction from the lower one.
    Side([u32; 2], u64),
    /// Inside a face, at dyadic parameters.
    Inner(FaceRef, [u64; 2]),
}

/// A triangle being bisected: corners, and which side of the face each edge (0-1, 1-2, 2-0) is on.
#[derive(Clone, Copy)]
struct Piece {
    spots: [Spot; 3],
    vertices: [u32; 3],
    sides: [Option<u8>; 3],
}

struct Builder<'a> {
    scaffold: &'a Scaffold,
    tolerance: f64,
    /// The greatest error of each side, over the faces it bounds.
    sides: HashMap<[u32; 2], f64>,
    numbers: HashMap<Name, u32>,
    points: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    faces: Vec<FaceRef>,
}

impl Builder<'_> {
    /// Adds the triangles of an outer face, fine enough for its curvature.
    fn add(&mut self, s: &Surface) {
        let first = self.triangles.len();
        self.divide(s, s.plane_normal.is_some());
        let Some(normal) = s.plane_normal else {
            return;
        };
        let is_turned_over = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| self.points[v as usize]);
            (b - a).cross(&(c - a)).dot(&normal) <= 0.0
        };
        // Curved sides may reach across triangles that are too long. The points on them remain.
        if self.triangles[first..].iter().any(is_turned_over) {
            self.triangles.truncate(first);
            self.faces.truncate(first);
            self.divide(s, false);
        }
    }

    /// Divides an outer face into triangles; one in a plane by its sides alone, if `by_sides`. A side has the error of
    /// both faces at it, so that they have the same points on it.
    fn divide(&mut self, s: &Surface, by_sides: bool) {
        let n = s.count();
        let corners: Vec<u32> = (0..n).map(|i| self.corner(s, i)).collect();
        let side = |i: usize| Some(i as u8);
        // A triangle is bisected as it is.
        if n == 3 {
            self.refine(
                s,
                Piece {
                    spots: [s.spot(0), s.spot(1), s.spot(2)],
                    vertices: [corners[0], corners[1], corners[2]],
                    sides: [side(0), side(1), side(2)],
                },
                by_sides,
            );
            return;
        }
        let flat = (by_sides || s.error([1.0, 1.0]) <= self.tolerance)
            && (0..4).all(|i| self.sides[&s.side(i)] <= self.tolerance);
        if flat {
            // Along the diagonal of the lowest node: the same whatever the numbering in the element.
            let first = (0..4).min_by_key(|&i| s.corners[i]).unwrap_or(0);
            let c = |i: usize| corners[(first + i) % 4];
            self.emit(s, [c(0), c(1), c(2)]);
            self.emit(s, [c(0), c(2), c(3)]);
            return;
        }
        // A curved quad begins as four triangles around its middle.
        let middle = self.inner(s, [0.5, 0.5]);
        for i in 0..4 {
            let j = (i + 1) % 4;
            self.refine(
                s,
                Piece {
                    spots: [s.spot(i), s.spot(j), [0.5, 0.5]],
                    vertices: [corners[i], corners[j], middle],
                    sides: [side(i), None, None],
                },
                by_sides,
            );
        }
    }

    /// Adds a finished triangle with its face.
    fn emit(&mut self, s: &Surface, triangle: [u32; 3]) {
        self.triangles.push(triangle);
        self.faces.push(s.face);
    }

    /// Bisects the worst edge until all are within the tolerance. A piece keeps for each of its edges the side of the
    /// face that it lies on. With `by_sides` no other edge is bisected.
    fn refine(&mut self, s: &Surface, whole: Piece, by_sides: bool) {
        // An edge on a side has the side's error from both faces, so that both cut it alike.
        let mut open = vec![whole];
        while let Some(p) = open.pop() {
            let errors = [0, 1, 2].map(|i| {
                if by_sides && p.sides[i].is_none() {
                    0.0
                } else {
                    self.edge_error(s, &p, i)
                }
            });
            let worst = (1..3).fold(0, |w, i| if errors[i] > errors[w] { i } else { w });
            if errors[worst] <= self.tolerance {
                self.emit(s, p.vertices);
                continue;
            }
            let [i, j, k] = [worst, (worst + 1) % 3, (worst + 2) % 3];
            let spot = [0, 1].map(|a| f64::midpoint(p.spots[i][a], p.spots[j][a]));
            let vertex = match p.sides[i] {
                Some(side) => self.on_side(s, side as usize, spot),
                None => self.inner(s, spot),
            };
            let half = |corner: usize, new_side: usize| {
                let mut h = p;
                h.spots[corner] = spot;
                h.vertices[corner] = vertex;
                // The edge from the midpoint to the opposite corner is new.
                h.sides[new_side] = None;
                h
            };
            open.push(half(i, k));
            open.push(half(j, j));
        }
    }

    /// The error of edge i of a piece: that of its side from both faces, scaled to the edge's part of the side, or of
    /// the face alone inside it; 0 for an edge too short to cut.
    fn edge_error(&self, s: &Surface, p: &Piece, i: usize) -> f64 {
        let (a, b) = (p.spots[i], p.spots[(i + 1) % 3]);
        let e = [b[0] - a[0], b[1] - a[1]];
        let length = e[0].abs().max(e[1].abs());
        if length <= MIN_PART_LENGTH {
            return 0.0;
        }
        match p.sides[i] {
            Some(side) => self.sides[&s.side(side as usize)] * length * length,
            None => s.error(e),
        }
    }

    /// The number of the vertex with this name; `point` makes it at the first call.
    fn number(&mut self, name: Name, point: impl FnOnce() -> Vec3) -> u32 {
        let points = &mut self.points;
        *self.numbers.entry(name).or_insert_with(|| {
            points.push(point());
            points.len() as u32 - 1
        })
    }

    /// The vertex at corner i of a face.
    fn corner(&mut self, s: &Surface, i: usize) -> u32 {
        let node = s.corners[i];
        let point = self.scaffold.nodes()[node as usize];
        self.number(Name::Node(node), || point)
    }

    /// The vertex at parameters inside a face.
    fn inner(&mut self, s: &Surface, spot: Spot) -> u32 {
        let element = self.scaffold.element(s.face.element as usize);
        self.number(Name::Inner(s.face, spot.map(f64::to_bits)), || {
            element.map(s.place(spot)).0
        })
    }

    /// A point of a side, the same bits from both faces.
    fn on_side(&mut self, s: &Surface, side: usize, spot: Spot) -> u32 {
        let [low, high] = s.side(side);
        let start = s.spot(side);
        let from_start = (spot[0] - start[0]).abs().max((spot[1] - start[1]).abs());
        let f = if s.corners[side] == low {
            from_start
        } else {
            1.0 - from_start
        };
        let nodes = self.scaffold.nodes();
        let (a, b) = (nodes[low as usize], nodes[high as usize]);
        let mid = s.mids.get(side).map(|&m| nodes[m as usize]);
        debug_assert_eq!(mid.is_some(), s.kind.degree() == 2);
        self.number(Name::Side([low, high], f.to_bits()), || match mid {
            None => a + (b - a) * f,
            Some(m) => {
                let bulge = m - (a + b) / 2.0;
                a + (b - a) * f + bulge * (4.0 * f * (1.0 - f))
            }
        })
    }
}
