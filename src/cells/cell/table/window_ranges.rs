//! Range queries on a spline: overlapping windows of all sizes, each with the range of its spline cells.
//!
//! A query takes a box of spline cells and joins a few windows that cover it, at most [`MAX_LOOK_UPS`]. The result is
//! an outer bound: windows may reach over the box, and ranges are rounded outwards to 16-bit steps. Bounds of gradients
//! are lengths per unit of reference length.

use super::grid::Grid;
use super::hull::{CELLS_PER_BATCH, cell_ranges};

/// Range of a spline over a set of spline cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    /// Lower bound of the values.
    pub least: f32,
    /// Upper bound of the values.
    pub greatest: f32,
    /// Bound of the gradient's length, per unit of reference length.
    pub max_slope: f32,
}

impl Range {
    pub(super) const JOIN_IDENTITY: Self = Self {
        least: f32::INFINITY,
        greatest: f32::NEG_INFINITY,
        max_slope: 0.0,
    };

    fn join(&mut self, other: &Self) {
        self.least = self.least.min(other.least);
        self.greatest = self.greatest.max(other.greatest);
        self.max_slope = self.max_slope.max(other.max_slope);
    }
}

/// Quantization steps from 0 to the largest stored number.
const QUANTIZATION_STEPS: f32 = 32_000.0;

/// A range in quantization steps, rounded outwards: - least, greatest, `max_slope`.
#[derive(Clone, Copy)]
struct Window([i16; 4]);

impl Window {
    const JOIN_IDENTITY: Self = Self([i16::MIN, i16::MIN, 0, 0]);

    #[inline]
    fn join(&mut self, other: Self) {
        for (a, b) in self.0.iter_mut().zip(other.0) {
            *a = (*a).max(b);
        }
    }
}

/// The size of a quantization step, for values and for the gradient's length.
#[derive(Clone, Copy)]
struct Units {
    value: f32,
    slope: f32,
}

/// Numbers that are all 0 get the step 1.
impl Units {
    /// Units for numbers up to these.
    fn new(largest: f32, max_slope: f32) -> Self {
        let unit = |most: f32| {
            if most > 0.0 {
                most / QUANTIZATION_STEPS
            } else {
                1.0
            }
        };
        Self {
            value: unit(largest),
            slope: unit(max_slope),
        }
    }

    /// Rounded outwards. The numbers are at most those of [`Units::new`].
    fn window(self, range: &Range) -> Window {
        let steps = |v: f32, unit: f32| (v / unit).ceil() as i16;
        Window([
            steps(-range.least, self.value),
            steps(range.greatest, self.value),
            steps(range.max_slope, self.slope),
            0,
        ])
    }

    /// The range that the quantized numbers enclose.
    fn range(self, Window([least, greatest, max_slope, _]): Window) -> Range {
        Range {
            least: -f32::from(least) * self.value,
            greatest: f32::from(greatest) * self.value,
            max_slope: f32::from(max_slope) * self.slope,
        }
    }
}

/// Windows of `width` spline cells per axis, one at every multiple of the stride of the axis, with periodic
/// wrap-around.
struct Level {
    width: usize,
    stride: [usize; 3],
    count: [usize; 3],
    windows: Vec<Window>,
}

impl Level {
    /// The window that starts at these numbers of strides.
    fn at(&self, i: usize, j: usize, k: usize) -> Window {
        self.windows[(i * self.count[1] + j) * self.count[2] + k]
    }
}

/// Windows of all sizes. A few of them cover any box; over a flat box they reach by up to their width.
pub(super) struct WindowRanges {
    samples: [usize; 3],
    largest: f32,
    units: Units,
    /// In ascending order of width; a window of the last level covers the whole period.
    levels: Vec<Level>,
}

/// Maximal number of window look-ups per query, four per axis, beyond which wider windows are used.
const MAX_LOOK_UPS: usize = 64;

impl WindowRanges {
    /// The windows over the padded coefficients of a grid.
    pub fn new(coefficients: &[f32], grid: &Grid) -> Self {
        let largest = coefficients.iter().fold(0f32, |m, c| m.max(c.abs()));
        let (units, base) = base(coefficients, grid, largest);
        let mut levels = vec![base];
        while let Some(last) = levels.last() {
            let Some(next) = wider(last, grid.samples) else {
                break;
            };
            levels.push(next);
        }
        Self {
            samples: grid.samples,
            largest,
            units,
            levels,
        }
    }

    /// Largest magnitude of a coefficient.
    pub fn largest(&self) -> f32 {
        self.largest
    }

    /// Memory of the windows in bytes.
    pub fn bytes(&self) -> usize {
        self.levels
            .iter()
            .map(|l| size_of_val(l.windows.as_slice()))
            .sum()
    }

    /// Range over `count` spline cells per axis from `from` on, with periodic wrap-around.
    /// `from` is below the samples of each axis, each count at least 1. Values and slopes are outer bounds. Counts of at
    /// least the samples of an axis take the whole period.
    pub fn query(&self, from: [usize; 3], count: [usize; 3]) -> Range {
        // Widths and strides are powers of 2, so that shifts replace divisions. Per axis: the last window
        // that starts at or before the range, and the number of windows from there.
        let cover = |l: &Level, a: usize| {
            let by = l.width.trailing_zeros();
            if count[a] >= self.samples[a] {
                return (0, (self.samples[a] + l.width - 1) >> by);
            }
            let stride = l.stride[a].trailing_zeros();
            let first = from[a] >> stride;
            let span = from[a] + count[a] - (first << stride);
            (first, (span + l.width - 1) >> by)
        };
        // The widest windows that no axis of the box exceeds need the fewest look-ups without reaching far over it; a
        // flat box may need wider ones to stay within `MAX_LOOK_UPS`. An axis of one sample (planar) has no extent.
        let varies = (0..3).filter(|&a| self.samples[a] > 1);
        let least = varies.map(|a| count[a]).min().unwrap_or(1);
        let fits = |l: &Level| l.width <= least.max(self.levels[0].width);
        let first = self.levels.iter().rposition(fits).unwrap_or(0);
        let Some(level) = self.levels[first..]
            .iter()
            .find(|l| cover(l, 0).1 * cover(l, 1).1 * cover(l, 2).1 <= MAX_LOOK_UPS)
            .or(self.levels.last())
        else {
            return Range::JOIN_IDENTITY;
        };
        let [(i0, ni), (j0, nj), (k0, nk)] = [cover(level, 0), cover(level, 1), cover(level, 2)];
        // The last window of an axis may start earlier, so that it ends with the range.
        let start = |a: usize, first: usize, n: usize, w: usize| {
            let stride = level.stride[a].trailing_zeros();
            let unshifted = (first << stride) + w * level.width;
            let end = from[a] + count[a];
            let place = if w + 1 == n && w > 0 && count[a] < self.samples[a] {
                // Rounded up to a multiple of the stride, a power of two.
                let up = level.stride[a] - 1;
                unshifted.min((end.saturating_sub(level.width) + up) & !up)
            } else {
                unshifted
            };
            let at = place >> stride;
            // The start is at most one period beyond the first window.
            if at < level.count[a] {
                at
            } else {
                at - level.count[a]
            }
        };
        let mut window = Window::JOIN_IDENTITY;
        for i in 0..ni {
            let i = start(0, i0, ni, i);
            for j in 0..nj {
                let j = start(1, j0, nj, j);
                for k in 0..nk {
                    window.join(level.at(i, j, start(2, k0, nk, k)));
                }
            }
        }
        self.units.range(window)
    }
}

/// The adjacent windows of two spline cells, and their units.
/// Two along each axis, so that a window has the range of up to eight cells.
fn base(coefficients: &[f32], grid: &Grid, largest: f32) -> (Units, Level) {
    use rayon::prelude::*;
    // Windows of two cells per axis, side by side: numbers of samples are even, or 1 (planar). A task has one plane of
    // windows, hence two planes of cells.
    let count = grid.samples.map(|n| n.div_ceil(2));
    let plane_size = count[1] * count[2];
    let mut ranges = vec![Range::JOIN_IDENTITY; count[0] * plane_size];
    ranges
        .par_chunks_mut(plane_size)
        .enumerate()
        .for_each(|(i, plane)| {
            let [nx, ny, nz] = grid.samples;
            for x in (2 * i..2 * i + 2).filter(|&x| x < nx) {
                // Ranges of eight cells along z at a time; those beyond the end of the row are dropped.
                for (y, z) in
                    (0..ny).flat_map(|y| (0..nz).step_by(CELLS_PER_BATCH).map(move |z| (y, z)))
                {
                    let all = cell_ranges(coefficients, grid, [x, y, z]);
                    for (z, own) in (z..nz).zip(&all) {
                        plane[y / 2 * count[2] + z / 2].join(own);
                    }
                }
            }
        });
    // The unit of slopes is known only after all ranges are: the largest number has the most quantization steps.
    let max_slope = ranges.iter().fold(0f32, |m, r| m.max(r.max_slope));
    let units = Units::new(largest, max_slope);
    let level = Level {
        width: 2,
        stride: [2; 3],
        count,
        windows: ranges.iter().map(|r| units.window(r)).collect(),
    };
    (units, level)
}

/// Windows of twice the width. The stride of an axis doubles where windows overlap by three quarters and are even.
/// `None` once a window covers the longest axis.
fn wider(last: &Level, samples: [usize; 3]) -> Option<Level> {
    let width = 2 * last.width;
    // A window as wide as the longest axis covers the whole period.
    if samples.into_iter().all(|n| last.width >= n) {
        return None;
    }
    // Wide windows need few starts: once four of them overlap everywhere, every second start is dropped; an odd number
    // of them would not close the period.
    let step = [0, 1, 2].map(|a| {
        let coarser = last.width >= 4 * last.stride[a] && last.count[a].is_multiple_of(2);
        if coarser { 2 } else { 1 }
    });
    let count = [0, 1, 2].map(|a| last.count[a] / step[a]);
    let half = [0, 1, 2].map(|a| last.width / last.stride[a]);
    let mut windows = Vec::with_capacity(count.iter().product());
    for i in 0..count[0] {
        for j in 0..count[1] {
            for k in 0..count[2] {
                let mut window = Window::JOIN_IDENTITY;
                // A window of twice the width is the union of eight windows, which start half of it apart
                // along each axis.
                for d in 0..8 {
                    let at = |c: usize, a: usize| {
                        (c * step[a] + (d >> (2 - a) & 1) * half[a]) % last.count[a]
                    };
                    window.join(last.at(at(i, 0), at(j, 1), at(k, 2)));
                }
                windows.push(window);
            }
        }
    }
    Some(Level {
        width,
        stride: [0, 1, 2].map(|a| last.stride[a] * step[a]),
        count,
        windows,
    })
}
