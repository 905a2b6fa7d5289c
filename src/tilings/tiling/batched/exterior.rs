//! Samples outside the scaffold: `d = max(d_F, d_S)`, the cut at the boundary.
//!
//! `d_S` is the exact distance to the boundary, `d_F` the distance of the field at the closest point q of the boundary.
//! Without a cut, `d_F` alone continues the field. Up to 64 closest points make one batch of rule Q (`rule`).
//!
//! The boundary's triangles deviate from curved faces by the chordal error. So q moves to the nearest point of an
//! element, and within a voxel delta of the sample x it is blended into the foot y of x on the element, to
//! q + (1 - |x - q| / delta) (y - q): the value is continuous where the element ends.

use super::BatchBuffers;
use super::block::FillContext;
use super::sample_batch::{MAX_SAMPLES, bits};
use crate::tiling::TiledSolid;
use crate::tiling::boundary::RegionFacts;
use crate::tiling::locality::LocalSearch;
use crate::tiling::patch::Patch;
use druse_geometry::field::Interval;
use druse_geometry::frame::{Aabb, Vec3};
use druse_geometry::mesh::ClosestPoint;

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
        buffers: &mut BatchBuffers,
        out: &mut [f32],
    ) {
        let w = self.options.half_width;
        let boundary = &self.components[context.component].boundary;
        let exterior = std::mem::take(&mut buffers.exterior);
        for exterior in exterior.chunks(MAX_SAMPLES) {
            buffers.batch.clear();
            // The sample of each point, and the least value that the cut leaves it.
            let mut exterior_points = [(0, 0.0); MAX_SAMPLES];
            let mut all_closest = [None; MAX_SAMPLES];
            let mut closest = &mut all_closest[..exterior.len()];
            for samples in exterior.chunk_by(|a, b| a.part == b.part) {
                let (own, others) = closest.split_at_mut(samples.len());
                let known = context.region_facts(&buffers.parts[samples[0].part]);
                self.closest_points(context, samples, known, own);
                closest = others;
            }
            for (number, (sample, closest)) in exterior.iter().zip(all_closest).enumerate() {
                let part = &buffers.parts[sample.part];
                let known = context.region_facts(part);
                let may_be_inside = !context.is_affine && !part.is_outside;
                // No boundary within the band: d = w, unless Newton's method has failed inside.
                let Some(closest) = closest else {
                    out[sample.n] = if may_be_inside && boundary.contains(sample.x) {
                        buffers.evaluations += 1;
                        self.single_value(context, sample, known) as f32
                    } else {
                        w as f32
                    };
                    continue;
                };
                // d_S: 0 within the tolerance of the boundary; -w, below every d_F, where the boundary does not cut.
                let outside = match self.is_cut() {
                    true if closest.distance < self.boundary_tolerance() => 0.0,
                    // Between the triangles and a curved face.
                    true if may_be_inside
                        && closest.distance < self.chord_slack()
                        && boundary.contains(sample.x) =>
                    {
                        -closest.distance
                    }
                    true => closest.distance,
                    false => -w,
                };
                if outside >= part.wanted.hi {
                    out[sample.n] = w as f32;
                    continue;
                }
                exterior_points[buffers.batch.len()] = (number, outside);
                buffers.batch.push(closest.point.into());
            }
            if buffers.batch.len() == 0 {
                continue;
            }
            buffers.batch.fill_up();
            self.collect_near(context, buffers);
            if !context.is_affine {
                let sample = |n: usize| exterior[exterior_points[n].0].x;
                self.move_to_elements(context, sample, buffers);
                self.collect_near(context, buffers);
            }
            let wanted = exterior
                .iter()
                .map(|sample| buffers.parts[sample.part].wanted)
                .fold(Interval::new(0.0, 0.0), Interval::hull);
            // max(d_F, d_S) needs no d_F below the least d_S.
            let least = match self.is_cut() {
                true if context.is_affine => 0.0,
                true => -self.chord_slack(),
                false => -w,
            };
            let wanted = Interval::new(wanted.lo.max(least), wanted.hi);
            self.evaluate_rule_q(
                context.near,
                &buffers.near_indices,
                (&buffers.batch, None),
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
                    buffers.evaluations += 1;
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

    /// The boundary points nearest to samples of a part; without a cut always one.
    fn closest_points(
        &self,
        context: &FillContext,
        samples: &[ExteriorSample],
        known: RegionFacts,
        closest: &mut [Option<ClosestPoint>],
    ) {
        let boundary = &self.components[context.component].boundary;
        let mut points = [Vec3::zeros(); MAX_SAMPLES];
        for (point, sample) in points.iter_mut().zip(samples) {
            *point = sample.x;
        }
        let points = &points[..samples.len()];
        if !self.is_cut() {
            for (closest, x) in closest.iter_mut().zip(points) {
                *closest = Some(boundary.closest(*x));
            }
            return;
        }
        // Beyond the band, or the greatest distance in the part, no closest point is needed; 1e-9 is for rounding.
        let w = self.options.half_width;
        let radius = w.min(known.max_boundary_distance * (1.0 + 1e-9));
        known.closest_within_all(boundary, points, radius, closest);
    }

    /// Collects the elements that can contribute to the points of the batch: those that reach the box around them.
    fn collect_near(&self, context: &FillContext, buffers: &mut BatchBuffers) {
        let points = bits(buffers.batch.active).map(|n| buffers.batch.point(n));
        let feet = Aabb::of(points);
        let (centre, half) = (feet.centre().0, feet.size() / 2.0);
        buffers.near_indices.clear();
        for (near_index, &e) in (0..).zip(&context.near.patches) {
            if !self.patches[e as usize].is_box_outside(centre, half, self.delta()) {
                buffers.near_indices.push(near_index);
            }
        }
    }

    /// Moves the points of the batch, the closest ones of the boundary's triangles, to the elements, and those of samples
    /// less than a voxel away towards their feet on the element. `sample` gives the position of a point's sample.
    fn move_to_elements(
        &self,
        context: &FillContext,
        sample: impl Fn(usize) -> Vec3,
        buffers: &mut BatchBuffers,
    ) {
        // The triangles deviate from the elements by less.
        let margin = 2.0 * self.chord_slack();
        let active = buffers.batch.active;
        for may_fade in [true, false] {
            let BatchBuffers {
                batch,
                samples,
                near_indices,
                ..
            } = &mut *buffers;
            let indices = near_indices.iter().copied();
            self.locate(context.near, indices, (batch, margin, None), samples);
            let locations = &samples.locations[..near_indices.len()];
            // The points that fade towards the feet of their samples, a bit each; the near elements of these feet, and the
            // weights.
            let mut faded = 0;
            let mut feet = [(0, 0.0); MAX_SAMPLES];
            for n in bits(batch.active) {
                let closest = batch.point(n);
                // The owner, or else the nearest element.
                let all = locations.iter().zip(&*near_indices);
                let owner = all.clone().find(|(l, _)| l.owns >> n & 1 != 0);
                let is_owned = owner.is_some();
                let nearest = || all.min_by(|(a, _), (b, _)| a.outside(n).total_cmp(&b.outside(n)));
                let Some((location, &near_index)) = owner
                    .or_else(nearest)
                    .filter(|(l, _)| l.outside(n) < margin)
                else {
                    continue;
                };
                let patch = self.near_patch(context, near_index);
                if !is_owned {
                    let foot = patch.clamp(location.xi(n).0);
                    batch.move_point(n, patch.point(self.scaffold, foot));
                }
                let nearness = 1.0 - (sample(n) - closest).norm() / self.delta();
                if may_fade && nearness > 0.0 && !patch.is_affine() {
                    faded |= 1 << n;
                    feet[n] = (near_index, nearness);
                }
            }
            // A faded point may have left the element: it moves once more.
            if faded == 0 {
                break;
            }
            self.fade_to_feet(context, (faded, &feet), &sample, buffers);
            buffers.batch.active = faded;
        }
        buffers.batch.active = active;
    }

    /// Blends points of the batch, a bit of `faded` each, into the feet of their samples. `feet` gives the near element of
    /// each, by index, and its weight.
    fn fade_to_feet(
        &self,
        context: &FillContext,
        (faded, feet): (u64, &[(u32, f64); MAX_SAMPLES]),
        sample: impl Fn(usize) -> Vec3,
        buffers: &mut BatchBuffers,
    ) {
        let BatchBuffers {
            batch,
            samples,
            faded_samples: points,
            foot_locations: location,
            ..
        } = buffers;
        // The other points only keep the numbers.
        points.clear();
        for n in 0..batch.len() {
            let is_faded = faded >> n & 1 != 0;
            let x = if is_faded { sample(n) } else { batch.point(n) };
            points.push(x.into());
        }
        let mut open = faded;
        while open != 0 {
            // The points of one element at a time.
            let (near_index, _) = feet[open.trailing_zeros() as usize % MAX_SAMPLES];
            points.active = bits(open)
                .filter(|&n| feet[n].0 == near_index)
                .fold(0, |all, n| all | 1 << n);
            open &= !points.active;
            let patch = self.near_patch(context, near_index);
            let starts = samples.starts(near_index);
            patch.locate(self.scaffold, points, f64::INFINITY, starts, location);
            for n in bits(points.active) {
                let xi = if location.shares >> n & 1 != 0 {
                    location.xi(n).0
                } else {
                    patch.preimage_or_affine(self.scaffold, points.point(n)).xi
                };
                let foot = patch.point(self.scaffold, patch.clamp(xi));
                let point = batch.point(n);
                batch.move_point(n, point + (foot - point) * feet[n].1);
            }
        }
    }

    /// A near element, given by index.
    fn near_patch(&self, context: &FillContext, near_index: u32) -> &Patch {
        &self.patches[context.near.patches[near_index as usize] as usize]
    }
}
