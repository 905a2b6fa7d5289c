//! The skin of a solid: what lies within a thickness of its surface.

use super::MeshSolid;
use crate::field::{Field, Interval, SampleLattice};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// On which side of the surface a skin lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Side {
    /// Within the solid, down to the thickness: max(d, -(d + t)).
    #[default]
    Inside,
    /// Outside the solid, up to the thickness: max(-d, d - t).
    Outside,
    /// Half the thickness on either side: |d| - t / 2.
    Both,
}

/// A shell of full thickness `t` along a solid's surface, as a distance field.
///
/// With d the solid's signed distance, its value is |d - c| - t / 2, c the depth of its middle.
pub struct Skin<'a> {
    solid: &'a MeshSolid,
    middle: f64,
    half: f64,
}

impl<'a> Skin<'a> {
    /// A skin of this full thickness, in world units; not positive means no skin at all.
    pub fn new(solid: &'a MeshSolid, thickness: f64, side: Side) -> Self {
        let half = thickness / 2.0;
        let middle = match side {
            Side::Inside => -half,
            Side::Outside => half,
            Side::Both => 0.0,
        };
        Self {
            solid,
            middle,
            half,
        }
    }

    fn of(&self, d: f64) -> f64 {
        (d - self.middle).abs() - self.half
    }
}

impl Field for Skin<'_> {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        self.of(self.solid.value(p))
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let (d, g) = self.solid.value_and_gradient(p);
        (self.of(d), if d < self.middle { -g } else { g })
    }

    fn bound(&self, region: &Aabb) -> Interval {
        let b = self.solid.bound(region);
        let (lo, hi) = (self.of(b.lo), self.of(b.hi));
        let holds_middle = b.contains(self.middle);
        Interval::new(
            if holds_middle { -self.half } else { lo.min(hi) },
            lo.max(hi),
        )
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.solid.fill(lattice, out);
        for v in out {
            *v = self.of(f64::from(*v)) as f32;
        }
    }
}
