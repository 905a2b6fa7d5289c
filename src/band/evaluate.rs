//! Evaluation by blocks.

use super::activate::{Bits, Neighbourhood, SPAN};
use super::cull::Culler;
use super::{BLOCK, Band, BandError, BandStats, LEAF, LeafBatch, LeafSink, Region, VOXELS, pool};
use crate::field::SampleLattice;
use crate::frame::{Aabb, Coord};
use crate::progress::{Cancelled, Progress, Threads};
use rayon::prelude::*;
use std::ops::Range;

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

/// One block: cull, then evaluate, activate and deliver its leaves by the stretch.
///
/// What a leaf's mask takes of its neighbours are signs, so that values are kept of two stretches at a
/// time: of the one to be delivered, and of the next one, whose signs it waits for.
fn block(
    culler: &Culler,
    origin: Coord,
    progress: &dyn Progress,
    sink: &dyn LeafSink,
) -> Result<BandStats, BandError> {
    let sieve = culler.leaves(origin);
    let mut block = Block::new(culler, origin, sieve.unknown);
    let mut inside = sieve.inside;
    let mut stats = BandStats {
        blocks: 1,
        leaves_touched: block.origins.len() as u64,
        ..BandStats::default()
    };
    let mut waiting: Option<Stretch> = None;
    let mut first = 0;
    while first < block.origins.len() || waiting.is_some() {
        if progress.cancelled() {
            return Err(Cancelled.into());
        }
        let last = block.stretch(first);
        let next = if first < last {
            let (stretch, looked) = block.evaluate(first..last, progress)?;
            stats.voxels_evaluated += looked;
            Some(stretch)
        } else {
            None
        };
        first = last;
        if let Some(stretch) = std::mem::replace(&mut waiting, next) {
            let (batch, looked) = block.choose(stretch, &mut inside);
            stats.voxels_evaluated += looked;
            stats.leaves_kept += batch.len() as u64;
            stats.active_voxels += batch.active_voxels();
            if !batch.is_empty() {
                sink.block(origin, &batch)?;
            }
            pool::give_batch(batch);
        }
    }
    sink.inside(&inside);
    Ok(stats)
}

/// Fills in the values of one leaf, clamped to the band; says what they are and at how many points the
/// field was looked at.
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

/// Consecutive leaves of a block, evaluated: their values, and no masks yet.
struct Stretch {
    leaves: Range<usize>,
    batch: LeafBatch,
}

/// The leaves of a block that may be active, sorted by origin, and what is known of them.
struct Block<'a> {
    culler: &'a Culler<'a>,
    origin: Coord,
    origins: Vec<Coord>,
    /// Of all leaves that were evaluated.
    bits: Vec<Bits>,
    /// Number of the leaf at each of the 16^3 places, z fastest.
    table: Vec<u16>,
}

impl<'a> Block<'a> {
    fn new(culler: &'a Culler<'a>, origin: Coord, origins: Vec<Coord>) -> Self {
        let mut table = vec![ABSENT; (EDGE * EDGE * EDGE) as usize];
        for (n, &leaf) in origins.iter().enumerate() {
            let [x, y, z] = place(origin, leaf);
            table[((x * EDGE + y) * EDGE + z) as usize] = n as u16;
        }
        Self {
            culler,
            origin,
            bits: vec![Bits::default(); origins.len()],
            origins,
            table,
        }
    }

    /// Where the stretch from a leaf on ends: after as many layers of leaves of one x as fit a batch,
    /// at least one, so that no leaf has a neighbour beyond the next stretch.
    fn stretch(&self, first: usize) -> usize {
        let mut last = first;
        while let Some(leaf) = self.origins.get(last) {
            let layer = self.origins[last..].partition_point(|o| o[0] == leaf[0]);
            if last > first && last + layer > first + BATCH {
                break;
            }
            last += layer;
        }
        last
    }

    /// Evaluates a stretch; gives its values, and at how many points the field was looked at.
    fn evaluate(
        &mut self,
        leaves: Range<usize>,
        progress: &dyn Progress,
    ) -> Result<(Stretch, u64), BandError> {
        let mut batch = pool::batch(leaves.len());
        let looked = self.origins[leaves.clone()]
            .par_chunks(GROUP)
            .zip(batch.values.par_chunks_mut(GROUP))
            .zip(self.bits[leaves.clone()].par_chunks_mut(GROUP))
            .map(|((group, values), bits)| {
                if progress.cancelled() {
                    return Err(BandError::from(Cancelled));
                }
                let mut looked = 0;
                for (n, &leaf) in group.iter().enumerate() {
                    let (found, points) = leaf_values(self.culler, leaf, &mut values[n])?;
                    bits[n] = found;
                    looked += points;
                }
                Ok(looked)
            })
            .try_reduce(|| 0, |a, b| Ok(a + b))?;
        Ok((Stretch { leaves, batch }, looked))
    }

    /// The leaves of a stretch that have active voxels; those that lie inside go to `inside`. Needs the
    /// next stretch evaluated. Gives at how many more points the field was looked at.
    fn choose(&self, stretch: Stretch, inside: &mut Vec<(Coord, i32)>) -> (LeafBatch, u64) {
        let Stretch { leaves, mut batch } = stretch;
        let masks: Vec<_> = leaves
            .clone()
            .into_par_iter()
            .map(|n| self.activate(n))
            .collect();
        let mut looked = 0;
        for (place, (n, (mask, more))) in leaves.zip(masks).enumerate() {
            looked += more;
            if mask == [0; 8] {
                if batch.values[place][0] < 0.0 {
                    inside.push((self.origins[n], LEAF));
                }
                continue;
            }
            let kept = batch.len();
            if kept < place {
                batch.values[kept] = batch.values[place];
            }
            batch.origins.push(self.origins[n]);
            batch.masks.push(mask);
        }
        batch.values.truncate(batch.origins.len());
        (batch, looked)
    }

    /// The mask of a leaf's active voxels, and how many samples beyond the block it took to find it.
    fn activate(&self, n: usize) -> ([u64; 8], u64) {
        // Only an inactive voxel may become active by its neighbours.
        if self.bits[n].within == [u64::MAX; 8] {
            return ([u64::MAX; 8], 0);
        }
        let leaf = self.origins[n];
        let mut near = Neighbourhood::default();
        let own = place(self.origin, leaf);
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
                    taken += enter_layer(self.culler, leaf, axis, outside, &mut near);
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

/// Which of the 16^3 places of a block a leaf has.
fn place(block: Coord, leaf: Coord) -> [i32; 3] {
    [0, 1, 2].map(|a| (leaf[a] - block[a]) / LEAF)
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
    let mut rows = [0; SPAN * SPAN];
    let rows = &mut rows[..counts[0] * counts[1]];
    let looked = culler.field.signs(&lattice, rows);
    let mut first = [0; 3];
    first[axis] = (outside + 1) as usize;
    let places = (0..counts[0]).flat_map(|i| (0..counts[1]).map(move |j| (i, j)));
    for ((i, j), &row) in places.zip(&*rows) {
        near.enter_row([first[0] + i, first[1] + j, first[2]], counts[2], row);
    }
    looked
}
