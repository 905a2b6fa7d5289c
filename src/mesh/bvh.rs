//! A four-wide bounding-volume hierarchy over boxes: nearest-first search and overlap search.
//!
//! Boxes are kept as `f32` in a local frame (centred, scaled by a power of two to about [-1, 1]) and
//! rounded outward, so that pruning is conservative while the caller computes in `f64`. The tree is
//! built by binned surface-area splits, in parallel, and is the same at any thread count; its depth
//! is bounded because splits fall back to halving.

use crate::frame::{Aabb, Vec3};
use build::{Primitive, build};

mod build;

/// Marks an unused lane.
const NONE: u32 = u32::MAX;
/// Deepest search: 48 levels by cost, 32 by halving, three siblings left behind on each.
const STACK: usize = 256;
/// Outward rounding of a box in the local frame: covers the casts of box and query to `f32`.
const MARGIN: f32 = 1.0 / (1 << 21) as f32;
/// Relative slack of squared distances computed in `f32`.
const SLACK: f32 = 1.0 / (1 << 19) as f32;

/// Four children: boxes by lane, then what each lane holds.
#[repr(align(64))]
#[derive(Clone)]
pub(crate) struct Node {
    lo: [[f32; 4]; 3],
    hi: [[f32; 4]; 3],
    /// Index of an inner child's node, or of a leaf's first slot.
    pub(crate) first: [u32; 4],
    /// Number of slots of a leaf, 0 for an inner child, `u32::MAX` for an unused lane.
    pub(crate) count: [u32; 4],
}

/// What a lane of a node holds.
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
            count: [NONE; 4],
        }
    }

    /// What lane `l` holds.
    pub(crate) fn child(&self, l: usize) -> Child {
        let first = self.first[l] as usize;
        match self.count[l] {
            NONE => Child::None,
            0 => Child::Inner(first),
            n => Child::Leaf(first..first + n as usize),
        }
    }

    /// Squared distances from a point to the four boxes, not more than the true ones.
    pub(crate) fn distances(&self, p: [f32; 3]) -> [f32; 4] {
        let mut sum = [0f32; 4];
        for a in 0..3 {
            for l in 0..4 {
                // Comparisons rather than f32::max: one instruction each, and no box holds a NaN.
                let (below, above) = (self.lo[a][l] - p[a], p[a] - self.hi[a][l]);
                let d = if below > above { below } else { above };
                let d = if d > 0.0 { d } else { 0.0 };
                sum[l] += d * d;
            }
        }
        sum.map(|s| s * (1.0 - SLACK))
    }

    /// The longest edge of each box; of an unused lane nothing that means anything.
    pub(crate) fn widths(&self) -> [f32; 4] {
        [0, 1, 2, 3].map(|l| {
            let edges = (0..3).map(|a| self.hi[a][l] - self.lo[a][l]);
            edges.fold(0.0, f32::max)
        })
    }
}

/// World coordinates to the local frame of the boxes.
#[derive(Clone, Copy)]
pub(crate) struct Local {
    centre: Vec3,
    inverse: f64,
}

impl Local {
    fn of(bounds: &Aabb) -> Self {
        if bounds.is_empty() {
            return Self {
                centre: Vec3::zeros(),
                inverse: 1.0,
            };
        }
        // Halves first: the sum of two huge coordinates could overflow.
        let centre = bounds.min / 2.0 + bounds.max / 2.0;
        let half = (bounds.max / 2.0 - bounds.min / 2.0).amax();
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

fn single(p: Vec3) -> [f32; 3] {
    [p.x as f32, p.y as f32, p.z as f32]
}

/// The hierarchy; slots are primitives in tree order.
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
    local: Local,
}

impl Bvh {
    /// Builds the tree over the boxes of primitives, which must be finite.
    pub(crate) fn new(count: usize, bounds: impl Fn(usize) -> Aabb) -> Self {
        let whole = (0..count).fold(Aabb::EMPTY, |b, i| b.union(bounds(i)));
        let local = Local::of(&whole);
        let mut primitives: Vec<Primitive> = (0..count)
            .map(|i| {
                let b = bounds(i);
                Primitive {
                    lo: single(local.point(b.min)).map(|c| c - MARGIN),
                    hi: single(local.point(b.max)).map(|c| c + MARGIN),
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

    /// The nodes; a child's index is greater than its parent's, the root is node 0.
    pub(crate) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The primitive in each slot.
    pub(crate) fn order(&self) -> &[u32] {
        &self.order
    }

    /// The frame in which nodes keep their numbers.
    pub(crate) fn local(&self) -> Local {
        self.local
    }

    /// Visits slots that may be nearer to `p` than `best`, nearest boxes first; `visit` gives the best
    /// distance when the slot improved it.
    pub(crate) fn nearest(&self, p: Vec3, best: f64, mut visit: impl FnMut(usize) -> Option<f64>) {
        if self.nodes.is_empty() {
            return;
        }
        let q = single(self.local.point(p));
        let limit = |best: f64| {
            let d = self.local.length(best) as f32;
            d * d * (1.0 + SLACK)
        };
        let mut cut = limit(best);
        let mut stack = [(0f32, 0u32); STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (far, n) = stack[top];
            if far > cut {
                continue;
            }
            let node = &self.nodes[n as usize];
            let d = node.distances(q);
            // Leaves at once; inner children later, the nearest on top of the stack.
            let floor = top;
            for l in 0..4 {
                if d[l] > cut {
                    continue;
                }
                match node.count[l] {
                    NONE => {}
                    0 => {
                        let mut at = top;
                        while at > floor && stack[at - 1].0 < d[l] {
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
                                cut = limit(best);
                            }
                        }
                    }
                }
            }
        }
    }

    /// Visits every slot whose box may meet the ray from `p` along an axis, ahead or back.
    pub(crate) fn along(&self, p: Vec3, axis: usize, ahead: bool, mut visit: impl FnMut(usize)) {
        if self.nodes.is_empty() {
            return;
        }
        let q = single(self.local.point(p));
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut stack = [0u32; STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = &self.nodes[stack[top] as usize];
            let mut hit = [false; 4];
            for l in 0..4 {
                let across = node.lo[u][l] <= q[u]
                    && q[u] <= node.hi[u][l]
                    && node.lo[v][l] <= q[v]
                    && q[v] <= node.hi[v][l];
                let before = if ahead {
                    q[axis] <= node.hi[axis][l]
                } else {
                    q[axis] >= node.lo[axis][l]
                };
                hit[l] = across && before;
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

    /// Visits every slot whose box may meet `region`, until `visit` says stop by `false`.
    pub(crate) fn overlapping(&self, region: &Aabb, mut visit: impl FnMut(usize) -> bool) {
        if self.nodes.is_empty() || region.is_empty() {
            return;
        }
        let lo = single(self.local.point(region.min)).map(|c| c - c.abs() * SLACK);
        let hi = single(self.local.point(region.max)).map(|c| c + c.abs() * SLACK);
        let mut stack = [0u32; STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = &self.nodes[stack[top] as usize];
            for l in 0..4 {
                let meets = (0..3).all(|a| node.lo[a][l] <= hi[a] && lo[a] <= node.hi[a][l]);
                if !meets || node.count[l] == NONE {
                    continue;
                }
                if node.count[l] == 0 {
                    stack[top] = node.first[l];
                    top += 1;
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
        // Clusters of very different size, so that splits by cost and by halving both happen.
        (0..n)
            .map(|i| Vec3::from_fn(|_, _| next()) * 0.5f64.powi((i % 60) as i32))
            .collect()
    }

    #[test]
    fn nearest_and_overlapping_agree_with_a_scan() {
        let points = points(20_000);
        let bvh = Bvh::new(points.len(), |i| Aabb::of([points[i]]));
        let mut seen = vec![false; points.len()];
        for &i in bvh.order() {
            seen[i as usize] = true;
        }
        assert!(seen.iter().all(|&s| s));
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
        // Halving 10,000 takes 14 levels; a tree that cannot tell its primitives apart takes thousands.
        assert!(depth.into_iter().max().unwrap() <= 14);
    }
}
