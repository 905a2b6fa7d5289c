//! The scale of rule Q, distance / |F|, tabulated over one period.
//!
//! The scale is periodic, and smooth where cells are large in voxels. It is tabulated on a lattice over one period. A
//! leaf interpolates it from a few entries along each axis, near Chebyshev nodes, by Lagrange polynomials. Trials
//! decide how many nodes are enough.
//!
//! In a wide band, leaves reach the middle of walls and gaps, where the scale jumps. No polynomial over a whole leaf
//! follows that. There each sample interpolates from the four entries around it along each axis, in a table of about
//! one entry a voxel. If that is not enough, every sample computes its own scale. Trials accept errors of 0.004 voxel
//! root mean square and 0.06 at most; the law `distances_are_those_of_the_general_way` allows 0.005 and 0.1.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::kernel::{PeriodicField, scale, splat_at, to_arrays};
use super::periods::FIRST_EIGHT_STEPS;
use druse_cells::cell::{Along, FUNCTIONS};
use druse_geometry::simd::{Lanes, Pair, SimdKernel, WideLanes};
use std::sync::atomic::{AtomicU64, Ordering};

/// Stands for scales computed at every sample: more than any number of nodes.
pub(super) const PER_SAMPLE: usize = 12;
/// Greatest number of nodes along an axis for a polynomial over the whole leaf.
pub(super) const MAX_POLYNOMIAL_NODES: usize = 6;
/// Number of nodes along an axis where each sample interpolates between four of them: eight samples span eight entries
/// at most, and cubics need one before and two behind.
pub(super) const LOCAL_NODES: usize = 11;
/// Number of consecutive entries along an axis that include the nodes of a leaf.
const NODE_SPAN: usize = 16;
/// Least and greatest number of entries along an axis. They are multiples of eight, so that entries, half a
/// spacing off the origin, avoid points of special symmetry, where slopes vanish and scales jump.
const ENTRY_RANGE: [f64; 2] = [16.0, 64.0];
/// Least size of a period, voxels: a leaf's nodes then lie within [`NODE_SPAN`] entries.
const MIN_PERIOD_VOXELS: f64 = 10.0;

/// The next unused identifier.
static NEXT_ID: AtomicU64 = AtomicU64::new(0);

/// A table of scales over one period, and the number of nodes from which a leaf interpolates.
#[derive(Clone, Debug, Default)]
pub(super) struct Scales {
    /// Unique identifier.
    id: u64,
    /// Entries along each axis.
    counts: [usize; 3],
    /// Entries from the beginning of each row along z that are repeated at its end.
    wrapped: usize,
    /// z fastest; the first entry is half a spacing from reference coordinates 0.
    values: Vec<f32>,
    /// At most [`MAX_POLYNOMIAL_NODES`], or [`LOCAL_NODES`], or [`PER_SAMPLE`].
    nodes: usize,
    /// Target positions of the nodes, in halves of a leaf from its centre.
    targets: [f64; MAX_POLYNOMIAL_NODES],
}

/// Data of the eight samples of a leaf along one axis.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    /// Coordinate of the first sample, world units; NaN in an unused entry.
    pub origin: f64,
    pub along: Along<[f32; 8]>,
    /// Offsets of the nodes in the table.
    nodes: [usize; LOCAL_NODES],
    /// For each sample, the first of the four nodes between which it interpolates.
    first_node: [usize; 8],
    /// Weight of each node in each sample.
    weights: [[f32; 8]; LOCAL_NODES],
    /// Distance of each sample outside the box.
    pub outside: [f32; 8],
}

impl Axis {
    pub const EMPTY_AXIS: Self = Self {
        origin: f64::NAN,
        along: [[0.0; 8]; FUNCTIONS],
        nodes: [0; LOCAL_NODES],
        first_node: [0; 8],
        weights: [[0.0; 8]; LOCAL_NODES],
        outside: [0.0; 8],
    };

    /// Distance of the outermost sample outside the box.
    #[inline(always)]
    pub fn outermost(&self) -> f32 {
        self.outside[0].max(self.outside[7])
    }
}

impl Scales {
    /// No table: every sample computes its own scale.
    pub fn per_sample() -> Self {
        Self {
            id: NEXT_ID.fetch_add(1, Ordering::Relaxed),
            nodes: PER_SAMPLE,
            ..Self::default()
        }
    }

    /// A table with entries about `spacing` voxels apart, within [`ENTRY_RANGE`]; [`Self::with_nodes`] sets the
    /// number of nodes. `None` for periods of few voxels.
    pub fn new(field: &PeriodicField, voxel_size: f64, spacing: f64) -> Option<Self> {
        let voxels = (field.periods.rate * voxel_size).map(f64::recip);
        let [min, max] = ENTRY_RANGE;
        if voxels.min() < MIN_PERIOD_VOXELS {
            return None;
        }
        let target = voxels.map(|v| (v / spacing).clamp(min, max));
        let count = |axis: usize| (target[axis] / 8.0).ceil() as usize * 8;
        let table = Self::with_entries::<true>(field, [count(0), count(1), count(2)]);
        Some(table.with_wrapped_rows(NODE_SPAN))
    }

    /// A table with entries at least a voxel apart, from which each sample interpolates between the four entries
    /// around it along each axis. `None` for periods of few voxels.
    pub fn local(field: &PeriodicField, voxel_size: f64) -> Option<Self> {
        let voxels = (field.periods.rate * voxel_size).map(|r| r.recip() * (1.0 + 1e-9));
        let [min, max] = ENTRY_RANGE;
        if voxels.min() < min {
            return None;
        }
        let count = |axis: usize| (voxels[axis].min(max) / 8.0) as usize * 8;
        let table = Self::with_entries::<false>(field, [count(0), count(1), count(2)]);
        Some(Self {
            nodes: LOCAL_NODES,
            ..table.with_wrapped_rows(LOCAL_NODES)
        })
    }

    /// Repeats the first `wrapped` entries of each row at its end, so that the entries after any entry are consecutive.
    fn with_wrapped_rows(mut self, wrapped: usize) -> Self {
        let count = self.counts[2];
        let rows = self.values.chunks_exact(count);
        self.values = rows
            .flat_map(|row| row.iter().cycle().take(count + wrapped))
            .copied()
            .collect();
        self.wrapped = wrapped;
        self
    }

    /// A table with these numbers of entries along each axis; `LIMIT_SMOOTHLY` as in [`scale`].
    fn with_entries<const LIMIT_SMOOTHLY: bool>(field: &PeriodicField, counts: [usize; 3]) -> Self {
        let mut values = vec![0.0; counts.iter().product()];
        druse_geometry::simd::run(TableKernel::<LIMIT_SMOOTHLY> {
            field,
            counts,
            values: &mut values,
        });
        Self {
            counts,
            values,
            ..Self::per_sample()
        }
    }

    /// The same table, with this number of nodes along each axis of a leaf.
    #[must_use]
    pub fn with_nodes(mut self, nodes: usize) -> Self {
        self.id = NEXT_ID.fetch_add(1, Ordering::Relaxed);
        self.nodes = nodes;
        for (n, target) in self.targets.iter_mut().enumerate() {
            // Chebyshev nodes of a leaf larger by 8 %: the outermost lie at its ends or just beyond.
            let angle = std::f64::consts::PI * (n as f64 + 0.5) / nodes as f64;
            *target = -1.08 * libm::cos(angle);
        }
        self
    }

    pub fn id(&self) -> u64 {
        self.id
    }

    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Data of eight samples along an axis, from the coordinate of the first.
    #[inline(always)]
    pub fn axis<L: Lanes>(
        &self,
        l: L,
        field: &PeriodicField,
        axis: usize,
        origin: f64,
        step: f64,
    ) -> Axis {
        let periods = &field.periods;
        let parts = periods.parts(l, axis, origin, step, &FIRST_EIGHT_STEPS);
        let mut data = Axis {
            origin,
            along: to_arrays(l, &field.products.along(l, &parts)),
            ..Axis::EMPTY_AXIS
        };
        let count = self.counts[axis];
        let mut positions = [0.0; 8];
        // Positions in the table, in entries; the first entry lies half a spacing from the origin.
        for n in 0..8 {
            let x = origin + step * n as f64;
            data.outside[n] = periods.outside(axis, x, step) as f32;
            let u = (periods.inside(axis, x) - periods.centre[axis]) * periods.rate[axis];
            positions[n] = u * count as f64 - 0.5;
        }
        if self.nodes <= MAX_POLYNOMIAL_NODES {
            self.set_polynomial_nodes(l, axis, &positions, &mut data);
        } else if self.nodes == LOCAL_NODES {
            self.set_local_nodes(axis, &positions, &mut data);
        }
        data
    }

    /// Stride of the table along an axis.
    #[inline(always)]
    fn stride(&self, axis: usize) -> usize {
        let row = self.counts[2] + self.wrapped;
        match axis {
            0 => self.counts[1] * row,
            1 => row,
            _ => 1,
        }
    }

    /// Sets the nodes to all entries around the samples, and the weights of each sample by cubic Lagrange
    /// interpolation between four of them.
    #[inline(always)]
    fn set_local_nodes(&self, axis: usize, positions: &[f64; 8], data: &mut Axis) {
        let first = positions[0].floor() as i64 - 1;
        for n in 0..LOCAL_NODES {
            let entry = (first + n as i64).rem_euclid(self.counts[axis] as i64);
            data.nodes[n] = entry as usize * self.stride(axis);
        }
        // The cubic Lagrange weights at -1, 0, 1, 2 for a position t after the second of four entries.
        let mut from = 0;
        for v in 0..8 {
            // At most one entry further than the previous sample, also with rounding.
            let next = positions[v].floor() as i64 - 1 - first;
            from = next.clamp(from, from + i64::from(v > 0));
            let t = (positions[v] - (first + from + 1) as f64) as f32;
            let [a, b, c] = [t + 1.0, t - 1.0, t - 2.0];
            let at = from as usize & 7;
            data.first_node[v] = at;
            data.weights[at][v] = t * b * c / -6.0;
            data.weights[at + 1][v] = a * b * c / 2.0;
            data.weights[at + 2][v] = a * t * c / -2.0;
            data.weights[at + 3][v] = a * t * b / 6.0;
        }
    }

    /// Sets the nodes for samples at these positions in the table, and the weights.
    #[inline(always)]
    fn set_polynomial_nodes<L: Lanes>(
        &self,
        l: L,
        axis: usize,
        positions: &[f64; 8],
        data: &mut Axis,
    ) {
        // The entries nearest to the Chebyshev positions, all different: from the middle outwards, each next one is at
        // least one entry further.
        let stride = self.stride(axis);
        let middle = f64::midpoint(positions[0], positions[7]);
        let half = (positions[7] - positions[0]) / 2.0;
        let mut at = [0i64; MAX_POLYNOMIAL_NODES];
        let inner = (self.nodes - 1) / 2;
        let target = |n: usize| (middle + half * self.targets[n]).round() as i64;
        // Of an even number, the inner two lie on both sides of the middle.
        at[inner] = target(inner).min(if self.nodes.is_multiple_of(2) {
            middle.floor() as i64
        } else {
            i64::MAX
        });
        for n in inner + 1..self.nodes {
            at[n] = target(n).max(at[n - 1] + 1);
        }
        for n in (0..inner).rev() {
            at[n] = target(n).min(at[n + 1] - 1);
        }
        // Lagrange weights: prod over m != n of (x - x_m) / (x_n - x_m).
        let mut differences = [l.splat(0.0); MAX_POLYNOMIAL_NODES];
        for n in 0..self.nodes {
            let mut row = [0.0; 8];
            for v in 0..8 {
                row[v] = (positions[v] - at[n] as f64) as f32;
            }
            differences[n] = l.load(&row);
        }
        for n in 0..self.nodes {
            let mut weight = l.splat(1.0);
            let mut denominator = 1.0;
            for m in 0..self.nodes {
                if m != n {
                    weight = l.mul(weight, differences[m]);
                    denominator *= (at[n] - at[m]) as f32;
                }
            }
            l.store(l.div(weight, l.splat(denominator)), &mut data.weights[n]);
            let entry = |node: i64| node.rem_euclid(self.counts[axis] as i64) as usize;
            // Rows along z are repeated at their ends, so that offsets from the first node need no wrap.
            data.nodes[n] = if axis == 2 {
                entry(at[0]) + (at[n] - at[0]) as usize
            } else {
                entry(at[n]) * stride
            };
        }
    }

    /// Interpolates scales along y and z: for each node along x, the rows along z at two samples along y at a
    /// time. The sum over x, with the weights of [`Self::weights`], remains to be done.
    #[inline(always)]
    pub fn planes<L: Lanes, const N: usize>(&self, l: L, at: [&Axis; 3]) -> [[Pair<L>; N]; 4] {
        // A constant in each instance: the branch costs nothing.
        if N == LOCAL_NODES {
            let local = self.local_planes(l, at);
            let mut planes = [[l.wide().splat_rows([0.0; 2]); N]; 4];
            for v in 0..4 {
                for n in 0..N {
                    planes[v][n] = local[v][n.min(LOCAL_NODES - 1)];
                }
            }
            return planes;
        }
        let [x, y, z] = at;
        let zero = l.splat(0.0);
        let mut weights_z = [zero; N];
        for k in 0..N {
            weights_z[k] = l.load(&z.weights[k]);
        }
        let wide = l.wide();
        let zeros = wide.splat_rows([0.0; 2]);
        let mut offsets = [0; N];
        for k in 0..N {
            offsets[k] = z.nodes[k].wrapping_sub(z.nodes[0]) % NODE_SPAN;
        }
        // Weights of two samples along y in one pair of rows.
        let mut weights_y = [[zeros; N]; 4];
        for v in 0..4 {
            for j in 0..N {
                weights_y[v][j] = wide.splat_rows([y.weights[j][2 * v], y.weights[j][2 * v + 1]]);
            }
        }
        let mut planes = [[zeros; N]; 4];
        // Contract along z, then along y; the layer of each node along x remains.
        for i in 0..N {
            let mut rows = [zeros; N];
            for j in 0..N {
                let first = x.nodes[i].wrapping_add(y.nodes[j]).wrapping_add(z.nodes[0]);
                let values = self.values.get(first..).and_then(|v| v.first_chunk());
                let Some::<&[f32; NODE_SPAN]>(values) = values else {
                    continue;
                };
                let mut row = zero;
                for k in 0..N {
                    row = l.fused(l.splat(values[offsets[k]]), weights_z[k], row);
                }
                rows[j] = wide.join_rows([row, row]);
            }
            for v in 0..4 {
                let mut sum = zeros;
                for j in 0..N {
                    sum = wide.fused(weights_y[v][j], rows[j], sum);
                }
                planes[v][i] = sum;
            }
        }
        planes
    }

    /// [`Self::planes`] for [`LOCAL_NODES`].
    #[inline(always)]
    fn local_planes<L: Lanes>(&self, l: L, at: [&Axis; 3]) -> [[Pair<L>; LOCAL_NODES]; 4] {
        let [x, y, z] = at;
        let zero = l.splat(0.0);
        let mut weights_z = [zero; LOCAL_NODES];
        for k in 0..LOCAL_NODES {
            weights_z[k] = l.load(&z.weights[k]);
        }
        let wide = l.wide();
        let zeros = wide.splat_rows([0.0; 2]);
        let mut planes = [[zeros; LOCAL_NODES]; 4];
        for i in 0..LOCAL_NODES {
            let mut rows = [zero; LOCAL_NODES];
            for j in 0..LOCAL_NODES {
                let row = x.nodes[i] + y.nodes[j] + z.nodes[0];
                let Some(values) = self.values[row..].first_chunk::<LOCAL_NODES>() else {
                    continue;
                };
                // Row j at eight z: sum_k w_k s_ijk.
                for k in 0..LOCAL_NODES {
                    rows[j] = l.fused(l.splat(values[k]), weights_z[k], rows[j]);
                }
            }
            for v in 0..4 {
                // sum_j w_j of the rows at two y. The nodes of the second sample begin at most one further.
                let from = y.first_node[2 * v];
                for n in 0..5 {
                    let j = (from + n).min(LOCAL_NODES - 1);
                    let weights = wide.splat_rows([y.weights[j][2 * v], y.weights[j][2 * v + 1]]);
                    planes[v][i] =
                        wide.fused(weights, wide.join_rows([rows[j], rows[j]]), planes[v][i]);
                }
            }
        }
        planes
    }

    /// The first node for sample `v` along an axis, and the nodes' weights; none with [`PER_SAMPLE`].
    #[inline(always)]
    pub fn weights<L: Lanes, const N: usize>(
        l: L,
        axis: &Axis,
        v: usize,
    ) -> (usize, [Pair<L>; MAX_POLYNOMIAL_NODES]) {
        let from = if N == LOCAL_NODES {
            axis.first_node[v & 7] & 7
        } else {
            0
        };
        let mut weights = [l.wide().splat_rows([0.0; 2]); MAX_POLYNOMIAL_NODES];
        for n in 0..contributing_nodes(N) {
            weights[n] = l.wide().splat_rows([axis.weights[from + n][v & 7]; 2]);
        }
        (from, weights)
    }
}

/// Number of nodes between which a sample interpolates.
pub(super) const fn contributing_nodes(nodes: usize) -> usize {
    match nodes {
        PER_SAMPLE => 0,
        LOCAL_NODES => 4,
        few => few,
    }
}

/// Fills a table; `LIMIT_SMOOTHLY` as in [`scale`].
struct TableKernel<'a, const LIMIT_SMOOTHLY: bool> {
    field: &'a PeriodicField,
    counts: [usize; 3],
    values: &'a mut [f32],
}

impl<const LIMIT_SMOOTHLY: bool> SimdKernel for TableKernel<'_, LIMIT_SMOOTHLY> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            field,
            counts,
            values,
        } = self;
        // The functions at eight entries each: entry n lies at (n + 1/2) / count, less the nearest whole number.
        let mut tables = [const { Vec::new() }; 3];
        for axis in 0..3 {
            for first in (0..counts[axis]).step_by(8) {
                let mut parts = [0.0; 8];
                for n in 0..8 {
                    let part = ((first + n) as f64 + 0.5) / counts[axis] as f64;
                    parts[n] = (part - part.round()) as f32;
                }
                tables[axis].push(to_arrays(l, &field.products.along(l, &parts)));
            }
        }
        let [xs, ys, zs] = &tables;
        let rows = values.chunks_exact_mut(counts[2]);
        for (row, values) in rows.enumerate() {
            let (i, j) = (row / counts[1], row % counts[1]);
            let at_x = splat_at(l, &xs[i / 8], i % 8);
            let at_y = splat_at(l, &ys[j / 8], j % 8);
            for (values, z) in values.as_chunks_mut().0.iter_mut().zip(zs) {
                let mut along_z = [l.splat(1.0); FUNCTIONS];
                for n in 1..FUNCTIONS {
                    along_z[n] = l.load(&z[n]);
                }
                let found = scale::<L, LIMIT_SMOOTHLY>(l, field, [&at_x, &at_y, &along_z]); // s_ijk
                l.store(found, values);
            }
        }
    }
}
