//! The generalised winding number: how often a surface goes round a point, for any triangles at all.
//!
//! w(q) = sum over triangles of (solid angle seen from q) / 4 pi: 1 inside and 0 outside a closed
//! outward mesh, and a smooth harmonic function where the surface is open. Far groups of triangles
//! count by their dipole N . (c - q) / (4 pi |c - q|^3), N the sum of area vectors and c the
//! area-weighted centre, once |c - q| > BETA times the group's radius (Barill, Dickson, Schmidt, Levin,
//! Jacobson, *Fast winding numbers for soups and clouds*, 2018, first order); near triangles count
//! exactly.

use super::bvh::{Child, Node};
use super::soup::Soup;
use super::triangle::SolidAngle;
use crate::frame::Vec3;

/// How many radii away a group counts by its dipole: with 2, the usual choice, coarse meshes are off by
/// up to 0.06; with 3, by 0.03.
const BETA: f32 = 3.0;
/// Inner nodes that wait at most (see the hierarchy's own bound).
const STACK: usize = 256;

/// Dipoles of a node's four children, by lane, in the tree's local frame.
#[repr(align(64))]
#[derive(Clone)]
struct Dipoles {
    centre: [[f32; 4]; 3],
    normal: [[f32; 4]; 3],
    /// (BETA radius)^2; infinite never to be taken.
    reach2: [f32; 4],
}

/// One group's dipole while they are gathered.
#[derive(Clone, Copy)]
struct Moment {
    area: f64,
    /// Area times centre.
    first: Vec3,
    normal: Vec3,
    radius: f64,
}

impl Moment {
    const ZERO: Self = Self {
        area: 0.0,
        first: Vec3::new(0.0, 0.0, 0.0),
        normal: Vec3::new(0.0, 0.0, 0.0),
        radius: 0.0,
    };

    fn centre(&self) -> Vec3 {
        if self.area > 0.0 {
            self.first / self.area
        } else {
            self.first
        }
    }
}

/// Dipoles for every node of a soup's tree.
pub(crate) struct Winding {
    dipoles: Vec<Dipoles>,
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
            dipoles: lanes.iter().map(pack).collect(),
        }
    }

    /// The winding number of `q`.
    pub(crate) fn number(&self, soup: &Soup, q: Vec3) -> f64 {
        let nodes = soup.bvh.nodes();
        if nodes.is_empty() {
            return 0.0;
        }
        let local = soup.bvh.local().point(q);
        if local.amax() > 1e9 || !local.iter().all(|c| c.is_finite()) {
            return 0.0;
        }
        let p = [local.x as f32, local.y as f32, local.z as f32];
        let mut near = SolidAngle::ZERO;
        let mut far = 0f64;
        let mut stack = [0u32; STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let n = stack[top] as usize;
            let (flux, is_far) = self.dipoles[n].seen_from(p);
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

impl Dipoles {
    /// Solid angle of each lane by its dipole, and whether the lane is far enough for that.
    fn seen_from(&self, p: [f32; 3]) -> ([f32; 4], [bool; 4]) {
        let mut d2 = [0f32; 4];
        let mut dot = [0f32; 4];
        for a in 0..3 {
            for l in 0..4 {
                let d = self.centre[a][l] - p[a];
                d2[l] += d * d;
                dot[l] += self.normal[a][l] * d;
            }
        }
        let mut flux = [0f32; 4];
        let mut far = [false; 4];
        for l in 0..4 {
            flux[l] = dot[l] / (d2[l] * d2[l].sqrt());
            far[l] = d2[l] > self.reach2[l];
        }
        (flux, far)
    }
}

/// The moment of a leaf's triangles.
fn leaf(triangles: impl Iterator<Item = [Vec3; 3]> + Clone) -> Moment {
    let mut m = Moment::ZERO;
    for [a, b, c] in triangles.clone() {
        let n = (b - a).cross(&(c - a)) / 2.0;
        let area = n.norm();
        m.area += area;
        m.normal += n;
        m.first += (a + b + c) * (area / 3.0);
    }
    if m.area == 0.0 {
        m.first = triangles.clone().flatten().next().unwrap_or_default();
    }
    let centre = m.centre();
    m.radius = triangles
        .flatten()
        .map(|p| (p - centre).norm())
        .fold(0.0, f64::max);
    m
}

/// The moment of four lanes together; its radius holds theirs.
fn group(lanes: &[Moment; 4]) -> Moment {
    let mut m = Moment::ZERO;
    for l in lanes {
        m.area += l.area;
        m.normal += l.normal;
        if l.area > 0.0 {
            m.first += l.first;
        }
    }
    if m.area == 0.0 {
        m.first = lanes[0].first;
    }
    let centre = m.centre();
    let reach = |l: &Moment| (l.centre() - centre).norm() + l.radius;
    m.radius = lanes
        .iter()
        .filter(|l| l.area > 0.0)
        .map(reach)
        .fold(0.0, f64::max);
    m
}

fn pack(lanes: &[Moment; 4]) -> Dipoles {
    let mut d = Dipoles {
        centre: [[0.0; 4]; 3],
        normal: [[0.0; 4]; 3],
        reach2: [f32::INFINITY; 4],
    };
    for (l, m) in lanes.iter().enumerate() {
        let centre = m.centre();
        for a in 0..3 {
            d.centre[a][l] = centre[a] as f32;
            d.normal[a][l] = m.normal[a] as f32;
        }
        // Rounding of a small far-away group: its radius in f32 must not vanish before its place.
        let radius = m.radius as f32 + 1e-6;
        if m.area > 0.0 {
            d.reach2[l] = (BETA * radius) * (BETA * radius);
        }
    }
    d
}
