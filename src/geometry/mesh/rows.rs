//! Distances of many points from few triangles, eight points at a time.
//!
//! A triangle lies in a disc of radius r about its centre c in its plane, of normal n. With the height h = n . (p - c)
//! and the distance l = sqrt(|p - c|^2 - h^2) across, its squared distance from p is at least h^2 + max(l - r, 0)^2.
//! Triangles whose bound exceeds the distance known so far are left out; the rest are measured in full, with the bits of
//! the scalar code. The law `lattices_at_fans_are_measured_bit_for_bit` compares both. A search for nearest triangles
//! excludes by the soup's discs, in single precision; `cut_soups_give_what_a_scan_of_all_triangles_gives` compares it.
// Small functions of a hot path: inlining compiles them for the instruction set of their caller. Arithmetic on
// lanes avoids closures, which would not inherit that instruction set.
#![allow(clippy::inline_always)]

use super::sliver::Sliver;
use super::soup::Soup;
use super::triangle::closest_point;
use crate::frame::Vec3;
use crate::simd::{self, Eight, Lanes, Number, SimdKernel, difference, splat_vector};

/// Number of points per row.
pub(super) const ROW: usize = 8;
/// Margins for the rounding of coordinates, relative to the greatest one, and for that of distances.
const COORDINATE_ROUNDING: f64 = 1e-12;
const DISTANCE_MARGIN: f64 = 1.0 + 1e-9;

/// A triangle with lower bounds of its distance: by its plane and by a disc around it.
pub(super) struct Facet<'a> {
    corners: [Vec3; 3],
    /// The unit normal. A triangle without area always comes with its sliver.
    normal: Vec3,
    centre: Vec3,
    /// The radius of the disc about the centre.
    radius: f64,
    sliver: Option<&'a Sliver>,
}

impl<'a> Facet<'a> {
    /// A triangle, with its frame if it is a sliver.
    pub(super) fn new(corners: [Vec3; 3], sliver: Option<&'a Sliver>) -> Self {
        let [a, b, c] = corners;
        let centre = (a + b + c) / 3.0;
        let away = corners.iter().map(|p| (p - centre).norm());
        let normal = match sliver {
            Some(sliver) => sliver.normal(),
            None => (b - a).cross(&(c - a)).normalize(),
        };
        Self {
            corners,
            normal,
            centre,
            radius: away.fold(0.0, f64::max),
            sliver,
        }
    }
}

/// Distances of points from the nearest of some triangles, bit for bit those by [`closest_point`]; infinite
/// without triangles. Consecutive points should be close together for speed.
pub(super) fn distances<'a>(
    facets: impl Iterator<Item = Facet<'a>>,
    points: &[Vec3],
    out: &mut [f64],
) {
    let facets: Vec<Facet> = facets.collect();
    let corners = facets.iter().flat_map(|f| f.corners);
    let coordinates = corners.chain(points.iter().copied());
    let size = coordinates.map(|p| p.amax()).fold(0.0, f64::max);
    simd::run(Distances {
        facets: &facets,
        slack: COORDINATE_ROUNDING * size,
        points,
        out,
    });
}

struct Distances<'a> {
    facets: &'a [Facet<'a>],
    /// Rounding of coordinates, world units.
    slack: f64,
    points: &'a [Vec3],
    out: &'a mut [f64],
}

impl SimdKernel for Distances<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let (margin, slack) = (zero.splat(DISTANCE_MARGIN), zero.splat(self.slack));
        let (shrink, grow) = (
            zero.splat(1.0 - COORDINATE_ROUNDING),
            zero.splat(1.0 + COORDINATE_ROUNDING),
        );
        let mut previous = None;
        for (points, out) in self.points.chunks(ROW).zip(self.out.chunks_mut(ROW)) {
            // The last point pads the last row.
            let mut coordinates = [[0.0; 3]; ROW];
            for (n, point) in coordinates.iter_mut().enumerate() {
                *point = points[n.min(points.len() - 1)].into();
            }
            let p = Eight::points(lanes, coordinates);
            let mut squared = zero.splat(f64::INFINITY);
            // Triangle inequality: the distance is at most that of the corresponding point of the previous row,
            // plus the length of the step from it.
            let mut reach = squared;
            if let Some((q, distance)) = previous {
                reach = length(difference(p, q)) + distance;
            }
            for facet in self.facets {
                // h, and the limit of distances that matter.
                let height = height(facet, p).abs();
                let limit = reach * margin;
                if limit.bits_below(height - slack) == u8::MAX {
                    continue;
                }
                // l - r, rounded down: the squares cancel where the point is above the centre.
                let from_centre = difference(p, splat_vector(zero, facet.centre));
                let across = dot(from_centre, from_centre) * shrink - height * height * grow;
                let across = across.max(zero).sqrt() - zero.splat(facet.radius) - slack;
                let across = across.max(zero);
                let low = (height - slack).max(zero);
                if (limit * limit).bits_below(low * low + across * across) == u8::MAX {
                    continue;
                }
                let from_facet = match facet.sliver {
                    Some(sliver) => {
                        let offset = difference(sliver.closest(p), p);
                        dot(offset, offset)
                    }
                    None => squared_distance(lanes, &facet.corners, p, &coordinates),
                };
                squared = squared.min(from_facet);
                reach = reach.min(squared.sqrt());
            }
            let distance = squared.sqrt();
            previous = Some((p, distance));
            out.copy_from_slice(&distance.row()[..out.len()]);
        }
    }
}

/// A search for the triangles of some slots that are nearest to the points of a row, finite, within a radius. Gives
/// their slots, `u32::MAX` where there is none.
pub(super) struct NearestOfRow<'a> {
    pub soup: &'a Soup,
    pub slots: &'a [u32],
    pub points: [Vec3; ROW],
    /// World units.
    pub radius: f64,
}

impl SimdKernel for NearestOfRow<'_> {
    type Output = [u32; ROW];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Self::Output {
        let local = self.soup.bvh.local();
        let coordinates = self.points.map(<[f64; 3]>::from);
        let p = Eight::points(lanes, coordinates);
        // In the tree's frame, for the discs.
        let mut q = [[0.0; ROW]; 3];
        for (n, point) in self.points.iter().enumerate() {
            let point = local.point(*point);
            for a in 0..3 {
                q[a][n] = point[a] as f32;
            }
        }
        let q = [lanes.load(&q[0]), lanes.load(&q[1]), lanes.load(&q[2])];
        let mut reaches = [local.length(self.radius) as f32; ROW];
        let mut best = Eight::of(lanes, &[self.radius * self.radius; ROW]);
        let mut found = [(u32::MAX, u32::MAX); ROW];
        for &slot in self.slots {
            if self
                .soup
                .disc(slot)
                .bits_beyond(lanes, q, lanes.load(&reaches))
                == u8::MAX
            {
                continue;
            }
            let corners = &self.soup.corners[slot as usize];
            let squared = match self.soup.sliver(slot as usize) {
                Some(sliver) => {
                    let offset = difference(sliver.closest(p), p);
                    dot(offset, offset)
                }
                None => squared_distance(lanes, corners, p, &coordinates),
            };
            let (above, below) = (best.bits_below(squared), squared.bits_below(best));
            if above == u8::MAX {
                continue;
            }
            // Of equally near triangles that of least number, of its parts that of the first slot, as for one point.
            let own = (self.soup.number[slot as usize], slot);
            for (n, found) in found.iter_mut().enumerate() {
                let is_equal = (above | below) >> n & 1 == 0;
                if below >> n & 1 != 0 || is_equal && own < *found {
                    *found = own;
                }
            }
            best = best.min(squared);
            for (reach, distance) in reaches.iter_mut().zip(best.sqrt().row()) {
                *reach = local.length(distance) as f32;
            }
        }
        found.map(|(_, slot)| slot)
    }
}

/// a . b, summed in the order of the scalar code without fused operations, for identical bits.
#[inline(always)]
fn dot<T: Number>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn length<T: Number>(a: [T; 3]) -> T {
    dot(a, a).sqrt()
}

/// The signed height over the plane of a triangle.
#[inline(always)]
fn height<T: Number>(facet: &Facet, p: [T; 3]) -> T {
    let from = difference(p, splat_vector(p[0], facet.corners[0]));
    dot(splat_vector(p[0], facet.normal), from)
}

/// A point of a triangle: corner + side * (s / total) + ac * (t / total).
#[derive(Clone, Copy)]
struct ClosestPoint<T> {
    corner: [T; 3],
    side: [T; 3],
    s: T,
    t: T,
    total: T,
}

impl<T: Number> ClosestPoint<T> {
    /// `self` where `test` is at most 0, otherwise `other`.
    #[inline(always)]
    fn select_unless_positive(self, test: T, other: Self) -> Self {
        let zero = test.splat(0.0);
        let (mut corner, mut side) = (other.corner, other.side);
        for a in 0..3 {
            corner[a] = zero.select_below(test, other.corner[a], self.corner[a]);
            side[a] = zero.select_below(test, other.side[a], self.side[a]);
        }
        Self {
            corner,
            side,
            s: zero.select_below(test, other.s, self.s),
            t: zero.select_below(test, other.t, self.t),
            total: zero.select_below(test, other.total, self.total),
        }
    }
}

/// Squared distances from one triangle: the cases of [`closest_point`] in reverse order. `coordinates` are the points
/// `p` again, for the scalar code.
#[inline(always)]
fn squared_distance<L: Lanes>(
    lanes: L,
    corners: &[Vec3; 3],
    p: [Eight<L>; 3],
    coordinates: &[[f64; 3]; ROW],
) -> Eight<L> {
    let zero = p[0].splat(0.0);
    let one = p[0].splat(1.0);
    let [a, b, c] = [
        splat_vector(zero, corners[0]),
        splat_vector(zero, corners[1]),
        splat_vector(zero, corners[2]),
    ];
    // As in [`closest_point`] (Ericson, section 5.1.5): products of sides and displacements; va, vb, vc are the
    // barycentrics times the area.
    let (ab, ac) = (difference(b, a), difference(c, a));
    let (ap, bp, cp) = (difference(p, a), difference(p, b), difference(p, c));
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    let (ab2, ac2) = (d1 - d3, d2 - d6);
    let vc = d1 * d4 - d3 * d2;
    let vb = d5 * d2 - d1 * d6;
    let va = d3 * d6 - d5 * d4;
    let total = va + vb + vc;
    let (from_b, from_c) = (d4 - d3, d5 - d6);
    // The closest points in each of the seven regions: face, sides, corners.
    let in_face = ClosestPoint {
        corner: a,
        side: ab,
        s: vb,
        t: vc,
        total,
    };
    let on_ab = ClosestPoint {
        s: d1,
        t: zero,
        total: ab2,
        ..in_face
    };
    let on_ac = ClosestPoint {
        side: ac,
        s: d2,
        total: ac2,
        ..on_ab
    };
    let on_bc = ClosestPoint {
        corner: b,
        side: difference(c, b),
        s: from_b,
        total: from_b + from_c,
        ..on_ab
    };
    let at_a = ClosestPoint {
        s: zero,
        total: one,
        ..on_ab
    };
    let at_b = ClosestPoint { corner: b, ..at_a };
    let at_c = ClosestPoint { corner: c, ..at_a };
    // Later selections overrule earlier ones, so that corners come last.
    let closest = on_bc.select_unless_positive(va.max(zero - from_b).max(zero - from_c), in_face);
    let closest = on_ac.select_unless_positive(vb.max(zero - d2).max(d6), closest);
    let closest = on_ab.select_unless_positive(vc.max(zero - d1).max(d3), closest);
    let closest = at_c.select_unless_positive((zero - d6).max(d5 - d6), closest);
    let closest = at_b.select_unless_positive((zero - d3).max(d4 - d3), closest);
    let closest = at_a.select_unless_positive(d1.max(d2), closest);
    let (s, t) = (closest.s / closest.total, closest.t / closest.total);
    let mut offset = p;
    for k in 0..3 {
        offset[k] = closest.corner[k] + closest.side[k] * s + ac[k] * t - p[k];
    }
    let squared = dot(offset, offset);
    // The area vanishes in rounding from very far: the scalar code takes over.
    let is_lost = u8::MAX ^ (zero.splat(1e-12) * ab2 * ac2).bits_below(total);
    if is_lost == 0 {
        return squared;
    }
    let mut row = squared.row();
    for (n, to) in row.iter_mut().enumerate() {
        if is_lost >> n & 1 != 0 {
            let p = Vec3::from(coordinates[n]);
            *to = (closest_point(corners, p) - p).norm_squared();
        }
    }
    Eight::of(lanes, &row)
}
