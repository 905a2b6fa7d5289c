//! Short series as sums of products of sines and cosines along the axes.
//!
//! Phi = sum c X(x) Y(y) Z(z), where each factor is 1, cos 2 pi h x or sin 2 pi h x: of the closed
//! forms a handful of products stands for up to some forty exponentials. Along an axis that is parallel to a
//! row of samples a factor is tabulated once for the row, so that a value costs one multiplication per
//! factor along the row; between samples sines and cosines follow by their sums' theorems.
//!
//! Functions along an axis are numbered: 0 is 1, 2 h - 1 is cos h, 2 h is sin h, of the angle
//! 2 pi x. Derivatives are by the angles. What runs on lanes has no closures: they would be compiled
//! for any processor.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::{Cell, Form, Solid};
use crate::frame::Vec3;
use crate::lanes::Lanes;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::Range;

/// Most harmonics along an axis.
const HARMONICS: usize = 3;
/// Functions along an axis, the constant included: a power of two, so that a mask keeps indices within.
pub const FUNCTIONS: usize = (2 * HARMONICS + 1).next_power_of_two();
const MASK: usize = FUNCTIONS - 1;
/// Most products.
const MOST: usize = 16;

/// The values of the functions along one axis, at eight places.
pub type Along<F> = [F; FUNCTIONS];

/// `c X_i(x) Y_j(y) Z_k(z)`.
#[derive(Clone, Copy, Debug)]
struct Product {
    functions: [usize; 3],
    /// The functions whose multiples are the derivatives of the functions, with the factors.
    turned: [usize; 3],
    rate: [f64; 3],
    /// c, and c times each rate.
    factor: f32,
    steep: [f32; 3],
    exact: f64,
}

/// The products that share a function along z.
#[derive(Clone, Debug)]
struct AlongZ {
    function: usize,
    terms: Range<usize>,
}

/// A short series in product form, with the level subtracted and the solid's sign.
#[derive(Clone, Debug)]
pub struct Products {
    /// Sorted by the function along z.
    terms: Vec<Product>,
    along_z: Vec<AlongZ>,
    harmonics: usize,
    solid: Solid,
    half: f64,
    any_numbering: bool,
    /// The constant product, and the sum of the others' sizes.
    mean: f64,
    most: f64,
}

/// The harmonic of a product along an axis.
#[inline(always)]
fn order(p: &Product, axis: usize) -> f64 {
    p.functions[axis].div_ceil(2) as f64
}

/// The function whose multiple is the derivative of a function, and the factor.
fn derivative(function: usize) -> (usize, f64) {
    match function {
        0 => (0, 0.0),
        f if f % 2 == 1 => (f + 1, -f64::from((f as u32).div_ceil(2))),
        f => (f - 1, f64::from(f as u32 / 2)),
    }
}

impl Products {
    /// The products of a cell that is one short series of period 1 along the axes of its element.
    pub fn of(cell: &Cell, form: &Form) -> Option<Self> {
        let series = form.series()?;
        if series.lattice().periods()? != [1.0; 3] {
            return None;
        }
        let mut sums = BTreeMap::<[usize; 3], f64>::new();
        let mut harmonics = 0;
        for &(k, [re, im]) in series.exponentials() {
            let f = series.lattice().frequency(k);
            let h: [i32; 3] = std::array::from_fn(|a| f[a].round() as i32);
            let greatest = h.map(i32::unsigned_abs).into_iter().max()? as usize;
            if greatest > HARMONICS || (0..3).any(|a| (f[a] - f64::from(h[a])).abs() > 1e-9) {
                return None;
            }
            harmonics = harmonics.max(greatest);
            // The real part of C prod (cos + i sin).
            for sines in 0..8usize {
                let is_sine = |a: usize| sines >> a & 1 == 1;
                if (0..3).any(|a| is_sine(a) && h[a] == 0) {
                    continue;
                }
                let sign: f64 = (0..3)
                    .filter(|&a| is_sine(a) && h[a] < 0)
                    .map(|_| -1.0)
                    .product();
                let part = match sines.count_ones() {
                    0 => re,
                    1 => -im,
                    2 => -re,
                    _ => im,
                };
                let functions = std::array::from_fn(|a| {
                    let n = h[a].unsigned_abs() as usize;
                    (2 * n).saturating_sub(usize::from(!is_sine(a)))
                });
                *sums.entry(functions).or_default() += sign * part;
            }
        }
        let solid = cell.solid();
        let sign = if solid == Solid::Above { -1.0 } else { 1.0 };
        let largest = sums.values().fold(0f64, |m, c| m.max(c.abs()));
        let mut terms: Vec<Product> = sums
            .into_iter()
            .filter(|(_, c)| c.abs() > 1e-12 * largest)
            .map(|(functions, c)| {
                let rate = functions.map(|f| derivative(f).1);
                Product {
                    functions,
                    turned: functions.map(|f| derivative(f).0),
                    rate,
                    factor: (c * sign) as f32,
                    steep: rate.map(|r| (c * sign * r) as f32),
                    exact: c * sign,
                }
            })
            .collect();
        terms.sort_by_key(|p| p.functions[2]);
        let along_z = terms
            .chunk_by(|p, q| p.functions[2] == q.functions[2])
            .scan(0, |first, of| {
                let terms = *first..*first + of.len();
                *first = terms.end;
                let function = of[0].functions[2];
                Some(AlongZ { function, terms })
            })
            .collect();
        let is_constant = |p: &&Product| p.functions == [0; 3];
        let mean = terms.iter().find(is_constant).map_or(0.0, |p| p.exact);
        let sizes: f64 = terms.iter().map(|p| p.exact.abs()).sum();
        (terms.len() <= MOST).then_some(Self {
            terms,
            along_z,
            harmonics,
            solid,
            half: if solid.is_symmetric() {
                cell.level()
            } else {
                0.0
            },
            any_numbering: cell.fits_any_numbering(),
            mean,
            most: sizes - mean.abs(),
        })
    }

    /// Whether the cell is the same whatever the numbering of its element's nodes.
    pub fn fits_any_numbering(&self) -> bool {
        self.any_numbering
    }

    /// Value of the solid's field from that of the sum, and its derivative by it.
    fn solid(&self, raw: f64) -> (f64, f64) {
        match self.solid {
            Solid::Below | Solid::Above => (raw, 1.0),
            Solid::Sheet => (raw.abs() - self.half, 1f64.copysign(raw)),
            Solid::Channels => (self.half - raw.abs(), -1f64.copysign(raw)),
        }
    }

    /// The sum itself and its derivatives by the coordinates, in double precision.
    fn raw(&self, u: Vec3) -> (f64, Vec3) {
        let along: [[f64; FUNCTIONS]; 3] = std::array::from_fn(|a| {
            let angle = TAU * (u[a] - u[a].round());
            let mut values = [1.0; FUNCTIONS];
            (values[2], values[1]) = libm::sincos(angle);
            let (s, c) = (values[2], values[1]);
            for h in 2..=self.harmonics {
                let (sh, ch) = (values[2 * h - 2], values[2 * h - 3]);
                values[2 * h - 1] = ch * c - sh * s;
                values[2 * h] = sh * c + ch * s;
            }
            values
        });
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        for p in &self.terms {
            let f: [f64; 3] = std::array::from_fn(|a| along[a][p.functions[a]]);
            let g: [f64; 3] = std::array::from_fn(|a| along[a][p.turned[a]] * p.rate[a]);
            value += p.exact * f[0] * f[1] * f[2];
            gradient +=
                p.exact * Vec3::new(g[0] * f[1] * f[2], f[0] * g[1] * f[2], f[0] * f[1] * g[2]);
        }
        (value, gradient * TAU)
    }

    /// Value and gradient by reference coordinates, in double precision; negative inside.
    pub fn value_and_gradient(&self, u: Vec3) -> (f64, Vec3) {
        let (raw, gradient) = self.raw(u);
        let (value, slope) = self.solid(raw);
        (value, gradient * slope)
    }

    /// Contains every value in the box of reference coordinates around a centre: second-order Taylor,
    /// the second derivatives bounded by the coefficients.
    pub fn bound(&self, centre: Vec3, half: Vec3) -> (f64, f64) {
        let (raw, gradient) = self.raw(centre);
        let curved: f64 = self
            .terms
            .iter()
            .map(|p| {
                let reach: f64 = (0..3).map(|a| TAU * order(p, a) * half[a]).sum();
                p.exact.abs() * reach * reach / 2.0
            })
            .sum();
        let reach = gradient.abs().dot(&half) + curved;
        self.solid_range(raw - reach, raw + reach, 1e-6)
    }

    /// The range of the solid's field from that of the sum, which is computed to `precision` of its
    /// greatest size.
    pub fn solid_range(&self, lo: f64, hi: f64, precision: f64) -> (f64, f64) {
        let slack = precision * (self.most + self.mean.abs());
        let lo = lo.max(self.mean - self.most) - slack;
        let hi = hi.min(self.mean + self.most) + slack;
        let least = if lo <= 0.0 && hi >= 0.0 {
            0.0
        } else {
            lo.abs().min(hi.abs())
        };
        let greatest = lo.abs().max(hi.abs());
        match self.solid {
            Solid::Below | Solid::Above => (lo, hi),
            Solid::Sheet => (least - self.half, greatest - self.half),
            Solid::Channels => (self.half - greatest, self.half - least),
        }
    }

    /// The functions along an axis at eight places, from the places' parts of a period, -1/2 to 1/2.
    #[inline(always)]
    pub fn along<L: Lanes>(&self, l: L, parts: &[f32; 8]) -> Along<L::F> {
        let r = l.load(parts);
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

    /// Values at 8^3 places, rows along z, from the functions along the axes (of x as arrays), into `out`;
    /// returns the least sizes.
    #[inline(always)]
    pub fn values<L: Lanes>(
        &self,
        l: L,
        x: &Along<[f32; 8]>,
        y: &Along<L::F>,
        z: &Along<L::F>,
        out: &mut [[f32; 8]; 64],
    ) -> L::F {
        match self.along_z.len() {
            1 => self.values_of::<L, 1>(l, x, y, z, out),
            2 => self.values_of::<L, 2>(l, x, y, z, out),
            3 => self.values_of::<L, 3>(l, x, y, z, out),
            4 => self.values_of::<L, 4>(l, x, y, z, out),
            5 => self.values_of::<L, 5>(l, x, y, z, out),
            6 => self.values_of::<L, 6>(l, x, y, z, out),
            _ => self.values_of::<L, 7>(l, x, y, z, out),
        }
    }

    /// The same with N functions along z: those of x and y are summed once per place along x, so that a
    /// row takes one multiplication for each of z.
    #[inline(always)]
    fn values_of<L: Lanes, const N: usize>(
        &self,
        l: L,
        x: &Along<[f32; 8]>,
        y: &Along<L::F>,
        z: &Along<L::F>,
        out: &mut [[f32; 8]; 64],
    ) -> L::F {
        let mut along_z = [l.splat(0.0); N];
        for (to, of) in along_z.iter_mut().zip(&self.along_z) {
            *to = z[of.function & MASK];
        }
        let mut least = l.splat(f32::INFINITY);
        for (i, slab) in out.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            let mut factors = [[0.0; 8]; N];
            for (to, of) in factors.iter_mut().zip(&self.along_z) {
                let mut sum = l.splat(0.0);
                for p in &self.terms[of.terms.clone()] {
                    let at_x = l.splat(p.factor * x[p.functions[0] & MASK][i & 7]);
                    sum = l.fused(at_x, y[p.functions[1] & MASK], sum);
                }
                l.store(sum, to);
            }
            for (j, row) in slab.iter_mut().enumerate() {
                let mut sum = l.splat(0.0);
                for n in 0..N {
                    sum = l.fused(l.splat(factors[n][j & 7]), along_z[n], sum);
                }
                let f = self.solid_of(l, sum);
                least = l.min(least, l.magnitude(f));
                l.store(f, row);
            }
        }
        least
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
