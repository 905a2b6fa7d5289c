//! The box of curved elements themselves, which their control points may leave.
//!
//! Along an axis an element is a polynomial over its cell. Bernstein coefficients bound it from above; values at
//! corners bound its maximum from below. A quadratic polynomial over a simplex has its maximum at a point where it is
//! stationary on the simplex or on one of its faces and edges, or at a corner: a small linear system each. On cubes and
//! prisms the part with the greatest coefficient is split across its most curved way until both bounds meet.

use super::bernstein::{Net, index, lattice};
use super::kind::{Family, Kind};
use druse_geometry::frame::{Aabb, Vec3};
use nalgebra::{DMatrix, DVector};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// The largest distance of the box from the elements, relative to its longest side.
const RELATIVE_TOLERANCE: f64 = 1e-7;
/// Maximum number of splits for one side of the box. Beyond it, which only long ridges reach that lie askew in many
/// elements, the side is that of the coefficients of the remaining parts.
const MAX_SPLITS: usize = 100_000;

/// A part of an element with an upper bound of its values.
struct Open {
    highest: f64,
    net: Net<f64>,
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.highest == other.highest
    }
}

impl Eq for Open {}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        self.highest.total_cmp(&other.highest)
    }
}

/// The box around the elements with these control points and around `straight`, within 1e-7 of its longest side and
/// never smaller; exact for quadratic tetrahedra.
pub(super) fn curved_box<'a>(
    nets: &(impl Iterator<Item = &'a Net<Vec3>> + Clone),
    straight: Aabb,
) -> Aabb {
    let corners = |net: &'a Net<Vec3>| net.corners().into_iter().map(|c| c.0);
    // The corners alone; then each side is moved out to the curved elements that reach beyond.
    let mut sharp = straight.union(Aabb::of(nets.clone().flat_map(corners)));
    let tolerance = RELATIVE_TOLERANCE * sharp.size().max();
    for axis in 0..3 {
        let along = |sign: f64| {
            let within = |c: &Vec3, limit: f64| sign * c[axis] <= limit;
            let limit = (sign * sharp.min[axis]).max(sign * sharp.max[axis]);
            // Most elements lie inside the box of the corners.
            let beyond = nets
                .clone()
                .filter(move |net| !net.coefficients.iter().all(|c| within(c, limit)));
            let component = move |net: &Net<Vec3>| Net {
                family: net.family,
                degree: net.degree,
                coefficients: net.coefficients.iter().map(|c| sign * c[axis]).collect(),
            };
            sign * greatest(beyond.map(component), limit, tolerance)
        };
        let (low, high) = (along(-1.0), along(1.0));
        sharp.min[axis] = low;
        sharp.max[axis] = high;
    }
    sharp
}

/// Control points of a planar element, without change along its third parameter.
pub(super) fn planar_controls(kind: Kind, nodes: &[Vec3]) -> Net<Vec3> {
    let mut net = kind.controls(nodes);
    let layer = net.coefficients.len() / (net.degree + 1);
    for i in layer..net.coefficients.len() {
        net.coefficients[i] = net.coefficients[i % layer];
    }
    net
}

/// The maximum of polynomials and of `known`, at most `tolerance` too high unless [`MAX_SPLITS`] are spent. `known` is
/// a value that is reached in any case.
fn greatest(nets: impl Iterator<Item = Net<f64>>, known: f64, tolerance: f64) -> f64 {
    let mut reached = known;
    // Quadratic simplices are solved in closed form; all others are open parts.
    let mut open = BinaryHeap::new();
    for net in nets {
        if net.family == Family::Simplex && net.degree == 2 {
            reached = reached.max(greatest_on_simplex(&net));
        } else {
            let highest = net.range().1;
            open.push(Open { highest, net });
        }
    }
    // The part with the highest upper bound is split until that bound is within the tolerance of a value reached.
    let mut splits_left = MAX_SPLITS;
    while let Some(part) = open.pop() {
        if part.highest <= reached + tolerance || splits_left == 0 {
            return reached.max(part.highest);
        }
        splits_left -= 1;
        for net in part.net.split(most_curved_way(&part.net)) {
            let at_corners = net.corners().into_iter().map(|c| c.0);
            reached = at_corners.fold(reached, f64::max);
            let highest = net.range().1;
            if highest > reached {
                open.push(Open { highest, net });
            }
        }
    }
    reached
}

/// The maximum of the quadratic form sum `c_ab l_a l_b` over the barycentrics l of a simplex. On the face of some of
/// its vertices it is stationary where C l = mu 1 and sum l = 1. `net` is quadratic.
fn greatest_on_simplex(net: &Net<f64>) -> f64 {
    // Vertex 0 has the exponents (0, 0, 0) of the other three.
    let exponents = |v: usize| [1, 2, 3].map(|axis| usize::from(axis == v));
    let form = |a: usize, b: usize| {
        let (p, q) = (exponents(a), exponents(b));
        net.coefficients[index(net.family, 2, [0, 1, 2].map(|i| p[i] + q[i]))]
    };
    let mut most = f64::NEG_INFINITY;
    // Every corner, edge, face and the whole: bit v stands for vertex v.
    for subset in 1u32..16 {
        let vertices: Vec<usize> = (0..4).filter(|v| subset >> v & 1 == 1).collect();
        let n = vertices.len();
        let system = DMatrix::from_fn(n + 1, n + 1, |row, column| match (row < n, column < n) {
            (true, true) => form(vertices[row], vertices[column]),
            (false, false) => 0.0,
            _ => 1.0,
        });
        let mut right = DVector::zeros(n + 1);
        right[n] = 1.0;
        // Of a singular system the stationary points reach an edge of the face or there are none.
        let Some(l) = system.lu().solve(&right) else {
            continue;
        };
        if l.iter().take(n).all(|l| *l >= 0.0) {
            // The value at these barycentrics, whatever rounding made of them.
            let sum: f64 = (0..n).map(|i| l[i]).sum();
            let rows = (0..n).map(|i| {
                let row = (0..n).map(|j| form(vertices[i], vertices[j]) * l[j]);
                l[i] * row.sum::<f64>()
            });
            let value = rows.sum::<f64>() / (sum * sum);
            most = most.max(value);
        }
    }
    most
}

/// The way to split with the greatest second difference: across an axis of the cube, an edge of the prism's triangle,
/// or (way 3) the prism's axis. The number is that of [`Net::split`], whose order the tables of edges below follow.
fn most_curved_way(net: &Net<f64>) -> usize {
    let (family, n) = (net.family, net.degree);
    let exists = |q: &[usize; 3]| match family {
        Family::Simplex => q.iter().sum::<usize>() <= n,
        Family::Tensor => q.iter().all(|i| *i <= n),
        Family::Prism => q[0] + q[1] <= n && q[2] <= n,
    };
    // c(p + 2u) - 2 c(p + u + v) + c(p + 2v), the greatest over every p.
    let second_difference = |[u, v]: [[usize; 3]; 2]| {
        let sum =
            |p: [usize; 3], a: [usize; 3], b: [usize; 3]| [0, 1, 2].map(|i| p[i] + a[i] + b[i]);
        let at = |q| net.coefficients[index(family, n, q)];
        lattice(family, n)
            .filter(|p| exists(&sum(*p, u, u)) && exists(&sum(*p, v, v)))
            .map(|p| (at(sum(p, u, u)) - 2.0 * at(sum(p, u, v)) + at(sum(p, v, v))).abs())
            .fold(0.0, f64::max)
    };
    let (zero, x, y, z) = ([0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]);
    let ways: &[[[usize; 3]; 2]] = match family {
        Family::Tensor => &[[zero, x], [zero, y], [zero, z]],
        Family::Prism => &[[zero, x], [x, y], [y, zero], [zero, z]],
        // The edges of a tet; quadratic simplices have a closed form, others come here.
        Family::Simplex => &[[zero, x], [x, y], [y, zero], [zero, z], [x, z], [y, z]],
    };
    let mut best = (0, 0.0);
    for (way, edge) in ways.iter().enumerate() {
        let difference = second_difference(*edge);
        if difference > best.1 {
            best = (way, difference);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scaffold::{Connectivity, Scaffold, Surface};
    use druse_geometry::frame::CellPoint;

    /// Nodes of a kind, moved by up to `size` in a fixed pseudo-random way.
    fn bent(kind: Kind, size: f64, seed: u64) -> Vec<Vec3> {
        let mut state = seed;
        let mut noise = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as f64 / f64::from(1u32 << 31) - 0.5
        };
        let rest = kind.reference_nodes().into_iter();
        rest.map(|p| p.0 + Vec3::from_fn(|_, _| size * noise()))
            .collect()
    }

    /// The greatest coordinate along each axis and its opposite, by hill climbing over the cell from many starts.
    fn climbed(kind: Kind, nodes: &[Vec3]) -> [[f64; 3]; 2] {
        let shape = kind.shape();
        let hull = shape.cell_box();
        let flat = kind.is_planar();
        let at = |xi: Vec3| -> Vec3 {
            let weights = kind.shape_functions(CellPoint(xi));
            nodes.iter().zip(weights).map(|(p, w)| p * w).sum()
        };
        let inside = |xi: Vec3| shape.face_distance(CellPoint(xi)) <= 1e-12;
        // From corner to corner, so that a climb can follow every edge and face, and along the axes.
        let corners = &kind.reference_nodes()[..kind.corner_count()];
        let pairs = corners
            .iter()
            .flat_map(|a| corners.iter().map(move |b| b.0 - a.0));
        let axes = [Vec3::x(), Vec3::y(), Vec3::z()].into_iter();
        let axes = axes.filter(|a| !flat || a.z == 0.0).flat_map(|a| [a, -a]);
        let ways: Vec<Vec3> = pairs.chain(axes).collect();
        let mut found = [[f64::NEG_INFINITY; 3]; 2];
        let steps = 13;
        for axis in 0..3 {
            for (sign, found) in [-1.0, 1.0].into_iter().zip(&mut found) {
                let height = |xi: Vec3| sign * at(xi)[axis];
                let starts = (0..steps * steps * if flat { 1 } else { steps }).map(|i| {
                    let part = [i % steps, i / steps % steps, i / steps / steps];
                    // With both ends: a corner may be the greatest point, and far from the next greatest.
                    let t = Vec3::from(part.map(|p| p as f64 / (steps - 1) as f64));
                    let p = hull.min + (hull.max - hull.min).component_mul(&t);
                    if flat { Vec3::new(p.x, p.y, 0.0) } else { p }
                });
                let best = starts
                    .filter(|p| inside(*p))
                    .max_by(|a, b| height(*a).total_cmp(&height(*b)));
                let mut best = best.unwrap();
                let mut step = 0.1;
                while step > 1e-9 {
                    let moves = ways.iter().copied();
                    let next = moves
                        .map(|m| best + m * step)
                        .filter(|p| inside(*p))
                        .max_by(|a, b| height(*a).total_cmp(&height(*b)));
                    match next.filter(|p| height(*p) > height(best)) {
                        Some(p) => best = p,
                        None => step /= 2.0,
                    }
                }
                found[axis] = height(best);
            }
        }
        found
    }

    /// The box against a search that knows shape functions only: it reaches the box, and never leaves it.
    #[test]
    fn the_box_is_that_of_the_elements() {
        for kind in Kind::ALL {
            for seed in 1..3 {
                let nodes = bent(kind, 0.5, seed);
                let mut elements = Connectivity::default();
                elements.push(kind, &(0..nodes.len() as u32).collect::<Vec<_>>());
                let found = if kind.is_planar() {
                    Surface::new(nodes.clone(), elements).unwrap().bounds()
                } else {
                    Scaffold::new(nodes.clone(), elements).unwrap().bounds()
                };
                let [low, high] = climbed(kind, &nodes);
                let tolerance = 2e-6 * found.size().max();
                for axis in 0..3 {
                    for (side, reached) in
                        [(-found.min[axis], low[axis]), (found.max[axis], high[axis])]
                    {
                        assert!(
                            reached <= side + 1e-9 && side - reached <= tolerance,
                            "{} {seed} axis {axis}: {side} for {reached}",
                            kind.name()
                        );
                    }
                }
            }
        }
    }

    /// x = -0.4 at the middle of an edge bent to the parabola 4 t (1 - t) (-0.4): the control point is at -0.8.
    #[test]
    fn a_bent_edge_ends_at_its_vertex() {
        let v = Vec3::new;
        let mut nodes = vec![v(0., 0., 0.), v(2., 0., 0.), v(0., 2., 0.), v(0., 0., 2.)];
        for [a, b] in Kind::Tet10.edges() {
            nodes.push((nodes[usize::from(*a)] + nodes[usize::from(*b)]) / 2.0);
        }
        nodes[7].x = -0.4;
        let mut elements = Connectivity::default();
        elements.push(Kind::Tet10, &(0..10).collect::<Vec<_>>());
        let found = Scaffold::new(nodes, elements).unwrap().bounds();
        assert!(
            (found.min - v(-0.4, 0.0, 0.0)).amax() < 1e-15
                && (found.max - v(2.0, 2.0, 2.0)).amax() < 1e-15
        );
    }
}
