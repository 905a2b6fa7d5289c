//! Curvature correction of the volume below a level.
//!
//! On a small tetrahedron the volume below `t` is taken as that of a linear function, whose level set is
//! a plane section. The volume of the true function differs by minus the integral of (value - t) / slope
//! over that section, up to the square of the displacement of the surface. With this correction the error
//! falls with the fourth power of the grid step instead of the second. The integral over a section is the
//! derivative of the volume with respect to the level times the mean of value - t there, a mean that is
//! exact for quadratics.

use super::super::domain::{Flag, SimplexGrid};
use super::layer::fraction_below;
use crate::frame::CellPoint;

/// A point of a flag, in ordered coordinates.
type Point = [f64; 3];

/// The correction summed over the tetrahedra of layer `i` of a grid of `parts` parts; `values` are the
/// function's values at the grid points, `weight` gives the weight of each cube.
pub(super) fn layer(
    i: usize,
    t: f64,
    (parts, values, flag): (usize, &[f64], &Flag),
    value: &(impl Fn(CellPoint<3>) -> f64 + Sync),
    weight: &impl Fn([usize; 3]) -> f64,
) -> f64 {
    let mut sum = 0.0;
    SimplexGrid::layer(i, |corners| {
        let v = corners.map(|c| values[SimplexGrid::index(c)]);
        let below = v.iter().filter(|v| **v < t).count();
        if below == 0 || below == 4 {
            return;
        }
        let (share, rate) = fraction_below(v, t);
        let points = corners.map(|c| c.map(|x| x as f64 / parts as f64));
        let bend = mean(&section(&points, &v, t), |p| value(flag.point(p)) - t);
        // The corrected share of a tetrahedron stays between 0 and 1. The first corner is the lowest of the
        // cube.
        sum += (-rate * bend).clamp(-share, 1.0 - share) * weight(corners[0]);
    });
    sum
}

/// The corners, in cyclic order, of the section of a tetrahedron where a linear function equals `t`.
fn section(points: &[Point; 4], v: &[f64; 4], t: f64) -> Vec<Point> {
    let (below, above): (Vec<usize>, Vec<usize>) = (0..4).partition(|&c| v[c] < t);
    let cut = |a: usize, b: usize| -> Point {
        let s = (t - v[a]) / (v[b] - v[a]);
        std::array::from_fn(|x| points[a][x] + (points[b][x] - points[a][x]) * s)
    };
    match (&below[..], &above[..]) {
        ([a, b], [c, d]) => vec![cut(*a, *c), cut(*a, *d), cut(*b, *d), cut(*b, *c)],
        ([a], rest) | (rest, [a]) => rest.iter().map(|&b| cut(*a, b)).collect(),
        _ => Vec::new(),
    }
}

/// The mean of a function over a planar polygon, from the edge midpoints of a triangle fan.
fn mean(polygon: &[Point], f: impl Fn(Point) -> f64) -> f64 {
    let [first, rest @ ..] = polygon else {
        return 0.0;
    };
    let middle = |a: &Point, b: &Point| std::array::from_fn(|x| f64::midpoint(a[x], b[x]));
    let (mut sum, mut area) = (0.0, 0.0);
    for pair in rest.windows(2) {
        let [b, c] = [&pair[0], &pair[1]];
        let own = doubled_area(first, b, c);
        if own > 0.0 {
            let edges = [middle(first, b), middle(b, c), middle(c, first)];
            sum += own * edges.map(&f).iter().sum::<f64>() / 3.0;
            area += own;
        }
    }
    if area > 0.0 { sum / area } else { 0.0 }
}

/// Twice the area of a triangle.
fn doubled_area(a: &Point, b: &Point, c: &Point) -> f64 {
    let edge = |p: &Point| nalgebra::Vector3::from_fn(|x, _| p[x] - a[x]);
    edge(b).cross(&edge(c)).norm()
}
