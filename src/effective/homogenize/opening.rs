//! The opening of a void: the radius of the greatest ball that travels through it from one period to the next.
//!
//! The void is given by values at the nodes `j / n - 1/2` of a period, positive in the void. Distances to its wall
//! are those to the points where edges of the grid cross it, handed on from node to node (Danielsson 1980). Nodes
//! then enter in the order of falling distance, each linked to the deepest node of every component beside it.
//! A link that closes a loop around the period is a way to the next one. The node that closes the last axis is the
//! throat. A throat between nodes is found too narrow by at most sqrt(3)/2 of their distance, never too wide by more
//! than the curvature of the wall within one such distance; on planes and lines of symmetry nodes are exact.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// Radii below this many node distances, sqrt(3)/2, may be a wall that lies between two nodes; they count as 0.
const MIN_RESOLVED: f64 = 0.87;

/// The way through a void.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Opening {
    /// Radius of the greatest ball that travels to the next period along every axis, periods; 0 if none does.
    pub radius: f64,
    /// The nodes that its centre visits, in the period around the origin. Where no ball travels they lie in the
    /// solid where it is thinnest.
    pub path: Vec<[f64; 3]>,
}

/// The nodes of a period, `n` along each axis.
#[derive(Clone, Copy)]
pub(super) struct Nodes(pub(super) usize);

impl Nodes {
    pub(super) fn place(self, node: usize) -> [usize; 3] {
        let n = self.0;
        [node / (n * n), node / n % n, node % n]
    }

    /// The node a step away, and the period that it lies in.
    pub(super) fn beside(self, node: usize, step: [i32; 3]) -> (usize, [i32; 3]) {
        let (n, at) = (self.0 as i32, self.place(node));
        let moved: [i32; 3] = std::array::from_fn(|a| at[a] as i32 + step[a]);
        let inside = moved.map(|m| m.rem_euclid(n) as usize);
        let number = (inside[0] * self.0 + inside[1]) * self.0 + inside[2];
        (number, moved.map(|m| m.div_euclid(n)))
    }
}

/// The steps to the 26 nodes around one.
pub(super) fn steps() -> Vec<[i32; 3]> {
    let each = (0..27).map(|s| [s / 9 - 1, s / 3 % 3 - 1, s % 3 - 1]);
    each.filter(|s| *s != [0; 3]).collect()
}

/// Distances to the wall of a phase.
pub(super) struct Distances {
    /// Of every node, in node distances: negative outside the phase, infinite without a wall.
    pub(super) signed: Vec<f64>,
    /// The point of the wall nearest to every node, a place among `walls`.
    pub(super) nearest: Vec<u32>,
    /// Where edges of the grid cross the wall, in node distances.
    pub(super) walls: Vec<[f64; 3]>,
    /// The end of each edge in the phase.
    pub(super) inside: Vec<u32>,
}

/// Distances to the wall where `values` change their sign.
pub(super) fn distances(nodes: Nodes, values: &[f64]) -> Distances {
    let mut inside = Vec::new();
    let mut walls: Vec<[f64; 3]> = Vec::new();
    let mut found = (
        vec![f64::INFINITY; values.len()],
        vec![u32::MAX; values.len()],
    );
    let mut queue = BinaryHeap::new();
    let offer = |node: usize, wall: u32, walls: &[[f64; 3]], found: &mut (Vec<f64>, Vec<u32>)| {
        let (at, to) = (nodes.place(node), walls[wall as usize]);
        let n = nodes.0 as f64;
        let square: f64 = (0..3)
            .map(|a| {
                let off = at[a] as f64 - to[a];
                (off - n * (off / n).round()).powi(2)
            })
            .sum();
        let distance = square.sqrt();
        let is_nearer = distance < found.0[node];
        if is_nearer {
            (found.0[node], found.1[node]) = (distance, wall);
        }
        is_nearer
    };
    for node in 0..values.len() {
        for axis in 0..3 {
            let mut step = [0; 3];
            step[axis] = 1;
            let (other, _) = nodes.beside(node, step);
            let (here, there) = (values[node], values[other]);
            if (here > 0.0) == (there > 0.0) {
                continue;
            }
            let mut wall = nodes.place(node).map(|c| c as f64);
            wall[axis] += here / (here - there);
            walls.push(wall);
            inside.push(if here > 0.0 { node } else { other } as u32);
            for end in [node, other] {
                offer(end, walls.len() as u32 - 1, &walls, &mut found);
            }
        }
    }
    // Distances are positive, so that their bits are in their order.
    let entry = |distance: f64, node: usize| Reverse((distance.to_bits(), node));
    for (node, d) in found.0.iter().enumerate() {
        if d.is_finite() {
            queue.push(entry(*d, node));
        }
    }
    let steps = steps();
    while let Some(Reverse((bits, node))) = queue.pop() {
        // A nearer wall was found since this entry was made.
        if bits != found.0[node].to_bits() {
            continue;
        }
        let wall = found.1[node];
        for step in &steps {
            let (other, _) = nodes.beside(node, *step);
            if offer(other, wall, &walls, &mut found) {
                queue.push(entry(found.0[other], other));
            }
        }
    }
    let signed = found.0.into_iter().zip(values);
    Distances {
        signed: signed.map(|(d, v)| if *v > 0.0 { d } else { -d }).collect(),
        nearest: found.1,
        walls,
        inside,
    }
}

/// Components of the nodes that have entered, each node with the period that it was reached in.
struct Forest {
    parents: Vec<u32>,
    /// The period of a node relative to that of its parent.
    periods: Vec<[i32; 3]>,
    sizes: Vec<u32>,
    /// Bits of the axes along which a component continues without end.
    axes: Vec<u8>,
}

impl Forest {
    fn new(count: usize) -> Self {
        Self {
            parents: (0..count as u32).collect(),
            periods: vec![[0; 3]; count],
            sizes: vec![1; count],
            axes: vec![0; count],
        }
    }

    /// The root of a node and the period of the node relative to it.
    fn root(&mut self, node: usize) -> (usize, [i32; 3]) {
        let (mut at, mut period) = (node, [0; 3]);
        while self.parents[at] as usize != at {
            for a in 0..3 {
                period[a] += self.periods[at][a];
            }
            at = self.parents[at] as usize;
        }
        // All on the way hang on the root from now on.
        let (root, mut rest, mut next) = (at, period, node);
        while self.parents[next] as usize != next {
            let (after, own) = (self.parents[next] as usize, self.periods[next]);
            (self.parents[next], self.periods[next]) = (root as u32, rest);
            for a in 0..3 {
                rest[a] -= own[a];
            }
            next = after;
        }
        (root, period)
    }

    /// Joins two components, `period` being that of the second root relative to the first.
    fn join(&mut self, first: usize, second: usize, period: [i32; 3]) {
        let (to, from, period) = if self.sizes[first] >= self.sizes[second] {
            (first, second, period)
        } else {
            (second, first, period.map(|p| -p))
        };
        (self.parents[from], self.periods[from]) = (to as u32, period);
        self.sizes[to] += self.sizes[from];
        self.axes[to] |= self.axes[from];
    }
}

/// The opening of the void where `values` at the nodes are positive; the ball's centre stays on nodes for which
/// `belongs` is true. The default, of radius 0, where no way leads along all three axes (7, a bit for each).
pub fn opening(n: usize, values: &[f64], belongs: impl Fn(usize) -> bool) -> Opening {
    let found = distances(Nodes(n), values);
    opening_of(Nodes(n), &found.signed, belongs)
}

/// The same, from distances to the wall.
pub(super) fn opening_of(
    nodes: Nodes,
    distances: &[f64],
    belongs: impl Fn(usize) -> bool,
) -> Opening {
    let mut order: Vec<usize> = (0..distances.len()).filter(|v| belongs(*v)).collect();
    // The sort is stable: of equals the lesser number comes first.
    order.sort_by(|a, b| distances[*b].total_cmp(&distances[*a]));
    let mut forest = Forest::new(distances.len());
    let mut has_entered = vec![false; distances.len()];
    let mut links: Vec<[usize; 2]> = Vec::new();
    let mut loops: Vec<[usize; 2]> = Vec::new();
    let steps = steps();
    for node in order {
        has_entered[node] = true;
        let mut around: Vec<(usize, [i32; 3])> =
            steps.iter().map(|s| nodes.beside(node, *s)).collect();
        around.retain(|(other, _)| has_entered[*other] && *other != node);
        around.sort_by(|a, b| distances[b.0].total_cmp(&distances[a.0]));
        for (other, crossed) in around {
            let ((mine, own), (theirs, far)) = (forest.root(node), forest.root(other));
            // The period of the other root relative to this one, along the link.
            let period: [i32; 3] = std::array::from_fn(|a| own[a] + crossed[a] - far[a]);
            if mine != theirs {
                forest.join(mine, theirs, period);
                links.push([node, other]);
                continue;
            }
            let turned = (0..3).fold(0, |bits, a| bits | u8::from(period[a] != 0) << a);
            if turned & !forest.axes[mine] != 0 {
                forest.axes[mine] |= turned;
                loops.push([node, other]);
            }
        }
        let (root, _) = forest.root(node);
        if forest.axes[root] == 7 {
            let own = loops.into_iter().filter(|l| forest.root(l[0]).0 == root);
            let own: Vec<[usize; 2]> = own.collect();
            let radius = distances[node];
            let is_resolved = radius >= MIN_RESOLVED && radius.is_finite();
            return Opening {
                radius: if is_resolved {
                    radius / nodes.0 as f64
                } else {
                    0.0
                },
                path: path(nodes, &links, &own),
            };
        }
    }
    Opening::default()
}

/// The nodes on the ways through the links from one end of each loop to its other.
fn path(nodes: Nodes, links: &[[usize; 2]], loops: &[[usize; 2]]) -> Vec<[f64; 3]> {
    let count = nodes.0.pow(3);
    let mut beside: Vec<Vec<usize>> = vec![Vec::new(); count];
    for [a, b] in links {
        beside[*a].push(*b);
        beside[*b].push(*a);
    }
    let mut is_on = vec![false; count];
    for [from, to] in loops {
        let mut before = vec![usize::MAX; count];
        before[*from] = *from;
        let mut queue = VecDeque::from([*from]);
        while let Some(node) = queue.pop_front() {
            for other in &beside[node] {
                if before[*other] == usize::MAX {
                    before[*other] = node;
                    queue.push_back(*other);
                }
            }
        }
        let mut node = *to;
        while before[node] != usize::MAX {
            is_on[node] = true;
            if node == *from {
                break;
            }
            node = before[node];
        }
    }
    let on = (0..count).filter(|v| is_on[*v]);
    on.map(|v| nodes.place(v).map(|c| c as f64 / nodes.0 as f64 - 0.5))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values at the nodes of `n` along each axis.
    fn values(n: usize, value: impl Fn([f64; 3]) -> f64) -> Vec<f64> {
        let nodes = Nodes(n);
        let place = |v| nodes.place(v).map(|c| c as f64 / n as f64 - 0.5);
        (0..n * n * n).map(|v| value(place(v))).collect()
    }

    /// Rounds of radius 0.4 around the centre, joined along each axis by a tube of this radius.
    fn rooms(tubes: [f64; 3]) -> impl Fn([f64; 3]) -> f64 {
        move |p: [f64; 3]| {
            let norm = |a: f64, b: f64| a.hypot(b);
            let room = 0.4 - norm(norm(p[0], p[1]), p[2]);
            let tube = (0..3).map(|a| tubes[a] - norm(p[(a + 1) % 3], p[(a + 2) % 3]));
            tube.fold(room, f64::max)
        }
    }

    #[test]
    fn the_narrowest_of_the_tubes_is_the_opening() {
        for (tubes, expected) in [([0.2, 0.2, 0.2], 0.2), ([0.3, 0.15, 0.2], 0.15)] {
            let found = opening(32, &values(32, rooms(tubes)), |_| true);
            assert!((found.radius - expected).abs() < 2e-3, "{}", found.radius);
            // The way leads along the middle of the tubes.
            let tube = found
                .path
                .iter()
                .filter(|p| p.iter().any(|c| c.abs() > 0.42));
            let off = tube.map(|p| {
                let mut sizes = p.map(f64::abs);
                sizes.sort_by(f64::total_cmp);
                sizes[1]
            });
            assert!(off.fold(0.0, f64::max) < 0.05, "{:?}", found.path);
        }
    }

    #[test]
    fn a_closed_axis_has_no_opening_but_a_way() {
        let found = opening(24, &values(24, rooms([0.2, 0.2, -1.0])), |_| true);
        assert_eq!(found.radius, 0.0);
        assert!(found.path.iter().any(|p| p[2] == -0.5), "{:?}", found.path);
        // Void alone, and solid alone.
        assert_eq!(opening(8, &[1.0; 512], |_| true).radius, 0.0);
        assert_eq!(opening(8, &[-1.0; 512], |_| true).radius, 0.0);
    }

    #[test]
    fn a_thin_wall_between_nodes_closes_the_way() {
        let n = 16;
        // Planes that lie between two layers of nodes.
        let wall = |p: [f64; 3]| {
            p.iter()
                .map(|c| (c + 0.25 / 16.0).abs() - 0.1 / 16.0)
                .fold(1.0, f64::min)
        };
        assert_eq!(opening(n, &values(n, wall), |_| true).radius, 0.0);
    }
}
