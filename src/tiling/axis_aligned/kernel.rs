//! Distances of a short series by rule Q, on lanes: its scale by two Newton steps, rows of samples, signs
//! and bounds.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::periods::{BEHIND, EACH, Periods};
use crate::cell::{Along, FUNCTIONS, Products};
use crate::frame::Vec3;
use crate::simd::{Lanes, Work};

/// The one function in the box.
#[derive(Clone, Debug)]
pub(super) struct Function {
    pub products: Products,
    pub periods: Periods,
    pub rule: Rule,
}

/// Lengths of the distance rule, world units, in single precision.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    /// The square that keeps Newton steps finite.
    pub damping: f32,
    /// Longest step.
    pub longest: f32,
    /// Half width of the band.
    pub half_width: f32,
    /// Bounds of the scale.
    pub least: f32,
    pub greatest: f32,
    /// Where |F| is at least this, neighbouring samples have one sign.
    pub reach: f32,
    /// Below this a value is next to the zero set.
    pub tiny: f32,
    /// Radians per world unit along each axis.
    pub turn: [f32; 3],
}

impl Rule {
    /// Whether all lengths can be held in single precision.
    pub fn is_finite(&self) -> bool {
        let Self {
            damping,
            longest,
            half_width,
            least,
            greatest,
            reach,
            tiny,
            turn: [x, y, z],
        } = *self;
        [
            damping, longest, half_width, least, greatest, reach, tiny, x, y, z,
        ]
        .iter()
        .all(|v| v.is_finite())
    }
}

/// What smoothly shortened steps tend to, as a share of the longest ones.
const SHORTENED: f32 = 0.75;

/// Functions as arrays.
#[inline(always)]
pub(super) fn stored<L: Lanes>(l: L, along: &Along<L::F>) -> [[f32; 8]; FUNCTIONS] {
    let mut all = [[0.0; 8]; FUNCTIONS];
    for (to, &from) in all.iter_mut().zip(along) {
        l.store(from, to);
    }
    all
}

/// The functions at one of eight places.
#[inline(always)]
pub(super) fn splatted<L: Lanes>(l: L, from: &[[f32; 8]; FUNCTIONS], place: usize) -> Along<L::F> {
    let mut all = [l.splat(1.0); FUNCTIONS];
    for n in 1..FUNCTIONS {
        all[n] = l.splat(from[n][place & 7]);
    }
    all
}

/// Rule Q's scale, distance / |F|, by two damped Newton steps. `SMOOTH`: steps beyond the half width are
/// not cut off at the longest but shortened little by little, so that the scale has no kinks; within the
/// band that is hardly seen, and between places of a table it is much better to interpolate.
#[inline(always)]
pub(super) fn scale<L: Lanes, const SMOOTH: bool>(
    l: L,
    function: &Function,
    at: [&Along<L::F>; 3],
) -> L::F {
    let Function { products, rule, .. } = function;
    let (f, g, m, q) = newton::<L, SMOOTH>(l, products, rule, at);
    let back = l.sub(l.splat(0.0), q);
    let mut ahead = [*at[0], *at[1], *at[2]];
    for a in 0..3 {
        let by = l.mul(l.mul(back, g[a]), l.splat(rule.turn[a]));
        ahead[a] = products.further(l, at[a], by);
    }
    let (_, h, _, r) = newton::<L, SMOOTH>(l, products, rule, [&ahead[0], &ahead[1], &ahead[2]]);
    let mut square = l.splat(0.0);
    for a in 0..3 {
        let way = l.fused(q, g[a], l.mul(r, h[a]));
        square = l.fused(way, way, square);
    }
    let of = l.max(l.mul(f, f), l.splat(f32::MIN_POSITIVE));
    let scale = l.sqrt(l.div(square, of));
    let on_it = l.div(l.sqrt(m), l.add(m, l.splat(rule.damping)));
    let scale = l.select_below(l.magnitude(f), l.splat(rule.tiny), on_it, scale);
    l.min(l.max(scale, l.splat(rule.least)), l.splat(rule.greatest))
}

/// Value, gradient and its square at a place, and the Newton step's share of the gradient, shortened to
/// the longest step.
#[inline(always)]
fn newton<L: Lanes, const SMOOTH: bool>(
    l: L,
    products: &Products,
    rule: &Rule,
    at: [&Along<L::F>; 3],
) -> (L::F, [L::F; 3], L::F, L::F) {
    let (f, mut g) = products.slope(l, at);
    let mut m = l.splat(0.0);
    for a in 0..3 {
        g[a] = l.mul(g[a], l.splat(rule.turn[a]));
        m = l.fused(g[a], g[a], m);
    }
    let mut q = l.div(f, l.add(m, l.splat(rule.damping)));
    let square = l.mul(l.mul(q, q), m);
    if SMOOTH {
        let limit = SHORTENED * rule.longest;
        let part = l.mul(square, l.splat((limit * limit).recip()));
        let one = l.splat(1.0);
        let by = l.sqrt(l.sqrt(l.fused(part, part, one)));
        return (f, g, m, l.div(q, by));
    }
    let longest = l.splat(rule.longest * rule.longest);
    if l.below(longest, square) != 0 {
        q = l.mul(q, l.sqrt(l.div(longest, l.max(square, longest))));
    }
    (f, g, m, q)
}

/// Distances at eight samples along z, a step apart.
pub(super) struct RowWork<'a> {
    pub function: &'a Function,
    /// The first sample.
    pub origin: Vec3,
    pub step: f64,
    pub out: &'a mut [f32; 8],
}

impl Work for RowWork<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            function,
            origin,
            step,
            out,
        } = self;
        let (products, periods) = (&function.products, &function.periods);
        let mut at = [[l.splat(0.0); FUNCTIONS]; 3];
        for (axis, steps) in [&[0.0; 8], &[0.0; 8], &EACH].into_iter().enumerate() {
            let parts = periods.parts(l, axis, origin[axis], step, steps);
            at[axis] = products.along(l, &parts);
        }
        let at = [&at[0], &at[1], &at[2]];
        let f = products.slope(l, at).0;
        let d = l.mul(f, scale::<L, false>(l, function, at));
        let w = l.splat(function.rule.half_width);
        let minus = l.splat(-function.rule.half_width);
        l.store(l.min(l.max(d, minus), w), out);
    }
}

/// Bounds of the sum in eight boxes, to single precision.
pub(super) struct RangeWork<'a> {
    pub function: &'a Function,
    /// Least and greatest coordinates of the boxes, by axis.
    pub min: [[f64; 8]; 3],
    pub max: [[f64; 8]; 3],
}

impl Work for RangeWork<'_> {
    type Output = [[f32; 8]; 2];
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [[f32; 8]; 2] {
        let Function {
            products,
            periods,
            rule,
        } = self.function;
        let room = &periods.room;
        let (mut parts, mut halves) = ([[0.0; 8]; 3], [[0.0; 8]; 3]);
        for axis in 0..3 {
            let (least, greatest) = (l.all_four(room.min[axis]), l.all_four(room.max[axis]));
            for half in [0, 4] {
                let [mut a, mut b] = [[0.0; 4]; 2];
                a.copy_from_slice(&self.min[axis][half..half + 4]);
                b.copy_from_slice(&self.max[axis][half..half + 4]);
                let a = l.min_four(l.max_four(l.four(a), least), greatest);
                let b = l.min_four(l.max_four(l.four(b), least), greatest);
                let centre = l.mul_four(l.add_four(a, b), l.all_four(0.5));
                let part = periods.part(l, axis, centre);
                parts[axis][half..half + 4].copy_from_slice(&part);
                let width = l.mul_four(l.sub_four(b, a), l.all_four(0.5));
                halves[axis][half..half + 4].copy_from_slice(&l.singles(width));
            }
        }
        let x = products.along(l, &parts[0]);
        let y = products.along(l, &parts[1]);
        let z = products.along(l, &parts[2]);
        let mut half = [l.splat(0.0); 3];
        for axis in 0..3 {
            half[axis] = l.mul(l.load(&halves[axis]), l.splat(rule.turn[axis]));
        }
        let (lo, hi) = products.raw_ranges(l, [&x, &y, &z], half);
        let mut both = [[0.0; 8]; 2];
        l.store(lo, &mut both[0]);
        l.store(hi, &mut both[1]);
        both
    }
}

/// Most samples along an axis of a lattice whose signs are asked for.
pub(super) const WIDEST: usize = 16;

/// Where the samples of a lattice lie inside, the box not regarded: as [`Field::signs`].
///
/// [`Field::signs`]: crate::field::Field::signs
pub(super) struct SignWork<'a> {
    pub function: &'a Function,
    /// The first sample.
    pub origin: Vec3,
    pub step: f64,
    /// At most [`WIDEST`].
    pub counts: [usize; 3],
    pub rows: &'a mut [u64],
}

impl Work for SignWork<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            function,
            origin,
            step,
            counts,
            rows,
        } = self;
        let (products, periods) = (&function.products, &function.periods);
        let mut tables = [[[[0.0; 8]; FUNCTIONS]; 2]; 3];
        for axis in 0..3 {
            for (half, steps) in [&EACH, &BEHIND].into_iter().enumerate() {
                if 8 * half < counts[axis] {
                    let parts = periods.parts(l, axis, origin[axis], step, steps);
                    tables[axis][half] = stored(l, &products.along(l, &parts));
                }
            }
        }
        let zero = l.splat(0.0);
        // Eight at a time along the longer of the last two axes.
        if counts[2] >= counts[1] {
            for (n, row) in rows.iter_mut().enumerate() {
                let at = [n / counts[1], n % counts[1], 0];
                let low = products.line(l, 2, &tables, at, 0);
                *row = u64::from(l.below(low, zero));
                if counts[2] > 8 {
                    let high = products.line(l, 2, &tables, at, 1);
                    *row |= u64::from(l.below(high, zero)) << 8;
                }
                *row &= (1 << counts[2]) - 1;
            }
            return;
        }
        rows.fill(0);
        for (i, rows) in rows.chunks_mut(counts[1]).enumerate() {
            for k in 0..counts[2] {
                for (half, rows) in rows.chunks_mut(8).enumerate() {
                    let values = products.line(l, 1, &tables, [i, 0, k], half);
                    let bits = u64::from(l.below(values, zero));
                    for (j, row) in rows.iter_mut().enumerate() {
                        *row |= (bits >> j & 1) << k;
                    }
                }
            }
        }
    }
}
