//! Sums of coefficients by weights: the values of the spline and of its slopes.
//!
//! First some groups of points are placed and get their weights, then the sums are taken: what comes in
//! between lies in memory, from which a weight is spread over a row at no cost, while spreading it from
//! another row takes the unit that all such moves wait for.
// Small functions of one hot path: a call each would cost as much as the work.
#![allow(clippy::inline_always)]

use super::place::{Places, group};
use super::weights::{CUBIC, SLOPES, Weights};
use super::{GROUP, HALF, Spline};
use crate::frame::CellPoint;
use crate::simd::{Lanes, Work};

/// Groups of points that are placed before their sums are taken: the fewest that are left in memory. Room
/// for more would take longer to clear, when few points are asked for, than it gains when many are.
const GROUPS: usize = 2;

/// Values at points, into a slice of the same length.
pub(super) struct Values<'a>(pub &'a Spline, pub &'a [CellPoint<3>], pub &'a mut [f32]);

impl Work for Values<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        self.0.values_by(lanes, self.1, self.2);
    }
}

/// Values and gradients (per unit of reference length) at points, into a slice of the same length.
pub(super) struct Samples<'a>(
    pub &'a Spline,
    pub &'a [CellPoint<3>],
    pub &'a mut [[f32; 4]],
);

impl Work for Samples<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        self.0.samples_by(lanes, self.1, self.2);
    }
}

/// A group of points: where their coefficients are, and the weights of these.
#[derive(Clone, Copy, Default)]
struct Seats {
    plane: [i32; GROUP],
    start: [i32; GROUP],
    weights: Weights,
}

impl Seats {
    #[inline(always)]
    fn set<L: Lanes>(&mut self, lanes: L, places: &Places<L>) {
        (self.plane, self.start) = (places.plane, places.start);
        self.weights.set(lanes, &places.within, &CUBIC);
    }
}

/// The same with the weights of slopes.
#[derive(Clone, Copy, Default)]
struct Slopes {
    seats: Seats,
    weights: Weights,
    /// What makes slopes by spline cells those of the points, by axis.
    scales: [[f32; GROUP]; 3],
    /// What made axes change places.
    order: [[f32; GROUP]; 3],
}

impl Spline {
    /// The coefficients around point `n` of a group, by plane and half.
    #[inline(always)]
    fn patches<L: Lanes>(&self, lanes: L, seats: &Seats, n: usize) -> [[L::F; 2]; 4] {
        // One look whether they are in the table: all after it are the same for every point.
        let plane = (seats.plane[n] as usize).wrapping_mul(self.plane);
        let from = plane.wrapping_add(seats.start[n] as usize);
        let window = &self.table[from..][..3 * self.plane + self.half + HALF];
        let (first, rest) = window.split_at(self.plane);
        let (second, rest) = rest.split_at(self.plane);
        let (third, fourth) = rest.split_at(self.plane);
        [
            self.patch(lanes, first),
            self.patch(lanes, second),
            self.patch(lanes, third),
            self.patch(lanes, fourth),
        ]
    }

    /// Both halves of what a plane starts with.
    #[inline(always)]
    fn patch<L: Lanes>(&self, lanes: L, plane: &[f32]) -> [L::F; 2] {
        let patch = &plane[..self.half + HALF];
        let low = patch.first_chunk::<HALF>();
        let high = patch[self.half..].first_chunk::<HALF>();
        let none = &[0.0; HALF];
        [
            lanes.load(low.unwrap_or(none)),
            lanes.load(high.unwrap_or(none)),
        ]
    }

    /// Sums along x and y at point `n`: of each place along z two shares, side by side.
    #[inline(always)]
    fn flat<L: Lanes>(&self, lanes: L, seats: &Seats, n: usize) -> L::F {
        let patches = self.patches(lanes, seats, n);
        let weights = &seats.weights;
        let first = weights.x(lanes, 0, n);
        let mut low = lanes.mul(patches[0][0], first);
        let mut high = lanes.mul(patches[0][1], first);
        for i in 1..4 {
            let weight = weights.x(lanes, i, n);
            low = lanes.fused(patches[i][0], weight, low);
            high = lanes.fused(patches[i][1], weight, high);
        }
        let [y0, y1] = weights.y(lanes, n);
        lanes.fused(low, y0, lanes.mul(high, y1))
    }

    /// The same, by slopes along x, and by slopes along y.
    #[inline(always)]
    fn flat_and_slopes<L: Lanes>(&self, lanes: L, group: &Slopes, n: usize) -> [L::F; 3] {
        let patches = self.patches(lanes, &group.seats, n);
        let (weights, slopes) = (&group.seats.weights, &group.weights);
        let (first, steep) = (weights.x(lanes, 0, n), slopes.x(lanes, 0, n));
        let mut low = lanes.mul(patches[0][0], first);
        let mut high = lanes.mul(patches[0][1], first);
        let mut steep_low = lanes.mul(patches[0][0], steep);
        let mut steep_high = lanes.mul(patches[0][1], steep);
        for i in 1..4 {
            let (weight, steep) = (weights.x(lanes, i, n), slopes.x(lanes, i, n));
            low = lanes.fused(patches[i][0], weight, low);
            high = lanes.fused(patches[i][1], weight, high);
            steep_low = lanes.fused(patches[i][0], steep, steep_low);
            steep_high = lanes.fused(patches[i][1], steep, steep_high);
        }
        let ([y0, y1], [d0, d1]) = (weights.y(lanes, n), slopes.y(lanes, n));
        [
            lanes.fused(low, y0, lanes.mul(high, y1)),
            lanes.fused(steep_low, y0, lanes.mul(steep_high, y1)),
            lanes.fused(low, d0, lanes.mul(high, d1)),
        ]
    }

    /// Values at four points of a group, or at the first of them.
    #[inline(always)]
    fn four_values<L: Lanes>(
        &self,
        lanes: L,
        seats: &Seats,
        quarter: usize,
        is_single: bool,
    ) -> [f32; 4] {
        let n = 4 * quarter;
        let first = self.flat(lanes, seats, n);
        let mut flat = [first; 4];
        if !is_single {
            for i in 1..4 {
                flat[i] = self.flat(lanes, seats, n + i);
            }
        }
        along_z(lanes, in_twos(lanes, flat), &seats.weights, quarter)
    }

    /// Values and slopes at four points of a group, or at the first of them.
    #[inline(always)]
    fn four_samples<L: Lanes>(
        &self,
        lanes: L,
        group: &Slopes,
        quarter: usize,
        is_single: bool,
    ) -> [[f32; 4]; 4] {
        let n = 4 * quarter;
        let [flat, steep, along] = self.flat_and_slopes(lanes, group, n);
        let (mut flat, mut steep, mut along) = ([flat; 4], [steep; 4], [along; 4]);
        if !is_single {
            for i in 1..4 {
                [flat[i], steep[i], along[i]] = self.flat_and_slopes(lanes, group, n + i);
            }
        }
        let flat = in_twos(lanes, flat);
        let weights = &group.seats.weights;
        [
            along_z(lanes, flat, weights, quarter),
            along_z(lanes, in_twos(lanes, steep), weights, quarter),
            along_z(lanes, in_twos(lanes, along), weights, quarter),
            along_z(lanes, flat, &group.weights, quarter),
        ]
    }

    #[inline(always)]
    pub(super) fn values_by<L: Lanes>(&self, lanes: L, points: &[CellPoint<3>], out: &mut [f32]) {
        if points.len() <= GROUP {
            self.values_in::<L, 1>(lanes, points, out);
        } else {
            self.values_in::<L, GROUPS>(lanes, points, out);
        }
    }

    #[inline(always)]
    fn values_in<L: Lanes, const N: usize>(
        &self,
        lanes: L,
        points: &[CellPoint<3>],
        out: &mut [f32],
    ) {
        let mut seats = [Seats::default(); N];
        for (points, out) in points.chunks(N * GROUP).zip(out.chunks_mut(N * GROUP)) {
            for (points, seats) in points.chunks(GROUP).zip(&mut seats) {
                seats.set(lanes, &self.places(lanes, &group(points)));
            }
            for (seats, out) in seats.iter().zip(out.chunks_mut(GROUP)) {
                let low = self.four_values(lanes, seats, 0, out.len() == 1);
                if let Some(out) = out.first_chunk_mut::<GROUP>() {
                    let high = self.four_values(lanes, seats, 1, false);
                    lanes.store(lanes.both(low, high), out);
                    continue;
                }
                let (first, rest) = out.split_at_mut(out.len().min(4));
                first.copy_from_slice(&low[..first.len()]);
                if !rest.is_empty() {
                    let high = self.four_values(lanes, seats, 1, rest.len() == 1);
                    rest.copy_from_slice(&high[..rest.len()]);
                }
            }
        }
    }

    #[inline(always)]
    pub(super) fn samples_by<L: Lanes>(
        &self,
        lanes: L,
        points: &[CellPoint<3>],
        out: &mut [[f32; 4]],
    ) {
        if points.len() <= GROUP {
            self.samples_in::<L, 1>(lanes, points, out);
        } else {
            self.samples_in::<L, GROUPS>(lanes, points, out);
        }
    }

    #[inline(always)]
    fn samples_in<L: Lanes, const N: usize>(
        &self,
        lanes: L,
        points: &[CellPoint<3>],
        out: &mut [[f32; 4]],
    ) {
        let mut groups = [Slopes::default(); N];
        for (points, out) in points.chunks(N * GROUP).zip(out.chunks_mut(N * GROUP)) {
            for (points, to) in points.chunks(GROUP).zip(&mut groups) {
                let places = self.places(lanes, &group(points));
                to.seats.set(lanes, &places);
                to.weights.set(lanes, &places.within, &SLOPES);
                for a in 0..3 {
                    let scale = lanes.mul(places.signs[a], lanes.splat(self.per_unit[a]));
                    lanes.store(scale, &mut to.scales[a]);
                    lanes.store(places.order[a], &mut to.order[a]);
                }
            }
            for (group, out) in groups.iter().zip(out.chunks_mut(GROUP)) {
                let low = self.four_samples(lanes, group, 0, out.len() == 1);
                let high = match out.len() {
                    5.. => self.four_samples(lanes, group, 1, out.len() == 5),
                    _ => low,
                };
                let mut slopes = [lanes.both(low[1], high[1]); 3];
                let mut order = slopes;
                for a in 0..3 {
                    slopes[a] = lanes.both(low[a + 1], high[a + 1]);
                    order[a] = lanes.load(&group.order[a]);
                }
                self.put_back(lanes, &order, &mut slopes);
                for a in 0..3 {
                    slopes[a] = lanes.mul(slopes[a], lanes.load(&group.scales[a]));
                }
                let [x, y, z] = slopes;
                let all = lanes.by_place([lanes.both(low[0], high[0]), x, y, z]);
                out.copy_from_slice(&all[..out.len()]);
            }
        }
    }
}

/// Both shares of each place along z together, for two points in a row.
#[inline(always)]
fn in_twos<L: Lanes>(lanes: L, [a, b, c, d]: [L::F; 4]) -> [L::F; 2] {
    [lanes.neighbours(a, b), lanes.neighbours(c, d)]
}

/// The sums along z at four points.
#[inline(always)]
fn along_z<L: Lanes>(lanes: L, twos: [L::F; 2], weights: &Weights, quarter: usize) -> [f32; 4] {
    let low = lanes.mul(twos[0], weights.z(lanes, 2 * quarter));
    let high = lanes.mul(twos[1], weights.z(lanes, 2 * quarter + 1));
    lanes.total(lanes.neighbours(low, high))
}
