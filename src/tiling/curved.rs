//! Rule Q for the samples of a small box at a time: cells are asked for many points at once.
//!
//! Blocks of 2^3 samples that lie in one element are first asked at their centre: with L the slope's
//! bound and R the block's half diagonal, |F| >= L (R + w) there decides all of them. Samples that are
//! left are asked for value and gradient; where second derivatives of the map place the block's corners
//! within 1e-7 of the cell, they place all of it, else Newton's method does. Those with |F| < L w are
//! seated in their owner and in the elements that share in the blend, which are asked for gradients, there
//! and one step on. What comes out is what single points give, but for those 1e-7.

mod in_band_samples;

use super::boundary::Known;
use super::local_map::Trail;
use super::locality::{Asking, Local, Owner};
use super::newton_distance::Leg;
use super::patch::{Patch, Spot, Spots};
use super::{Filling, TiledSolid};
use crate::frame::{CellPoint, Mat3, Vec3};
use in_band_samples::{Seat, Sum};

/// A sample: where its value goes, and where it lies.
#[derive(Clone, Copy)]
pub(super) struct Target {
    pub n: u32,
    pub x: Vec3,
}

/// A sample whose distance is wanted.
struct Item {
    target: Target,
    /// Its owner's place in the list of near elements.
    place: u32,
    how: How,
    /// How deep it lies under its owner's faces; a voxel stands for more.
    depth: f64,
}

/// How a sample was placed in its owner.
#[derive(Clone, Copy)]
enum How {
    /// By a trail.
    Trail(u32),
    /// By itself, with d xi / d x in a list.
    Alone(u32),
}

/// A block of samples within one element.
struct Block {
    number: usize,
    place: usize,
    radius: f64,
    /// Its centre's.
    trail: u32,
    /// Whether its samples are where they are guessed to be.
    is_smooth: bool,
    depth: f64,
    f: f64,
}

/// Guesses this good, in reference units, need no step of Newton's method.
const GOOD: f64 = 1e-7;

/// Points in elements that are asked for values together.
#[derive(Default)]
struct Questions {
    places: Vec<u32>,
    points: Vec<CellPoint<3>>,
}

/// Room for the work, kept between boxes.
#[derive(Default)]
pub(super) struct Batch {
    blocks: Vec<Block>,
    /// Of blocks.
    trails: Vec<Trail>,
    /// Samples whose element is not known from their block's.
    open: Vec<Target>,
    at: Vec<Vec3>,
    owners: Vec<Option<Owner>>,
    found: Spots,
    asking: Asking,
    items: Vec<Item>,
    /// d xi / d x of items that were placed alone.
    alone: Vec<Mat3>,
    /// One for every item, or for every block.
    asked: Questions,
    /// Values at the centres of blocks.
    values: Vec<f64>,
    /// Values and gradients of items in their owners.
    own: Vec<(f64, Vec3)>,
    /// Items in the band near faces.
    shared: Vec<u32>,
    seats: Vec<Seat>,
    /// One for every seat.
    points: Vec<CellPoint<3>>,
    /// One for every seat that no trail has d xi / d x for.
    inverses: Vec<Mat3>,
    slopes: Vec<(f64, Vec3)>,
    legs: Vec<Leg>,
    scales: Vec<f64>,
    /// Items that are looked for in a neighbour.
    guests: Vec<u32>,
    /// One for every item.
    sums: Vec<Sum>,
    /// At how many points a cell was looked at: samples, and centres of blocks.
    pub looked: u64,
}

impl Questions {
    fn clear(&mut self) {
        self.places.clear();
        self.points.clear();
    }

    fn push(&mut self, place: u32, xi: Vec3) {
        self.places.push(place);
        self.points.push(CellPoint(xi));
    }
}

/// Opposite corners of a block: of a lattice in storage order the first sample and the last.
fn ends(samples: &[Target]) -> [Vec3; 2] {
    match (samples.first(), samples.last()) {
        (Some(a), Some(b)) => [a.x, b.x],
        _ => [Vec3::zeros(); 2],
    }
}

/// The centre of some samples and the greatest distance from it.
fn ball(samples: &[Target]) -> (Vec3, f64) {
    let [a, b] = ends(samples);
    ((a + b) / 2.0, (b - a).norm() / 2.0)
}

/// Corners of a block of samples of which no two share an edge: guesses that err by odd powers of the
/// distance, or by even ones, err alike at the other corners.
fn corners(samples: &[Target]) -> [Vec3; 4] {
    let [a, b] = ends(samples);
    [
        a,
        Vec3::new(a.x, b.y, b.z),
        Vec3::new(b.x, a.y, b.z),
        Vec3::new(b.x, b.y, a.z),
    ]
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
        batch.alone.clear();
        batch.asked.clear();
        batch.open.clear();
        let w = self.options.half_width;
        let mut found = |t: &Target, d: f64| {
            out[t.n as usize] = self.cut(component, d, t.x, known) as f32;
        };
        let whole = std::mem::take(&mut batch.blocks);
        let mut next = 0;
        for (number, samples) in blocks.iter().enumerate() {
            let Some(block) = whole.get(next).filter(|b| b.number == number) else {
                batch.open.extend(samples);
                continue;
            };
            if block.f.abs() >= self.rise(&local.near, block.radius + w) {
                let d = w.copysign(block.f);
                for t in samples {
                    found(t, d);
                }
            } else {
                self.enter_block(local, samples, block, batch);
            }
            next += 1;
        }
        batch.blocks = whole;
        self.enter_open(local, batch, |local, t| {
            let d = self.value_at(component, local, t.x, known);
            out[t.n as usize] = d as f32;
        });
        self.ask_owners(local, batch);
        let mut found = |t: &Target, d: f64| {
            out[t.n as usize] = self.cut(component, d, t.x, known) as f32;
        };
        self.seat(local, batch, &mut found);
        self.blend(local, batch, &mut found);
    }

    /// Finds the blocks that lie in one element, and the field at their centres.
    fn find_blocks(&self, local: &mut Local, blocks: &[Vec<Target>], batch: &mut Batch) {
        batch.blocks.clear();
        batch.trails.clear();
        batch.asked.clear();
        batch.at.clear();
        batch.at.extend(blocks.iter().map(|b| ball(b).0));
        let Batch { at, owners, .. } = batch;
        self.owners(local, at, &mut batch.asking, owners);
        for (number, (&x, owner)) in at.iter().zip(owners).enumerate() {
            let Some(Owner { place, spot }) = owner else {
                continue;
            };
            let patch = self.patch(local, *place);
            let (radius, depth) = (ball(&blocks[number]).1, patch.depth(spot));
            if depth <= radius {
                continue;
            }
            // Second derivatives change little from block to block.
            let last = batch.blocks.last().filter(|b| b.place == *place);
            let trail = match last {
                Some(last) => batch.trails[last.trail as usize].moved(x, spot),
                None => self.note_trail(local, *place, x, spot),
            };
            let error = patch.error(self.scaffold, &trail, corners(&blocks[number]));
            let is_smooth = error < GOOD;
            batch.trails.push(trail);
            batch.asked.push(*place as u32, spot.xi);
            batch.blocks.push(Block {
                number,
                place: *place,
                radius,
                trail: batch.trails.len() as u32 - 1,
                is_smooth,
                depth,
                f: 0.0,
            });
        }
        self.ask_values(local, batch);
        for (block, &f) in batch.blocks.iter_mut().zip(&batch.values) {
            block.f = f;
        }
    }

    /// Enters the samples of a block that lies in one element.
    fn enter_block(&self, local: &Local, samples: &[Target], block: &Block, batch: &mut Batch) {
        // A voxel stands for all depths that are more.
        let sure = block.depth - block.radius;
        let patch = self.patch(local, block.place);
        batch.at.clear();
        batch.at.extend(samples.iter().map(|t| t.x));
        if block.is_smooth {
            let first = batch.asked.points.len();
            let trail = &batch.trails[block.trail as usize];
            trail.guess_all(&batch.at, &mut batch.asked.points);
            let place = block.place as u32;
            batch.asked.places.resize(batch.asked.points.len(), place);
            for (&target, xi) in samples.iter().zip(&batch.asked.points[first..]) {
                let depth = if sure < self.delta() {
                    patch.depth_at(target.x, xi.0)
                } else {
                    sure
                };
                batch.items.push(Item {
                    target,
                    place,
                    how: How::Trail(block.trail),
                    depth,
                });
            }
            return;
        }
        let mut found = std::mem::take(&mut batch.found);
        let all = (&*batch.at, f64::INFINITY);
        let mut trail = batch.trails[block.trail as usize];
        patch.spots(self.scaffold, all, (&mut trail, true), &mut found);
        for (&target, spot) in samples.iter().zip(&found.all) {
            match spot {
                Some(spot) => batch.enter_alone(target, block.place, spot, patch),
                None => batch.open.push(target),
            }
        }
        batch.found = found;
    }

    /// Enters samples whose owner is to be found; those without are handed to `strays`.
    fn enter_open(
        &self,
        local: &mut Local,
        batch: &mut Batch,
        mut strays: impl FnMut(&mut Local, &Target),
    ) {
        let Batch {
            open, at, owners, ..
        } = batch;
        at.clear();
        at.extend(open.iter().map(|t| t.x));
        self.owners(local, at, &mut batch.asking, owners);
        let owners = std::mem::take(&mut batch.owners);
        for (n, owner) in owners.iter().enumerate() {
            let target = batch.open[n];
            if let Some(Owner { place, spot }) = owner {
                batch.enter_alone(target, *place, spot, self.patch(local, *place));
            } else {
                batch.looked += 1;
                strays(local, &target);
            }
        }
        batch.owners = owners;
    }

    /// The field and its gradient at all samples, in their owners.
    fn ask_owners(&self, local: &Local, batch: &mut Batch) {
        let Batch { asked, own, .. } = &mut *batch;
        own.resize(asked.points.len(), (0.0, Vec3::zeros()));
        let mut first = 0;
        for run in asked.places.chunk_by(|a, b| a == b) {
            let all = first..first + run.len();
            first = all.end;
            let place = run[0] as usize;
            self.ask_slopes(local, place, &asked.points[all.clone()], &mut own[all]);
        }
        batch.looked += batch.asked.points.len() as u64;
    }

    /// Values and gradients at points of one of the near elements.
    fn ask_slopes(
        &self,
        local: &Local,
        place: usize,
        points: &[CellPoint<3>],
        slopes: &mut [(f64, Vec3)],
    ) {
        let element = local.near.patches[place] as usize;
        self.filling.slopes(element, points, slopes);
    }

    /// The field at all points that are asked for.
    fn ask_values(&self, local: &Local, batch: &mut Batch) {
        let Batch { asked, values, .. } = &mut *batch;
        values.resize(asked.points.len(), 0.0);
        let mut first = 0;
        for run in asked.places.chunk_by(|a, b| a == b) {
            let element = local.near.patches[run[0] as usize] as usize;
            let all = first..first + run.len();
            first = all.end;
            self.filling
                .values(element, &asked.points[all.clone()], &mut values[all]);
        }
        batch.looked += batch.asked.points.len() as u64;
    }
}

impl Batch {
    /// Enters a sample that was placed in its owner by itself.
    fn enter_alone(&mut self, target: Target, place: usize, spot: &Spot, patch: &Patch) {
        self.alone.push(spot.inverse);
        let how = How::Alone(self.alone.len() as u32 - 1);
        let (place, depth) = (place as u32, patch.depth(spot));
        self.asked.push(place, spot.xi);
        self.items.push(Item {
            target,
            place,
            how,
            depth,
        });
    }
}
