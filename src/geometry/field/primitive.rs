//! Primitive solids as exact signed distances in world space.
//!
//! Values are distances at every point, inside too. A bound follows from the value at the middle of a box, since a
//! distance changes by at most the length of a step. Sizes are not checked: a negative radius is an empty solid.

use super::{Field, Interval};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// A ball.
#[derive(Clone, Copy, Debug)]
pub struct Sphere {
    /// Centre, world units.
    pub centre: Vec3,
    /// Radius, world units.
    pub radius: f64,
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub struct BoxSolid(pub Aabb);

/// The bound of a field with Lipschitz constant 1: the value at the centre, +- half the diagonal.
pub(super) fn lipschitz_bound(field: &impl Field<Point = WorldPoint>, region: &Aabb) -> Interval {
    let (v, r) = (field.value(region.centre()), region.half_diagonal());
    Interval::new(v - r, v + r)
}

impl Field for Sphere {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        (p.0 - self.centre).norm() - self.radius
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let d = p.0 - self.centre;
        let n = d.norm();
        (n - self.radius, if n > 0.0 { d / n } else { Vec3::zeros() })
    }
    fn bound(&self, region: &Aabb) -> Interval {
        lipschitz_bound(self, region)
    }
}

impl Field for BoxSolid {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        let q = (p.0 - self.0.centre().0).abs() - self.0.size() / 2.0;
        q.sup(&Vec3::zeros()).norm() + q.max().min(0.0)
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let d = p.0 - self.0.centre().0;
        let q = d.abs() - self.0.size() / 2.0;
        let outside = q.sup(&Vec3::zeros());
        let n = outside.norm();
        let g = if n > 0.0 {
            outside / n
        } else {
            Vec3::ith(q.imax(), 1.0)
        };
        (
            n + q.max().min(0.0),
            g.component_mul(&d.map(|c| if c < 0.0 { -1.0 } else { 1.0 })),
        )
    }
    fn bound(&self, region: &Aabb) -> Interval {
        lipschitz_bound(self, region)
    }
}
