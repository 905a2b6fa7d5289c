//! A mesh as a solid: exact distance, sign by the winding number.
//!
//! A point is inside where the generalised winding number exceeds 1/2, which holds for open,
//! self-intersecting and duplicated surfaces alike; where nothing is open it is counted exactly. The value is the signed distance to the
//! triangles, without the parts that overlapping shells bury in the solid where a mesh is repaired:
//! 1-Lipschitz wherever the surface is closed. Across a hole, where w = 1/2 without a
//! surface, the sign changes at a distance; bounds and bulk evaluation take that into account.

use super::boundary_edges::Rim;
use super::open_winding::Open;
use super::sides::HalfEdges;
use super::soup::{Closest, Soup};
use super::unite::United;
use super::{TriMesh, crossing, lattice};
use crate::field::{Field, Interval, LeafBits, LeafParts, Leaves, SampleLattice};
use crate::frame::{Aabb, Vec3, WorldPoint};

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
    /// Winding numbers where something is open.
    open: Option<Open>,
    /// Triangles that wind only: there the sign may change away from the surface.
    caps: Option<Soup>,
    /// Parts of triangles inside the solid, and how near to them it has no crack.
    buried: Option<(Soup, f64)>,
    rim: Option<Rim>,
}

/// Triangles with their numbers.
pub(super) type Numbered = Vec<([Vec3; 3], u32)>;

/// What a solid is made of.
pub(super) struct Parts {
    pub(super) mesh: TriMesh,
    /// All triangles of the mesh.
    pub(super) all: Soup,
    /// What winding numbers need if the triangles are no cycle.
    pub(super) open: Option<(Open, Rim)>,
    /// The surface and what is buried, where that is not all triangles.
    pub(super) united: Option<United>,
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
        let merged = mesh.merged();
        let sides = HalfEdges::of(merged.triangles(), merged.vertices().len());
        let numbered: Numbered = mesh.iter_corners().zip(0u32..).collect();
        let all = Soup::new(&numbered);
        let (vertices, rim) = (merged.vertices(), sides.rim());
        let open = Open::new(vertices, &rim, &all);
        let open = open.and_then(|open| {
            let rim = Rim::new(vertices, &rim, open.spanning(&all))?;
            Some((open, rim))
        });
        let parts = Parts {
            mesh,
            all,
            open,
            united: None,
        };
        Self::of_parts(parts, is_cap)
    }

    /// # Panics
    /// When `is_cap` has not one entry per triangle.
    pub(super) fn of_parts(parts: Parts, is_cap: &[bool]) -> Self {
        let Parts { mesh, all, .. } = parts;
        assert_eq!(
            is_cap.len(),
            mesh.triangles().len(),
            "one flag per triangle"
        );
        let has_caps = is_cap.contains(&true);
        let part = |cap: bool| -> Numbered {
            let numbered = mesh.iter_corners().zip(0u32..);
            numbered.filter(|t| is_cap[t.1 as usize] == cap).collect()
        };
        let (open, rim) = parts.open.unzip();
        let is_surface = |t: &([Vec3; 3], u32)| !is_cap[t.1 as usize];
        let (surface, whole, buried) = match parts.united {
            Some(united) => {
                let surface: Numbered = united.surface.into_iter().filter(is_surface).collect();
                let buried = (Soup::new(&united.buried), united.hair);
                (Soup::new(&surface), Some(all), Some(buried))
            }
            None if has_caps => (Soup::new(&part(false)), Some(all), None),
            None => (all, None, None),
        };
        Self {
            bounds: mesh.bounds(),
            open,
            caps: has_caps.then(|| Soup::new(&part(true))),
            buried,
            rim,
            mesh,
            surface,
            whole,
        }
    }

    /// The pieces of the surface with the numbers of their triangles, caps left out.
    pub(crate) fn surface(&self) -> impl Iterator<Item = ([Vec3; 3], u32)> + '_ {
        let numbers = self.surface.number.iter().copied();
        self.surface.corners.iter().copied().zip(numbers)
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

    /// What winds.
    fn all(&self) -> &Soup {
        self.whole.as_ref().unwrap_or(&self.surface)
    }

    /// The generalised winding number at `p`: exact and whole for a cycle, otherwise within a few
    /// thousandths (far triangles count in groups).
    pub fn winding_number(&self, p: Vec3) -> f64 {
        let soup = self.all();
        match &self.open {
            Some(open) => open.winding_number(soup, &self.bounds, p),
            None if !self.bounds.contains(WorldPoint(p)) => 0.0,
            None => crossing::winding(soup, &self.bounds, p) as f64,
        }
    }

    /// Whether `p` is inside: the winding number exceeds 1/2. Faces of united shells that touch but for
    /// rounding leave no crack.
    pub fn contains(&self, p: Vec3) -> bool {
        let is_inside = match &self.open {
            Some(open) => open.contains(self.all(), &self.bounds, p),
            None => self.winding_number(p) > 0.5,
        };
        if is_inside {
            return true;
        }
        let Some((buried, hair)) = &self.buried else {
            return false;
        };
        let (near, slot) = buried.closest_within(p, *hair, None);
        if near.triangle == u32::MAX {
            return false;
        }
        let [a, b, c] = buried.corners[slot];
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0);
        normal.is_some_and(|n| {
            let beside = [1.0, -1.0].map(|s| self.winding_number(p + n * (2.0 * s * hair)));
            beside.iter().all(|&w| w > 0.5)
        })
    }

    /// Distance to the surface, negative inside.
    pub fn signed_distance(&self, p: Vec3) -> f64 {
        let d = self.closest(p).distance;
        if self.contains(p) { -d } else { d }
    }

    /// Signed distances of a lattice's samples where they are nearer than `near`; elsewhere numbers of the
    /// right sign that are not.
    fn fill_within(&self, lattice: &SampleLattice<WorldPoint>, near: f64, out: &mut [f32]) {
        if lattice.is_empty() {
            return;
        }
        let span = lattice.span();
        let (centre, radius) = (span.centre().0, span.half_diagonal());
        // A little more, so that samples on the box's corners are held too.
        let radius = radius * (1.0 + 1e-9);
        let at_centre = self.surface.closest_within(centre, near + radius, None).0;
        let most = (at_centre.distance + radius).min(near);
        let mut distances = vec![f64::INFINITY; lattice.len()];
        if most.is_finite() {
            let mut packs = Vec::new();
            let reach = most * (1.0 + 1e-9);
            self.surface.collect_packs(&span, reach, &mut packs);
            lattice::distances(&self.surface, &packs, lattice, near, &mut distances);
        }
        let steady = self.steady(centre, radius);
        let settled = steady.filter(|_| at_centre.distance > radius);
        let [_, ny, nz] = lattice.counts;
        let reach = lattice.step * (1.0 + 1e-9);
        let strides = [1, nz, ny * nz];
        let blocks = self.steady_blocks(lattice, steady.is_some());
        for n in 0..lattice.len() {
            // The neighbours before.
            let place = [n % nz, n / nz % ny, n / (ny * nz)];
            let before = (0..3).filter(|&a| place[a] > 0).map(|a| n - strides[a]);
            let d = distances[n];
            let inside = settled.unwrap_or_else(|| {
                // Between two samples whose distances exceed their step no surface can pass.
                let passes = |&m: &usize| distances[m] + d > reach;
                let is_steady = |&m: &usize| blocks[m] != 0 && blocks[m] == blocks[n];
                let same = before.clone().find(|m| is_steady(m) && passes(m));
                let alone = || self.contains(lattice.point(n).0);
                same.map_or_else(alone, |m| out[m].is_sign_negative())
            });
            out[n] = if inside { -d } else { d } as f32;
        }
    }

    /// Numbers of blocks of a lattice's samples: within a block the sign changes at the surface only, unless
    /// its number is 0. With `is_one` all samples are one such block.
    fn steady_blocks(&self, lattice: &SampleLattice<WorldPoint>, is_one: bool) -> Vec<u32> {
        let mut blocks = vec![u32::from(is_one); lattice.len()];
        if is_one {
            return blocks;
        }
        let [_, ny, nz] = lattice.counts;
        let mut last = 0;
        // Blocks of 4^3 samples, and of 2^3 where they do not do.
        let start = [0, 1, 2].map(|a| (0..lattice.counts[a]).step_by(4));
        let mut waiting = Vec::new();
        for x in start[0].clone() {
            for y in start[1].clone() {
                waiting.extend(start[2].clone().map(|z| ([x, y, z], 4)));
            }
        }
        while let Some((from, size)) = waiting.pop() {
            let to = [0, 1, 2].map(|a| (from[a] + size).min(lattice.counts[a]));
            let number = |[x, y, z]: [usize; 3]| (x * ny + y) * nz + z;
            let ends = [from, to.map(|c| c - 1)].map(|at| lattice.point(number(at)).0);
            let radius = (ends[1] - ends[0]).norm() / 2.0 * (1.0 + 1e-9);
            if self.steady((ends[0] + ends[1]) / 2.0, radius).is_some() {
                last += 1;
                for x in from[0]..to[0] {
                    for y in from[1]..to[1] {
                        blocks[number([x, y, from[2]])..=number([x, y, to[2] - 1])].fill(last);
                    }
                }
            } else if size == 4 {
                for n in 0..8 {
                    let part = [0, 1, 2].map(|a| from[a] + 2 * (n >> a & 1));
                    if (0..3).all(|a| part[a] < to[a]) {
                        waiting.push((part, 2));
                    }
                }
            }
        }
        blocks
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

    fn leaf_bound(&self, parts: &LeafParts<Aabb>, near: f64) -> Interval {
        let beyond = |inside| {
            if inside {
                Interval::new(f64::NEG_INFINITY, -near)
            } else {
                Interval::new(near, f64::INFINITY)
            }
        };
        let mut joint: Option<Interval> = None;
        for region in &parts.wide {
            let (centre, radius) = (region.centre().0, region.half_diagonal());
            let radius = radius * (1.0 + 1e-9);
            let found = self.surface.closest_within(centre, near + radius, None);
            if found.1 != usize::MAX {
                let d = found.0.distance + radius;
                return Interval::new(-d, d);
            }
            let sign_changes_elsewhere = self.rim.is_some() || self.caps.is_some();
            let part = match joint {
                // The parts touch, and no surface is in them.
                Some(joint) if !sign_changes_elsewhere => joint,
                _ => self
                    .steady(centre, radius)
                    .map_or_else(|| self.bound(region), beyond),
            };
            let all = joint.map_or(part, |joint| joint.hull(part));
            if all.comes_within(near) {
                return all;
            }
            joint = Some(all);
        }
        joint.unwrap_or(Interval::ALL)
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.fill_within(lattice, f64::INFINITY, out);
    }

    fn fill_leaves(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        // What is moved is rounded otherwise.
        if leaves.by != 0.0 {
            return None;
        }
        for ((origin, values), bits) in leaves
            .origins
            .iter()
            .zip(leaves.values.iter_mut())
            .zip(leaves.bits.iter_mut())
        {
            let lattice = SampleLattice {
                origin: *origin,
                step: leaves.step,
                counts: [8; 3],
            };
            self.fill_within(&lattice, f64::from(leaves.background), values);
            *bits = LeafBits::look_at(values, leaves.background);
        }
        Some(512 * leaves.origins.len() as u64)
    }
}
