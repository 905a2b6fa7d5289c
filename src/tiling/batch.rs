//! Rule Q for the samples of a small box at a time: cells are asked for many points at once.
//!
//! Blocks of 2^3 samples that lie in one element are first asked at their centre: with L the slope's
//! bound and R the block's half diagonal, |F| >= L (R + w) there decides all of them. Samples that are
//! left are asked for their value, those with |F| < L w for gradients, in their owner and in the
//! elements that share in the blend, there and one step on. What comes out is what single points give.

use super::near::{Known, Local, Owner};
use super::scale::Advance;
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
    /// Its owner's place in the list of near elements.
    place: u32,
    /// Where its owner's d xi / d x stands, if that is not the same all over the element.
    inverse: Option<u32>,
    /// How deep it lies under its owner's faces; a voxel stands for more.
    depth: f64,
}

/// What an element says of a sample that several share in.
struct Share {
    item: u32,
    place: u32,
    xi: Vec3,
    inverse: Mat3,
    weight: f64,
    advance: Advance,
}

/// The sum of the shares in a sample.
#[derive(Clone, Copy, Default)]
struct Sum {
    f: f64,
    scales: f64,
    weights: f64,
}

/// A block of samples within one element.
struct Block {
    number: usize,
    owner: Owner,
    depth: f64,
    f: f64,
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
    items: Vec<Item>,
    inverses: Vec<Mat3>,
    /// One for every item.
    asked: Questions,
    values: Vec<f64>,
    /// Items that only their owner, and that also others have a share in.
    own: Vec<u32>,
    shared: Vec<u32>,
    shares: Vec<Share>,
    /// Shares by place.
    order: Vec<u32>,
    sums: Vec<Sum>,
    advances: Vec<(f64, Advance)>,
    /// Who makes the second step, and d xi / d x there.
    ahead: Vec<(u32, Option<Mat3>)>,
    next: Questions,
    slopes: Vec<(f64, Vec3)>,
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

    /// Calls `ask` for each run of points in one of the near elements: its number, and the run.
    fn by_element(&self, local: &Local, mut ask: impl FnMut(usize, std::ops::Range<usize>)) {
        let mut first = 0;
        for end in 1..=self.places.len() {
            if self.places.get(end) != Some(&self.places[first]) {
                let element = local.near.patches[self.places[first] as usize];
                ask(element as usize, first..end);
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
        batch.inverses.clear();
        batch.asked.clear();
        let w = self.options.half_width;
        let mut whole = 0;
        for (number, samples) in blocks.iter().enumerate() {
            let (_, radius) = ball(samples);
            let block = batch.blocks.get(whole).filter(|b| b.number == number);
            whole += usize::from(block.is_some());
            if let Some(b) = block
                && b.f.abs() >= local.near.slope_sup * (radius + w)
            {
                let d = w.copysign(b.f);
                for t in samples {
                    out[t.n as usize] = self.cut(component, d, t.x, known) as f32;
                }
                continue;
            }
            let certain = block.map(|b| (b.owner.place, b.depth - radius));
            for &target in samples {
                if !self.enter(local, target, certain, batch) {
                    batch.looked += 1;
                    out[target.n as usize] =
                        self.value_at(component, local, target.x, known) as f32;
                }
            }
        }
        self.ask_values(local, batch);
        let mut found = |t: &Target, d: f64| {
            out[t.n as usize] = self.cut(component, d, t.x, known) as f32;
        };
        self.sort_out(local, batch, &mut found);
        self.step_alone(local, batch, &mut found);
        self.blend(local, batch, &mut found);
    }

    /// Finds a sample's owner, its `certain` one if its block lies in one element and at least so deep;
    /// false if it has none.
    fn enter(
        &self,
        local: &mut Local,
        target: Target,
        certain: Option<(usize, f64)>,
        batch: &mut Batch,
    ) -> bool {
        let x = target.x;
        if let Some((place, sure)) = certain
            && let patch = self.patch(local, place)
            && let Some(xi) = patch.affine_point(x)
        {
            let depth = if sure >= self.delta() {
                sure
            } else {
                patch.affine_depth(x)
            };
            batch.asked.push(place as u32, xi);
            batch.items.push(Item {
                target,
                place: place as u32,
                inverse: None,
                depth,
            });
            return true;
        }
        let owner = match certain {
            Some((place, _)) => self
                .spot(local, place, x, f64::INFINITY)
                .map(|spot| Owner { place, spot }),
            None => self.owner(local, x),
        };
        let Some(owner) = owner else {
            return false;
        };
        let patch = self.patch(local, owner.place);
        let depth = match certain {
            Some((_, depth)) if depth >= self.delta() => depth,
            _ => patch.depth(x, &owner.spot),
        };
        let inverse = if patch.is_affine() {
            None
        } else {
            batch.inverses.push(owner.spot.inverse);
            Some(batch.inverses.len() as u32 - 1)
        };
        batch.asked.push(owner.place as u32, owner.spot.xi);
        batch.items.push(Item {
            target,
            place: owner.place as u32,
            inverse,
            depth,
        });
        true
    }

    /// Finds the blocks that lie in one element, and the field at their centres.
    fn find_blocks(&self, local: &mut Local, blocks: &[Vec<Target>], batch: &mut Batch) {
        batch.blocks.clear();
        batch.asked.clear();
        for (number, samples) in blocks.iter().enumerate() {
            let (centre, radius) = ball(samples);
            let Some(owner) = self.owner(local, centre) else {
                continue;
            };
            let depth = self.patch(local, owner.place).depth(centre, &owner.spot);
            if depth > radius {
                batch.asked.push(owner.place as u32, owner.spot.xi);
                batch.blocks.push(Block {
                    number,
                    owner,
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

    /// The field at all points that are asked for.
    fn ask_values(&self, local: &Local, batch: &mut Batch) {
        let Batch { asked, values, .. } = &mut *batch;
        values.resize(asked.points.len(), 0.0);
        asked.by_element(local, |element, run| {
            self.filling
                .values(element, &asked.points[run.clone()], &mut values[run]);
        });
        batch.looked += batch.asked.points.len() as u64;
    }

    fn ask_slopes(&self, local: &Local, next: &Questions, slopes: &mut Vec<(f64, Vec3)>) {
        slopes.resize(next.points.len(), (0.0, Vec3::zeros()));
        next.by_element(local, |element, run| {
            self.filling
                .slopes(element, &next.points[run.clone()], &mut slopes[run]);
        });
    }

    /// Hands samples that are certainly far to `found`, and parts the others by who has a share.
    fn sort_out(&self, local: &Local, batch: &mut Batch, mut found: impl FnMut(&Target, f64)) {
        let w = self.options.half_width;
        // Every scale is at least 1 / L.
        let most = w * local.near.slope_sup;
        batch.own.clear();
        batch.shared.clear();
        for (n, (item, &f)) in batch.items.iter().zip(&batch.values).enumerate() {
            if f.abs() >= most {
                found(&item.target, w.copysign(f));
            } else if item.depth >= self.delta() {
                batch.own.push(n as u32);
            } else {
                batch.shared.push(n as u32);
            }
        }
    }

    /// Distances of samples that only their owner has a share in.
    fn step_alone(&self, local: &Local, batch: &mut Batch, mut found: impl FnMut(&Target, f64)) {
        let Batch {
            items,
            inverses,
            asked,
            own,
            advances,
            ahead,
            next,
            slopes,
            ..
        } = batch;
        next.clear();
        for &n in &*own {
            next.push(items[n as usize].place, asked.points[n as usize].0);
        }
        self.ask_slopes(local, next, slopes);
        next.clear();
        advances.clear();
        ahead.clear();
        for (k, &n) in own.iter().enumerate() {
            let item = &items[n as usize];
            let patch = self.patch(local, item.place as usize);
            let inverse = patch.inverse(item.inverse.map(|i| &inverses[i as usize]));
            let (f, g) = slopes[k];
            let advance = self.advance(patch, (f, inverse.tr_mul(&g)));
            if advance.goes_on() {
                let (step, xi) = (advance.step, asked.points[n as usize].0);
                let to = item.target.x + step;
                let (xi, there) = patch.follow(self.scaffold, (xi, inverse), step, to);
                next.push(item.place, xi);
                ahead.push((k as u32, there));
            }
            advances.push((f, advance));
        }
        self.ask_slopes(local, next, slopes);
        for ((&(k, ref there), &place), &(f, g)) in ahead.iter().zip(&next.places).zip(&*slopes) {
            let patch = self.patch(local, place as usize);
            let slope = (f, patch.inverse(there.as_ref()).tr_mul(&g));
            advances[k as usize].1.arrive(self.step(patch, slope));
        }
        let w = self.options.half_width;
        for (&n, (f, advance)) in own.iter().zip(&*advances) {
            let item = &items[n as usize];
            let scale = advance.scale(self.patch(local, item.place as usize));
            found(&item.target, (f * scale).clamp(-w, w));
        }
    }

    /// Distances of samples near faces: the scales of the elements that share in each are blended.
    fn blend(&self, local: &Local, batch: &mut Batch, mut found: impl FnMut(&Target, f64)) {
        self.share(local, batch);
        let Batch {
            items,
            shared,
            shares,
            order,
            sums,
            ahead,
            next,
            slopes,
            ..
        } = batch;
        // In order of element numbers, so that both sides of a face sum alike.
        order.clear();
        order.extend(0..shares.len() as u32);
        order.sort_by_key(|&s| shares[s as usize].place);
        next.clear();
        for &s in &*order {
            next.push(shares[s as usize].place, shares[s as usize].xi);
        }
        self.ask_slopes(local, next, slopes);
        next.clear();
        ahead.clear();
        sums.clear();
        sums.resize(shared.len(), Sum::default());
        for (&s, &(f, g)) in order.iter().zip(&*slopes) {
            let share = &mut shares[s as usize];
            let item = &items[shared[share.item as usize] as usize];
            if share.place == item.place {
                sums[share.item as usize].f = f;
            }
            let patch = self.patch(local, share.place as usize);
            share.advance = self.advance(patch, (f, share.inverse.tr_mul(&g)));
            if share.advance.goes_on() {
                let step = share.advance.step;
                let (from, to) = ((share.xi, &share.inverse), item.target.x + step);
                let (xi, there) = patch.follow(self.scaffold, from, step, to);
                next.push(share.place, xi);
                ahead.push((s, there));
            }
        }
        self.ask_slopes(local, next, slopes);
        for (&(s, ref there), &(f, g)) in ahead.iter().zip(&*slopes) {
            let share = &mut shares[s as usize];
            let patch = self.patch(local, share.place as usize);
            let slope = (f, patch.inverse(there.as_ref()).tr_mul(&g));
            share.advance.arrive(self.step(patch, slope));
        }
        for &s in &*order {
            let share = &shares[s as usize];
            let sum = &mut sums[share.item as usize];
            let scale = share.advance.scale(self.patch(local, share.place as usize));
            sum.scales += share.weight * scale;
            sum.weights += share.weight;
        }
        let w = self.options.half_width;
        for (&n, sum) in shared.iter().zip(&*sums) {
            let d = (sum.f * sum.scales / sum.weights).clamp(-w, w);
            found(&items[n as usize].target, d);
        }
    }

    /// Finds the elements that share in each sample near faces.
    fn share(&self, local: &Local, batch: &mut Batch) {
        let Batch {
            items,
            inverses,
            asked,
            shared,
            shares,
            ..
        } = batch;
        shares.clear();
        for (number, &n) in shared.iter().enumerate() {
            let item = &items[n as usize];
            let own = self.patch(local, item.place as usize);
            let inverse = own.inverse(item.inverse.map(|i| &inverses[i as usize]));
            shares.push(Share {
                item: number as u32,
                place: item.place,
                xi: asked.points[n as usize].0,
                inverse: *inverse,
                weight: 1.0,
                advance: Advance::default(),
            });
            let x = item.target.x;
            for place in (0..local.near.patches.len()).filter(|&p| p != item.place as usize) {
                let Some(spot) = self.spot(local, place, x, self.delta()) else {
                    continue;
                };
                let beyond = self.patch(local, place).overshoot(x, &spot);
                let weight = 1.0 - beyond.max(item.depth) / self.delta();
                if weight > 0.0 {
                    shares.push(Share {
                        item: number as u32,
                        place: place as u32,
                        xi: spot.xi,
                        inverse: spot.inverse,
                        weight,
                        advance: Advance::default(),
                    });
                }
            }
        }
    }
}
