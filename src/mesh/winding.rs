//! The generalised winding number: how often a surface goes round a point, for any triangles at all.
//!
//! w(q) = sum over triangles of (solid angle seen from q) / 4 pi: 1 inside and 0 outside a closed
//! outward mesh, and a smooth harmonic function where the surface is open. Far groups of triangles
//! count by the Taylor expansion of F(d) = d / |d|^3 about their area-weighted centre c, once
//! |c - q| > some times the group's radius; near triangles count exactly (Barill, Dickson, Schmidt,
//! Levin, Jacobson, *Fast winding numbers for soups and clouds*, 2018, second order). With r = c - q,
//! the area vectors n and places c + e of the group's surface, and
//! N = int n, M = int e n, T = int e e n / 2, its solid angle is
//! N.r / r^3 - 3 r.M.r / r^5 + 15 T(r, r, r) / r^7 for the symmetric traceless parts of M and T: the
//! rest does not count, since F is a gradient and has no divergence.

use super::bvh::{Child, Node};
use super::soup::Soup;
use super::triangle::SolidAngle;
use crate::frame::{Mat3, Vec3};

/// How many radii away a group counts by its expansion: with this many, coarse meshes are off by up to
/// 0.004, fine ones by less.
pub(crate) const FINE: f32 = 2.0;
/// With this many a sum takes half the time; it is off by less than a tenth.
pub(crate) const FAST: f32 = 1.3;
/// Inner nodes that wait at most (see the hierarchy's own bound).
const STACK: usize = 256;
/// Index pairs and triples of the components of M and T that are kept.
const PAIRS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [0, 2], [1, 2]];
const TRIPLES: [[usize; 3]; 10] = [
    [0, 0, 0],
    [1, 1, 1],
    [2, 2, 2],
    [0, 0, 1],
    [0, 0, 2],
    [1, 1, 0],
    [1, 1, 2],
    [2, 2, 0],
    [2, 2, 1],
    [0, 1, 2],
];

/// Expansions of a node's four children, by lane, in the tree's local frame.
#[repr(align(64))]
#[derive(Clone)]
struct Expansions {
    centre: [[f32; 4]; 3],
    normal: [[f32; 4]; 3],
    /// -3 M by [`PAIRS`], those off the diagonal twice.
    pairs: [[f32; 4]; 6],
    /// 15 T by [`TRIPLES`], as often as the triple can be ordered.
    triples: [[f32; 4]; 10],
    /// radius^2; infinite never to be taken.
    radius2: [f32; 4],
}

/// One group's moments while they are gathered.
#[derive(Clone, Copy)]
struct Moment {
    area: f64,
    /// Area times centre.
    first: Vec3,
    /// N.
    normal: Vec3,
    /// M about the centre: row the place, column the area vector.
    second: Mat3,
    /// 2 T about the centre: for every component of the area vector the matrix of the places.
    third: [Mat3; 3],
    radius: f64,
}

impl Moment {
    const ZERO: Self = Self {
        area: 0.0,
        first: Vec3::new(0.0, 0.0, 0.0),
        normal: Vec3::new(0.0, 0.0, 0.0),
        second: Mat3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        third: [Mat3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0); 3],
        radius: 0.0,
    };

    fn centre(&self) -> Vec3 {
        if self.area > 0.0 {
            self.first / self.area
        } else {
            self.first
        }
    }

    /// Adds what another has about a centre that lies `by` from this one's.
    fn add_moved(&mut self, other: &Self, by: Vec3) {
        self.normal += other.normal;
        self.second += other.second + by * other.normal.transpose();
        for j in 0..3 {
            let row = other.second.column(j) * by.transpose();
            self.third[j] +=
                other.third[j] + row + row.transpose() + by * by.transpose() * other.normal[j];
        }
    }

    /// -3 M and 15 T, symmetric and traceless.
    fn traceless(&self) -> ([f64; 6], [f64; 10]) {
        let mean = self.second.trace() / 3.0;
        let pairs = PAIRS.map(|[i, j]| {
            if i == j {
                -3.0 * (self.second[(i, i)] - mean)
            } else {
                -3.0 * (self.second[(i, j)] + self.second[(j, i)])
            }
        });
        let whole = |i: usize, j: usize, k: usize| {
            let t = &self.third;
            (t[k][(i, j)] + t[i][(j, k)] + t[j][(k, i)]) / 6.0
        };
        let trace = [0, 1, 2].map(|k| (0..3).map(|i| whole(i, i, k)).sum::<f64>() / 5.0);
        let triples = TRIPLES.map(|[i, j, k]| {
            let mut value = whole(i, j, k);
            value -= f64::from(u8::from(i == j)) * trace[k];
            value -= f64::from(u8::from(j == k)) * trace[i];
            value -= f64::from(u8::from(i == k)) * trace[j];
            let orders = match (i == j, j == k) {
                (true, true) => 1.0,
                (false, false) => 6.0,
                _ => 3.0,
            };
            15.0 * orders * value
        });
        (pairs, triples)
    }
}

/// Expansions for every node of a soup's tree.
pub(crate) struct Winding {
    expansions: Vec<Expansions>,
}

impl Winding {
    pub(crate) fn new(soup: &Soup) -> Self {
        let nodes = soup.bvh.nodes();
        let local = soup.bvh.local();
        let mut lanes = vec![[Moment::ZERO; 4]; nodes.len()];
        // Children come after their parents.
        for n in (0..nodes.len()).rev() {
            for l in 0..4 {
                lanes[n][l] = match nodes[n].child(l) {
                    Child::None => Moment::ZERO,
                    Child::Inner(c) => group(&lanes[c]),
                    Child::Leaf(slots) => {
                        let corners = soup.corners[slots].iter();
                        leaf(corners.map(|t| t.map(|p| local.point(p))))
                    }
                };
            }
        }
        Self {
            expansions: lanes.iter().map(pack).collect(),
        }
    }

    /// The winding number of `q`; groups count by their expansions `away` radii away.
    pub(crate) fn number(&self, soup: &Soup, q: Vec3, away: f32) -> f64 {
        let nodes = soup.bvh.nodes();
        if nodes.is_empty() {
            return 0.0;
        }
        let local = soup.bvh.local().point(q);
        if local.amax() > 1e9 || !local.iter().all(|c| c.is_finite()) {
            return 0.0;
        }
        let p = [local.x as f32, local.y as f32, local.z as f32];
        let away2 = away * away;
        let mut near = SolidAngle::ZERO;
        let mut far = 0f64;
        let mut stack = [0u32; STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let n = stack[top] as usize;
            let (flux, is_far) = self.expansions[n].seen_from(p, away2);
            let node: &Node = &nodes[n];
            for l in 0..4 {
                if is_far[l] {
                    far += f64::from(flux[l]);
                    continue;
                }
                match node.child(l) {
                    Child::None => {}
                    Child::Inner(c) => {
                        stack[top] = c as u32;
                        top += 1;
                    }
                    Child::Leaf(slots) => soup.corners[slots].iter().for_each(|t| near.add(t, q)),
                }
            }
        }
        near.winding() + far / (4.0 * std::f64::consts::PI)
    }
}

impl Expansions {
    /// Solid angle of each lane by its expansion, and whether the lane is far enough for that.
    fn seen_from(&self, p: [f32; 3], away2: f32) -> ([f32; 4], [bool; 4]) {
        let mut r = [[0f32; 4]; 3];
        let mut d2 = [0f32; 4];
        for a in 0..3 {
            for l in 0..4 {
                r[a][l] = self.centre[a][l] - p[a];
                d2[l] += r[a][l] * r[a][l];
            }
        }
        let mut far = [false; 4];
        for l in 0..4 {
            far[l] = d2[l] > away2 * self.radius2[l];
        }
        if far == [false; 4] {
            return ([0.0; 4], far);
        }
        let (mut one, mut two, mut three) = ([0f32; 4], [0f32; 4], [0f32; 4]);
        for a in 0..3 {
            for l in 0..4 {
                one[l] += self.normal[a][l] * r[a][l];
            }
        }
        for (own, [i, j]) in self.pairs.iter().zip(PAIRS) {
            for l in 0..4 {
                two[l] += own[l] * r[i][l] * r[j][l];
            }
        }
        for (own, [i, j, k]) in self.triples.iter().zip(TRIPLES) {
            for l in 0..4 {
                three[l] += own[l] * r[i][l] * r[j][l] * r[k][l];
            }
        }
        let mut flux = [0f32; 4];
        for l in 0..4 {
            let inverse2 = 1.0 / d2[l];
            flux[l] =
                (one[l] + (two[l] + three[l] * inverse2) * inverse2) * inverse2 * inverse2.sqrt();
        }
        (flux, far)
    }
}

/// The moment of a leaf's triangles.
fn leaf(triangles: impl Iterator<Item = [Vec3; 3]> + Clone) -> Moment {
    let mut m = Moment::ZERO;
    let parts: Vec<(Moment, Vec3)> = triangles
        .clone()
        .map(|[a, b, c]| {
            let normal = (b - a).cross(&(c - a)) / 2.0;
            let centre = (a + b + c) / 3.0;
            // The mean of e e over a triangle.
            let spread = [a, b, c].map(|v| (v - centre) * (v - centre).transpose());
            let spread = (spread[0] + spread[1] + spread[2]) / 12.0;
            let part = Moment {
                area: normal.norm(),
                normal,
                third: [0, 1, 2].map(|j| spread * normal[j]),
                ..Moment::ZERO
            };
            (part, centre)
        })
        .collect();
    for (part, centre) in &parts {
        m.area += part.area;
        m.first += centre * part.area;
    }
    if m.area == 0.0 {
        m.first = parts.first().map_or(Vec3::zeros(), |p| p.1);
    }
    let middle = m.centre();
    for (part, centre) in &parts {
        m.add_moved(part, centre - middle);
    }
    m.radius = triangles
        .flatten()
        .map(|p| (p - middle).norm())
        .fold(0.0, f64::max);
    m
}

/// The moment of four lanes together; its radius holds theirs.
fn group(lanes: &[Moment; 4]) -> Moment {
    let mut m = Moment::ZERO;
    let filled = || lanes.iter().filter(|l| l.area > 0.0);
    for l in filled() {
        m.area += l.area;
        m.first += l.first;
    }
    if m.area == 0.0 {
        m.first = lanes[0].first;
    }
    let centre = m.centre();
    for l in filled() {
        let by = l.centre() - centre;
        m.add_moved(l, by);
        m.radius = m.radius.max(by.norm() + l.radius);
    }
    m
}

fn pack(lanes: &[Moment; 4]) -> Expansions {
    let mut e = Expansions {
        centre: [[0.0; 4]; 3],
        normal: [[0.0; 4]; 3],
        pairs: [[0.0; 4]; 6],
        triples: [[0.0; 4]; 10],
        radius2: [f32::INFINITY; 4],
    };
    for (l, m) in lanes.iter().enumerate() {
        let centre = m.centre();
        for a in 0..3 {
            e.centre[a][l] = centre[a] as f32;
            e.normal[a][l] = m.normal[a] as f32;
        }
        let (pairs, triples) = m.traceless();
        for (to, from) in e.pairs.iter_mut().zip(pairs) {
            to[l] = from as f32;
        }
        for (to, from) in e.triples.iter_mut().zip(triples) {
            to[l] = from as f32;
        }
        // Rounding of a small far-away group: its radius in f32 must not vanish before its place.
        let radius = m.radius as f32 + 1e-6;
        if m.area > 0.0 {
            e.radius2[l] = radius * radius;
        }
    }
    e
}
