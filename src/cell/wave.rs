//! Exact evaluation of a real trigonometric sum from phasor tables, one table per lattice axis.

use std::f64::consts::TAU;

/// Powers exp(2 pi i k u) of one coordinate, k = -bound..=bound, computed by one sine and cosine.
pub(super) struct Phasors {
    bound: i32,
    re: Vec<f64>,
    im: Vec<f64>,
}

impl Phasors {
    pub fn new(u: f64, bound: i32) -> Self {
        let n = bound as usize;
        let (mut re, mut im) = (vec![1.0; 2 * n + 1], vec![0.0; 2 * n + 1]);
        let (s, c) = (TAU * (u - u.round())).sin_cos();
        for k in 1..=n {
            // The power as a product of two halves: the error grows with log k, not with k.
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

    pub fn get(&self, k: i32) -> (f64, f64) {
        let n = (k + self.bound) as usize;
        (self.re[n], self.im[n])
    }
}

/// Consecutive indices along the last axis: (first, second, from..).
struct Run {
    first: i32,
    second: i32,
    from: i32,
    start: usize,
    len: usize,
}

/// The sum over k of `C_k` exp(2 pi i k.u) with `C_{-k}` = conj `C_k`, stored by one of each pair, the
/// pair's coefficients doubled. Planar sums have a zero first axis.
pub(super) struct Waves {
    runs: Vec<Run>,
    re: Vec<f64>,
    im: Vec<f64>,
    bounds: [i32; 3],
}

/// Products in four lanes, so that the order of sums does not hinder vector instructions.
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

impl Waves {
    /// From every index with its coefficient (re, im); both members of a pair must be given.
    pub fn new(mut terms: Vec<([i32; 3], [f64; 2])>) -> Self {
        terms.retain(|(k, c)| *k >= [0; 3] && c.iter().any(|v| *v != 0.0));
        terms.sort_by_key(|t| t.0);
        let mut waves = Self {
            runs: Vec::new(),
            re: Vec::with_capacity(terms.len()),
            im: Vec::with_capacity(terms.len()),
            bounds: [0; 3],
        };
        for (k, c) in terms {
            let weight = if k == [0; 3] { 1.0 } else { 2.0 };
            let start = waves.re.len();
            waves.re.push(c[0] * weight);
            waves.im.push(c[1] * weight);
            for a in 0..3 {
                waves.bounds[a] = waves.bounds[a].max(k[a].abs());
            }
            match waves.runs.last_mut() {
                Some(r) if [r.first, r.second, r.from + r.len as i32] == k => r.len += 1,
                _ => waves.runs.push(Run {
                    first: k[0],
                    second: k[1],
                    from: k[2],
                    start,
                    len: 1,
                }),
            }
        }
        waves
    }

    fn tables(&self, u: [f64; 3]) -> [Phasors; 3] {
        std::array::from_fn(|a| Phasors::new(u[a], self.bounds[a]))
    }

    /// Value at lattice coordinates u.
    pub fn value(&self, u: [f64; 3]) -> f64 {
        let [x, y, z] = self.tables(u);
        let mut sum = 0.0;
        for r in &self.runs {
            let c = r.start..r.start + r.len;
            let from = (r.from + z.bound) as usize;
            let zr = from..from + r.len;
            let (cr, ci) = (&self.re[c.clone()], &self.im[c]);
            let (pr, pi) = (&z.re[zr.clone()], &z.im[zr]);
            let s = (dot(cr, pr) - dot(ci, pi), dot(cr, pi) + dot(ci, pr));
            let (a, b) = (x.get(r.first), y.get(r.second));
            let w = (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
            sum += w.0 * s.0 - w.1 * s.1;
        }
        sum
    }

    /// Value and derivatives with respect to lattice coordinates.
    pub fn value_and_gradient(&self, u: [f64; 3]) -> (f64, [f64; 3]) {
        let [x, y, z] = self.tables(u);
        // The phasors times their index: the derivative along the last axis.
        let index = |p: &[f64]| -> Vec<f64> {
            p.iter()
                .zip(-z.bound..)
                .map(|(v, k)| v * f64::from(k))
                .collect()
        };
        let (kr, ki) = (index(&z.re), index(&z.im));
        let (mut sum, mut grad) = (0.0, [0.0; 3]);
        for r in &self.runs {
            let c = r.start..r.start + r.len;
            let from = (r.from + z.bound) as usize;
            let zr = from..from + r.len;
            let (cr, ci) = (&self.re[c.clone()], &self.im[c]);
            let (pr, pi) = (&z.re[zr.clone()], &z.im[zr.clone()]);
            let (qr, qi) = (&kr[zr.clone()], &ki[zr]);
            let s = (dot(cr, pr) - dot(ci, pi), dot(cr, pi) + dot(ci, pr));
            let t = (dot(cr, qr) - dot(ci, qi), dot(cr, qi) + dot(ci, qr));
            let (a, b) = (x.get(r.first), y.get(r.second));
            let w = (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
            sum += w.0 * s.0 - w.1 * s.1;
            let imaginary = w.0 * s.1 + w.1 * s.0;
            grad[0] -= TAU * f64::from(r.first) * imaginary;
            grad[1] -= TAU * f64::from(r.second) * imaginary;
            grad[2] -= TAU * (w.0 * t.1 + w.1 * t.0);
        }
        (sum, grad)
    }
}
