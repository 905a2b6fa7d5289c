//! Prediction of a band's size from culling and a sample of its leaves.
//!
//! The numbers of blocks and of leaves to evaluate are exact, as culling finds them; what leaves hold is extrapolated
//! from those that are drawn. One seed gives one estimate, but for the time, at any number of threads. Positions of
//! voxels within the band are drawn in the same way, for tests of a field.

use super::activate::Neighbourhood;
use super::cull::Culler;
use super::evaluate::leaf_values;
use super::leaf::population;
use super::{Band, BandError, Region, VOXELS};
use druse_geometry::field::LeafBits;
use druse_geometry::frame::{Coord, WorldPoint};
use druse_geometry::progress::{Cancelled, Progress, Threads};
use rayon::prelude::*;

/// How much to sample.
#[derive(Clone, Copy, Debug)]
pub struct Sampling {
    /// Leaves to evaluate, at least 2, so that there is a standard error; all of them if there are fewer.
    pub leaves: usize,
    /// Seed of the random generator; the same seed gives the same estimate.
    pub seed: u64,
}

impl Default for Sampling {
    fn default() -> Self {
        Self {
            // A mean then errs by 1/28 of the spread within runs.
            leaves: 768,
            seed: 1,
        }
    }
}

/// The predicted size of a band, with standard errors of the predicted numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Blocks that will be visited (counted).
    pub blocks: u64,
    /// Leaves that will be evaluated (counted).
    pub leaves_evaluated: u64,
    /// Leaves that will be kept.
    pub leaves_kept: f64,
    /// Standard error of `leaves_kept`.
    pub leaves_kept_error: f64,
    /// Active voxels.
    pub active_voxels: f64,
    /// Standard error of `active_voxels`.
    pub active_voxels_error: f64,
    /// Lattice edges that the surface crosses; a quad mesh of it has one quad per edge.
    pub crossings: f64,
    /// Leaves that were evaluated for the estimate.
    pub leaves_sampled: u64,
    /// Measured seconds per evaluated leaf and thread; the only field that differs between runs.
    pub seconds_per_leaf: f64,
}

impl Band<'_> {
    /// Predicts the result of [`Band::evaluate`]: culls all leaves and evaluates a stratified sample. The leaves, in
    /// order of block and origin, are divided into runs of equal length; one leaf is drawn from each.
    ///
    /// # Errors
    /// As [`Band::evaluate`]; a value that is not finite is found only if it is sampled.
    pub fn estimate(
        &self,
        threads: &Threads,
        progress: &dyn Progress,
        sampling: Sampling,
    ) -> Result<Estimate, BandError> {
        let culler = Culler::new(self, Region::EVERYWHERE)?;
        threads.install(|| {
            let blocks = culler.blocks().undecided;
            progress.stage("estimate", Some(blocks.len() as u64));
            let leaves: Vec<Vec<Coord>> = blocks
                .par_iter()
                .map(|&block| {
                    if progress.cancelled() {
                        return Err(Cancelled);
                    }
                    progress.advance(1);
                    Ok(culler.leaves(block).undecided)
                })
                .collect::<Result<_, _>>()?;
            let leaves: Vec<Coord> = leaves.into_iter().flatten().collect();
            // The variance is that of differences, of two leaves at least.
            let sampling = Sampling {
                leaves: sampling.leaves.max(2),
                ..sampling
            };
            let drawn = draw_stratified(leaves.len(), sampling);
            let measured: Vec<LeafSample> = drawn
                .par_iter()
                .map(|&n| {
                    if progress.cancelled() {
                        return Err(Cancelled.into());
                    }
                    let start = std::time::Instant::now();
                    let (bits, _) = leaf_values(&culler, leaves[n], &mut [0.0; VOXELS])?;
                    Ok(LeafSample {
                        active: active_voxels(&bits),
                        crossings: crossings(&bits.negative),
                        seconds: start.elapsed().as_secs_f64(),
                    })
                })
                .collect::<Result<_, BandError>>()?;
            let seconds: f64 = measured.iter().map(|m| m.seconds).sum();
            let active = |m: &LeafSample| m.active as f64;
            let kept = |m: &LeafSample| f64::from(u8::from(m.active > 0));
            let (active_voxels, active_voxels_error) = total(&measured, leaves.len(), active);
            let (leaves_kept, leaves_kept_error) = total(&measured, leaves.len(), kept);
            // Seven of the eight edges along a row lie within the leaf.
            let (within, _) = total(&measured, leaves.len(), |m| m.crossings as f64);
            Ok(Estimate {
                // An edge over the face of a leaf is not seen in the leaf alone.
                crossings: within * 8.0 / 7.0,
                blocks: blocks.len() as u64,
                leaves_evaluated: leaves.len() as u64,
                leaves_kept,
                leaves_kept_error,
                active_voxels,
                active_voxels_error,
                leaves_sampled: drawn.len() as u64,
                seconds_per_leaf: seconds / (drawn.len().max(1) as f64),
            })
        })
    }
}

/// Greatest number of blocks that voxels are drawn from: it bounds the culling.
const MAX_DRAWN_BLOCKS: usize = 64;
/// Voxels drawn from one leaf, few since its voxels are much alike.
const DRAWN_VOXELS_PER_LEAF: usize = 4;

impl Band<'_> {
    /// Positions of at most `count` voxels within the band, drawn from blocks all over it; deterministic. Fewer come
    /// back if fewer leaves have such voxels.
    ///
    /// # Errors
    /// As [`Band::evaluate`].
    pub fn draw(
        &self,
        threads: &Threads,
        progress: &dyn Progress,
        count: usize,
    ) -> Result<Vec<WorldPoint>, BandError> {
        let culler = Culler::new(self, Region::EVERYWHERE)?;
        let sampling = |leaves| Sampling { leaves, seed: 1 };
        threads.install(|| {
            let blocks = culler.blocks().undecided;
            let blocks: Vec<Coord> = draw_stratified(blocks.len(), sampling(MAX_DRAWN_BLOCKS))
                .into_iter()
                .map(|n| blocks[n])
                .collect();
            let leaves: Vec<Coord> = blocks
                .par_iter()
                .flat_map_iter(|&block| culler.leaves(block).undecided)
                .collect();
            // Twice the leaves needed: not every leaf that culling keeps has active voxels.
            let leaves: Vec<Coord> = draw_stratified(
                leaves.len(),
                sampling(2 * count.div_ceil(DRAWN_VOXELS_PER_LEAF)),
            )
            .into_iter()
            .map(|n| leaves[n])
            .collect();
            let places: Vec<Vec<WorldPoint>> = leaves
                .par_iter()
                .map(|&leaf| {
                    if progress.cancelled() {
                        return Err(Cancelled.into());
                    }
                    let within = leaf_values(&culler, leaf, &mut [0.0; VOXELS])?.0.within;
                    let active: Vec<usize> = (0..VOXELS)
                        .filter(|&n| within[n >> 6] >> (n & 63) & 1 == 1)
                        .collect();
                    let stride = active.len().div_ceil(DRAWN_VOXELS_PER_LEAF).max(1);
                    let place = |n: &usize| {
                        let [x, y, z] = [n >> 6, n >> 3 & 7, n & 7].map(|c| c as i32);
                        self.transform.world(leaf.offset(x, y, z))
                    };
                    Ok(active.iter().step_by(stride).map(place).collect())
                })
                .collect::<Result<_, BandError>>()?;
            let places: Vec<WorldPoint> = places.into_iter().flatten().collect();
            Ok(draw_stratified(places.len(), sampling(count))
                .into_iter()
                .map(|n| places[n])
                .collect())
        })
    }
}

/// Counts and time of one sampled leaf.
struct LeafSample {
    active: u64,
    crossings: u64,
    seconds: f64,
}

/// Edges within a leaf whose ends differ in sign.
fn crossings(negative: &[u64; 8]) -> u64 {
    // All voxels but those at z = 7.
    const BELOW_Z_MAX_BITS: u64 = 0x7f7f_7f7f_7f7f_7f7f;
    let along_x = negative.windows(2).map(|w| (w[0] ^ w[1]).count_ones());
    let across = negative.iter().map(|w| {
        let along_y = (w ^ w >> 8) & (u64::MAX >> 8);
        let along_z = (w ^ w >> 1) & BELOW_Z_MAX_BITS;
        along_y.count_ones() + along_z.count_ones()
    });
    along_x.chain(across).map(u64::from).sum()
}

/// Active voxels of an isolated leaf: changes of sign towards its neighbours do not count.
fn active_voxels(bits: &LeafBits) -> u64 {
    let mut isolated = Neighbourhood::default();
    isolated.set_leaf([1; 3], &bits.negative);
    let mut mask = bits.within;
    for (word, changed) in mask.iter_mut().zip(isolated.next_to_change()) {
        *word |= changed;
    }
    population(&mask)
}

/// Draws one number from each of `count` runs of `0..total`. All numbers if there are at most `count`; ascending.
fn draw_stratified(
    total: usize,
    Sampling {
        leaves: count,
        seed,
    }: Sampling,
) -> Vec<usize> {
    if total <= count {
        return (0..total).collect();
    }
    let mut state = seed;
    (0..count)
        .map(|run| {
            // SplitMix64, by Steele, Lea and Flood 2014.
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = state;
            z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
            let uniform = ((z ^ z >> 31) >> 11) as f64 / (1u64 << 53) as f64;
            let [first, next] =
                [run, run + 1].map(|r| (r as u128 * total as u128 / count as u128) as usize);
            first + (uniform * (next - first) as f64) as usize
        })
        .collect()
}

/// The estimated total over all leaves and its standard error. The variance within a run is estimated from
/// neighbouring runs: half the mean square of successive differences.
fn total(sample: &[LeafSample], leaves: usize, of: impl Fn(&LeafSample) -> f64) -> (f64, f64) {
    let n = sample.len() as f64;
    let sum: f64 = sample.iter().map(&of).sum();
    if sample.len() == leaves {
        return (sum, 0.0);
    }
    let squares: f64 = sample
        .windows(2)
        .map(|w| (of(&w[0]) - of(&w[1])).powi(2))
        .sum();
    let variance = squares / 2.0 / (n - 1.0);
    let all = leaves as f64;
    let left_out = 1.0 - n / all;
    (sum / n * all, all * (variance * left_out / n).sqrt())
}
