//! Solids of revolution and the half space, as exact signed distances in world space.
//!
//! Values are distances at every point, inside too. Ends and normals are not checked: a cylinder needs two distinct
//! ends, a half space a unit normal.

use super::primitive::lipschitz_bound;
use super::{Field, Interval};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// A ball swept along a segment.
#[derive(Clone, Copy, Debug)]
pub struct Capsule {
    /// Centres of the ball, world units.
    pub ends: [Vec3; 2],
    /// Radius, world units.
    pub radius: f64,
}

/// A straight cylinder with flat ends.
#[derive(Clone, Copy, Debug)]
pub struct Cylinder {
    /// Centres of the ends, world units; distinct.
    pub ends: [Vec3; 2],
    /// Radius, world units.
    pub radius: f64,
}

/// The points behind a plane.
#[derive(Clone, Copy, Debug)]
pub struct HalfSpace {
    /// A point of the plane, world units.
    pub point: Vec3,
    /// Unit vector that points out of the solid.
    pub normal: Vec3,
}

impl Capsule {
    /// The vector from the nearest point of the axis.
    fn radial_vector(&self, p: WorldPoint) -> Vec3 {
        let [a, b] = self.ends;
        let axis = b - a;
        let square = axis.norm_squared();
        let t = if square > 0.0 {
            ((p.0 - a).dot(&axis) / square).clamp(0.0, 1.0)
        } else {
            0.0
        };
        p.0 - a - axis * t
    }

    /// The bounding box, world units.
    pub fn bounds(&self) -> Aabb {
        Aabb::of(self.ends).dilated(self.radius)
    }
}

impl Field for Capsule {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        self.radial_vector(p).norm() - self.radius
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let radial_vector = self.radial_vector(p);
        let n = radial_vector.norm();
        let gradient = radial_vector.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
        (n - self.radius, gradient)
    }
    fn bound(&self, region: &Aabb) -> Interval {
        lipschitz_bound(self, region)
    }
}

impl Cylinder {
    /// The coordinate along the axis from the centre, the axis, and the vector from the axis.
    fn parts(&self, p: WorldPoint) -> (f64, Vec3, Vec3) {
        let [a, b] = self.ends;
        let axis = (b - a).try_normalize(0.0).unwrap_or_else(Vec3::z);
        let d = p.0 - (a + b) / 2.0;
        let along = d.dot(&axis);
        (along, axis, d - axis * along)
    }

    /// Signed distances to the planes of the ends and to the lateral surface.
    fn excess(&self, along: f64, radial_vector: Vec3) -> [f64; 2] {
        let half = (self.ends[1] - self.ends[0]).norm() / 2.0;
        [along.abs() - half, radial_vector.norm() - self.radius]
    }

    /// The bounding box, world units.
    pub fn bounds(&self) -> Aabb {
        let axis = (self.ends[1] - self.ends[0])
            .try_normalize(0.0)
            .unwrap_or_else(Vec3::z);
        // A disc of unit normal n reaches r sqrt(1 - n_a^2) along axis a.
        let reach = axis.map(|c| (1.0 - c * c).max(0.0).sqrt() * self.radius);
        let around = Aabb::of(self.ends);
        Aabb {
            min: around.min - reach,
            max: around.max + reach,
        }
    }
}

impl Field for Cylinder {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        let (along, _, radial_vector) = self.parts(p);
        let [u, v] = self.excess(along, radial_vector);
        libm::hypot(u.max(0.0), v.max(0.0)) + u.max(v).min(0.0)
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let (along, axis, radial_vector) = self.parts(p);
        let [u, v] = self.excess(along, radial_vector);
        let cap = axis * along.signum();
        let mantle = radial_vector.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
        let gradient = match (u > 0.0, v > 0.0) {
            (true, true) => (cap * u + mantle * v) / libm::hypot(u, v),
            (false, false) if v > u => mantle,
            (false, true) => mantle,
            _ => cap,
        };
        (self.value(p), gradient)
    }
    fn bound(&self, region: &Aabb) -> Interval {
        lipschitz_bound(self, region)
    }
}

impl Field for HalfSpace {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        (p.0 - self.point).dot(&self.normal)
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        (self.value(p), self.normal)
    }
    fn bound(&self, region: &Aabb) -> Interval {
        lipschitz_bound(self, region)
    }
}
