//! Exact evaluation of a real trigonometric sum from tables of phasors, one table per lattice axis.
//!
//! A phasor is a power exp(2 pi i k u) of one coordinate. A wave's phasor is the product over the axes. Waves are
//! grouped in runs of consecutive last indices, so that a run is a dot product with the table of the last axis. All is
//! in double precision, with one opposite of each pair stored.

use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Powers exp(2 pi i k u) of one coordinate, k = -bound..=bound, from one sine and one cosine.
pub(super) struct Phasors {
    bound: i32,
    re: Vec<f64>,
    im: Vec<f64>,
}

impl Phasors {
    /// The powers at the coordinate `u` up to `bound`.
    /// `bound` is at least 0. `u` is reduced to a fraction of the period first, so that large coordinates lose nothing
    /// but their own rounding.
    pub fn new(u: f64, bound: i32) -> Self {
        let n = bound as usize;
        let (mut re, mut im) = (vec![1.0; 2 * n + 1], vec![0.0; 2 * n + 1]);
        let (s, c) = libm::sincos(TAU * (u - u.round()));
        for k in 1..=n {
            // Each power is the product of two powers of about half the exponent: the error grows with log k.
            let (a, b) = (n + k / 2, n + k - k / 2);
            (re[n + k], im[n + k]) = if k == 1 {
                (c, s)
            } else {
                (re[a] * re[b] - im[a] * im[b], re[a] * im[b] + im[a] * re[b])
            };
            re[n - k] = re[n + k];
            im[n - k] = -im[n + k];
        }
        Self { bound, re, im }
    }

    /// exp(2 pi i k u), for |k| up to the bound.
    #[inline]
    pub fn get(&self, k: i32) -> Complex64 {
        let n = (k + self.bound) as usize;
        Complex64::new(self.re[n], self.im[n])
    }
}

/// Number of lattice axes: six for series of the ball, whose lattice is icosahedral. Functions with fewer are padded.
pub(super) const AXES: usize = 6;
/// All axes but the last.
const LEADING_AXES: usize = AXES - 1;

/// A run of consecutive indices along the last axis: (leading.., from..from + len), with coefficients from `start` on.
struct Run {
    leading: [i32; LEADING_AXES],
    from: i32,
    start: usize,
    len: usize,
}

/// The sum over k of `C_k` exp(2 pi i k.u) with `C_{-k}` = conj `C_k`. One index of each pair is stored,
/// with doubled coefficients. Indices of functions with fewer axes are padded with leading zeros.
pub(super) struct TrigSum {
    runs: Vec<Run>,
    re: Vec<f64>,
    im: Vec<f64>,
    bounds: [i32; AXES],
    /// The first axis along which the function varies, at most the last but one.
    first_axis: usize,
}

/// The dot product with four partial sums, which the compiler can vectorise.
/// Both have the same length.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (ca, cb) = (a.chunks_exact(4), b.chunks_exact(4));
    let tail: f64 = ca
        .remainder()
        .iter()
        .zip(cb.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in ca.zip(cb) {
        for i in 0..4 {
            lanes[i] += x[i] * y[i];
        }
    }
    lanes.iter().sum::<f64>() + tail
}

impl TrigSum {
    /// From all indices with their coefficients (re, im); both members of each pair must be present.
    /// The order of `terms` does not matter; each index occurs once.
    pub fn new(mut terms: Vec<([i32; AXES], [f64; 2])>) -> Self {
        // The sum over all waves is real: C e_k + conj(C) e_-k = 2 Re(C e_k). One wave of each pair is kept,
        // with weight 2; k = 0 is its own opposite.
        terms.retain(|(k, c)| *k >= [0; AXES] && c.iter().any(|v| *v != 0.0));
        terms.sort_by_key(|t| t.0);
        let mut sum = Self {
            runs: Vec::new(),
            re: Vec::with_capacity(terms.len()),
            im: Vec::with_capacity(terms.len()),
            bounds: [0; AXES],
            first_axis: LEADING_AXES - 1,
        };
        for (k, c) in terms {
            let weight = if k == [0; AXES] { 1.0 } else { 2.0 };
            let start = sum.re.len();
            sum.re.push(c[0] * weight);
            sum.im.push(c[1] * weight);
            for a in 0..AXES {
                sum.bounds[a] = sum.bounds[a].max(k[a].abs());
            }
            // Waves with consecutive last indices form a run, along which the phasor advances.
            let leading: [i32; LEADING_AXES] = std::array::from_fn(|a| k[a]);
            match sum.runs.last_mut() {
                Some(r) if r.leading == leading && r.from + r.len as i32 == k[LEADING_AXES] => {
                    r.len += 1;
                }
                _ => sum.runs.push(Run {
                    leading,
                    from: k[LEADING_AXES],
                    start,
                    len: 1,
                }),
            }
        }
        // Leading axes on which all indices are 0 are skipped.
        let varies = sum.bounds.iter().position(|b| *b > 0);
        sum.first_axis = varies.unwrap_or(AXES).min(LEADING_AXES - 1);
        sum
    }

    /// Phasors along the leading axes from `first_axis` on, and along the last axis.
    /// The lists start at `first_axis`.
    fn tables(&self, u: [f64; AXES]) -> (Vec<Phasors>, Phasors) {
        let axes = self.first_axis..LEADING_AXES;
        let leading = axes.map(|a| Phasors::new(u[a], self.bounds[a])).collect();
        (
            leading,
            Phasors::new(u[LEADING_AXES], self.bounds[LEADING_AXES]),
        )
    }

    /// The product of the phasors along the leading axes, which all terms of a run share.
    /// At least one leading axis is in the tables.
    fn leading(&self, run: &Run, tables: &[Phasors]) -> Complex64 {
        let indices = &run.leading[self.first_axis..];
        let mut factor = tables[0].get(indices[0]);
        for (table, k) in tables[1..].iter().zip(&indices[1..]) {
            factor *= table.get(*k);
        }
        factor
    }

    /// Value at lattice coordinates `u`.
    /// `u` has as many coordinates as there are axes, the unused first.
    pub fn value(&self, u: [f64; AXES]) -> f64 {
        let (leading, z) = self.tables(u);
        let mut sum = 0.0;
        for r in &self.runs {
            let c = r.start..r.start + r.len;
            let from = (r.from + z.bound) as usize;
            let zr = from..from + r.len;
            let (cr, ci) = (&self.re[c.clone()], &self.im[c]);
            let (pr, pi) = (&z.re[zr.clone()], &z.im[zr]);
            let s = Complex64::new(dot(cr, pr) - dot(ci, pi), dot(cr, pi) + dot(ci, pr));
            sum += (self.leading(r, &leading) * s).re;
        }
        sum
    }

    /// Value and derivatives with respect to the lattice coordinates.
    /// The derivatives are per unit of `u`; along axes that do not vary they are 0.
    pub fn value_and_gradient(&self, u: [f64; AXES]) -> (f64, [f64; AXES]) {
        let (leading, z) = self.tables(u);
        // Phasors times their index, for the derivative along the last axis.
        let index = |p: &[f64]| -> Vec<f64> {
            p.iter()
                .zip(-z.bound..)
                .map(|(v, k)| v * f64::from(k))
                .collect()
        };
        let (kr, ki) = (index(&z.re), index(&z.im));
        let (mut sum, mut grad) = (0.0, [0.0; AXES]);
        for r in &self.runs {
            let c = r.start..r.start + r.len;
            let from = (r.from + z.bound) as usize;
            let zr = from..from + r.len;
            let (cr, ci) = (&self.re[c.clone()], &self.im[c]);
            let (pr, pi) = (&z.re[zr.clone()], &z.im[zr.clone()]);
            let (qr, qi) = (&kr[zr.clone()], &ki[zr]);
            let s = Complex64::new(dot(cr, pr) - dot(ci, pi), dot(cr, pi) + dot(ci, pr));
            let t = Complex64::new(dot(cr, qr) - dot(ci, qi), dot(cr, qi) + dot(ci, qr));
            let w = self.leading(r, &leading);
            // The derivative of Re(C e) along an axis is -2 pi k Im(C e); t is s with the last index as a factor.
            let part = w * s;
            sum += part.re;
            for a in self.first_axis..LEADING_AXES {
                grad[a] -= TAU * f64::from(r.leading[a]) * part.im;
            }
            grad[LEADING_AXES] -= TAU * (w * t).im;
        }
        (sum, grad)
    }
}
