//! Rule Q for the samples of a small box at a time: cells are asked for many points at once.
//!
//! Blocks of 2^3 samples that lie in one element are first asked at their centre: with L the slope's
//! bound and R the block's half diagonal, |F| >= L (R + w) there decides all of them. Samples that are
//! left are asked for their value, those with |F| < L w for gradients, in their owner and in the
//! elements that share in the blend, there and one step on. What comes out is what single points give.

use super::near::{Known, Local, Owner};
use super::patch::Spot;
use super::scale::Advance;
use super::{Filling, TiledSolid};
use crate::frame::{CellPoint, Vec3};

/// A sample whose distance is wanted.
struct Item {
    /// Where the distance goes.
    n: usize,
    x: Vec3,
    owner: Owner,
    /// How deep it lies under its owner's faces; a voxel stands for more.
    depth: f64,
    f: f64,
    sum: f64,
    weights: f64,
}

/// What an element says of a sample.
struct Share {
    item: usize,
    place: usize,
    spot: Spot,
    weight: f64,
    advance: Advance,
}

/// A block of samples within one element.
struct Block {
    number: usize,
    owner: Owner,
    depth: f64,
    f: f64,
}

/// A sample: where its value goes, and where it lies.
pub(super) type Target = (usize, Vec3);

/// Room for the work, kept between boxes.
#[derive(Default)]
pub(super) struct Batch {
    blocks: Vec<Block>,
    items: Vec<Item>,
    shares: Vec<Share>,
    points: Vec<CellPoint<3>>,
    values: Vec<f64>,
    slopes: Vec<(f64, Vec3)>,
    ahead: Vec<(usize, Spot)>,
    /// At how many points a cell was looked at: samples, and centres of blocks.
    pub looked: u64,
}

/// Calls `work` for each run of equal keys in `0..count`.
fn runs(count: usize, key: impl Fn(usize) -> usize, mut work: impl FnMut(std::ops::Range<usize>)) {
    let mut first = 0;
    for end in 1..=count {
        if end == count || key(end) != key(first) {
            work(first..end);
            first = end;
        }
    }
}

/// The centre of some samples and the greatest distance from it.
fn ball(samples: &[Target]) -> (Vec3, f64) {
    // Of a lattice in storage order the first and the last are opposite corners.
    match (samples.first(), samples.last()) {
        (Some(a), Some(b)) => ((a.1 + b.1) / 2.0, (b.1 - a.1).norm() / 2.0),
        _ => (Vec3::zeros(), 0.0),
    }
}

impl<F: Filling> TiledSolid<'_, F> {
    /// Distances at samples, given block by block in the order of a lattice; the boundary regarded as
    /// `known` says.
    pub(super) fn measure(
        &self,
        component: usize,
        local: &mut Local,
        blocks: &[Vec<Target>],
        known: Known,
        batch: &mut Batch,
        out: &mut [f32],
    ) {
        self.find_blocks(local, blocks, batch);
        batch.items.clear();
        let mut whole = 0;
        for (number, samples) in blocks.iter().enumerate() {
            let (_, radius) = ball(samples);
            let block = batch.blocks.get(whole).filter(|b| b.number == number);
            whole += usize::from(block.is_some());
            let w = self.options.half_width;
            if let Some(b) = block
                && b.f.abs() >= local.near.slope_sup * (radius + w)
            {
                let d = w.copysign(b.f);
                for &(n, x) in samples {
                    out[n] = self.cut(component, d, x, known) as f32;
                }
                continue;
            }
            let certain = block.map(|b| (b.owner.place, b.depth - radius));
            for &(n, x) in samples {
                let owner = match certain {
                    Some((place, _)) => self
                        .spot(local, place, x, f64::INFINITY)
                        .map(|spot| Owner { place, spot }),
                    None => self.owner(local, x),
                };
                let Some(owner) = owner else {
                    batch.looked += 1;
                    out[n] = self.value_at(component, local, x, known) as f32;
                    continue;
                };
                let depth = match certain {
                    Some((_, depth)) if depth >= self.delta() => depth,
                    _ => self.patch(local, owner.place).depth(x, &owner.spot),
                };
                batch.items.push(Item {
                    n,
                    x,
                    owner,
                    depth,
                    f: 0.0,
                    sum: 0.0,
                    weights: 0.0,
                });
            }
        }
        self.ask_values(local, batch);
        let w = self.options.half_width;
        let most = w * local.near.slope_sup;
        batch.items.retain(|i| {
            // Every scale is at least 1 / L.
            let is_far = i.f.abs() >= most;
            if is_far {
                out[i.n] = self.cut(component, w.copysign(i.f), i.x, known) as f32;
            }
            !is_far
        });
        self.blend(local, batch);
        for i in &batch.items {
            let d = (i.f * i.sum / i.weights).clamp(-w, w);
            out[i.n] = self.cut(component, d, i.x, known) as f32;
        }
    }

    /// Finds the blocks that lie in one element, and the field at their centres.
    fn find_blocks(&self, local: &mut Local, blocks: &[Vec<Target>], batch: &mut Batch) {
        batch.blocks.clear();
        batch.points.clear();
        for (number, samples) in blocks.iter().enumerate() {
            let (centre, radius) = ball(samples);
            let Some(owner) = self.owner(local, centre) else {
                continue;
            };
            let depth = self.patch(local, owner.place).depth(centre, &owner.spot);
            if depth > radius {
                batch.points.push(CellPoint(owner.spot.xi));
                batch.blocks.push(Block {
                    number,
                    owner,
                    depth,
                    f: 0.0,
                });
            }
        }
        let Batch {
            blocks,
            points,
            values,
            ..
        } = &mut *batch;
        values.resize(points.len(), 0.0);
        runs(
            blocks.len(),
            |n| blocks[n].owner.place,
            |run| {
                let element = local.near.patches[blocks[run.start].owner.place] as usize;
                self.filling
                    .values(element, &points[run.clone()], &mut values[run]);
            },
        );
        batch.looked += batch.points.len() as u64;
        for (block, &f) in batch.blocks.iter_mut().zip(&batch.values) {
            block.f = f;
        }
    }

    /// The field at all samples.
    fn ask_values(&self, local: &Local, batch: &mut Batch) {
        let Batch {
            items,
            points,
            values,
            ..
        } = &mut *batch;
        if items
            .windows(2)
            .any(|w| w[0].owner.place > w[1].owner.place)
        {
            items.sort_by_key(|i| i.owner.place);
        }
        points.clear();
        points.extend(items.iter().map(|i| CellPoint(i.owner.spot.xi)));
        values.resize(points.len(), 0.0);
        runs(
            items.len(),
            |n| items[n].owner.place,
            |run| {
                let element = local.near.patches[items[run.start].owner.place] as usize;
                self.filling
                    .values(element, &points[run.clone()], &mut values[run]);
            },
        );
        for (item, &f) in items.iter_mut().zip(values.iter()) {
            item.f = f;
        }
        batch.looked += batch.points.len() as u64;
    }

    /// Asks for slopes at the points of the batch, whose elements' places `place` says.
    fn ask_slopes(
        &self,
        local: &Local,
        batch_points: &[CellPoint<3>],
        place: impl Fn(usize) -> usize,
        slopes: &mut Vec<(f64, Vec3)>,
    ) {
        slopes.resize(batch_points.len(), (0.0, Vec3::zeros()));
        runs(batch_points.len(), &place, |run| {
            let element = local.near.patches[place(run.start)] as usize;
            self.filling
                .slopes(element, &batch_points[run.clone()], &mut slopes[run]);
        });
    }

    /// Sums the scales of the elements that share in each sample.
    fn blend(&self, local: &Local, batch: &mut Batch) {
        let Batch {
            items,
            shares,
            points,
            slopes,
            ahead,
            ..
        } = batch;
        shares.clear();
        let mut is_sorted = true;
        for (number, item) in items.iter().enumerate() {
            let own = Share {
                item: number,
                place: item.owner.place,
                spot: item.owner.spot,
                weight: 1.0,
                advance: Advance::default(),
            };
            is_sorted &= shares.last().is_none_or(|s| s.place <= own.place);
            shares.push(own);
            if item.depth >= self.delta() {
                continue;
            }
            for place in (0..local.near.patches.len()).filter(|&p| p != item.owner.place) {
                let Some(spot) = self.spot(local, place, item.x, self.delta()) else {
                    continue;
                };
                let beyond = self.patch(local, place).overshoot(item.x, &spot);
                let weight = 1.0 - beyond.max(item.depth) / self.delta();
                if weight > 0.0 {
                    is_sorted = false;
                    shares.push(Share {
                        item: number,
                        place,
                        spot,
                        weight,
                        advance: Advance::default(),
                    });
                }
            }
        }
        // In order of element numbers, so that both sides of a face sum alike.
        if !is_sorted {
            shares.sort_by_key(|s| s.place);
        }
        points.clear();
        points.extend(shares.iter().map(|s| CellPoint(s.spot.xi)));
        self.ask_slopes(local, points, |n| shares[n].place, slopes);
        points.clear();
        ahead.clear();
        for (n, share) in shares.iter_mut().enumerate() {
            let item = &mut items[share.item];
            let (f, g) = slopes[n];
            if share.place == item.owner.place {
                item.f = f;
            }
            let patch = self.patch(local, share.place);
            share.advance = self.advance(patch, (f, share.spot.inverse.tr_mul(&g)));
            if share.advance.goes_on() {
                let step = share.advance.step;
                let spot = patch.follow(self.scaffold, &share.spot, step, item.x + step);
                points.push(CellPoint(spot.xi));
                ahead.push((n, spot));
            }
        }
        self.ask_slopes(local, points, |n| shares[ahead[n].0].place, slopes);
        for (&(n, ref spot), &(f, g)) in ahead.iter().zip(slopes.iter()) {
            let patch = self.patch(local, shares[n].place);
            let slope = (f, spot.inverse.tr_mul(&g));
            shares[n].advance.arrive(self.step(patch, slope));
        }
        for share in shares.iter() {
            let item = &mut items[share.item];
            let scale = share.advance.scale(self.patch(local, share.place));
            item.sum += share.weight * scale;
            item.weights += share.weight;
        }
    }
}
