//! The scale of rule Q, distance / |F|, tabulated over one period.
//!
//! The scale is smooth where cells are large in voxels, and periodic as the field is: it is found once, on
//! a lattice over one period, and the leaves take theirs from a few nodes of it along each axis, close to
//! Chebyshev's, by Lagrange's polynomials. How many nodes do is tried out; if none do, every sample has
//! its own scale.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::kernel::{Function, scale, splatted, stored};
use super::periods::EACH;
use crate::cell::{Along, FUNCTIONS};
use crate::lanes::{Lanes, Pair, Twice, Work};

/// Nodes along an axis where every sample is one.
pub(super) const EVERY: usize = 8;
/// Most nodes along an axis, otherwise.
pub(super) const MOST: usize = 6;
/// Least and most places of the lattice along an axis. Multiples of eight, so that the middles between
/// them are far from the points of special symmetry, at which slopes vanish and scales leap.
const PLACES: [f64; 2] = [16.0, 64.0];

/// Scales over one period, and of how many of them along an axis those of a leaf are made.
#[derive(Clone, Debug, Default)]
pub(super) struct Scales {
    /// Places along each axis.
    counts: [usize; 3],
    /// z fastest; the first one half a place from reference coordinates 0.
    values: Vec<f32>,
    /// At most [`MOST`], or [`EVERY`].
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
    nodes: [usize; MOST],
    /// Of each node, its share in each sample.
    shares: [[f32; 8]; MOST],
    /// How far outside the box the samples lie.
    pub beyond: [f32; 8],
}

impl Axis {
    pub const NONE: Self = Self {
        origin: f64::NAN,
        along: [[0.0; 8]; FUNCTIONS],
        nodes: [0; MOST],
        shares: [[0.0; 8]; MOST],
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
            nodes: EVERY,
            ..Self::default()
        }
    }

    /// A table of places about a voxel apart, but not too many of them; from how many nodes leaves take
    /// their scales is yet to be said.
    pub fn new(function: &Function, voxel_size: f64) -> Self {
        let voxels = (function.periods.rate * voxel_size).map(f64::recip);
        let [least, most] = PLACES;
        let count = |axis: usize| (voxels[axis].clamp(least, most) / 8.0).ceil() as usize * 8;
        let counts = [count(0), count(1), count(2)];
        let mut values = vec![0.0; counts.iter().product()];
        crate::lanes::run(TableWork {
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
        self.nodes = nodes;
        for (n, wanted) in self.wanted.iter_mut().enumerate() {
            // A little wider than the leaf.
            let angle = std::f64::consts::PI * (n as f64 + 0.5) / nodes as f64;
            *wanted = -1.08 * libm::cos(angle);
        }
        self
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
        }
        of
    }

    /// Finds the nodes of samples at so many places of the table, and their shares in them.
    #[inline(always)]
    fn place_nodes<L: Lanes>(&self, l: L, axis: usize, places: &[f64; 8], of: &mut Axis) {
        let stride = match axis {
            0 => self.counts[1] * self.counts[2],
            1 => self.counts[2],
            _ => 1,
        };
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
            of.nodes[n] = at[n].rem_euclid(self.counts[axis] as i64) as usize * stride;
        }
    }

    /// Scales along z at the nodes along x and all places along y, two of them together: what is left to do
    /// is to add up those of x, with the shares that [`Self::shares`] gives.
    #[inline(always)]
    pub fn planes<L: Lanes, const N: usize>(&self, l: L, at: [&Axis; 3]) -> [[Pair<L>; N]; 4] {
        let [x, y, z] = at;
        let zero = l.splat(0.0);
        let mut along_z = [zero; N];
        for k in 0..N {
            along_z[k] = l.load(&z.shares[k]);
        }
        let two = l.two();
        let none = two.each([0.0; 2]);
        let mut planes = [[none; N]; 4];
        for i in 0..N {
            let mut rows = [zero; N];
            for j in 0..N {
                let row = x.nodes[i].wrapping_add(y.nodes[j]);
                for k in 0..N {
                    let value = self.values[row.wrapping_add(z.nodes[k])];
                    rows[j] = l.fused(l.splat(value), along_z[k], rows[j]);
                }
            }
            for v in 0..4 {
                let mut sum = none;
                for j in 0..N {
                    let shares = two.each([y.shares[j][2 * v], y.shares[j][2 * v + 1]]);
                    sum = two.fused(shares, two.pair([rows[j], rows[j]]), sum);
                }
                planes[v][i] = sum;
            }
        }
        planes
    }

    /// Each node's share in sample `v` along an axis; nothing where every sample has its own scale.
    #[inline(always)]
    pub fn shares<L: Lanes, const N: usize>(l: L, axis: &Axis, v: usize) -> [Pair<L>; N] {
        let mut shares = [l.two().each([0.0; 2]); N];
        for n in 0..N.min(MOST) {
            shares[n] = l.two().each([axis.shares[n][v & 7]; 2]);
        }
        shares
    }
}

/// A table to be filled.
struct TableWork<'a> {
    function: &'a Function,
    counts: [usize; 3],
    values: &'a mut [f32],
}

impl Work for TableWork<'_> {
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
                let found = scale::<L, true>(l, function, [&at_x, &at_y, &along_z]);
                l.store(found, values);
            }
        }
    }
}
