//! Euclidean projections onto the closed reference cells.
//!
//! The point of the cell nearest to xi in the Euclidean sense of the cell frame. A point of the cell keeps all its
//! bits; outside, the projection is continuous. The row versions give the same as those of one point.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use druse_geometry::frame::{CellPoint, Element, Vec3};
use druse_geometry::simd::Number;

/// Normals of the tet's faces, times sqrt 3.
const TET_NORMALS: [[f64; 3]; 4] = [
    [1.0, 1.0, 1.0],
    [1.0, -1.0, -1.0],
    [-1.0, 1.0, -1.0],
    [-1.0, -1.0, 1.0],
];

/// The point of the closed reference cell that is nearest to `xi`; planar elements keep z.
pub(super) fn clamp_to_cell(shape: Element, xi: Vec3) -> Vec3 {
    match shape {
        Element::Hex => xi.map(|c| c.clamp(-0.5, 0.5)),
        Element::Quad => Vec3::new(xi.x.clamp(-0.5, 0.5), xi.y.clamp(-0.5, 0.5), xi.z),
        Element::Tet => onto_tet::<f64>(xi.into()).into(),
        Element::Tri => onto_triangle(xi),
        Element::Wedge => {
            let flat = onto_triangle(xi);
            Vec3::new(flat.x, flat.y, xi.z.clamp(-0.5, 0.5))
        }
        Element::Pyramid => onto_pyramid(xi),
        Element::Ball => xi.cap_magnitude(0.5),
    }
}

/// The nearest point of a segment.
fn onto_segment(x: Vec3, a: Vec3, b: Vec3) -> Vec3 {
    let along = b - a;
    a + along * ((x - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0)
}

/// The projection onto the prism over the triangle, z unchanged.
fn onto_triangle(xi: Vec3) -> Vec3 {
    if Element::Tri.face_distance(CellPoint(xi)) <= 0.0 {
        return xi;
    }
    let v = Element::Tri.vertices();
    let flat = Vec3::new(xi.x, xi.y, 0.0);
    let sides = [0, 1, 2].map(|i| onto_segment(flat, v[i], v[(i + 1) % 3]));
    let mut best = sides[0];
    for side in &sides[1..] {
        if (flat - side).norm_squared() < (flat - best).norm_squared() {
            best = *side;
        }
    }
    Vec3::new(best.x, best.y, xi.z)
}

/// The point of the reference pyramid nearest to xi. The base is the unit square at z = 0, the apex at z = 1 / sqrt(2).
fn onto_pyramid(xi: Vec3) -> Vec3 {
    if Element::Pyramid.face_distance(CellPoint(xi)) <= 0.0 {
        return xi;
    }
    if xi.z <= 0.0 {
        return Vec3::new(xi.x.clamp(-0.5, 0.5), xi.y.clamp(-0.5, 0.5), 0.0);
    }
    // Above the base the nearest point is on a side: by symmetry on that of the greater coordinate, or on the
    // edges of both. In that side's plane, 2 x + sqrt(2) z = 1, it is in the triangle or on an edge.
    let swapped = xi.y.abs() > xi.x.abs();
    let x = if swapped {
        Vec3::new(xi.y, xi.x, xi.z)
    } else {
        xi
    };
    let (sx, sy) = (1f64.copysign(x.x), 1f64.copysign(x.y));
    let x = Vec3::new(x.x.abs(), x.y.abs(), x.z);
    let normal = Vec3::new(2.0, 0.0, 2f64.sqrt()) / 6f64.sqrt();
    let foot = x - normal * (normal.dot(&x) - 6f64.sqrt().recip());
    // The width of the pyramid at the height of the foot.
    let h = 1.0 - 2f64.sqrt() * foot.z;
    let inside = foot.z >= 0.0 && h >= 0.0 && foot.y <= h / 2.0;
    let nearest = if inside {
        foot
    } else {
        let apex = Vec3::new(0.0, 0.0, 0.5f64.sqrt());
        let corner = Vec3::new(0.5, 0.5, 0.0);
        let rim = onto_segment(x, corner, Vec3::new(0.5, -0.5, 0.0));
        let slope = onto_segment(x, corner, apex);
        if (x - rim).norm_squared() < (x - slope).norm_squared() {
            rim
        } else {
            slope
        }
    };
    let y = Vec3::new(nearest.x * sx, nearest.y * sy, nearest.z);
    if swapped { Vec3::new(y.y, y.x, y.z) } else { y }
}

/// The nearest point of the tet. Every lane is a point of its own.
#[inline(always)]
fn onto_tet<T: Number>(xi: [T; 3]) -> [T; 3] {
    // The tet is regular, so its barycentric coordinates are an isometry (up to scale) onto the
    // standard simplex of R^4, whose projection subtracts a common threshold and drops negatives.
    let (zero, half) = (xi[0].splat(0.0), xi[0].splat(0.5));
    let mut lambda = tet_sums(xi);
    for l in &mut lambda {
        *l = (half - *l) * half;
    }
    let [a, b, c, d] = lambda;
    let (least, most) = ([a.min(b), c.min(d)], [a.max(b), c.max(d)]);
    let (first, last) = (most[0].max(most[1]), least[0].min(least[1]));
    let middle = [most[0].min(most[1]), least[0].max(least[1])];
    let (second, third) = (middle[0].max(middle[1]), middle[0].min(middle[1]));
    // The threshold is the maximum over the sets of the 1, 2, 3 or 4 greatest coordinates.
    let mut sum = first - first.splat(1.0);
    let mut threshold = sum;
    for (l, share) in [(second, 1.0 / 2.0), (third, 1.0 / 3.0), (last, 1.0 / 4.0)] {
        sum = sum + l;
        threshold = threshold.max(sum * sum.splat(share));
    }
    let mut nearest = [zero; 3];
    for (normal, l) in TET_NORMALS.iter().zip(lambda) {
        let moved = (l - threshold).max(zero);
        for (y, &n) in nearest.iter_mut().zip(normal) {
            *y = moved.fused(moved.splat(-0.5 * n), *y);
        }
    }
    // Points of the tet keep all their bits.
    for (y, x) in nearest.iter_mut().zip(xi) {
        *y = last.select_below(zero, *y, x);
    }
    nearest
}

/// Scalar products with the normals of the tet's faces, times sqrt 3.
#[inline(always)]
fn tet_sums<T: Number>([x, y, z]: [T; 3]) -> [T; 4] {
    let (sum, difference) = (y + z, y - z);
    [
        x + sum,
        x - sum,
        difference - x,
        x.splat(0.0) - x - difference,
    ]
}

#[inline(always)]
fn clamp_to_half<T: Number>(x: T) -> T {
    x.max(x.splat(-0.5)).min(x.splat(0.5))
}

/// As [`clamp_to_cell`], for a row of points.
#[inline(always)]
pub(super) fn clamp_row<T: Number>(shape: Element, xi: [T; 3]) -> [T; 3] {
    match shape {
        Element::Hex => [
            clamp_to_half(xi[0]),
            clamp_to_half(xi[1]),
            clamp_to_half(xi[2]),
        ],
        Element::Quad => [clamp_to_half(xi[0]), clamp_to_half(xi[1]), xi[2]],
        Element::Tet => onto_tet(xi),
        _ => T::map_points(xi, |p| clamp_to_cell(shape, p.into()).into()),
    }
}

/// Largest signed distance to the faces, for a row of points.
#[inline(always)]
pub(super) fn face_distance_row<T: Number>(shape: Element, xi: [T; 3]) -> T {
    let half = xi[0].splat(0.5);
    match shape {
        Element::Hex => xi[0].abs().max(xi[1].abs()).max(xi[2].abs()) - half,
        Element::Tet => {
            let [a, b, c, d] = tet_sums(xi);
            (a.max(b).max(c.max(d)) - half) * half.splat(1.0 / 3f64.sqrt())
        }
        _ => {
            let distance = |p: [f64; 3]| shape.face_distance(CellPoint(p.into()));
            T::map_points(xi, |p| [distance(p), 0.0, 0.0])[0]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clamping_is_the_euclidean_projection() {
        // The projection y of x satisfies (x - y) . (v - y) <= 0 for all vertices v.
        for shape in [Element::Tet, Element::Hex, Element::Wedge, Element::Pyramid] {
            for n in 0..4096u32 {
                let x = Vec3::new(
                    f64::from(n % 16) / 6.0 - 1.25,
                    f64::from(n / 16 % 16) / 6.0 - 1.2,
                    f64::from(n / 256) / 6.0 - 1.15,
                );
                let y = clamp_to_cell(shape, x);
                assert!(shape.face_distance(CellPoint(y)) < 1e-12);
                for v in shape.vertices() {
                    assert!((x - y).dot(&(v - y)) < 1e-12, "{shape:?} {x:?} {y:?}");
                }
            }
        }
    }
}
