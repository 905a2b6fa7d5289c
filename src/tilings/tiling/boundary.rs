//! The boundary of the scaffold: signed distance to it, and the cut of the solid at it.
//!
//! The boundary is a triangle mesh within a share of a voxel of the outer faces, so that a point so near may lie on
//! either side of it. Distances D are negative inside the scaffold. Under [`Boundary::Extend`] nothing is cut; D is
//! then needed only to find where the field is continued.

use super::{Boundary, CHORD_TOLERANCE, TiledSolid};
use druse_geometry::field::Interval;
use druse_geometry::frame::{Aabb, Vec3};
use druse_geometry::mesh::{ClosestPoint, MeshSolid};

/// Up to this many triangles are tested one by one. Among more, the tree is faster.
const MAX_LINEAR_SEARCH: usize = 64;

/// What is proved of a region before its points are evaluated.
#[derive(Clone, Copy)]
pub(super) struct RegionFacts<'a> {
    /// The field's distance, not cut at the boundary, if it is the same in the whole region: w or -w.
    pub field_distance: Option<f64>,
    /// Whether the region is so far inside the boundary that the boundary has no effect.
    pub is_deep: bool,
    /// Bound of the distance to the boundary, world units.
    pub max_boundary_distance: f64,
    /// Boundary triangles that include the closest one, if it is within the band.
    pub boundary_triangles: Option<&'a [u32]>,
    /// Distances beyond its ends, world units, need only their side.
    pub wanted: Interval,
}

impl RegionFacts<'_> {
    pub const UNKNOWN: Self = Self {
        field_distance: None,
        is_deep: false,
        max_boundary_distance: f64::INFINITY,
        boundary_triangles: None,
        wanted: Interval::REAL_LINE,
    };

    /// The boundary point nearest to `x`, if it is within `radius`, at most the band's half width. A short list of
    /// triangles is searched one by one, else the whole boundary by its hierarchy: both find the same point.
    #[inline]
    pub fn closest_within(
        &self,
        boundary: &MeshSolid,
        x: Vec3,
        radius: f64,
    ) -> Option<ClosestPoint> {
        match self.short_list() {
            Some(slots) => boundary.closest_among(slots, x, radius),
            None => boundary.closest_within(x, radius),
        }
    }

    /// The boundary triangles, if they are few.
    fn short_list(&self) -> Option<&[u32]> {
        self.boundary_triangles
            .filter(|slots| slots.len() <= MAX_LINEAR_SEARCH)
    }

    /// As [`Self::closest_within`] for several points of the region.
    pub fn closest_within_all(
        &self,
        boundary: &MeshSolid,
        points: &[Vec3],
        radius: f64,
        closest: &mut [Option<ClosestPoint>],
    ) {
        if let Some(slots) = self.short_list() {
            return boundary.closest_among_all(slots, points, radius, closest);
        }
        for (closest, x) in closest.iter_mut().zip(points) {
            *closest = boundary.closest_within(*x, radius);
        }
    }
}

/// A point on a known side of the boundary.
#[derive(Clone, Copy)]
pub(super) struct KnownSide {
    point: Vec3,
    /// No triangle of the boundary that may affect the lattice, or the box around the points, is nearer.
    clearance: f64,
    is_inside: bool,
}

impl KnownSide {
    /// Whether another point of the same box, with its clearance, is on the same side: no triangle passes between two
    /// points that have more clearance together than they are apart. `tolerance` is for rounding.
    fn is_beside(&self, other: Vec3, clearance: f64, tolerance: f64) -> bool {
        (self.point - other).norm() + tolerance < self.clearance + clearance
    }
}

/// Limits of distances as an interval that contains 0, so that a value of the field beyond it has the side of its
/// distance; at most `band`.
pub(super) fn within_band([low, high]: [f32; 2], band: Interval) -> Interval {
    Interval::new(
        f64::from(low).clamp(band.lo, 0.0),
        f64::from(high).clamp(0.0, band.hi),
    )
}

impl TiledSolid<'_> {
    /// Cuts the field's distance `d` at a point of the scaffold with the boundary: max(d, D). Distances are in world
    /// units; `known` states what is proved of the region around `x`.
    pub(super) fn cut_at_boundary(
        &self,
        component: usize,
        d: f64,
        x: Vec3,
        known: RegionFacts,
    ) -> f64 {
        let limit = self.options.half_width.min(known.wanted.hi);
        if known.is_deep || d >= limit || !self.is_cut() {
            return d;
        }
        let slack = self.chord_slack();
        let boundary = &self.components[component].boundary;
        // max(d, D): the boundary matters only where it is nearer than the surface, and than the least wanted distance;
        // 1e-9 is for the rounding of the bound.
        let radius = slack
            .max((-d).min(-known.wanted.lo))
            .min(known.max_boundary_distance * (1.0 + 1e-9));
        match known.closest_within(boundary, x, radius) {
            // On the boundary, outside within the slack, or inside: only the second needs the winding number.
            Some(c) if c.distance < self.boundary_tolerance() => d.max(0.0),
            Some(c) if c.distance < slack && !boundary.contains(x) => d.max(c.distance),
            Some(c) => d.max(-c.distance),
            None => d,
        }
    }

    /// Replaces `boundary_triangles` by those that may affect a box, its band included.
    pub(super) fn find_boundary_triangles(
        &self,
        component: usize,
        region: &Aabb,
        boundary_triangles: &mut Vec<u32>,
    ) {
        let boundary = &self.components[component].boundary;
        boundary.collect(region, self.boundary_reach(), boundary_triangles);
    }

    /// The signed distance to the boundary up to which it has no effect on the wanted distances. Where triangles deviate
    /// from curved faces it has.
    pub(super) fn deep_distance(&self, wanted: Interval) -> f64 {
        wanted.lo.min(-self.chord_slack())
    }

    /// Distance from a box within which the boundary can affect it.
    pub(super) fn boundary_reach(&self) -> f64 {
        self.options.half_width + self.chord_slack()
    }

    /// Whether a point is in a component. A point well inside one of the affine elements `near` is.
    fn component_contains(&self, component: usize, x: Vec3, near: &[u32]) -> bool {
        let margin = self.boundary_tolerance();
        near.iter()
            .any(|&e| self.patches[e as usize].is_deeper_inside(x, margin))
            || self.components[component].boundary.contains(x)
    }

    /// Bounds of the signed distance to a component's boundary over a box, within the bounds `wider` of a box
    /// around it. Distances beyond -w or w are not resolved, except outside where the boundary does not cut.
    /// The boundary triangles, those that may affect a box around `region`, and the elements near it are optional; they
    /// make it faster. `known_side` tells the side of a point of that box, and then that of the centre of `region`.
    pub(super) fn boundary_range(
        &self,
        component: usize,
        region: &Aabb,
        wider: Interval,
        boundary_triangles: Option<&[u32]>,
        near: &[u32],
        known_side: &mut Option<KnownSide>,
    ) -> Interval {
        let boundary = &self.components[component].boundary;
        let (centre, radius) = (region.centre().0, region.half_diagonal());
        let boundary_reach = self.boundary_reach();
        let reach = radius + boundary_reach;
        let facts = RegionFacts {
            boundary_triangles,
            ..RegionFacts::UNKNOWN
        };
        let closest = facts.closest_within(boundary, centre, reach);
        let mut away = closest.map_or(f64::INFINITY, |c| c.distance);
        let clearance = away.min(reach);
        let tolerance = self.boundary_tolerance();
        let known = known_side.filter(|k| k.is_beside(centre, clearance, tolerance));
        let is_inside = wider.hi < 0.0
            || (wider.lo <= 0.0
                && known.map_or_else(
                    || self.component_contains(component, centre, near),
                    |k| k.is_inside,
                ));
        *known_side = Some(KnownSide {
            point: centre,
            clearance,
            is_inside,
        });
        // A continued field needs the distance itself, also where it is beyond the reach.
        if !self.is_cut() && !is_inside && closest.is_none() {
            away = boundary.closest(centre).distance;
        }
        let least = if self.is_cut() || is_inside {
            // Triangles that were not collected are out of reach.
            (away - radius).min(boundary_reach)
        } else {
            away - radius
        };
        if is_inside {
            Interval::new(-away - radius, -least)
        } else {
            Interval::new(least, away + radius)
        }
    }

    /// Points within this distance of the boundary's triangles count as on the boundary, hence outside: rounding
    /// must not split samples in the plane of a face.
    pub(super) fn boundary_tolerance(&self) -> f64 {
        1e-6 * self.options.voxel_size
    }

    /// Beyond this distance from the boundary's triangles, twice their error, a point that has an owner is inside.
    pub(super) fn chord_slack(&self) -> f64 {
        2.0 * CHORD_TOLERANCE * self.options.voxel_size
    }

    /// Whether the scaffold's outer faces end the solid.
    pub(super) fn is_cut(&self) -> bool {
        self.options.boundary == Boundary::Cut
    }
}
