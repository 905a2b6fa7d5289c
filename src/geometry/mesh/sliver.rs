//! Slivers: triangles much longer than high, measured in a frame of their own.
//!
//! Products of a sliver's sides cancel, so barycentric coordinates lose as many digits as the square of length over
//! height. Instead the longest side becomes the x axis and the height the y axis of a plane. A point's coordinates
//! (x, y) are then as accurate as the coordinates of the point itself. In the plane each side has a unit
//! direction u and a length l. The closest point of a side is its start plus u t with t = u . q, clamped to [0, l],
//! and cross products with u tell whether (x, y) lies in the triangle. Every step is a sum of products of numbers
//! that do not exceed the distance from the corner by unit vectors. So the result is that of a triangle whose corners
//! moved by rounding, whatever its shape.
// Small functions of a hot path: inlining compiles them for the instruction set of their caller.
#![allow(clippy::inline_always)]

use crate::frame::Vec3;
use crate::simd::{Number, difference, splat_vector};

/// A triangle whose height is at most this fraction of its longest side is a sliver.
const MAX_HEIGHT_RATIO: f64 = 0.01;

pub(super) struct Thinness {
    double_area: f64,
    /// The square of the longest side.
    longest_squared: f64,
}

impl Thinness {
    /// That of a triangle, from the magnitude of its area and its longest side; corners in any order.
    pub(super) fn of(&[a, b, c]: &[Vec3; 3]) -> Self {
        let (ab, ac) = (b - a, c - a);
        let longest = ab.norm_squared().max(ac.norm_squared());
        Self {
            double_area: ab.cross(&ac).norm(),
            longest_squared: longest.max((c - b).norm_squared()),
        }
    }

    /// Whether the height is at most this fraction of the longest side; it is without area.
    pub(super) fn has_height_ratio(&self, at_most: f64) -> bool {
        // Twice the area is the longest side times the height.
        self.double_area <= at_most * self.longest_squared
    }

    /// Whether the height is at most `MAX_HEIGHT_RATIO` of the longest side.
    pub(super) fn is_sliver(&self) -> bool {
        self.has_height_ratio(MAX_HEIGHT_RATIO)
    }
}

/// Whether a triangle is a sliver; one without area is.
pub(super) fn is_sliver(t: &[Vec3; 3]) -> bool {
    Thinness::of(t).is_sliver()
}

/// A side in the plane of its sliver.
struct Side {
    /// x of its start, where y = 0.
    start: f64,
    direction: [f64; 2],
    length: f64,
}

impl Side {
    /// The side from (`start`, 0) to the corner (`x`, `y`); without length its direction is zero.
    fn to([x, y]: [f64; 2], start: f64) -> Self {
        let length = (x - start).hypot(y);
        let direction = if length > 0.0 {
            [(x - start) / length, y / length]
        } else {
            [0.0; 2]
        };
        Self {
            start,
            direction,
            length,
        }
    }
}

/// A sliver in its frame.
pub(super) struct Sliver {
    corner: Vec3,
    /// The unit vector of the longest side, from the corner.
    along: Vec3,
    /// The unit vector of the height; zero without height.
    across: Vec3,
    length: f64,
    /// The other sides: from the corner and from the far end of the longest side.
    sides: [Side; 2],
    /// Positive if the sliver has no inside.
    flatness: f64,
}

impl Sliver {
    /// The frame of a triangle: origin at the first corner of its longest side, x along that side, y along the height,
    /// which is positive. The triangle need not be a sliver; one without length or height has zero vectors in their
    /// place.
    pub(super) fn of(t: &[Vec3; 3]) -> Self {
        let squares = [0, 1, 2].map(|i| (t[(i + 1) % 3] - t[i]).norm_squared());
        let longest = (1..3).fold(
            0,
            |best, i| if squares[i] > squares[best] { i } else { best },
        );
        let [a, b, c] = [0, 1, 2].map(|i| t[(longest + i) % 3]);
        let length = (b - a).norm();
        let along = (b - a).try_normalize(0.0).unwrap_or_default();
        let x = along.dot(&(c - a));
        // Twice, since the first remainder of a flat sliver may be rounding along the side.
        let remainder = c - a - along * x;
        let remainder = remainder - along * along.dot(&remainder);
        let height = remainder.norm();
        let across = remainder.try_normalize(0.0).unwrap_or_default();
        // A flat sliver has no inside: `flatness` 1 sends every point to its sides.
        let is_flat = across == Vec3::zeros();
        Self {
            corner: a,
            along,
            across,
            length,
            sides: [Side::to([x, height], 0.0), Side::to([x, height], length)],
            flatness: f64::from(u8::from(is_flat)),
        }
    }

    /// The unit normal; zero without height.
    pub(super) fn normal(&self) -> Vec3 {
        self.along.cross(&self.across)
    }

    /// The point closest to `p`. `p` holds x, y, z; each may be a row of points. The same operations run in every lane,
    /// without branches.
    #[inline(always)]
    pub(super) fn closest<T: Number>(&self, p: [T; 3]) -> [T; 3] {
        let lane = p[0];
        let zero = lane.splat(0.0);
        let corner = splat_vector(lane, self.corner);
        let (along, across) = (
            splat_vector(lane, self.along),
            splat_vector(lane, self.across),
        );
        let from = difference(p, corner);
        let (x, y) = (dot(along, from), dot(across, from));
        // The closest point of the longest side.
        let mut on_sides = [x.max(zero).min(lane.splat(self.length)), zero];
        let gap = x - on_sides[0];
        let mut nearest = gap * gap + y * y;
        let mut outside = (zero - y).max(lane.splat(self.flatness));
        // The inside lies right of the side from the corner and left of the other.
        for (side, sign) in self.sides.iter().zip([1.0, -1.0]) {
            let [u, v] = [lane.splat(side.direction[0]), lane.splat(side.direction[1])];
            let start = lane.splat(side.start);
            let q = x - start;
            let t = (u * q + v * y).max(zero).min(lane.splat(side.length));
            let closest = [u * t, v * t];
            let gap = [q - closest[0], y - closest[1]];
            let squared = gap[0] * gap[0] + gap[1] * gap[1];
            on_sides[0] = squared.select_below(nearest, start + closest[0], on_sides[0]);
            on_sides[1] = squared.select_below(nearest, closest[1], on_sides[1]);
            nearest = squared.min(nearest);
            outside = outside.max(lane.splat(sign) * (u * y - v * q));
        }
        let u = zero.select_below(outside, on_sides[0], x);
        let v = zero.select_below(outside, on_sides[1], y);
        let mut point = corner;
        for a in 0..3 {
            point[a] = corner[a] + along[a] * u + across[a] * v;
        }
        point
    }
}

/// a . b, summed without fused operations, for identical bits in all lanes.
#[inline(always)]
fn dot<T: Number>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::rows;
    use crate::mesh::triangle::closest_point;

    /// A plane of integer points: u, v and n are orthogonal and have the length 3.
    const AXES: [[i64; 3]; 3] = [[1, 2, 2], [2, 1, -2], [2, -2, 1]];

    /// The point u x + v y + n z, by exact arithmetic.
    fn point(at: [i64; 3]) -> Vec3 {
        Vec3::from_fn(|c, _| (0..3).map(|k| AXES[k][c] * at[k]).sum::<i64>() as f64)
    }

    /// The squared distance of a point from a triangle in the plane, by integers up to the last division.
    fn exact_square(t: [[i64; 2]; 3], q: [i64; 2]) -> f64 {
        let minus = |a: [i64; 2], b: [i64; 2]| [0, 1].map(|k| i128::from(a[k] - b[k]));
        let dot = |a: [i128; 2], b: [i128; 2]| a[0] * b[0] + a[1] * b[1];
        let cross = |a: [i128; 2], b: [i128; 2]| a[0] * b[1] - a[1] * b[0];
        let turns = [0, 1, 2].map(|i| cross(minus(t[(i + 1) % 3], t[i]), minus(q, t[i])));
        let has_area = cross(minus(t[1], t[0]), minus(t[2], t[0])) != 0;
        if has_area && (turns.iter().all(|&c| c >= 0) || turns.iter().all(|&c| c <= 0)) {
            return 0.0;
        }
        let to_side = |i: usize| {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            let (ab, aq) = (minus(b, a), minus(q, a));
            let (s, whole) = (dot(ab, aq), dot(ab, ab));
            if s <= 0 {
                dot(aq, aq) as f64
            } else if s >= whole {
                let bq = minus(q, b);
                dot(bq, bq) as f64
            } else {
                let height = cross(ab, aq) as f64;
                height / whole as f64 * height
            }
        };
        (0..3).map(to_side).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn distances_are_exact_for_triangles_of_any_shape() {
        let mut state = 5u64;
        let mut random = || {
            // A linear congruence; the high bits are random.
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        let mut worst = [0f64; 2];
        for case in 0..15_000 {
            let mut draw = |size: i64| (random() % (2 * size as u64 + 1)) as i64 - size;
            // Fans, needles, caps and triangles without area.
            let (long, wide) = (1 << (4 + case % 18), 1 << (case / 18 % 18));
            let a = [draw(1000), draw(1000)];
            let to = [draw(long), draw(long)];
            let quarters = draw(8);
            let b = [a[0] + to[0], a[1] + to[1]];
            let c = [0, 1].map(|k| a[k] + to[k] * quarters / 4 + draw(wide));
            let t = [a, b, c];
            let weights = [draw(4), draw(4), draw(4)];
            let near = [0, 1]
                .map(|k| a[k] + (weights[0] * (b[k] - a[k]) + weights[1] * (c[k] - a[k])) / 8);
            let q = [near[0] + draw(2), near[1] + draw(2)];
            let height = [0, 0, 1, draw(long)][case % 4];
            let right = 3.0 * (exact_square(t, q) + (height * height) as f64).sqrt();
            let corners = t.map(|[x, y]| point([x, y, 0]));
            let p = point([q[0], q[1], height]);
            let distance = (closest_point(&corners, p) - p).norm();
            let size = corners
                .iter()
                .map(|c| (c - p).norm())
                .fold(1000.0, f64::max);
            let kind = usize::from(is_sliver(&corners));
            let error = (distance - right).abs() / size;
            worst[kind] = worst[kind].max(error);
            let mut by_rows = [0.0];
            let sliver = is_sliver(&corners).then(|| Sliver::of(&corners));
            let facet = rows::Facet::new(corners, sliver.as_ref());
            rows::distances([facet].into_iter(), &[p], &mut by_rows);
            assert_eq!(by_rows[0].to_bits(), distance.to_bits());
        }
        assert!(worst[0] < 1e-12 && worst[1] < 1e-15, "{worst:?}");
    }
}
