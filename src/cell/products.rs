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

/// Most harmonics along an axis.
const HARMONICS: usize = 3;
/// Functions along an axis, the constant included.
pub const FUNCTIONS: usize = 2 * HARMONICS + 1;
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
    rate: [f32; 3],
    factor: f32,
    exact: f64,
}

/// A short series in product form, with the level subtracted and the solid's sign.
#[derive(Clone, Debug)]
pub struct Products {
    terms: Vec<Product>,
    harmonics: usize,
    solid: Solid,
    half: f64,
    any_numbering: bool,
    /// Functions along z that occur.
    along_z: Vec<usize>,
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
        let products: Vec<Product> = sums
            .into_iter()
            .filter(|(_, c)| c.abs() > 1e-12 * largest)
            .map(|(functions, c)| Product {
                functions,
                turned: functions.map(|f| derivative(f).0),
                rate: functions.map(|f| derivative(f).1 as f32),
                factor: (c * sign) as f32,
                exact: c * sign,
            })
            .collect();
        let mut along_z: Vec<usize> = products.iter().map(|p| p.functions[2]).collect();
        along_z.sort_unstable();
        along_z.dedup();
        (products.len() <= MOST).then_some(Self {
            terms: products,
            harmonics,
            solid,
            half: if solid.is_symmetric() {
                cell.level()
            } else {
                0.0
            },
            any_numbering: cell.fits_any_numbering(),
            along_z,
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
            for h in 1..=self.harmonics {
                let (s, c) = (h as f64 * angle).sin_cos();
                values[2 * h - 1] = c;
                values[2 * h] = s;
            }
            values
        });
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        for p in &self.terms {
            let f: [f64; 3] = std::array::from_fn(|a| along[a][p.functions[a]]);
            let g: [f64; 3] = std::array::from_fn(|a| along[a][p.turned[a]] * f64::from(p.rate[a]));
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
        let (mut curved, mut most, mut mean) = (0.0, 0.0, 0.0);
        for p in &self.terms {
            let reach: f64 = (0..3)
                .map(|a| TAU * p.functions[a].div_ceil(2) as f64 * half[a])
                .sum();
            curved += p.exact.abs() * reach * reach / 2.0;
            if p.functions == [0; 3] {
                mean = p.exact;
            } else {
                most += p.exact.abs();
            }
        }
        let reach = gradient.abs().dot(&half) + curved;
        let slack = 1e-6 * (most + mean.abs());
        let lo = (raw - reach).max(mean - most) - slack;
        let hi = (raw + reach).min(mean + most) + slack;
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

    /// Value and derivatives by the angles from the functions along the axes.
    #[inline(always)]
    pub fn slope<L: Lanes>(&self, l: L, at: [&Along<L::F>; 3]) -> (L::F, [L::F; 3]) {
        let zero = l.splat(0.0);
        let (mut value, mut gradient) = (zero, [zero; 3]);
        let [x, y, z] = at;
        for p in &self.terms {
            let ([i, j, k], [di, dj, dk]) = (p.functions, p.turned);
            let c = l.splat(p.factor);
            let (fx, fy, fz) = (x[i], y[j], z[k]);
            if k == 0 {
                let cy = l.mul(c, fy);
                value = l.fused(fx, cy, value);
                gradient[0] = l.fused(l.mul(l.splat(p.rate[0]), x[di]), cy, gradient[0]);
                let cx = l.mul(l.splat(p.factor * p.rate[1]), fx);
                gradient[1] = l.fused(cx, y[dj], gradient[1]);
                continue;
            }
            let cz = l.mul(c, fz);
            let (yz, dz) = (l.mul(fy, cz), l.mul(l.splat(p.factor * p.rate[2]), z[dk]));
            value = l.fused(fx, yz, value);
            if i != 0 {
                gradient[0] = l.fused(l.mul(l.splat(p.rate[0]), x[di]), yz, gradient[0]);
            }
            if j != 0 {
                let dy = l.mul(l.splat(p.rate[1]), y[dj]);
                gradient[1] = l.fused(l.mul(fx, dy), cz, gradient[1]);
            }
            gradient[2] = l.fused(l.mul(fx, fy), dz, gradient[2]);
        }
        match self.solid {
            Solid::Below | Solid::Above => (value, gradient),
            Solid::Sheet | Solid::Channels => {
                let outwards = if self.solid == Solid::Sheet {
                    1.0
                } else {
                    -1.0
                };
                let half = l.splat(self.half as f32);
                let sign = l.select_below(value, zero, l.splat(-outwards), l.splat(outwards));
                let value = l.sub(l.magnitude(value), half);
                for g in &mut gradient {
                    *g = l.mul(*g, sign);
                }
                (l.mul(l.splat(outwards), value), gradient)
            }
        }
    }

    /// Values on a row along z, of eight rows along y at one place x: for each function of z its
    /// factor in each row.
    #[inline(always)]
    pub fn rows<L: Lanes>(
        &self,
        l: L,
        x: &[[f32; 8]; FUNCTIONS],
        place: usize,
        y: &Along<L::F>,
    ) -> [[f32; 8]; FUNCTIONS] {
        let mut sums = [l.splat(0.0); FUNCTIONS];
        for p in &self.terms {
            let [i, j, k] = p.functions;
            sums[k] = l.fused(l.splat(p.factor * x[i][place]), y[j], sums[k]);
        }
        let mut rows = [[0.0; 8]; FUNCTIONS];
        for &k in &self.along_z {
            l.store(sums[k], &mut rows[k]);
        }
        rows
    }

    /// Values of row `y` from what [`Self::rows`] gave.
    #[inline(always)]
    pub fn row<L: Lanes>(
        &self,
        l: L,
        rows: &[[f32; 8]; FUNCTIONS],
        y: usize,
        z: &Along<L::F>,
    ) -> L::F {
        let mut sum = l.splat(rows[0][y]);
        for &k in &self.along_z {
            if k != 0 {
                sum = l.fused(l.splat(rows[k][y]), z[k], sum);
            }
        }
        self.solid_of(l, sum)
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
                    factor *= tables[axis][at[axis] >> 3][p.functions[axis]][at[axis] & 7];
                }
            }
            factors[p.functions[along]] += factor;
        }
        let mut sum = l.splat(factors[0]);
        for n in 1..FUNCTIONS {
            sum = l.fused(l.splat(factors[n]), l.load(&tables[along][half][n]), sum);
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
