//! Rule Q for the samples of a small box at a time: cells are asked for many points at once.
//!
//! Blocks of 2^3 samples that lie in one element are first asked at their centre: with L the slope's
//! bound and R the block's half diagonal, |F| >= L (R + w) there decides all of them. Samples that are
//! left are asked for their value; those with |F| < L w are seated in their owner and in the elements
//! that share in the blend, which are asked for gradients, there and one step on. What comes out is
//! what single points give.

use super::near::{Asking, Known, Local, Owner};
use super::patch::Spot;
use super::place::Trail;
use super::walk::{self, Leg, Walkers};
use super::{Filling, TiledSolid};
use crate::frame::{CellPoint, Mat3, Vec3};

/// A sample: where its value goes, and where it lies.
#[derive(Clone, Copy)]
pub(super) struct Target {
    pub n: u32,
    pub x: Vec3,
}

/// A sample whose distance is wanted.
struct Item {
    target: Target,
    /// Its owner's place in the list of near elements, and d xi / d x there.
    place: u32,
    inverse: Mat3,
    /// How deep it lies under its owner's faces; a voxel stands for more.
    depth: f64,
}

/// A block of samples within one element.
struct Block {
    number: usize,
    place: usize,
    /// Its centre.
    trail: Trail,
    depth: f64,
    f: f64,
}

/// A sample in one of the elements that share in it.
struct Seat {
    item: u32,
    place: u32,
    weight: f64,
}

/// The sum of the shares in a sample.
#[derive(Clone, Copy, Default)]
struct Sum {
    f: f64,
    scales: f64,
    weights: f64,
}

/// Points in elements that are asked for values or slopes together.
#[derive(Default)]
struct Questions {
    places: Vec<u32>,
    points: Vec<CellPoint<3>>,
}

/// Room for the work, kept between boxes.
#[derive(Default)]
pub(super) struct Batch {
    blocks: Vec<Block>,
    centres: Vec<Vec3>,
    /// Samples whose element is not known from their block's.
    open: Vec<Target>,
    at: Vec<Vec3>,
    owners: Vec<Option<Owner>>,
    spots: Vec<Option<Spot>>,
    asking: Asking,
    items: Vec<Item>,
    /// One for every item.
    asked: Questions,
    values: Vec<f64>,
    /// Items in the band near faces.
    shared: Vec<u32>,
    seats: Vec<Seat>,
    /// One for every seat.
    next: Questions,
    x: Vec<Vec3>,
    inverses: Vec<Mat3>,
    slopes: Vec<(f64, Vec3)>,
    legs: Vec<Leg>,
    scales: Vec<f64>,
    /// Which items are looked for in a neighbour.
    asking_for: Vec<u32>,
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

    /// Calls `ask` for each run of points that are in one place.
    fn by_place(places: &[u32], mut ask: impl FnMut(usize, std::ops::Range<usize>)) {
        let mut first = 0;
        for end in 1..=places.len() {
            if places.get(end) != Some(&places[first]) {
                ask(places[first] as usize, first..end);
                first = end;
            }
        }
    }
}

/// The centre of some samples and the greatest distance from it.
fn ball(samples: &[Target]) -> (Vec3, f64) {
    // Of a lattice in storage order the first and the last are opposite corners.
    match (samples.first(), samples.last()) {
        (Some(a), Some(b)) => ((a.x + b.x) / 2.0, (b.x - a.x).norm() / 2.0),
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
        batch.asked.clear();
        batch.open.clear();
        let w = self.options.half_width;
        let mut found = |t: &Target, d: f64| {
            out[t.n as usize] = self.cut(component, d, t.x, known) as f32;
        };
        let whole = std::mem::take(&mut batch.blocks);
        let mut next = whole.iter().peekable();
        for (number, samples) in blocks.iter().enumerate() {
            let Some(block) = next.next_if(|b| b.number == number) else {
                batch.open.extend(samples);
                continue;
            };
            let (_, radius) = ball(samples);
            if block.f.abs() >= local.near.slope_sup * (radius + w) {
                let d = w.copysign(block.f);
                for t in samples {
                    found(t, d);
                }
            } else {
                self.enter_block(local, samples, block, block.depth - radius, batch);
            }
        }
        batch.blocks = whole;
        self.enter_open(local, batch, |local, t| {
            let d = self.value_at(component, local, t.x, known);
            out[t.n as usize] = d as f32;
        });
        self.ask_values(local, batch);
        let mut found = |t: &Target, d: f64| {
            out[t.n as usize] = self.cut(component, d, t.x, known) as f32;
        };
        self.seat(local, batch, &mut found);
        self.blend(local, batch, &mut found);
    }

    /// Finds the blocks that lie in one element, and the field at their centres.
    fn find_blocks(&self, local: &mut Local, blocks: &[Vec<Target>], batch: &mut Batch) {
        batch.blocks.clear();
        batch.asked.clear();
        batch.centres.clear();
        batch.centres.extend(blocks.iter().map(|b| ball(b).0));
        let Batch {
            centres, owners, ..
        } = batch;
        self.owners(local, centres, &mut batch.asking, owners);
        for (number, (&x, owner)) in centres.iter().zip(owners).enumerate() {
            let Some(Owner { place, spot }) = owner else {
                continue;
            };
            let patch = self.patch(local, *place);
            let depth = patch.depth(x, spot);
            if depth > ball(&blocks[number]).1 {
                // The map's second derivatives hardly change from block to block.
                let trail = match batch.blocks.last().filter(|b| b.place == *place) {
                    Some(last) => Trail {
                        x,
                        xi: spot.xi,
                        inverse: spot.inverse,
                        ..last.trail
                    },
                    None => patch.trail(self.scaffold, x, spot),
                };
                batch.asked.push(*place as u32, spot.xi);
                batch.blocks.push(Block {
                    number,
                    place: *place,
                    trail,
                    depth,
                    f: 0.0,
                });
            }
        }
        self.ask_values(local, batch);
        for (block, &f) in batch.blocks.iter_mut().zip(&batch.values) {
            block.f = f;
        }
    }

    /// Enters the samples of a block that lies in one element, all of them at least `sure` deep.
    fn enter_block(
        &self,
        local: &Local,
        samples: &[Target],
        block: &Block,
        sure: f64,
        batch: &mut Batch,
    ) {
        let patch = self.patch(local, block.place);
        let is_deep = sure >= self.delta();
        if patch.is_affine() {
            for &target in samples {
                let depth = if is_deep {
                    sure
                } else {
                    patch.affine_depth(target.x)
                };
                let xi = block.trail.guess(target.x);
                batch.enter(target, block.place, (xi, block.trail.inverse), depth);
            }
            return;
        }
        batch.at.clear();
        batch.at.extend(samples.iter().map(|t| t.x));
        let (mut trail, mut spots) = (block.trail, std::mem::take(&mut batch.spots));
        patch.spots(self.scaffold, &batch.at, (&mut trail, true), &mut spots);
        for (&target, spot) in samples.iter().zip(&spots) {
            if let Some(spot) = spot {
                let depth = if is_deep {
                    sure
                } else {
                    patch.depth(target.x, spot)
                };
                batch.enter(target, block.place, (spot.xi, spot.inverse), depth);
            } else {
                batch.open.push(target);
            }
        }
        batch.spots = spots;
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
        for n in 0..batch.open.len() {
            let target = batch.open[n];
            if let Some(Owner { place, spot }) = batch.owners[n] {
                let depth = self.patch(local, place).depth(target.x, &spot);
                batch.enter(target, place, (spot.xi, spot.inverse), depth);
            } else {
                batch.looked += 1;
                strays(local, &target);
            }
        }
    }

    /// The field at all points that are asked for.
    fn ask_values(&self, local: &Local, batch: &mut Batch) {
        let Batch { asked, values, .. } = &mut *batch;
        values.resize(asked.points.len(), 0.0);
        Questions::by_place(&asked.places, |place, run| {
            let element = local.near.patches[place] as usize;
            self.filling
                .values(element, &asked.points[run.clone()], &mut values[run]);
        });
        batch.looked += batch.asked.points.len() as u64;
    }

    fn ask_slopes(&self, local: &Local, next: &Questions, slopes: &mut Vec<(f64, Vec3)>) {
        slopes.resize(next.points.len(), (0.0, Vec3::zeros()));
        Questions::by_place(&next.places, |place, run| {
            let element = local.near.patches[place] as usize;
            self.filling
                .slopes(element, &next.points[run.clone()], &mut slopes[run]);
        });
    }

    /// Hands samples that are certainly far to `found`, and seats the others in their owners and in the
    /// elements that share in them.
    fn seat(&self, local: &Local, batch: &mut Batch, mut found: impl FnMut(&Target, f64)) {
        let w = self.options.half_width;
        // Every scale is at least 1 / L.
        let most = w * local.near.slope_sup;
        batch.seats.clear();
        batch.shared.clear();
        batch.next.clear();
        batch.x.clear();
        batch.inverses.clear();
        for n in 0..batch.items.len() {
            let (item, f) = (&batch.items[n], batch.values[n]);
            if f.abs() >= most {
                found(&item.target, w.copysign(f));
            } else if item.depth >= self.delta() {
                batch.seat_in_owner(n as u32);
            } else {
                batch.shared.push(n as u32);
            }
        }
        if batch.shared.is_empty() {
            return;
        }
        // In order of element numbers, so that both sides of a face sum alike.
        let shared = std::mem::take(&mut batch.shared);
        let mut spots = std::mem::take(&mut batch.spots);
        for place in 0..local.near.patches.len() {
            let patch = self.patch(local, place);
            batch.at.clear();
            batch.asking_for.clear();
            for &n in &shared {
                let item = &batch.items[n as usize];
                if item.place as usize == place {
                    batch.seat_in_owner(n);
                } else if !patch.is_beyond(item.target.x, self.delta()) {
                    batch.at.push(item.target.x);
                    batch.asking_for.push(n);
                }
            }
            self.spots(local, place, &batch.at, &mut spots);
            for k in 0..spots.len() {
                let (n, x) = (batch.asking_for[k], batch.at[k]);
                let Some(spot) = &spots[k] else {
                    continue;
                };
                let beyond = patch.overshoot(x, spot);
                let depth = batch.items[n as usize].depth;
                let weight = 1.0 - beyond.max(depth) / self.delta();
                if weight > 0.0 {
                    batch.take_seat(n, place as u32, (spot.xi, spot.inverse), weight);
                }
            }
        }
        batch.spots = spots;
        batch.shared = shared;
    }

    /// Distances of the samples that are seated: the scales of the elements that share in each are
    /// blended.
    fn blend(&self, local: &Local, batch: &mut Batch, mut found: impl FnMut(&Target, f64)) {
        let Batch {
            items,
            seats,
            next,
            x,
            inverses,
            slopes,
            legs,
            scales,
            sums,
            ..
        } = batch;
        self.ask_slopes(local, next, slopes);
        sums.clear();
        sums.resize(items.len(), Sum::default());
        for (seat, (f, _)) in seats.iter().zip(&*slopes) {
            if seat.place == items[seat.item as usize].place {
                sums[seat.item as usize].f = *f;
            }
        }
        legs.resize(seats.len(), Leg::default());
        scales.resize(seats.len(), 0.0);
        Questions::by_place(&next.places, |place, run| {
            let patch = self.patch(local, place);
            let walkers = Walkers {
                x: &x[run.clone()],
                at: &mut next.points[run.clone()],
                inverses: &mut inverses[run.clone()],
                slopes: &slopes[run.clone()],
                legs: &mut legs[run],
            };
            patch.set_off(self.scaffold, self.pace(patch), walkers);
        });
        self.ask_slopes(local, next, slopes);
        Questions::by_place(&next.places, |place, run| {
            walk::arrive(
                self.pace(self.patch(local, place)),
                &slopes[run.clone()],
                &inverses[run.clone()],
                &legs[run.clone()],
                &mut scales[run],
            );
        });
        for (seat, scale) in seats.iter().zip(&*scales) {
            let sum = &mut sums[seat.item as usize];
            sum.scales += seat.weight * scale;
            sum.weights += seat.weight;
        }
        let w = self.options.half_width;
        for (item, sum) in items.iter().zip(&*sums).filter(|(_, s)| s.weights > 0.0) {
            let d = (sum.f * sum.scales / sum.weights).clamp(-w, w);
            found(&item.target, d);
        }
    }
}

impl Batch {
    /// Enters a sample in its owner.
    fn enter(&mut self, target: Target, place: usize, (xi, inverse): (Vec3, Mat3), depth: f64) {
        let place = place as u32;
        self.asked.push(place, xi);
        self.items.push(Item {
            target,
            place,
            inverse,
            depth,
        });
    }

    /// Seats an item in its owner.
    fn seat_in_owner(&mut self, item: u32) {
        let own = &self.items[item as usize];
        let at = (self.asked.points[item as usize].0, own.inverse);
        self.take_seat(item, own.place, at, 1.0);
    }

    fn take_seat(&mut self, item: u32, place: u32, (xi, inverse): (Vec3, Mat3), weight: f64) {
        self.next.push(place, xi);
        self.inverses.push(inverse);
        self.x.push(self.items[item as usize].target.x);
        self.seats.push(Seat {
            item,
            place,
            weight,
        });
    }
}
