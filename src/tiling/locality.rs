//! Which elements matter at a point: its owner, its neighbours, the continuation outside.

use super::boundary::Known;
use super::local_map::Trail;
use super::patch::{ON_FACE, Patch, Search, Spot, Spots};
use super::{Distance, Filling, TiledSolid, TilingOptions};
use crate::frame::{Aabb, Vec3};
use std::cell::Cell;

/// Distance of the furthest of a sample's neighbours, a hair more, in voxels.
pub(super) const NEIGHBOUR: f64 = 1.733;
/// Voxels beyond the half width within which slopes count as near the surface: across a block of samples,
/// and to their neighbours.
const AROUND: f64 = 2.0;

/// Elements that are near a point, mostly no more than so many.
const FEW: usize = 64;

/// How far from the surface the slopes matter that the band's values depend on, world units.
pub(super) fn near_surface(options: TilingOptions) -> f64 {
    options.half_width + AROUND * options.voxel_size
}

/// Elements of one component near a box, by ascending number.
#[derive(Clone, Default)]
pub(super) struct Near {
    pub patches: Vec<u32>,
    /// The largest of their slope bounds L near the surface.
    pub slope_sup: f64,
    /// The least of these.
    pub slope_least: f64,
    /// The largest over all of them.
    slope_most: f64,
}

impl Near {
    /// Becomes another, in the room that it has.
    fn copy(&mut self, other: &Self) {
        let patches = std::mem::take(&mut self.patches);
        *self = Self { patches, ..*other };
        self.patches.clone_from(&other.patches);
    }
}

/// Elements near a box, with what one point teaches about the next: never the result, only how soon
/// it is found, but for rounding.
#[derive(Default)]
pub(super) struct Local {
    pub near: Near,
    /// The last point's owner.
    last: Option<u32>,
    /// A point near the last ones that each near element placed, if it is curved.
    trails: Vec<Cell<Option<Trail>>>,
    /// Whether points are wanted for values in single precision.
    is_rough: bool,
    /// The last list of elements, and their trails.
    before: (Vec<u32>, Vec<Cell<Option<Trail>>>),
}

/// A point's owner: its place in the list of near elements, and the point as it sees it.
#[derive(Clone, Copy)]
pub(super) struct Owner {
    pub place: usize,
    pub spot: Spot,
}

/// Room for asking many points who owns them.
#[derive(Default)]
pub(super) struct Asking {
    open: Vec<u32>,
    at: Vec<Vec3>,
    found: Spots,
}

impl Local {
    pub fn new(near: Near) -> Self {
        let trails = vec![Cell::new(None); near.patches.len()];
        Self {
            near,
            trails,
            ..Self::default()
        }
    }

    /// Forgets all, for other elements: what is known of those before must not decide even the last bits.
    pub fn start(&mut self, near: &Near) {
        self.near.copy(near);
        self.last = None;
        self.is_rough = false;
        self.trails.clear();
        self.trails.resize(near.patches.len(), Cell::new(None));
    }

    /// The same for none, to be filled by [`TiledSolid::narrow`], for values in single precision.
    pub fn start_rough(&mut self) {
        self.start(&Near::default());
        self.is_rough = true;
    }

    /// What the next point of an element is guessed from.
    fn trail(&self, place: usize, patch: &Patch) -> Trail {
        self.trails[place].get().unwrap_or_else(|| patch.start())
    }

    fn note(&self, place: usize, patch: &Patch, x: Vec3, spot: &Spot) {
        let trail = self.trail(place, patch).moved(x, spot);
        self.trails[place].set(Some(trail));
    }

    /// How an element looks for a point.
    fn search(&self, place: usize, x: Vec3) -> Search {
        Search {
            start: self.trails[place].get().map(|t| t.guess(x)),
            is_rough: self.is_rough,
        }
    }
}

impl<F: Filling> TiledSolid<'_, F> {
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
        let mut near = Near {
            patches: Vec::with_capacity(FEW),
            ..Near::default()
        };
        self.find_near(component, region, margin, &mut near);
        near
    }

    /// The same, in the place of others.
    pub(super) fn find_near(&self, component: usize, region: &Aabb, margin: f64, near: &mut Near) {
        let patches = &mut near.patches;
        self.scaffold.candidates(&region.dilated(margin), patches);
        let (centre, half) = (region.centre().0, region.size() / 2.0);
        patches.retain(|&e| {
            self.component_of[e as usize] as usize == component
                && !self.patches[e as usize].misses(centre, half, margin)
        });
        self.find_slopes(near);
    }

    fn find_slopes(&self, near: &mut Near) {
        (near.slope_sup, near.slope_most) = (0.0, 0.0);
        near.slope_least = f64::INFINITY;
        for &e in &near.patches {
            let patch = &self.patches[e as usize];
            near.slope_sup = near.slope_sup.max(patch.slope_sup);
            near.slope_least = near.slope_least.min(patch.slope_sup);
            near.slope_most = near.slope_most.max(patch.slope_most);
        }
    }

    /// How much |F| changes at most over a length, in near elements, if it starts or ends where |F| <= L w: near
    /// the surface by L, further away by the steepest slope there is.
    pub(super) fn rise(&self, near: &Near, length: f64) -> f64 {
        let beyond = (length - near_surface(self.options)).max(0.0);
        near.slope_sup * (length - beyond) + near.slope_most * beyond
    }

    /// Replaces `near` by what of a wider list may be near a point of `region`.
    pub(super) fn keep_near(&self, wide: &Near, region: &Aabb, near: &mut Near) {
        let (centre, half, margin) = (region.centre().0, region.size() / 2.0, self.margin());
        let all = wide.patches.iter().copied();
        let misses = |e: &u32| self.patches[*e as usize].misses(centre, half, margin);
        near.patches.clear();
        near.patches.extend(all.filter(|e| !misses(e)));
        self.find_slopes(near);
    }

    /// The same for a list that knows more.
    pub(super) fn narrow(&self, wide: &Near, region: &Aabb, local: &mut Local) {
        let Local {
            near,
            trails,
            before,
            ..
        } = local;
        std::mem::swap(&mut near.patches, &mut before.0);
        std::mem::swap(trails, &mut before.1);
        self.keep_near(wide, region, near);
        // What is known of an element holds nearby too.
        let known = |e| before.1[before.0.binary_search(e).ok()?].get();
        trails.clear();
        trails.extend(near.patches.iter().map(|e| Cell::new(known(e))));
    }

    pub(super) fn patch(&self, local: &Local, place: usize) -> &Patch {
        &self.patches[local.near.patches[place] as usize]
    }

    /// Where a point lies in one of the near elements, if it may be less than `margin` outside.
    pub(super) fn spot(&self, local: &Local, place: usize, x: Vec3, margin: f64) -> Option<Spot> {
        let patch = self.patch(local, place);
        if patch.is_affine() {
            return patch.spot(self.scaffold, x, margin, Search::default());
        }
        let spot = patch.spot(self.scaffold, x, margin, local.search(place, x))?;
        local.note(place, patch, x, &spot);
        Some(spot)
    }

    /// Where those of some points lie in one of the near elements that may be less than `margin` outside.
    pub(super) fn spots(
        &self,
        local: &Local,
        place: usize,
        points: (&[Vec3], f64),
        found: &mut Spots,
    ) {
        let patch = self.patch(local, place);
        let mut trail = local.trail(place, patch);
        patch.spots(self.scaffold, points, (&mut trail, local.is_rough), found);
        if !patch.is_affine() {
            local.trails[place].set(Some(trail));
        }
    }

    /// Makes and notes a trail, with second derivatives, from a point as one of the near elements has
    /// placed it.
    pub(super) fn note_trail(&self, local: &Local, place: usize, x: Vec3, spot: &Spot) -> Trail {
        let trail = self.patch(local, place).trail(self.scaffold, x, spot);
        local.trails[place].set(Some(trail));
        trail
    }

    /// The owners of points, into `owners`; as [`Self::owner`] finds them.
    pub(super) fn owners(
        &self,
        local: &mut Local,
        points: &[Vec3],
        asking: &mut Asking,
        owners: &mut Vec<Option<Owner>>,
    ) {
        owners.clear();
        owners.resize(points.len(), None);
        let Asking { open, at, found } = asking;
        open.clear();
        open.extend(0..points.len() as u32);
        at.clear();
        at.extend(points);
        let margin = points.iter().map(|&x| self.rounding(x)).fold(0.0, f64::max);
        let near = &local.near.patches;
        let last = local.last.and_then(|n| near.binary_search(&n).ok());
        // Well inside the last point's owner no other can contain a point.
        let first = last.map(|place| (place, -ON_FACE));
        for (place, most) in first
            .into_iter()
            .chain((0..near.len()).map(|p| (p, ON_FACE)))
        {
            if open.is_empty() {
                break;
            }
            self.spots(local, place, (at, margin), found);
            let mut is_owner = false;
            for (n, &spot) in found.found().filter(|(_, s)| s.beyond <= most) {
                owners[open[n as usize] as usize] = Some(Owner { place, spot });
                is_owner = true;
            }
            if is_owner {
                local.last = Some(local.near.patches[place]);
                open.retain(|&n| owners[n as usize].is_none());
                at.clear();
                at.extend(open.iter().map(|&n| points[n as usize]));
            }
        }
    }

    /// How far outside an element a point of it can lie by rounding.
    fn rounding(&self, x: Vec3) -> f64 {
        ON_FACE * x.amax().max(self.options.voxel_size) + ON_FACE * self.delta()
    }

    /// The element of lowest number that contains a point.
    pub(super) fn owner(&self, local: &mut Local, x: Vec3) -> Option<Owner> {
        let margin = self.rounding(x);
        let near = &local.near.patches;
        let last = local.last.and_then(|n| near.binary_search(&n).ok());
        if let Some(place) = last {
            // Well inside one element no other can contain the point.
            let patch = self.patch(local, place);
            if let Some(spot) = patch.inside(self.scaffold, x, local.search(place, x)) {
                if !patch.is_affine() {
                    local.note(place, patch, x, &spot);
                }
                return Some(Owner { place, spot });
            }
        }
        for place in 0..local.near.patches.len() {
            if let Some(spot) = self.spot(local, place, x, margin)
                && spot.beyond <= ON_FACE
            {
                local.last = Some(local.near.patches[place]);
                return Some(Owner { place, spot });
            }
        }
        None
    }

    /// The component's value at `x`, its boundary included. `local` must hold all elements near `x`
    /// and near the boundary points closest to it.
    ///
    /// Known beforehand may be: the field's own `constant` value near here; that the boundary's
    /// distance cannot show (`is_deep`: more than w inside); a bound of the distance to it.
    pub(super) fn value_at(
        &self,
        component: usize,
        local: &mut Local,
        x: Vec3,
        known: Known,
    ) -> f64 {
        let w = self.options.half_width;
        let slack = self.chord_slack();
        let boundary = &self.components[component].boundary;
        let Some(at) = self.owner(local, x) else {
            if known.is_deep {
                return self.in_a_gap(local, x);
            }
            if !self.is_cut() {
                return self.continued(local, x, boundary.closest(x).point);
            }
            let radius = w.min(known.distance * (1.0 + 1e-9));
            return match known.closest_within(boundary, x, radius) {
                Some(c) => {
                    let outside = if c.distance < self.on_boundary() {
                        0.0
                    } else if c.distance < slack && boundary.contains(x) {
                        -c.distance
                    } else {
                        c.distance
                    };
                    let d = known
                        .constant
                        .unwrap_or_else(|| self.continued(local, x, c.point));
                    d.max(outside).min(w)
                }
                None if boundary.contains(x) => self.in_a_gap(local, x),
                None => w,
            };
        };
        let d = known
            .constant
            .unwrap_or_else(|| self.distance(local, at, x));
        self.cut(component, d, x, known)
    }

    /// The value at a point that rounding has put between two elements.
    fn in_a_gap(&self, local: &mut Local, x: Vec3) -> f64 {
        match self.nearest(local, x) {
            Some((at, point)) => self.distance(local, at, point),
            None => self.options.half_width,
        }
    }

    /// The distance outside the scaffold, before the boundary has its say: the value at the closest
    /// point of the scaffold, `q` on the boundary's triangles. On curved faces these run up to the
    /// chordal error off the elements: within a voxel of them the point of evaluation fades into the
    /// foot of `x` on the element itself, so that nothing jumps where the scaffold ends.
    fn continued(&self, local: &mut Local, x: Vec3, q: Vec3) -> f64 {
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
            let m = spot.overshoot;
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
}
