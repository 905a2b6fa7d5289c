//! Extremes of B-spline coefficients over ranges of spline cells: overlapping windows of many sizes.

/// Extremes of the coefficients that matter in a range of spline cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    /// Least coefficient.
    pub least: f32,
    /// Greatest coefficient.
    pub greatest: f32,
    /// Bound of the gradient's length, per spline cell.
    pub steepest: f32,
}

impl Range {
    const NOTHING: Self = Self {
        least: f32::INFINITY,
        greatest: f32::NEG_INFINITY,
        steepest: 0.0,
    };

    fn join(&mut self, other: &Self) {
        self.least = self.least.min(other.least);
        self.greatest = self.greatest.max(other.greatest);
        self.steepest = self.steepest.max(other.steepest);
    }
}

/// Windows of `width` spline cells per axis, one at every multiple of `stride`, wrapping around.
struct Level {
    width: usize,
    stride: usize,
    count: usize,
    windows: Vec<Range>,
}

impl Level {
    fn at(&self, i: usize, j: usize, k: usize) -> &Range {
        &self.windows[(i * self.count + j) * self.count + k]
    }
}

/// Windows that answer any box with a few look-ups, at most one stride too wide on each side.
pub(super) struct Pyramid {
    samples: usize,
    largest: f32,
    /// In ascending order of width; the last one holds everything.
    levels: Vec<Level>,
}

/// Look-ups that a query may cost before it takes wider windows.
const LOOK_UPS: usize = 64;

impl Pyramid {
    /// From padded coefficients, [samples + 3]^3, `samples` even.
    pub fn new(coefficients: &[f32], samples: usize) -> Self {
        let mut levels = vec![base(coefficients, samples)];
        while let Some(last) = levels.last() {
            let Some(next) = wider(last, samples) else {
                break;
            };
            levels.push(next);
        }
        let largest = coefficients.iter().fold(0f32, |m, c| m.max(c.abs()));
        Self {
            samples,
            largest,
            levels,
        }
    }

    /// Greatest magnitude of a coefficient.
    pub fn largest(&self) -> f32 {
        self.largest
    }

    pub fn bytes(&self) -> usize {
        self.levels
            .iter()
            .map(|l| l.windows.len() * size_of::<Range>())
            .sum()
    }

    /// Extremes over `count` spline cells per axis from `from` on, wrapping around.
    pub fn query(&self, from: [usize; 3], count: [usize; 3]) -> Range {
        // Per axis: windows from the last one that starts at or before the range.
        let cover = |l: &Level, a: usize| {
            if count[a] >= self.samples {
                return (0, self.samples.div_ceil(l.width));
            }
            let first = from[a] / l.stride;
            let span = from[a] + count[a] - first * l.stride;
            (first, span.div_ceil(l.width))
        };
        let least = count.into_iter().min().unwrap_or(1);
        let level = self
            .levels
            .iter()
            .rev()
            .find(|l| l.width <= least.max(self.levels[0].width))
            .map_or(0, |l| l.width);
        let Some(level) = self
            .levels
            .iter()
            .filter(|l| l.width >= level)
            .find(|l| (0..3).map(|a| cover(l, a).1).product::<usize>() <= LOOK_UPS)
            .or(self.levels.last())
        else {
            return Range::NOTHING;
        };
        let [(i0, ni), (j0, nj), (k0, nk)] = [0, 1, 2].map(|a| cover(level, a));
        // The last window of an axis may start earlier, so as to end with the range.
        let start = |a: usize, first: usize, n: usize, w: usize| {
            let plain = first * level.stride + w * level.width;
            let end = from[a] + count[a];
            let s = if w + 1 == n && w > 0 && count[a] < self.samples {
                end.saturating_sub(level.width)
                    .next_multiple_of(level.stride)
                    .min(plain)
            } else {
                plain
            };
            (s / level.stride) % level.count
        };
        let mut range = Range::NOTHING;
        for i in 0..ni {
            for j in 0..nj {
                for k in 0..nk {
                    range.join(level.at(
                        start(0, i0, ni, i),
                        start(1, j0, nj, j),
                        start(2, k0, nk, k),
                    ));
                }
            }
        }
        range
    }
}

/// Extremes over a block of `edge` spline cells per axis, straight from the padded coefficients.
pub(super) fn scan(c: &[f32], samples: usize, [x, y, z]: [usize; 3], edge: usize) -> Range {
    let (s, reach) = (samples + 3, edge + 3);
    let mut range = Range::NOTHING;
    let mut slope = [0f32; 3];
    for i in x..x + reach {
        for j in y..y + reach {
            for k in z..z + reach {
                let at = (i * s + j) * s + k;
                let v = c[at];
                range.least = range.least.min(v);
                range.greatest = range.greatest.max(v);
                if i < x + reach - 1 {
                    slope[0] = slope[0].max((c[at + s * s] - v).abs());
                }
                if j < y + reach - 1 {
                    slope[1] = slope[1].max((c[at + s] - v).abs());
                }
                if k < z + reach - 1 {
                    slope[2] = slope[2].max((c[at + 1] - v).abs());
                }
            }
        }
    }
    range.steepest = slope.iter().map(|d| d * d).sum::<f32>().sqrt();
    range
}

/// Windows of two spline cells, side by side.
fn base(coefficients: &[f32], samples: usize) -> Level {
    use rayon::prelude::*;
    let count = samples / 2;
    let mut windows = vec![Range::NOTHING; count * count * count];
    windows
        .par_chunks_mut(count * count)
        .enumerate()
        .for_each(|(i, plane)| {
            for (jk, window) in plane.iter_mut().enumerate() {
                let (j, k) = (jk / count, jk % count);
                *window = scan(coefficients, samples, [2 * i, 2 * j, 2 * k], 2);
            }
        });
    Level {
        width: 2,
        stride: 2,
        count,
        windows,
    }
}

/// Windows twice as wide; their stride doubles once they overlap by three quarters.
fn wider(last: &Level, samples: usize) -> Option<Level> {
    let width = 2 * last.width;
    if last.width >= samples {
        return None;
    }
    let coarser = last.width >= 4 * last.stride && last.count % 2 == 0;
    let step = if coarser { 2 } else { 1 };
    let count = last.count / step;
    let half = last.width / last.stride;
    let mut windows = Vec::with_capacity(count * count * count);
    for i in 0..count {
        for j in 0..count {
            for k in 0..count {
                let mut window = Range::NOTHING;
                for d in 0..8 {
                    let at = |c: usize, bit: usize| (c * step + (d >> bit & 1) * half) % last.count;
                    window.join(last.at(at(i, 2), at(j, 1), at(k, 0)));
                }
                windows.push(window);
            }
        }
    }
    Some(Level {
        width,
        stride: last.stride * step,
        count,
        windows,
    })
}
