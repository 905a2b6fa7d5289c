//! Samples in no element: the field is continued from the nearest points of the boundary, all of a box together.
//!
//! A sample x with the nearest boundary point q takes max(d(p), |x - q|), or d(p) without a cut, clamped to w, where p
//! is q on the nearest element. The boundary's triangles deviate from curved faces by the chordal error. So within a
//! voxel delta p is blended into the foot y of x on the element: p = q + (1 - |x - q| / delta) (y - q), and the value
//! is continuous where the element ends.
//! The law `values_in_bulk_are_those_of_single_points_in_graded_elements_of_every_kind` compares with single points.

use super::{CurvedBatch, LatticeSample};
use crate::tiling::TiledSolid;
use crate::tiling::boundary::RegionFacts;
use crate::tiling::locality::{LocalSearch, Owner};
use druse_geometry::frame::Vec3;

/// A sample in no element whose value is that of a point of one.
pub(super) struct ExteriorSample {
    sample: LatticeSample,
    /// The point of an element whose value it takes.
    point: Vec3,
    /// The least value that the cut at the boundary leaves.
    least: f64,
    /// 1 on the boundary, falling to 0 a voxel away.
    nearness: f64,
    owner: Option<Owner>,
}

impl TiledSolid<'_> {
    /// The values at the exterior samples of a batch.
    pub(super) fn fill_exterior_samples(
        &self,
        component: usize,
        local: &mut LocalSearch,
        known: RegionFacts,
        batch: &mut CurvedBatch,
        out: &mut [f32],
    ) {
        // The boundary's points first; most samples beyond the band need none.
        let mut continued = std::mem::take(&mut batch.continued);
        continued.clear();
        for sample in &batch.exterior {
            match self.continued(component, sample, known) {
                Ok(sample) => continued.push(sample),
                Err(Some(d)) => out[sample.n as usize] = d as f32,
                Err(None) => {
                    batch.evaluations += 1;
                    let d = self.value_at(component, local, sample.x, known);
                    out[sample.n as usize] = d as f32;
                }
            }
        }
        // Owners of the points. Near curved faces the points are then moved towards the elements, and have new owners.
        self.find_nearest(local, &mut continued, batch);
        if self.fade(local, &mut continued) {
            self.find_nearest(local, &mut continued, batch);
        }
        batch.clear_items();
        for (number, exterior) in (0..).zip(&continued) {
            if let Some(owner) = &exterior.owner {
                let sample = LatticeSample {
                    n: number,
                    x: exterior.point,
                };
                batch.push_single(sample, owner, self.patch(local, owner.near_index));
            } else {
                out[exterior.sample.n as usize] = self.options.half_width as f32;
            }
        }
        // The items are numbered in the list of exterior samples.
        let known = RegionFacts {
            limits: None,
            ..known
        };
        self.evaluate_items(local, known, batch, |t, d| {
            let exterior = &continued[t.n as usize];
            let d = d.max(exterior.least).min(self.options.half_width);
            out[exterior.sample.n as usize] = d as f32;
        });
        batch.continued = continued;
    }

    /// A sample with its nearest point on the boundary. An error is its value, if it needs no point; `None` if rounding
    /// has moved it out of the elements, so that it is evaluated alone.
    fn continued(
        &self,
        component: usize,
        sample: &LatticeSample,
        known: RegionFacts,
    ) -> Result<ExteriorSample, Option<f64>> {
        let w = self.options.half_width;
        let boundary = &self.components[component].boundary;
        if known.is_deep {
            return Err(None);
        }
        // The cut at the boundary leaves at least the distance to it; without a cut the field is continued alone.
        let (closest, least) = if self.is_cut() {
            let radius = w.min(known.max_boundary_distance * (1.0 + 1e-9)); // Rounding.
            let Some(closest) = known.closest_within(boundary, sample.x, radius) else {
                return Err((!boundary.contains(sample.x)).then_some(w));
            };
            // Inside by less than the chordal error: between the triangles and a curved face.
            let distance = closest.distance;
            let outside = if distance < self.boundary_tolerance() {
                0.0
            } else if distance < self.chord_slack() && boundary.contains(sample.x) {
                -distance
            } else {
                distance
            };
            if outside >= w.min(known.wanted.hi) {
                return Err(Some(w));
            }
            (closest, outside)
        } else {
            (boundary.closest(sample.x), -w)
        };
        Ok(ExteriorSample {
            sample: *sample,
            point: closest.point,
            least,
            nearness: 1.0 - (sample.x - closest.point).norm() / self.delta(),
            owner: None,
        })
    }

    /// Finds the owners of the points that have none, as [`Self::nearest`] does.
    fn find_nearest(
        &self,
        local: &mut LocalSearch,
        continued: &mut [ExteriorSample],
        batch: &mut CurvedBatch,
    ) {
        let CurvedBatch {
            at,
            owners,
            found,
            open_exterior: open,
            ..
        } = batch;
        collect_open(continued, open, at);
        self.owners(local, at, &mut batch.owner_buffers, owners);
        for (&n, owner) in open.iter().zip(&*owners) {
            continued[n as usize].owner = *owner;
        }
        collect_open(continued, open, at);
        // The boundary deviates from the elements by less.
        let margin = 2.0 * self.chord_slack();
        owners.clear();
        owners.resize(open.len(), None);
        for near_index in 0..local.near.patches.len() {
            if open.is_empty() {
                break;
            }
            self.preimages(local, near_index, (at, margin), found);
            for (k, &preimage) in found.found() {
                let best = &mut owners[k as usize];
                let reach = best.map_or(margin, |b| b.preimage.outside_distance);
                if preimage.outside_distance < reach {
                    *best = Some(Owner {
                        near_index,
                        preimage,
                    });
                }
            }
        }
        for (&n, nearest) in open.iter().zip(&*owners) {
            let exterior = &mut continued[n as usize];
            if let Some(owner) = nearest {
                let patch = self.patch(local, owner.near_index);
                let (point, preimage) = patch.at(self.scaffold, patch.clamp(owner.preimage.xi));
                exterior.point = point;
                exterior.owner = Some(Owner { preimage, ..*owner });
            } else if let Some((owner, point)) = self.nearest(local, exterior.point) {
                exterior.point = point;
                exterior.owner = Some(owner);
            }
        }
    }

    /// Moves the points of samples less than a voxel outside towards their feet on the element, see
    /// [`Self::continuation`], and takes their owners. Returns whether there are any.
    fn fade(&self, local: &LocalSearch, continued: &mut [ExteriorSample]) -> bool {
        let mut any = false;
        for exterior in continued.iter_mut().filter(|e| e.nearness > 0.0) {
            let Some(owner) = &exterior.owner else {
                continue;
            };
            let patch = self.patch(local, owner.near_index);
            if patch.is_affine() {
                continue;
            }
            let preimage = patch.preimage_or_affine(self.scaffold, exterior.sample.x);
            let foot = patch.point(self.scaffold, patch.clamp(preimage.xi));
            exterior.point += (foot - exterior.point) * exterior.nearness;
            exterior.owner = None;
            any = true;
        }
        any
    }
}

/// The samples without owners, and their points.
fn collect_open(continued: &[ExteriorSample], open: &mut Vec<u32>, at: &mut Vec<Vec3>) {
    let all = (0..).zip(continued).filter(|(_, e)| e.owner.is_none());
    open.clear();
    open.extend(all.clone().map(|(n, _)| n));
    at.clear();
    at.extend(all.map(|(_, e)| e.point));
}
