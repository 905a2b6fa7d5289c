//! The skin of a solid: a layer of given thickness along its surface.

use super::MeshSolid;
use crate::field::{Field, Interval, SampleLattice, ValueLimits};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// The side of the surface on which a skin lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Side {
    /// Inside the solid: max(d, -(d + t)).
    #[default]
    Inside,
    /// Outside the solid: max(-d, d - t).
    Outside,
    /// Half the thickness on either side: |d| - t / 2.
    Both,
}

/// A layer of thickness t along a solid's surface, as a distance field.
///
/// With the solid's signed distance d, the value is |d - c| - t / 2, where c is the signed distance of the
/// layer's mid-surface.
pub struct Skin<'a> {
    solid: &'a MeshSolid,
    centre_distance: f64,
    half_thickness: f64,
}

impl<'a> Skin<'a> {
    /// A skin of this thickness, in world units; zero or negative gives an empty solid.
    pub fn new(solid: &'a MeshSolid, thickness: f64, side: Side) -> Self {
        let half_thickness = thickness / 2.0;
        let centre_distance = match side {
            Side::Inside => -half_thickness,
            Side::Outside => half_thickness,
            Side::Both => 0.0,
        };
        Self {
            solid,
            centre_distance,
            half_thickness,
        }
    }

    fn value_at(&self, d: f64) -> f64 {
        (d - self.centre_distance).abs() - self.half_thickness
    }
}

impl Field for Skin<'_> {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        self.value_at(self.solid.value(p))
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let (d, g) = self.solid.value_and_gradient(p);
        (
            self.value_at(d),
            if d < self.centre_distance { -g } else { g },
        )
    }

    fn bound(&self, region: &Aabb) -> Interval {
        let b = self.solid.bound(region);
        let (lo, hi) = (self.value_at(b.lo), self.value_at(b.hi));
        let contains_centre = b.contains(self.centre_distance);
        Interval::new(
            if contains_centre {
                -self.half_thickness
            } else {
                lo.min(hi)
            },
            lo.max(hi),
        )
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.solid.fill(lattice, out);
        for v in out {
            *v = self.value_at(f64::from(*v)) as f32;
        }
    }

    /// The distance d needs its value only where |d - c| is less than the greatest limit plus t / 2.
    fn fill_within(
        &self,
        lattice: &SampleLattice<WorldPoint>,
        limits: &ValueLimits,
        out: &mut [f32],
    ) -> u64 {
        let Some([_, high]) = limits.hull_of_all() else {
            return 0;
        };
        // Rounding to single precision must not move a distance to the other side of its limit.
        let half = (f64::from(high) + self.half_thickness).max(0.0) * (1.0 + 1e-6);
        let ends = [-half, half].map(|end| (self.centre_distance + end) as f32);
        let limits = ValueLimits::uniform(out.len(), ends);
        let measured = self.solid.fill_within(lattice, &limits, out);
        for v in out {
            *v = self.value_at(f64::from(*v)) as f32;
        }
        measured
    }
}
