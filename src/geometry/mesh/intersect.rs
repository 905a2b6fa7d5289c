//! Exact self-intersection tests of triangle meshes.
//!
//! Two triangles may share a corner or a side; every other common point is an intersection, contact included.
//! Signs of volumes and areas come from adaptive exact arithmetic (Shewchuk 1997), without tolerances; rounded extents
//! only rule out pairs that are apart beyond doubt.

use crate::frame::Vec3;
use robust::{Coord, Coord3D, orient2d, orient3d};

/// The sign of the volume of the tetrahedron a, b, c, d.
fn orientation3(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> i8 {
    let at = |p: Vec3| Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    };
    sign(orient3d(at(a), at(b), at(c), at(d)))
}

fn sign(x: f64) -> i8 {
    i8::from(x > 0.0) - i8::from(x < 0.0)
}

/// The projection along a coordinate axis, for coplanar figures.
#[derive(Clone, Copy)]
struct AxisProjection(usize);

impl AxisProjection {
    /// A projection in which the triangle has an area; `None` if it has none in space.
    fn of(&[a, b, c]: &[Vec3; 3]) -> Option<Self> {
        let n = (b - a).cross(&(c - a));
        let first = n.iamax();
        [first, (first + 1) % 3, (first + 2) % 3]
            .map(Self)
            .into_iter()
            .find(|projection| projection.orientation(a, b, c) != 0)
    }

    /// The sign of the area of a, b, c in the projection.
    fn orientation(self, a: Vec3, b: Vec3, c: Vec3) -> i8 {
        let at = |p: Vec3| Coord {
            x: p[(self.0 + 1) % 3],
            y: p[(self.0 + 2) % 3],
        };
        sign(orient2d(at(a), at(b), at(c)))
    }

    /// Whether `p`, on the line through a and b, lies between them, the ends included.
    fn between(self, a: Vec3, b: Vec3, p: Vec3) -> bool {
        [(self.0 + 1) % 3, (self.0 + 2) % 3]
            .into_iter()
            .all(|k| a[k].min(b[k]) <= p[k] && p[k] <= a[k].max(b[k]))
    }

    /// Whether two closed segments meet.
    fn segments_meet(self, [a, b]: [Vec3; 2], [c, d]: [Vec3; 2]) -> bool {
        let (sc, sd) = (self.orientation(a, b, c), self.orientation(a, b, d));
        let (sa, sb) = (self.orientation(c, d, a), self.orientation(c, d, b));
        if sc * sd < 0 && sa * sb < 0 {
            return true;
        }
        (sc == 0 && self.between(a, b, c))
            || (sd == 0 && self.between(a, b, d))
            || (sa == 0 && self.between(c, d, a))
            || (sb == 0 && self.between(c, d, b))
    }

    /// Whether the closed triangle contains the point.
    fn contains(self, &[a, b, c]: &[Vec3; 3], p: Vec3) -> bool {
        let s = [
            self.orientation(a, b, p),
            self.orientation(b, c, p),
            self.orientation(c, a, p),
        ];
        s.iter().all(|&x| x >= 0) || s.iter().all(|&x| x <= 0)
    }

    /// Whether a closed segment meets a closed triangle.
    fn intersects(self, [p, q]: [Vec3; 2], t: &[Vec3; 3]) -> bool {
        self.contains(t, p) || (0..3).any(|i| self.segments_meet([p, q], [t[i], t[(i + 1) % 3]]))
    }
}

/// Whether a triangle has exactly zero area.
pub(crate) fn is_degenerate_triangle(t: &[Vec3; 3]) -> bool {
    AxisProjection::of(t).is_none()
}

/// Whether the closed segment meets the closed triangle; `sides` are the sides of the triangle's plane on which its
/// ends lie. Signs are those of [`orientation3`].
fn segment_meets_triangle([p, q]: [Vec3; 2], sides: [i8; 2], t: &[Vec3; 3]) -> bool {
    if sides[0] * sides[1] > 0 {
        return false;
    }
    if sides == [0, 0] {
        return AxisProjection::of(t).is_some_and(|projection| projection.intersects([p, q], t));
    }
    let s = [0, 1, 2].map(|i| orientation3(p, q, t[i], t[(i + 1) % 3]));
    s.iter().all(|&x| x >= 0) || s.iter().all(|&x| x <= 0)
}

/// The extent of a triangle along a direction, in rounded arithmetic: exact signs of thousands of triangles in one
/// plane, or in planes side by side, would take long.
pub(crate) struct Extent {
    origin: Vec3,
    direction: Vec3,
    ends: [f64; 2],
    size: f64,
}

impl Extent {
    fn of(t: &[Vec3; 3], direction: Vec3) -> Self {
        let mut extent = Self {
            origin: t[0],
            direction,
            ends: [0.0; 2],
            size: 0.0,
        };
        (extent.ends, extent.size) = extent.heights(t);
        extent
    }

    /// The extent of a triangle along its normal: next to none.
    pub(crate) fn across(t: &[Vec3; 3]) -> Self {
        Self::of(t, (t[1] - t[0]).cross(&(t[2] - t[0])))
    }

    /// The least and the greatest height of corners, and their greatest coordinate from the origin.
    fn heights(&self, corners: &[Vec3; 3]) -> ([f64; 2], f64) {
        let from_origin = corners.each_ref().map(|p| p - self.origin);
        let [a, b, c] = from_origin.each_ref().map(|p| self.direction.dot(p));
        let [p, q, r] = from_origin.each_ref().map(Vec3::amax);
        ([a.min(b).min(c), a.max(b).max(c)], p.max(q).max(r))
    }

    /// Whether a triangle lies beyond one of the ends beyond doubt, whatever the direction: it does not meet this one.
    pub(crate) fn is_apart(&self, u: &[Vec3; 3]) -> bool {
        let ([low, high], size) = self.heights(u);
        // A height m . (p - origin) has a difference, a product and two sums, each rounded by at most half an
        // epsilon of |m|_1 |p - origin|, or by much less than the least normal number: 4 epsilons for two heights.
        let rounding = 8.0 * f64::EPSILON * self.direction.lp_norm(1) * size.max(self.size)
            + f64::MIN_POSITIVE;
        low - self.ends[1] > rounding || self.ends[0] - high > rounding
    }
}

/// Whether a plane along a side of `t`, at right angles to `t`, separates the triangles beyond doubt.
fn is_apart_across_sides(t: &[Vec3; 3], u: &[Vec3; 3]) -> bool {
    let normal = (t[1] - t[0]).cross(&(t[2] - t[0]));
    (0..3).any(|i| Extent::of(t, (t[(i + 1) % 3] - t[i]).cross(&normal)).is_apart(u))
}

/// The corners of `a` that `b` lacks, and their number; a corner has equal coordinates.
fn unshared(a: &[Vec3; 3], b: &[Vec3; 3]) -> ([usize; 3], usize) {
    let (mut corners, mut count) = ([0; 3], 0);
    for (i, p) in a.iter().enumerate() {
        if !b.contains(p) {
            corners[count] = i;
            count += 1;
        }
    }
    (corners, count)
}

/// Whether triangles with area meet beyond shared corners; corners of equal coordinates are shared.
/// The case is chosen by the number of corners that one lacks of the other: 0 duplicates, 1 a common side, 2 a common
/// corner, 3 none.
pub(crate) fn triangles_meet(t: &[Vec3; 3], u: &[Vec3; 3]) -> bool {
    let rotated = |a: &[Vec3; 3], i: usize| [a[i], a[(i + 1) % 3], a[(i + 2) % 3]];
    let ((ft, of_t), (fu, of_u)) = (unshared(t, u), unshared(u, t));
    match (of_t, of_u) {
        // The same corners: duplicate triangles.
        (0, _) | (_, 0) => true,
        // A common side: they meet only if folded onto each other in one plane.
        (1, _) | (_, 1) => {
            let ([c, a, b], d) = (rotated(t, ft[0]), u[fu[0]]);
            orientation3(a, b, c, d) == 0
                && AxisProjection::of(t).is_some_and(|projection| {
                    projection.orientation(a, b, c) == projection.orientation(a, b, d)
                })
        }
        // A common corner: an intersection reaches the side opposite to it in one of the triangles.
        (2, _) | (_, 2) => {
            let opposite = |a: &[Vec3; 3], f: [usize; 3]| [a[f[0]], a[f[1]]];
            let (of_t, of_u) = (opposite(t, ft), opposite(u, fu));
            let sides = |e: [Vec3; 2], f: &[Vec3; 3]| e.map(|p| orientation3(f[0], f[1], f[2], p));
            segment_meets_triangle(of_u, sides(of_u, t), t)
                || segment_meets_triangle(of_t, sides(of_t, u), u)
        }
        _ if is_apart_across_sides(t, u) || is_apart_across_sides(u, t) => false,
        _ => meet_without_common_corner(t, u),
    }
}

/// Whether triangles with area and without a common corner meet.
fn meet_without_common_corner(t: &[Vec3; 3], u: &[Vec3; 3]) -> bool {
    let of_u = u.map(|p| orientation3(t[0], t[1], t[2], p));
    if of_u == [1; 3] || of_u == [-1; 3] {
        return false;
    }
    let of_t = t.map(|p| orientation3(u[0], u[1], u[2], p));
    if of_t == [1; 3] || of_t == [-1; 3] {
        return false;
    }
    let edge = |i: usize| [i, (i + 1) % 3];
    (0..3).any(|i| {
        let e = edge(i);
        segment_meets_triangle(e.map(|k| u[k]), e.map(|k| of_u[k]), t)
            || segment_meets_triangle(e.map(|k| t[k]), e.map(|k| of_t[k]), u)
        // In one plane, one may lie within the other.
    }) || (of_u == [0; 3]
        && AxisProjection::of(u)
            .is_some_and(|projection| projection.contains(u, t[0]) || projection.contains(t, u[0])))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of small integers touch often, in corners, sides and planes.
    #[test]
    fn triangles_apart_by_rounded_planes_do_not_meet() {
        let mut state = 11u64;
        let mut corner = |size: u64| {
            Vec3::from_fn(|_, _| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                ((state >> 33) % size) as f64
            })
        };
        let (mut apart, mut meeting) = (0, 0);
        for case in 0..60_000 {
            let size = [3, 5, 9][case % 3];
            let [mut t, mut u] = [0, 1].map(|_| [0, 1, 2].map(|_| corner(size)));
            // Every other pair lies in one plane.
            if case % 2 == 0 {
                for p in t.iter_mut().chain(&mut u) {
                    p.z = 0.1 * p.x + 0.7;
                }
            }
            let shares = t.iter().any(|p| u.contains(p));
            if shares || is_degenerate_triangle(&t) || is_degenerate_triangle(&u) {
                continue;
            }
            let meet = meet_without_common_corner(&t, &u);
            meeting += usize::from(meet);
            for is_apart in [
                is_apart_across_sides(&t, &u),
                Extent::across(&t).is_apart(&u),
            ] {
                apart += usize::from(is_apart);
                assert!(!(meet && is_apart), "{t:?} {u:?}");
            }
        }
        assert!(apart > 5000 && meeting > 5000, "{apart} {meeting}");
    }
}
