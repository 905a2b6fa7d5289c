//! Shares of solid in voxels, from samples of a field: differentiable by every sample.
//!
//! Each voxel is divided into f^3 parts with one sample at the centre. Within a part the field is linear with the
//! gradient from central differences, so that the share below the level is the volume of a cube cut by a plane,
//! in closed form. A sheet is the difference of two such shares, which includes walls thinner than a part.

use super::HomogenizeError;
use super::grid::Grid;
use druse_cells::cell::Solid;
use druse_geometry::field::cube_share;
use rayon::prelude::*;

/// Samples of a field over a period.
#[derive(Clone, Debug)]
pub struct Samples {
    grid: Grid,
    /// Samples along each edge of a voxel.
    fineness: usize,
    values: Vec<f64>,
    solid: Solid,
    level: f64,
}

/// A share of solid, from 0 to 1, with its derivatives by the field's value, its slopes (the rise over one part along
/// each axis) and the level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Share {
    pub value: f64,
    pub by_value: f64,
    pub by_slope: [f64; 3],
    pub by_level: f64,
}

/// The share of solid in a part with this value at its centre and this slope (the rise over one part along each axis).
pub(super) fn part(solid: Solid, level: f64, value: f64, slope: [f64; 3]) -> Share {
    // The share below `level`, times `sign`. `rise` is the derivative of that level by the level of the solid, -1
    // for the lower wall of a sheet or channels.
    let one = |level: f64, sign: f64, rise: f64| {
        let (share, by_height, by_slope) = cube_share(level - value, slope);
        Share {
            value: sign * share,
            by_value: -sign * by_height,
            by_slope: by_slope.map(|s| sign * s),
            by_level: sign * rise * by_height,
        }
    };
    let sum = |a: Share, b: Share, constant: f64| Share {
        value: constant + a.value + b.value,
        by_value: a.by_value + b.by_value,
        by_slope: std::array::from_fn(|i| a.by_slope[i] + b.by_slope[i]),
        by_level: a.by_level + b.by_level,
    };
    match solid {
        Solid::Below => one(level, 1.0, 1.0),
        Solid::Above => sum(one(level, -1.0, 1.0), Share::default(), 1.0),
        Solid::Sheet => sum(one(level, 1.0, 1.0), one(-level, -1.0, -1.0), 0.0),
        Solid::Channels => sum(one(level, -1.0, 1.0), one(-level, 1.0, -1.0), 1.0),
    }
}

impl Samples {
    /// Samples of a field on a grid with `fineness` samples along each edge of a voxel (one along z of a
    /// planar grid), z fastest.
    ///
    /// # Errors
    /// [`HomogenizeError::Grid`] for another number of values, or values that are not finite.
    pub fn new(
        grid: Grid,
        fineness: usize,
        values: Vec<f64>,
        solid: Solid,
        level: f64,
    ) -> Result<Self, HomogenizeError> {
        let samples = Self {
            grid,
            fineness,
            values,
            solid,
            level,
        };
        let expected: usize = samples.counts().iter().product();
        if samples.values.len() != expected {
            return Err(HomogenizeError::Grid(format!(
                "found {} samples; expected {expected}",
                samples.values.len()
            )));
        }
        // A value that is not finite would spread through the transforms over the whole period.
        if let Some(n) = samples.values.iter().position(|v| !v.is_finite()) {
            return Err(HomogenizeError::Grid(format!(
                "found {} at sample {n}; expected finite values",
                samples.values[n]
            )));
        }
        Ok(samples)
    }

    /// The voxels.
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// Samples along each edge of a voxel.
    pub fn fineness(&self) -> usize {
        self.fineness
    }

    /// Which side of the level is solid.
    pub fn solid(&self) -> Solid {
        self.solid
    }

    /// The level.
    pub fn level(&self) -> f64 {
        self.level
    }

    /// The same samples at another level.
    #[must_use]
    pub fn with_level(self, level: f64) -> Self {
        Self { level, ..self }
    }

    /// Samples along each axis.
    pub(super) fn counts(&self) -> [usize; 3] {
        fine_counts(self.grid, self.fineness)
    }

    /// Value at a sample.
    pub(super) fn value(&self, [i, j, k]: [usize; 3]) -> f64 {
        let [_, ny, nz] = self.counts();
        self.values[(i * ny + j) * nz + k]
    }

    /// The neighbours of a sample along an axis, before and after, across the periodic sides.
    pub(super) fn neighbours(&self, at: [usize; 3], axis: usize) -> [[usize; 3]; 2] {
        let n = self.counts()[axis];
        let moved = |by: usize| {
            let mut other = at;
            other[axis] = (at[axis] + by) % n;
            other
        };
        [moved(n - 1), moved(1)]
    }

    /// Slopes at a sample: the rise over one part along each axis, by central differences.
    pub(super) fn slope(&self, at: [usize; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let [before, after] = self.neighbours(at, axis);
            (self.value(after) - self.value(before)) / 2.0
        })
    }

    /// The parts of a voxel, by their indices among all samples.
    pub(super) fn parts(&self, [i, j, k]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> + use<> {
        let f = self.fineness;
        let deep = if self.grid.is_planar() { 1 } else { f };
        (0..f * f * deep).map(move |n| {
            let [a, b, c] = [n / (f * deep), n / deep % f, n % deep];
            [i * f + a, j * f + b, k * deep + c]
        })
    }

    /// The share of solid in each voxel, from 0 to 1, z fastest.
    pub fn shares(&self) -> Vec<f64> {
        let level = self.level;
        let [_, ny, nz] = self.grid.counts();
        let count = self.parts([0; 3]).count() as f64;
        let mut shares = vec![0.0; self.grid.voxels()];
        shares
            .par_chunks_mut(ny * nz)
            .enumerate()
            .for_each(|(i, layer)| {
                for (n, share) in layer.iter_mut().enumerate() {
                    let at = [i, n / nz, n % nz];
                    let sum: f64 = self
                        .parts(at)
                        .map(|p| part(self.solid, level, self.value(p), self.slope(p)).value)
                        .sum();
                    *share = (sum / count).clamp(0.0, 1.0);
                }
            });
        shares
    }

    /// The share of solid in the whole period.
    pub fn volume_fraction(&self) -> f64 {
        mean(&self.shares())
    }

    /// The level at which the solid has a given share of the period, by Newton steps within a bisection; at most 60
    /// steps, and then the last level. For a symmetric solid it is not negative.
    ///
    /// # Errors
    /// [`HomogenizeError::Fraction`] unless 0 < `fraction` < 1.
    pub fn level_for_volume_fraction(&self, fraction: f64) -> Result<f64, HomogenizeError> {
        if !(fraction > 0.0 && fraction < 1.0) {
            return Err(HomogenizeError::Fraction(fraction));
        }
        let ends = self
            .values
            .iter()
            .fold([f64::MAX, f64::MIN], |[lo, hi], v| [lo.min(*v), hi.max(*v)]);
        // Between these levels the share runs from 0 to 1, nearly; a symmetric solid depends on |value| alone.
        let [mut low, mut high] = if self.solid.is_symmetric() {
            [0.0, ends[0].abs().max(ends[1].abs())]
        } else {
            ends
        };
        let grows = matches!(self.solid, Solid::Below | Solid::Sheet);
        let mut level = f64::midpoint(low, high);
        for _ in 0..60 {
            let (found, rate) = self.fraction_at(level);
            // The side of the bracket depends on whether the solid grows or shrinks with its level.
            if (found < fraction) == grows {
                low = level;
            } else {
                high = level;
            }
            // A Newton step that leaves the bracket, or divides by 0, gives way to bisection. Steps of 1e-13 are rounding.
            let newton = level - (found - fraction) / rate;
            let next = if newton > low && newton < high {
                newton
            } else {
                f64::midpoint(low, high)
            };
            if (next - level).abs() <= 1e-13 * (ends[1] - ends[0]) || high <= low {
                return Ok(next);
            }
            level = next;
        }
        Ok(level)
    }

    /// The share of solid in the period at a level, and its derivative by the level.
    fn fraction_at(&self, level: f64) -> (f64, f64) {
        let [nx, ny, nz] = self.counts();
        let layers: Vec<[f64; 2]> = (0..nx)
            .into_par_iter()
            .map(|i| {
                let mut sum = [0.0; 2];
                for n in 0..ny * nz {
                    let at = [i, n / nz, n % nz];
                    let own = part(self.solid, level, self.value(at), self.slope(at));
                    sum[0] += own.value;
                    sum[1] += own.by_level;
                }
                sum
            })
            .collect();
        let count = self.values.len() as f64;
        let total = |n: usize| layers.iter().map(|l| l[n]).sum::<f64>() / count;
        (total(0), total(1))
    }

    /// Area of the surface between solid and void over the volume of the period, per reference length. It is the rate
    /// at which the share of solid grows with the level, which is the integral of dS / |slope|, times the slope.
    pub fn surface_per_volume(&self) -> f64 {
        let [nx, ny, nz] = self.grid.counts();
        let per_part = self.spacing_of_parts();
        let total: Vec<f64> = (0..nx)
            .into_par_iter()
            .map(|i| {
                let mut sum = 0.0;
                for n in 0..ny * nz {
                    for p in self.parts([i, n / nz, n % nz]) {
                        let slope = self.slope(p);
                        let own = part(self.solid, self.level, self.value(p), slope);
                        let steep: f64 = (0..3).map(|a| (slope[a] / per_part[a]).powi(2)).sum();
                        // The two walls of a sheet or channels move alike with the level, but oppositely with the
                        // value, where they would cancel.
                        let walls = if self.solid.is_symmetric() {
                            own.by_level
                        } else {
                            own.by_value
                        };
                        sum += walls.abs() * steep.sqrt();
                    }
                }
                sum
            })
            .collect();
        total.iter().sum::<f64>() / self.values.len() as f64
    }

    /// Edges of a part, reference lengths.
    fn spacing_of_parts(&self) -> [f64; 3] {
        let counts = self.counts();
        let size = self.grid.size();
        std::array::from_fn(|a| size[a] / counts[a] as f64)
    }
}

/// Samples along each axis of a grid; planar grids have one along z.
pub(super) fn fine_counts(grid: Grid, fineness: usize) -> [usize; 3] {
    let [nx, ny, nz] = grid.counts();
    let deep = if grid.is_planar() { 1 } else { fineness };
    [nx * fineness, ny * fineness, nz * deep]
}

/// The mean of shares, by chunks of 4096 (32 KiB) in a fixed order, so that it does not depend on the threads.
pub fn mean(shares: &[f64]) -> f64 {
    let parts: Vec<f64> = shares.par_chunks(1 << 12).map(|c| c.iter().sum()).collect();
    parts.iter().sum::<f64>() / shares.len() as f64
}

/// Shares rounded to 0 or 1, so that every voxel is solid or void.
pub fn sharpened(shares: &[f64]) -> Vec<f64> {
    let sharp = |s: &f64| if *s >= 0.5 { 1.0 } else { 0.0 };
    shares.iter().map(sharp).collect()
}
