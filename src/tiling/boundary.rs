//! The boundary of the scaffold: where it ends what fills the elements.

use super::{Boundary, CHORD, Filling, TiledSolid};
use crate::field::Interval;
use crate::frame::{Aabb, Vec3};
use crate::mesh::{Closest, MeshSolid};

/// So many triangles are tried one by one; among more the tree finds the closest sooner.
const FEW: usize = 64;

/// What is known of a point before it is looked at; see [`TiledSolid::value_at`].
#[derive(Clone, Copy)]
pub(super) struct Known<'a> {
    pub constant: Option<f64>,
    pub is_deep: bool,
    pub distance: f64,
    /// Triangles of the boundary among which the closest one is, if it is within the band.
    pub shore: Option<&'a [u32]>,
}

impl Known<'_> {
    pub const NOTHING: Self = Self {
        constant: None,
        is_deep: false,
        distance: f64::INFINITY,
        shore: None,
    };

    /// The point of the boundary nearest to `x`, if it is not farther than `radius`, at most the band's half
    /// width.
    #[inline]
    pub fn closest_within(&self, boundary: &MeshSolid, x: Vec3, radius: f64) -> Option<Closest> {
        match self.shore {
            Some(slots) if slots.len() <= FEW => boundary.closest_among(slots, x, radius),
            _ => boundary.closest_within(x, radius),
        }
    }
}

impl<F: Filling> TiledSolid<'_, F> {
    /// The distance `d` of the field at a point of the scaffold, the boundary regarded.
    pub(super) fn cut(&self, component: usize, d: f64, x: Vec3, known: Known) -> f64 {
        if known.is_deep || d >= self.options.half_width || !self.is_cut() {
            return d;
        }
        let slack = self.chord_slack();
        let boundary = &self.components[component].boundary;
        // The boundary shows only where it is nearer than the surface.
        match known.closest_within(
            boundary,
            x,
            slack.max(-d).min(known.distance * (1.0 + 1e-9)),
        ) {
            Some(c) if c.distance < self.on_boundary() => d.max(0.0),
            Some(c) if c.distance < slack && !boundary.contains(x) => d.max(c.distance),
            Some(c) => d.max(-c.distance),
            None => d,
        }
    }

    /// Replaces `shore` by the triangles of the boundary that may show in a box, its band included.
    pub(super) fn find_shore(&self, component: usize, region: &Aabb, shore: &mut Vec<u32>) {
        let boundary = &self.components[component].boundary;
        boundary.collect(region, self.sight(), shore);
    }

    /// How far from a box the boundary can matter to it.
    pub(super) fn sight(&self) -> f64 {
        self.options.half_width + self.chord_slack()
    }

    /// Whether a point lies in a component: certainly where it is well inside one of some straight
    /// elements of it.
    fn holds(&self, component: usize, x: Vec3, near: &[u32]) -> bool {
        let margin = self.on_boundary();
        near.iter()
            .any(|&e| self.patches[e as usize].is_under(x, margin))
            || self.components[component].boundary.contains(x)
    }

    /// Bounds of the signed distance to a component's boundary over a box, within those of a wider one.
    /// What lies beyond -w or w is not told apart, except outside where the boundary does not cut. Sooner
    /// found where the shore of a box around, or elements near it, are known.
    pub(super) fn boundary_range(
        &self,
        component: usize,
        region: &Aabb,
        wider: Interval,
        (shore, near): (Option<&[u32]>, &[u32]),
    ) -> Interval {
        let boundary = &self.components[component].boundary;
        let (centre, radius) = (region.centre().0, region.half_diagonal());
        let sight = self.sight();
        let inside = wider.hi < 0.0 || (wider.lo <= 0.0 && self.holds(component, centre, near));
        let closest = match shore {
            _ if !self.is_cut() && !inside => Some(boundary.closest(centre)),
            Some(slots) if slots.len() <= FEW => {
                boundary.closest_among(slots, centre, radius + sight)
            }
            _ => boundary.closest_within(centre, radius + sight),
        };
        let away = closest.map_or(f64::INFINITY, |c| c.distance);
        let least = if self.is_cut() || inside {
            // What is not on the shore is out of sight.
            (away - radius).min(sight)
        } else {
            away - radius
        };
        if inside {
            Interval::new(-away - radius, -least)
        } else {
            Interval::new(least, away + radius)
        }
    }

    /// Nearer than this to the boundary's triangles a point lies on them, which is outside: samples
    /// in the plane of a face must not be told apart by rounding.
    pub(super) fn on_boundary(&self) -> f64 {
        1e-6 * self.options.voxel_size
    }

    /// Further than this from the boundary's triangles an owner means inside.
    pub(super) fn chord_slack(&self) -> f64 {
        2.0 * CHORD * self.options.voxel_size
    }

    /// Whether the scaffold's outer faces end the solid.
    pub(super) fn is_cut(&self) -> bool {
        self.options.boundary == Boundary::Cut
    }
}
