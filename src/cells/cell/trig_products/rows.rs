//! Evaluation of products on SIMD lanes: functions along the axes at eight coordinates, and their sums.
//!
//! With the factor `F_n(x, y)` = sum c X(x) Y(y) of the function `Z_n` along z, a value is the sum of `F_n Z_n`.
//! Over a column of leaves along z the `F_n` stay, so that only the `Z_n` are new. The law `products_are_their_series`
//! measures the rounding, `bounds_contain_what_products_give` the ranges.
//!
//! The compiler does not propagate target features into closures, so this file has none.
// Small functions of hot paths, inlined so that they are compiled for the target features of the caller.
#![allow(clippy::inline_always)]

use super::{FUNCTION_MASK, FUNCTIONS, MAX_HARMONICS, Products, derivative, harmonic};
use crate::cell::Solid;
use druse_geometry::simd::{Lanes, Pair, WideLanes};

/// The values of the functions along one axis, at eight coordinates.
pub type Along<F> = [F; FUNCTIONS];

/// Maximal number of functions along z.
const MAX_Z_FUNCTIONS: usize = 2 * MAX_HARMONICS + 1;

/// The products summed along x and y over a column of leaves: for each of eight coordinates along x and
/// each function along z, the factor of that function at eight coordinates along y.
#[derive(Clone, Default)]
pub struct Column([[[f32; 8]; MAX_Z_FUNCTIONS]; 8]);

impl Products {
    /// The functions along an axis at eight coordinates, given as fractions of a period, -1/2 to 1/2.
    #[inline(always)]
    pub fn along<L: Lanes>(&self, l: L, parts: &[f32; 8]) -> Along<L::F> {
        self.axis_functions_of(l, l.load(parts))
    }

    /// As [`Self::along`], for fractions that are already on lanes.
    #[inline(always)]
    pub fn axis_functions_of<L: Lanes>(&self, l: L, r: L::F) -> Along<L::F> {
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
        self.functions_from_first(l, s, c)
    }

    /// All functions from the first sine and cosine.
    /// The recurrence is that of the addition theorems, up to the greatest harmonic. The rest stays 1.
    #[inline(always)]
    fn functions_from_first<L: Lanes>(&self, l: L, s: L::F, c: L::F) -> Along<L::F> {
        let mut all = [l.splat(1.0); FUNCTIONS];
        (all[1], all[2]) = (c, s);
        for h in 2..=self.harmonics {
            let (ch, sh) = (all[2 * h - 3], all[2 * h - 2]);
            // cos h t = cos (h-1)t cos t - sin (h-1)t sin t; sin h t = sin (h-1)t cos t + cos (h-1)t sin t.
            all[2 * h - 1] = l.sub(l.mul(ch, c), l.mul(sh, s));
            all[2 * h] = l.fused(sh, c, l.mul(ch, s));
        }
        all
    }

    /// The functions at coordinates that are advanced by `by` radians, each less than 2.2.
    /// `from` has the functions at the present coordinates; only the first sine and cosine are read.
    #[inline(always)]
    pub fn advanced<L: Lanes>(&self, l: L, from: &Along<L::F>, by: L::F) -> Along<L::F> {
        let (s, c) = sine_and_cosine(l, by);
        let (c0, s0) = (from[1], from[2]);
        self.functions_from_first(
            l,
            // sin (t + by), cos (t + by).
            l.fused(s0, c, l.mul(c0, s)),
            l.sub(l.mul(c0, c), l.mul(s0, s)),
        )
    }

    /// The sum and its derivatives with respect to the angles, from the functions along the axes.
    #[inline(always)]
    fn sum_and_gradient<L: Lanes>(&self, l: L, [x, y, z]: [&Along<L::F>; 3]) -> (L::F, [L::F; 3]) {
        let zero = l.splat(0.0);
        let (mut value, mut gradient) = (zero, [zero; 3]);
        for p in &self.terms {
            // c X Y Z and c X' Y Z, c X Y' Z, c X Y Z'.
            let [i, j, k] = [
                p.functions[0] & FUNCTION_MASK,
                p.functions[1] & FUNCTION_MASK,
                p.functions[2] & FUNCTION_MASK,
            ];
            let [di, dj, dk] = [
                p.derivatives[0] & FUNCTION_MASK,
                p.derivatives[1] & FUNCTION_MASK,
                p.derivatives[2] & FUNCTION_MASK,
            ];
            let (yz, xz, xy) = (l.mul(y[j], z[k]), l.mul(x[i], z[k]), l.mul(x[i], y[j]));
            value = l.fused(l.mul(l.splat(p.factor), x[i]), yz, value);
            gradient[0] = l.fused(l.mul(l.splat(p.slopes[0]), x[di]), yz, gradient[0]);
            gradient[1] = l.fused(l.mul(l.splat(p.slopes[1]), y[dj]), xz, gradient[1]);
            gradient[2] = l.fused(l.mul(l.splat(p.slopes[2]), z[dk]), xy, gradient[2]);
        }
        (value, gradient)
    }

    /// The value of the solid field from the functions along the axes.
    #[inline(always)]
    pub fn value<L: Lanes>(&self, l: L, [x, y, z]: [&Along<L::F>; 3]) -> L::F {
        let mut sum = l.splat(0.0);
        for p in &self.terms {
            let [i, j, k] = p.functions;
            let yz = l.mul(y[j & FUNCTION_MASK], z[k & FUNCTION_MASK]);
            sum = l.fused(l.mul(l.splat(p.factor), x[i & FUNCTION_MASK]), yz, sum);
        }
        self.solid_of(l, sum)
    }

    /// The solid field and its derivatives with respect to the angles, from the functions along the axes.
    #[inline(always)]
    pub fn slope<L: Lanes>(&self, l: L, at: [&Along<L::F>; 3]) -> (L::F, [L::F; 3]) {
        let (value, mut gradient) = self.sum_and_gradient(l, at);
        let outwards = match self.solid {
            Solid::Below | Solid::Above => return (value, gradient),
            Solid::Sheet => 1.0,
            Solid::Channels => -1.0,
        };
        let zero = l.splat(0.0);
        // d|v| = sign(v) dv.
        let sign = l.select_below(value, zero, l.splat(-outwards), l.splat(outwards));
        for g in &mut gradient {
            *g = l.mul(*g, sign);
        }
        (self.solid_of(l, value), gradient)
    }

    /// Bounds of the sum (not of the solid field) in eight boxes, from the functions at the box centres and
    /// the half edges in radians.
    /// The result is (least, greatest) without rounding.
    #[inline(always)]
    pub fn sum_ranges<L: Lanes>(
        &self,
        l: L,
        at: [&Along<L::F>; 3],
        half: [L::F; 3],
    ) -> (L::F, L::F) {
        let (value, gradient) = self.sum_and_gradient(l, at);
        // Taylor: |Phi - Phi(centre)| <= sum_a |dPhi/da| h_a + sum |c| (sum_a k_a h_a)^2 / 2, for harmonics k
        // and half edges h.
        let mut reach = l.splat(0.0);
        for a in 0..3 {
            reach = l.fused(l.magnitude(gradient[a]), half[a], reach);
        }
        for p in &self.terms {
            let mut phase = l.splat(0.0);
            for a in 0..3 {
                phase = l.fused(l.splat(harmonic(p, a) as f32), half[a], phase);
            }
            let remainder = l.mul(l.splat(0.5 * p.factor.abs()), phase);
            reach = l.fused(remainder, phase, reach);
        }
        (l.sub(value, reach), l.add(value, reach))
    }

    /// The products summed along x and y for a column of leaves, from the functions at its eight coordinates
    /// along x and along y.
    /// `to` holds the result; entries beyond the functions of this cell keep their old values.
    #[inline(always)]
    pub fn column<L: Lanes>(
        &self,
        l: L,
        x: &Along<[f32; 8]>,
        y: &Along<[f32; 8]>,
        to: &mut Column,
    ) {
        // F_n at the i-th x and eight y.
        for (i, to) in to.0.iter_mut().enumerate() {
            for (to, of) in to.iter_mut().zip(&self.along_z) {
                let mut sum = l.splat(0.0);
                for p in &self.terms[of.terms.clone()] {
                    let at_x = l.splat(p.factor * x[p.functions[0] & FUNCTION_MASK][i & 7]);
                    sum = l.fused(at_x, l.load(&y[p.functions[1] & FUNCTION_MASK]), sum);
                }
                l.store(sum, to);
            }
        }
    }

    /// Values at 8^3 points, rows along z, from the column and the functions along z.
    /// `out[8 i + j]` is the row at the i-th x and j-th y. Values are those of the solid field.
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
            _ => self.values_of::<L, MAX_Z_FUNCTIONS>(l, column, z, out),
        }
    }

    /// As [`Self::values`], where N is at least the number of functions along z: a row takes N multiplications.
    #[inline(always)]
    fn values_of<L: Lanes, const N: usize>(
        &self,
        l: L,
        column: &Column,
        z: &Along<[f32; 8]>,
        out: &mut [[f32; 8]; 64],
    ) {
        let two = l.wide();
        let zero = two.splat_rows([0.0; 2]);
        // Z_n of eight z twice in a wide register, for two rows that differ in y.
        let mut along_z = [zero; N];
        for (to, of) in along_z.iter_mut().zip(&self.along_z) {
            let row = l.load(&z[of.function & FUNCTION_MASK]);
            *to = two.join_rows([row, row]);
        }
        for (i, slab) in out.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            let factors = &column.0[i & 7]; // F_n
            // sum_n F_n Z_n, two rows at a time.
            for (j, rows) in slab.as_chunks_mut().0.iter_mut().enumerate() {
                let j = (2 * j) & 7;
                let mut sum = zero;
                for n in 0..N {
                    let factor = two.splat_rows([factors[n][j], factors[n][j + 1]]);
                    sum = two.fused(factor, along_z[n], sum);
                }
                two.store(self.solid_of_pair(l, sum), rows);
            }
        }
    }

    /// Classifies 8^3 boxes: in which the solid field is proved to be above the first of `bounds`, and in
    /// which below minus the second. Arguments are the functions at the box centres and the half edges in
    /// radians along each axis. The result has one bit per box along z, `[x][y]`. The sum has a relative
    /// rounding error `precision` of its largest magnitude.
    #[inline(always)]
    pub fn classify_boxes<L: Lanes>(
        &self,
        l: L,
        at: [&Along<[f32; 8]>; 3],
        half: &[[f32; 8]; 3],
        bounds: [f32; 2],
        precision: f32,
    ) -> [[[u8; 8]; 8]; 2] {
        let remainder = self.remainder_bound(half, precision);
        match self.along_z.len() {
            1 => self.classify_boxes_of::<L, 1>(l, at, half, bounds, remainder),
            2 => self.classify_boxes_of::<L, 2>(l, at, half, bounds, remainder),
            3 => self.classify_boxes_of::<L, 3>(l, at, half, bounds, remainder),
            4 => self.classify_boxes_of::<L, 4>(l, at, half, bounds, remainder),
            5 => self.classify_boxes_of::<L, 5>(l, at, half, bounds, remainder),
            6 => self.classify_boxes_of::<L, 6>(l, at, half, bounds, remainder),
            _ => self.classify_boxes_of::<L, MAX_Z_FUNCTIONS>(l, at, half, bounds, remainder),
        }
    }

    /// Bound of the rounding error plus the second-order Taylor remainder of the sum, over all boxes.
    #[inline(always)]
    fn remainder_bound(&self, half: &[[f32; 8]; 3], precision: f32) -> f32 {
        let mut max_half = [0f32; 3];
        for axis in 0..3 {
            for n in 0..8 {
                max_half[axis] = max_half[axis].max(half[axis][n]);
            }
        }
        // precision (sum |c|) + sum |c| (sum_a k_a h_a)^2 / 2, for harmonics k and the greatest half edges h.
        let mut reach = precision * (self.amplitude + self.mean.abs()) as f32;
        for p in &self.terms {
            let mut phase = 0.0;
            for axis in 0..3 {
                phase += harmonic(p, axis) as f32 * max_half[axis];
            }
            reach += 0.5 * p.factor.abs() * phase * phase;
        }
        reach
    }

    /// As [`Self::classify_boxes`], for N functions along z and the largest remainder of all boxes.
    #[inline(always)]
    fn classify_boxes_of<L: Lanes, const N: usize>(
        &self,
        l: L,
        [x, y, z]: [&Along<[f32; 8]>; 3],
        half: &[[f32; 8]; 3],
        bounds: [f32; 2],
        remainder_bound: f32,
    ) -> [[[u8; 8]; 8]; 2] {
        let zero = l.splat(0.0);
        let (mut along_z, mut derivative_z) = ([zero; N], [zero; N]); // Z_n, Z_n'
        for (n, of) in self.along_z.iter().enumerate().take(N) {
            let (other, rate) = derivative(of.function);
            along_z[n] = l.load(&z[of.function & FUNCTION_MASK]);
            derivative_z[n] = l.mul(l.load(&z[other & FUNCTION_MASK]), l.splat(rate as f32));
        }
        let (above, below) = (l.splat(bounds[0]), l.splat(-bounds[1]));
        let (remainder, half_z) = (l.splat(remainder_bound), l.load(&half[2]));
        let mut sides = [[[0; 8]; 8]; 2];
        for i in 0..8 {
            // For each Z_n its factor F_n at eight y, and dF_n/dx, dF_n/dy.
            let mut factors = [[[0.0; 8]; 3]; N];
            for (to, of) in factors.iter_mut().zip(&self.along_z) {
                let mut sums = [zero; 3];
                for p in &self.terms[of.terms.clone()] {
                    let along_y = l.load(&y[p.functions[1] & FUNCTION_MASK]);
                    let derivative_y = l.load(&y[p.derivatives[1] & FUNCTION_MASK]);
                    let at_x = x[p.functions[0] & FUNCTION_MASK][i];
                    let derivative_x = x[p.derivatives[0] & FUNCTION_MASK][i];
                    sums[0] = l.fused(l.splat(p.factor * at_x), along_y, sums[0]);
                    sums[1] = l.fused(l.splat(p.slopes[0] * derivative_x), along_y, sums[1]);
                    sums[2] = l.fused(l.splat(p.slopes[1] * at_x), derivative_y, sums[2]);
                }
                for n in 0..3 {
                    l.store(sums[n], &mut to[n]);
                }
            }
            // sum F_n Z_n and its slopes at eight box centres along z, then the Taylor bound of `sum_ranges` with
            // the largest remainder of all boxes.
            for j in 0..8 {
                let (mut value, mut slope) = (zero, [zero; 3]);
                for n in 0..N {
                    let factor = l.splat(factors[n][0][j]);
                    value = l.fused(factor, along_z[n], value);
                    slope[0] = l.fused(l.splat(factors[n][1][j]), along_z[n], slope[0]);
                    slope[1] = l.fused(l.splat(factors[n][2][j]), along_z[n], slope[1]);
                    slope[2] = l.fused(factor, derivative_z[n], slope[2]);
                }
                let mut reach = l.fused(l.magnitude(slope[0]), l.splat(half[0][i]), remainder);
                reach = l.fused(l.magnitude(slope[1]), l.splat(half[1][j]), reach);
                reach = l.fused(l.magnitude(slope[2]), half_z, reach);
                let (lo, hi) = self.solid_between(l, l.sub(value, reach), l.add(value, reach));
                sides[0][i][j] = l.below(above, lo);
                sides[1][i][j] = l.below(hi, below);
            }
        }
        sides
    }

    /// The range of the solid field from that of the sum.
    /// The result is (least, greatest).
    #[inline(always)]
    fn solid_between<L: Lanes>(&self, l: L, lo: L::F, hi: L::F) -> (L::F, L::F) {
        let outwards = match self.solid {
            Solid::Below | Solid::Above => return (lo, hi),
            Solid::Sheet => true,
            Solid::Channels => false,
        };
        let (zero, half) = (l.splat(0.0), l.splat(self.half as f32));
        // |sum| is between max(lo, -hi, 0) and max(-lo, hi).
        let minus = l.sub(zero, lo);
        let least = l.max(l.max(lo, l.sub(zero, hi)), zero);
        let greatest = l.max(minus, hi);
        if outwards {
            (l.sub(least, half), l.sub(greatest, half))
        } else {
            (l.sub(half, greatest), l.sub(half, least))
        }
    }

    /// Values at eight coordinates along axis `along`, with the coordinates of both other axes fixed by `at`
    /// (`at[along]` is ignored). `tables` holds the functions at 16 coordinates along each axis, in two
    /// halves.
    /// `half` selects which of the two groups of eight along the axis; `at` is from 0 to 15.
    #[inline(always)]
    pub fn line<L: Lanes>(
        &self,
        l: L,
        along: usize,
        tables: &[[Along<[f32; 8]>; 2]; 3],
        at: [usize; 3],
        half: usize,
    ) -> L::F {
        // All products with the same function along the line add up to one factor of it.
        let mut factors = [0.0; FUNCTIONS];
        for p in &self.terms {
            let mut factor = p.factor;
            for axis in 0..3 {
                if axis != along {
                    factor *= tables[axis][at[axis] >> 3 & 1][p.functions[axis] & FUNCTION_MASK]
                        [at[axis] & 7];
                }
            }
            factors[p.functions[along] & FUNCTION_MASK] += factor;
        }
        // Function 0 is 1.
        let mut sum = l.splat(factors[0]);
        for n in 1..=2 * MAX_HARMONICS {
            sum = l.fused(
                l.splat(factors[n]),
                l.load(&tables[along][half & 1][n]),
                sum,
            );
        }
        self.solid_of(l, sum)
    }

    /// As [`Self::solid_of`], for two rows.
    #[inline(always)]
    fn solid_of_pair<L: Lanes>(&self, l: L, sums: Pair<L>) -> Pair<L> {
        match self.solid {
            Solid::Below | Solid::Above => sums,
            Solid::Sheet | Solid::Channels => {
                let [low, high] = l.wide().split_rows(sums);
                l.wide()
                    .join_rows([self.solid_of(l, low), self.solid_of(l, high)])
            }
        }
    }

    /// The solid field from the sum.
    #[inline(always)]
    fn solid_of<L: Lanes>(&self, l: L, sum: L::F) -> L::F {
        match self.solid {
            Solid::Below | Solid::Above => sum,
            Solid::Sheet => l.sub(l.magnitude(sum), l.splat(self.half as f32)),
            Solid::Channels => l.sub(l.splat(self.half as f32), l.magnitude(sum)),
        }
    }
}

/// Sine and cosine of angles in +-2.2 radians. The error is at most 5e-6 at the ends and 1e-7 within a
/// quarter turn.
#[inline(always)]
fn sine_and_cosine<L: Lanes>(l: L, t: L::F) -> (L::F, L::F) {
    // By Horner in q = t^2: sin t = t S(q), cos t = C(q).
    let q = l.mul(t, t);
    let mut sine = l.splat(SINE_COEFFICIENTS[0]);
    for c in &SINE_COEFFICIENTS[1..] {
        sine = l.fused(sine, q, l.splat(*c));
    }
    let mut cosine = l.splat(COSINE_COEFFICIENTS[0]);
    for c in &COSINE_COEFFICIENTS[1..] {
        cosine = l.fused(cosine, q, l.splat(*c));
    }
    (l.mul(sine, t), cosine)
}

/// Taylor coefficients of sin t / t and cos t in powers of t^2, highest first.
const SINE_COEFFICIENTS: [f32; 6] = [
    -2.505_210_8e-8,
    2.755_731_9e-6,
    -1.984_127e-4,
    8.333_333e-3,
    -0.166_666_67,
    1.0,
];
const COSINE_COEFFICIENTS: [f32; 7] = [
    2.087_675_7e-9,
    -2.755_732e-7,
    2.480_158_7e-5,
    -1.388_888_9e-3,
    4.166_666_8e-2,
    -0.5,
    1.0,
];
