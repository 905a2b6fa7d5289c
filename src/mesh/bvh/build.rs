//! Building: binned surface-area splits, four children at a time, in parallel for large ranges.

use super::Node;

/// Primitives in a leaf at most.
const LEAF: usize = 2;
/// Bins per axis when a split is sought.
const BINS: usize = 16;
/// Depth from which ranges are halved instead of split by cost.
const COST_DEPTH: usize = 48;
/// Ranges of at most this many primitives are halved: bins cost more there than they save.
const HALVED: usize = 16;
/// Ranges of at least this many primitives are built in parallel.
const PARALLEL: usize = 1 << 13;

/// A primitive while the tree is built.
#[derive(Clone, Copy)]
pub(super) struct Primitive {
    pub(super) lo: [f32; 3],
    pub(super) hi: [f32; 3],
    pub(super) index: u32,
}

impl Primitive {
    fn centre(&self, axis: usize) -> f32 {
        self.lo[axis] + self.hi[axis]
    }
}

/// A box while the tree is built.
#[derive(Clone, Copy)]
struct Extent {
    lo: [f32; 3],
    hi: [f32; 3],
}

impl Extent {
    const EMPTY: Self = Self {
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
        let mut e = Self::EMPTY;
        for p in primitives {
            e.grow(p.lo, p.hi);
        }
        e
    }

    /// Half the surface area; 0 for an empty box.
    fn area(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|a| (self.hi[a] - self.lo[a]).max(0.0));
        x * y + y * z + z * x
    }
}

/// Builds the node over a range of primitives whose first slot is `base`, after the nodes in `out`.
pub(super) fn build(primitives: &mut [Primitive], base: u32, depth: usize, out: &mut Vec<Node>) {
    let here = out.len();
    out.push(Node::empty());
    let parts = quarter(primitives, depth);
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
        if length <= LEAF {
            node.first[l] = start;
            node.count[l] = length as u32;
        } else {
            node.count[l] = 0;
            inner.push((l, start, part));
        }
        start += length as u32;
    }
    if rest.is_empty() && start - base >= PARALLEL as u32 {
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
    out[here] = node;
}

/// Orders a range so that up to four consecutive parts make good children; gives their lengths.
fn quarter(primitives: &mut [Primitive], depth: usize) -> Vec<usize> {
    let mut parts = vec![primitives.len()];
    while parts.len() < 4 {
        let mut start = 0;
        let mut widest = (-1f32, 0, 0);
        for (i, &n) in parts.iter().enumerate() {
            let area = Extent::of(&primitives[start..start + n]).area();
            if n > LEAF && area > widest.0 {
                widest = (area, i, start);
            }
            start += n;
        }
        let (area, i, start) = widest;
        if area < 0.0 {
            break;
        }
        let n = parts[i];
        let mid = split(&mut primitives[start..start + n], depth);
        parts[i] = mid;
        parts.insert(i + 1, n - mid);
    }
    parts
}

/// Partitions a range in two by the least surface-area cost over bins; gives the first part's length.
fn split(primitives: &mut [Primitive], depth: usize) -> usize {
    let n = primitives.len();
    let mut centres = Extent::EMPTY;
    for p in primitives.iter() {
        let c = [0, 1, 2].map(|a| p.centre(a));
        centres.grow(c, c);
    }
    let width = [0, 1, 2].map(|a| centres.hi[a] - centres.lo[a]);
    let longest = (1..3).fold(0, |m, a| if width[a] > width[m] { a } else { m });
    let bin = |p: &Primitive, axis: usize| {
        let t = (p.centre(axis) - centres.lo[axis]) / width[axis] * BINS as f32;
        (t as usize).min(BINS - 1)
    };
    let mut best = (f32::INFINITY, 0, 0);
    if depth < COST_DEPTH && n > HALVED {
        for axis in (0..3).filter(|&a| width[a] > 0.0) {
            let mut bins = [(Extent::EMPTY, 0usize); BINS];
            for p in primitives.iter() {
                let b = &mut bins[bin(p, axis)];
                b.0.grow(p.lo, p.hi);
                b.1 += 1;
            }
            let mut after = [0f32; BINS];
            let mut e = (Extent::EMPTY, 0);
            for i in (1..BINS).rev() {
                e.0.grow(bins[i].0.lo, bins[i].0.hi);
                e.1 += bins[i].1;
                after[i] = e.0.area() * e.1 as f32;
            }
            let mut e = (Extent::EMPTY, 0);
            for i in 0..BINS - 1 {
                e.0.grow(bins[i].0.lo, bins[i].0.hi);
                e.1 += bins[i].1;
                let cost = e.0.area() * e.1 as f32 + after[i + 1];
                if e.1 > 0 && e.1 < n && cost < best.0 {
                    best = (cost, axis, i);
                }
            }
        }
    }
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
    // Few, all in one place, or too deep: halve along the longest axis.
    primitives.select_nth_unstable_by(n / 2, |p, q| {
        p.centre(longest)
            .total_cmp(&q.centre(longest))
            .then(p.index.cmp(&q.index))
    });
    n / 2
}
