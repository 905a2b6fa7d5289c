//! A triangle soup with its bounding-volume hierarchy, for distances and winding numbers.

use super::bvh::{Bvh, LocalFrame};
use super::sliver::{Sliver, is_sliver};
use super::triangle::closest_point_of_regular;
use crate::frame::{Aabb, Vec3};
use std::sync::OnceLock;

/// The point of a surface nearest to a query point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestPoint {
    /// The distance, not negative; infinite if there is no triangle.
    pub distance: f64,
    /// The point on the surface.
    pub point: Vec3,
    /// The number of a triangle that contains the point, the least one among the tested triangles at the
    /// same distance; `u32::MAX` if there is none.
    pub triangle: u32,
}

impl ClosestPoint {
    pub(crate) const NOT_FOUND: Self = Self {
        distance: f64::INFINITY,
        point: Vec3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        triangle: u32::MAX,
    };
}

/// A disc that contains a triangle in its plane, in the tree's local frame: it bounds the distance much
/// tighter than a box for points far along the normal.
#[derive(Clone, Copy)]
struct Disc {
    centre: [f32; 3],
    /// The unit normal; zero turns the disc into a ball.
    normal: [f32; 3],
    radius: f32,
    /// The number of the sliver's frame; `u32::MAX` for other triangles.
    sliver: u32,
}

impl Disc {
    fn around(t: &[Vec3; 3], local: LocalFrame) -> Self {
        let [a, b, c] = t.map(|p| local.point(p));
        let centre = (a + b + c) / 3.0;
        let radius = [a, b, c]
            .iter()
            .map(|p| (p - centre).norm())
            .fold(0.0, f64::max);
        let n = (b - a).cross(&(c - a));
        // The normal of a needle is too inaccurate.
        let normal = if n.norm() > 1e-6 * radius * radius {
            n.normalize()
        } else {
            Vec3::zeros()
        };
        Self {
            centre: [centre.x as f32, centre.y as f32, centre.z as f32],
            normal: [normal.x as f32, normal.y as f32, normal.z as f32],
            radius: radius as f32,
            sliver: u32::MAX,
        }
    }

    /// Whether the whole disc is farther from `p` than `max_distance`, despite rounding.
    fn is_beyond(&self, p: [f32; 3], max_distance: f32) -> bool {
        let mut d2 = 0.0;
        let mut height = 0.0;
        for a in 0..3 {
            let d = p[a] - self.centre[a];
            d2 += d * d;
            height += d * self.normal[a];
        }
        // The terms cover the relative rounding of distances, the rounding of the normal over the disc, and
        // the absolute rounding of coordinates in [-1, 1].
        let max_distance = max_distance * (1.0 + 4e-6) + 1e-6 * self.radius + 6e-7;
        let remaining2 = max_distance * max_distance - height * height;
        // sqrt(d2 - height^2) > radius + sqrt(remaining2), without roots where possible.
        let across2 = d2 - height * height;
        remaining2 < 0.0 || {
            let limit = self.radius + remaining2.sqrt();
            across2 > limit * limit
        }
    }
}

/// Number of discs in a pack.
pub(super) const PACK_SIZE: usize = 8;

/// The discs of [`PACK_SIZE`] consecutive slots as a structure of arrays; the last disc pads the last pack.
#[derive(Clone)]
pub(super) struct DiscPack {
    pub(super) centre: [[f32; PACK_SIZE]; 3],
    pub(super) normal: [[f32; PACK_SIZE]; 3],
    pub(super) radius: [f32; PACK_SIZE],
}

impl DiscPack {
    fn of(discs: &[Disc]) -> Self {
        let at = |n: usize| &discs[n.min(discs.len() - 1)];
        Self {
            centre: std::array::from_fn(|a| std::array::from_fn(|n| at(n).centre[a])),
            normal: std::array::from_fn(|a| std::array::from_fn(|n| at(n).normal[a])),
            radius: std::array::from_fn(|n| at(n).radius),
        }
    }
}

/// Triangles without connectivity, sorted into the slots of a hierarchy.
pub(crate) struct Soup {
    pub(crate) bvh: Bvh,
    pub(crate) corners: Vec<[Vec3; 3]>,
    /// The caller's number of the triangle in each slot.
    pub(crate) number: Vec<u32>,
    discs: Vec<Disc>,
    slivers: Vec<Sliver>,
    packs: OnceLock<Vec<DiscPack>>,
}

impl Soup {
    /// A soup of numbered triangles.
    pub(crate) fn new(triangles: &[([Vec3; 3], u32)]) -> Self {
        let bvh = Bvh::new(triangles.len(), |i| Aabb::of(triangles[i].0));
        let at = |slot: &u32| triangles[*slot as usize];
        let corners: Vec<_> = bvh.order().iter().map(|s| at(s).0).collect();
        let mut slivers = Vec::new();
        let disc = |t: &[Vec3; 3]| {
            let mut disc = Disc::around(t, bvh.local());
            if is_sliver(t) {
                disc.sliver = slivers.len() as u32;
                slivers.push(Sliver::of(t));
            }
            disc
        };
        let discs = corners.iter().map(disc).collect();
        Self {
            discs,
            slivers,
            corners,
            number: bvh.order().iter().map(|s| at(s).1).collect(),
            packs: OnceLock::new(),
            bvh,
        }
    }

    /// The point of the triangle in a slot closest to `p`.
    #[inline]
    #[doc(hidden)]
    pub fn closest_point(&self, slot: usize, p: Vec3) -> Vec3 {
        match self.slivers.get(self.discs[slot].sliver as usize) {
            Some(sliver) => sliver.closest::<f64>(p.into()).into(),
            None => closest_point_of_regular(&self.corners[slot], p),
        }
    }

    /// The discs by pack: slot n is in pack n / [`PACK_SIZE`].
    pub(super) fn packs(&self) -> &[DiscPack] {
        self.packs
            .get_or_init(|| self.discs.chunks(PACK_SIZE).map(DiscPack::of).collect())
    }

    /// Replaces `found` by the sorted packs of all triangles that may be nearer than `max_distance` to a box.
    pub(super) fn collect_packs(&self, region: &Aabb, max_distance: f64, found: &mut Vec<u32>) {
        found.clear();
        self.bvh.overlapping(&region.dilated(max_distance), |slot| {
            let pack = (slot / PACK_SIZE) as u32;
            if found.last() != Some(&pack) {
                found.push(pack);
            }
            true
        });
        found.sort_unstable();
        found.dedup();
    }

    /// The closest point and its slot. A `hint`, a slot with a near triangle, speeds up the search.
    pub(crate) fn closest(&self, p: Vec3, hint: Option<usize>) -> (ClosestPoint, usize) {
        self.closest_within(p, f64::INFINITY, hint)
    }

    /// The closest point and its slot, if within `radius`.
    pub(crate) fn closest_within(
        &self,
        p: Vec3,
        radius: f64,
        hint: Option<usize>,
    ) -> (ClosestPoint, usize) {
        let mut search = Search::new(self, p, radius);
        let best = hint.and_then(|slot| search.visit(slot));
        self.bvh
            .nearest(p, best.unwrap_or(radius), |slot| search.visit(slot));
        search.found
    }

    /// The closest point on the triangles of some slots, if within `radius`.
    pub(crate) fn closest_among(&self, slots: &[u32], p: Vec3, radius: f64) -> ClosestPoint {
        let mut search = Search::new(self, p, radius);
        for &slot in slots {
            search.visit(slot as usize);
        }
        search.found.0
    }

    /// Replaces `found` by the slots of all triangles that may be nearer than `max_distance` to a box; stops
    /// at `max_count + 1` slots.
    pub(crate) fn collect(
        &self,
        region: &Aabb,
        max_distance: f64,
        max_count: usize,
        found: &mut Vec<u32>,
    ) {
        found.clear();
        let may_be_near = self.may_be_within(region, max_distance);
        self.bvh.overlapping(&region.dilated(max_distance), |slot| {
            if may_be_near(slot as u32) {
                found.push(slot as u32);
            }
            found.len() <= max_count
        });
    }

    /// Adds to `found` the slots of `slots` whose triangles may be nearer than `max_distance` to a box.
    pub(crate) fn collect_among(
        &self,
        slots: &[u32],
        region: &Aabb,
        max_distance: f64,
        found: &mut Vec<u32>,
    ) {
        let may_be_near = self.may_be_within(region, max_distance);
        found.extend(slots.iter().copied().filter(|&slot| may_be_near(slot)));
    }

    /// A test whether the triangle in a slot may be nearer than `max_distance` to the ball around a box.
    fn may_be_within(&self, region: &Aabb, max_distance: f64) -> impl Fn(u32) -> bool + '_ {
        let local = self.bvh.local();
        let q = local.point(region.centre().0);
        let q = [q.x as f32, q.y as f32, q.z as f32];
        let local_reach = local.length(region.half_diagonal() + max_distance) as f32;
        move |slot| !self.discs[slot as usize].is_beyond(q, local_reach)
    }
}

/// The state of a search for the closest point.
struct Search<'a> {
    soup: &'a Soup,
    p: Vec3,
    /// `p` in the tree's local frame.
    q: [f32; 3],
    max_squared: f64,
    max_distance: f32,
    found: (ClosestPoint, usize),
}

impl<'a> Search<'a> {
    fn new(soup: &'a Soup, p: Vec3, radius: f64) -> Self {
        let local = soup.bvh.local();
        let q = local.point(p);
        Self {
            soup,
            p,
            q: [q.x as f32, q.y as f32, q.z as f32],
            max_squared: radius * radius,
            max_distance: local.length(radius) as f32,
            found: (ClosestPoint::NOT_FOUND, usize::MAX),
        }
    }

    /// Tests the triangle in a slot; returns its distance if it is the closest so far.
    #[inline]
    fn visit(&mut self, slot: usize) -> Option<f64> {
        let soup = self.soup;
        if soup.discs[slot].is_beyond(self.q, self.max_distance) {
            return None;
        }
        let point = soup.closest_point(slot, self.p);
        let d2 = (point - self.p).norm_squared();
        let number = soup.number[slot];
        if d2 < self.max_squared || (d2 == self.max_squared && number < self.found.0.triangle) {
            let distance = d2.sqrt();
            self.max_squared = d2;
            self.max_distance = soup.bvh.local().length(distance) as f32;
            self.found = (
                ClosestPoint {
                    distance,
                    point,
                    triangle: number,
                },
                slot,
            );
        }
        (number == self.found.0.triangle).then_some(self.found.0.distance)
    }
}

/// Distances to triangles; degenerate ones count as segments or points.
#[doc(hidden)]
pub struct TriangleDistances(Soup);

impl TriangleDistances {
    /// Builds the hierarchy of triangles with finite coordinates.
    #[doc(hidden)]
    pub fn new(triangles: &[[Vec3; 3]]) -> Self {
        let numbered: Vec<_> = triangles.iter().copied().zip(0u32..).collect();
        Self(Soup::new(&numbered))
    }

    /// The distance to the nearest triangle.
    #[doc(hidden)]
    pub fn distance(&self, p: Vec3) -> f64 {
        self.0.closest(p, None).0.distance
    }
}
