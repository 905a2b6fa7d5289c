//! What the volume below a level gains where the function bends between the points of the grid.
//!
//! On a small tetrahedron the volume below `t` is that below a plane. With the function moved from its
//! linear interpolant to itself, the volume changes by minus the integral of (value - t) / slope over
//! that plane section, up to the square of how far the surface moves: the error falls with the
//! fourth power of the grid's step instead of the second. The integral over a section is the derivative of
//! the volume by the level times the mean of value - t there, a mean that is exact for quadratics.

use super::super::domain::{Flag, SimplexGrid};
use super::layer::fraction_below;
use crate::frame::CellPoint;

/// A point of a flag, in ordered coordinates.
type Point = [f64; 3];

/// The sum over the tetrahedra of layer `i` of a grid of `parts` parts of what their shares below `t`
/// gain; `values` are those at the grid's points, `weight` is that of the cubes.
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
        // What is in a tetrahedron cannot be less than nothing or more than all of it.
        // The first corner is the least of the cube.
        sum += (-rate * bend).clamp(-share, 1.0 - share) * weight(corners[0]);
    });
    sum
}

/// The corners, in order around it, of the section of a tetrahedron where a linear function is `t`.
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

/// The mean of a function over a polygon in a plane, by the midpoints of the edges of its triangles.
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
