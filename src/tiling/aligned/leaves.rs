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
use crate::lanes::{Lanes, Twice, Work};

/// Leaves along z whose samples' functions are kept.
const KEPT: usize = 16;
/// A little more than a voxel's diagonal, voxels: by so much distances to the box of neighbours differ.
const DIAGONAL: f32 = 1.7321;

/// Leaves to be filled.
pub(super) struct LeavesWork<'a, 'b> {
    pub function: &'a Function,
    pub scales: &'a Scales,
    /// Whether the solid ends at the box.
    pub is_cut: bool,
    pub leaves: &'a mut Leaves<'b, WorldPoint>,
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
        } = self;
        let (step, by, background) = (leaves.step, leaves.by, leaves.background);
        let mut across = [Axis::NONE; 2];
        let mut along = [Axis::NONE; KEPT];
        let mut column = Column::default();
        let places = leaves.values.iter_mut().zip(leaves.bits.iter_mut());
        for (origin, (values, bits)) in leaves.origins.iter().zip(places) {
            let mut is_new = false;
            for axis in 0..2 {
                if across[axis].origin != origin.0[axis] {
                    across[axis] = scales.axis(l, function, axis, origin.0[axis], step);
                    is_new = true;
                }
            }
            let [x, y] = &across;
            if is_new {
                let products = &function.products;
                products.column(l, &x.along, &y.along, &mut column);
            }
            let place = (origin.0.z / (8.0 * step) + 0.5) as i64 as usize;
            let z = &mut along[place % KEPT];
            if z.origin != origin.0.z {
                *z = scales.axis(l, function, 2, origin.0.z, step);
            }
            let Some(rows) = values.as_chunks_mut().0.first_chunk_mut() else {
                continue;
            };
            function.products.values(l, &column, &z.along, rows);
            let sweep = Sweep {
                function,
                scales,
                by,
                background,
                at: [x, y, z],
            };
            let outermost = x.outermost().max(y.outermost()).max(z.outermost());
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
        let one = same(1.0);
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
        // The greatest distances where the field is such that a neighbour may have the other sign.
        let mut doubt = zero;
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
                let off = two.magnitude(two.fused(f, one, less));
                doubt = two.max(doubt, two.select_below(off, reach, size, zero));
                if CUT {
                    let (ox, oy) = (x.beyond[i & 7], [y.beyond[j], y.beyond[j + 1]]);
                    let ends = [
                        l.sub(to_box(l, ox, oy[0], outside_z), l.splat(by)),
                        l.sub(to_box(l, ox, oy[1], outside_z), l.splat(by)),
                    ];
                    d = two.max(d, two.pair(ends));
                    size = two.magnitude(d);
                }
                d = two.min(two.max(d, minus), limit);
                two.store(d, rows);
                negative |= u64::from(two.below(d, zero)) << (8 * j);
                within |= u64::from(two.below(size, limit)) << (8 * j);
            }
            bits.negative[i & 7] = negative;
            bits.within[i & 7] = within;
        }
        bits.settled = two.below(doubt, limit) == u16::MAX;
        bits
    }
}

/// Distances to the box of a row along z, from how far outside of it the coordinates lie.
#[inline(always)]
fn to_box<L: Lanes>(l: L, x: f32, y: f32, z: L::F) -> L::F {
    let zero = l.splat(0.0);
    let (ox, oy, oz) = (x.max(0.0), y.max(0.0), l.max(z, zero));
    let across = l.max(l.splat(x.max(y)), z);
    let outside = l.add(l.splat(ox * ox + oy * oy), l.mul(oz, oz));
    l.add(l.sqrt(outside), l.min(across, zero))
}
