//! Samples in the band, seated in the elements that share in them: from gradients to distances.

use super::{Batch, How, Target};
use crate::frame::{CellPoint, Vec3};
use crate::tiling::near::Local;
use crate::tiling::walk::{self, Frame, Leg, Walkers};
use crate::tiling::{Filling, TiledSolid};

/// A sample in one of the elements that share in it.
pub(super) struct Seat {
    item: u32,
    place: u32,
    /// Whose trail has d xi / d x; without one it stands in a list.
    block: Option<u32>,
    weight: f64,
}

/// The sum of the shares in a sample.
#[derive(Clone, Copy, Default)]
pub(super) struct Sum {
    f: f64,
    scales: f64,
    weights: f64,
}

impl<F: Filling> TiledSolid<'_, F> {
    fn ask_slopes(
        &self,
        local: &Local,
        seats: &[Seat],
        points: &[CellPoint<3>],
        slopes: &mut Vec<(f64, Vec3)>,
    ) {
        slopes.resize(points.len(), (0.0, Vec3::zeros()));
        let mut first = 0;
        for run in seats.chunk_by(|a, b| a.place == b.place) {
            let element = local.near.patches[run[0].place as usize] as usize;
            let all = first..first + run.len();
            first = all.end;
            self.filling
                .slopes(element, &points[all.clone()], &mut slopes[all]);
        }
    }

    /// Hands samples that are certainly far to `found`, and seats the others in their owners and in the
    /// elements that share in them.
    pub(super) fn seat(
        &self,
        local: &Local,
        batch: &mut Batch,
        mut found: impl FnMut(&Target, f64),
    ) {
        let w = self.options.half_width;
        // Every scale is at least 1 / L.
        let most = w * local.near.slope_sup;
        batch.seats.clear();
        batch.shared.clear();
        batch.points.clear();
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
        let mut found = std::mem::take(&mut batch.found);
        for place in 0..local.near.patches.len() {
            batch.at.clear();
            batch.guests.clear();
            for &n in &shared {
                let item = &batch.items[n as usize];
                if item.place as usize == place {
                    batch.seat_in_owner(n);
                } else {
                    batch.at.push(item.target.x);
                    batch.guests.push(n);
                }
            }
            self.spots(local, place, (&batch.at, self.delta()), &mut found);
            for (k, spot) in found.found() {
                let n = batch.guests[k as usize];
                let depth = batch.items[n as usize].depth;
                let weight = 1.0 - spot.overshoot.max(depth) / self.delta();
                if weight > 0.0 {
                    batch.inverses.push(spot.inverse);
                    batch.take_seat(n, place as u32, spot.xi, None, weight);
                }
            }
        }
        batch.found = found;
        batch.shared = shared;
    }

    /// Distances of the samples that are seated: the scales of the elements that share in each are
    /// blended.
    pub(super) fn blend(
        &self,
        local: &Local,
        batch: &mut Batch,
        mut found: impl FnMut(&Target, f64),
    ) {
        let Batch {
            blocks,
            items,
            seats,
            points,
            at,
            inverses,
            slopes,
            legs,
            scales,
            sums,
            ..
        } = batch;
        self.ask_slopes(local, seats, points, slopes);
        sums.clear();
        sums.resize(items.len(), Sum::default());
        at.clear();
        for (seat, (f, _)) in seats.iter().zip(&*slopes) {
            let item = &items[seat.item as usize];
            at.push(item.target.x);
            if seat.place == item.place {
                sums[seat.item as usize].f = *f;
            }
        }
        scales.resize(seats.len(), 0.0);
        let most = seats.len().max(legs.len());
        legs.resize(most, Leg::default());
        let (mut first, mut alone, mut leg) = (0, 0, 0);
        for run in seats.chunk_by(|a, b| (a.place, a.block) == (b.place, b.block)) {
            let all = first..first + run.len();
            let Seat { place, block, .. } = run[0];
            let frame = if let Some(number) = block {
                Frame::Trail(&blocks[number as usize].trail)
            } else {
                let own = alone..alone + run.len();
                alone = own.end;
                Frame::Each(&inverses[own])
            };
            let patch = self.patch(local, place as usize);
            let walkers = Walkers {
                x: &at[all.clone()],
                at: &mut points[all.clone()],
                frame,
                slopes: &slopes[all.clone()],
            };
            let own = leg..leg + run.len().div_ceil(4);
            patch.set_off(
                self.scaffold,
                self.pace(patch),
                walkers,
                &mut legs[own.clone()],
            );
            (first, leg) = (all.end, own.end);
        }
        self.ask_slopes(local, seats, points, slopes);
        let (mut first, mut leg) = (0, 0);
        for run in seats.chunk_by(|a, b| (a.place, a.block) == (b.place, b.block)) {
            let (all, own) = (first..first + run.len(), leg..leg + run.len().div_ceil(4));
            let pace = self.pace(self.patch(local, run[0].place as usize));
            walk::arrive(
                pace,
                &slopes[all.clone()],
                &legs[own.clone()],
                &mut scales[all.clone()],
            );
            (first, leg) = (all.end, own.end);
        }
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
    /// Seats an item in its owner.
    fn seat_in_owner(&mut self, item: u32) {
        let own = &self.items[item as usize];
        let (place, xi) = (own.place, self.asked.points[item as usize].0);
        match own.how {
            How::Block(number) => self.take_seat(item, place, xi, Some(number), 1.0),
            How::Alone(number) => {
                self.inverses.push(self.alone[number as usize]);
                self.take_seat(item, place, xi, None, 1.0);
            }
        }
    }

    /// Seats an item in an element, with d xi / d x of a block, or in the list.
    fn take_seat(&mut self, item: u32, place: u32, xi: Vec3, block: Option<u32>, weight: f64) {
        self.points.push(CellPoint(xi));
        self.seats.push(Seat {
            item,
            place,
            block,
            weight,
        });
    }
}
