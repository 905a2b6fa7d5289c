//! Distances on leaves of 8^3 samples, many leaves at a time.
//!
//! The functions along an axis are computed once for all leaves at a coordinate, and their products along x and y once
//! for a column of leaves. One sweep over the 64 rows of a leaf turns values into distances and sets the bits of
//! negative samples and of those within the band.
//!
//! d = F s, moved by `by` and cut at the box. Rows hold eight samples along z, and the sweep takes two rows at once, y
//! and y + 1. Scales s come from a table or are computed for each sample (module `scales`). The law
//! `distances_are_those_of_the_general_way` allows 0.005 voxel root mean square, 0.1 at most.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::kernel::{PeriodicField, scale, splat_at};
use super::scales::{
    Axis, LOCAL_NODES, MAX_POLYNOMIAL_NODES, PER_SAMPLE, Scales, contributing_nodes,
};
use druse_cells::cell::Column;
use druse_geometry::field::{LeafBits, Leaves};
use druse_geometry::frame::WorldPoint;
use druse_geometry::simd::{self, InstructionSet, Lanes, SimdKernel, WideLanes};
use std::cell::Cell;

/// Number of leaves along each axis whose functions are cached: those of a block.
const CACHED_LEAVES: usize = 16;
/// A voxel's diagonal, voxels, rounded up: bound of the difference of neighbours' distances to the box.
const VOXEL_DIAGONAL: f32 = 1.7321;

/// Functions along the axes, cached between groups of leaves.
struct AxisCache {
    /// The cache is valid for these scales, this step and these instructions.
    key: (u64, f64, InstructionSet),
    /// Functions along x, y and z, by position of the leaf modulo [`CACHED_LEAVES`].
    along: Vec<[Axis; 3]>,
}

thread_local! {
    static AXIS_CACHE: Cell<Option<AxisCache>> = Cell::default();
}

/// Fills leaves; `is_cut`: the solid ends at the box.
pub(super) fn fill(
    field: &PeriodicField,
    scales: &Scales,
    is_cut: bool,
    leaves: &mut Leaves<'_, WorldPoint>,
) {
    let key = (scales.id(), leaves.step, simd::instruction_set());
    let cached = AXIS_CACHE.take().filter(|axes| axes.key == key);
    let mut axes = cached.unwrap_or_else(|| AxisCache {
        key,
        along: vec![[Axis::EMPTY_AXIS; 3]; CACHED_LEAVES],
    });
    simd::run(LeavesKernel {
        field,
        scales,
        is_cut,
        leaves,
        axes: &mut axes,
    });
    AXIS_CACHE.set(Some(axes));
}

/// Fills leaves.
struct LeavesKernel<'a, 'b> {
    field: &'a PeriodicField,
    scales: &'a Scales,
    is_cut: bool,
    leaves: &'a mut Leaves<'b, WorldPoint>,
    axes: &'a mut AxisCache,
}

impl SimdKernel for LeavesKernel<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            field,
            scales,
            is_cut,
            leaves,
            axes,
        } = self;
        let (step, by, background) = (leaves.step, leaves.by, leaves.background);
        let mut column = Column::default();
        let mut column_at = [f64::NAN; 2];
        let mut kept = 0;
        for (origin, bits) in leaves.origins.iter().zip(leaves.bits.iter_mut()) {
            let mut slots = [0; 3];
            for axis in 0..3 {
                let x = origin.0[axis];
                let position = (x / (8.0 * step) + 0.5).floor() as i64 as usize;
                slots[axis] = position % CACHED_LEAVES;
                let along = &mut axes.along[position % CACHED_LEAVES][axis];
                if along.origin != x {
                    *along = scales.axis(l, field, axis, x, step);
                }
            }
            let [x, y, z] = [0, 1, 2].map(|axis| &axes.along[slots[axis]][axis]);
            // The product of x and y serves all leaves of a column.
            if column_at != [x.origin, y.origin] {
                let products = &field.products;
                products.column(l, &x.along, &y.along, &mut column);
                column_at = [x.origin, y.origin];
            }
            let values = leaves.values.get_mut(kept);
            let Some(rows) = values.and_then(|v| v.as_chunks_mut().0.first_chunk_mut()) else {
                break;
            };
            // F at all samples, then distances in place.
            field.products.values(l, &column, &z.along, rows);
            let outside = [x.outermost(), y.outermost(), z.outermost()];
            let outermost = outside[0].max(outside[1]).max(outside[2]);
            let sweep = Sweep {
                field,
                scales,
                by,
                background,
                at: [x, y, z],
                is_near_edge: outside.into_iter().filter(|&b| b > 0.0).count() > 1,
            };
            // Far inside the box the cut is left out.
            let reaches_box = is_cut && outermost > by - background;
            *bits = match (scales.nodes(), reaches_box) {
                (4, false) => sweep.run::<L, 4, false>(l, rows),
                (4, true) => sweep.run::<L, 4, true>(l, rows),
                (5, false) => sweep.run::<L, 5, false>(l, rows),
                (5, true) => sweep.run::<L, 5, true>(l, rows),
                (MAX_POLYNOMIAL_NODES, false) => {
                    sweep.run::<L, MAX_POLYNOMIAL_NODES, false>(l, rows)
                }
                (MAX_POLYNOMIAL_NODES, true) => sweep.run::<L, MAX_POLYNOMIAL_NODES, true>(l, rows),
                (LOCAL_NODES, false) => sweep.run::<L, LOCAL_NODES, false>(l, rows),
                (LOCAL_NODES, true) => sweep.run::<L, LOCAL_NODES, true>(l, rows),
                (_, false) => sweep.run::<L, PER_SAMPLE, false>(l, rows),
                (_, true) => sweep.run::<L, PER_SAMPLE, true>(l, rows),
            };
            // The sweep's proof of signs ignores the box, whose faces may lie beyond a narrow band.
            let reach = VOXEL_DIAGONAL * step as f32;
            if is_cut && background <= reach && outermost > by - background - reach {
                bits.settled = false;
            }
            // A leaf out of the band is overwritten by the next.
            kept += usize::from(!bits.is_out());
        }
    }
}

/// Turns the field's values on a leaf into distances.
struct Sweep<'a> {
    field: &'a PeriodicField,
    scales: &'a Scales,
    /// Distance by which the surface is moved outwards.
    by: f32,
    background: f32,
    at: [&'a Axis; 3],
    /// Whether samples may lie outside two faces of the box.
    is_near_edge: bool,
}

impl Sweep<'_> {
    /// Scales come from N nodes along each axis; `CUT`: distances are cut at the box.
    #[inline(always)]
    fn run<L: Lanes, const N: usize, const CUT: bool>(
        &self,
        l: L,
        rows: &mut [[f32; 8]; 64],
    ) -> LeafBits {
        let Self {
            field,
            scales,
            by,
            background,
            at,
            is_near_edge,
        } = *self;
        let [x, y, z] = at;
        let rule = &field.rule;
        let wide = l.wide();
        let same = |v: f32| wide.splat_rows([v; 2]);
        let (zero, least) = (same(0.0), same(rule.min_scale));
        let (limit, minus) = (same(background), same(-background));
        let back = same(-by);
        // Where the field differs from the middle by more than the reach, neighbours are on the same side of the
        // moved surface: there the field is between 0 and `by` times its greatest slope.
        let middle = 0.5 * by / rule.min_scale;
        let (less, reach) = (same(-middle), same(rule.sign_reach + middle.abs()));
        // |F| beyond which d is out of the band, since s is at least the least scale.
        let beyond = same((background + by.abs()) / rule.min_scale);
        let mut planes = [[zero; N]; 4];
        let mut along_z = [l.splat(0.0); druse_cells::cell::FUNCTIONS];
        // Without a table: the functions along z. With one: scales interpolated along y and z, x remains.
        if N == PER_SAMPLE {
            for (to, from) in along_z.iter_mut().zip(&z.along) {
                *to = l.load(from);
            }
        } else {
            planes = scales.planes::<L, N>(l, at);
        }
        let outside_z = l.load(&z.outside);
        let mut bits = LeafBits {
            // Clamped values are finite.
            finite: true,
            ..LeafBits::default()
        };
        // Positive as long as every sample is within the band or has neighbours of its own sign.
        let mut margin = limit;
        // A slab of samples with the same x, in pairs of rows.
        for (i, slab) in rows.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            let (from, weights) = Scales::weights::<L, N>(l, x, i);
            let (mut negative, mut within) = (0, 0);
            for (pair, rows) in slab.as_chunks_mut().0.iter_mut().enumerate() {
                let j = (2 * pair) & 7;
                let f = wide.load(rows);
                let mut s = zero;
                if N == PER_SAMPLE {
                    // Scales are costly: only pairs of rows with a sample in the band compute them.
                    if wide.below(wide.magnitude(f), beyond) != 0 {
                        let at_x = splat_at(l, &x.along, i);
                        let at_y = [splat_at(l, &y.along, j), splat_at(l, &y.along, j + 1)];
                        s = wide.join_rows([
                            scale::<L, false>(l, field, [&at_x, &at_y[0], &along_z]),
                            scale::<L, false>(l, field, [&at_x, &at_y[1], &along_z]),
                        ]);
                    }
                } else {
                    // s = the sum over the nodes along x.
                    for n in 0..contributing_nodes(N) {
                        let plane = planes[pair & 3][(from + n).min(N - 1)];
                        s = wide.fused(weights[n], plane, s);
                    }
                }
                s = wide.max(s, least);
                // d = F s - by.
                let mut d = wide.fused(f, s, back);
                let mut size = wide.magnitude(d);
                let off = wide.magnitude(wide.add(f, less));
                // Positive where the neighbours have the same sign, or the sample is within the band.
                let free = wide.max(wide.sub(off, reach), wide.sub(limit, size));
                margin = wide.min(free, margin);
                // d = max(d, D - by).
                if CUT {
                    let (ox, oy) = (l.splat(x.outside[i & 7]), [y.outside[j], y.outside[j + 1]]);
                    let outside = oy.map(|oy| [ox, l.splat(oy), outside_z]);
                    let ends = if is_near_edge {
                        [box_distance(l, outside[0]), box_distance(l, outside[1])]
                    } else {
                        [outermost(l, outside[0]), outermost(l, outside[1])]
                    };
                    d = wide.max(d, wide.add(wide.join_rows(ends), back));
                    size = wide.magnitude(d);
                }
                d = wide.min(wide.max(d, minus), limit);
                wide.store(d, rows);
                // Use sign bits of differences: their mask takes one instruction, that of a comparison takes more. Adding
                // zero turns -0 into 0.
                negative |= u64::from(wide.sign_bits(wide.add(d, zero))) << (8 * j);
                within |= u64::from(wide.sign_bits(wide.sub(size, limit))) << (8 * j);
            }
            bits.negative[i & 7] = negative;
            bits.within[i & 7] = within;
        }
        bits.settled = wide.below(zero, margin) == u16::MAX;
        bits
    }
}

/// Distances to the box from the distances of the coordinates outside it, also near its edges.
#[inline(always)]
fn box_distance<L: Lanes>(l: L, beyond: [L::F; 3]) -> L::F {
    let zero = l.splat(0.0);
    let mut square = zero;
    for coordinate in beyond {
        let outside = l.max(coordinate, zero);
        square = l.fused(outside, outside, square);
    }
    l.add(l.sqrt(square), l.min(outermost(l, beyond), zero))
}

/// As [`box_distance`], where at most one coordinate lies outside.
#[inline(always)]
fn outermost<L: Lanes>(l: L, [x, y, z]: [L::F; 3]) -> L::F {
    l.max(l.max(x, y), z)
}
