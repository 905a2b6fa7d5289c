//! Euclidean projections onto the closed reference cells.

use crate::frame::{CellPoint, Element, Vec3};

/// Normals of the tet's faces, times the root of 3.
const FACES: [[f64; 3]; 4] = [
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
        Element::Tet => onto_tet(xi),
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

fn onto_pyramid(xi: Vec3) -> Vec3 {
    if Element::Pyramid.face_distance(CellPoint(xi)) <= 0.0 {
        return xi;
    }
    if xi.z <= 0.0 {
        return Vec3::new(xi.x.clamp(-0.5, 0.5), xi.y.clamp(-0.5, 0.5), 0.0);
    }
    // Above the base the nearest point is on a side; by symmetry on that of the greater coordinate
    // (or on the edges of both). In that side's plane it is in the triangle or on an edge.
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

fn onto_tet(xi: Vec3) -> Vec3 {
    // The tet is regular, so its barycentric coordinates are an isometry (up to scale) onto the
    // standard simplex of R^4, whose projection subtracts a common threshold and drops negatives.
    let lambda = FACES.map(|n| (0.5 - Vec3::from(n).dot(&xi)) / 2.0);
    if lambda.iter().all(|&l| l >= 0.0) {
        return xi;
    }
    let mut sorted = lambda;
    sorted.sort_unstable_by(|a, b| b.total_cmp(a));
    let (mut sum, mut threshold) = (0.0, 0.0);
    for (n, &l) in sorted.iter().enumerate() {
        sum += l;
        let t = (sum - 1.0) / (n + 1) as f64;
        if l > t {
            threshold = t;
        }
    }
    FACES
        .iter()
        .zip(lambda)
        .map(|(&n, l)| Vec3::from(n) * (-0.5 * (l - threshold).max(0.0)))
        .sum()
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
