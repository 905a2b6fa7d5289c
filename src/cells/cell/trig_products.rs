//! Short series as sums of products of sines and cosines along the axes.
//!
//! Phi = sum c X(x) Y(y) Z(z), where each factor is 1, cos 2 pi h x or sin 2 pi h x. A closed form has a
//! handful of products in place of up to some forty exponentials. Along a row of samples parallel to an
//! axis, a factor is tabulated once, so that a value costs one multiplication per factor along the row.
//! Between samples, sines and cosines follow from the addition theorems.
//!
//! The functions along an axis are numbered: 0 is 1, 2 h - 1 is cos h, 2 h is sin h, of the angle 2 pi x. Derivatives
//! are with respect to the angle. In single precision (`rows`) the law `products_are_their_series` allows errors of
//! 2e-6 of the sum of the waves' sizes.

use super::{Cell, Expression, Solid};
use druse_geometry::frame::Vec3;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::Range;

mod rows;
pub use rows::{Along, Column};

/// Maximal harmonic along an axis.
const MAX_HARMONICS: usize = 3;
/// Number of functions along an axis, the constant included; a power of two, so that a mask bounds indices.
pub const FUNCTIONS: usize = (2 * MAX_HARMONICS + 1).next_power_of_two();
const FUNCTION_MASK: usize = FUNCTIONS - 1;
/// Maximal number of products.
const MAX_PRODUCTS: usize = 16;

/// `c X_i(x) Y_j(y) Z_k(z)`.
#[derive(Clone, Copy, Debug)]
struct Product {
    functions: [usize; 3],
    /// The derivative of each function is `rates` times the function `derivatives`.
    derivatives: [usize; 3],
    rates: [f64; 3],
    /// c in single precision, and c times each rate.
    factor: f32,
    slopes: [f32; 3],
    /// c in double precision.
    coefficient: f64,
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
    /// The constant product, and the sum of the absolute coefficients of the others.
    mean: f64,
    amplitude: f64,
}

/// The harmonic of a product along an axis.
/// 0 for the constant function, else the number of waves in the period.
fn harmonic(p: &Product, axis: usize) -> f64 {
    p.functions[axis].div_ceil(2) as f64
}

/// The derivative of a function: the index of another function, and the factor of that function.
/// The derivative of cos h is -h sin h, that of sin h is h cos h.
fn derivative(function: usize) -> (usize, f64) {
    match function {
        0 => (0, 0.0),
        f if f % 2 == 1 => (f + 1, -f64::from((f as u32).div_ceil(2))),
        f => (f - 1, f64::from(f as u32 / 2)),
    }
}

impl Products {
    /// The products of a cell; `None` if its function is no single series, has another period than 1 along the axes,
    /// harmonics beyond 3 (`MAX_HARMONICS`) or more than 16 products (`MAX_PRODUCTS`).
    pub fn of(cell: &Cell, expression: &Expression) -> Option<Self> {
        let series = expression.series()?;
        if series.lattice().periods()? != [1.0; 3] {
            return None;
        }
        // Indices are harmonics here: period 1 along each axis. Waves that are none have no product form.
        let mut sums = BTreeMap::<[usize; 3], f64>::new();
        let mut harmonics = 0;
        for &(k, [re, im]) in series.exponentials() {
            let f = series.lattice().frequency(k);
            let h: [i32; 3] = std::array::from_fn(|a| f[a].round() as i32);
            let max_harmonic = h.map(i32::unsigned_abs).into_iter().max()? as usize;
            if max_harmonic > MAX_HARMONICS || (0..3).any(|a| (f[a] - f64::from(h[a])).abs() > 1e-9)
            {
                return None;
            }
            harmonics = harmonics.max(max_harmonic);
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
        // Terms that cancel leave rounding; the sign makes the solid negative.
        let solid = cell.solid();
        let sign = if solid == Solid::Above { -1.0 } else { 1.0 };
        let largest = sums.values().fold(0f64, |m, c| m.max(c.abs()));
        let mut terms: Vec<Product> = sums
            .into_iter()
            .filter(|(_, c)| c.abs() > 1e-12 * largest)
            .map(|(functions, c)| {
                let rates = functions.map(|f| derivative(f).1);
                Product {
                    functions,
                    derivatives: functions.map(|f| derivative(f).0),
                    rates,
                    factor: (c * sign) as f32,
                    slopes: rates.map(|r| (c * sign * r) as f32),
                    coefficient: c * sign,
                }
            })
            .collect();
        // Terms with the same function along z are neighbours: a row along z multiplies by it once.
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
        let mean = terms
            .iter()
            .find(is_constant)
            .map_or(0.0, |p| p.coefficient);
        let sizes: f64 = terms.iter().map(|p| p.coefficient.abs()).sum();
        (terms.len() <= MAX_PRODUCTS).then_some(Self {
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
            amplitude: sizes - mean.abs(),
        })
    }

    /// Whether the cell is independent of the numbering of its element's nodes.
    #[inline]
    pub fn fits_any_numbering(&self) -> bool {
        self.any_numbering
    }

    /// Number of products.
    #[inline]
    pub fn terms(&self) -> usize {
        self.terms.len()
    }

    /// Whether values are representable in single precision.
    /// The limit 1e30 leaves room for products.
    #[inline]
    pub fn is_single(&self) -> bool {
        (self.amplitude + self.mean.abs() + self.half.abs()) < 1e30
    }

    /// Value of the solid field from that of the sum, and its derivative with respect to the sum.
    /// The derivative has the sign of the sum for a sheet, and the opposite one for channels.
    fn solid(&self, sum: f64) -> (f64, f64) {
        match self.solid {
            Solid::Below | Solid::Above => (sum, 1.0),
            Solid::Sheet => (sum.abs() - self.half, 1f64.copysign(sum)),
            Solid::Channels => (self.half - sum.abs(), -1f64.copysign(sum)),
        }
    }

    /// The sum and its derivatives with respect to the coordinates, in double precision.
    /// `u` is in reference coordinates, of period 1.
    fn sum(&self, u: Vec3) -> (f64, Vec3) {
        let along: [[f64; FUNCTIONS]; 3] = std::array::from_fn(|a| {
            let angle = TAU * (u[a] - u[a].round()); // -pi to pi
            let mut values = [1.0; FUNCTIONS];
            (values[2], values[1]) = libm::sincos(angle);
            let (s, c) = (values[2], values[1]);
            // cos h t = cos (h-1)t cos t - sin (h-1)t sin t; sin h t = sin (h-1)t cos t + cos (h-1)t sin t.
            for h in 2..=self.harmonics {
                let (sh, ch) = (values[2 * h - 2], values[2 * h - 3]);
                values[2 * h - 1] = ch * c - sh * s;
                values[2 * h] = sh * c + ch * s;
            }
            values
        });
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        // c X Y Z and c (X' Y Z, X Y' Z, X Y Z'), by the angles; 2 pi makes it by the coordinates.
        for p in &self.terms {
            let f: [f64; 3] = std::array::from_fn(|a| along[a][p.functions[a]]);
            let g: [f64; 3] = std::array::from_fn(|a| along[a][p.derivatives[a]] * p.rates[a]);
            value += p.coefficient * f[0] * f[1] * f[2];
            gradient += p.coefficient
                * Vec3::new(g[0] * f[1] * f[2], f[0] * g[1] * f[2], f[0] * f[1] * g[2]);
        }
        (value, gradient * TAU)
    }

    /// Value (negative inside) and gradient in reference coordinates, in double precision.
    /// `u` is in reference coordinates, and the gradient is per unit of them.
    #[inline]
    pub fn value_and_gradient(&self, u: Vec3) -> (f64, Vec3) {
        let (sum, gradient) = self.sum(u);
        let (value, slope) = self.solid(sum);
        (value, gradient * slope)
    }

    /// The range of values in the box of reference coordinates around a centre: second-order Taylor
    /// expansion, with the second derivatives bounded by the coefficients.
    /// `half` is the box's half edges, in reference lengths. The result is (least, greatest), widened by 1e-6 of the
    /// largest magnitude for rounding.
    #[inline]
    pub fn bound(&self, centre: Vec3, half: Vec3) -> (f64, f64) {
        let (sum, gradient) = self.sum(centre);
        // |Phi - Phi(centre)| <= sum_a |dPhi/da| h_a + sum |c| (sum_a 2 pi k_a h_a)^2 / 2, harmonics k.
        let remainder: f64 = self
            .terms
            .iter()
            .map(|p| {
                let reach: f64 = (0..3).map(|a| TAU * harmonic(p, a) * half[a]).sum();
                p.coefficient.abs() * reach * reach / 2.0
            })
            .sum();
        let reach = gradient.abs().dot(&half) + remainder;
        self.solid_range(sum - reach, sum + reach, 1e-6)
    }

    /// The range of the solid field from that of the sum. The sum has a relative rounding error `precision`
    /// of its largest magnitude.
    /// The result is (least, greatest), each widened by that error.
    pub fn solid_range(&self, lo: f64, hi: f64, precision: f64) -> (f64, f64) {
        let slack = precision * (self.amplitude + self.mean.abs());
        let lo = lo.max(self.mean - self.amplitude) - slack;
        let hi = hi.min(self.mean + self.amplitude) + slack;
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gyroid_is_its_closed_form_within_its_bounds() {
        let hex = druse_geometry::frame::Element::Hex;
        let cell = crate::cell::Surface::Gyroid.cell(hex).unwrap();
        let products = Products::of(&cell, cell.expression()).unwrap();
        let closed = |u: Vec3| {
            let [(sx, cx), (sy, cy), (sz, cz)] = [u.x, u.y, u.z].map(|c| (TAU * c).sin_cos());
            sx * cy + sy * cz + sz * cx
        };
        for u in [[0.1, 0.2, 0.3], [-0.4, 3.3, 0.0], [0.7, -0.6, 1.2]].map(Vec3::from) {
            let (value, gradient) = products.value_and_gradient(u);
            assert!((value - closed(u)).abs() < 1e-12, "{u:?}: {value}");
            for step in [0, 1, 2, 3, 4, 5].map(|n| Vec3::ith(n / 2, [0.05, -0.05][n % 2])) {
                let ((lo, hi), there) = (products.bound(u, step.abs()), closed(u + step));
                // Second derivatives along an axis are at most 2 (2 pi)^2.
                let error = there - value - gradient.dot(&step);
                assert!(error.abs() < (TAU * 0.05).powi(2) && lo <= there && there <= hi);
            }
        }
    }
}
