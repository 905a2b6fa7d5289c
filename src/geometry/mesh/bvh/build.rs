//! Construction of the hierarchy: binned surface-area splits into four children, parallel for large ranges.
//!
//! It sorts the primitives into the slots of the tree and appends its nodes, each parent before its children. The tree
//! depends on the boxes alone and not on the number of threads. Boxes are in `f32`, as the caller rounded them.

use super::Node;

/// Greatest number of primitives in a leaf.
const MAX_LEAF_PRIMITIVES: usize = 2;
/// Number of bins per axis in the search for a split.
const BIN_COUNT: usize = 16;
/// Depth from which ranges are split at the median instead of by cost.
const MAX_COST_SPLIT_DEPTH: usize = 48;
/// Ranges of at most this many primitives are split at the median: bins cost more there than they save.
const MAX_MEDIAN_SPLIT_PRIMITIVES: usize = 16;
/// Ranges of at least this many primitives are built in parallel.
const MIN_PARALLEL_PRIMITIVES: usize = 1 << 13;

/// A primitive during construction.
#[derive(Clone, Copy)]
pub(super) struct Primitive {
    pub(super) lo: [f32; 3],
    pub(super) hi: [f32; 3],
    pub(super) index: u32,
}

impl Primitive {
    /// Twice the centre.
    fn double_centre(&self, axis: usize) -> f32 {
        self.lo[axis] + self.hi[axis]
    }
}

/// A box during construction.
#[derive(Clone, Copy)]
struct Extent {
    lo: [f32; 3],
    hi: [f32; 3],
}

impl Extent {
    const EMPTY_BOX: Self = Self {
        lo: [f32::INFINITY; 3],
        hi: [f32::NEG_INFINITY; 3],
    };

    fn grow(&mut self, lo: [f32; 3], hi: [f32; 3]) {
        for a in 0..3 {
            self.lo[a] = self.lo[a].min(lo[a]);
            self.hi[a] = self.hi[a].max(hi[a]);
        }
    }

    fn of(primitives: &[Primitive]) -> Self {
        let mut e = Self::EMPTY_BOX;
        for p in primitives {
            e.grow(p.lo, p.hi);
        }
        e
    }

    /// Half the surface area; 0 for an empty box.
    fn half_area(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|a| (self.hi[a] - self.lo[a]).max(0.0));
        x * y + y * z + z * x
    }
}

/// Builds the node over a range of primitives whose first slot is `base`, after the nodes in `out`. `depth` counts the
/// halvings above it: a split in four is two. `primitives` are sorted into the order of slots; child nodes are appended
/// to `out` after their parent.
pub(super) fn build(primitives: &mut [Primitive], base: u32, depth: usize, out: &mut Vec<Node>) {
    // The node's number is fixed before its children are built.
    let node_index = out.len();
    out.push(Node::empty());
    let parts = split_in_four(primitives, depth);
    let mut node = Node::empty();
    let mut inner: Vec<(usize, u32, &mut [Primitive])> = Vec::new();
    let mut rest = primitives;
    let mut start = base;
    for (l, &length) in parts.iter().enumerate() {
        let (part, tail) = rest.split_at_mut(length);
        rest = tail;
        let e = Extent::of(part);
        for a in 0..3 {
            node.lo[a][l] = e.lo[a];
            node.hi[a][l] = e.hi[a];
        }
        if length <= MAX_LEAF_PRIMITIVES {
            node.first[l] = start;
            node.count[l] = length as u32;
        } else {
            node.count[l] = 0;
            inner.push((l, start, part));
        }
        start += length as u32;
    }
    // Children of large ranges are built apart from each other, with numbers from 0, then moved behind the others.
    if start - base >= MIN_PARALLEL_PRIMITIVES as u32 {
        use rayon::prelude::*;
        let built: Vec<(usize, Vec<Node>)> = inner
            .into_par_iter()
            .map(|(l, start, part)| {
                let mut nodes = Vec::new();
                build(part, start, depth + 2, &mut nodes);
                (l, nodes)
            })
            .collect();
        for (l, nodes) in built {
            let shift = out.len() as u32;
            node.first[l] = shift;
            // Only inner lanes, with a count of 0, hold numbers of nodes.
            out.extend(nodes.into_iter().map(|mut n| {
                for l in 0..4 {
                    if n.count[l] == 0 {
                        n.first[l] += shift;
                    }
                }
                n
            }));
        }
    } else {
        for (l, start, part) in inner {
            node.first[l] = out.len() as u32;
            build(part, start, depth + 2, out);
        }
    }
    out[node_index] = node;
}

/// Sorts a range into up to four consecutive parts, the children of a node; returns their lengths.
fn split_in_four(primitives: &mut [Primitive], depth: usize) -> Vec<usize> {
    let mut parts = vec![primitives.len()];
    // Halves the part whose box has the largest surface, until there are four or all fit into leaves.
    while parts.len() < 4 {
        let mut start = 0;
        let mut widest = (-1f32, 0, 0);
        for (i, &n) in parts.iter().enumerate() {
            let half_area = Extent::of(&primitives[start..start + n]).half_area();
            if n > MAX_LEAF_PRIMITIVES && half_area > widest.0 {
                widest = (half_area, i, start);
            }
            start += n;
        }
        let (half_area, i, start) = widest;
        // No part with more than a leaf's primitives is left.
        if half_area < 0.0 {
            break;
        }
        let n = parts[i];
        let mid = split(&mut primitives[start..start + n], depth);
        parts[i] = mid;
        parts.insert(i + 1, n - mid);
    }
    parts
}

/// Partitions a range in two by the least surface-area cost over bins; returns the first part's length. `depth` counts
/// the halvings above. Deep ranges, small ones and those with one common centre split at the longest axis's median.
fn split(primitives: &mut [Primitive], depth: usize) -> usize {
    let n = primitives.len();
    // Bins divide the range of the centres, not of the boxes: no bin at an end is empty.
    let mut centres = Extent::EMPTY_BOX;
    for p in primitives.iter() {
        let c = [0, 1, 2].map(|a| p.double_centre(a));
        centres.grow(c, c);
    }
    let width = [0, 1, 2].map(|a| centres.hi[a] - centres.lo[a]);
    let longest = (1..3).fold(0, |m, a| if width[a] > width[m] { a } else { m });
    let bin = |p: &Primitive, axis: usize| {
        let t = (p.double_centre(axis) - centres.lo[axis]) / width[axis] * BIN_COUNT as f32;
        (t as usize).min(BIN_COUNT - 1)
    };
    let mut best = (f32::INFINITY, 0, 0);
    if depth < MAX_COST_SPLIT_DEPTH && n > MAX_MEDIAN_SPLIT_PRIMITIVES {
        for axis in (0..3).filter(|&a| width[a] > 0.0) {
            // Boxes and counts by bin.
            let mut bins = [(Extent::EMPTY_BOX, 0usize); BIN_COUNT];
            for p in primitives.iter() {
                let b = &mut bins[bin(p, axis)];
                b.0.grow(p.lo, p.hi);
                b.1 += 1;
            }
            // The costs of all bins from i on, then from the left: area times number on both sides of each boundary.
            let mut after = [0f32; BIN_COUNT];
            let mut e = (Extent::EMPTY_BOX, 0);
            for i in (1..BIN_COUNT).rev() {
                e.0.grow(bins[i].0.lo, bins[i].0.hi);
                e.1 += bins[i].1;
                after[i] = e.0.half_area() * e.1 as f32;
            }
            let mut e = (Extent::EMPTY_BOX, 0);
            for i in 0..BIN_COUNT - 1 {
                e.0.grow(bins[i].0.lo, bins[i].0.hi);
                e.1 += bins[i].1;
                let cost = e.0.half_area() * e.1 as f32 + after[i + 1];
                if e.1 > 0 && e.1 < n && cost < best.0 {
                    best = (cost, axis, i);
                }
            }
        }
    }
    // In place: primitives of the bins up to the best one move to the front.
    if best.0.is_finite() {
        let (_, axis, last) = best;
        let mut mid = 0;
        for i in 0..n {
            if bin(&primitives[i], axis) <= last {
                primitives.swap(i, mid);
                mid += 1;
            }
        }
        return mid;
    }
    primitives.select_nth_unstable_by(n / 2, |p, q| {
        p.double_centre(longest)
            .total_cmp(&q.double_centre(longest))
            .then(p.index.cmp(&q.index))
    });
    n / 2
}
