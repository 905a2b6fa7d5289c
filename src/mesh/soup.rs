//! Triangles in tree order with their hierarchy: what distance and winding number search.

use super::bvh::{Bvh, Local};
use super::triangle::closest_point;
use crate::frame::{Aabb, Vec3};
use std::sync::OnceLock;

/// A point of a surface nearest to a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// Distance, not negative; infinite if there is no triangle.
    pub distance: f64,
    /// The point on the surface.
    pub point: Vec3,
    /// Number of a triangle that holds it, the least of those tried at the same distance;
    /// `u32::MAX` if there is none.
    pub triangle: u32,
}

impl Closest {
    pub(crate) const NOTHING: Self = Self {
        distance: f64::INFINITY,
        point: Vec3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        triangle: u32::MAX,
    };
}

/// A disc around a triangle in its plane, in the tree's local frame: a much closer bound of distance
/// than a box for a triangle seen from far along its normal.
#[derive(Clone, Copy)]
struct Disc {
    centre: [f32; 3],
    /// Unit normal; zero makes a ball of the disc.
    normal: [f32; 3],
    radius: f32,
}

impl Disc {
    fn around(t: &[Vec3; 3], local: Local) -> Self {
        let [a, b, c] = t.map(|p| local.point(p));
        let centre = (a + b + c) / 3.0;
        let radius = [a, b, c]
            .iter()
            .map(|p| (p - centre).norm())
            .fold(0.0, f64::max);
        let n = (b - a).cross(&(c - a));
        // The normal of a needle is not known well enough.
        let normal = if n.norm() > 1e-6 * radius * radius {
            n.normalize()
        } else {
            Vec3::zeros()
        };
        Self {
            centre: [centre.x as f32, centre.y as f32, centre.z as f32],
            normal: [normal.x as f32, normal.y as f32, normal.z as f32],
            radius: radius as f32,
        }
    }

    /// Whether the whole disc is farther from `p` than `reach`, rounding considered.
    fn is_beyond(&self, p: [f32; 3], reach: f32) -> bool {
        let mut d2 = 0.0;
        let mut height = 0.0;
        for a in 0..3 {
            let d = p[a] - self.centre[a];
            d2 += d * d;
            height += d * self.normal[a];
        }
        // Relative rounding of distances, absolute of places in [-1, 1], and of the normal over the
        // disc.
        let reach = reach * (1.0 + 4e-6) + 1e-6 * self.radius + 6e-7;
        let room = reach * reach - height * height;
        // sqrt(d2 - height^2) > radius + sqrt(room), without the roots where possible.
        let across2 = d2 - height * height;
        room < 0.0 || {
            let wide = self.radius + room.sqrt();
            across2 > wide * wide
        }
    }
}

/// Discs in a pack.
pub(super) const PACK: usize = 8;

/// The discs of [`PACK`] slots that follow each other, a row of numbers each; the last pack's are filled up
/// with the last disc.
#[derive(Clone)]
pub(super) struct Pack {
    pub(super) centre: [[f32; PACK]; 3],
    pub(super) normal: [[f32; PACK]; 3],
    pub(super) radius: [f32; PACK],
}

impl Pack {
    fn of(discs: &[Disc]) -> Self {
        let at = |n: usize| &discs[n.min(discs.len() - 1)];
        Self {
            centre: std::array::from_fn(|a| std::array::from_fn(|n| at(n).centre[a])),
            normal: std::array::from_fn(|a| std::array::from_fn(|n| at(n).normal[a])),
            radius: std::array::from_fn(|n| at(n).radius),
        }
    }
}

/// Triangles by slot, their numbers, and the tree over them.
pub(crate) struct Soup {
    pub(crate) bvh: Bvh,
    pub(crate) corners: Vec<[Vec3; 3]>,
    /// The number each slot's triangle has outside.
    pub(crate) number: Vec<u32>,
    discs: Vec<Disc>,
    packs: OnceLock<Vec<Pack>>,
}

impl Soup {
    /// Triangles with their numbers.
    pub(crate) fn new(triangles: &[([Vec3; 3], u32)]) -> Self {
        let bvh = Bvh::new(triangles.len(), |i| Aabb::of(triangles[i].0));
        let at = |slot: &u32| triangles[*slot as usize];
        let corners: Vec<_> = bvh.order().iter().map(|s| at(s).0).collect();
        Self {
            discs: corners
                .iter()
                .map(|t| Disc::around(t, bvh.local()))
                .collect(),
            corners,
            number: bvh.order().iter().map(|s| at(s).1).collect(),
            packs: OnceLock::new(),
            bvh,
        }
    }

    /// The discs in packs: slot n is in pack n / [`PACK`].
    pub(super) fn packs(&self) -> &[Pack] {
        self.packs
            .get_or_init(|| self.discs.chunks(PACK).map(Pack::of).collect())
    }

    /// Replaces `found` by the packs of all triangles that may be nearer than `reach` to a box, in order.
    pub(super) fn collect_packs(&self, region: &Aabb, reach: f64, found: &mut Vec<u32>) {
        found.clear();
        self.bvh.overlapping(&region.dilated(reach), |slot| {
            let pack = (slot / PACK) as u32;
            if found.last() != Some(&pack) {
                found.push(pack);
            }
            true
        });
        found.sort_unstable();
        found.dedup();
    }

    /// The closest point, not farther than that of the slot `hint` if there is one; gives its slot.
    pub(crate) fn closest(&self, p: Vec3, hint: Option<usize>) -> (Closest, usize) {
        self.closest_within(p, f64::INFINITY, hint)
    }

    /// The closest point if it is not farther than `radius`.
    pub(crate) fn closest_within(
        &self,
        p: Vec3,
        radius: f64,
        hint: Option<usize>,
    ) -> (Closest, usize) {
        let mut search = Search::new(self, p, radius);
        let best = hint.and_then(|slot| search.visit(slot));
        self.bvh
            .nearest(p, best.unwrap_or(radius), |slot| search.visit(slot));
        search.found
    }

    /// The closest point on the triangles of some slots, if it is not farther than `radius`.
    pub(crate) fn closest_among(&self, slots: &[u32], p: Vec3, radius: f64) -> Closest {
        let mut search = Search::new(self, p, radius);
        for &slot in slots {
            search.visit(slot as usize);
        }
        search.found.0
    }

    /// Replaces `found` by the slots of all triangles that may be nearer than `reach` to a box; of more than
    /// `most` by one more than these.
    pub(crate) fn collect(&self, region: &Aabb, reach: f64, most: usize, found: &mut Vec<u32>) {
        found.clear();
        let near = self.nearness(region, reach);
        self.bvh.overlapping(&region.dilated(reach), |slot| {
            if near(slot as u32) {
                found.push(slot as u32);
            }
            found.len() <= most
        });
    }

    /// Adds to `found` those of some slots whose triangles may be nearer than `reach` to a box.
    pub(crate) fn collect_among(
        &self,
        slots: &[u32],
        region: &Aabb,
        reach: f64,
        found: &mut Vec<u32>,
    ) {
        let near = self.nearness(region, reach);
        found.extend(slots.iter().copied().filter(|&slot| near(slot)));
    }

    /// Whether a slot's triangle may be nearer than `reach` to the ball around a box.
    fn nearness(&self, region: &Aabb, reach: f64) -> impl Fn(u32) -> bool + '_ {
        let local = self.bvh.local();
        let q = local.point(region.centre().0);
        let q = [q.x as f32, q.y as f32, q.z as f32];
        let all = local.length(region.half_diagonal() + reach) as f32;
        move |slot| !self.discs[slot as usize].is_beyond(q, all)
    }
}

/// What a search for the closest point has found so far.
struct Search<'a> {
    soup: &'a Soup,
    p: Vec3,
    /// In the tree's local frame.
    q: [f32; 3],
    squared: f64,
    reach: f32,
    found: (Closest, usize),
}

impl<'a> Search<'a> {
    fn new(soup: &'a Soup, p: Vec3, radius: f64) -> Self {
        let local = soup.bvh.local();
        let q = local.point(p);
        Self {
            soup,
            p,
            q: [q.x as f32, q.y as f32, q.z as f32],
            squared: radius * radius,
            reach: local.length(radius) as f32,
            found: (Closest::NOTHING, usize::MAX),
        }
    }

    /// Tries a slot; gives the distance if it is the closest so far.
    #[inline]
    fn visit(&mut self, slot: usize) -> Option<f64> {
        let soup = self.soup;
        if soup.discs[slot].is_beyond(self.q, self.reach) {
            return None;
        }
        let point = closest_point(&soup.corners[slot], self.p);
        let d2 = (point - self.p).norm_squared();
        let number = soup.number[slot];
        if d2 < self.squared || (d2 == self.squared && number < self.found.0.triangle) {
            let distance = d2.sqrt();
            self.squared = d2;
            self.reach = soup.bvh.local().length(distance) as f32;
            self.found = (
                Closest {
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

/// Distances to triangles, any of which may be a segment (two corners the same) or a point.
pub(crate) struct Distances(Soup);

impl Distances {
    /// Prepares finite triangles.
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let numbered: Vec<_> = triangles.iter().copied().zip(0u32..).collect();
        Self(Soup::new(&numbered))
    }

    /// Distance to the nearest one.
    pub(crate) fn distance(&self, p: Vec3) -> f64 {
        self.0.closest(p, None).0.distance
    }
}
