//! Evaluation by blocks.

use super::activate::{Neighbourhood, SPAN};
use super::buffers::{self, Signs};
use super::contact;
use super::cull::Culler;
use super::{BLOCK, Band, BandError, BandStats, LEAF, LeafBatch, LeafSink, Region, VOXELS};
use crate::field::{LeafBits, Leaves, SampleLattice};
use crate::frame::{Aabb, Coord, Vec3, WorldPoint};
use crate::progress::{Cancelled, Progress, Threads};
use rayon::prelude::*;
use std::ops::Range;

/// Most leaves in a batch, which are evaluated at once, between two looks at whether the user asked to stop.
const GROUP: usize = 32;
/// Most leaves of a stretch: no fewer than those of one x.
const STRETCH: usize = (EDGE * EDGE) as usize;
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
/// time: of the one to be delivered, and of the next one, whose signs it waits for. A stretch whose
/// leaves are settled waits for nothing, and its values are still in the cache when they are read. Leaves
/// that are proved to have no active voxels leave no values.
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
        let mut next = None;
        if first < last {
            let (stretch, looked) = block.evaluate(first..last, progress)?;
            stats.voxels_evaluated += looked;
            next = Some(stretch);
        }
        first = last;
        let settled = next.take_if(|stretch| stretch.is_settled);
        for mut stretch in [waiting.take(), settled].into_iter().flatten() {
            stats.voxels_evaluated += block.settle(&mut stretch, &mut inside);
            for batch in stretch.batches {
                stats.leaves_kept += batch.len() as u64;
                stats.active_voxels += batch.active_voxels();
                if !batch.is_empty() {
                    sink.block(origin, &batch)?;
                }
                buffers::give_batch(batch);
            }
        }
        waiting = next;
    }
    sink.inside(&inside);
    buffers::give_signs(block.signs);
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
) -> Result<(LeafBits, u64), BandError> {
    let mut bits = [LeafBits::default()];
    let values = std::slice::from_mut(values);
    let looked = group_values(culler, &[origin], values, &mut bits)?;
    Ok((bits[0], looked))
}

/// The same for at most [`GROUP`] leaves, sorted by origin.
pub(super) fn group_values(
    culler: &Culler,
    leaves: &[Coord],
    values: &mut [[f32; VOXELS]],
    bits: &mut [LeafBits],
) -> Result<u64, BandError> {
    let step = culler.transform.voxel_size();
    let background = culler.background as f32;
    let mut origins = [WorldPoint(Vec3::zeros()); GROUP];
    for (to, &leaf) in origins.iter_mut().zip(leaves) {
        *to = culler.transform.world(leaf);
    }
    let together = culler.field.fill_leaves(&mut Leaves {
        origins: &origins[..leaves.len()],
        step,
        by: 0.0,
        background,
        values,
        bits,
    });
    if let Some(looked) = together
        && bits.iter().all(|b| b.finite)
    {
        // Leaves that are out have left no values.
        let kept = leaves.iter().zip(bits).filter(|(_, bits)| !bits.is_out());
        for ((&leaf, bits), values) in kept.zip(values) {
            contact::join(culler, leaf, values, bits);
        }
        return Ok(looked);
    }
    let mut looked = 0;
    for (n, values) in values.iter_mut().enumerate() {
        let lattice = SampleLattice {
            origin: origins[n],
            step,
            counts: [LEAF as usize; 3],
        };
        looked += culler.field.fill_counting(&lattice, values);
        bits[n] = LeafBits::look_at(values, background);
        if !bits[n].finite {
            let m = values.iter().position(|v| !v.is_finite()).unwrap_or(0);
            let voxel = leaves[n].offset((m >> 6) as i32, (m >> 3 & 7) as i32, (m & 7) as i32);
            return Err(BandError::NotFinite {
                value: values[m],
                voxel,
                place: culler.transform.world(voxel),
            });
        }
        contact::join(culler, leaves[n], values, &mut bits[n]);
    }
    Ok(looked)
}

/// What is known of a leaf.
#[derive(Clone, Copy, PartialEq)]
enum Standing {
    /// Voxels may be active because a neighbour beyond the band has the other sign.
    Open,
    /// Its mask is all there is to it.
    Settled,
    /// No voxel is active: it has no values.
    Out,
}

/// Consecutive leaves of a block, evaluated: the values of those that are not out, and for masks what
/// lies within the band.
struct Stretch {
    leaves: Range<usize>,
    batches: [LeafBatch; STRETCH / GROUP],
    /// Whether no leaf is open.
    is_settled: bool,
}

/// The leaves of a block that may be active, sorted by origin, and what is known of them.
struct Block<'a> {
    culler: &'a Culler<'a>,
    origin: Coord,
    origins: Vec<Coord>,
    /// Of the leaves that were evaluated.
    signs: Vec<Signs>,
    standings: Vec<Standing>,
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
            signs: buffers::signs(origins.len()),
            standings: vec![Standing::Open; origins.len()],
            origins,
            table,
        }
    }

    /// Where the stretch from a leaf on ends: after as many layers of leaves of one x as it may hold,
    /// at least one, so that no leaf has a neighbour beyond the next stretch.
    fn stretch(&self, first: usize) -> usize {
        let mut last = first;
        while let Some(leaf) = self.origins.get(last) {
            let layer = self.origins[last..].partition_point(|o| o[0] == leaf[0]);
            if last > first && last + layer > first + STRETCH {
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
        let mut batches: [LeafBatch; STRETCH / GROUP] = Default::default();
        let looked = self.origins[leaves.clone()]
            .par_chunks(GROUP)
            .zip(&mut batches)
            .zip(self.signs[leaves.clone()].par_chunks_mut(GROUP))
            .zip(self.standings[leaves.clone()].par_chunks_mut(GROUP))
            .map(|(((group, batch), signs), standings)| {
                if progress.cancelled() {
                    return Err(BandError::from(Cancelled));
                }
                *batch = buffers::batch(group.len());
                let mut bits = [LeafBits::default(); GROUP];
                let bits = &mut bits[..group.len()];
                let looked = group_values(self.culler, group, &mut batch.values, bits)?;
                for (n, bits) in bits.iter().enumerate() {
                    signs[n] = bits.negative;
                    standings[n] = if bits.is_out() {
                        Standing::Out
                    } else if bits.settled || bits.within == [u64::MAX; 8] {
                        // Only an inactive voxel may become active by its neighbours.
                        Standing::Settled
                    } else {
                        Standing::Open
                    };
                    if !bits.is_out() {
                        batch.origins.push(group[n]);
                        batch.masks.push(bits.within);
                    }
                }
                batch.values.truncate(batch.len());
                Ok(looked)
            })
            .try_reduce(|| 0, |a, b| Ok(a + b))?;
        let is_settled = !self.standings[leaves.clone()].contains(&Standing::Open);
        let stretch = Stretch {
            leaves,
            batches,
            is_settled,
        };
        Ok((stretch, looked))
    }

    /// Activates what lies next to a change of sign and takes away the leaves that have no active voxels;
    /// those that lie inside go to `inside`. Needs the next stretch evaluated, unless this one is settled.
    /// Gives at how many more points the field was looked at.
    fn settle(&mut self, stretch: &mut Stretch, inside: &mut Vec<(Coord, i32)>) -> u64 {
        let mut looked = 0;
        if !stretch.is_settled {
            let batches = stretch.batches.par_iter_mut();
            let leaves = batches.flat_map(|b| b.masks.par_iter_mut().zip(&b.origins));
            looked = leaves
                .filter(|(_, leaf)| self.standings[self.number(**leaf)] == Standing::Open)
                .map(|(mask, leaf)| self.activate(*leaf, mask))
                .sum();
            for batch in &mut stretch.batches {
                self.drop_empty(batch);
            }
        }
        for n in stretch.leaves.clone() {
            if self.standings[n] == Standing::Out && self.signs[n][0] & 1 == 1 {
                inside.push((self.origins[n], LEAF));
            }
        }
        looked
    }

    /// Takes the leaves without active voxels out of a batch.
    fn drop_empty(&mut self, batch: &mut LeafBatch) {
        let mut kept = 0;
        for place in 0..batch.len() {
            if batch.masks[place] == [0; 8] {
                let number = self.number(batch.origins[place]);
                self.standings[number] = Standing::Out;
                continue;
            }
            if kept < place {
                batch.origins[kept] = batch.origins[place];
                batch.masks[kept] = batch.masks[place];
                batch.values.copy_within(place..=place, kept);
            }
            kept += 1;
        }
        batch.origins.truncate(kept);
        batch.masks.truncate(kept);
        batch.values.truncate(kept);
    }

    /// The number of a leaf that was evaluated.
    fn number(&self, leaf: Coord) -> usize {
        let [x, y, z] = place(self.origin, leaf);
        usize::from(self.table[((x * EDGE + y) * EDGE + z) as usize])
    }

    /// Adds to the mask of a leaf's voxels within the band those next to a change of sign; gives how many
    /// samples beyond the block it took to find them.
    fn activate(&self, leaf: Coord, mask: &mut [u64; 8]) -> u64 {
        let mut near = Neighbourhood::default();
        let own = place(self.origin, leaf);
        for d in 0..27usize {
            let direction = [d / 9, d / 3 % 3, d % 3];
            let [x, y, z] = [0, 1, 2].map(|a| own[a] + direction[a] as i32 - 1);
            if [x, y, z].iter().any(|c| !(0..EDGE).contains(c)) {
                continue;
            }
            let number = self.table[((x * EDGE + y) * EDGE + z) as usize];
            if let Some(signs) = self.signs.get(number as usize) {
                near.enter_leaf(direction, signs);
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
        for (word, changed) in mask.iter_mut().zip(near.next_to_change()) {
            *word |= changed;
        }
        taken
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
