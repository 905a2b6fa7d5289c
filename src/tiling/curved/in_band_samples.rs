//! Samples in the band, seated in the elements that share in them: from gradients to distances.

use super::{Batch, How, Target};
use crate::frame::{CellPoint, Vec3};
use crate::tiling::locality::Local;
use crate::tiling::newton_distance::{self, Frame, Leg, Walkers};
use crate::tiling::{Filling, TiledSolid};

/// A sample in one of the elements that share in it.
pub(super) struct Seat {
    item: u32,
    place: u32,
    /// The trail that has d xi / d x; without one it stands in a list.
    trail: Option<u32>,
    weight: f64,
}

/// The sum of the shares in a sample.
#[derive(Clone, Copy, Default)]
pub(super) struct Sum {
    scales: f64,
    weights: f64,
}

impl<F: Filling> TiledSolid<'_, F> {
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
        batch.slopes.clear();
        batch.inverses.clear();
        for n in 0..batch.items.len() {
            let (item, f) = (&batch.items[n], batch.own[n].0);
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
            let first = batch.points.len();
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
            let guests = &batch.points[first..];
            batch
                .slopes
                .resize(batch.points.len(), (0.0, Vec3::zeros()));
            self.ask_slopes(local, place, guests, &mut batch.slopes[first..]);
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
            trails,
            items,
            own,
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
        sums.clear();
        sums.resize(items.len(), Sum::default());
        at.clear();
        at.extend(seats.iter().map(|s| items[s.item as usize].target.x));
        scales.resize(seats.len(), 0.0);
        let most = seats.len().max(legs.len());
        legs.resize(most, Leg::default());
        let (mut first, mut alone, mut leg) = (0, 0, 0);
        for run in seats.chunk_by(|a, b| (a.place, a.trail) == (b.place, b.trail)) {
            let all = first..first + run.len();
            let Seat { place, trail, .. } = run[0];
            let frame = if let Some(number) = trail {
                Frame::Trail(&trails[number as usize])
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
        let mut first = 0;
        for run in seats.chunk_by(|a, b| a.place == b.place) {
            let all = first..first + run.len();
            first = all.end;
            let place = run[0].place as usize;
            self.ask_slopes(local, place, &points[all.clone()], &mut slopes[all]);
        }
        let (mut first, mut leg) = (0, 0);
        for run in seats.chunk_by(|a, b| (a.place, a.trail) == (b.place, b.trail)) {
            let (all, own) = (first..first + run.len(), leg..leg + run.len().div_ceil(4));
            let pace = self.pace(self.patch(local, run[0].place as usize));
            newton_distance::arrive(
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
        let all = items.iter().zip(&*own).zip(&*sums);
        for ((item, (f, _)), sum) in all.filter(|(_, s)| s.weights > 0.0) {
            let d = (f * sum.scales / sum.weights).clamp(-w, w);
            found(&item.target, d);
        }
    }
}

impl Batch {
    /// Seats an item in its owner.
    fn seat_in_owner(&mut self, item: u32) {
        let own = &self.items[item as usize];
        let (place, xi) = (own.place, self.asked.points[item as usize].0);
        self.slopes.push(self.own[item as usize]);
        match own.how {
            How::Trail(number) => self.take_seat(item, place, xi, Some(number), 1.0),
            How::Alone(number) => {
                self.inverses.push(self.alone[number as usize]);
                self.take_seat(item, place, xi, None, 1.0);
            }
        }
    }

    /// Seats an item in an element, with d xi / d x of a trail, or in the list.
    fn take_seat(&mut self, item: u32, place: u32, xi: Vec3, trail: Option<u32>, weight: f64) {
        self.points.push(CellPoint(xi));
        self.seats.push(Seat {
            item,
            place,
            trail,
            weight,
        });
    }
}
