//! The generalised winding number of a triangle soup.
//!
//! w(q) = sum over triangles of (solid angle seen from q) / 4 pi: 1 inside and 0 outside a closed
//! outward mesh, and a smooth harmonic function where the surface is open. A group of triangles with
//! area-weighted centre c and radius R contributes by the Taylor expansion of F(d) = d / |d|^3 about c where
//! |c - q| > beta R; nearer triangles are summed exactly (Barill, Dickson, Schmidt, Levin, Jacobson, *Fast
//! winding numbers for soups and clouds*, 2018, second order). With r = c - q, area vectors n at the points
//! c + e of the group's surface, and N = int n, M = int e n, T = int e e n / 2, its solid angle is
//! N.r / r^3 - 3 r.M.r / r^5 + 15 T(r, r, r) / r^7 for the symmetric traceless parts of M and T; the other
//! parts vanish, since F is a gradient without divergence.

use super::bvh::{Child, Node};
use super::soup::Soup;
use super::triangle::SolidAngle;
use crate::frame::{Mat3, Vec3};

/// The opening parameter beta for an error of at most 0.004 on coarse meshes and less on fine ones.
pub(crate) const ACCURATE_BETA: f32 = 2.0;
/// The opening parameter beta for half the time and an error below 0.1.
pub(crate) const FAST_BETA: f32 = 1.3;
/// Greatest size of the search stack (see `bvh`).
const MAX_STACK: usize = 256;
/// Index pairs and triples of the stored components of M and T.
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
    /// -3 M by [`PAIRS`], components off the diagonal doubled.
    pairs: [[f32; 4]; 6],
    /// 15 T by [`TRIPLES`], times the number of permutations of the triple.
    triples: [[f32; 4]; 10],
    /// radius^2; infinite where the expansion is invalid.
    radius2: [f32; 4],
}

/// The moments of one group.
#[derive(Clone, Copy)]
struct Moment {
    area: f64,
    /// Area times centre.
    first: Vec3,
    /// N.
    normal: Vec3,
    /// M about the centre: rows for e, columns for the area vector.
    second: Mat3,
    /// 2 T about the centre: the matrix of e e for every component of the area vector.
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

    /// Adds the moments of another group, whose centre lies at the offset `by` from this one's.
    fn add_moved(&mut self, other: &Self, by: Vec3) {
        self.normal += other.normal;
        self.second += other.second + by * other.normal.transpose();
        for j in 0..3 {
            let row = other.second.column(j) * by.transpose();
            self.third[j] +=
                other.third[j] + row + row.transpose() + by * by.transpose() * other.normal[j];
        }
    }

    /// The symmetric traceless parts of -3 M by [`PAIRS`] and of 15 T by [`TRIPLES`], times the number of their
    /// permutations.
    fn traceless(&self) -> ([f64; 6], [f64; 10]) {
        let mean = self.second.trace() / 3.0;
        // Sums over i and j hold each pair off the diagonal twice.
        let pairs = PAIRS.map(|[i, j]| {
            if i == j {
                -3.0 * (self.second[(i, i)] - mean)
            } else {
                -3.0 * (self.second[(i, j)] + self.second[(j, i)])
            }
        });
        // T symmetrised: the mean of three permutations, as each matrix is symmetric; `third` is 2 T, hence 6.
        let whole = |i: usize, j: usize, k: usize| {
            let t = &self.third;
            (t[k][(i, j)] + t[i][(j, k)] + t[j][(k, i)]) / 6.0
        };
        // Traceless: T_ijk minus (delta_ij t_k + delta_jk t_i + delta_ik t_j) / 5 with the trace t_k = T_iik.
        let trace = [0, 1, 2].map(|k| (0..3).map(|i| whole(i, i, k)).sum::<f64>() / 5.0);
        let triples = TRIPLES.map(|[i, j, k]| {
            let mut value = whole(i, j, k);
            value -= f64::from(u8::from(i == j)) * trace[k];
            value -= f64::from(u8::from(j == k)) * trace[i];
            value -= f64::from(u8::from(i == k)) * trace[j];
            // A triple with repeated indices has fewer permutations.
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
    /// The expansions of all groups of a soup, from the leaves of its hierarchy to the root. There is one for each
    /// node, with four lanes, in the order of nodes and in the tree's local frame.
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

    /// The winding number of `q`, world units; groups farther than `beta` radii are expanded. `soup` is the one of
    /// [`Self::new`]. Far outside and at points that are not finite the result is 0.
    pub(crate) fn number(&self, soup: &Soup, q: Vec3, beta: f32) -> f64 {
        let nodes = soup.bvh.nodes();
        if nodes.is_empty() {
            return 0.0;
        }
        let local = soup.bvh.local().point(q);
        // Far away the sum vanishes; single precision would overflow.
        if local.amax() > 1e9 || !local.iter().all(|c| c.is_finite()) {
            return 0.0;
        }
        let p = [local.x as f32, local.y as f32, local.z as f32];
        // Squares on both sides of the test save a root per lane.
        let beta2 = beta * beta;
        // Far groups by their expansion in single precision, near triangles exactly.
        let mut near = SolidAngle::ZERO;
        let mut far = 0f64;
        let mut stack = [0u32; MAX_STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let n = stack[top] as usize;
            let (flux, is_far) = self.expansions[n].seen_from(p, beta2);
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
    /// The solid angle of each lane by its expansion, and whether the lane is far enough for the expansion. `p` is in
    /// the tree's frame, `beta2` the square of the opening parameter.
    fn seen_from(&self, p: [f32; 3], beta2: f32) -> ([f32; 4], [bool; 4]) {
        // r = c - p, four lanes at a time.
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
            far[l] = d2[l] > beta2 * self.radius2[l];
        }
        if far == [false; 4] {
            return ([0.0; 4], far);
        }
        // N.r, r.(-3 M).r and 15 T(r, r, r).
        let (mut one, mut two, mut three) = ([0f32; 4], [0f32; 4], [0f32; 4]);
        for a in 0..3 {
            for l in 0..4 {
                one[l] += self.normal[a][l] * r[a][l];
            }
        }
        for (component, [i, j]) in self.pairs.iter().zip(PAIRS) {
            for l in 0..4 {
                two[l] += component[l] * r[i][l] * r[j][l];
            }
        }
        for (component, [i, j, k]) in self.triples.iter().zip(TRIPLES) {
            for l in 0..4 {
                three[l] += component[l] * r[i][l] * r[j][l] * r[k][l];
            }
        }
        // N.r / r^3 + two / r^5 + three / r^7.
        let mut flux = [0f32; 4];
        for l in 0..4 {
            let inverse2 = 1.0 / d2[l];
            flux[l] =
                (one[l] + (two[l] + three[l] * inverse2) * inverse2) * inverse2 * inverse2.sqrt();
        }
        (flux, far)
    }
}

/// The moments of a leaf's triangles. Moments are about the area-weighted centre, in the unit of the corners; those of
/// triangles without area are zero.
fn leaf(triangles: impl Iterator<Item = [Vec3; 3]> + Clone) -> Moment {
    let mut m = Moment::ZERO;
    let parts: Vec<(Moment, Vec3)> = triangles
        .clone()
        .map(|[a, b, c]| {
            let normal = (b - a).cross(&(c - a)) / 2.0;
            let centre = (a + b + c) / 3.0;
            // The mean of e e over a triangle: a twelfth of the sum over its corners.
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
    // The area-weighted centre first: moments are about it.
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

/// The moments of four lanes as one group, whose radius contains theirs.
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

/// Single-precision expansions of four groups; an empty lane keeps an infinite radius, so that it is never expanded.
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
        // Rounding: the radius of a small group must not vanish against its coordinates in f32.
        let radius = m.radius as f32 + 1e-6;
        if m.area > 0.0 {
            e.radius2[l] = radius * radius;
        }
    }
    e
}
