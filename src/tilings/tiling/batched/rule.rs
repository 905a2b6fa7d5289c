//! Rule Q for a batch of points: d = F sum(omega s) / sum(omega).
//!
//! F is the value in the owner, the element of lowest number that contains the point. s is the scale of two Newton
//! steps in each element e less than delta away, and `omega = 1 - max(m_e, depth) / delta` its weight, with `m_e` the
//! distance outside e and depth the distance of the point below its owner's faces. The owner weighs 1.

use super::distances::BatchDistances;
use super::expansions::BlockCentres;
use super::locate::{BatchLocations, Starts};
use super::newton_steps::NewtonBatch;
use super::sample_batch::{MAX_SAMPLES, SampleBatch, bits};
use crate::tiling::TiledSolid;
use crate::tiling::local_map::LocalMap;
use crate::tiling::locality::NearElements;
use druse_geometry::field::Interval;
use druse_geometry::frame::CellPoint;

/// Locations and distances of a batch's points.
#[derive(Default)]
pub(super) struct BatchEvaluation {
    /// Locations in each element, in the order of the elements given.
    pub locations: Vec<BatchLocations>,
    /// For each near element, if curved, the local map at a recent point.
    local_maps: Vec<Option<LocalMap>>,
    /// The points that lie in an element: a bit each.
    pub owned: u64,
    /// The points that lie in exactly one element: not on faces, nor where a scaffold overlaps itself.
    pub single: u64,
    pub distances: BatchDistances,
    /// Bound of the change of |F| between neighbouring samples.
    pub change: f64,
    /// Whether some sample out of the band may have a neighbour of the other sign: |F| is less than `change`
    /// there, or the scaffold overlaps itself.
    pub has_unproved_sign: bool,
    /// Depths of points below their owners' faces, world units, where other elements contribute.
    depth: PerPoint<f64>,
    /// The points of [`Self::newton`]: number in the batch, and weight.
    newton_items: PerPoint<(u8, f64)>,
    newton: NewtonBatch,
}

/// A value for each point of a batch.
struct PerPoint<T>([T; MAX_SAMPLES]);

impl<T: Copy + Default> Default for PerPoint<T> {
    fn default() -> Self {
        Self([T::default(); MAX_SAMPLES])
    }
}

impl BatchEvaluation {
    /// Starts over with other near elements. No local map is kept: earlier points must not affect even the last bits.
    pub fn start(&mut self, near: &NearElements) {
        self.local_maps.clear();
        self.local_maps.resize(near.patches.len(), None);
    }

    /// The starts of Newton's method in a near element.
    pub fn starts(&mut self, near_index: u32) -> Starts<'_> {
        Starts {
            last: &mut self.local_maps[near_index as usize],
            centres: None,
        }
    }

    /// The least m of a point among the first `count` elements: at most its distance outside affine ones.
    #[inline]
    pub fn outside(&self, count: usize, n: usize) -> f64 {
        let all = self.locations[..count].iter();
        all.map(|p| p.outside(n)).fold(f64::INFINITY, f64::min)
    }
}

/// Gathers reference coordinates of the points in `which`. Returns their number.
fn gather(location: &BatchLocations, which: u64, at: &mut [CellPoint<3>; MAX_SAMPLES]) -> usize {
    let mut count = 0;
    for n in bits(which) {
        at[count % MAX_SAMPLES] = location.xi(n);
        count += 1;
    }
    count
}

impl TiledSolid<'_> {
    /// Locates the points in these of the near elements, as far as they are less than `reach` outside, and finds their
    /// owners: the elements of lowest number. `centres` are those of the batch's blocks, if it has blocks.
    pub(super) fn locate(
        &self,
        near: &NearElements,
        near_indices: impl ExactSizeIterator<Item = u32>,
        (batch, reach, centres): (&SampleBatch, f64, Option<&BlockCentres>),
        evaluation: &mut BatchEvaluation,
    ) {
        let BatchEvaluation {
            locations,
            local_maps,
            ..
        } = evaluation;
        let count = near_indices.len();
        if locations.len() < count {
            locations.resize_with(count, BatchLocations::default);
        }
        // Elements come in ascending order: the first that contains a point owns it.
        let (mut open, mut repeated, mut inner) = (batch.active, 0, 0);
        for (location, near_index) in locations.iter_mut().zip(near_indices) {
            let near_index = near_index as usize;
            let patch = &self.patches[near.patches[near_index] as usize];
            let starts = Starts {
                last: &mut local_maps[near_index],
                centres: centres.map(|centres| (centres, near_index)),
            };
            patch.locate(self.scaffold, batch, reach, starts, location);
            // A second element contains the point as well.
            repeated |= location.owns & !open;
            // Elements that share more than faces.
            evaluation.has_unproved_sign |=
                (location.owns & inner | location.inner & !open) & batch.active != 0;
            inner |= location.inner;
            location.owns &= open;
            open &= !location.owns;
        }
        evaluation.owned = batch.active & !open;
        evaluation.single = evaluation.owned & !repeated;
    }

    /// Evaluates the field at the points that elements own, into `values` at the points' numbers.
    pub(super) fn evaluate_owned(
        &self,
        near: &NearElements,
        evaluation: &mut BatchEvaluation,
        values: &mut [f64; MAX_SAMPLES],
    ) {
        let mut found = [0.0; MAX_SAMPLES];
        for (location, &element) in evaluation.locations.iter().zip(&near.patches) {
            let count = gather(location, location.owns, &mut evaluation.newton.at);
            let found = &mut found[..count];
            self.filling
                .values(element as usize, &evaluation.newton.at[..count], found);
            for (n, v) in bits(location.owns).zip(found) {
                values[n] = *v;
            }
        }
    }

    /// Distances of a batch's points among these of the near elements, by ascending number. Those beyond the ends of
    /// `wanted`, which contains 0, only get their side.
    pub(super) fn evaluate_rule_q(
        &self,
        near: &NearElements,
        near_indices: &[u32],
        (batch, centres): (&SampleBatch, Option<&BlockCentres>),
        wanted: Interval,
        evaluation: &mut BatchEvaluation,
    ) {
        let (w, delta) = (self.options.half_width, self.delta());
        let patch = |&near_index: &u32| &self.patches[near.patches[near_index as usize] as usize];
        let indices = near_indices.iter().copied();
        self.locate(near, indices, (batch, delta, centres), evaluation);
        let sup = near_indices
            .iter()
            .map(|p| patch(p).slope_sup)
            .fold(0.0, f64::max);
        let BatchEvaluation {
            locations,
            owned,
            distances,
            change,
            has_unproved_sign,
            depth: PerPoint(depth),
            newton_items: PerPoint(newton_items),
            newton,
            ..
        } = evaluation;
        let locations = &locations[..near_indices.len()];
        // The owners give F and the gradient at each point.
        let mut deep = 0;
        for (location, near_index) in locations.iter().zip(near_indices) {
            let count = gather(location, location.owns, &mut newton.at);
            if count == 0 {
                continue;
            }
            let slopes = &mut newton.slopes[..count];
            let element = patch(near_index).number();
            self.filling
                .values_and_gradients_f32(element, &newton.at[..count], slopes);
            for (n, &slope) in bits(location.owns).zip(&*slopes) {
                distances.slopes[n] = slope;
            }
            deep |= location.owns & location.deep;
        }
        // Every scale is at least 1 / L: F beyond L times a wanted distance is beyond that distance.
        let open = Interval::new(sup * wanted.lo, sup * wanted.hi);
        let band = distances.set_far_distances(batch.len(), open, w) & *owned;
        *has_unproved_sign |= *change > w * sup;
        if band == 0 {
            return;
        }
        // Deep points have no second element; the others need their depth below the owner's faces.
        let shared = band & !deep;
        if shared != 0 {
            for location in locations {
                for n in bits(location.owns & shared) {
                    depth[n] = (-location.outside(n)).max(0.0);
                }
            }
        }
        distances.clear_sums();
        // Sum by ascending element number, so that both sides of a face give the same bits.
        for (location, near_index) in locations.iter().zip(near_indices) {
            let mut count = 0;
            for n in bits(location.owns & band) {
                newton_items[count % MAX_SAMPLES] = (n as u8, 1.0);
                newton.at[count % MAX_SAMPLES] = location.xi(n);
                newton.slopes[count % MAX_SAMPLES] = distances.slopes[n];
                count += 1;
            }
            let first = count;
            // omega = 1 - max(m_e, depth) / delta, zero a voxel away from the face.
            for n in bits(location.shares & shared & !location.owns) {
                let weight = 1.0 - location.outside(n).max(depth[n]) / delta;
                if weight > 0.0 {
                    newton_items[count % MAX_SAMPLES] = (n as u8, weight);
                    newton.at[count % MAX_SAMPLES] = location.xi(n);
                    count += 1;
                }
            }
            if count == 0 {
                continue;
            }
            let patch = patch(near_index);
            let neighbours = first..count;
            // Owned points have their slopes already; neighbours continue their own field to the points.
            if !neighbours.is_empty() {
                let at = &newton.at[neighbours.clone()];
                self.filling.values_and_gradients_f32(
                    patch.number(),
                    at,
                    &mut newton.slopes[neighbours],
                );
            }
            // s of each point in this element, by two Newton steps.
            let (limits, map) = (self.limits(patch), patch.step_map(self.scaffold));
            newton.len = count;
            newton.take_first_step(limits, map);
            let slopes = &mut newton.slopes[..count];
            self.filling
                .values_and_gradients_f32(patch.number(), &newton.at[..count], slopes);
            newton.take_second_step(limits, map);
            for (k, &(n, weight)) in newton_items[..count].iter().enumerate() {
                distances.add(usize::from(n), weight, newton.scale(k));
            }
        }
        *has_unproved_sign |= distances.blend_scales(batch.len(), [w, *change]) & band != 0;
    }
}
