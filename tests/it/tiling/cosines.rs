//! Cells in closed form: sums of products of cosines, with exact ranges over boxes.

use crate::strategy::{self, Noise};
use druse::field::{Field, Interval};
use druse::frame::{CellBox, CellPoint, Element, Vec3};
use druse::tiling::CellField;
use std::f64::consts::TAU;

/// sum a (cos kX cos lY cos mZ over the permutations of k, l, m) - level: any such sum has the full
/// symmetry of the cube and of the tetrahedron.
pub struct Cosines {
    element: Element,
    terms: Vec<([f64; 3], f64)>,
    level: f64,
}

impl Cosines {
    pub fn new(element: Element, orbits: &[([u32; 3], f64)], level: f64) -> Self {
        let mut terms = Vec::new();
        for &([k, l, m], a) in orbits {
            let mut all = vec![
                [k, l, m],
                [l, m, k],
                [m, k, l],
                [l, k, m],
                [m, l, k],
                [k, m, l],
            ];
            all.sort_unstable();
            all.dedup();
            terms.extend(all.into_iter().map(|f| (f.map(f64::from), a)));
        }
        Self {
            element,
            terms,
            level,
        }
    }

    pub fn schwarz_p(element: Element, level: f64) -> Self {
        Self::new(element, &[([1, 0, 0], 1.0)], level)
    }

    pub fn random(element: Element, noise: &mut Noise) -> Self {
        let orbits: Vec<_> = [[1, 0, 0], [1, 1, 0], [1, 1, 1], [2, 0, 0], [2, 1, 0]]
            .into_iter()
            .map(|f| (f, noise.signed() / f64::from(f.iter().sum::<u32>())))
            .collect();
        Self::new(element, &orbits, 0.5 * noise.signed())
    }
}

/// The range of cos over an interval of its argument in turns.
fn cos_range(lo: f64, hi: f64) -> Interval {
    let (a, b) = ((TAU * lo).cos(), (TAU * hi).cos());
    let mut range = Interval::new(a.min(b), a.max(b));
    if hi.floor() >= lo {
        range.hi = 1.0;
    }
    if (hi - 0.5).floor() + 0.5 >= lo {
        range.lo = -1.0;
    }
    range
}

fn times(a: Interval, b: Interval) -> Interval {
    let all = [a.lo * b.lo, a.lo * b.hi, a.hi * b.lo, a.hi * b.hi];
    Interval::new(
        all.into_iter().fold(f64::INFINITY, f64::min),
        all.into_iter().fold(f64::NEG_INFINITY, f64::max),
    )
}

impl Field for Cosines {
    type Point = CellPoint<3>;
    fn value(&self, p: CellPoint<3>) -> f64 {
        let sum: f64 = self
            .terms
            .iter()
            .map(|(f, a)| a * (0..3).map(|i| (TAU * f[i] * p.0[i]).cos()).product::<f64>())
            .sum();
        sum - self.level
    }
    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        let mut gradient = Vec3::zeros();
        for (f, a) in &self.terms {
            let c = [0, 1, 2].map(|i| (TAU * f[i] * p.0[i]).cos());
            let s = [0, 1, 2].map(|i| -TAU * f[i] * (TAU * f[i] * p.0[i]).sin());
            gradient += Vec3::new(s[0] * c[1] * c[2], c[0] * s[1] * c[2], c[0] * c[1] * s[2]) * *a;
        }
        (self.value(p), gradient)
    }
    fn bound(&self, region: &CellBox<3>) -> Interval {
        let mut sum = Interval::new(-self.level, -self.level);
        for (f, a) in &self.terms {
            let mut product = Interval::new(*a, *a);
            for i in 0..3 {
                let c = cos_range(f[i] * region.min[i], f[i] * region.max[i]);
                product = times(product, c);
            }
            sum = Interval::new(sum.lo + product.lo, sum.hi + product.hi);
        }
        // Rounding of the sum.
        Interval::new(sum.lo - 1e-12, sum.hi + 1e-12)
    }
}

impl CellField for Cosines {
    fn element(&self) -> Element {
        self.element
    }
    fn gradient_sup(&self) -> f64 {
        self.terms
            .iter()
            .map(|(f, a)| a.abs() * TAU * Vec3::from(*f).norm())
            .sum()
    }
    fn gradient_rms(&self) -> f64 {
        let mut noise = Noise::new(3);
        let squares: f64 = (0..2000)
            .map(|_| {
                let p = strategy::cell_point(self.element, &mut noise);
                self.value_and_gradient(p).1.norm_squared()
            })
            .sum();
        (squares / 2000.0).sqrt()
    }
}
