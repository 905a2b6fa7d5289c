//! The rim of a surface: sides of triangles that no neighbour answers.
//!
//! The rim decides how the winding number may change where no surface is: it is a chain of edges,
//! empty exactly when the triangles form a cycle (every side as often forward as backward), and then
//! the winding number is an integer that jumps only at the surface. Otherwise, at distance r,
//! |grad w| is at most the sum of length / (4 pi r^2) over the rim (the law of Biot and Savart), and at most
//! the sum of area / (2 pi r^3) over any triangles with this rim, which are a layer of dipoles.

use super::falloff::Falloff;
use super::sides::Side;
use crate::frame::Vec3;
use std::f64::consts::PI;

/// A change that is as good as none.
const LITTLE: f64 = 0.1;

/// Unanswered sides, with their lengths, and triangles between them, with their areas.
pub(crate) struct Rim {
    sides: Falloff,
    spanning: Falloff,
}

impl Rim {
    /// The rim's sides over merged vertices, and triangles with the same rim; `None` when there are none.
    pub(crate) fn new(vertices: &[Vec3], sides: &[Side], spanning: &[[Vec3; 3]]) -> Option<Self> {
        let at = |v: u32| vertices[v as usize];
        let weighed: Vec<_> = sides
            .iter()
            .map(|s| {
                let (from, to) = (at(s.from), at(s.to));
                ([from, to, to], (from - to).norm() * f64::from(s.times))
            })
            .collect();
        let area = |[a, b, c]: [Vec3; 3]| (b - a).cross(&(c - a)).norm() / 2.0;
        (!weighed.is_empty()).then(|| Self {
            sides: Falloff::new(weighed),
            spanning: Falloff::new(spanning.iter().map(|&t| (t, area(t))).collect()),
        })
    }

    /// How much the winding number may change within `radius` of `centre`, jumps at the surface apart,
    /// plus the error of its approximation; infinite if the rim comes that near, or it is more than 1.
    pub(crate) fn drift(&self, centre: Vec3, radius: f64) -> f64 {
        // A twentieth for what far groups are off.
        const FAR: f64 = 0.05;
        if radius == 0.0 {
            return FAR;
        }
        let (length, area) = (radius / (4.0 * PI), radius / (2.0 * PI));
        let by_sides = length * self.sides.sum(centre, radius, 2, 1.0 / length);
        if by_sides < LITTLE {
            return by_sides + FAR;
        }
        let by_area = area * self.spanning.sum(centre, radius, 3, 1.0 / area);
        by_sides.min(by_area) + FAR
    }
}
