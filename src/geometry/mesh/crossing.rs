//! The exact winding number of a cycle of triangles: signed crossings along a ray.
//!
//! In a cycle every half-edge has an opposite one. The winding number of a point is then the number of times
//! that any ray from the point leaves the surface minus the number of times that it enters. The ray
//! runs along an axis toward the nearest side of the bounding box. Projected along the ray, half-open edges
//! decide whether a triangle contains the point, so that a ray through a side or a corner counts once. Exact
//! predicates decide on which side of the triangle's plane the point lies.

use super::soup::Soup;
use crate::frame::{Aabb, Vec3};
use robust::{Coord, Coord3D, orient2d, orient3d};

/// The winding number of `q`, a point in the bounding box of the soup, which is a cycle.
pub(crate) fn winding(soup: &Soup, bounds: &Aabb, q: Vec3) -> i64 {
    let mut sum = 0;
    cross(soup, bounds, q, |_, crossings| sum += crossings);
    sum
}

/// The winding number of `q` with respect to each part of a soup that its ray crosses; `part` maps triangle
/// numbers to parts. The value is arbitrary for parts that are no cycle.
pub(crate) fn by_part(soup: &Soup, part: &[u32], bounds: &Aabb, q: Vec3) -> Vec<(u32, i64)> {
    let mut sums: Vec<(u32, i64)> = Vec::new();
    cross(soup, bounds, q, |slot, crossings| {
        let part = part[soup.number[slot] as usize];
        match sums.iter_mut().find(|s| s.0 == part) {
            Some(found) => found.1 += crossings,
            None => sums.push((part, crossings)),
        }
    });
    sums
}

/// Visits the slots of the triangles that the ray from `q` to the nearest side of the box crosses, each with its
/// contribution to the winding number: 1 where the ray leaves the surface, -1 where it enters.
fn cross(soup: &Soup, bounds: &Aabb, q: Vec3, mut visit: impl FnMut(usize, i64)) {
    // The nearest side: the shorter the ray, the fewer triangles it meets.
    let (mut axis, mut is_forward, mut nearest) = (0, true, f64::INFINITY);
    for a in 0..3 {
        for (forward, distance) in [(true, bounds.max[a] - q[a]), (false, q[a] - bounds.min[a])] {
            if distance < nearest {
                (axis, is_forward, nearest) = (a, forward, distance);
            }
        }
    }
    let direction = if is_forward { 1.0 } else { -1.0 };
    let mut crossed: Vec<usize> = Vec::new();
    soup.along(q, axis, is_forward, |slot| {
        let t = &soup.corners[slot];
        let crossings = crossings(t, q, axis);
        // The triangle lies ahead of q: its plane's side agrees with its turn seen along the ray. A triangle whose plane
        // contains q counts 0.
        if crossings != 0 && side_of_plane(t, q) * f64::from(crossings) * direction > 0.0 {
            // The boxes of two pieces of a triangle may both meet the ray, which crosses it once.
            if soup.is_cut() {
                if crossed.contains(&slot) {
                    return;
                }
                crossed.push(slot);
            }
            visit(
                slot,
                i64::from(if is_forward { crossings } else { -crossings }),
            );
        }
    });
}

/// The winding number (-1, 0 or 1) of the projected triangle about the projected point, along the axis.
fn crossings(t: &[Vec3; 3], q: Vec3, axis: usize) -> i32 {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let at = |p: Vec3| Coord { x: p[u], y: p[v] };
    let [a, b, c] = *t;
    // Outside the triangle's range no side counts, or one forward and one backward.
    if a[u].max(b[u]).max(c[u]) < q[u] || q[u] < a[u].min(b[u]).min(c[u]) {
        return 0;
    }
    let mut sum = 0;
    for i in 0..3 {
        let (a, b) = (t[i], t[(i + 1) % 3]);
        // Each side runs from its lower to its upper end, so that both its triangles agree exactly.
        let (lo, hi, sign) = if a[v] <= b[v] { (a, b, 1) } else { (b, a, -1) };
        if lo[v] <= q[v] && q[v] < hi[v] && orient2d(at(lo), at(hi), at(q)) > 0.0 {
            sum += sign;
        }
    }
    sum
}

/// Positive where the point lies behind the triangle, on the side from which it appears clockwise.
fn side_of_plane([a, b, c]: &[Vec3; 3], q: Vec3) -> f64 {
    let at = |p: &Vec3| Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    };
    orient3d(at(a), at(b), at(c), at(&q))
}
