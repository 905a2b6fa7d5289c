//! A mesh as a solid: exact distance, sign by the winding number.
//!
//! A point is inside where the generalised winding number exceeds 1/2, which holds for open,
//! self-intersecting and duplicated surfaces alike; where nothing is open it is counted exactly. The value is the signed distance to the
//! triangles: 1-Lipschitz wherever the surface is closed. Across a hole, where w = 1/2 without a
//! surface, the sign changes at a distance; bounds and bulk evaluation take that into account.

use super::rim::Rim;
use super::soup::{Closest, Soup};
use super::winding::Winding;
use super::{TriMesh, crossing, rows};
use crate::field::{Field, Interval, SampleLattice};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// So many triangles near a lattice are tried row by row.
const FEW: usize = 256;

/// A triangle mesh prepared for distance and inside tests; immutable and shared by threads.
///
/// A mesh without triangles is a solid that is nowhere: outside everywhere, at infinite distance.
///
/// ```
/// use druse::{field::Field, frame::{Aabb, Vec3, WorldPoint}, mesh::{MeshSolid, TriMesh}};
/// let cube = MeshSolid::new(TriMesh::cuboid(&Aabb::of([[0.0; 3].into(), [2.0; 3].into()])));
/// assert_eq!(cube.value(WorldPoint(Vec3::new(1.0, 1.0, 0.25))), -0.25);
/// assert_eq!(cube.signed_distance(Vec3::new(5.0, 6.0, 1.0)), 5.0);
/// ```
pub struct MeshSolid {
    mesh: TriMesh,
    bounds: Aabb,
    /// What distance is measured to.
    surface: Soup,
    /// What winds, where it is more than the surface.
    whole: Option<Soup>,
    /// Expansions of far triangles, where something is open.
    winding: Option<Winding>,
    /// Triangles that wind only: there the sign may change away from the surface.
    caps: Option<Soup>,
    rim: Option<Rim>,
}

impl MeshSolid {
    /// A solid whose surface is the whole mesh.
    pub fn new(mesh: TriMesh) -> Self {
        let caps = vec![false; mesh.triangles().len()];
        Self::with_caps(mesh, &caps)
    }

    /// A solid some of whose triangles are only caps: they count for what is inside, but the
    /// distance passes them by. A cell trimmed at its element's faces is such a mesh.
    ///
    /// # Panics
    /// When `is_cap` has not one entry per triangle.
    pub fn with_caps(mesh: TriMesh, is_cap: &[bool]) -> Self {
        assert_eq!(
            is_cap.len(),
            mesh.triangles().len(),
            "one flag per triangle"
        );
        let numbered: Vec<_> = mesh.iter_corners().zip(0u32..).collect();
        let part = |cap: bool| -> Vec<_> {
            numbered
                .iter()
                .filter(|t| is_cap[t.1 as usize] == cap)
                .copied()
                .collect()
        };
        let has_caps = is_cap.contains(&true);
        let surface = if has_caps {
            Soup::new(&part(false))
        } else {
            Soup::new(&numbered)
        };
        let whole = has_caps.then(|| Soup::new(&numbered));
        let merged = mesh.merged();
        let rim = Rim::new(merged.vertices(), merged.triangles());
        let winding = |_: &Rim| Winding::new(whole.as_ref().unwrap_or(&surface));
        Self {
            bounds: mesh.bounds(),
            winding: rim.as_ref().map(winding),
            caps: has_caps.then(|| Soup::new(&part(true))),
            rim,
            mesh,
            surface,
            whole,
        }
    }

    /// The mesh it was made from.
    pub fn mesh(&self) -> &TriMesh {
        &self.mesh
    }

    /// The box around all triangles, caps included; the solid lies within.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Whether every side of a triangle is answered by another in the opposite direction: the
    /// winding number is then an integer away from the triangles.
    pub fn is_cycle(&self) -> bool {
        self.rim.is_none()
    }

    /// The point of the surface nearest to `p`.
    pub fn closest(&self, p: Vec3) -> Closest {
        self.surface.closest(p, None).0
    }

    /// The point of the surface nearest to `p`, if it is not farther than `radius`: faster than
    /// [`MeshSolid::closest`] where nothing is near.
    pub fn closest_within(&self, p: Vec3, radius: f64) -> Option<Closest> {
        let found = self.surface.closest_within(p, radius, None).0;
        (found.triangle != u32::MAX).then_some(found)
    }

    /// As [`MeshSolid::closest_within`], among some triangles only.
    pub(crate) fn closest_among(&self, slots: &[u32], p: Vec3, radius: f64) -> Option<Closest> {
        let found = self.surface.closest_among(slots, p, radius);
        (found.triangle != u32::MAX).then_some(found)
    }

    /// Replaces `slots` by all triangles that may be nearer than `reach` to a box: among them is the one
    /// closest to any point of the box, if it is within reach.
    pub(crate) fn collect(&self, region: &Aabb, reach: f64, slots: &mut Vec<u32>) {
        self.surface.collect(region, reach, usize::MAX, slots);
    }

    /// Adds to `slots` those of `among` that may be nearer than `reach` to a box.
    pub(crate) fn collect_among(
        &self,
        among: &[u32],
        region: &Aabb,
        reach: f64,
        slots: &mut Vec<u32>,
    ) {
        self.surface.collect_among(among, region, reach, slots);
    }

    /// The generalised winding number at `p`: exact and whole for a cycle, otherwise within a few
    /// thousandths (far triangles count in groups).
    pub fn winding_number(&self, p: Vec3) -> f64 {
        let soup = self.whole.as_ref().unwrap_or(&self.surface);
        match &self.winding {
            Some(expansions) => expansions.number(soup, p),
            None if !self.bounds.contains(WorldPoint(p)) => 0.0,
            None => crossing::winding(soup, &self.bounds, p) as f64,
        }
    }

    /// Whether `p` is inside: the winding number exceeds 1/2.
    pub fn contains(&self, p: Vec3) -> bool {
        self.winding_number(p) > 0.5
    }

    /// Distance to the surface, negative inside.
    pub fn signed_distance(&self, p: Vec3) -> f64 {
        let d = self.closest(p).distance;
        if self.contains(p) { -d } else { d }
    }

    /// Distances of a lattice's samples to the surface, which are at most `most`; the triangle of the slot
    /// `hint` is near.
    fn distances(
        &self,
        lattice: &SampleLattice<WorldPoint>,
        most: f64,
        hint: Option<usize>,
    ) -> Vec<f64> {
        let mut distances = vec![0.0; lattice.len()];
        let mut near = Vec::new();
        if most.is_finite() {
            self.surface
                .collect(&lattice.span(), most * (1.0 + 1e-9), FEW, &mut near);
        }
        if near.len() <= FEW {
            let points: Vec<Vec3> = (0..lattice.len()).map(|n| lattice.point(n).0).collect();
            let triangles = near.iter().map(|&s| self.surface.corners[s as usize]);
            rows::distances(triangles, &points, &mut distances);
            return distances;
        }
        // Among many the tree finds the nearest sooner.
        let [_, ny, nz] = lattice.counts;
        let mut slots = vec![usize::MAX; lattice.len()];
        for n in 0..lattice.len() {
            // The neighbour before on the fastest axis there is one on.
            let before = match (n % nz, n / nz % ny, n / (ny * nz)) {
                (0, 0, 0) => None,
                (0, 0, _) => Some(n - ny * nz),
                (0, ..) => Some(n - nz),
                _ => Some(n - 1),
            };
            let near = before.map_or(hint, |m| Some(slots[m]));
            let near = near.filter(|&s| s != usize::MAX);
            let (closest, slot) = self.surface.closest(lattice.point(n).0, near);
            distances[n] = closest.distance;
            slots[n] = slot;
        }
        distances
    }

    /// Whether `centre` is inside, if within `radius` of it the sign changes at the surface only;
    /// `None` where a cap or the film across a hole may come between.
    fn steady(&self, centre: Vec3, radius: f64) -> Option<bool> {
        let near = |caps: &Soup| caps.closest_within(centre, radius, None).1 != usize::MAX;
        if self.caps.as_ref().is_some_and(near) {
            return None;
        }
        let Some(rim) = &self.rim else {
            return Some(self.contains(centre));
        };
        // The surface itself makes w jump by whole numbers: all values w could take must keep clear
        // of 1/2.
        let drift = rim.drift(centre, radius);
        let w = if drift < 0.5 {
            self.winding_number(centre)
        } else {
            0.5
        };
        ((w - w.floor() - 0.5).abs() > drift).then_some(w > 0.5)
    }
}

impl Field for MeshSolid {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        self.signed_distance(p.0)
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let c = self.closest(p.0);
        let s = if self.contains(p.0) { -1.0 } else { 1.0 };
        let away = p.0 - c.point;
        let gradient = if c.distance > 0.0 && c.distance.is_finite() {
            away * (s / c.distance)
        } else if c.triangle == u32::MAX {
            Vec3::zeros()
        } else {
            let [a, b, c] = self.mesh.corners(c.triangle as usize);
            (b - a)
                .cross(&(c - a))
                .try_normalize(0.0)
                .unwrap_or_default()
        };
        (s * c.distance, gradient)
    }

    fn bound(&self, region: &Aabb) -> Interval {
        let (centre, radius) = (region.centre().0, region.half_diagonal());
        let d = self.closest(centre).distance;
        match self.steady(centre, radius) {
            Some(inside) => {
                let v = if inside { -d } else { d };
                Interval::new(v - radius, v + radius)
            }
            None => Interval::new(-d - radius, d + radius),
        }
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        if lattice.is_empty() {
            return;
        }
        let span = lattice.span();
        let (centre, radius) = (span.centre().0, span.half_diagonal());
        let (at_centre, slot) = self.surface.closest(centre, None);
        let hint = (slot != usize::MAX).then_some(slot);
        // A little more, so that samples on the box's corners are held too.
        let radius = radius * (1.0 + 1e-9);
        let steady = self.steady(centre, radius);
        let settled = steady.filter(|_| at_centre.distance > radius);
        let [_, ny, nz] = lattice.counts;
        let reach = lattice.step * (1.0 + 1e-9);
        let strides = [1, nz, ny * nz];
        let distances = self.distances(lattice, at_centre.distance + radius, hint);
        for n in 0..lattice.len() {
            // The neighbours before.
            let place = [n % nz, n / nz % ny, n / (ny * nz)];
            let before = (0..3).filter(|&a| place[a] > 0).map(|a| n - strides[a]);
            let d = distances[n];
            let inside = settled.unwrap_or_else(|| {
                // Between two samples whose distances exceed their step no surface can pass.
                let passes = |&m: &usize| distances[m] + d > reach;
                let same = before.clone().find(|m| steady.is_some() && passes(m));
                let alone = || self.contains(lattice.point(n).0);
                same.map_or_else(alone, |m| out[m].is_sign_negative())
            });
            out[n] = if inside { -d } else { d } as f32;
        }
    }
}
