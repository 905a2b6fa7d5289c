//! The elements that contribute at a point: its owner, its neighbours, the continuation outside.

use super::boundary::RegionFacts;
use super::local_map::LocalMap;
use super::patch::{FACE_TOLERANCE, InverseOptions, Patch, Preimage};
use super::{Distance, TiledSolid, TilingOptions};
use druse_geometry::frame::{Aabb, Vec3};
use std::cell::Cell;

/// Distance to the farthest of a sample's 26 neighbours, voxels: sqrt 3, rounded up.
pub(super) const NEIGHBOUR_DISTANCE: f64 = 1.733;
/// Margin beyond the half width, voxels, in which slopes count as near the surface: it covers a block of
/// samples and their neighbours.
const NEAR_SURFACE_VOXELS: f64 = 2.0;

/// Initial capacity of a list of near elements.
const TYPICAL_NEAR_ELEMENTS: usize = 64;

/// Distance from the surface, world units, up to which slopes affect values in the band.
pub(super) fn near_surface_distance(options: TilingOptions) -> f64 {
    options.half_width + NEAR_SURFACE_VOXELS * options.voxel_size
}

/// The elements of one component near a box, by ascending number.
#[derive(Clone, Default)]
pub(super) struct NearElements {
    pub patches: Vec<u32>,
    /// The largest of their slope bounds L near the surface.
    pub slope_sup: f64,
    /// The smallest of these bounds.
    pub slope_sup_min: f64,
    /// The largest slope bound anywhere in the elements.
    slope_sup_anywhere: f64,
}

/// The elements near a box, with the local maps of recent points as starts of Newton's method. They change
/// the cost of a search, and its result within the tolerance of Newton's method.
#[derive(Default)]
pub(super) struct LocalSearch {
    pub near: NearElements,
    /// The owner of the last point.
    last: Option<u32>,
    /// For each near element, if curved, the local map at a recent point.
    local_maps: Vec<Cell<Option<LocalMap>>>,
    /// Whether positions are needed for values in single precision only.
    for_f32: bool,
}

/// The element that owns a point: its index among the near elements, and the point's preimage in it.
#[derive(Clone, Copy)]
pub(super) struct Owner {
    pub near_index: usize,
    pub preimage: Preimage,
}

impl LocalSearch {
    pub fn new(near: NearElements) -> Self {
        let local_maps = vec![Cell::new(None); near.patches.len()];
        Self {
            near,
            local_maps,
            ..Self::default()
        }
    }

    fn store_preimage(&self, near_index: usize, x: Vec3, preimage: &Preimage) {
        self.local_maps[near_index].set(Some(LocalMap::linear(x, preimage)));
    }

    /// The start and the tolerance of Newton's method for a point in an element.
    fn inverse_options(&self, near_index: usize, x: Vec3) -> InverseOptions {
        InverseOptions {
            start: self.local_maps[near_index].get().map(|t| t.estimate(x)),
            for_f32: self.for_f32,
        }
    }
}

impl TiledSolid<'_> {
    /// Distance from an element's faces over which fields are blended: one voxel.
    pub(super) fn delta(&self) -> f64 {
        self.options.voxel_size
    }

    /// Distance from a point within which elements can affect its value.
    pub(super) fn margin(&self) -> f64 {
        match self.options.distance {
            Distance::Fast => self.delta(),
            Distance::Exact => self.delta().max(self.options.half_width),
        }
    }

    /// The elements of a component that may be less than `margin` away from a point of `region`.
    pub(super) fn near(&self, component: usize, region: &Aabb, margin: f64) -> NearElements {
        let mut near = NearElements {
            patches: Vec::with_capacity(TYPICAL_NEAR_ELEMENTS),
            ..NearElements::default()
        };
        self.find_near(component, region, margin, &mut near);
        near
    }

    /// As [`Self::near`], replacing the elements of `near`.
    pub(super) fn find_near(
        &self,
        component: usize,
        region: &Aabb,
        margin: f64,
        near: &mut NearElements,
    ) {
        let patches = &mut near.patches;
        self.scaffold.candidates(&region.dilated(margin), patches);
        let (centre, half) = (region.centre().0, region.size() / 2.0);
        patches.retain(|&e| {
            self.component_of[e as usize] as usize == component
                && !self.patches[e as usize].is_box_outside(centre, half, margin)
        });
        self.find_slopes(near);
    }

    fn find_slopes(&self, near: &mut NearElements) {
        (near.slope_sup, near.slope_sup_anywhere) = (0.0, 0.0);
        near.slope_sup_min = f64::INFINITY;
        for &e in &near.patches {
            let patch = &self.patches[e as usize];
            near.slope_sup = near.slope_sup.max(patch.slope_sup);
            near.slope_sup_min = near.slope_sup_min.min(patch.slope_sup);
            near.slope_sup_anywhere = near.slope_sup_anywhere.max(patch.slope_sup_anywhere);
        }
    }

    /// Bound of the change of |F| over a length within near elements, if |F| <= L w at one end: L bounds the
    /// slope near the surface, and a larger bound holds further away.
    pub(super) fn max_change(&self, near: &NearElements, length: f64) -> f64 {
        // The part of the length that is no longer near the surface.
        let beyond = (length - near_surface_distance(self.options)).max(0.0);
        near.slope_sup * (length - beyond) + near.slope_sup_anywhere * beyond
    }

    /// Replaces `near` by the elements of a wider list that may be near a point of `region`.
    pub(super) fn filter_near(&self, wider: &NearElements, region: &Aabb, near: &mut NearElements) {
        let (centre, half, margin) = (region.centre().0, region.size() / 2.0, self.margin());
        let all = wider.patches.iter().copied();
        let misses = |e: &u32| self.patches[*e as usize].is_box_outside(centre, half, margin);
        near.patches.clear();
        near.patches.extend(all.filter(|e| !misses(e)));
        self.find_slopes(near);
    }

    /// Starts `local` over with the elements of a wider list that may be near a point of `region`, for values in single
    /// precision. Nothing else is kept: earlier points must not affect even the last bits.
    pub(super) fn restrict(&self, wider: &NearElements, region: &Aabb, local: &mut LocalSearch) {
        self.filter_near(wider, region, &mut local.near);
        local.last = None;
        local.for_f32 = true;
        local.local_maps.clear();
        let count = local.near.patches.len();
        local.local_maps.resize(count, Cell::new(None));
    }

    pub(super) fn patch(&self, local: &LocalSearch, near_index: usize) -> &Patch {
        &self.patches[local.near.patches[near_index] as usize]
    }

    /// The preimage of a point in one of the near elements, if it may be less than `margin` outside.
    pub(super) fn preimage(
        &self,
        local: &LocalSearch,
        near_index: usize,
        x: Vec3,
        margin: f64,
    ) -> Option<Preimage> {
        let patch = self.patch(local, near_index);
        if patch.is_affine() {
            return patch.preimage(self.scaffold, x, margin, InverseOptions::default());
        }
        let preimage = patch.preimage(
            self.scaffold,
            x,
            margin,
            local.inverse_options(near_index, x),
        )?;
        local.store_preimage(near_index, x, &preimage);
        Some(preimage)
    }

    /// Bound of the distance by which rounding can move a point out of its element.
    fn rounding(&self, x: Vec3) -> f64 {
        FACE_TOLERANCE * x.amax().max(self.options.voxel_size) + FACE_TOLERANCE * self.delta()
    }

    /// The near element with the lowest number that contains a point; `None` if none does.
    pub(super) fn owner(&self, local: &mut LocalSearch, x: Vec3) -> Option<Owner> {
        let margin = self.rounding(x);
        let near = &local.near.patches;
        let last = local.last.and_then(|n| near.binary_search(&n).ok());
        if let Some(near_index) = last {
            // No other element contains a point well inside this one.
            let patch = self.patch(local, near_index);
            if let Some(preimage) =
                patch.interior_preimage(self.scaffold, x, local.inverse_options(near_index, x))
            {
                if !patch.is_affine() {
                    local.store_preimage(near_index, x, &preimage);
                }
                return Some(Owner {
                    near_index,
                    preimage,
                });
            }
        }
        for near_index in 0..local.near.patches.len() {
            if let Some(preimage) = self.preimage(local, near_index, x, margin)
                && preimage.face_distance <= FACE_TOLERANCE
            {
                local.last = Some(local.near.patches[near_index]);
                return Some(Owner {
                    near_index,
                    preimage,
                });
            }
        }
        None
    }

    /// The value of a component at `x`, cut at its boundary. `local` must hold all elements near `x` and near
    /// the closest points of the boundary. `known` states what holds in a region around `x`.
    pub(super) fn value_at(
        &self,
        component: usize,
        local: &mut LocalSearch,
        x: Vec3,
        known: RegionFacts,
    ) -> f64 {
        let w = self.options.half_width;
        let slack = self.chord_slack();
        let boundary = &self.components[component].boundary;
        // In no element: outside the scaffold, or in a gap that rounding leaves between elements.
        let Some(at) = self.owner(local, x) else {
            if known.is_deep {
                return self.value_in_gap(local, x);
            }
            if !self.is_cut() {
                return self.continuation(local, x, boundary.closest(x).point);
            }
            let radius = w.min(known.max_boundary_distance * (1.0 + 1e-9)); // Rounding.
            return match known.closest_within(boundary, x, radius) {
                Some(c) => {
                    let outside = if c.distance < self.boundary_tolerance() {
                        0.0
                    } else if c.distance < slack && boundary.contains(x) {
                        -c.distance
                    } else {
                        c.distance
                    };
                    let d = known
                        .field_distance
                        .unwrap_or_else(|| self.continuation(local, x, c.point));
                    d.max(outside).min(w)
                }
                None if boundary.contains(x) => self.value_in_gap(local, x),
                None => w,
            };
        };
        let d = known
            .field_distance
            .unwrap_or_else(|| self.distance(local, at, x));
        self.cut_at_boundary(component, d, x, known)
    }

    /// The value at a point that rounding has moved into a gap between elements.
    fn value_in_gap(&self, local: &mut LocalSearch, x: Vec3) -> f64 {
        match self.nearest(local, x) {
            Some((at, point)) => self.distance(local, at, point),
            None => self.options.half_width,
        }
    }

    /// The distance outside the scaffold, not yet cut at the boundary: the value at the closest point `q` on
    /// the boundary's triangles. On curved faces the triangles deviate from the elements by the chordal error.
    /// Within a voxel of them the point of evaluation is therefore blended into the foot of `x` on the element,
    /// so that the value is continuous at the end of the scaffold.
    fn continuation(&self, local: &mut LocalSearch, x: Vec3, q: Vec3) -> f64 {
        let Some((mut at, mut point)) = self.nearest(local, q) else {
            return self.options.half_width;
        };
        let nearness = 1.0 - (x - q).norm() / self.delta();
        let patch = self.patch(local, at.near_index);
        if nearness > 0.0 && !patch.is_affine() {
            let preimage = patch.preimage_or_affine(self.scaffold, x);
            let foot = patch.point(self.scaffold, patch.clamp(preimage.xi));
            if let Some(faded) = self.nearest(local, point + (foot - point) * nearness) {
                (at, point) = faded;
            }
        }
        self.distance(local, at, point)
    }

    /// The point of the near elements nearest to `q`, and its owner, for `q` on the elements up to rounding and
    /// the chordal error.
    pub(super) fn nearest(&self, local: &mut LocalSearch, q: Vec3) -> Option<(Owner, Vec3)> {
        if let Some(at) = self.owner(local, q) {
            return Some((at, q));
        }
        // The element with the least distance m; each one found limits the search in the next.
        let mut best: Option<(f64, usize, Preimage)> = None;
        for near_index in 0..local.near.patches.len() {
            let reach = best.as_ref().map_or(f64::INFINITY, |b| b.0);
            let Some(preimage) = self.preimage(local, near_index, q, reach) else {
                continue;
            };
            let m = preimage.outside_distance;
            if m < reach {
                best = Some((m, near_index, preimage));
            }
        }
        let (_, near_index, preimage) = best?;
        let patch = self.patch(local, near_index);
        let point = patch.point(self.scaffold, patch.clamp(preimage.xi));
        let preimage = patch.preimage_or_affine(self.scaffold, point);
        Some((
            Owner {
                near_index,
                preimage,
            },
            point,
        ))
    }
}
