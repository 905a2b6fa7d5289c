//! Levels along the way from one cell to another, at which the blend's volume is interpolated.

use crate::field::Interval;

/// Weights at which a level is tabulated, less one.
const STEPS: usize = 16;

/// Levels of the blend of two cells, at weights 0, 1/16 ... 1 of the second.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pair {
    pub levels: [f64; STEPS + 1],
}

impl Pair {
    /// Bernstein coefficients of the cubic from entry `i` to the next: entries are met, with the slope
    /// between their neighbours (at the ends 0, where pure cells keep their level).
    fn cubic(&self, i: usize) -> [f64; 4] {
        let slope = |j: usize| {
            if j == 0 || j == STEPS {
                0.0
            } else {
                (self.levels[j + 1] - self.levels[j - 1]) / 2.0
            }
        };
        let [a, b] = [self.levels[i], self.levels[i + 1]];
        [a, a + slope(i) / 3.0, b - slope(i + 1) / 3.0, b]
    }

    /// The level at a weight of the second cell, and its slope: both continuous.
    pub fn at(&self, w: f64) -> (f64, f64) {
        let t = w.clamp(0.0, 1.0) * STEPS as f64;
        let i = (t as usize).min(STEPS - 1);
        let c = self.cubic(i);
        let t = t - i as f64;
        let mix = |a: f64, b: f64| a + (b - a) * t;
        let [d, e, f] = [mix(c[0], c[1]), mix(c[1], c[2]), mix(c[2], c[3])];
        let [g, h] = [mix(d, e), mix(e, f)];
        (mix(g, h), 3.0 * (h - g) * STEPS as f64)
    }

    /// Contains the levels over a range of weights.
    pub fn range(&self, w: Interval) -> Interval {
        let place = |w: f64| ((w.clamp(0.0, 1.0) * STEPS as f64) as usize).min(STEPS - 1);
        let mut found = Interval::new(f64::INFINITY, f64::NEG_INFINITY);
        for c in (place(w.lo)..=place(w.hi)).flat_map(|i| self.cubic(i)) {
            found = found.hull(Interval::new(c, c));
        }
        found
    }

    /// A bound of the slope.
    pub fn steepest(&self) -> f64 {
        let steps = (0..STEPS).flat_map(|i| {
            let c = self.cubic(i);
            [0, 1, 2].map(|j| (c[j + 1] - c[j]).abs())
        });
        3.0 * steps.fold(0.0, f64::max) * STEPS as f64
    }

    /// A bound of the level.
    pub fn greatest(&self) -> f64 {
        let all = (0..STEPS).flat_map(|i| self.cubic(i));
        all.fold(0.0, |a, c| a.max(c.abs()))
    }
}

/// Levels that interpolate the volumes of two normalised cells, from their values at the same
/// points; none where there are no values.
pub(super) fn pair(a: &[f64], b: &[f64]) -> Pair {
    let mut pair = Pair::default();
    if a.len() != b.len() || a.len() < 2 {
        return pair;
    }
    let below = |v: &[f64]| v.iter().filter(|v| **v < 0.0).count() as f64;
    let ends = [below(a), below(b)];
    for (i, level) in pair.levels.iter_mut().enumerate() {
        // Pure cells keep their own level exactly.
        if i == 0 || i == STEPS {
            continue;
        }
        let w = i as f64 / STEPS as f64;
        let mut mixed: Vec<f64> = a
            .iter()
            .zip(b)
            .map(|(a, b)| a * (1.0 - w) + b * w)
            .collect();
        mixed.sort_unstable_by(f64::total_cmp);
        let wanted = ends[0] * (1.0 - w) + ends[1] * w;
        let rank = (wanted as usize).clamp(1, mixed.len() - 1);
        *level = f64::midpoint(mixed[rank - 1], mixed[rank]);
    }
    pair
}
