//! Samples outside the scaffold: `d = max(d_F, d_S)`, the cut at the boundary.
//!
//! `d_S` is the exact distance to the boundary, `d_F` the distance of the field at the closest point of the boundary.
//! Without a cut, `d_F` alone continues the field. Up to 64 closest points make one batch of rule Q (`rule`).

use super::AffineBuffers;
use super::block::FillContext;
use super::sample_batch::{MAX_SAMPLES, bits};
use crate::tiling::TiledSolid;
use crate::tiling::boundary::RegionFacts;
use crate::tiling::locality::LocalSearch;
use druse_geometry::field::Interval;
use druse_geometry::frame::{Aabb, Vec3};

/// A point more than this outside all elements, voxels, is not in a gap due to rounding.
pub(super) const GAP_TOLERANCE: f64 = 1e-6;

/// A sample in no element: its storage index, its point in world space, and the number of its part.
#[derive(Clone, Copy)]
pub(super) struct ExteriorSample {
    pub n: usize,
    pub x: Vec3,
    pub part: usize,
}

impl TiledSolid<'_> {
    /// The value at a sample, evaluated as a single point.
    pub(super) fn single_value(
        &self,
        context: &FillContext,
        sample: &ExteriorSample,
        known: RegionFacts,
    ) -> f64 {
        let mut local = LocalSearch::new(context.near.clone());
        self.value_at(context.component, &mut local, sample.x, known)
    }

    /// Values outside the scaffold, world units: those at the closest points of its boundary, and at least the distance
    /// to them where the boundary cuts; w where that distance is beyond what the part wants.
    pub(super) fn fill_exterior(
        &self,
        context: &FillContext,
        buffers: &mut AffineBuffers,
        out: &mut [f32],
    ) {
        let w = self.options.half_width;
        let boundary = &self.components[context.component].boundary;
        let exterior = std::mem::take(&mut buffers.exterior);
        for exterior in exterior.chunks(MAX_SAMPLES) {
            buffers.batch.clear();
            let mut feet = Aabb::EMPTY;
            let mut exterior_points = [(0, 0.0); MAX_SAMPLES];
            for (number, sample) in exterior.iter().enumerate() {
                // Beyond the band, or beyond the greatest distance in the part, no closest point is needed.
                let closest = if self.is_cut() {
                    let known = context.region_facts(&buffers.parts[sample.part]);
                    let radius = w.min(known.max_boundary_distance * (1.0 + 1e-9)); // Rounding.
                    known.closest_within(boundary, sample.x, radius)
                } else {
                    Some(boundary.closest(sample.x))
                };
                // No boundary within the band: d = w.
                let Some(closest) = closest else {
                    out[sample.n] = w as f32;
                    continue;
                };
                // d_S: 0 within the tolerance of the boundary; -w, below every d_F, where the boundary does not cut.
                let outside = match self.is_cut() {
                    true if closest.distance < self.boundary_tolerance() => 0.0,
                    true => closest.distance,
                    false => -w,
                };
                if outside >= buffers.parts[sample.part].wanted.hi {
                    out[sample.n] = w as f32;
                    continue;
                }
                exterior_points[buffers.batch.len()] = (number, outside);
                let q = closest.point;
                feet = feet.union(Aabb { min: q, max: q });
                buffers.batch.push(q.into());
            }
            buffers.batch.fill_up();
            if buffers.batch.len() == 0 {
                continue;
            }
            let (centre, half) = (feet.centre().0, feet.size() / 2.0);
            // Only elements that reach the box of the closest points can contribute to them.
            buffers.near_indices.clear();
            for (near_index, &e) in (0..).zip(&context.near.patches) {
                if !self.patches[e as usize].is_box_outside(centre, half, self.delta()) {
                    buffers.near_indices.push(near_index);
                }
            }
            let wanted = exterior
                .iter()
                .map(|sample| buffers.parts[sample.part].wanted)
                .fold(Interval::new(0.0, 0.0), Interval::hull);
            self.evaluate_rule_q(
                context.near,
                &buffers.near_indices,
                &buffers.batch,
                wanted,
                &mut buffers.samples,
            );
            buffers.evaluations += u64::from(buffers.samples.owned.count_ones());
            // d = max(d_F, d_S); a closest point that rounding puts into no element is evaluated alone.
            for n in bits(buffers.batch.active) {
                let (number, outside) = exterior_points[n];
                let sample = &exterior[number];
                out[sample.n] = if buffers.samples.owned >> n & 1 != 0 {
                    buffers.samples.distances.d(n).max(outside).min(w) as f32
                } else {
                    self.single_value(
                        context,
                        sample,
                        context.region_facts(&buffers.parts[sample.part]),
                    ) as f32
                };
            }
        }
        buffers.exterior = exterior;
        buffers.exterior.clear();
    }
}
