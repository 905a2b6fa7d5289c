//! Distances on leaves of 8^3 samples, many of them at a time.
//!
//! What the samples have along an axis is found once for all leaves there, what the products come to
//! along x and y once for a column of leaves; a leaf takes one sweep over its 64 rows, in which values
//! become distances and say where they are negative and where within the band.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::kernel::{Function, scale, splatted};
use super::scales::{Axis, EVERY, LOCAL, MOST, Scales, sharing};
use crate::cell::Column;
use crate::field::{LeafBits, Leaves};
use crate::frame::WorldPoint;
use crate::simd::{self, Code, Lanes, Twice, Work};
use std::cell::Cell;

/// Leaves along each axis whose samples' functions are kept: those of a block.
const KEPT: usize = 16;
/// A little more than a voxel's diagonal, voxels: by so much distances to the box of neighbours differ.
const DIAGONAL: f32 = 1.7321;

/// What is kept of leaves along the axes from one group of leaves to the next.
struct Axes {
    /// What they hold for: the scales, the distance of samples, the processor's code.
    held: (u64, f64, Code),
    /// By the leaf's place along each of the three.
    along: Vec<[Axis; 3]>,
}

impl Axes {
    /// Nothing.
    fn new(held: (u64, f64, Code)) -> Self {
        Self {
            held,
            along: vec![[Axis::NONE; 3]; KEPT],
        }
    }
}

thread_local! {
    static AXES: Cell<Option<Axes>> = Cell::default();
}

/// Fills leaves; `is_cut`: the solid ends at the box.
pub(super) fn fill(
    function: &Function,
    scales: &Scales,
    is_cut: bool,
    leaves: &mut Leaves<'_, WorldPoint>,
) {
    let held = (scales.number(), leaves.step, simd::code());
    let kept = AXES.take().filter(|axes| axes.held == held);
    let mut axes = kept.unwrap_or_else(|| Axes::new(held));
    simd::run(LeavesWork {
        function,
        scales,
        is_cut,
        leaves,
        axes: &mut axes,
    });
    AXES.set(Some(axes));
}

/// Leaves to be filled.
struct LeavesWork<'a, 'b> {
    function: &'a Function,
    scales: &'a Scales,
    is_cut: bool,
    leaves: &'a mut Leaves<'b, WorldPoint>,
    axes: &'a mut Axes,
}

impl Work for LeavesWork<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            function,
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
            let mut places = [0; 3];
            for axis in 0..3 {
                let x = origin.0[axis];
                let place = (x / (8.0 * step) + 0.5).floor() as i64 as usize;
                places[axis] = place % KEPT;
                let along = &mut axes.along[place % KEPT][axis];
                if along.origin != x {
                    *along = scales.axis(l, function, axis, x, step);
                }
            }
            let [x, y, z] = [0, 1, 2].map(|axis| &axes.along[places[axis]][axis]);
            if column_at != [x.origin, y.origin] {
                let products = &function.products;
                products.column(l, &x.along, &y.along, &mut column);
                column_at = [x.origin, y.origin];
            }
            let values = leaves.values.get_mut(kept);
            let Some(rows) = values.and_then(|v| v.as_chunks_mut().0.first_chunk_mut()) else {
                break;
            };
            function.products.values(l, &column, &z.along, rows);
            let beyond = [x.outermost(), y.outermost(), z.outermost()];
            let outermost = beyond[0].max(beyond[1]).max(beyond[2]);
            let sweep = Sweep {
                function,
                scales,
                by,
                background,
                at: [x, y, z],
                at_edge: beyond.into_iter().filter(|&b| b > 0.0).count() > 1,
            };
            let ends = is_cut && outermost > by - background;
            *bits = match (scales.nodes(), ends) {
                (4, false) => sweep.run::<L, 4, false>(l, rows),
                (4, true) => sweep.run::<L, 4, true>(l, rows),
                (5, false) => sweep.run::<L, 5, false>(l, rows),
                (5, true) => sweep.run::<L, 5, true>(l, rows),
                (MOST, false) => sweep.run::<L, MOST, false>(l, rows),
                (MOST, true) => sweep.run::<L, MOST, true>(l, rows),
                (LOCAL, false) => sweep.run::<L, LOCAL, false>(l, rows),
                (LOCAL, true) => sweep.run::<L, LOCAL, true>(l, rows),
                (_, false) => sweep.run::<L, EVERY, false>(l, rows),
                (_, true) => sweep.run::<L, EVERY, true>(l, rows),
            };
            // What the sweep proves does not regard the box, whose sides a narrow band may hide.
            let reach = DIAGONAL * step as f32;
            if is_cut && background <= reach && outermost > by - background - reach {
                bits.settled = false;
            }
            kept += usize::from(!bits.is_out());
        }
    }
}

/// From the field's values on a leaf to distances.
struct Sweep<'a> {
    function: &'a Function,
    scales: &'a Scales,
    /// How far outwards the surface is moved.
    by: f32,
    background: f32,
    at: [&'a Axis; 3],
    /// Whether samples may lie outside of two faces of the box.
    at_edge: bool,
}

impl Sweep<'_> {
    /// With scales from N nodes along each axis, and cut off at the box or not.
    #[inline(always)]
    fn run<L: Lanes, const N: usize, const CUT: bool>(
        &self,
        l: L,
        rows: &mut [[f32; 8]; 64],
    ) -> LeafBits {
        let Self {
            function,
            scales,
            by,
            background,
            at,
            at_edge,
        } = *self;
        let [x, y, z] = at;
        let rule = &function.rule;
        let two = l.two();
        let same = |v: f32| two.each([v; 2]);
        let (zero, least) = (same(0.0), same(rule.least));
        let (limit, minus) = (same(background), same(-background));
        let back = same(-by);
        // Where the field is further from this than that, neighbours lie on the same side of the moved
        // surface: at it the field lies between 0 and `by` times its greatest slope.
        let middle = 0.5 * by / rule.least;
        let (less, reach) = (same(-middle), same(rule.reach + middle.abs()));
        let beyond = same((background + by.abs()) / rule.least);
        let mut planes = [[zero; N]; 4];
        let mut along_z = [l.splat(0.0); crate::cell::FUNCTIONS];
        if N == EVERY {
            for (to, from) in along_z.iter_mut().zip(&z.along) {
                *to = l.load(from);
            }
        } else {
            planes = scales.planes::<L, N>(l, at);
        }
        let outside_z = l.load(&z.beyond);
        let mut bits = LeafBits {
            // Clamped as they are, all values are numbers.
            finite: true,
            ..LeafBits::default()
        };
        // Above 0 as long as no sample is such that a neighbour may have the other sign, without being
        // within the band.
        let mut doubt = limit;
        for (i, slab) in rows.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            let (from, shares) = Scales::shares::<L, N>(l, x, i);
            let (mut negative, mut within) = (0, 0);
            for (pair, rows) in slab.as_chunks_mut().0.iter_mut().enumerate() {
                let j = (2 * pair) & 7;
                let f = two.load(rows);
                let mut s = zero;
                if N == EVERY {
                    if two.below(two.magnitude(f), beyond) != 0 {
                        let at_x = splatted(l, &x.along, i);
                        let at_y = [splatted(l, &y.along, j), splatted(l, &y.along, j + 1)];
                        s = two.pair([
                            scale::<L, false>(l, function, [&at_x, &at_y[0], &along_z]),
                            scale::<L, false>(l, function, [&at_x, &at_y[1], &along_z]),
                        ]);
                    }
                } else {
                    for n in 0..sharing(N) {
                        let plane = planes[pair & 3][(from + n).min(N - 1)];
                        s = two.fused(shares[n], plane, s);
                    }
                }
                s = two.max(s, least);
                let mut d = two.fused(f, s, back);
                let mut size = two.magnitude(d);
                let off = two.magnitude(two.add(f, less));
                let free = two.max(two.sub(off, reach), two.sub(limit, size));
                doubt = two.min(free, doubt);
                if CUT {
                    let (ox, oy) = (l.splat(x.beyond[i & 7]), [y.beyond[j], y.beyond[j + 1]]);
                    let outside = oy.map(|oy| [ox, l.splat(oy), outside_z]);
                    let ends = if at_edge {
                        [to_box(l, outside[0]), to_box(l, outside[1])]
                    } else {
                        [outermost(l, outside[0]), outermost(l, outside[1])]
                    };
                    d = two.max(d, two.add(two.pair(ends), back));
                    size = two.magnitude(d);
                }
                d = two.min(two.max(d, minus), limit);
                two.store(d, rows);
                // Signs of differences, since a mask of signs is one instruction, and one of comparisons
                // is not. A zero added makes 0 of -0.
                negative |= u64::from(two.signs(two.add(d, zero))) << (8 * j);
                within |= u64::from(two.signs(two.sub(size, limit))) << (8 * j);
            }
            bits.negative[i & 7] = negative;
            bits.within[i & 7] = within;
        }
        bits.settled = two.below(zero, doubt) == u16::MAX;
        bits
    }
}

/// Distances to the box from how far outside of it the coordinates lie, also beyond its edges.
#[inline(always)]
fn to_box<L: Lanes>(l: L, beyond: [L::F; 3]) -> L::F {
    let zero = l.splat(0.0);
    let mut square = zero;
    for coordinate in beyond {
        let outside = l.max(coordinate, zero);
        square = l.fused(outside, outside, square);
    }
    l.add(l.sqrt(square), l.min(outermost(l, beyond), zero))
}

/// The same where no two of the coordinates lie outside.
#[inline(always)]
fn outermost<L: Lanes>(l: L, [x, y, z]: [L::F; 3]) -> L::F {
    l.max(l.max(x, y), z)
}
