//! New points of a face as weighted means of old ones.
//!
//! Doo and Sabin's weights: a for the corner itself (its own weight), (1 - a) (3 + 2 cos(2 pi (i - j)/n)) /
//! (3n - 5) for corner j. They chose a = 1/4 + 5/(4n).

use druse_geometry::frame::Vec3;
use std::f64::consts::TAU;

/// Doo and Sabin's own weight of a corner of an `n`-gon.
pub(super) fn doo_sabin(n: usize) -> f64 {
    0.25 + 5.0 / (4.0 * n as f64)
}

/// The own weight of the honeycomb scheme for an `n`-gon: sqrt(1/2) - 1/4 + 5/(4n).
pub(super) fn honeycomb(n: usize) -> f64 {
    0.5f64.sqrt() - 0.5 + doo_sabin(n)
}

/// The weighted means of a polygon's points, one for each, where a point has the weight `own` in its own mean.
pub(super) fn weighted(points: &[Vec3], own: f64) -> Vec<Vec3> {
    let n = points.len();
    // The weights of the other corners sum to 1 - own: sum over j of 3 + 2 cos is 3n - 5 without the corner itself.
    let share = (1.0 - own) / (3 * n - 5) as f64;
    let turn: Vec<(f64, f64)> = (0..n)
        .map(|j| (TAU * j as f64 / n as f64).sin_cos())
        .collect();
    // cos(a - b) = cos a cos b + sin a sin b: three sums serve all corners.
    let sum: Vec3 = points.iter().sum();
    let cosine: Vec3 = points.iter().zip(&turn).map(|(p, t)| p * t.1).sum();
    let sine: Vec3 = points.iter().zip(&turn).map(|(p, t)| p * t.0).sum();
    points
        .iter()
        .zip(&turn)
        .map(|(p, (s, c))| {
            own * p + share * (3.0 * sum + 2.0 * (cosine * *c + sine * *s) - 5.0 * p)
        })
        .collect()
}
