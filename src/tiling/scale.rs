//! Rule Q: distance as the field times a positive scale, blended over faces.

use super::near::{Local, Owner};
use super::patch::{Patch, Spot};
use super::{Distance, Filling, TiledSolid};
use crate::frame::{CellPoint, Vec3};

/// Newton steps are damped where the slope is below this fraction of its mean.
const DAMPING: f64 = 0.05;
/// Scales beyond this many times the mean distance per field unit are cut off.
const STEEPEST: f64 = 10.0;

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
        let depth = patch.depth(x, &at.spot);
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
            let weight = 1.0 - patch.overshoot(x, &spot).max(depth) / delta;
            if weight > 0.0 {
                sum +=
                    weight * self.scale(patch, &spot, x, self.slope(patch.number() as u32, &spot));
                weights += weight;
            }
        }
        (slope.0 * sum / weights).clamp(-w, w)
    }

    /// The filling's value in an element and its gradient in world space.
    pub(super) fn slope(&self, element: u32, spot: &Spot) -> (f64, Vec3) {
        let (f, g) = self
            .filling
            .value_and_gradient(element as usize, CellPoint(spot.xi));
        (f, spot.inverse.tr_mul(&g))
    }

    /// The scale `s_e`: distance per field unit at `x`, by two damped Newton steps with one element's
    /// own field, given its value and gradient there.
    fn scale(&self, patch: &Patch, spot: &Spot, x: Vec3, slope: (f64, Vec3)) -> f64 {
        let mut advance = self.advance(patch, slope);
        if advance.goes_on() {
            let to = x + advance.step;
            let mut at = [CellPoint(spot.xi + spot.inverse * advance.step)];
            let mut inverse = [spot.inverse];
            patch.follow_all(self.scaffold, &[to], &mut at, &mut inverse);
            let (f, g) = self.filling.value_and_gradient(patch.number(), at[0]);
            let slope = (f, inverse[0].tr_mul(&g));
            advance.arrive(self.step(patch, slope));
        }
        advance.scale(patch)
    }

    /// The first of both steps.
    pub(super) fn advance(&self, patch: &Patch, (f, g): (f64, Vec3)) -> Advance {
        let size = f.abs();
        if size < 1e-9 * patch.slope_rms * self.options.voxel_size {
            let damping = (DAMPING * patch.slope_rms).powi(2);
            return Advance {
                step: Vec3::zeros(),
                size: 0.0,
                scale: g.norm() / (g.norm_squared() + damping),
            };
        }
        Advance {
            step: self.step(patch, (f, g)),
            size,
            scale: 0.0,
        }
    }

    /// A damped Newton step from a point with this value and gradient.
    pub(super) fn step(&self, patch: &Patch, (f, g): (f64, Vec3)) -> Vec3 {
        let damping = (DAMPING * patch.slope_rms).powi(2);
        let longest = 2.0 * self.options.half_width;
        let step = g * (-f / (g.norm_squared() + damping));
        let square = step.norm_squared();
        if square > longest * longest {
            step * (longest / square.sqrt())
        } else {
            step
        }
    }
}

/// Two steps towards the zero set, of which one is made.
#[derive(Clone, Copy, Default)]
pub(super) struct Advance {
    pub step: Vec3,
    /// |F| at the start; 0 where that is a zero already.
    size: f64,
    scale: f64,
}

impl Advance {
    /// Whether there is a second step.
    pub fn goes_on(&self) -> bool {
        self.size > 0.0
    }

    /// Makes the second step.
    pub fn arrive(&mut self, step: Vec3) {
        self.scale = (self.step + step).norm() / self.size;
    }

    /// The distance per field unit, not beyond its limits.
    pub fn scale(&self, patch: &Patch) -> f64 {
        self.scale
            .min(STEEPEST / patch.slope_rms)
            .max(1.0 / patch.slope_sup)
    }
}
