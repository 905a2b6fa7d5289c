//! Whether a level set is what it promises, in numbers.

use super::components::{Pieces, Side};
use super::index::{FACES, Holder, LeafIndex};
use super::{LevelSet, Session, VdbError};
use crate::progress::Cancelled;
use rayon::prelude::*;
use serde::Serialize;
use std::ops::AddAssign;

/// How well the band is a distance: |grad| by central differences, where all six neighbours are active.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct GradientStatistics {
    /// Voxels measured.
    pub voxels: u64,
    /// Root mean square of |grad| - 1.
    pub rms: f64,
    /// 99 % of the voxels have | |grad| - 1 | below this (to 0.001).
    pub p99: f64,
    /// Voxels with |grad| outside 0.5 to 1.5: creases and the medial axis of thin walls.
    pub far_off: u64,
}

/// What [`LevelSet::check`] found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelSetCheck {
    /// World units.
    pub voxel_size: f64,
    /// Voxels.
    pub half_width: f64,
    /// How far distances are known inside and outside, voxels: less than the half width where the band is
    /// narrower on that side.
    pub known_widths: [f64; 2],
    /// World units.
    pub background: f64,
    /// Voxels of the band.
    pub active_voxels: u64,
    /// Values that are NaN or infinite.
    pub not_finite: u64,
    /// Active values beyond the background.
    pub beyond_band: u64,
    /// Inactive values that are neither minus nor plus the background.
    pub off_background: u64,
    /// Neighbours of different sign of which one is inactive: the surface is torn there, or inside
    /// and outside are exchanged.
    pub torn: u64,
    /// Where the first of them is, world units.
    pub torn_at: Option<[f64; 3]>,
    /// How well it is a distance.
    pub gradient: GradientStatistics,
    /// Connected pieces of the solid.
    pub pieces: usize,
    /// Voids that the solid encloses.
    pub voids: usize,
    /// Share of the solid's voxels in the largest piece.
    pub largest_share: f64,
}

impl LevelSetCheck {
    /// What breaks the promise, one line each; empty when all is well. Gradients, pieces and voids
    /// are told, not judged.
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
            let [x, y, z] = [x, y, z].map(|c| c as f32);
            problems.push(format!("the first torn pair is at ({x}, {y}, {z})"));
        }
        if self.active_voxels == 0 {
            problems.push("no voxel is active: there is no surface".into());
        }
        problems
    }

    /// Whether the promise holds.
    pub fn passed(&self) -> bool {
        self.problems().is_empty()
    }
}

/// Bins of | |grad| - 1 |, 0.001 each; the last holds the rest.
const BINS: usize = 1000;

/// Counts of one leaf or several.
#[derive(Clone, Copy, Default)]
struct Tally {
    active: u64,
    not_finite: u64,
    beyond: u64,
    off: u64,
    measured: u64,
    far_off: u64,
    squares: f64,
}

impl AddAssign for Tally {
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
    /// Measures the level set against what it promises.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn check(&self, session: Session<'_>) -> Result<LevelSetCheck, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, true)?;
        let (h, background) = (self.voxel_size() as f32, self.background() as f32);
        let progress = session.progress;
        // Groups of a fixed size, added in order: the sums depend on nothing else.
        let numbers: Vec<usize> = (0..index.leaves.len()).collect();
        let groups: Vec<(Tally, Vec<u64>)> = session.threads.install(|| {
            let groups = numbers.par_chunks(512).map(|group| {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                let mut bins = vec![0; BINS];
                let mut total = Tally::default();
                for &leaf in group {
                    total += tally(&index, leaf, h, background, &mut bins);
                }
                Ok((total, bins))
            });
            groups.collect::<Result<_, _>>()
        })?;
        let mut bins = vec![0; BINS];
        let mut total = Tally::default();
        for (t, b) in groups {
            total += t;
            bins.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        }
        let tears = self.tears()?;
        let solid = Pieces::find(&index, Side::Solid, self.voxel_size(), session)?
            .ranking
            .counted();
        let voids = Pieces::find(&index, Side::Void, self.voxel_size(), session)?
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
            torn: tears.torn,
            torn_at: tears.first.map(Into::into),
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
    let wanted = bins.iter().sum::<u64>() as f64 * share;
    let mut seen = 0;
    let bin = bins.iter().position(|&count| {
        seen += count;
        seen > 0 && seen as f64 >= wanted
    });
    bin.map_or(0.0, |b| (b + 1) as f64 / 1000.0)
}

fn tally(index: &LeafIndex<'_>, leaf: usize, h: f32, background: f32, bins: &mut [u64]) -> Tally {
    let view = index.leaves[leaf];
    let beside = FACES.map(|s| index.holder(view.origin.offset(8 * s[0], 8 * s[1], 8 * s[2])));
    // A voxel's neighbour across face f: its value, whether it is active.
    let neighbour = |n: usize, f: usize| -> (f32, bool) {
        let (axis, ahead) = (f / 2, f % 2 == 1);
        let step = [64, 8, 1][axis];
        let place = n / step % 8;
        let at = match (ahead, place) {
            (true, 7) => n - 7 * step,
            (false, 0) => n + 7 * step,
            (true, _) => return (view.values[n + step], view.is_active(n + step)),
            (false, _) => return (view.values[n - step], view.is_active(n - step)),
        };
        match beside[f] {
            Holder::Leaf(other) => {
                let other = &index.leaves[other];
                (other.values[at], other.is_active(at))
            }
            Holder::Tile(tile) => (index.tiles[tile].value, index.tiles[tile].active),
            Holder::Nothing => (background, false),
        }
    };
    let mut t = Tally::default();
    for (n, &v) in view.values.iter().enumerate() {
        let active = view.is_active(n);
        t.active += u64::from(active);
        if !v.is_finite() {
            t.not_finite += 1;
            continue;
        }
        let excess = (v.abs() - background) / background;
        if active {
            t.beyond += u64::from(excess > 1e-3);
        } else {
            t.off += u64::from(excess.abs() > 1e-3);
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
            t.measured += 1;
            t.squares += error * error;
            t.far_off += u64::from(error.abs() > 0.5);
            bins[((error.abs() * 1000.0) as usize).min(BINS - 1)] += 1;
        }
    }
    t
}
