//! Which elements matter at a point: its owner, its neighbours, the continuation outside.

use super::patch::{ON_FACE, Patch, Spot};
use super::{Boundary, CHORD, CellField, Component, Distance, TiledSolid};
use crate::frame::{Aabb, Vec3};

/// Elements of one component near a box, by ascending number.
pub(super) struct Near {
    pub patches: Vec<u32>,
    /// The largest of their slope bounds L.
    pub slope_sup: f64,
}

/// Elements near a box, with what one point teaches about the next: never the result, only how soon
/// it is found.
pub(super) struct Local {
    pub near: Near,
    /// Place in `near` of the last point's owner, and its reference coordinates there.
    last: Option<(usize, Vec3)>,
}

/// A point's owner: its place in the list of near elements, and the point as it sees it.
#[derive(Clone, Copy)]
pub(super) struct Owner {
    pub place: usize,
    pub spot: Spot,
}

impl Local {
    pub fn new(near: Near) -> Self {
        Self { near, last: None }
    }
}

impl<C: CellField> TiledSolid<'_, C> {
    /// Blending reaches this far beyond an element's faces: one voxel.
    pub(super) fn delta(&self) -> f64 {
        self.options.voxel_size
    }

    /// How far from a point elements can matter to its distance.
    pub(super) fn margin(&self) -> f64 {
        match self.options.distance {
            Distance::Fast => self.delta(),
            Distance::Exact => self.delta().max(self.options.half_width),
        }
    }

    /// The elements of a component that may be less than `margin` away from a point of `region`.
    pub(super) fn near(&self, component: usize, region: &Aabb, margin: f64) -> Near {
        let mut patches = Vec::new();
        self.scaffold
            .candidates(&region.dilated(margin), &mut patches);
        let (centre, half) = (region.centre().0, region.size() / 2.0);
        patches.retain(|&e| {
            self.component_of[e as usize] as usize == component
                && !self.patches[e as usize].misses(centre, half, margin)
        });
        patches.sort_unstable();
        let slope_sup = patches
            .iter()
            .map(|&e| self.patches[e as usize].slope_sup)
            .fold(0.0, f64::max);
        Near { patches, slope_sup }
    }

    pub(super) fn patch(&self, local: &Local, place: usize) -> &Patch {
        &self.patches[local.near.patches[place] as usize]
    }

    /// Where a point lies in one of the near elements, if it may be less than `margin` outside.
    pub(super) fn spot(&self, local: &Local, place: usize, x: Vec3, margin: f64) -> Option<Spot> {
        self.patch(local, place)
            .spot(self.scaffold, x, margin, None)
    }

    /// The element of lowest number that contains a point.
    pub(super) fn owner(&self, local: &mut Local, x: Vec3) -> Option<Owner> {
        let margin = ON_FACE * x.amax().max(self.options.voxel_size) + ON_FACE * self.delta();
        if let Some((place, start)) = local.last {
            // Well inside one element no other can contain the point.
            let patch = self.patch(local, place);
            if let Some(spot) = patch.spot(self.scaffold, x, 0.0, Some(start)) {
                if spot.beyond < -ON_FACE {
                    local.last = Some((place, spot.xi));
                    return Some(Owner { place, spot });
                }
            }
        }
        for place in 0..local.near.patches.len() {
            if let Some(spot) = self.spot(local, place, x, margin) {
                if spot.beyond <= ON_FACE {
                    local.last = Some((place, spot.xi));
                    return Some(Owner { place, spot });
                }
            }
        }
        None
    }

    /// The distance outside the scaffold, before the boundary has its say: the value at the closest
    /// point. `local` serves if its elements reach that point.
    pub(super) fn continued(&self, component: usize, local: Option<&mut Local>, x: Vec3) -> f64 {
        let Component { boundary, behind } = &self.components[component];
        let closest = boundary.closest(x);
        let Some(behind) = behind.get(closest.triangle as usize) else {
            return self.options.half_width;
        };
        let q = closest.point;
        if let Some(local) = local {
            if local.near.patches.binary_search(behind).is_ok() {
                return self.landed(local, x, q);
            }
        }
        let here = Aabb { min: q, max: q };
        let near = self.near(component, &here, self.margin() + self.delta());
        self.landed(&mut Local::new(near), x, q)
    }

    /// The value outside, at `x`, where `q` is the point of the boundary's triangles closest to it.
    /// On curved faces the triangles run up to the chordal error off the elements: within a
    /// voxel of them the point of evaluation fades into the foot of `x` on the element itself, so
    /// that nothing jumps where the scaffold ends.
    fn landed(&self, local: &mut Local, x: Vec3, q: Vec3) -> f64 {
        let Some((mut at, mut point)) = self.nearest(local, q) else {
            return self.options.half_width;
        };
        let nearness = 1.0 - (x - q).norm() / self.delta();
        let patch = self.patch(local, at.place);
        if nearness > 0.0 && !patch.is_affine() {
            let spot = patch.spot_anyway(self.scaffold, x);
            let foot = patch.point(self.scaffold, patch.clamp(spot.xi));
            if let Some(faded) = self.nearest(local, point + (foot - point) * nearness) {
                (at, point) = faded;
            }
        }
        self.distance(local, at, point)
    }

    /// The point of the near elements that is nearest to `q`, and its owner, where `q` lies on the
    /// elements but for rounding and the chordal error.
    fn nearest(&self, local: &mut Local, q: Vec3) -> Option<(Owner, Vec3)> {
        if let Some(at) = self.owner(local, q) {
            return Some((at, q));
        }
        let mut best: Option<(f64, usize, Spot)> = None;
        for place in 0..local.near.patches.len() {
            let reach = best.as_ref().map_or(f64::INFINITY, |b| b.0);
            let Some(spot) = self.spot(local, place, q, reach) else {
                continue;
            };
            let m = self.patch(local, place).overshoot(q, &spot);
            if m < reach {
                best = Some((m, place, spot));
            }
        }
        let (_, place, spot) = best?;
        let patch = self.patch(local, place);
        let point = patch.point(self.scaffold, patch.clamp(spot.xi));
        let spot = patch.spot_anyway(self.scaffold, point);
        Some((Owner { place, spot }, point))
    }

    /// Signed distance to a component's boundary where it is less than `w`, else minus or plus `w`.
    /// Whether an element `owns` the point tells its side unless it lies within the chordal error.
    pub(super) fn depth(&self, component: usize, x: Vec3, owned: bool) -> f64 {
        let w = self.options.half_width;
        let boundary = &self.components[component].boundary;
        let Some(closest) = boundary.closest_within(x, w) else {
            return if owned { -w } else { w };
        };
        let inside = if closest.distance > 2.0 * CHORD * self.options.voxel_size {
            owned
        } else {
            boundary.contains(x)
        };
        if inside {
            -closest.distance
        } else {
            closest.distance
        }
    }

    /// Whether the scaffold's outer faces end the solid.
    pub(super) fn is_cut(&self) -> bool {
        self.options.boundary == Boundary::Cut
    }
}
