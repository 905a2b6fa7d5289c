//! Evaluation by blocks.

use super::activate::{Bits, Neighbourhood, SPAN};
use super::cull::Culler;
use super::leaf::count;
use super::{BLOCK, Band, BandError, BandStats, LEAF, LeafSink, Region, VOXELS, pool};
use crate::field::SampleLattice;
use crate::frame::{Aabb, Coord};
use crate::progress::{Cancelled, Progress, Threads};
use rayon::prelude::*;

/// Leaves evaluated between two looks at whether the user asked to stop.
const GROUP: usize = 16;
/// Most leaves in a batch.
const BATCH: usize = 256;
/// Leaves along a block's edge.
const EDGE: i32 = BLOCK / LEAF;
/// A leaf that was not evaluated, in a block's table.
const ABSENT: u16 = u16::MAX;

impl Band<'_> {
    /// Evaluates the band and hands its leaves to a sink.
    ///
    /// # Errors
    /// A half width or extent out of range, a value that is not finite, cancelling, the sink's error.
    pub fn evaluate(
        &self,
        threads: &Threads,
        progress: &dyn Progress,
        sink: &dyn LeafSink,
    ) -> Result<BandStats, BandError> {
        self.evaluate_within(Region::EVERYWHERE, threads, progress, sink)
    }

    /// The same for the leaves that meet a region. Values do not depend on the region, nor do active
    /// voxels, but for those that are active only because the sign changes towards a voxel outside of
    /// a region that is not made of blocks.
    ///
    /// # Errors
    /// As [`Band::evaluate`].
    pub fn evaluate_within(
        &self,
        region: Region,
        threads: &Threads,
        progress: &dyn Progress,
        sink: &dyn LeafSink,
    ) -> Result<BandStats, BandError> {
        let culler = Culler::new(self, region)?;
        threads.install(|| {
            let blocks = culler.blocks();
            progress.stage("band", Some(blocks.unknown.len() as u64));
            sink.inside(&blocks.inside);
            blocks
                .unknown
                .par_iter()
                .map(|&origin| {
                    let stats = block(&culler, origin, progress, sink)?;
                    progress.advance(1);
                    Ok(stats)
                })
                .try_reduce(BandStats::default, |mut a, b| {
                    a += b;
                    Ok(a)
                })
        })
    }

    /// The blocks that the bound cannot exclude, sorted by origin: what [`Band::evaluate`] visits.
    ///
    /// # Errors
    /// A half width or extent out of range.
    pub fn blocks(&self) -> Result<Vec<Coord>, BandError> {
        Ok(Culler::new(self, Region::EVERYWHERE)?.blocks().unknown)
    }
}

/// One block: cull, evaluate, activate, deliver.
fn block(
    culler: &Culler,
    origin: Coord,
    progress: &dyn Progress,
    sink: &dyn LeafSink,
) -> Result<BandStats, BandError> {
    if progress.cancelled() {
        return Err(Cancelled.into());
    }
    let sieve = culler.leaves(origin);
    let mut inside = sieve.inside;
    let samples = BlockSamples::take(culler, origin, sieve.unknown, progress)?;
    let mut stats = BandStats {
        blocks: 1,
        leaves_touched: samples.origins.len() as u64,
        voxels_evaluated: samples.looked,
        ..BandStats::default()
    };
    for first in (0..samples.origins.len()).step_by(BATCH) {
        if progress.cancelled() {
            return Err(Cancelled.into());
        }
        let range = first..samples.origins.len().min(first + BATCH);
        let masks: Vec<_> = range
            .clone()
            .into_par_iter()
            .map(|n| samples.activate(culler, n))
            .collect();
        let mut batch = pool::batch();
        for (n, (mask, extra)) in range.zip(masks) {
            stats.voxels_evaluated += extra;
            if mask == [0; 8] {
                if samples.values[n][0] < 0.0 {
                    inside.push((samples.origins[n], LEAF));
                }
                continue;
            }
            stats.leaves_kept += 1;
            stats.active_voxels += count(&mask);
            batch.push(samples.origins[n], mask, &samples.values[n]);
            if let Some(values) = batch.values.last_mut() {
                clamp(values, culler.background as f32);
            }
        }
        if !batch.is_empty() {
            sink.block(origin, &batch)?;
        }
        pool::give_batch(batch);
    }
    pool::give_values(samples.values);
    sink.inside(&inside);
    Ok(stats)
}

/// Clamps values to the band. Inactive ones lie beyond it: they become plus or minus the background.
fn clamp(values: &mut [f32; VOXELS], background: f32) {
    for v in values {
        *v = v.max(-background).min(background);
    }
}

/// Fills in the values of one leaf; says what they are and at how many points the field was looked at.
///
/// # Errors
/// A value that is not finite.
pub(super) fn leaf_values(
    culler: &Culler,
    origin: Coord,
    values: &mut [f32; VOXELS],
) -> Result<(Bits, u64), BandError> {
    let lattice = SampleLattice {
        origin: culler.transform.world(origin),
        step: culler.transform.voxel_size(),
        counts: [LEAF as usize; 3],
    };
    let looked = culler.field.fill_counting(&lattice, values);
    let bits = Bits::of(values, culler.background as f32);
    if bits.finite {
        return Ok((bits, looked));
    }
    let n = values.iter().position(|v| !v.is_finite()).unwrap_or(0);
    let voxel = origin.offset((n >> 6) as i32, (n >> 3 & 7) as i32, (n & 7) as i32);
    Err(BandError::NotFinite {
        value: values[n],
        voxel,
        place: culler.transform.world(voxel),
    })
}

/// All evaluated leaves of a block.
struct BlockSamples {
    origin: Coord,
    origins: Vec<Coord>,
    /// At least as many as there are leaves: recycled memory.
    values: Vec<[f32; VOXELS]>,
    bits: Vec<Bits>,
    /// At how many points the field was looked at.
    looked: u64,
    /// Number of the leaf at each of the 16^3 places, z fastest.
    table: Vec<u16>,
}

impl BlockSamples {
    fn take(
        culler: &Culler,
        origin: Coord,
        origins: Vec<Coord>,
        progress: &dyn Progress,
    ) -> Result<Self, BandError> {
        let mut values = pool::values(origins.len());
        let mut bits = vec![Bits::default(); origins.len()];
        let looked = origins
            .par_chunks(GROUP)
            .zip(values.par_chunks_mut(GROUP))
            .zip(bits.par_chunks_mut(GROUP))
            .map(|((group, values), bits)| {
                if progress.cancelled() {
                    return Err(BandError::from(Cancelled));
                }
                let mut looked = 0;
                for (n, &leaf) in group.iter().enumerate() {
                    let (found, points) = leaf_values(culler, leaf, &mut values[n])?;
                    bits[n] = found;
                    looked += points;
                }
                Ok(looked)
            })
            .try_reduce(|| 0, |a, b| Ok(a + b))?;
        let mut samples = Self {
            origin,
            table: vec![ABSENT; (EDGE * EDGE * EDGE) as usize],
            origins,
            values,
            bits,
            looked,
        };
        for n in 0..samples.origins.len() {
            if let Some(place) = samples.place(samples.origins[n]) {
                samples.table[place] = n as u16;
            }
        }
        Ok(samples)
    }

    /// Where a leaf stands in the table; `None` outside the block.
    fn place(&self, leaf: Coord) -> Option<usize> {
        (leaf.aligned(BLOCK) == self.origin).then(|| {
            (0..3).fold(0, |n, a| {
                n * EDGE as usize + ((leaf[a] - self.origin[a]) / LEAF) as usize
            })
        })
    }

    /// The mask of a leaf's active voxels, and how many samples beyond the block it took to find it.
    fn activate(&self, culler: &Culler, n: usize) -> ([u64; 8], u64) {
        // Only an inactive voxel may become active by its neighbours.
        if self.bits[n].within == [u64::MAX; 8] {
            return ([u64::MAX; 8], 0);
        }
        let leaf = self.origins[n];
        let mut near = Neighbourhood::default();
        let own = [0, 1, 2].map(|a| (leaf[a] - self.origin[a]) / LEAF);
        for d in 0..27usize {
            let direction = [d / 9, d / 3 % 3, d % 3];
            let [x, y, z] = [0, 1, 2].map(|a| own[a] + direction[a] as i32 - 1);
            if [x, y, z].iter().any(|c| !(0..EDGE).contains(c)) {
                continue;
            }
            let number = self.table[((x * EDGE + y) * EDGE + z) as usize];
            if let Some(bits) = self.bits.get(number as usize) {
                near.enter_leaf(direction, &bits.negative);
            }
        }
        let mut taken = 0;
        for axis in 0..3 {
            for (at_end, outside) in [
                (leaf[axis] == self.origin[axis], -1),
                (leaf[axis] + LEAF == self.origin[axis] + BLOCK, LEAF),
            ] {
                if at_end {
                    taken += enter_layer(culler, leaf, axis, outside, &mut near);
                }
            }
        }
        let mut mask = self.bits[n].within;
        for (word, changed) in mask.iter_mut().zip(near.next_to_change()) {
            *word |= changed;
        }
        (mask, taken)
    }
}

/// Enters the signs of the layer of samples at index `outside` (-1 or 8) of `axis`, which lies in
/// another block; returns how many samples it took. None if the bound shows one sign throughout.
fn enter_layer(
    culler: &Culler,
    leaf: Coord,
    axis: usize,
    outside: i32,
    near: &mut Neighbourhood,
) -> u64 {
    let h = culler.transform.voxel_size();
    let corner = |along: i32, across: i32| {
        let mut c = leaf.offset(across, across, across);
        c.0[axis] = leaf[axis] + along;
        culler.transform.world(c).0
    };
    let region = Aabb {
        min: corner(outside.min(LEAF - 1), -1),
        max: corner(outside.max(0), LEAF),
    };
    let bound = culler.field.bound(&region);
    if bound.lo > 0.0 || bound.hi < 0.0 {
        return 0;
    }
    let mut counts = [SPAN; 3];
    counts[axis] = 1;
    let lattice = SampleLattice {
        origin: crate::frame::WorldPoint(corner(outside, -1)),
        step: h,
        counts,
    };
    let mut negative = [false; SPAN * SPAN];
    let looked = culler.field.signs(&lattice, &mut negative);
    for (n, &is_negative) in negative.iter().enumerate() {
        let mut i = [
            n / (counts[1] * counts[2]),
            n / counts[2] % counts[1],
            n % counts[2],
        ];
        i[axis] = (outside + 1) as usize;
        near.enter_sample(i, is_negative);
    }
    looked
}
