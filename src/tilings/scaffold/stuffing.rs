//! Solids filled with tets: isosurface stuffing (Labelle and Shewchuk 2007).
//!
//! The tets of the body-centred cubic lattice, long edges a, short ones a sqrt 3 / 2, are cut where the
//! field changes its sign. Lattice points too near to a cut (nearer than 0.24999 of a long, 0.41189
//! of a short edge) are moved onto it first; then the rest of each tet that is inside is one of a few
//! stencils. A quad between two cut edges is halved from the inner end of the long one or, if both are
//! short, from the inner end of even parity, so that neighbours agree. All dihedral angles
//! stay between 10.7 and 164.8 degrees.

use super::{Connectivity, Kind, Scaffold, ScaffoldError};
use druse_geometry::frame::{Aabb, Vec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};

/// A cut nearer to a lattice point than this share of the edge moves the point: long edges, short edges.
const SNAP_SHARES: [f64; 2] = [0.24999, 0.41189];
/// Maximum number of lattice points.
const MAX_LATTICE_POINTS: f64 = 4e7;

/// A lattice point: all coordinates even, or all odd; neighbours of a kind are 2 apart.
type Point = [i32; 3];

/// A vertex of a tet: a lattice point, or the cut of an edge.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
enum Vertex {
    Lattice(Point),
    Cut(Point, Point),
}

struct Lattice {
    origin: Vec3,
    /// World length of one step, half of a long edge.
    step: f64,
    counts: [i32; 3],
}

impl Lattice {
    fn place(&self, p: Point) -> Vec3 {
        self.origin + Vec3::from(p.map(f64::from)) * self.step
    }

    /// Every tet: two neighbours of one kind and an edge of the ring between them.
    fn tets(&self) -> impl Iterator<Item = [Point; 4]> + '_ {
        let [nx, ny, nz] = self.counts;
        let centres =
            (0..nx).flat_map(move |i| (0..ny).flat_map(move |j| (0..nz).map(move |k| [i, j, k])));
        centres.flat_map(move |cell| {
            (0..3usize).flat_map(move |axis| {
                let a = cell.map(|c| 2 * c + 1);
                let mut b = a;
                b[axis] += 2;
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let ring = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(|[s, t]| {
                    let mut p = a;
                    p[axis] += 1;
                    p[u] += s;
                    p[v] += t;
                    p
                });
                // Beyond the last cell there is no neighbour.
                let inside = cell[axis] + 1 < self.counts[axis];
                (0..if inside { 4 } else { 0 }).map(move |i| [a, b, ring[i], ring[(i + 1) % 4]])
            })
        })
    }
}

fn is_long(a: Point, b: Point) -> bool {
    (a[0] - b[0]) % 2 == 0
}

/// The edge between two points, the lower first.
fn edge(a: Point, b: Point) -> (Point, Point) {
    (a.min(b), a.max(b))
}

/// Two points inside and their cuts towards a point outside form a quad: the point from which its diagonal starts.
fn halved_from(p: Point, q: Point, outside: Point) -> Point {
    match (is_long(p, outside), is_long(q, outside)) {
        (true, false) => p,
        (false, true) => q,
        _ => {
            // Both short: p and q are neighbours of a kind, of different parity.
            let odd = p[0].rem_euclid(2);
            let parity = p.iter().map(|c| (c - odd) / 2).sum::<i32>().rem_euclid(2);
            if parity == 0 { p } else { q }
        }
    }
}

impl Scaffold {
    /// Fills the inside of a field (where it is negative) within a box with tets of edges of about
    /// `cell`. The field should be close to a distance within a cell of its surface.
    ///
    /// # Errors
    /// [`ScaffoldError::BadRound`] for a cell without size or an empty box, [`ScaffoldError::TooMany`],
    /// [`ScaffoldError::Empty`] where nothing is inside.
    pub fn stuffed(
        bounds: Aabb,
        cell: f64,
        field: impl Fn(Vec3) -> f64 + Sync,
    ) -> Result<Self, ScaffoldError> {
        let size = bounds.size();
        if !(cell.is_finite() && cell > 0.0) || bounds.is_empty() {
            return Err(ScaffoldError::BadRound {
                radius: size.amax(),
                cell,
            });
        }
        // A cell of room on every side.
        let counts = size.map(|s| (s / cell).ceil() + 3.0);
        let found = 2.0 * counts.product();
        if !found.is_finite() || found > MAX_LATTICE_POINTS {
            return Err(ScaffoldError::TooMany {
                found: found.min(1e18) as usize,
                what: "lattice points",
            });
        }
        let lattice = Lattice {
            origin: bounds.centre().0 - counts * (cell / 2.0),
            step: cell / 2.0,
            counts: [counts.x, counts.y, counts.z].map(|c| c as i32),
        };
        let mut points: Vec<Point> = lattice.tets().flatten().collect();
        points.sort_unstable();
        points.dedup();
        let values: Vec<f64> = points
            .par_iter()
            .map(|&p| -field(lattice.place(p)))
            .collect();
        let mut stuffing = Stuffing {
            value: points.into_iter().zip(values).collect(),
            cuts: BTreeMap::new(),
            moved: HashMap::new(),
            lattice,
            node_of: HashMap::new(),
            nodes: Vec::new(),
            elements: Connectivity::default(),
        };
        stuffing.cut(&field);
        stuffing.warp();
        let tets: Vec<[Point; 4]> = stuffing.lattice.tets().collect();
        for tet in tets {
            stuffing.fill(tet);
        }
        Self::new(stuffing.nodes, stuffing.elements)
    }

    /// Least and greatest dihedral angle of the straight tets, degrees; `None` if there are none.
    pub fn dihedral_range(&self) -> Option<[f64; 2]> {
        let mut range: Option<[f64; 2]> = None;
        for e in self.elements().filter(|e| e.kind() == Kind::Tet4) {
            let p = [0, 1, 2, 3].map(|i| self.nodes()[e.nodes()[i] as usize]);
            for [i, j, k, l] in [
                [0, 1, 2, 3],
                [0, 2, 1, 3],
                [0, 3, 1, 2],
                [1, 2, 0, 3],
                [1, 3, 0, 2],
                [2, 3, 0, 1],
            ] {
                let along = p[j] - p[i];
                let off = |v: Vec3| v - along * (v.dot(&along) / along.norm_squared());
                let angle = off(p[k] - p[i]).angle(&off(p[l] - p[i])).to_degrees();
                let [a, b] = range.unwrap_or([angle; 2]);
                range = Some([a.min(angle), b.max(angle)]);
            }
        }
        range
    }
}

struct Stuffing {
    lattice: Lattice,
    /// Positive inside; 0 for points that were moved onto the surface.
    value: HashMap<Point, f64>,
    /// Where edges are cut, from their lower end, as a share.
    cuts: BTreeMap<(Point, Point), f64>,
    moved: HashMap<Point, Vec3>,
    /// The node made for each vertex.
    node_of: HashMap<Vertex, u32>,
    nodes: Vec<Vec3>,
    elements: Connectivity,
}

impl Stuffing {
    /// Finds the cuts of all edges whose ends differ in sign.
    fn cut(&mut self, field: &(impl Fn(Vec3) -> f64 + Sync)) {
        let mut edges: Vec<(Point, Point)> = Vec::new();
        for t in self.lattice.tets() {
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                if (self.value[&t[i]] > 0.0) != (self.value[&t[j]] > 0.0) {
                    edges.push(edge(t[i], t[j]));
                }
            }
        }
        edges.sort_unstable();
        edges.dedup();
        let shares: Vec<f64> = edges
            .par_iter()
            .map(|(a, b)| {
                let (x, y) = (self.lattice.place(*a), self.lattice.place(*b));
                let at = |t: f64| -field(x + (y - x) * t);
                let (mut low, mut high) = ((0.0, self.value[a]), (1.0, self.value[b]));
                let mut t = 0.5;
                for _ in 0..6 {
                    t = low.0 + (high.0 - low.0) * low.1 / (low.1 - high.1);
                    let v = at(t);
                    if (v > 0.0) == (low.1 > 0.0) {
                        low = (t, v);
                    } else {
                        high = (t, v);
                    }
                }
                t.clamp(0.0, 1.0)
            })
            .collect();
        self.cuts = edges.into_iter().zip(shares).collect();
    }

    /// Moves lattice points onto cuts that are too near to them.
    fn warp(&mut self) {
        let mut around: BTreeMap<Point, Vec<(Point, Point)>> = BTreeMap::new();
        for &(a, b) in self.cuts.keys() {
            around.entry(a).or_default().push((a, b));
            around.entry(b).or_default().push((a, b));
        }
        for (p, edges) in around {
            let mut nearest: Option<(f64, (Point, Point))> = None;
            for e in &edges {
                let Some(&t) = self.cuts.get(e) else { continue };
                let share = if e.0 == p { t } else { 1.0 - t };
                let long = is_long(e.0, e.1);
                if share < SNAP_SHARES[usize::from(!long)] {
                    let distance = share * if long { 2.0 } else { 3f64.sqrt() };
                    if nearest.is_none_or(|n| distance < n.0) {
                        nearest = Some((distance, *e));
                    }
                }
            }
            if let Some((_, e)) = nearest {
                let place = self.cut_place(e);
                self.moved.insert(p, place);
                self.value.insert(p, 0.0);
                for e in &edges {
                    self.cuts.remove(e);
                }
            }
        }
    }

    fn cut_place(&self, (a, b): (Point, Point)) -> Vec3 {
        let (x, y) = (self.lattice.place(a), self.lattice.place(b));
        x + (y - x) * self.cuts[&(a, b)]
    }

    fn position(&self, v: Vertex) -> Vec3 {
        match v {
            Vertex::Lattice(p) => self
                .moved
                .get(&p)
                .copied()
                .unwrap_or_else(|| self.lattice.place(p)),
            Vertex::Cut(a, b) => self.cut_place((a, b)),
        }
    }

    fn push(&mut self, mut tet: [Vertex; 4]) {
        let p = tet.map(|v| self.position(v));
        if (p[1] - p[0]).cross(&(p[2] - p[0])).dot(&(p[3] - p[0])) < 0.0 {
            tet.swap(2, 3);
        }
        let own = tet.map(|v| {
            let place = self.position(v);
            *self.node_of.entry(v).or_insert_with(|| {
                self.nodes.push(place);
                self.nodes.len() as u32 - 1
            })
        });
        self.elements.push(Kind::Tet4, &own);
    }

    /// Adds the part of a lattice tet that is inside.
    fn fill(&mut self, tet: [Point; 4]) {
        let value = tet.map(|p| self.value[&p]);
        let of = |test: fn(f64) -> bool| -> Vec<Point> {
            (0..4).filter(|&i| test(value[i])).map(|i| tet[i]).collect()
        };
        let (inside, zero, outside) = (of(|v| v > 0.0), of(|v| v == 0.0), of(|v| v < 0.0));
        let at = Vertex::Lattice;
        let between = |a: Point, b: Point| {
            let (a, b) = edge(a, b);
            Vertex::Cut(a, b)
        };
        match (&inside[..], &zero[..], &outside[..]) {
            ([], ..) => {}
            (_, _, []) => self.push(tet.map(at)),
            ([p], ..) => {
                let rest: Vec<Vertex> = zero
                    .iter()
                    .map(|&z| at(z))
                    .chain(outside.iter().map(|&n| between(*p, n)))
                    .collect();
                self.push([at(*p), rest[0], rest[1], rest[2]]);
            }
            ([p, q], [z], [n]) => {
                let from = halved_from(*p, *q, *n);
                let other = if from == *p { *q } else { *p };
                self.push([at(*z), at(from), at(other), between(other, *n)]);
                self.push([at(*z), at(from), between(other, *n), between(from, *n)]);
            }
            ([p, q, r], [], [n]) => {
                let a = [*p, *q, *r];
                let halves = [0, 1, 2].map(|k| halved_from(a[k], a[(k + 1) % 3], *n) == a[k]);
                let prism = prism(a.map(at), a.map(|p| between(p, *n)), halves);
                for t in prism {
                    self.push(t);
                }
            }
            ([p, q], [], [n, m]) => {
                let a = [at(*p), between(*p, *n), between(*p, *m)];
                let b = [at(*q), between(*q, *n), between(*q, *m)];
                let first = halved_from(*p, *q, *n) == *p;
                let last = halved_from(*p, *q, *m) != *p;
                // The quad of four cuts is inside the tet: halved as is better for the angles.
                let ways = [true, false]
                    .into_iter()
                    .filter(|&way| !(first == way && way == last))
                    .map(|way| prism(a, b, [first, way, last]));
                let best = ways.max_by(|s, t| self.roundness(s).total_cmp(&self.roundness(t)));
                for t in best.into_iter().flatten() {
                    self.push(t);
                }
            }
            _ => {}
        }
    }

    /// The least ratio of six times a tet's volume to the cube of its longest edge.
    fn roundness(&self, tets: &[[Vertex; 4]]) -> f64 {
        let one = |t: &[Vertex; 4]| {
            let p = t.map(|v| self.position(v));
            let volume = (p[1] - p[0])
                .cross(&(p[2] - p[0]))
                .dot(&(p[3] - p[0]))
                .abs();
            let mut longest = 0f64;
            for i in 0..4 {
                for j in 0..i {
                    longest = longest.max((p[i] - p[j]).norm());
                }
            }
            volume / longest.powi(3)
        };
        tets.iter().map(one).fold(f64::INFINITY, f64::min)
    }
}

/// The three tets of a prism between triangles a and b; `halves[k]`: the quad over the edge k, k + 1 is
/// halved from `a[k]` to `b[k + 1]`, else from `a[k + 1]` to `b[k]`. Not all may be alike.
fn prism(a: [Vertex; 3], b: [Vertex; 3], halves: [bool; 3]) -> Vec<[Vertex; 4]> {
    let first = (0..3).find(|&i| halves[i] && !halves[(i + 2) % 3]);
    let Some(i) = first else {
        return Vec::new();
    };
    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
    let mut all = vec![[a[i], b[0], b[1], b[2]]];
    if halves[j] {
        all.push([a[i], a[j], a[k], b[k]]);
        all.push([a[i], a[j], b[k], b[j]]);
    } else {
        all.push([a[i], a[j], a[k], b[j]]);
        all.push([a[i], a[k], b[k], b[j]]);
    }
    all
}
