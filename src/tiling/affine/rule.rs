//! Rule Q for a bundle of points among straight elements.

use super::distances::Found;
use super::newton_steps::Walk;
use super::sample_batch::{Bundle, MOST, Placed, bits};
use crate::frame::CellPoint;
use crate::tiling::locality::Near;
use crate::tiling::patch::Patch;
use crate::tiling::{Filling, TiledSolid};

/// What is wanted of points.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::tiling) enum Wanted {
    Distances,
    /// A value of the right sign.
    Signs,
}

/// What is found of a bundle's points.
#[derive(Default)]
pub(super) struct Rule {
    /// By element, in the order in which they were given.
    pub placed: Vec<Placed>,
    /// Which points lie in an element.
    pub owned: u64,
    /// Which lie in one only: not on faces, nor where a scaffold overlaps itself.
    pub single: u64,
    pub found: Found,
    /// How much |F| may change from a sample to its neighbours, and whether some sample, as far from the surface
    /// as the half width, was found where it is not greater, or where the scaffold overlaps itself.
    pub change: f64,
    pub is_open: bool,
    /// How deep points lie in their owners, world units, if others share in them.
    depth: PerPoint<f64>,
    /// Points of the walk: their numbers, and their weights.
    items: PerPoint<(u8, f64)>,
    walk: Walk,
}

/// A thing for each point of a bundle.
struct PerPoint<T>([T; MOST]);

impl<T: Copy + Default> Default for PerPoint<T> {
    fn default() -> Self {
        Self([T::default(); MOST])
    }
}

impl Rule {
    /// Places points in some of the near elements, and finds their owners: those of lowest number.
    pub fn place<'a>(
        &mut self,
        patches: impl ExactSizeIterator<Item = &'a Patch>,
        bundle: &Bundle,
        delta: f64,
    ) {
        let count = patches.len();
        if self.placed.len() < count {
            self.placed.resize_with(count, Placed::default);
        }
        let (mut open, mut again, mut deep) = (bundle.real, 0, 0);
        for (placed, patch) in self.placed.iter_mut().zip(patches) {
            patch.place(bundle, delta, placed);
            again |= placed.owns & !open;
            // By more than their faces.
            self.is_open |= (placed.owns & deep | placed.deep & !open) & bundle.real != 0;
            deep |= placed.deep;
            placed.owns &= open;
            open &= !placed.owns;
        }
        self.owned = bundle.real & !open;
        self.single = self.owned & !again;
    }

    /// How far from the nearest of so many elements a point is at least.
    #[inline]
    pub fn outside(&self, count: usize, n: usize) -> f64 {
        let all = self.placed[..count].iter();
        all.map(|p| p.outside(n)).fold(f64::INFINITY, f64::min)
    }
}

/// Gathers reference coordinates of points; gives how many there are.
fn gather(placed: &Placed, which: u64, at: &mut [CellPoint<3>; MOST]) -> usize {
    let mut count = 0;
    for n in bits(which) {
        at[count % MOST] = placed.xi(n);
        count += 1;
    }
    count
}

impl<F: Filling> TiledSolid<'_, F> {
    /// The field at those points of a placed bundle that elements own, into `values` of their numbers.
    pub(super) fn field_of(&self, near: &Near, rule: &mut Rule, values: &mut [f64; MOST]) {
        let mut found = [0.0; MOST];
        for (placed, &element) in rule.placed.iter().zip(&near.patches) {
            let count = gather(placed, placed.owns, &mut rule.walk.at);
            let found = &mut found[..count];
            self.filling
                .values(element as usize, &rule.walk.at[..count], found);
            for (n, v) in bits(placed.owns).zip(found) {
                values[n] = *v;
            }
        }
    }

    /// Distances of a bundle's points among these of the near elements, by ascending number.
    pub(super) fn rule_q(
        &self,
        (near, places): (&Near, &[u32]),
        bundle: &Bundle,
        wanted: Wanted,
        rule: &mut Rule,
    ) {
        let (w, delta) = (self.options.half_width, self.delta());
        let patch = |&place: &u32| &self.patches[near.patches[place as usize] as usize];
        rule.place(places.iter().map(patch), bundle, delta);
        let sup = places
            .iter()
            .map(|p| patch(p).slope_sup)
            .fold(0.0, f64::max);
        let Rule {
            placed,
            owned,
            found,
            change,
            is_open,
            depth: PerPoint(depth),
            items: PerPoint(items),
            walk,
            ..
        } = rule;
        let placed = &placed[..places.len()];
        let mut deep = 0;
        for (placed, place) in placed.iter().zip(places) {
            let count = gather(placed, placed.owns, &mut walk.at);
            if count == 0 {
                continue;
            }
            let slopes = &mut walk.slopes[..count];
            let element = patch(place).number();
            self.filling.samples(element, &walk.at[..count], slopes);
            for (n, &slope) in bits(placed.owns).zip(&*slopes) {
                found.slopes[n] = slope;
            }
            deep |= placed.owns & placed.deep;
        }
        // Every scale is at least 1 / L.
        let band = found.decide(bundle.len(), [w * sup, w]) & *owned;
        *is_open |= *change > w * sup;
        if band == 0 || wanted == Wanted::Signs {
            return;
        }
        let shared = band & !deep;
        if shared != 0 {
            for placed in placed {
                for n in bits(placed.owns & shared) {
                    depth[n] = (-placed.outside(n)).max(0.0);
                }
            }
        }
        found.clear_sums();
        // In order of element numbers, so that both sides of a face sum alike.
        for (placed, place) in placed.iter().zip(places) {
            let mut count = 0;
            for n in bits(placed.owns & band) {
                items[count % MOST] = (n as u8, 1.0);
                walk.at[count % MOST] = placed.xi(n);
                walk.slopes[count % MOST] = found.slopes[n];
                count += 1;
            }
            let first = count;
            for n in bits(placed.shares & shared & !placed.owns) {
                let weight = 1.0 - placed.outside(n).max(depth[n]) / delta;
                if weight > 0.0 {
                    items[count % MOST] = (n as u8, weight);
                    walk.at[count % MOST] = placed.xi(n);
                    count += 1;
                }
            }
            if count == 0 {
                continue;
            }
            let patch = patch(place);
            let guests = first..count;
            if !guests.is_empty() {
                let at = &walk.at[guests.clone()];
                self.filling
                    .samples(patch.number(), at, &mut walk.slopes[guests]);
            }
            let (pace, map) = (self.pace(patch), patch.start());
            walk.len = count;
            walk.set_off(pace, &map);
            let slopes = &mut walk.slopes[..count];
            self.filling
                .samples(patch.number(), &walk.at[..count], slopes);
            walk.arrive(pace, &map);
            for (k, &(n, weight)) in items[..count].iter().enumerate() {
                found.add(usize::from(n), weight, walk.scale(k));
            }
        }
        *is_open |= found.finish(bundle.len(), [w, *change]) & band != 0;
    }
}
