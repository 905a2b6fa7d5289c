//! Check of the guarantees of a level set.
//!
//! A level set of this program has finite values, none beyond the background, inactive values at the
//! background, and a sign that only changes within the band. The slope is measured as well, but not judged:
//! |grad phi| = 1 fails at edges and mid-surfaces of any solid.

use super::components::{Components, Side};
use super::error::VdbError;
use super::ffi::TileChoice;
use super::index::{FACES, Holder, LeafIndex};
use super::{LevelSet, Session};
use crate::progress::Cancelled;
use rayon::prelude::*;
use serde::Serialize;
use std::ops::AddAssign;

/// Statistics of |grad|, by central differences at voxels whose six neighbours are active; 1 for a distance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct GradientStatistics {
    /// Number of measured voxels.
    pub voxels: u64,
    /// Root mean square of |grad| - 1.
    pub rms: f64,
    /// 99 % of the voxels have | |grad| - 1 | below this (to 0.001); 1 stands for 1 and more.
    pub p99: f64,
    /// Number of voxels with |grad| outside 0.5 to 1.5: creases and the medial axis of thin walls.
    pub far_off: u64,
}

/// The result of [`LevelSet::check`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelSetCheck {
    /// Edge of a voxel, world units.
    pub voxel_size: f64,
    /// Half width of the band, voxels.
    pub half_width: f64,
    /// Distances up to which values are valid inside and outside, voxels; below the half width if the band is
    /// narrower on that side.
    pub known_widths: [f64; 2],
    /// Half width of the band, world units.
    pub background: f64,
    /// Number of active voxels.
    pub active_voxels: u64,
    /// Number of values that are NaN or infinite.
    pub not_finite: u64,
    /// Number of active values beyond the background.
    pub beyond_band: u64,
    /// Number of inactive values that are neither minus nor plus the background.
    pub off_background: u64,
    /// Number of pairs of neighbours with different signs and at least one inactive voxel: the surface is torn
    /// there, or inside and outside are exchanged.
    pub torn: u64,
    /// Position of the first of them, world units.
    pub torn_at: Option<[f64; 3]>,
    /// Statistics of the gradient.
    pub gradient: GradientStatistics,
    /// Number of connected components of the solid.
    pub pieces: usize,
    /// Number of voids that the solid encloses.
    pub voids: usize,
    /// Share of the solid's voxels in the largest component.
    pub largest_share: f64,
}

impl LevelSetCheck {
    /// Violations of the guarantees, one line each. Gradients, components and voids are not judged.
    pub fn problems(&self) -> Vec<String> {
        let lines = [
            (self.not_finite, "values are NaN or infinite"),
            (self.beyond_band, "active values lie beyond the background"),
            (
                self.off_background,
                "inactive values are not the background",
            ),
            (
                self.torn,
                "pairs of neighbours change sign without a band: torn surface, or inside out",
            ),
        ];
        let mut problems: Vec<String> = lines
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        if let Some([x, y, z]) = self.torn_at {
            let [x, y, z] = [x, y, z].map(|c| c as f32); // for fewer digits
            problems.push(format!("the first torn pair is at ({x}, {y}, {z})"));
        }
        if self.active_voxels == 0 {
            problems.push("no voxel is active: there is no surface".into());
        }
        problems
    }

    /// Whether all guarantees hold.
    pub fn passed(&self) -> bool {
        self.problems().is_empty()
    }
}

/// Number of bins of | |grad| - 1 |, 0.001 each; the last bin holds the rest.
const ERROR_BINS: usize = 1000;

/// Counts of one leaf or several.
#[derive(Clone, Copy, Default)]
struct LeafCounts {
    active: u64,
    not_finite: u64,
    beyond: u64,   // active voxels beyond the band
    off: u64,      // inactive voxels off the background
    measured: u64, // voxels with a slope
    far_off: u64,
    squares: f64, // of |grad| - 1
}

impl AddAssign for LeafCounts {
    fn add_assign(&mut self, o: Self) {
        self.active += o.active;
        self.not_finite += o.not_finite;
        self.beyond += o.beyond;
        self.off += o.off;
        self.measured += o.measured;
        self.far_off += o.far_off;
        self.squares += o.squares;
    }
}

impl LevelSet {
    /// Checks the guarantees of the level set.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn check(&self, session: Session<'_>) -> Result<LevelSetCheck, VdbError> {
        let leaves = self.leaves()?;
        // Components of the void need the tiles of the void.
        let index = LeafIndex::new(self, &leaves, TileChoice::All)?;
        let (h, background) = (self.voxel_size() as f32, self.background() as f32);
        let progress = session.progress;
        // Groups of 512 leaves for any number of threads, added in order, so that the sums do not depend on it.
        let numbers: Vec<usize> = (0..index.leaves.len()).collect();
        let groups: Vec<(LeafCounts, Vec<u64>)> = session.threads.install(|| {
            let groups = numbers.par_chunks(512).map(|group| {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                let mut bins = vec![0; ERROR_BINS];
                let mut total = LeafCounts::default();
                for &leaf in group {
                    total += count_leaf(&index, leaf, h, background, &mut bins);
                }
                Ok((total, bins))
            });
            groups.collect::<Result<_, _>>()
        })?;
        let mut bins = vec![0; ERROR_BINS];
        let mut total = LeafCounts::default();
        for (counts, b) in groups {
            total += counts;
            bins.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        }
        let gaps = self.band_gaps()?;
        // Components as the mesher counts them, voids by the sign alone.
        let solid = Components::bodies(&index, self.voxel_size(), session)?
            .ranking
            .counted();
        let voids = Components::find(&index, Side::Void, self.voxel_size(), session)?
            .ranking
            .counted();
        let inside: u64 = solid.iter().map(|p| p.voxels).sum();
        Ok(LevelSetCheck {
            voxel_size: self.voxel_size(),
            half_width: self.half_width(),
            known_widths: self.known_widths()?,
            background: self.background(),
            active_voxels: total.active,
            not_finite: total.not_finite,
            beyond_band: total.beyond,
            off_background: total.off,
            torn: gaps.gaps,
            torn_at: gaps.first.map(Into::into),
            gradient: GradientStatistics {
                voxels: total.measured,
                rms: (total.squares / total.measured.max(1) as f64).sqrt(),
                p99: quantile(&bins, 0.99),
                far_off: total.far_off,
            },
            pieces: solid.len(),
            voids: voids.len(),
            largest_share: solid.first().map_or(0.0, |p| p.voxels as f64) / inside.max(1) as f64,
        })
    }
}

/// The upper end of the bin that holds this quantile.
fn quantile(bins: &[u64], share: f64) -> f64 {
    let target = bins.iter().sum::<u64>() as f64 * share;
    let mut cumulative = 0;
    let bin = bins.iter().position(|&count| {
        cumulative += count;
        cumulative > 0 && cumulative as f64 >= target
    });
    bin.map_or(0.0, |b| (b + 1) as f64 / 1000.0)
}

/// Counts the defects of a leaf: values that are not finite, too large or off the background, and errors of the slope
/// in `bins` of a thousandth. `h` is the voxel size and `background` the half width of the band, world units. `leaf` is
/// its number. Values within a thousandth of the background count as the background; a slope is far off beyond 0.5.
fn count_leaf(
    index: &LeafIndex<'_>,
    leaf: usize,
    h: f32,
    background: f32,
    bins: &mut [u64],
) -> LeafCounts {
    let view = index.leaves[leaf];
    let neighbours = FACES.map(|s| index.holder(view.origin.offset(8 * s[0], 8 * s[1], 8 * s[2])));
    // Value of a voxel's neighbour across face f, and whether it is active.
    let neighbour = |n: usize, f: usize| -> (f32, bool) {
        let (axis, ahead) = (f / 2, f % 2 == 1);
        let step = [64, 8, 1][axis];
        let index_on_axis = n / step % 8;
        let opposite = match (ahead, index_on_axis) {
            (true, 7) => n - 7 * step,
            (false, 0) => n + 7 * step,
            (true, _) => return (view.values[n + step], view.is_active(n + step)),
            (false, _) => return (view.values[n - step], view.is_active(n - step)),
        };
        match neighbours[f] {
            Holder::Leaf(other) => {
                let other = &index.leaves[other];
                (other.values[opposite], other.is_active(opposite))
            }
            Holder::Tile(tile) => (index.tiles[tile].value, index.tiles[tile].active),
            Holder::Background => (background, false),
        }
    };
    let mut counts = LeafCounts::default();
    for (n, &v) in view.values.iter().enumerate() {
        let active = view.is_active(n);
        counts.active += u64::from(active);
        if !v.is_finite() {
            counts.not_finite += 1;
            continue;
        }
        // A thousandth of the background exceeds the rounding of half floats.
        let excess = (v.abs() - background) / background;
        if active {
            counts.beyond += u64::from(excess > 1e-3);
        } else {
            counts.off += u64::from(excess.abs() > 1e-3);
        }
        let mut all_active = active;
        let mut slope = [0.0; 3];
        for f in 0..6 {
            let (w, other_active) = neighbour(n, f);
            all_active &= other_active;
            slope[f / 2] += if f % 2 == 1 { w } else { -w };
        }
        if all_active {
            let g = slope.iter().map(|s| s * s).sum::<f32>().sqrt() / (2.0 * h);
            let error = f64::from(g - 1.0);
            counts.measured += 1;
            counts.squares += error * error;
            counts.far_off += u64::from(error.abs() > 0.5);
            bins[((error.abs() * 1000.0) as usize).min(ERROR_BINS - 1)] += 1;
        }
    }
    counts
}
