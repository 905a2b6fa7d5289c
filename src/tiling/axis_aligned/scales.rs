//! The scale of rule Q, distance / |F|, tabulated over one period.
//!
//! The scale is smooth where cells are large in voxels, and periodic as the field is: it is found once, on
//! a lattice over one period, and the leaves take theirs from a few nodes of it along each axis, close to
//! Chebyshev's, by Lagrange's polynomials. How many nodes do is tried out.
//!
//! Where the band is so wide that its leaves reach to where the scale leaps, half a wall or gap away, no
//! polynomial over the whole of a leaf follows it. There a sample takes its scale from the four places about
//! it along each axis, of a table of about a place a voxel; if that does not do either, every sample has its
//! own scale.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::kernel::{Function, scale, splatted, stored};
use super::periods::EACH;
use crate::cell::{Along, FUNCTIONS};
use crate::simd::{Lanes, Pair, Twice, Work};
use std::sync::atomic::{AtomicU64, Ordering};

/// Nodes along an axis where every sample is one.
pub(super) const EVERY: usize = 12;
/// Most nodes along an axis of which all have a share in each sample.
pub(super) const MOST: usize = 6;
/// Nodes along an axis where four have a share in a sample.
pub(super) const LOCAL: usize = 11;
/// Places of a table, of which the nodes along an axis are some, all of which follow each other.
const SPREAD: usize = 16;
/// Least and most places of the lattice along an axis. Multiples of eight, so that the middles between
/// them are far from the points of special symmetry, at which slopes vanish and scales leap.
const PLACES: [f64; 2] = [16.0, 64.0];
/// Fewest voxels of a period, of which a leaf's nodes lie among [`SPREAD`] places.
const FEWEST: f64 = 10.0;

/// The number of the next scales.
static NEXT: AtomicU64 = AtomicU64::new(0);

/// Scales over one period, and of how many of them along an axis those of a leaf are made.
#[derive(Clone, Debug, Default)]
pub(super) struct Scales {
    /// No others have this number.
    number: u64,
    /// Places along each axis.
    counts: [usize; 3],
    /// Places from the beginning of each row along z that come again at its end.
    again: usize,
    /// z fastest; the first one half a place from reference coordinates 0.
    values: Vec<f32>,
    /// At most [`MOST`], or [`LOCAL`], or [`EVERY`].
    nodes: usize,
    /// Where the nodes are wanted, in halves of a leaf from its centre.
    wanted: [f64; MOST],
}

/// What the eight samples of a leaf along one axis have in common with all leaves there.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    /// Coordinate of the first sample; not a number before there is one.
    pub origin: f64,
    pub along: Along<[f32; 8]>,
    /// Where the nodes are in the table of scales.
    nodes: [usize; LOCAL],
    /// Of each sample, the first node that has a share in it, where four have.
    from: [usize; 8],
    /// Of each node, its share in each sample.
    shares: [[f32; 8]; LOCAL],
    /// How far outside the box the samples lie.
    pub beyond: [f32; 8],
}

impl Axis {
    pub const NONE: Self = Self {
        origin: f64::NAN,
        along: [[0.0; 8]; FUNCTIONS],
        nodes: [0; LOCAL],
        from: [0; 8],
        shares: [[0.0; 8]; LOCAL],
        beyond: [0.0; 8],
    };

    /// How far outside the box the outermost sample lies.
    #[inline(always)]
    pub fn outermost(&self) -> f32 {
        self.beyond[0].max(self.beyond[7])
    }
}

impl Scales {
    /// No table: every sample has its own scale.
    pub fn of_every_sample() -> Self {
        Self {
            number: NEXT.fetch_add(1, Ordering::Relaxed),
            nodes: EVERY,
            ..Self::default()
        }
    }

    /// A table of places about so many voxels apart, but not too many of them; from how many nodes leaves take
    /// their scales is yet to be said. None for cells of few voxels.
    pub fn new(function: &Function, voxel_size: f64, apart: f64) -> Option<Self> {
        let voxels = (function.periods.rate * voxel_size).map(f64::recip);
        let [least, most] = PLACES;
        if voxels.min() < FEWEST {
            return None;
        }
        let wanted = voxels.map(|v| (v / apart).clamp(least, most));
        let count = |axis: usize| (wanted[axis] / 8.0).ceil() as usize * 8;
        let table = Self::with_places::<true>(function, [count(0), count(1), count(2)]);
        Some(table.going_on(SPREAD))
    }

    /// A table of places no nearer to each other than voxels, each sample's scale from the four places about
    /// it along each axis; none for cells of few voxels.
    pub fn local(function: &Function, voxel_size: f64) -> Option<Self> {
        let voxels = (function.periods.rate * voxel_size).map(|r| r.recip() * (1.0 + 1e-9));
        let [least, most] = PLACES;
        if voxels.min() < least {
            return None;
        }
        let count = |axis: usize| (voxels[axis].min(most) / 8.0) as usize * 8;
        let table = Self::with_places::<false>(function, [count(0), count(1), count(2)]);
        Some(Self {
            nodes: LOCAL,
            ..table.going_on(LOCAL)
        })
    }

    /// The table whose rows go on for so many places, so that those from any place on follow each other.
    fn going_on(mut self, again: usize) -> Self {
        let count = self.counts[2];
        let rows = self.values.chunks_exact(count);
        self.values = rows
            .flat_map(|row| row.iter().cycle().take(count + again))
            .copied()
            .collect();
        self.again = again;
        self
    }

    /// A table of so many places along each axis; `SMOOTH` as of [`scale`].
    fn with_places<const SMOOTH: bool>(function: &Function, counts: [usize; 3]) -> Self {
        let mut values = vec![0.0; counts.iter().product()];
        crate::simd::run(TableWork::<SMOOTH> {
            function,
            counts,
            values: &mut values,
        });
        Self {
            counts,
            values,
            ..Self::of_every_sample()
        }
    }

    /// The same table, with so many nodes along each axis of a leaf.
    #[must_use]
    pub fn with_nodes(mut self, nodes: usize) -> Self {
        self.number = NEXT.fetch_add(1, Ordering::Relaxed);
        self.nodes = nodes;
        for (n, wanted) in self.wanted.iter_mut().enumerate() {
            // A little wider than the leaf.
            let angle = std::f64::consts::PI * (n as f64 + 0.5) / nodes as f64;
            *wanted = -1.08 * libm::cos(angle);
        }
        self
    }

    /// A number that no other scales have.
    pub fn number(&self) -> u64 {
        self.number
    }

    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// What eight samples along an axis take, from the coordinate of the first of them.
    #[inline(always)]
    pub fn axis<L: Lanes>(
        &self,
        l: L,
        function: &Function,
        axis: usize,
        origin: f64,
        step: f64,
    ) -> Axis {
        let periods = &function.periods;
        let parts = periods.parts(l, axis, origin, step, &EACH);
        let mut of = Axis {
            origin,
            along: stored(l, &function.products.along(l, &parts)),
            ..Axis::NONE
        };
        let count = self.counts[axis];
        let mut places = [0.0; 8];
        for n in 0..8 {
            let x = origin + step * n as f64;
            of.beyond[n] = periods.beyond(axis, x, step) as f32;
            let u = (periods.inside(axis, x) - periods.centre[axis]) * periods.rate[axis];
            places[n] = u * count as f64 - 0.5;
        }
        if self.nodes <= MOST {
            self.place_nodes(l, axis, &places, &mut of);
        } else if self.nodes == LOCAL {
            self.place_local(axis, &places, &mut of);
        }
        of
    }

    /// The step of the table from one place to the next along an axis.
    #[inline(always)]
    fn stride(&self, axis: usize) -> usize {
        let row = self.counts[2] + self.again;
        match axis {
            0 => self.counts[1] * row,
            1 => row,
            _ => 1,
        }
    }

    /// Takes all places about the samples for nodes; each sample has its shares of the four about it, by
    /// Lagrange's cubic.
    #[inline(always)]
    fn place_local(&self, axis: usize, places: &[f64; 8], of: &mut Axis) {
        let first = places[0].floor() as i64 - 1;
        for n in 0..LOCAL {
            let place = (first + n as i64).rem_euclid(self.counts[axis] as i64);
            of.nodes[n] = place as usize * self.stride(axis);
        }
        let mut from = 0;
        for v in 0..8 {
            // At most a place further than the sample before, rounding or not.
            let next = places[v].floor() as i64 - 1 - first;
            from = next.clamp(from, from + i64::from(v > 0));
            let t = (places[v] - (first + from + 1) as f64) as f32;
            let [a, b, c] = [t + 1.0, t - 1.0, t - 2.0];
            let at = from as usize & 7;
            of.from[v] = at;
            of.shares[at][v] = t * b * c / -6.0;
            of.shares[at + 1][v] = a * b * c / 2.0;
            of.shares[at + 2][v] = a * t * c / -2.0;
            of.shares[at + 3][v] = a * t * b / 6.0;
        }
    }

    /// Finds the nodes of samples at so many places of the table, and their shares in them.
    #[inline(always)]
    fn place_nodes<L: Lanes>(&self, l: L, axis: usize, places: &[f64; 8], of: &mut Axis) {
        let stride = self.stride(axis);
        let middle = f64::midpoint(places[0], places[7]);
        let half = (places[7] - places[0]) / 2.0;
        let mut at = [0i64; MOST];
        let inner = (self.nodes - 1) / 2;
        let wanted = |n: usize| (middle + half * self.wanted[n]).round() as i64;
        at[inner] = wanted(inner).min(if self.nodes.is_multiple_of(2) {
            middle.floor() as i64
        } else {
            i64::MAX
        });
        for n in inner + 1..self.nodes {
            at[n] = wanted(n).max(at[n - 1] + 1);
        }
        for n in (0..inner).rev() {
            at[n] = wanted(n).min(at[n + 1] - 1);
        }
        let mut apart = [l.splat(0.0); MOST];
        for n in 0..self.nodes {
            let mut row = [0.0; 8];
            for v in 0..8 {
                row[v] = (places[v] - at[n] as f64) as f32;
            }
            apart[n] = l.load(&row);
        }
        for n in 0..self.nodes {
            let mut share = l.splat(1.0);
            let mut whole = 1.0;
            for m in 0..self.nodes {
                if m != n {
                    share = l.mul(share, apart[m]);
                    whole *= (at[n] - at[m]) as f32;
                }
            }
            l.store(l.div(share, l.splat(whole)), &mut of.shares[n]);
            let place = |node: i64| node.rem_euclid(self.counts[axis] as i64) as usize;
            of.nodes[n] = if axis == 2 {
                place(at[0]) + (at[n] - at[0]) as usize
            } else {
                place(at[n]) * stride
            };
        }
    }

    /// Scales along z at the nodes along x and all places along y, two of them together: what is left to do
    /// is to add up those of x, with the shares that [`Self::shares`] gives.
    #[inline(always)]
    pub fn planes<L: Lanes, const N: usize>(&self, l: L, at: [&Axis; 3]) -> [[Pair<L>; N]; 4] {
        if N == LOCAL {
            let local = self.local_planes(l, at);
            let mut planes = [[l.two().each([0.0; 2]); N]; 4];
            for v in 0..4 {
                for n in 0..N {
                    planes[v][n] = local[v][n.min(LOCAL - 1)];
                }
            }
            return planes;
        }
        let [x, y, z] = at;
        let zero = l.splat(0.0);
        let mut along_z = [zero; N];
        for k in 0..N {
            along_z[k] = l.load(&z.shares[k]);
        }
        let two = l.two();
        let none = two.each([0.0; 2]);
        let mut ahead = [0; N];
        for k in 0..N {
            ahead[k] = z.nodes[k].wrapping_sub(z.nodes[0]) % SPREAD;
        }
        let mut along_y = [[none; N]; 4];
        for v in 0..4 {
            for j in 0..N {
                along_y[v][j] = two.each([y.shares[j][2 * v], y.shares[j][2 * v + 1]]);
            }
        }
        let mut planes = [[none; N]; 4];
        for i in 0..N {
            let mut rows = [none; N];
            for j in 0..N {
                let first = x.nodes[i].wrapping_add(y.nodes[j]).wrapping_add(z.nodes[0]);
                let values = self.values.get(first..).and_then(|v| v.first_chunk());
                let Some::<&[f32; SPREAD]>(values) = values else {
                    continue;
                };
                let mut row = zero;
                for k in 0..N {
                    row = l.fused(l.splat(values[ahead[k]]), along_z[k], row);
                }
                rows[j] = two.pair([row, row]);
            }
            for v in 0..4 {
                let mut sum = none;
                for j in 0..N {
                    sum = two.fused(along_y[v][j], rows[j], sum);
                }
                planes[v][i] = sum;
            }
        }
        planes
    }

    /// [`Self::planes`] of the nodes of which four have a share in a sample.
    #[inline(always)]
    fn local_planes<L: Lanes>(&self, l: L, at: [&Axis; 3]) -> [[Pair<L>; LOCAL]; 4] {
        let [x, y, z] = at;
        let zero = l.splat(0.0);
        let mut along_z = [zero; LOCAL];
        for k in 0..LOCAL {
            along_z[k] = l.load(&z.shares[k]);
        }
        let two = l.two();
        let none = two.each([0.0; 2]);
        let mut planes = [[none; LOCAL]; 4];
        for i in 0..LOCAL {
            let mut rows = [zero; LOCAL];
            for j in 0..LOCAL {
                let row = x.nodes[i] + y.nodes[j] + z.nodes[0];
                let Some(values) = self.values[row..].first_chunk::<LOCAL>() else {
                    continue;
                };
                for k in 0..LOCAL {
                    rows[j] = l.fused(l.splat(values[k]), along_z[k], rows[j]);
                }
            }
            for v in 0..4 {
                // The second sample's nodes begin at most one further.
                let from = y.from[2 * v];
                for n in 0..5 {
                    let j = (from + n).min(LOCAL - 1);
                    let shares = two.each([y.shares[j][2 * v], y.shares[j][2 * v + 1]]);
                    planes[v][i] = two.fused(shares, two.pair([rows[j], rows[j]]), planes[v][i]);
                }
            }
        }
        planes
    }

    /// The first of the nodes that have a share in sample `v` along an axis, and their shares; none where
    /// every sample has its own scale.
    #[inline(always)]
    pub fn shares<L: Lanes, const N: usize>(
        l: L,
        axis: &Axis,
        v: usize,
    ) -> (usize, [Pair<L>; MOST]) {
        let from = if N == LOCAL { axis.from[v & 7] & 7 } else { 0 };
        let mut shares = [l.two().each([0.0; 2]); MOST];
        for n in 0..sharing(N) {
            shares[n] = l.two().each([axis.shares[from + n][v & 7]; 2]);
        }
        (from, shares)
    }
}

/// How many of N nodes have a share in a sample.
pub(super) const fn sharing(nodes: usize) -> usize {
    match nodes {
        EVERY => 0,
        LOCAL => 4,
        few => few,
    }
}

/// A table to be filled.
/// `SMOOTH` as of [`scale`].
struct TableWork<'a, const SMOOTH: bool> {
    function: &'a Function,
    counts: [usize; 3],
    values: &'a mut [f32],
}

impl<const SMOOTH: bool> Work for TableWork<'_, SMOOTH> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            function,
            counts,
            values,
        } = self;
        // The functions at eight places from the given one on.
        let mut tables = [const { Vec::new() }; 3];
        for axis in 0..3 {
            for first in (0..counts[axis]).step_by(8) {
                let mut parts = [0.0; 8];
                for n in 0..8 {
                    let part = ((first + n) as f64 + 0.5) / counts[axis] as f64;
                    parts[n] = (part - part.round()) as f32;
                }
                tables[axis].push(stored(l, &function.products.along(l, &parts)));
            }
        }
        let [xs, ys, zs] = &tables;
        let rows = values.chunks_exact_mut(counts[2]);
        for (row, values) in rows.enumerate() {
            let (i, j) = (row / counts[1], row % counts[1]);
            let at_x = splatted(l, &xs[i / 8], i % 8);
            let at_y = splatted(l, &ys[j / 8], j % 8);
            for (values, z) in values.as_chunks_mut().0.iter_mut().zip(zs) {
                let mut along_z = [l.splat(1.0); FUNCTIONS];
                for n in 1..FUNCTIONS {
                    along_z[n] = l.load(&z[n]);
                }
                let found = scale::<L, SMOOTH>(l, function, [&at_x, &at_y, &along_z]);
                l.store(found, values);
            }
        }
    }
}
