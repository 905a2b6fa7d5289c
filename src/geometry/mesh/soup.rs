//! A triangle soup with its bounding-volume hierarchy, for distances and winding numbers.
//!
//! A slot is a triangle's place in the hierarchy; its number is the caller's. Discs around triangles exclude most of
//! them in `f32`, always on the safe side; distances of the rest are computed in `f64`. Long triangles can be cut into
//! pieces, each with a box of its own, in a second hierarchy. A hint affects the time of a search and not its result.
// Tests of discs must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::bvh::{Bvh, LocalFrame};
use super::pieces::PieceTree;
use super::plates::Plates;
use super::rows::{Facet, NearestOfRow, ROW};
use super::sliver::{Sliver, Thinness};
use super::triangle::closest_point_of_regular;
use crate::frame::{Aabb, Vec3};
use crate::simd::{self, Lanes};
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
pub(super) struct Disc {
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
        let max_distance = max_distance * DISTANCE_FACTOR + self.slack();
        let remaining2 = max_distance * max_distance - height * height;
        // sqrt(d2 - height^2) > radius + sqrt(remaining2), without roots where possible.
        let across2 = d2 - height * height;
        remaining2 < 0.0 || {
            let limit = self.radius + remaining2.sqrt();
            across2 > limit * limit
        }
    }

    /// As [`Self::is_beyond`] for a row of points: one bit each.
    #[inline(always)]
    pub(super) fn bits_beyond<L: Lanes>(&self, l: L, p: [L::F; 3], max_distance: L::F) -> u8 {
        let (mut d2, mut height) = (l.splat(0.0), l.splat(0.0));
        for a in 0..3 {
            let d = l.sub(p[a], l.splat(self.centre[a]));
            d2 = l.fused(d, d, d2);
            height = l.fused(d, l.splat(self.normal[a]), height);
        }
        let slack = l.splat(self.slack());
        let max_distance = l.fused(max_distance, l.splat(DISTANCE_FACTOR), slack);
        let height2 = l.mul(height, height);
        let remaining2 = l.sub(l.mul(max_distance, max_distance), height2);
        let zero = l.splat(0.0);
        let limit = l.add(l.splat(self.radius), l.sqrt(l.max(remaining2, zero)));
        let across2 = l.sub(d2, height2);
        l.below(remaining2, zero) | l.below(l.mul(limit, limit), across2)
    }

    /// Covers the rounding of the normal over the disc, and the absolute rounding of coordinates in [-1, 1].
    #[inline(always)]
    fn slack(&self) -> f32 {
        1e-6 * self.radius + 6e-7
    }
}

/// Covers the relative rounding of distances in `f32`.
const DISTANCE_FACTOR: f32 = 1.0 + 4e-6;

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

/// A triangle whose height is at most this fraction of its longest side is long: its disc is mostly empty.
const MAX_LONG_RATIO: f64 = 1.0 / 16.0;

/// Triangles without connectivity, sorted into the slots of a hierarchy.
pub(crate) struct Soup {
    pub(crate) bvh: Bvh,
    pub(crate) corners: Vec<[Vec3; 3]>,
    /// The caller's number of the triangle in each slot.
    pub(crate) number: Vec<u32>,
    discs: Vec<Disc>,
    slivers: Vec<Sliver>,
    /// The slots of long triangles, ascending.
    long: Vec<u32>,
    /// A second hierarchy for distances and rays, where boxes of whole triangles overlap too much.
    pieces: Option<PieceTree>,
    packs: OnceLock<Vec<DiscPack>>,
    plates: OnceLock<Plates>,
}

impl Soup {
    /// A soup of numbered triangles.
    pub(crate) fn new(triangles: &[([Vec3; 3], u32)]) -> Self {
        let mut soup = Self::uncut(triangles);
        soup.cut();
        soup
    }

    /// Cuts long triangles into pieces, where that speeds up distances and winding numbers.
    pub(super) fn cut(&mut self) {
        self.pieces = PieceTree::of(&self.corners, &self.long);
    }

    /// As [`Self::new`], without cutting long triangles: for few distances and winding numbers. Each triangle comes
    /// with its number in the mesh.
    pub(crate) fn uncut(triangles: &[([Vec3; 3], u32)]) -> Self {
        let bvh = Bvh::new(triangles.len(), |i| Aabb::of(triangles[i].0));
        let at = |slot: &u32| triangles[*slot as usize];
        let corners: Vec<_> = bvh.order().iter().map(|s| at(s).0).collect();
        let (mut slivers, mut long) = (Vec::new(), Vec::new());
        // Bounding discs are loose for slivers and long triangles, which get tighter shapes.
        let disc = |(slot, t): (u32, &[Vec3; 3])| {
            let mut disc = Disc::around(t, bvh.local());
            let thinness = Thinness::of(t);
            if thinness.has_height_ratio(MAX_LONG_RATIO) {
                long.push(slot);
            }
            if thinness.is_sliver() {
                disc.sliver = slivers.len() as u32;
                slivers.push(Sliver::of(t));
            }
            disc
        };
        let discs = (0u32..).zip(&corners).map(disc).collect();
        Self {
            discs,
            slivers,
            long,
            corners,
            number: bvh.order().iter().map(|s| at(s).1).collect(),
            pieces: None,
            packs: OnceLock::new(),
            plates: OnceLock::new(),
            bvh,
        }
    }

    /// Whether searches may visit a triangle more than once, by its pieces.
    pub(super) fn is_cut(&self) -> bool {
        self.pieces.is_some()
    }

    /// The disc of the triangle in a slot.
    #[inline]
    pub(super) fn disc(&self, slot: u32) -> &Disc {
        &self.discs[slot as usize]
    }

    /// The frame of the sliver in a slot; `None` for other triangles.
    #[inline]
    pub(super) fn sliver(&self, slot: usize) -> Option<&Sliver> {
        self.slivers.get(self.discs[slot].sliver as usize)
    }

    /// The triangle in a slot, for rows of points.
    pub(super) fn facet(&self, slot: usize) -> Facet<'_> {
        Facet::new(self.corners[slot], self.sliver(slot))
    }

    /// The point of the triangle in a slot closest to `p`.
    #[inline]
    pub(super) fn closest_point(&self, slot: usize, p: Vec3) -> Vec3 {
        match self.sliver(slot) {
            Some(sliver) => sliver.closest::<f64>(p.into()).into(),
            None => closest_point_of_regular(&self.corners[slot], p),
        }
    }

    /// The discs by pack: slot n is in pack n / [`PACK_SIZE`].
    pub(super) fn packs(&self) -> &[DiscPack] {
        self.packs
            .get_or_init(|| self.discs.chunks(PACK_SIZE).map(DiscPack::of).collect())
    }

    /// Plates of the packs with long triangles, if these are cut or more than an eighth of all.
    pub(super) fn plates(&self) -> &Plates {
        self.plates.get_or_init(|| {
            if self.is_cut() || 8 * self.long.len() > self.corners.len() {
                Plates::of(&self.corners, &self.long, self.bvh.local())
            } else {
                Plates::default()
            }
        })
    }

    /// Visits the slots of all triangles that may be nearer than `max_distance` to a box; with pieces some slots
    /// more than once.
    fn visit_near(&self, region: &Aabb, max_distance: f64, mut visit: impl FnMut(usize)) {
        let region = region.dilated(max_distance);
        match &self.pieces {
            None => self.bvh.overlapping(&region, |slot| {
                visit(slot);
                true
            }),
            Some(pieces) => pieces.bvh.overlapping(&region, |n| {
                visit(pieces.triangles[n] as usize);
                true
            }),
        }
    }

    /// Visits the slots of all triangles that the ray from `p` along an axis, forward or backward, may cross; with
    /// pieces some slots more than once.
    pub(super) fn along(
        &self,
        p: Vec3,
        axis: usize,
        is_forward: bool,
        mut visit: impl FnMut(usize),
    ) {
        match &self.pieces {
            None => self.bvh.along(p, axis, is_forward, visit),
            Some(pieces) => pieces.bvh.along(p, axis, is_forward, |n| {
                visit(pieces.triangles[n] as usize);
            }),
        }
    }

    /// Replaces `found` by the sorted packs of all triangles that may be nearer than `max_distance` to a box.
    pub(super) fn collect_packs(&self, region: &Aabb, max_distance: f64, found: &mut Vec<u32>) {
        found.clear();
        self.visit_near(region, max_distance, |slot| {
            let pack = (slot / PACK_SIZE) as u32;
            if found.last() != Some(&pack) {
                found.push(pack);
            }
        });
        found.sort_unstable();
        found.dedup();
    }

    /// The closest point and its slot. A `hint`, a slot with a near triangle, speeds up the search.
    pub(crate) fn closest(&self, p: Vec3, hint: Option<usize>) -> (ClosestPoint, usize) {
        self.closest_within(p, f64::INFINITY, hint)
    }

    /// The closest point and its slot, if within `radius`. Beyond it the result is [`ClosestPoint::NOT_FOUND`] with the
    /// slot `usize::MAX`.
    pub(crate) fn closest_within(
        &self,
        p: Vec3,
        radius: f64,
        hint: Option<usize>,
    ) -> (ClosestPoint, usize) {
        let mut search = Search::new(self, p, radius);
        let best = hint.and_then(|slot| search.visit(slot));
        let best = best.unwrap_or(radius);
        match &self.pieces {
            None => self.bvh.nearest(p, best, |slot| search.visit(slot)),
            Some(pieces) => pieces
                .bvh
                .nearest(p, best, |n| search.visit(pieces.triangles[n] as usize)),
        }
        search.found
    }

    /// The closest point on the triangles of some slots, if within `radius`; else [`ClosestPoint::NOT_FOUND`].
    pub(crate) fn closest_among(&self, slots: &[u32], p: Vec3, radius: f64) -> ClosestPoint {
        let mut search = Search::new(self, p, radius);
        for &slot in slots {
            search.visit(slot as usize);
        }
        search.found.0
    }

    /// As [`Self::closest_among`] for several points, which should be close together.
    pub(crate) fn closest_among_all(
        &self,
        slots: &[u32],
        points: &[Vec3],
        radius: f64,
        closest: &mut [Option<ClosestPoint>],
    ) {
        for first in (0..points.len()).step_by(ROW) {
            // The last point pads the last row.
            let at = |n: usize| (first + n).min(points.len() - 1);
            let nearest = simd::run(NearestOfRow {
                soup: self,
                slots,
                points: std::array::from_fn(|n| points[at(n)]),
                radius,
            });
            for (n, slot) in (first..points.len()).zip(nearest) {
                let mut search = Search::new(self, points[n], radius);
                if slot != u32::MAX {
                    search.visit(slot as usize);
                }
                closest[n] = (slot != u32::MAX).then_some(search.found.0);
            }
        }
    }

    /// Replaces `found` by the slots of all triangles that may be nearer than `max_distance` to a box. The distance is
    /// in world units. No slot occurs twice; slots ascend only where triangles are cut.
    pub(crate) fn collect(&self, region: &Aabb, max_distance: f64, found: &mut Vec<u32>) {
        found.clear();
        let may_be_near = self.may_be_within(region, max_distance);
        self.visit_near(region, max_distance, |slot| {
            if may_be_near(slot as u32) {
                found.push(slot as u32);
            }
        });
        if self.is_cut() {
            found.sort_unstable();
            found.dedup();
        }
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
    /// A search for the triangle closest to `p` within `radius`, both in world units; nothing is found yet.
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
        // The parts of a united triangle share its number: the slot decides, whatever the order of the search.
        let is_before = || (number, slot) < (self.found.0.triangle, self.found.1);
        if d2 < self.max_squared || (d2 == self.max_squared && is_before()) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::SampleLattice;
    use crate::frame::WorldPoint;
    use crate::mesh::{crossing, lattice};

    /// Triangles of a turned prism whose caps are fans from one corner, and of ordinary ones beside it.
    fn turned_prism(corners: usize) -> Vec<([Vec3; 3], u32)> {
        let turn = std::f64::consts::TAU / corners as f64;
        let axes =
            [[2.0, 3.0, 6.0], [3.0, -6.0, 2.0], [6.0, 2.0, -3.0]].map(|a| Vec3::from(a) / 7.0);
        let rim = |k: usize, z: f64| {
            let angle = k as f64 * turn;
            axes[0] * angle.cos() + axes[1] * angle.sin() + axes[2] * z
        };
        let mut all = Vec::new();
        for k in 0..corners {
            let next = (k + 1) % corners;
            all.push([rim(k, 0.0), rim(next, 0.0), rim(next, 0.3)]);
            all.push([rim(k, 0.0), rim(next, 0.3), rim(k, 0.3)]);
            // The sides at the hub have no triangle in the fan.
            if k > 0 && next > 0 {
                all.push([rim(0, 0.3), rim(k, 0.3), rim(next, 0.3)]);
                all.push([rim(0, 0.0), rim(next, 0.0), rim(k, 0.0)]);
            }
        }
        all.into_iter().zip(0..).collect()
    }

    fn random_points(count: usize) -> Vec<Vec3> {
        let mut state = 3u64;
        let mut coordinate = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as f64 / f64::from(1u32 << 30) - 1.0
        };
        let mut point = || Vec3::from_fn(|_, _| 1.2 * coordinate());
        (0..count).map(|_| point()).collect()
    }

    /// Distances, nearest triangles and winding numbers of a cut soup are bit for bit those of a scan.
    #[test]
    fn cut_soups_give_what_a_scan_of_all_triangles_gives() {
        let triangles = turned_prism(300);
        let (cut, uncut) = (Soup::new(&triangles), Soup::uncut(&triangles));
        assert!(cut.is_cut() && !uncut.is_cut());
        let bounds = Aabb::of(triangles.iter().flat_map(|t| t.0));
        let slots: Vec<u32> = (0..triangles.len() as u32).rev().collect();
        let mut inside = 0;
        let mut points = random_points(300);
        // Points on sides and corners have the same distance from several triangles.
        points.extend(triangles.iter().step_by(7).map(|t| (t.0[0] + t.0[1]) / 2.0));
        points.extend(triangles.iter().step_by(11).map(|t| t.0[1]));
        // Rows of eight, and a rest: the bits of single points, within a radius and beyond.
        let found = [0.0, 0.2, 3.0].map(|radius| {
            let mut closest = vec![None; points.len()];
            uncut.closest_among_all(&slots, &points, radius, &mut closest);
            for (closest, p) in closest.iter().zip(&points) {
                let alone = uncut.closest_among(&slots, *p, radius);
                assert_eq!(*closest, (alone.triangle != u32::MAX).then_some(alone));
            }
            closest.iter().flatten().count()
        });
        assert!(found[0] < found[1] && found[1] < found[2], "{found:?}");
        assert_eq!(found[2], points.len());
        for p in points {
            let from = |slot: usize| (cut.closest_point(slot, p) - p).norm_squared();
            let scan = (0..triangles.len()).map(|slot| (from(slot), cut.number[slot]));
            let (squared, number) = scan.fold((f64::INFINITY, u32::MAX), |best, next| {
                if next < best { next } else { best }
            });
            let found = cut.closest(p, None).0;
            assert_eq!((found.distance, found.triangle), (squared.sqrt(), number));
            assert_eq!(uncut.closest(p, Some(0)).0, found);
            if bounds.contains(WorldPoint(p)) {
                let winding = crossing::winding(&cut, &bounds, p);
                assert_eq!(winding, crossing::winding(&uncut, &bounds, p));
                inside += winding;
            }
        }
        assert!(inside > 5, "{inside}");
    }

    /// Samples of a lattice at the hub of a fan, and across a whole cap.
    #[test]
    fn lattices_at_fans_are_measured_bit_for_bit() {
        let triangles = turned_prism(400);
        let soup = Soup::new(&triangles);
        let hub = triangles[0].0[0];
        for (origin, step) in [(hub - Vec3::repeat(0.04), 0.01), (Vec3::repeat(-0.8), 0.2)] {
            let samples = SampleLattice {
                origin: WorldPoint(origin),
                step,
                counts: [8; 3],
            };
            let (span, reach) = (samples.span(), 0.25);
            let mut packs = Vec::new();
            soup.collect_packs(&span, reach, &mut packs);
            let mut distances = vec![0.0; samples.len()];
            lattice::distances(&soup, &packs, &samples, reach, &mut distances);
            let mut measured = 0;
            for (n, distance) in distances.into_iter().enumerate() {
                let p = samples.point(n).0;
                let all = (0..triangles.len()).map(|slot| (soup.closest_point(slot, p) - p).norm());
                let right = all.fold(f64::INFINITY, f64::min);
                if right < reach {
                    assert_eq!(distance.to_bits(), right.to_bits());
                    measured += 1;
                } else {
                    assert!(distance >= reach);
                }
            }
            assert!(measured > 100, "{measured}");
        }
    }
}
