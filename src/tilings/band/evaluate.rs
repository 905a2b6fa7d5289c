//! Evaluation of a band, block by block.
//!
//! A block of 16^3 leaves is culled, then evaluated in slabs of whole x layers. A slab with a leaf whose mask needs the
//! signs of its neighbours waits for the next one; layers that lie in other blocks are sampled again, so that no block
//! waits for another. Results depend neither on threads nor on the order of blocks.

use super::activate::{Neighbourhood, SPAN};
use super::buffers::{self, Signs};
use super::contact;
use super::cull::Culler;
use super::{BLOCK, Band, BandError, BandStats, LEAF, LeafBatch, LeafSink, Region, VOXELS};
use druse_geometry::field::{LeafBits, Leaves, SampleLattice};
use druse_geometry::frame::{Aabb, Coord, Vec3, WorldPoint};
use druse_geometry::progress::{Cancelled, Progress, Threads};
use rayon::prelude::*;
use std::ops::Range;

/// Greatest number of leaves in a batch. A batch is one call of the field; cancellation is checked between batches.
const BATCH_LEAVES: usize = 32;
/// Greatest number of leaves in a slab; one x layer of a block has at most as many.
const SLAB_LEAVES: usize = (BLOCK_EDGE_LEAVES * BLOCK_EDGE_LEAVES) as usize;
/// Units of progress of a block: large parts may have few blocks.
const BLOCK_PARTS: u64 = 16;
/// Leaves along a block's edge.
const BLOCK_EDGE_LEAVES: i32 = BLOCK / LEAF;
/// Entry of a block's table without an evaluated leaf.
const NO_LEAF: u16 = u16::MAX;

impl Band<'_> {
    /// Evaluates the band and hands its leaves to a sink.
    ///
    /// # Errors
    /// A half width or extent out of range, a value that is not finite, cancellation, the sink's error.
    pub fn evaluate(
        &self,
        threads: &Threads,
        progress: &dyn Progress,
        sink: &dyn LeafSink,
    ) -> Result<BandStats, BandError> {
        self.evaluate_within(Region::EVERYWHERE, threads, progress, sink)
    }

    /// Evaluates only the leaves that meet a region. Values do not depend on the region, nor do active
    /// voxels if it is a union of blocks. Otherwise voxels at its boundary that are active only because of a
    /// change of sign across it may differ.
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
            progress.stage("band", Some(BLOCK_PARTS * blocks.undecided.len() as u64));
            sink.inside(&blocks.inside);
            blocks
                .undecided
                .par_iter()
                .map(|&origin| evaluate_block(&culler, origin, progress, sink))
                .try_reduce(BandStats::default, |mut a, b| {
                    a += b;
                    Ok(a)
                })
        })
    }

    /// The blocks that the bound cannot exclude, sorted by origin; [`Band::evaluate`] visits these.
    ///
    /// # Errors
    /// A half width or extent out of range.
    pub fn blocks(&self) -> Result<Vec<Coord>, BandError> {
        Ok(Culler::new(self, Region::EVERYWHERE)?.blocks().undecided)
    }
}

/// Evaluates one block: culls, then evaluates, activates and delivers its leaves slab by slab. `origin` is the block's
/// least voxel.
///
/// A leaf's mask depends on the signs of its neighbours, so two slabs of values are in memory at a time: the slab to
/// deliver, and the next one, whose signs it needs. A slab of complete leaves is delivered at once, while its values
/// are in the cache. Leaves proved to have no active voxels have no values.
fn evaluate_block(
    culler: &Culler,
    origin: Coord,
    progress: &dyn Progress,
    sink: &dyn LeafSink,
) -> Result<BandStats, BandError> {
    let leaves = culler.leaves(origin);
    let mut block = Block::new(culler, origin, leaves.undecided);
    let mut inside = leaves.inside;
    let mut stats = BandStats {
        blocks: 1,
        leaves_evaluated: block.origins.len() as u64,
        ..BandStats::default()
    };
    // `waiting` is the slab whose masks still need the signs of the next one.
    let mut waiting: Option<Slab> = None;
    let (mut first, mut parts) = (0, 0);
    while first < block.origins.len() || waiting.is_some() {
        if progress.cancelled() {
            return Err(Cancelled.into());
        }
        let last = block.slab_end(first);
        let mut next = None;
        if first < last {
            let (slab, samples) = block.evaluate(first..last, progress)?;
            stats.samples_evaluated += samples;
            next = Some(slab);
        }
        first = last;
        let reached = BLOCK_PARTS * first as u64 / block.origins.len() as u64;
        progress.advance(reached - parts);
        parts = reached;
        // A complete slab need not wait; the one before it is delivered first.
        let complete = next.take_if(|slab| slab.is_complete);
        for mut slab in [waiting.take(), complete].into_iter().flatten() {
            stats.samples_evaluated += block.complete(&mut slab, &mut inside);
            for batch in slab.batches {
                stats.leaves_kept += batch.len() as u64;
                stats.active_voxels += batch.active_voxels();
                if !batch.is_empty() {
                    sink.block(origin, &batch)?;
                }
                buffers::recycle_batch(batch);
            }
        }
        waiting = next;
    }
    progress.advance(BLOCK_PARTS - parts);
    sink.inside(&inside);
    buffers::recycle_signs(block.signs);
    Ok(stats)
}

/// Evaluates one leaf, clamped to the band; returns the bits of its values and the number of samples evaluated.
///
/// # Errors
/// A value that is not finite.
pub(super) fn leaf_values(
    culler: &Culler,
    origin: Coord,
    values: &mut [f32; VOXELS],
) -> Result<(LeafBits, u64), BandError> {
    let mut bits = [LeafBits::default()];
    let values = std::slice::from_mut(values);
    let samples = batch_values(culler, &[origin], values, &mut bits)?;
    Ok((bits[0], samples))
}

/// Evaluates at most [`BATCH_LEAVES`] leaves, sorted by origin, into `values` and one entry of `bits` per leaf; returns
/// the number of samples evaluated. Values are clamped to the band, and consecutive for the leaves that are not out of
/// it: evaluated leaf by leaf, none counts as out.
///
/// # Errors
/// [`BandError::NotFinite`] with the first such voxel.
pub(super) fn batch_values(
    culler: &Culler,
    leaves: &[Coord],
    values: &mut [[f32; VOXELS]],
    bits: &mut [LeafBits],
) -> Result<u64, BandError> {
    let step = culler.transform.voxel_size();
    let background = culler.background as f32;
    let mut origins = [WorldPoint(Vec3::zeros()); BATCH_LEAVES];
    for (to, &leaf) in origins.iter_mut().zip(leaves) {
        *to = culler.transform.world(leaf);
    }
    let filled = culler.field.fill_leaves(&mut Leaves {
        origins: &origins[..leaves.len()],
        step,
        by: 0.0,
        background,
        values,
        bits,
    });
    if let Some(samples) = filled
        && bits.iter().all(|b| b.finite)
    {
        // Leaves out of the band have no values.
        let kept = leaves.iter().zip(bits).filter(|(_, bits)| !bits.is_out());
        for ((&leaf, bits), values) in kept.zip(values) {
            contact::merge_solids(culler, leaf, values, bits);
        }
        return Ok(samples);
    }
    // The field has no such method, or a value is not finite: leaf by leaf the voxel can be named.
    let mut samples = 0;
    for (n, values) in values.iter_mut().enumerate() {
        let lattice = SampleLattice {
            origin: origins[n],
            step,
            counts: [LEAF as usize; 3],
        };
        samples += culler
            .field
            .fill_within(&lattice, &culler.leaf_limits, values);
        bits[n] = LeafBits::from_values(values, background);
        if !bits[n].finite {
            // There is one, since the leaf's bits have found it.
            let m = values.iter().position(|v| !v.is_finite()).unwrap_or(0);
            let voxel = leaves[n].offset((m >> 6) as i32, (m >> 3 & 7) as i32, (m & 7) as i32);
            return Err(BandError::NotFinite {
                value: values[m],
                voxel,
                place: culler.transform.world(voxel),
            });
        }
        contact::merge_solids(culler, leaves[n], values, &mut bits[n]);
    }
    Ok(samples)
}

/// The state of a leaf's mask.
#[derive(Clone, Copy, PartialEq)]
enum LeafState {
    /// More voxels may become active, next to a voxel of the other sign outside the band.
    Pending,
    /// The mask is final.
    Complete,
    /// No voxel is active; the leaf has no values.
    Inactive,
}

/// Evaluated consecutive leaves of a block. Batches hold those that are not inactive; their masks hold
/// the voxels within the band.
struct Slab {
    leaves: Range<usize>,
    batches: [LeafBatch; SLAB_LEAVES / BATCH_LEAVES],
    /// Whether no leaf is pending.
    is_complete: bool,
}

/// The leaves of a block that may be active, sorted by origin, with their signs and states.
struct Block<'a> {
    culler: &'a Culler<'a>,
    origin: Coord,
    origins: Vec<Coord>,
    /// Signs of the evaluated leaves.
    signs: Vec<Signs>,
    states: Vec<LeafState>,
    /// Number of the leaf in each of the 16^3 slots, z fastest.
    table: Vec<u16>,
}

impl<'a> Block<'a> {
    fn new(culler: &'a Culler<'a>, origin: Coord, origins: Vec<Coord>) -> Self {
        let mut table =
            vec![NO_LEAF; (BLOCK_EDGE_LEAVES * BLOCK_EDGE_LEAVES * BLOCK_EDGE_LEAVES) as usize];
        for (n, &leaf) in origins.iter().enumerate() {
            let [x, y, z] = slot(origin, leaf);
            table[((x * BLOCK_EDGE_LEAVES + y) * BLOCK_EDGE_LEAVES + z) as usize] = n as u16;
        }
        Self {
            culler,
            origin,
            signs: buffers::take_signs(origins.len()),
            states: vec![LeafState::Pending; origins.len()],
            origins,
            table,
        }
    }

    /// The end of the slab that begins at leaf `first`: as many whole x layers as fit, at least one, so
    /// that no leaf has a neighbour beyond the next slab.
    fn slab_end(&self, first: usize) -> usize {
        let mut last = first;
        while let Some(leaf) = self.origins.get(last) {
            let layer = self.origins[last..].partition_point(|o| o[0] == leaf[0]);
            if last > first && last + layer > first + SLAB_LEAVES {
                break;
            }
            last += layer;
        }
        last
    }

    /// Evaluates a slab; returns it and the number of samples evaluated. `leaves` are numbers of origins; signs and
    /// states of these are set. The slab is complete if the masks of all its leaves are final.
    fn evaluate(
        &mut self,
        leaves: Range<usize>,
        progress: &dyn Progress,
    ) -> Result<(Slab, u64), BandError> {
        let mut batches: [LeafBatch; SLAB_LEAVES / BATCH_LEAVES] = Default::default();
        let samples = self.origins[leaves.clone()]
            .par_chunks(BATCH_LEAVES)
            .zip(&mut batches)
            .zip(self.signs[leaves.clone()].par_chunks_mut(BATCH_LEAVES))
            .zip(self.states[leaves.clone()].par_chunks_mut(BATCH_LEAVES))
            .map(|(((origins, batch), signs), states)| {
                if progress.cancelled() {
                    return Err(BandError::from(Cancelled));
                }
                *batch = buffers::take_batch(origins.len());
                let mut bits = [LeafBits::default(); BATCH_LEAVES];
                let bits = &mut bits[..origins.len()];
                let samples = batch_values(self.culler, origins, &mut batch.values, bits)?;
                for (n, bits) in bits.iter().enumerate() {
                    signs[n] = bits.negative;
                    states[n] = if bits.is_out() {
                        LeafState::Inactive
                    } else if bits.settled || bits.within == [u64::MAX; 8] {
                        // Settled: samples beyond the band have their neighbours' sign; out: settled, none within.
                        // A full mask leaves nothing to activate.
                        LeafState::Complete
                    } else {
                        LeafState::Pending
                    };
                    if !bits.is_out() {
                        batch.origins.push(origins[n]);
                        batch.masks.push(bits.within);
                    }
                }
                // Values are in step with origins: a leaf that is out has left no gap among them.
                batch.values.truncate(batch.len());
                Ok(samples)
            })
            .try_reduce(|| 0, |a, b| Ok(a + b))?;
        let is_complete = !self.states[leaves.clone()].contains(&LeafState::Pending);
        let slab = Slab {
            leaves,
            batches,
            is_complete,
        };
        Ok((slab, samples))
    }

    /// Completes the masks of a slab: activates voxels next to a change of sign and removes leaves without
    /// active voxels; removed leaves that lie inside are added to `inside`. The next slab must have been
    /// evaluated, unless this one is complete. Returns the number of further samples evaluated.
    fn complete(&mut self, slab: &mut Slab, inside: &mut Vec<(Coord, i32)>) -> u64 {
        let mut samples = 0;
        if !slab.is_complete {
            let batches = slab.batches.par_iter_mut();
            let leaves = batches.flat_map(|b| b.masks.par_iter_mut().zip(&b.origins));
            samples = leaves
                .filter(|(_, leaf)| self.states[self.number(**leaf)] == LeafState::Pending)
                .map(|(mask, leaf)| self.activate(*leaf, mask))
                .sum();
            for batch in &mut slab.batches {
                self.remove_inactive(batch);
            }
        }
        for n in slab.leaves.clone() {
            if self.states[n] == LeafState::Inactive && self.signs[n][0] & 1 == 1 {
                inside.push((self.origins[n], LEAF));
            }
        }
        samples
    }

    /// Removes the leaves without active voxels from a batch.
    fn remove_inactive(&mut self, batch: &mut LeafBatch) {
        let mut kept = 0;
        for n in 0..batch.len() {
            if batch.masks[n] == [0; 8] {
                let number = self.number(batch.origins[n]);
                self.states[number] = LeafState::Inactive;
                continue;
            }
            if kept < n {
                batch.origins[kept] = batch.origins[n];
                batch.masks[kept] = batch.masks[n];
                batch.values.copy_within(n..=n, kept);
            }
            kept += 1;
        }
        batch.origins.truncate(kept);
        batch.masks.truncate(kept);
        batch.values.truncate(kept);
    }

    /// The number of an evaluated leaf.
    fn number(&self, leaf: Coord) -> usize {
        let [x, y, z] = slot(self.origin, leaf);
        usize::from(self.table[((x * BLOCK_EDGE_LEAVES + y) * BLOCK_EDGE_LEAVES + z) as usize])
    }

    /// Adds the voxels next to a change of sign to a leaf's mask; returns the number of samples that were
    /// evaluated beyond the block.
    fn activate(&self, leaf: Coord, mask: &mut [u64; 8]) -> u64 {
        let mut near = Neighbourhood::default();
        // The signs of the 27 leaves around this one, as far as they are in the block.
        let own = slot(self.origin, leaf);
        for d in 0..27usize {
            let direction = [d / 9, d / 3 % 3, d % 3];
            let [x, y, z] = [0, 1, 2].map(|a| own[a] + direction[a] as i32 - 1);
            if [x, y, z]
                .iter()
                .any(|c| !(0..BLOCK_EDGE_LEAVES).contains(c))
            {
                continue;
            }
            let number = self.table[((x * BLOCK_EDGE_LEAVES + y) * BLOCK_EDGE_LEAVES + z) as usize];
            // `NO_LEAF` is beyond the list: the leaf was culled and has its neighbours' sign.
            if let Some(signs) = self.signs.get(number as usize) {
                near.set_leaf(direction, signs);
            }
        }
        // Layers that lie in other blocks are evaluated here, so that a block needs no other.
        let mut samples = 0;
        for axis in 0..3 {
            for (at_end, outside) in [
                (leaf[axis] == self.origin[axis], -1),
                (leaf[axis] + LEAF == self.origin[axis] + BLOCK, LEAF),
            ] {
                if at_end {
                    let layer = OuterLayer { axis, outside };
                    samples += layer.set_signs(self.culler, leaf, mask, &mut near);
                }
            }
        }
        for (word, changed) in mask.iter_mut().zip(near.next_to_change()) {
            *word |= changed;
        }
        samples
    }
}

/// The slot of a leaf among the 16^3 of a block.
fn slot(block: Coord, leaf: Coord) -> [i32; 3] {
    [0, 1, 2].map(|a| (leaf[a] - block[a]) / LEAF)
}

/// The layer of samples at index `outside` (-1 or 8) of an axis of a leaf, in another block. It has a sample more than
/// the leaf on all sides.
#[derive(Clone, Copy)]
struct OuterLayer {
    axis: usize,
    outside: i32,
}

impl OuterLayer {
    /// Sets the signs of the samples next to voxels that are not active; returns the number of samples evaluated: 0 if
    /// there are no such voxels, or if the bound proves one sign throughout.
    fn set_signs(
        self,
        culler: &Culler,
        leaf: Coord,
        mask: &[u64; 8],
        near: &mut Neighbourhood,
    ) -> u64 {
        let Self { axis, outside } = self;
        let face = outside.clamp(0, LEAF - 1);
        let Some(needed) = self.next_to_inactive(mask, face as usize) else {
            return 0;
        };
        let corner = |along: i32, across: i32| {
            let mut c = leaf.offset(across, across, across);
            c.0[axis] = leaf[axis] + along;
            culler.transform.world(c).0
        };
        // The layer and the face of the leaf beside it.
        let region = Aabb {
            min: corner(outside.min(face), -1),
            max: corner(outside.max(face), LEAF),
        };
        let bound = culler.field.bound(&region);
        if bound.lo > 0.0 || bound.hi < 0.0 {
            return 0;
        }
        let mut counts = [SPAN; 3];
        counts[axis] = 1;
        let lattice = SampleLattice {
            origin: WorldPoint(corner(outside, -1)),
            step: culler.transform.voxel_size(),
            counts,
        };
        let count = counts[0] * counts[1];
        let mut rows = [0; SPAN * SPAN];
        let samples = culler
            .field
            .signs(&lattice, &needed[..count], &mut rows[..count]);
        let mut first = [0; 3];
        first[axis] = (outside + 1) as usize;
        for (n, &needed) in needed[..count].iter().enumerate() {
            let at = [first[0] + n / counts[1], first[1] + n % counts[1], first[2]];
            near.set_row(at, needed, rows[n]);
        }
        samples
    }

    /// The samples of the layer next to voxels in layer `face` of the leaf that are not active, a bit each in rows along
    /// z; `None` if there are none.
    fn next_to_inactive(self, mask: &[u64; 8], face: usize) -> Option<[u64; SPAN * SPAN]> {
        // The inactive voxels of the face: a word for each index along its first axis.
        let inactive: [u64; 8] = std::array::from_fn(|a| match self.axis {
            0 => !mask[face] >> (8 * a) & 0xff,
            1 => !mask[a] >> (8 * face) & 0xff,
            _ => (0..8).fold(0, |row, b| row | (!mask[a] >> (8 * b + face) & 1) << b),
        });
        if inactive == [0; 8] {
            return None;
        }
        // Voxel a of the face is next to samples a to a + 2 of the layer, whose first is -1.
        let mut needed = [0; SPAN * SPAN];
        for (a, row) in inactive.into_iter().enumerate() {
            let row = row | row << 1 | row << 2;
            for a in a..a + 3 {
                if self.axis < 2 {
                    needed[a] |= row;
                } else {
                    for b in 0..SPAN {
                        needed[SPAN * a + b] |= row >> b & 1;
                    }
                }
            }
        }
        Some(needed)
    }
}
