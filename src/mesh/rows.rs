//! Distances of many points from few triangles, eight points at a time.
// Small functions of a hot path, which must be compiled for the processor that their caller is for;
// arithmetic on lanes stands in no closure, which would not be.
#![allow(clippy::inline_always)]

use super::triangle::closest_point;
use crate::frame::Vec3;
use crate::simd::{self, Eight, Lanes, Number, Work, alike, difference};

/// Points of a row.
const ROW: usize = 8;
/// Room for the rounding of places, relative to the greatest coordinate, and of distances.
const SLACK: f64 = 1e-12;
const MARGIN: f64 = 1.0 + 1e-9;

/// A triangle, and what shows from afar that others are nearer.
struct Facet {
    corners: [Vec3; 3],
    /// Unit normal; zero of a needle.
    normal: Vec3,
    centre: Vec3,
    /// Of a ball about the centre.
    radius: f64,
}

impl Facet {
    fn new(corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners;
        let centre = (a + b + c) / 3.0;
        let normal = (b - a).cross(&(c - a));
        let longest = (b - a).norm_squared().max((c - a).norm_squared());
        let away = corners.iter().map(|p| (p - centre).norm());
        Self {
            corners,
            // That of a needle is not known well enough.
            normal: if normal.norm() > 1e-6 * longest {
                normal.normalize()
            } else {
                Vec3::zeros()
            },
            centre,
            radius: away.fold(0.0, f64::max),
        }
    }
}

/// Distances of points from the nearest of some triangles, to the bit those by [`closest_point`]; infinite
/// if there is none. Points that follow each other are best near each other.
pub(super) fn distances(
    triangles: impl Iterator<Item = [Vec3; 3]>,
    points: &[Vec3],
    out: &mut [f64],
) {
    let facets: Vec<Facet> = triangles.map(Facet::new).collect();
    let corners = facets.iter().flat_map(|f| f.corners);
    let coordinates = corners.chain(points.iter().copied());
    let size = coordinates.map(|p| p.amax()).fold(0.0, f64::max);
    simd::run(Distances {
        facets: &facets,
        slack: SLACK * size,
        points,
        out,
    });
}

struct Distances<'a> {
    facets: &'a [Facet],
    slack: f64,
    points: &'a [Vec3],
    out: &'a mut [f64],
}

impl Work for Distances<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let (margin, slack) = (zero.like(MARGIN), zero.like(self.slack));
        let mut before = None;
        for (points, out) in self.points.chunks(ROW).zip(self.out.chunks_mut(ROW)) {
            let mut places = [[0.0; 3]; ROW];
            for (n, place) in places.iter_mut().enumerate() {
                *place = points[n.min(points.len() - 1)].into();
            }
            let p = Eight::points(lanes, places);
            let mut squared = zero.like(f64::INFINITY);
            // No point is farther than its neighbour of the row before, and the way from there.
            let mut reach = squared;
            if let Some((q, from)) = before {
                reach = length(difference(p, q)) + from;
            }
            for facet in self.facets {
                let away = height(facet, p).abs() - slack;
                let limit = reach * margin;
                if limit.bits_below(away) == u8::MAX {
                    continue;
                }
                let away = length(difference(p, alike(zero, facet.centre)));
                if (limit + zero.like(facet.radius) + slack).bits_below(away) == u8::MAX {
                    continue;
                }
                squared = squared.min(squared_distance(lanes, &facet.corners, p, &places));
                reach = reach.min(squared.sqrt());
            }
            let found = squared.sqrt();
            before = Some((p, found));
            out.copy_from_slice(&found.row()[..out.len()]);
        }
    }
}

/// a . b, summed in the order of the scalar code and never fused: the same bits.
#[inline(always)]
fn dot<T: Number>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn length<T: Number>(a: [T; 3]) -> T {
    dot(a, a).sqrt()
}

/// Over the plane of a triangle.
#[inline(always)]
fn height<T: Number>(facet: &Facet, p: [T; 3]) -> T {
    let from = difference(p, alike(p[0], facet.corners[0]));
    dot(alike(p[0], facet.normal), from)
}

/// A point of a triangle: from a corner along one side, and along `ac`.
#[derive(Clone, Copy)]
struct Foot<T> {
    from: [T; 3],
    along: [T; 3],
    /// The share of `along` is `part / whole`, that of `ac` is `other / whole`.
    part: T,
    whole: T,
    other: T,
}

impl<T: Number> Foot<T> {
    /// This one where `test` is at most 0.
    #[inline(always)]
    fn where_not_above(self, test: T, other: Self) -> Self {
        let zero = test.like(0.0);
        let (mut from, mut along) = (other.from, other.along);
        for a in 0..3 {
            from[a] = zero.below(test, other.from[a], self.from[a]);
            along[a] = zero.below(test, other.along[a], self.along[a]);
        }
        Self {
            from,
            along,
            part: zero.below(test, other.part, self.part),
            whole: zero.below(test, other.whole, self.whole),
            other: zero.below(test, other.other, self.other),
        }
    }
}

/// Squared distances from one triangle: [`closest_point`]'s cases, the last first.
#[inline(always)]
fn squared_distance<L: Lanes>(
    lanes: L,
    corners: &[Vec3; 3],
    p: [Eight<L>; 3],
    places: &[[f64; 3]; ROW],
) -> Eight<L> {
    let zero = p[0].like(0.0);
    let one = p[0].like(1.0);
    let [a, b, c] = [
        alike(zero, corners[0]),
        alike(zero, corners[1]),
        alike(zero, corners[2]),
    ];
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
    let inside = Foot {
        from: a,
        along: ab,
        part: vb,
        whole: total,
        other: vc,
    };
    let on = Foot {
        other: zero,
        ..inside
    };
    let on_bc = Foot {
        from: b,
        along: difference(c, b),
        part: from_b,
        whole: from_b + from_c,
        ..on
    };
    let on_ac = Foot {
        along: ac,
        part: d2,
        whole: ac2,
        ..on
    };
    let on_ab = Foot {
        part: d1,
        whole: ab2,
        ..on
    };
    let at = Foot {
        part: zero,
        whole: one,
        ..on
    };
    let foot = on_bc.where_not_above(va.max(zero - from_b).max(zero - from_c), inside);
    let foot = on_ac.where_not_above(vb.max(zero - d2).max(d6), foot);
    let foot = on_ab.where_not_above(vc.max(zero - d1).max(d3), foot);
    let foot = Foot { from: c, ..at }.where_not_above((zero - d6).max(d5 - d6), foot);
    let foot = Foot { from: b, ..at }.where_not_above((zero - d3).max(d4 - d3), foot);
    let foot = at.where_not_above(d1.max(d2), foot);
    let (along, across) = (foot.part / foot.whole, foot.other / foot.whole);
    let mut off = p;
    for k in 0..3 {
        off[k] = foot.from[k] + foot.along[k] * along + ac[k] * across - p[k];
    }
    let squared = dot(off, off);
    // A needle, whose inside cannot be told.
    let needle = u8::MAX ^ (zero.like(1e-12) * ab2 * ac2).bits_below(total);
    if needle == 0 {
        return squared;
    }
    let mut row = squared.row();
    for (n, to) in row.iter_mut().enumerate() {
        if needle >> n & 1 != 0 {
            let p = Vec3::from(places[n]);
            *to = (closest_point(corners, p) - p).norm_squared();
        }
    }
    Eight::of(lanes, &row)
}
