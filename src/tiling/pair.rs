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
    /// The level at a weight of the second cell, and its slope.
    pub fn at(&self, w: f64) -> (f64, f64) {
        let t = w.clamp(0.0, 1.0) * STEPS as f64;
        let i = (t as usize).min(STEPS - 1);
        let slope = self.levels[i + 1] - self.levels[i];
        (
            self.levels[i] + slope * (t - i as f64),
            slope * STEPS as f64,
        )
    }

    /// Levels over a range of weights.
    pub fn range(&self, w: Interval) -> Interval {
        let mut found = Interval::new(self.at(w.lo).0, self.at(w.lo).0);
        let inner = (0..=STEPS).map(|i| i as f64 / STEPS as f64);
        for w in inner.filter(|&t| w.contains(t)).chain([w.hi]) {
            let v = self.at(w).0;
            found = found.hull(Interval::new(v, v));
        }
        found
    }

    /// The greatest slope.
    pub fn steepest(&self) -> f64 {
        let steps = self.levels.windows(2).map(|p| (p[1] - p[0]).abs());
        steps.fold(0.0, f64::max) * STEPS as f64
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
