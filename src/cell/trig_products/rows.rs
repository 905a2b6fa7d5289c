//! Products on lanes: their functions along the axes at eight places, and the sums of them.
//!
//! Nothing here has closures: they would be compiled for any processor.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::{FUNCTIONS, HARMONICS, MASK, Products, derivative, order};
use crate::cell::Solid;
use crate::simd::{Lanes, Pair, Twice};

/// The values of the functions along one axis, at eight places.
pub type Along<F> = [F; FUNCTIONS];

/// Most functions along z that products share.
const SUMS: usize = 2 * HARMONICS + 1;

/// What the products come to over a column of leaves: at eight places along x, of each function along z
/// its factor at eight places along y.
#[derive(Clone, Default)]
pub struct Column([[[f32; 8]; SUMS]; 8]);

impl Products {
    /// The functions along an axis at eight places, from the places' parts of a period, -1/2 to 1/2.
    #[inline(always)]
    pub fn along<L: Lanes>(&self, l: L, parts: &[f32; 8]) -> Along<L::F> {
        self.along_of(l, l.load(parts))
    }

    /// The same of parts that are on lanes.
    #[inline(always)]
    pub fn along_of<L: Lanes>(&self, l: L, r: L::F) -> Along<L::F> {
        // Sines of the angle folded to a quarter turn.
        let quarter = l.splat(0.25);
        let size = l.magnitude(r);
        let zero = l.splat(0.0);
        let folded_size = l.sub(l.splat(0.5), size);
        let folded = l.select_below(r, zero, l.sub(zero, folded_size), folded_size);
        let t = l.mul(
            l.select_below(quarter, size, folded, r),
            l.splat(std::f32::consts::TAU),
        );
        let (s, c) = sine_and_cosine(l, t);
        let c = l.select_below(quarter, size, l.sub(zero, c), c);
        self.harmonics_of(l, s, c)
    }

    /// All functions from the first sine and cosine.
    #[inline(always)]
    fn harmonics_of<L: Lanes>(&self, l: L, s: L::F, c: L::F) -> Along<L::F> {
        let mut all = [l.splat(1.0); FUNCTIONS];
        (all[1], all[2]) = (c, s);
        for h in 2..=self.harmonics {
            let (ch, sh) = (all[2 * h - 3], all[2 * h - 2]);
            all[2 * h - 1] = l.sub(l.mul(ch, c), l.mul(sh, s));
            all[2 * h] = l.fused(sh, c, l.mul(ch, s));
        }
        all
    }

    /// The functions at places that lie so many radians further, each less than 2.2.
    #[inline(always)]
    pub fn further<L: Lanes>(&self, l: L, from: &Along<L::F>, by: L::F) -> Along<L::F> {
        let (s, c) = sine_and_cosine(l, by);
        let (c0, s0) = (from[1], from[2]);
        self.harmonics_of(
            l,
            l.fused(s0, c, l.mul(c0, s)),
            l.sub(l.mul(c0, c), l.mul(s0, s)),
        )
    }

    /// The sum itself and its derivatives by the angles, from the functions along the axes.
    #[inline(always)]
    fn raw_slope<L: Lanes>(&self, l: L, [x, y, z]: [&Along<L::F>; 3]) -> (L::F, [L::F; 3]) {
        let zero = l.splat(0.0);
        let (mut value, mut gradient) = (zero, [zero; 3]);
        for p in &self.terms {
            let [i, j, k] = [
                p.functions[0] & MASK,
                p.functions[1] & MASK,
                p.functions[2] & MASK,
            ];
            let [di, dj, dk] = [p.turned[0] & MASK, p.turned[1] & MASK, p.turned[2] & MASK];
            let (yz, xz, xy) = (l.mul(y[j], z[k]), l.mul(x[i], z[k]), l.mul(x[i], y[j]));
            value = l.fused(l.mul(l.splat(p.factor), x[i]), yz, value);
            gradient[0] = l.fused(l.mul(l.splat(p.steep[0]), x[di]), yz, gradient[0]);
            gradient[1] = l.fused(l.mul(l.splat(p.steep[1]), y[dj]), xz, gradient[1]);
            gradient[2] = l.fused(l.mul(l.splat(p.steep[2]), z[dk]), xy, gradient[2]);
        }
        (value, gradient)
    }

    /// The value from the functions along the axes.
    #[inline(always)]
    pub fn value<L: Lanes>(&self, l: L, [x, y, z]: [&Along<L::F>; 3]) -> L::F {
        let mut sum = l.splat(0.0);
        for p in &self.terms {
            let [i, j, k] = p.functions;
            let yz = l.mul(y[j & MASK], z[k & MASK]);
            sum = l.fused(l.mul(l.splat(p.factor), x[i & MASK]), yz, sum);
        }
        self.solid_of(l, sum)
    }

    /// Value and derivatives by the angles from the functions along the axes.
    #[inline(always)]
    pub fn slope<L: Lanes>(&self, l: L, at: [&Along<L::F>; 3]) -> (L::F, [L::F; 3]) {
        let (value, mut gradient) = self.raw_slope(l, at);
        let outwards = match self.solid {
            Solid::Below | Solid::Above => return (value, gradient),
            Solid::Sheet => 1.0,
            Solid::Channels => -1.0,
        };
        let zero = l.splat(0.0);
        let sign = l.select_below(value, zero, l.splat(-outwards), l.splat(outwards));
        for g in &mut gradient {
            *g = l.mul(*g, sign);
        }
        (self.solid_of(l, value), gradient)
    }

    /// Bounds of the sum, not of the solid's field, in eight boxes, from the functions at their centres
    /// and half their edges in radians.
    #[inline(always)]
    pub fn raw_ranges<L: Lanes>(
        &self,
        l: L,
        at: [&Along<L::F>; 3],
        half: [L::F; 3],
    ) -> (L::F, L::F) {
        let (value, gradient) = self.raw_slope(l, at);
        let mut reach = l.splat(0.0);
        for a in 0..3 {
            reach = l.fused(l.magnitude(gradient[a]), half[a], reach);
        }
        for p in &self.terms {
            let mut turned = l.splat(0.0);
            for a in 0..3 {
                turned = l.fused(l.splat(order(p, a) as f32), half[a], turned);
            }
            let curved = l.mul(l.splat(0.5 * p.factor.abs()), turned);
            reach = l.fused(curved, turned, reach);
        }
        (l.sub(value, reach), l.add(value, reach))
    }

    /// What the products come to over the leaves of a column, at whose eight places along x and along y
    /// the functions have these values.
    #[inline(always)]
    pub fn column<L: Lanes>(
        &self,
        l: L,
        x: &Along<[f32; 8]>,
        y: &Along<[f32; 8]>,
        to: &mut Column,
    ) {
        for (i, to) in to.0.iter_mut().enumerate() {
            for (to, of) in to.iter_mut().zip(&self.along_z) {
                let mut sum = l.splat(0.0);
                for p in &self.terms[of.terms.clone()] {
                    let at_x = l.splat(p.factor * x[p.functions[0] & MASK][i & 7]);
                    sum = l.fused(at_x, l.load(&y[p.functions[1] & MASK]), sum);
                }
                l.store(sum, to);
            }
        }
    }

    /// Values at 8^3 places, rows along z, from their column and the functions along z.
    #[inline(always)]
    pub fn values<L: Lanes>(
        &self,
        l: L,
        column: &Column,
        z: &Along<[f32; 8]>,
        out: &mut [[f32; 8]; 64],
    ) {
        match self.along_z.len() {
            1 => self.values_of::<L, 1>(l, column, z, out),
            2 => self.values_of::<L, 2>(l, column, z, out),
            3 => self.values_of::<L, 3>(l, column, z, out),
            4 => self.values_of::<L, 4>(l, column, z, out),
            5 => self.values_of::<L, 5>(l, column, z, out),
            6 => self.values_of::<L, 6>(l, column, z, out),
            _ => self.values_of::<L, SUMS>(l, column, z, out),
        }
    }

    /// The same with N functions along z: a row takes one multiplication for each.
    #[inline(always)]
    fn values_of<L: Lanes, const N: usize>(
        &self,
        l: L,
        column: &Column,
        z: &Along<[f32; 8]>,
        out: &mut [[f32; 8]; 64],
    ) {
        let two = l.two();
        let zero = two.each([0.0; 2]);
        let mut along_z = [zero; N];
        for (to, of) in along_z.iter_mut().zip(&self.along_z) {
            let row = l.load(&z[of.function & MASK]);
            *to = two.pair([row, row]);
        }
        for (i, slab) in out.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            let factors = &column.0[i & 7];
            for (j, rows) in slab.as_chunks_mut().0.iter_mut().enumerate() {
                let j = (2 * j) & 7;
                let mut sum = zero;
                for n in 0..N {
                    let factor = two.each([factors[n][j], factors[n][j + 1]]);
                    sum = two.fused(factor, along_z[n], sum);
                }
                two.store(self.solids_of(l, sum), rows);
            }
        }
    }

    /// In which of 8^3 boxes the solid's field is proved to be above the first of `bounds`, and in which
    /// below minus the second, from the functions at their centres and half their edges in radians along each axis; one
    /// bit by box along z, `[x][y]`. The sum is computed to `precision` of its greatest size.
    #[inline(always)]
    pub fn sides<L: Lanes>(
        &self,
        l: L,
        at: [&Along<[f32; 8]>; 3],
        half: &[[f32; 8]; 3],
        bounds: [f32; 2],
        precision: f32,
    ) -> [[[u8; 8]; 8]; 2] {
        let limits = (bounds, self.least_reach(half, precision));
        match self.along_z.len() {
            1 => self.sides_of::<L, 1>(l, at, half, limits),
            2 => self.sides_of::<L, 2>(l, at, half, limits),
            3 => self.sides_of::<L, 3>(l, at, half, limits),
            4 => self.sides_of::<L, 4>(l, at, half, limits),
            5 => self.sides_of::<L, 5>(l, at, half, limits),
            6 => self.sides_of::<L, 6>(l, at, half, limits),
            _ => self.sides_of::<L, SUMS>(l, at, half, limits),
        }
    }

    /// How far the sum may stray in boxes from what the slope at their centres says.
    #[inline(always)]
    fn least_reach(&self, half: &[[f32; 8]; 3], precision: f32) -> f32 {
        let mut widest = [0f32; 3];
        for axis in 0..3 {
            for n in 0..8 {
                widest[axis] = widest[axis].max(half[axis][n]);
            }
        }
        let mut reach = precision * (self.most + self.mean.abs()) as f32;
        for p in &self.terms {
            let mut turned = 0.0;
            for axis in 0..3 {
                turned += order(p, axis) as f32 * widest[axis];
            }
            reach += 0.5 * p.factor.abs() * turned * turned;
        }
        reach
    }

    #[inline(always)]
    fn sides_of<L: Lanes, const N: usize>(
        &self,
        l: L,
        [x, y, z]: [&Along<[f32; 8]>; 3],
        half: &[[f32; 8]; 3],
        (bounds, least_reach): ([f32; 2], f32),
    ) -> [[[u8; 8]; 8]; 2] {
        let zero = l.splat(0.0);
        let (mut along_z, mut turned_z) = ([zero; N], [zero; N]);
        for (n, of) in self.along_z.iter().enumerate().take(N) {
            let (turned, rate) = derivative(of.function);
            along_z[n] = l.load(&z[of.function & MASK]);
            turned_z[n] = l.mul(l.load(&z[turned & MASK]), l.splat(rate as f32));
        }
        let (above, below) = (l.splat(bounds[0]), l.splat(-bounds[1]));
        let (curved, half_z) = (l.splat(least_reach), l.load(&half[2]));
        let mut sides = [[[0; 8]; 8]; 2];
        for i in 0..8 {
            // Of each function along z, its factor along y, and the factor's slopes by x and y.
            let mut factors = [[[0.0; 8]; 3]; N];
            for (to, of) in factors.iter_mut().zip(&self.along_z) {
                let mut sums = [zero; 3];
                for p in &self.terms[of.terms.clone()] {
                    let along_y = l.load(&y[p.functions[1] & MASK]);
                    let turned_y = l.load(&y[p.turned[1] & MASK]);
                    let at_x = x[p.functions[0] & MASK][i];
                    let turned_x = x[p.turned[0] & MASK][i];
                    sums[0] = l.fused(l.splat(p.factor * at_x), along_y, sums[0]);
                    sums[1] = l.fused(l.splat(p.steep[0] * turned_x), along_y, sums[1]);
                    sums[2] = l.fused(l.splat(p.steep[1] * at_x), turned_y, sums[2]);
                }
                for n in 0..3 {
                    l.store(sums[n], &mut to[n]);
                }
            }
            for j in 0..8 {
                let (mut value, mut slope) = (zero, [zero; 3]);
                for n in 0..N {
                    let factor = l.splat(factors[n][0][j]);
                    value = l.fused(factor, along_z[n], value);
                    slope[0] = l.fused(l.splat(factors[n][1][j]), along_z[n], slope[0]);
                    slope[1] = l.fused(l.splat(factors[n][2][j]), along_z[n], slope[1]);
                    slope[2] = l.fused(factor, turned_z[n], slope[2]);
                }
                let mut reach = l.fused(l.magnitude(slope[0]), l.splat(half[0][i]), curved);
                reach = l.fused(l.magnitude(slope[1]), l.splat(half[1][j]), reach);
                reach = l.fused(l.magnitude(slope[2]), half_z, reach);
                let (lo, hi) = self.solid_between(l, l.sub(value, reach), l.add(value, reach));
                sides[0][i][j] = l.below(above, lo);
                sides[1][i][j] = l.below(hi, below);
            }
        }
        sides
    }

    /// The range of the solid's field from that of the sum.
    #[inline(always)]
    fn solid_between<L: Lanes>(&self, l: L, lo: L::F, hi: L::F) -> (L::F, L::F) {
        let outwards = match self.solid {
            Solid::Below | Solid::Above => return (lo, hi),
            Solid::Sheet => true,
            Solid::Channels => false,
        };
        let (zero, half) = (l.splat(0.0), l.splat(self.half as f32));
        let minus = l.sub(zero, lo);
        let least = l.max(l.max(lo, l.sub(zero, hi)), zero);
        let greatest = l.max(minus, hi);
        if outwards {
            (l.sub(least, half), l.sub(greatest, half))
        } else {
            (l.sub(half, greatest), l.sub(half, least))
        }
    }

    /// Values at eight places along axis `along`, at one place of both others (that of `at[along]` does
    /// not matter): of 16 places along each axis `tables` holds the functions by eights.
    #[inline(always)]
    pub fn line<L: Lanes>(
        &self,
        l: L,
        along: usize,
        tables: &[[Along<[f32; 8]>; 2]; 3],
        at: [usize; 3],
        half: usize,
    ) -> L::F {
        let mut factors = [0.0; FUNCTIONS];
        for p in &self.terms {
            let mut factor = p.factor;
            for axis in 0..3 {
                if axis != along {
                    factor *=
                        tables[axis][at[axis] >> 3 & 1][p.functions[axis] & MASK][at[axis] & 7];
                }
            }
            factors[p.functions[along] & MASK] += factor;
        }
        let mut sum = l.splat(factors[0]);
        for n in 1..=2 * HARMONICS {
            sum = l.fused(
                l.splat(factors[n]),
                l.load(&tables[along][half & 1][n]),
                sum,
            );
        }
        self.solid_of(l, sum)
    }

    /// The same of two rows.
    #[inline(always)]
    fn solids_of<L: Lanes>(&self, l: L, sums: Pair<L>) -> Pair<L> {
        match self.solid {
            Solid::Below | Solid::Above => sums,
            Solid::Sheet | Solid::Channels => {
                let [low, high] = l.two().rows(sums);
                l.two()
                    .pair([self.solid_of(l, low), self.solid_of(l, high)])
            }
        }
    }

    /// The solid's field from the sum.
    #[inline(always)]
    fn solid_of<L: Lanes>(&self, l: L, sum: L::F) -> L::F {
        match self.solid {
            Solid::Below | Solid::Above => sum,
            Solid::Sheet => l.sub(l.magnitude(sum), l.splat(self.half as f32)),
            Solid::Channels => l.sub(l.splat(self.half as f32), l.magnitude(sum)),
        }
    }
}

/// Sine and cosine of angles within +-2.2 radians: error at most 5e-6 at the ends, 1e-7 within a
/// quarter turn.
#[inline(always)]
fn sine_and_cosine<L: Lanes>(l: L, t: L::F) -> (L::F, L::F) {
    let q = l.mul(t, t);
    let mut sine = l.splat(SINE[0]);
    for c in &SINE[1..] {
        sine = l.fused(sine, q, l.splat(*c));
    }
    let mut cosine = l.splat(COSINE[0]);
    for c in &COSINE[1..] {
        cosine = l.fused(cosine, q, l.splat(*c));
    }
    (l.mul(sine, t), cosine)
}

/// Taylor coefficients of sin t / t and cos t by powers of t^2, the highest first.
const SINE: [f32; 6] = [
    -2.505_210_8e-8,
    2.755_731_9e-6,
    -1.984_127e-4,
    8.333_333e-3,
    -0.166_666_67,
    1.0,
];
const COSINE: [f32; 7] = [
    2.087_675_7e-9,
    -2.755_732e-7,
    2.480_158_7e-5,
    -1.388_888_9e-3,
    4.166_666_8e-2,
    -0.5,
    1.0,
];
