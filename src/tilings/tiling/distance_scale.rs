//! Rule Q: distance as the field times a positive scale, blended over faces.
//!
//! In an element the scale s = |step| / |F| comes from two Newton steps (`newton_distance`). Within one blending width
//! of a face the scales of the elements around are averaged with weights that vanish at that width, so that d is
//! continuous while its zeros are those of F.

use super::locality::{LocalSearch, Owner};
use super::newton_distance::StepLimits;
use super::patch::{Patch, Preimage};
use super::{Distance, TiledSolid};
use druse_geometry::frame::{CellPoint, Vec3};

impl TiledSolid<'_> {
    /// The distance d(F) at a point of the scaffold, clamped to the band and not cut at the boundary.
    pub(super) fn distance(&self, local: &LocalSearch, at: Owner, x: Vec3) -> f64 {
        let w = self.options.half_width;
        let (f, g) = self.slope(local.near.patches[at.near_index], &at.preimage);
        // Every scale is at least 1 / L.
        if f.abs() >= w * local.near.slope_sup {
            return w.copysign(f);
        }
        let d = self.fast(local, at, x, f, g);
        match self.options.distance {
            Distance::Fast => d,
            Distance::Exact => self.exact(local, x, d),
        }
    }

    /// Rule Q: d = F sum(omega s) / sum(omega) over the near elements, with the scale s and the weight omega of each.
    /// `f` and `g` are value and gradient in the owner, by its reference coordinates. `local` holds the elements near
    /// `x`, `at` is its owner.
    fn fast(&self, local: &LocalSearch, at: Owner, x: Vec3, f: f64, g: Vec3) -> f64 {
        let w = self.options.half_width;
        let delta = self.delta();
        let patch = self.patch(local, at.near_index);
        let owner_scale = self.scale(patch, &at.preimage, f, g);
        let depth = patch.depth(&at.preimage);
        if depth >= delta {
            return (f * owner_scale).clamp(-w, w);
        }
        // Sum by ascending element number, so that both sides of a face give the same bits.
        let (mut sum, mut weights) = (0.0, 0.0);
        for near_index in 0..local.near.patches.len() {
            if near_index == at.near_index {
                sum += owner_scale;
                weights += 1.0;
                continue;
            }
            let Some(preimage) = self.preimage(local, near_index, x, delta) else {
                continue;
            };
            let patch = self.patch(local, near_index);
            // omega is 1 at the face, and 0 where the depth reaches delta: from there on the owner counts alone.
            let weight = 1.0 - preimage.outside_distance.max(depth) / delta;
            if weight > 0.0 {
                let (f, g) = self.slope(patch.number() as u32, &preimage);
                sum += weight * self.scale(patch, &preimage, f, g);
                weights += weight;
            }
        }
        (f * sum / weights).clamp(-w, w)
    }

    /// The filling's value in an element and its gradient by reference coordinates.
    fn slope(&self, element: u32, preimage: &Preimage) -> (f64, Vec3) {
        let at = CellPoint(preimage.xi);
        self.filling.value_and_gradient(element as usize, at)
    }

    /// The scale `s_e`: distance per field unit at a point, by two damped Newton steps with the element's own field,
    /// from its value `f` and gradient `g` there.
    fn scale(&self, patch: &Patch, preimage: &Preimage, f: f64, g: Vec3) -> f64 {
        let limits = self.limits(patch);
        let mut at = preimage.xi.into();
        let first = limits.first_step(patch.step_map(self.scaffold), &mut at, f, g.into());
        let end = CellPoint(at.into());
        let (f, g) = self.filling.value_and_gradient(patch.number(), end);
        limits.scale(first, f, g.into())
    }

    /// Limits of the Newton steps in an element.
    pub(super) fn limits(&self, patch: &Patch) -> StepLimits {
        patch.limits(self.options.half_width, self.options.voxel_size)
    }
}
