//! Rule Q: distance as the field times a positive scale, blended over faces.

use super::locality::{Local, Owner};
use super::newton_distance::{self, Frame, Leg, Pace, Walkers};
use super::patch::{Patch, Spot};
use super::{Distance, Filling, TiledSolid};
use crate::frame::{CellPoint, Vec3};

impl<F: Filling> TiledSolid<'_, F> {
    /// The distance d(F) at a point of the scaffold, clamped to the band; the boundary not regarded.
    pub(super) fn distance(&self, local: &Local, at: Owner, x: Vec3) -> f64 {
        let w = self.options.half_width;
        let slope = self.slope(local.near.patches[at.place], &at.spot);
        let f = slope.0;
        // Every scale is at least 1 / L.
        if f.abs() >= w * local.near.slope_sup {
            return w.copysign(f);
        }
        let d = self.fast(local, at, x, slope);
        match self.options.distance {
            Distance::Fast => d,
            Distance::Exact => self.exact(local, x, d),
        }
    }

    /// Rule Q, from value and gradient in the owner.
    fn fast(&self, local: &Local, at: Owner, x: Vec3, slope: (f64, Vec3)) -> f64 {
        let w = self.options.half_width;
        let delta = self.delta();
        let patch = self.patch(local, at.place);
        let own = self.scale(patch, &at.spot, x, slope);
        let depth = patch.depth(&at.spot);
        if depth >= delta {
            return (slope.0 * own).clamp(-w, w);
        }
        // In order of element numbers, so that both sides of a face sum alike.
        let (mut sum, mut weights) = (0.0, 0.0);
        for place in 0..local.near.patches.len() {
            if place == at.place {
                sum += own;
                weights += 1.0;
                continue;
            }
            let Some(spot) = self.spot(local, place, x, delta) else {
                continue;
            };
            let patch = self.patch(local, place);
            let weight = 1.0 - spot.overshoot.max(depth) / delta;
            if weight > 0.0 {
                sum +=
                    weight * self.scale(patch, &spot, x, self.slope(patch.number() as u32, &spot));
                weights += weight;
            }
        }
        (slope.0 * sum / weights).clamp(-w, w)
    }

    /// The filling's value in an element and its gradient by reference coordinates.
    fn slope(&self, element: u32, spot: &Spot) -> (f64, Vec3) {
        let at = CellPoint(spot.xi);
        self.filling.value_and_gradient(element as usize, at)
    }

    /// The scale `s_e`: distance per field unit at `x`, by two damped Newton steps with one element's
    /// own field, given its value and gradient there.
    fn scale(&self, patch: &Patch, spot: &Spot, x: Vec3, slope: (f64, Vec3)) -> f64 {
        let pace = self.pace(patch);
        let mut at = [CellPoint(spot.xi)];
        let (mut legs, mut scales) = ([Leg::default()], [0.0]);
        let walkers = Walkers {
            x: &[x],
            at: &mut at,
            frame: Frame::Each(&[spot.inverse]),
            slopes: &[slope],
        };
        patch.set_off(self.scaffold, pace, walkers, &mut legs);
        let slope = self.filling.value_and_gradient(patch.number(), at[0]);
        newton_distance::arrive(pace, &[slope], &legs, &mut scales);
        scales[0]
    }

    /// How far steps may go in an element.
    pub(super) fn pace(&self, patch: &Patch) -> Pace {
        patch.pace(self.options.half_width, self.options.voxel_size)
    }
}
