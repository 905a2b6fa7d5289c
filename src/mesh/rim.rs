//! The rim of a surface: sides of triangles that no neighbour answers.
//!
//! The rim decides how the winding number may change where no surface is: it is a chain of edges,
//! empty exactly when the triangles form a cycle (every side as often forward as backward), and then
//! the winding number is an integer that jumps only at the surface. Otherwise
//! |grad w| <= length / (4 pi r^2) at distance r from the rim (the law of Biot and Savart).

use super::soup::Soup;
use crate::frame::Vec3;

/// Unanswered sides, for distances, with their length.
pub(crate) struct Rim {
    sides: Soup,
    length: f64,
}

impl Rim {
    /// The rim of triangles over merged vertices; `None` when it is empty.
    pub(crate) fn new(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Option<Self> {
        let sides = sides(triangles);
        let at = |v: u32| vertices[v as usize];
        let length = sides
            .iter()
            .map(|s| (at(s.from) - at(s.to)).norm() * f64::from(s.times))
            .sum();
        let soup: Vec<_> = sides
            .iter()
            .enumerate()
            .map(|(i, s)| ([at(s.from), at(s.to), at(s.to)], i as u32))
            .collect();
        (!soup.is_empty()).then(|| Self {
            sides: Soup::new(&soup),
            length,
        })
    }

    /// How much the winding number may change within `radius` of `centre`, jumps at the surface apart,
    /// plus the error of its approximation; infinite if the rim comes that near.
    pub(crate) fn drift(&self, centre: Vec3, radius: f64) -> f64 {
        let r = self.sides.closest(centre, None).0.distance - radius;
        if r > 0.0 {
            // A twentieth for what far groups are off.
            self.length * radius / (4.0 * std::f64::consts::PI * r * r) + 0.05
        } else {
            f64::INFINITY
        }
    }
}

/// A side that remains: from one vertex to another, so many times.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Side {
    pub(crate) from: u32,
    pub(crate) to: u32,
    pub(crate) times: u32,
}

/// Sides of triangles minus those answered in the other direction, sorted by vertex numbers.
pub(crate) fn sides(triangles: &[[u32; 3]]) -> Vec<Side> {
    use rayon::prelude::*;
    let mut all: Vec<(u32, u32, bool)> = triangles
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
        .filter(|(a, b)| a != b)
        .map(|(a, b)| (a.min(b), a.max(b), a < b))
        .collect();
    all.par_sort_unstable();
    let mut rest = Vec::new();
    for same in all.chunk_by(|s, t| (s.0, s.1) == (t.0, t.1)) {
        let forward = same.iter().filter(|s| s.2).count() as i64;
        let net = 2 * forward - same.len() as i64;
        let (lo, hi, _) = same[0];
        let (from, to) = if net > 0 { (lo, hi) } else { (hi, lo) };
        if net != 0 {
            rest.push(Side {
                from,
                to,
                times: net.unsigned_abs() as u32,
            });
        }
    }
    rest
}
