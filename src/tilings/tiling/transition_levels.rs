//! Levels of the blend of two cells at which its volume is interpolated linearly.
//!
//! The level of a weight is the quantile of the blended values at which the solid fraction is that of the
//! interpolation. Between the tabulated weights a cubic keeps level and slope continuous, and its Bernstein
//! coefficients bound both.

use druse_geometry::field::Interval;

/// Intervals between tabulated weights.
const INTERVALS: usize = 16;

/// Levels of the blend of two cells, at weights 0, 1/16 ... 1 of the second.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TransitionLevels {
    pub levels: [f64; INTERVALS + 1],
}

impl TransitionLevels {
    /// Bernstein coefficients of the cubic from entry `i` to the next. It interpolates the entries; its slope
    /// there is that between the neighbours, and 0 at both ends, where pure cells keep their level.
    fn cubic(&self, i: usize) -> [f64; 4] {
        let slope = |j: usize| {
            if j == 0 || j == INTERVALS {
                0.0
            } else {
                (self.levels[j + 1] - self.levels[j - 1]) / 2.0
            }
        };
        let [a, b] = [self.levels[i], self.levels[i + 1]];
        [a, a + slope(i) / 3.0, b - slope(i + 1) / 3.0, b]
    }

    /// The level at a weight of the second cell, and its slope; both are continuous.
    pub fn at(&self, w: f64) -> (f64, f64) {
        let t = w.clamp(0.0, 1.0) * INTERVALS as f64;
        let i = (t as usize).min(INTERVALS - 1);
        let c = self.cubic(i);
        let t = t - i as f64;
        let mix = |a: f64, b: f64| a + (b - a) * t;
        let [d, e, f] = [mix(c[0], c[1]), mix(c[1], c[2]), mix(c[2], c[3])];
        let [g, h] = [mix(d, e), mix(e, f)];
        (mix(g, h), 3.0 * (h - g) * INTERVALS as f64)
    }

    /// Contains the levels over a range of weights.
    pub fn range(&self, w: Interval) -> Interval {
        let interval =
            |w: f64| ((w.clamp(0.0, 1.0) * INTERVALS as f64) as usize).min(INTERVALS - 1);
        let mut found = Interval::new(f64::INFINITY, f64::NEG_INFINITY);
        for c in (interval(w.lo)..=interval(w.hi)).flat_map(|i| self.cubic(i)) {
            found = found.hull(Interval::new(c, c));
        }
        found
    }

    /// A bound of the slope.
    pub fn max_slope(&self) -> f64 {
        let steps = (0..INTERVALS).flat_map(|i| {
            let c = self.cubic(i);
            [0, 1, 2].map(|j| (c[j + 1] - c[j]).abs())
        });
        3.0 * steps.fold(0.0, f64::max) * INTERVALS as f64
    }

    /// A bound of the level.
    pub fn max_level(&self) -> f64 {
        let all = (0..INTERVALS).flat_map(|i| self.cubic(i));
        all.fold(0.0, |a, c| a.max(c.abs()))
    }
}

/// The levels that interpolate the volumes of two normalised cells, from their values at the same points; zeros if the
/// lists differ in length or have fewer than two values. Values below 0 are solid.
pub(super) fn transition_levels(a: &[f64], b: &[f64]) -> TransitionLevels {
    let mut levels = TransitionLevels::default();
    if a.len() != b.len() || a.len() < 2 {
        return levels;
    }
    let below = |v: &[f64]| v.iter().filter(|v| **v < 0.0).count() as f64;
    let ends = [below(a), below(b)];
    for (i, level) in levels.levels.iter_mut().enumerate() {
        // Pure cells keep their own level exactly.
        if i == 0 || i == INTERVALS {
            continue;
        }
        let w = i as f64 / INTERVALS as f64;
        let mut mixed: Vec<f64> = a
            .iter()
            .zip(b)
            .map(|(a, b)| a * (1.0 - w) + b * w)
            .collect();
        mixed.sort_unstable_by(f64::total_cmp);
        let target = ends[0] * (1.0 - w) + ends[1] * w;
        // Half way between the last of the wanted number of lowest values and the next one.
        let rank = (target as usize).clamp(1, mixed.len() - 1);
        *level = f64::midpoint(mixed[rank - 1], mixed[rank]);
    }
    levels
}
