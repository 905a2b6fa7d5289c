//! Corrects the shares of tetrahedra below a level for the curvature of the function.
//!
//! A flag is a simplex of the element, divided by a grid into small tetrahedra. The share of a tetrahedron below
//! the level `t` is first that of the linear function with the same corner values, whose surface is a plane section.
//! The volume below `t` of the function itself differs by minus the integral of (function - t) / slope over that
//! section, up to terms of second order in the displacement of the surface; slope is the linear function's. That
//! integral is the mean of function - t over the section, times the derivative of the volume with respect to `t`.
//! The mean is exact for quadratic functions. The error of the corrected share falls with the fourth power of the grid
//! step, not the second.

use super::super::domain::{Flag, SimplexGrid};
use super::layer::share_of_tetrahedron_below;
use druse_geometry::frame::CellPoint;

/// Ordered coordinates 1 >= a >= b >= c >= 0 of a point of a flag, which are affine: see [`Flag::point`]. Means over
/// a section do not change under affine maps.
type Point = [f64; 3];

/// The weighted sum of the corrections of the shares below `t` over the tetrahedra of a layer: those between the
/// coordinates a = i/n and (i + 1)/n of a grid of n = `parts` parts per edge. `values` are the function's values at the
/// grid points of the flag, `function` gives it everywhere; `weight_of` gives the weight of the grid cube with a lowest
/// corner.
pub(super) fn layer_correction(
    i: usize,
    t: f64,
    parts: usize,
    values: &[f64],
    flag: &Flag,
    function: &(impl Fn(CellPoint<3>) -> f64 + Sync),
    weight_of: &impl Fn([usize; 3]) -> f64,
) -> f64 {
    let mut sum = 0.0;
    SimplexGrid::layer(i, |corners| {
        let corner_values = corners.map(|c| values[SimplexGrid::index(c)]);
        let below = corner_values.iter().filter(|v| **v < t).count();
        if below == 0 || below == 4 {
            return;
        }
        let (share, rate) = share_of_tetrahedron_below(corner_values, t);
        let points = corners.map(|c| c.map(|x| x as f64 / parts as f64));
        let polygon = section(&points, &corner_values, t);
        let mean_difference = mean(&polygon, |p| function(flag.point(p)) - t);
        // The corrected share of a tetrahedron stays between 0 and 1. The first corner is the lowest of the cube.
        sum += (-rate * mean_difference).clamp(-share, 1.0 - share) * weight_of(corners[0]);
    });
    sum
}

/// The corners, in cyclic order, of the section of a tetrahedron where the linear function with these corner values
/// equals `t`.
/// The corners may be in any coordinates. The result has 3 or 4 points, and none if the level does not cut.
fn section(points: &[Point; 4], values: &[f64; 4], t: f64) -> Vec<Point> {
    let (below, above): (Vec<usize>, Vec<usize>) = (0..4).partition(|&c| values[c] < t);
    let edge_point = |a: usize, b: usize| -> Point {
        let s = (t - values[a]) / (values[b] - values[a]);
        std::array::from_fn(|x| points[a][x] + (points[b][x] - points[a][x]) * s)
    };
    match (&below[..], &above[..]) {
        ([a, b], [c, d]) => {
            let edges = [(*a, *c), (*a, *d), (*b, *d), (*b, *c)];
            edges.map(|(a, b)| edge_point(a, b)).to_vec()
        }
        ([a], others) | (others, [a]) => others.iter().map(|&b| edge_point(*a, b)).collect(),
        _ => Vec::new(),
    }
}

/// The mean of a function over a convex planar polygon, 0 for one without area, from the edge midpoints of a fan of
/// triangles: exact for quadratic functions.
fn mean(polygon: &[Point], f: impl Fn(Point) -> f64) -> f64 {
    let [first, rest @ ..] = polygon else {
        return 0.0;
    };
    let middle = |a: &Point, b: &Point| std::array::from_fn(|x| f64::midpoint(a[x], b[x]));
    let (mut sum, mut total_weight) = (0.0, 0.0);
    for pair in rest.windows(2) {
        let [b, c] = [&pair[0], &pair[1]];
        let weight = doubled_area(first, b, c);
        if weight > 0.0 {
            let edges = [middle(first, b), middle(b, c), middle(c, first)];
            sum += weight * edges.map(&f).iter().sum::<f64>() / 3.0;
            total_weight += weight;
        }
    }
    if total_weight > 0.0 {
        sum / total_weight
    } else {
        0.0
    }
}

/// Twice the area of a triangle.
fn doubled_area(a: &Point, b: &Point, c: &Point) -> f64 {
    let edge = |p: &Point| nalgebra::Vector3::from_fn(|x, _| p[x] - a[x]);
    edge(b).cross(&edge(c)).norm()
}
