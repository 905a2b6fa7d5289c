//! The winding number of a cycle of triangles, exactly: signed crossings along a ray.
//!
//! Where every side of a triangle is answered in the other direction, the winding number is the number
//! of times that any ray from the point leaves the surface minus the times that it enters. The ray
//! runs along an axis toward the nearest side of the box. In the plane across it a triangle goes round
//! the point by the rule of half-open edges, which counts a ray through a side or a corner once; on
//! which side of the triangle's plane the point lies is decided by exact predicates.

use super::soup::Soup;
use crate::frame::{Aabb, Vec3};
use robust::{Coord, Coord3D, orient2d, orient3d};

/// The winding number of `q`, which lies in the box of the soup, a cycle.
pub(crate) fn winding(soup: &Soup, bounds: &Aabb, q: Vec3) -> i64 {
    let mut sum = 0;
    cross(soup, bounds, q, |_, turns| sum += turns);
    sum
}

/// The winding number of `q` by each part of a soup that its ray meets; `part` tells the part of each
/// triangle by number. Parts that are cycles have their winding number, others an arbitrary one.
pub(crate) fn by_part(soup: &Soup, part: &[u32], bounds: &Aabb, q: Vec3) -> Vec<(u32, i64)> {
    let mut sums: Vec<(u32, i64)> = Vec::new();
    cross(soup, bounds, q, |slot, turns| {
        let part = part[soup.number[slot] as usize];
        match sums.iter_mut().find(|s| s.0 == part) {
            Some(found) => found.1 += turns,
            None => sums.push((part, turns)),
        }
    });
    sums
}

/// Visits the triangles that the ray from `q` to the nearest side of the box crosses, each with what it
/// adds to the winding number.
fn cross(soup: &Soup, bounds: &Aabb, q: Vec3, mut visit: impl FnMut(usize, i64)) {
    let (mut axis, mut ahead, mut least) = (0, true, f64::INFINITY);
    for a in 0..3 {
        for (forward, room) in [(true, bounds.max[a] - q[a]), (false, q[a] - bounds.min[a])] {
            if room < least {
                (axis, ahead, least) = (a, forward, room);
            }
        }
    }
    let direction = if ahead { 1.0 } else { -1.0 };
    soup.bvh.along(q, axis, ahead, |slot| {
        let t = &soup.corners[slot];
        let turns = turns(t, q, axis);
        if turns != 0 && height(t, q) * f64::from(turns) * direction > 0.0 {
            visit(slot, i64::from(if ahead { turns } else { -turns }));
        }
    });
}

/// How often the triangle's shadow along the axis goes round the point's: -1, 0 or 1.
fn turns(t: &[Vec3; 3], q: Vec3, axis: usize) -> i32 {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let at = |p: Vec3| Coord { x: p[u], y: p[v] };
    let [a, b, c] = *t;
    // Beside the triangle no side counts, or one forward and one back.
    if a[u].max(b[u]).max(c[u]) < q[u] || q[u] < a[u].min(b[u]).min(c[u]) {
        return 0;
    }
    let mut sum = 0;
    for i in 0..3 {
        let (a, b) = (t[i], t[(i + 1) % 3]);
        // Each side from its lower to its upper end, so that both its triangles agree exactly.
        let (lo, hi, sign) = if a[v] <= b[v] { (a, b, 1) } else { (b, a, -1) };
        if lo[v] <= q[v] && q[v] < hi[v] && orient2d(at(lo), at(hi), at(q)) > 0.0 {
            sum += sign;
        }
    }
    sum
}

/// Positive where the point lies behind the triangle, on the side from which it winds clockwise.
fn height([a, b, c]: &[Vec3; 3], q: Vec3) -> f64 {
    let at = |p: &Vec3| Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    };
    orient3d(at(a), at(b), at(c), at(&q))
}
