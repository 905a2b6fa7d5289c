//! Samples in the band: from gradients in the contributing elements to blended distances.
//!
//! d = F sum `w_e` `s_e` / sum `w_e` over the elements e within a voxel delta of the sample: w = 1 for the owner, otherwise
//! `w_e` = 1 - max(`m_e`, depth) / delta, with `m_e` the distance outside e and the depth below the owner's faces. Both are 0 at
//! a face, where the two elements have the same weight. A contribution is one term of the sum; contributions lie in runs of
//! one element, and within them of one local map, in ascending order of elements, so that each sample is summed in the same
//! order from both sides of a face. The steps have no error of their own; `newton_distance` states that of the scale.

use super::{CurvedBatch, JacobianSource, LatticeSample};
use crate::tiling::TiledSolid;
use crate::tiling::boundary::RegionFacts;
use crate::tiling::locality::LocalSearch;
use crate::tiling::newton_distance::{self, FirstStep, InverseJacobians, StepStarts};
use druse_geometry::frame::{CellPoint, Vec3};

/// The contribution of an element to a sample.
pub(super) struct Contribution {
    item: u32,
    near_index: u32,
    /// The local map that gives d xi / d x; without one the batch stores the matrix.
    local_map: Option<u32>,
    weight: f64,
}

/// Weighted sum of the scales that contribute to a sample.
#[derive(Clone, Copy, Default)]
pub(super) struct ScaleSum {
    scales: f64,
    weights: f64,
}

impl TiledSolid<'_> {
    /// Passes samples out of the band to `found`, and collects the contributions of the owner and its neighbours
    /// to the others.
    pub(super) fn collect_contributions(
        &self,
        local: &LocalSearch,
        known: RegionFacts,
        batch: &mut CurvedBatch,
        mut found: impl FnMut(&LatticeSample, f64),
    ) {
        let w = self.options.half_width;
        let sup = local.near.slope_sup;
        batch.contributions.clear();
        batch.shared.clear();
        batch.points.clear();
        batch.slopes.clear();
        batch.inverses.clear();
        for n in 0..batch.items.len() {
            let (item, f) = (&batch.items[n], batch.owner_slopes[n].0);
            // Every scale is at least 1 / L: F beyond L times a wanted distance is beyond that distance.
            let wanted = known.wanted_of(item.sample.n);
            if f >= sup * wanted.hi {
                found(&item.sample, w);
            } else if f <= sup * wanted.lo {
                found(&item.sample, -w);
            } else if item.depth >= self.delta() {
                batch.push_owner_contribution(n as u32);
            } else {
                batch.shared.push(n as u32);
            }
        }
        if batch.shared.is_empty() {
            return;
        }
        // Sum by ascending element number, so that both sides of a face give the same bits.
        let shared = std::mem::take(&mut batch.shared);
        let mut found = std::mem::take(&mut batch.found);
        for near_index in 0..local.near.patches.len() {
            batch.at.clear();
            batch.neighbours.clear();
            for &n in &shared {
                let item = &batch.items[n as usize];
                if item.near_index as usize == near_index {
                    batch.push_owner_contribution(n);
                } else {
                    batch.at.push(item.sample.x);
                    batch.neighbours.push(n);
                }
            }
            let first = batch.points.len();
            self.preimages(local, near_index, (&batch.at, self.delta()), &mut found);
            for (k, preimage) in found.found() {
                let n = batch.neighbours[k as usize];
                let depth = batch.items[n as usize].depth;
                // w_e = 1 - max(m_e, depth) / delta.
                let weight = 1.0 - preimage.outside_distance.max(depth) / self.delta();
                if weight > 0.0 {
                    batch.inverses.push(preimage.inverse);
                    batch.push_contribution(n, near_index as u32, preimage.xi, None, weight);
                }
            }
            let neighbours = &batch.points[first..];
            batch
                .slopes
                .resize(batch.points.len(), (0.0, Vec3::zeros()));
            self.evaluate_slopes(local, near_index, neighbours, &mut batch.slopes[first..]);
        }
        batch.found = found;
        batch.shared = shared;
    }

    /// Distances of the samples in the band, by blending the scales of the contributing elements.
    pub(super) fn blend(
        &self,
        local: &LocalSearch,
        batch: &mut CurvedBatch,
        mut found: impl FnMut(&LatticeSample, f64),
    ) {
        let CurvedBatch {
            local_maps,
            items,
            owner_slopes,
            contributions,
            points,
            at,
            inverses,
            slopes,
            first_steps,
            scales,
            sums,
            ..
        } = batch;
        sums.clear();
        sums.resize(items.len(), ScaleSum::default());
        at.clear();
        at.extend(
            contributions
                .iter()
                .map(|s| items[s.item as usize].sample.x),
        );
        scales.resize(contributions.len(), 0.0);
        let count = contributions.len().max(first_steps.len());
        first_steps.resize(count, FirstStep::default());
        // First Newton step of all points with one element and one local map, four in a `FirstStep`.
        let (mut first, mut next_inverse, mut first_step) = (0, 0, 0);
        for run in contributions
            .chunk_by(|a, b| (a.near_index, a.local_map) == (b.near_index, b.local_map))
        {
            let all = first..first + run.len();
            let Contribution {
                near_index,
                local_map,
                ..
            } = run[0];
            let inverses = if let Some(number) = local_map {
                InverseJacobians::Local(&local_maps[number as usize])
            } else {
                let range = next_inverse..next_inverse + run.len();
                next_inverse = range.end;
                InverseJacobians::Each(&inverses[range])
            };
            let patch = self.patch(local, near_index as usize);
            let starts = StepStarts {
                x: &at[all.clone()],
                at: &mut points[all.clone()],
                inverses,
                slopes: &slopes[all.clone()],
            };
            let range = first_step..first_step + run.len().div_ceil(4);
            patch.take_first_step(
                self.scaffold,
                self.limits(patch),
                starts,
                &mut first_steps[range.clone()],
            );
            (first, first_step) = (all.end, range.end);
        }
        // F and its gradient at the ends of the first steps, all points of an element at once.
        let mut first = 0;
        for run in contributions.chunk_by(|a, b| a.near_index == b.near_index) {
            let all = first..first + run.len();
            first = all.end;
            let near_index = run[0].near_index as usize;
            self.evaluate_slopes(local, near_index, &points[all.clone()], &mut slopes[all]);
        }
        // The second steps, in the runs of the first: each gives the scale s of its point.
        let (mut first, mut first_step) = (0, 0);
        for run in contributions
            .chunk_by(|a, b| (a.near_index, a.local_map) == (b.near_index, b.local_map))
        {
            let (all, range) = (
                first..first + run.len(),
                first_step..first_step + run.len().div_ceil(4),
            );
            let limits = self.limits(self.patch(local, run[0].near_index as usize));
            newton_distance::take_second_step(
                limits,
                &slopes[all.clone()],
                &first_steps[range.clone()],
                &mut scales[all.clone()],
            );
            (first, first_step) = (all.end, range.end);
        }
        // The sums of the weights w_e of rule Q and of w_e s_e; the elements come in ascending order.
        for (contribution, scale) in contributions.iter().zip(&*scales) {
            let sum = &mut sums[contribution.item as usize];
            sum.scales += contribution.weight * scale;
            sum.weights += contribution.weight;
        }
        let w = self.options.half_width;
        let all = items.iter().zip(&*owner_slopes).zip(&*sums);
        for ((item, (f, _)), sum) in all.filter(|(_, s)| s.weights > 0.0) {
            // d = F sum w_e s_e / sum w_e.
            let d = (f * sum.scales / sum.weights).clamp(-w, w);
            found(&item.sample, d);
        }
    }
}

impl CurvedBatch {
    /// Adds the contribution of an item's owner.
    fn push_owner_contribution(&mut self, item: u32) {
        let pending = &self.items[item as usize];
        let (near_index, xi) = (
            pending.near_index,
            self.evaluation_points.points[item as usize].0,
        );
        self.slopes.push(self.owner_slopes[item as usize]);
        match pending.jacobian {
            JacobianSource::Local(number) => {
                self.push_contribution(item, near_index, xi, Some(number), 1.0);
            }
            JacobianSource::Single(number) => {
                self.inverses.push(self.single_inverses[number as usize]);
                self.push_contribution(item, near_index, xi, None, 1.0);
            }
        }
    }

    /// Adds a contribution to an item, with d xi / d x from a local map or from the list.
    fn push_contribution(
        &mut self,
        item: u32,
        near_index: u32,
        xi: Vec3,
        local_map: Option<u32>,
        weight: f64,
    ) {
        self.points.push(CellPoint(xi));
        self.contributions.push(Contribution {
            item,
            near_index,
            local_map,
            weight,
        });
    }
}
