//! A four-wide bounding-volume hierarchy over boxes: searches by distance, ray and overlap.
//!
//! Boxes are stored as `f32` in a local frame (centred, scaled by a power of two to about [-1, 1]) and
//! rounded outward, so that pruning is conservative while the caller computes in `f64`. Binned surface-area
//! splits build the tree in parallel, with the same result at any thread count. Its depth is bounded because
//! deep ranges are split at the median.

use crate::frame::{Aabb, Vec3};
use build::{Primitive, build};

mod build;

/// The count of an unused lane.
const UNUSED_LANE: u32 = u32::MAX;
/// Size of a search stack. Three siblings wait on each level: on at most 24 levels of splits by cost, which count two
/// halvings each, and 32 at the median, which halve 2^32 primitives to one.
const MAX_STACK: usize = 256;
/// Outward margin of a box in the local frame: covers the casts of box and query to `f32`.
const BOX_MARGIN: f32 = 1.0 / (1 << 21) as f32;
/// Relative slack of squared distances and of coordinates in `f32`: 32 roundings of 2^-24, where about ten occur.
const DISTANCE_SLACK: f32 = 1.0 / (1 << 19) as f32;

/// A node: the boxes of four children by lane, and the contents of each lane.
#[repr(align(64))]
#[derive(Clone)]
pub(crate) struct Node {
    lo: [[f32; 4]; 3],
    hi: [[f32; 4]; 3],
    /// The node index of an inner child, or the first slot of a leaf.
    pub(crate) first: [u32; 4],
    /// The number of slots of a leaf, 0 for an inner child, `u32::MAX` for an unused lane.
    pub(crate) count: [u32; 4],
}

/// The contents of a lane of a node.
pub(crate) enum Child {
    Inner(usize),
    Leaf(std::ops::Range<usize>),
    None,
}

impl Node {
    fn empty() -> Self {
        Self {
            lo: [[f32::INFINITY; 4]; 3],
            hi: [[f32::NEG_INFINITY; 4]; 3],
            first: [0; 4],
            count: [UNUSED_LANE; 4],
        }
    }

    /// The contents of lane `l`.
    pub(crate) fn child(&self, l: usize) -> Child {
        let first = self.first[l] as usize;
        match self.count[l] {
            UNUSED_LANE => Child::None,
            0 => Child::Inner(first),
            n => Child::Leaf(first..first + n as usize),
        }
    }

    /// Lower bounds of the squared distances from a point to the four boxes. `p` and the boxes are in the tree's local
    /// frame, and so are the distances; the slack covers rounding.
    pub(crate) fn distances(&self, p: [f32; 3]) -> [f32; 4] {
        let mut sum = [0f32; 4];
        for a in 0..3 {
            for l in 0..4 {
                // Comparisons instead of f32::max: one instruction each, and no box contains a NaN.
                let (below, above) = (self.lo[a][l] - p[a], p[a] - self.hi[a][l]);
                let d = if below > above { below } else { above };
                let d = if d > 0.0 { d } else { 0.0 };
                sum[l] += d * d;
            }
        }
        sum.map(|s| s * (1.0 - DISTANCE_SLACK))
    }

    /// The longest edge of each box; 0 for an unused lane.
    pub(crate) fn widths(&self) -> [f32; 4] {
        [0, 1, 2, 3].map(|l| {
            let edges = (0..3).map(|a| self.hi[a][l] - self.lo[a][l]);
            edges.fold(0.0, f32::max)
        })
    }
}

/// The map from world coordinates to the local frame of the boxes.
#[derive(Clone, Copy)]
pub(crate) struct LocalFrame {
    centre: Vec3,
    inverse: f64,
}

impl LocalFrame {
    fn of(bounds: &Aabb) -> Self {
        if bounds.is_empty() {
            return Self {
                centre: Vec3::zeros(),
                inverse: 1.0,
            };
        }
        // Halve before adding: the sum of two huge coordinates could overflow.
        let centre = bounds.min / 2.0 + bounds.max / 2.0;
        let half = (bounds.max / 2.0 - bounds.min / 2.0).amax();
        // A power of two scales without rounding; the clamp keeps it in the range of f64.
        let exponent = if half > 0.0 { half.log2().ceil() } else { 0.0 };
        Self {
            centre,
            inverse: (-exponent.clamp(-1000.0, 1000.0)).exp2(),
        }
    }

    /// A point in the local frame.
    pub(crate) fn point(self, p: Vec3) -> Vec3 {
        (p - self.centre) * self.inverse
    }

    /// A length in the local frame.
    pub(crate) fn length(self, d: f64) -> f64 {
        d * self.inverse
    }
}

fn to_f32(p: Vec3) -> [f32; 3] {
    [p.x as f32, p.y as f32, p.z as f32]
}

/// The hierarchy; slots are primitives in tree order.
#[doc(hidden)]
pub struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
    local: LocalFrame,
}

impl Bvh {
    /// Builds the tree over `count` primitives with finite boxes. `bounds` returns the box of a primitive by its
    /// number, in world units. It is called twice for each.
    #[doc(hidden)]
    pub fn new(count: usize, bounds: impl Fn(usize) -> Aabb) -> Self {
        let whole = (0..count).fold(Aabb::EMPTY, |b, i| b.union(bounds(i)));
        let local = LocalFrame::of(&whole);
        let mut primitives: Vec<Primitive> = (0..count)
            .map(|i| {
                let b = bounds(i);
                Primitive {
                    lo: to_f32(local.point(b.min)).map(|c| c - BOX_MARGIN),
                    hi: to_f32(local.point(b.max)).map(|c| c + BOX_MARGIN),
                    index: i as u32,
                }
            })
            .collect();
        let mut nodes = Vec::new();
        if count > 0 {
            build(&mut primitives, 0, 0, &mut nodes);
        }
        Self {
            nodes,
            order: primitives.iter().map(|p| p.index).collect(),
            local,
        }
    }

    /// The nodes; node 0 is the root, and a child's index exceeds its parent's.
    pub(crate) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Memory in bytes.
    #[doc(hidden)]
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(self.order())
    }

    /// The index of the primitive in each slot.
    #[doc(hidden)]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The local frame of the nodes' boxes.
    pub(crate) fn local(&self) -> LocalFrame {
        self.local
    }

    /// Visits slots that may be nearer to `p` than `best`: the leaves of a node at once, its inner children nearest
    /// first. `visit` returns the new best distance if the slot improves it. `p` and distances are in world units.
    #[doc(hidden)]
    pub fn nearest(&self, p: Vec3, best: f64, mut visit: impl FnMut(usize) -> Option<f64>) {
        if self.nodes.is_empty() {
            return;
        }
        let q = to_f32(self.local.point(p));
        // The distance as the boxes' single precision has it, rounded up.
        let limit = |best: f64| {
            let d = self.local.length(best) as f32;
            d * d * (1.0 + DISTANCE_SLACK)
        };
        let mut cutoff = limit(best);
        let mut stack = [(0f32, 0u32); MAX_STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (distance2, n) = stack[top];
            if distance2 > cutoff {
                continue;
            }
            let node = &self.nodes[n as usize];
            let d = node.distances(q);
            // Leaves are visited at once; inner children are pushed in order, the nearest on top.
            // A child farther than the best so far is left out, now or when it is popped.
            let first_child = top;
            for l in 0..4 {
                if d[l] > cutoff {
                    continue;
                }
                match node.count[l] {
                    UNUSED_LANE => {}
                    0 => {
                        let mut at = top;
                        while at > first_child && stack[at - 1].0 < d[l] {
                            stack[at] = stack[at - 1];
                            at -= 1;
                        }
                        stack[at] = (d[l], node.first[l]);
                        top += 1;
                    }
                    n => {
                        let first = node.first[l] as usize;
                        for slot in first..first + n as usize {
                            if let Some(best) = visit(slot) {
                                cutoff = limit(best);
                            }
                        }
                    }
                }
            }
        }
    }

    /// Visits every slot whose box may meet the ray from `p`, world units, along an axis, forward or backward. `axis`
    /// is 0, 1 or 2. The order of visits has no meaning.
    pub(crate) fn along(
        &self,
        p: Vec3,
        axis: usize,
        is_forward: bool,
        mut visit: impl FnMut(usize),
    ) {
        if self.nodes.is_empty() {
            return;
        }
        let q = to_f32(self.local.point(p));
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut stack = [0u32; MAX_STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = &self.nodes[stack[top] as usize];
            // A box meets the ray if it holds q across the axis and reaches ahead of it; an unused lane's is empty.
            let mut hit = [false; 4];
            for l in 0..4 {
                let overlaps = node.lo[u][l] <= q[u]
                    && q[u] <= node.hi[u][l]
                    && node.lo[v][l] <= q[v]
                    && q[v] <= node.hi[v][l];
                let reaches = if is_forward {
                    q[axis] <= node.hi[axis][l]
                } else {
                    q[axis] >= node.lo[axis][l]
                };
                hit[l] = overlaps && reaches;
            }
            for l in (0..4).filter(|&l| hit[l]) {
                match node.child(l) {
                    Child::None => {}
                    Child::Inner(n) => {
                        stack[top] = n as u32;
                        top += 1;
                    }
                    Child::Leaf(slots) => slots.for_each(&mut visit),
                }
            }
        }
    }

    /// One value for each node: that of its slots, joined. `join` must not depend on order. Nodes are visited from the
    /// last to the first, since a child's number exceeds its parent's. Every node has a slot, so that the result has as
    /// many entries as there are nodes.
    pub(crate) fn by_node<T: Copy>(
        &self,
        slot: impl Fn(usize) -> T,
        join: impl Fn(T, T) -> T,
    ) -> Vec<T> {
        let mut of_nodes: Vec<Option<T>> = vec![None; self.nodes.len()];
        for (n, node) in self.nodes.iter().enumerate().rev() {
            let mut all: Option<T> = None;
            let mut add = |value: T| all = Some(all.map_or(value, |a| join(a, value)));
            for l in 0..4 {
                match node.child(l) {
                    Child::Inner(child) => of_nodes[child].into_iter().for_each(&mut add),
                    Child::Leaf(slots) => slots.map(&slot).for_each(&mut add),
                    Child::None => {}
                }
            }
            of_nodes[n] = all;
        }
        of_nodes.into_iter().flatten().collect()
    }

    /// Visits every slot whose box may meet `region`, until `visit` returns `false`.
    #[doc(hidden)]
    pub fn overlapping(&self, region: &Aabb, visit: impl FnMut(usize) -> bool) {
        self.overlapping_where(region, |_| true, visit);
    }

    /// As [`Bvh::overlapping`], in the root's leaves and in the nodes, by number, that `enters` admits. The search ends
    /// when `visit` returns false. `region` is in world units.
    pub(crate) fn overlapping_where(
        &self,
        region: &Aabb,
        enters: impl Fn(usize) -> bool,
        mut visit: impl FnMut(usize) -> bool,
    ) {
        if self.nodes.is_empty() || region.is_empty() {
            return;
        }
        // The region grows by the rounding of its corners to single precision.
        let lo = to_f32(self.local.point(region.min)).map(|c| c - c.abs() * DISTANCE_SLACK);
        let hi = to_f32(self.local.point(region.max)).map(|c| c + c.abs() * DISTANCE_SLACK);
        let mut stack = [0u32; MAX_STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = &self.nodes[stack[top] as usize];
            for l in 0..4 {
                let meets = (0..3).all(|a| node.lo[a][l] <= hi[a] && lo[a] <= node.hi[a][l]);
                if !meets || node.count[l] == UNUSED_LANE {
                    continue;
                }
                // An inner child has a count of 0 and its number in place of the first slot.
                if node.count[l] == 0 {
                    if enters(node.first[l] as usize) {
                        stack[top] = node.first[l];
                        top += 1;
                    }
                    continue;
                }
                let first = node.first[l] as usize;
                for slot in first..first + node.count[l] as usize {
                    if !visit(slot) {
                        return;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(n: usize) -> Vec<Vec3> {
        let mut s = 1u64;
        let mut next = || {
            s = s
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (s >> 11) as f64 / (1u64 << 53) as f64
        };
        // Clusters of very different size, which need both kinds of split.
        (0..n)
            .map(|i| Vec3::from_fn(|_, _| next()) * 0.5f64.powi((i % 60) as i32))
            .collect()
    }

    #[test]
    fn nearest_and_overlapping_agree_with_a_scan() {
        let points = points(20_000);
        let bvh = Bvh::new(points.len(), |i| Aabb::of([points[i]]));
        let mut is_present = vec![false; points.len()];
        for &i in bvh.order() {
            is_present[i as usize] = true;
        }
        assert!(is_present.iter().all(|&s| s));
        for q in points.iter().step_by(997).map(|p| p * 1.3) {
            let mut found = f64::INFINITY;
            bvh.nearest(q, f64::INFINITY, |slot| {
                found = found.min((points[bvh.order()[slot] as usize] - q).norm());
                Some(found)
            });
            let scan = points
                .iter()
                .map(|p| (p - q).norm())
                .fold(f64::INFINITY, f64::min);
            assert_eq!(found, scan);
            let region = Aabb::of([q]).dilated(0.01);
            let inside = |p: Vec3| region.contains(crate::frame::WorldPoint(p));
            let mut count = 0;
            bvh.overlapping(&region, |slot| {
                count += usize::from(inside(points[bvh.order()[slot] as usize]));
                true
            });
            assert_eq!(count, points.iter().filter(|&&p| inside(p)).count());
        }
    }

    #[test]
    fn identical_primitives_make_a_shallow_tree() {
        let bvh = Bvh::new(10_000, |_| Aabb::of([Vec3::zeros()]));
        let mut depth = vec![1; bvh.nodes().len()];
        for (i, n) in bvh.nodes().iter().enumerate() {
            for l in 0..4 {
                if let Child::Inner(c) = n.child(l) {
                    depth[c] = depth[i] + 1;
                }
            }
        }
        // Median splits of 10,000 primitives take 14 levels; one primitive per split would take thousands.
        assert!(depth.into_iter().max().unwrap() <= 14);
    }
}
