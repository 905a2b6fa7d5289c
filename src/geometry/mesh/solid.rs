//! A mesh as a solid: exact distance, sign by the winding number.
//!
//! A point is inside where the generalised winding number w exceeds 1/2. This definition also covers open,
//! self-intersecting and duplicated surfaces; for a closed surface the winding number is exact. The value is
//! the signed distance to the triangles; in a repaired mesh, parts that overlapping shells bury in the solid
//! do not count. It is 1-Lipschitz where the surface is closed. Across a hole, where w = 1/2 without a surface,
//! the sign changes away from the surface; bounds and bulk evaluation account for that.

use super::boundary_edges::BoundaryEdges;
use super::half_edges::HalfEdges;
use super::last_results::{self, MeshId};
use super::open_winding::OpenWinding;
use super::precision::Precision;
use super::soup::{ClosestPoint, Soup};
use super::unite::United;
use super::{TriMesh, crossing, lattice};
use crate::field::{Field, Interval, LeafBits, LeafParts, Leaves, SampleLattice, ValueLimits};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// A triangle mesh prepared for distance and inside tests; immutable and shared by threads.
///
/// A mesh without triangles is the empty solid: every point is outside, at infinite distance.
///
/// ```
/// # extern crate druse_geometry as druse;
/// use druse::{field::Field, frame::{Aabb, Vec3, WorldPoint}, mesh::{MeshSolid, TriMesh}};
/// let cube = MeshSolid::new(TriMesh::cuboid(&Aabb::of([[0.0; 3].into(), [2.0; 3].into()])));
/// assert_eq!(cube.value(WorldPoint(Vec3::new(1.0, 1.0, 0.25))), -0.25);
/// assert_eq!(cube.signed_distance(Vec3::new(5.0, 6.0, 1.0)), 5.0);
/// ```
pub struct MeshSolid {
    id: MeshId,
    mesh: TriMesh,
    bounds: Aabb,
    /// The triangles for distances.
    surface: Soup,
    /// The triangles for winding numbers, where they differ from the surface.
    winding_soup: Option<Soup>,
    /// Winding numbers of an open surface.
    open: Option<OpenWinding>,
    /// Triangles that count for the winding number only: there the sign may change away from the surface.
    caps: Option<Soup>,
    /// Triangles inside the solid, and the distance from them within which it has no crack.
    buried: Option<(Soup, f64)>,
    boundary: Option<BoundaryEdges>,
    precision: Precision,
}

/// Factor of radii and reaches, so that points on their rim count despite rounding.
const RIM_FACTOR: f64 = 1.0 + 1e-9;

/// Triangles with their numbers in the mesh.
pub(super) type NumberedTriangles = Vec<([Vec3; 3], u32)>;

/// The parts of a solid before assembly.
pub(super) struct SolidParts {
    pub(super) mesh: TriMesh,
    /// All triangles of the mesh.
    pub(super) winding_triangles: Soup,
    /// Winding data, if the triangles are no cycle.
    pub(super) open: Option<(OpenWinding, BoundaryEdges)>,
    /// The surface and the buried triangles, where the surface is not the whole mesh.
    pub(super) united: Option<United>,
}

impl MeshSolid {
    /// A solid whose surface is the whole mesh.
    pub fn new(mesh: TriMesh) -> Self {
        let caps = vec![false; mesh.triangles().len()];
        Self::with_caps(mesh, &caps)
    }

    /// A solid with caps: triangles that count for the inside test, but not for the distance. A cell trimmed
    /// at the faces of its element is such a mesh.
    ///
    /// # Panics
    /// When `is_cap` does not have one entry per triangle.
    pub fn with_caps(mesh: TriMesh, is_cap: &[bool]) -> Self {
        let merged = mesh.merged();
        let sides = HalfEdges::of(merged.triangles(), merged.vertices().len());
        let numbered: NumberedTriangles = mesh.iter_corners().zip(0u32..).collect();
        let winding_triangles = Soup::new(&numbered);
        let (vertices, boundary) = (merged.vertices(), sides.boundary());
        let open = OpenWinding::new(vertices, &boundary, &winding_triangles);
        let open = open.and_then(|open| {
            let boundary =
                BoundaryEdges::new(vertices, &boundary, open.spanning(&winding_triangles))?;
            Some((open, boundary))
        });
        let parts = SolidParts {
            mesh,
            winding_triangles,
            open,
            united: None,
        };
        Self::of_parts(parts, is_cap)
    }

    /// Assembles a solid. `is_cap` marks the triangles that count for the winding number only.
    ///
    /// # Panics
    /// When `is_cap` does not have one entry per triangle.
    pub(super) fn of_parts(parts: SolidParts, is_cap: &[bool]) -> Self {
        let SolidParts {
            mesh,
            winding_triangles,
            ..
        } = parts;
        assert_eq!(
            is_cap.len(),
            mesh.triangles().len(),
            "one flag per triangle"
        );
        let has_caps = is_cap.contains(&true);
        let part = |cap: bool| -> NumberedTriangles {
            let numbered = mesh.iter_corners().zip(0u32..);
            numbered.filter(|t| is_cap[t.1 as usize] == cap).collect()
        };
        let (open, boundary) = parts.open.unzip();
        // Distances are measured from the surface without caps and buried parts, winding numbers from all triangles.
        let is_surface = |t: &([Vec3; 3], u32)| !is_cap[t.1 as usize];
        let (surface, winding_soup, buried) = match parts.united {
            Some(united) => {
                let surface: NumberedTriangles =
                    united.surface.into_iter().filter(is_surface).collect();
                let buried = (Soup::new(&united.buried), united.side_offset);
                (Soup::new(&surface), Some(winding_triangles), Some(buried))
            }
            None if has_caps => (Soup::new(&part(false)), Some(winding_triangles), None),
            None => (winding_triangles, None, None),
        };
        let bounds = mesh.bounds();
        // As far beside the surface as `contains` tests for cracks.
        let gap = buried
            .as_ref()
            .map_or(0.0, |(_, side_offset)| 2.0 * side_offset);
        Self {
            id: MeshId::new(),
            precision: Precision::of(&bounds, gap),
            bounds,
            open,
            caps: has_caps.then(|| Soup::new(&part(true))),
            buried,
            boundary,
            mesh,
            surface,
            winding_soup,
        }
    }

    /// The volume, or `None` for an open surface, one with caps and one whose parts were united: that of the mesh is
    /// another one.
    pub fn volume(&self) -> Option<f64> {
        let is_whole = self.surface().count() == self.mesh.triangles().len();
        (self.is_cycle() && is_whole).then(|| self.mesh.volume())
    }

    /// The parts of the surface with the numbers of their triangles, without caps.
    #[doc(hidden)]
    pub fn surface(&self) -> impl Iterator<Item = ([Vec3; 3], u32)> + '_ {
        let numbers = self.surface.number.iter().copied();
        self.surface.corners.iter().copied().zip(numbers)
    }

    /// The mesh of the solid.
    pub fn mesh(&self) -> &TriMesh {
        &self.mesh
    }

    /// The bounding box of all triangles, caps included; it contains the solid.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Whether every half-edge has an opposite one: the winding number is then an integer away from the triangles.
    pub fn is_cycle(&self) -> bool {
        self.boundary.is_none()
    }

    /// The point of the surface nearest to `p`.
    pub fn closest(&self, p: Vec3) -> ClosestPoint {
        self.surface.closest(p, None).0
    }

    /// The point of the surface nearest to `p`, if it is within `radius`: faster than
    /// [`MeshSolid::closest`] far from the surface.
    pub fn closest_within(&self, p: Vec3, radius: f64) -> Option<ClosestPoint> {
        let found = self.surface.closest_within(p, radius, None).0;
        (found.triangle != u32::MAX).then_some(found)
    }

    /// As [`MeshSolid::closest_within`], restricted to some slots.
    #[doc(hidden)]
    pub fn closest_among(&self, slots: &[u32], p: Vec3, radius: f64) -> Option<ClosestPoint> {
        let found = self.surface.closest_among(slots, p, radius);
        (found.triangle != u32::MAX).then_some(found)
    }

    /// As [`MeshSolid::closest_among`] for several points: faster where they are close together.
    #[doc(hidden)]
    pub fn closest_among_all(
        &self,
        slots: &[u32],
        points: &[Vec3],
        radius: f64,
        closest: &mut [Option<ClosestPoint>],
    ) {
        let surface = &self.surface;
        surface.closest_among_all(slots, points, radius, closest);
    }

    /// Replaces `slots` by all triangles that may be nearer than `reach` to a box: they include the triangle
    /// closest to any point of the box, if it is within `reach`.
    #[doc(hidden)]
    pub fn collect(&self, region: &Aabb, reach: f64, slots: &mut Vec<u32>) {
        self.surface.collect(region, reach, slots);
    }

    /// Adds the slots of `among` that may be nearer than `reach` to a box to `slots`.
    #[doc(hidden)]
    pub fn collect_among(&self, among: &[u32], region: &Aabb, reach: f64, slots: &mut Vec<u32>) {
        self.surface.collect_among(among, region, reach, slots);
    }

    fn winding_triangles(&self) -> &Soup {
        self.winding_soup.as_ref().unwrap_or(&self.surface)
    }

    /// The generalised winding number at `p`: an exact integer for a cycle, otherwise within a few thousandths
    /// (groups of distant triangles are expanded).
    pub fn winding_number(&self, p: Vec3) -> f64 {
        let soup = self.winding_triangles();
        match &self.open {
            Some(open) => open.winding_number(soup, &self.bounds, p),
            None if !self.bounds.contains(WorldPoint(p)) => 0.0,
            None => crossing::winding(soup, &self.bounds, p) as f64,
        }
    }

    /// Whether `p` is inside: the winding number exceeds 1/2. Faces of united shells that touch up to rounding
    /// leave no crack.
    pub fn contains(&self, p: Vec3) -> bool {
        let is_inside = match &self.open {
            Some(open) => open.contains(self.winding_triangles(), &self.bounds, p),
            None => self.winding_number(p) > 0.5,
        };
        if is_inside {
            return true;
        }
        let Some((buried, side_offset)) = &self.buried else {
            return false;
        };
        let (nearest, slot) = buried.closest_within(p, *side_offset, None);
        if nearest.triangle == u32::MAX {
            return false;
        }
        // Both sides beyond the crack are inside.
        let [a, b, c] = buried.corners[slot];
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0);
        normal.is_some_and(|n| {
            let windings =
                [1.0, -1.0].map(|s| self.winding_number(p + n * (2.0 * s * side_offset)));
            windings.iter().all(|&w| w > 0.5)
        })
    }

    /// Distance to the surface, negative inside.
    pub fn signed_distance(&self, p: Vec3) -> f64 {
        let d = self.closest(p).distance;
        self.precision.signed(d, self.contains(p))
    }

    /// Signed distances of a lattice's samples that are nearer than `max_distance`, at least the step; other samples
    /// get a value of the correct sign and at least this magnitude. Returns the number of measured samples.
    fn fill_band(
        &self,
        lattice: &SampleLattice<WorldPoint>,
        max_distance: f64,
        out: &mut [f32],
    ) -> u64 {
        if lattice.is_empty() {
            return 0;
        }
        let span = lattice.span();
        let (centre, radius) = (span.centre().0, span.half_diagonal());
        let radius = radius * RIM_FACTOR;
        let nearest_to_centre = self
            .surface
            .closest_within(centre, max_distance + radius, None)
            .0;
        let bound = (nearest_to_centre.distance + radius).min(max_distance);
        let mut distances = vec![f64::INFINITY; lattice.len()];
        let mut measured = 0;
        if bound.is_finite() {
            let mut packs = Vec::new();
            let reach = bound * RIM_FACTOR;
            self.surface.collect_packs(&span, reach, &mut packs);
            measured =
                lattice::distances(&self.surface, &packs, lattice, max_distance, &mut distances);
        }
        let regular_sign = self.regular_sign(centre, radius);
        let slack = self.precision.slack;
        // Without a surface in a regular ball all samples have the sign of its centre.
        let inside_all = regular_sign.filter(|_| nearest_to_centre.distance > radius + slack);
        let signs = match inside_all {
            Some(inside) => vec![inside; lattice.len()],
            None => self.signs(lattice, regular_sign.is_some(), (&distances, max_distance)),
        };
        for ((out, d), inside) in out.iter_mut().zip(distances).zip(signs) {
            *out = self.precision.signed(d, inside) as f32;
        }
        measured as u64
    }

    /// Whether each sample of a lattice is inside, from its distances. Of a distance beyond `max_distance`, at least the
    /// step, no more is known than that. `is_regular`: the whole lattice is one regular block.
    ///
    /// No surface passes between two samples of a regular block whose distances from it add up to more than the distance
    /// between them: the sign goes from one to the other, along the axes in storage order. A sample less than half a step
    /// from the surface that no sign reaches so waits for the others, then tries its 26 neighbours. Where no sign arrives
    /// the winding number decides.
    fn signs(
        &self,
        lattice: &SampleLattice<WorldPoint>,
        is_regular: bool,
        (distances, max_distance): (&[f64], f64),
    ) -> Vec<bool> {
        let [nx, ny, nz] = lattice.counts;
        let blocks = self.regular_blocks(lattice, is_regular);
        // By the squared number of steps between two samples: 1 along an axis, 2 or 3 along a diagonal.
        let reach = [1.0, 2.0, 3.0]
            .map(|s: f64| lattice.step * s.sqrt() * RIM_FACTOR + self.precision.slack);
        let known = |n: usize| {
            if distances[n] < max_distance {
                distances[n]
            } else {
                max_distance
            }
        };
        let is_same_block = |m: usize, n: usize| blocks[m] != 0 && blocks[m] == blocks[n];
        let by_winding = |n: usize| self.contains(lattice.point(n).0);
        let index = |n: usize| [n / (ny * nz), n / nz % ny, n % nz];
        let strides = [ny * nz, nz, 1];
        let mut signs = vec![None; lattice.len()];
        let mut late = Vec::new();
        for n in 0..signs.len() {
            let at = index(n);
            let before = (0..3).filter(|&a| at[a] > 0).map(|a| n - strides[a]);
            let arrived = before
                .filter(|&m| is_same_block(m, n) && distances[m] + distances[n] > reach[0])
                .find_map(|m| signs[m]);
            if arrived.is_none() && 2.0 * distances[n] <= reach[0] {
                late.push(n);
                continue;
            }
            signs[n] = Some(arrived.unwrap_or_else(|| by_winding(n)));
        }
        for n in late {
            let [i, j, k] = index(n);
            let around = |i: usize, count: usize| i.saturating_sub(1)..(i + 2).min(count);
            let mut neighbours = around(i, nx).flat_map(|x| {
                around(j, ny).flat_map(move |y| around(k, nz).map(move |z| [x, y, z]))
            });
            let arrived = neighbours.find_map(|[x, y, z]| {
                let steps = x.abs_diff(i) + y.abs_diff(j) + z.abs_diff(k);
                let m = (x * ny + y) * nz + z;
                let is_free = || known(m) + known(n) > reach[steps - 1];
                signs[m].filter(|_| m != n && is_same_block(m, n) && is_free())
            });
            signs[n] = Some(arrived.unwrap_or_else(|| by_winding(n)));
        }
        signs
            .into_iter()
            .map(|inside| inside == Some(true))
            .collect()
    }

    /// Labels of regular blocks of a lattice's samples (see [`Self::regular_sign`]); label 0 marks samples in
    /// no regular block. With `is_single_block` all samples form one block.
    fn regular_blocks(
        &self,
        lattice: &SampleLattice<WorldPoint>,
        is_single_block: bool,
    ) -> Vec<u32> {
        let mut blocks = vec![u32::from(is_single_block); lattice.len()];
        if is_single_block {
            return blocks;
        }
        let [_, ny, nz] = lattice.counts;
        let mut block_count = 0;
        // Blocks of 4^3 samples, and of 2^3 where the larger ones fail.
        let start = [0, 1, 2].map(|a| (0..lattice.counts[a]).step_by(4));
        let mut pending = Vec::new();
        for x in start[0].clone() {
            for y in start[1].clone() {
                pending.extend(start[2].clone().map(|z| ([x, y, z], 4)));
            }
        }
        // A block that fails is divided once; parts that fail keep label 0.
        while let Some((from, size)) = pending.pop() {
            let to = [0, 1, 2].map(|a| (from[a] + size).min(lattice.counts[a]));
            let number = |[x, y, z]: [usize; 3]| (x * ny + y) * nz + z;
            let ends = [from, to.map(|c| c - 1)].map(|at| lattice.point(number(at)).0);
            let radius = (ends[1] - ends[0]).norm() / 2.0 * RIM_FACTOR;
            if self
                .regular_sign((ends[0] + ends[1]) / 2.0, radius)
                .is_some()
            {
                block_count += 1;
                for x in from[0]..to[0] {
                    for y in from[1]..to[1] {
                        blocks[number([x, y, from[2]])..=number([x, y, to[2] - 1])]
                            .fill(block_count);
                    }
                }
            } else if size == 4 {
                for n in 0..8 {
                    let part = [0, 1, 2].map(|a| from[a] + 2 * (n >> a & 1));
                    if (0..3).all(|a| part[a] < to[a]) {
                        pending.push((part, 2));
                    }
                }
            }
        }
        blocks
    }

    /// Whether `centre` is inside, if the ball of `radius` about it is regular: the sign changes in it at the
    /// surface only. `None` where a cap or the level w = 1/2 across a hole may be that near.
    fn regular_sign(&self, centre: Vec3, radius: f64) -> Option<bool> {
        let is_near = |caps: &Soup| caps.closest_within(centre, radius, None).1 != usize::MAX;
        if self.caps.as_ref().is_some_and(is_near) {
            return None;
        }
        let Some(boundary) = &self.boundary else {
            return Some(self.contains(centre));
        };
        // At the surface w jumps by integers: the fractional part of w must stay away from 1/2. A value of 0.5 fails.
        let winding_variation = boundary.winding_variation(centre, radius);
        let w = if winding_variation < 0.5 {
            self.winding_number(centre)
        } else {
            0.5
        };
        ((w - w.floor() - 0.5).abs() > winding_variation).then_some(w > 0.5)
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
        (self.precision.signed(c.distance, s < 0.0), gradient)
    }

    fn bound(&self, region: &Aabb) -> Interval {
        last_results::bound(self.id, region, || {
            let (centre, radius) = (region.centre().0, region.half_diagonal());
            let d = self.closest(centre).distance;
            match self.regular_sign(centre, radius) {
                Some(inside) => {
                    let v = if inside { -d } else { d };
                    Interval::new(v - radius, v + radius)
                }
                None => Interval::new(-d - radius, d + radius),
            }
        })
    }

    /// Bounds a leaf by its parts, each with the layer around it; stops at the first that may be within `max_distance`.
    fn leaf_bound(&self, parts: &LeafParts<Aabb>, max_distance: f64) -> Interval {
        let outside_band = |inside| {
            if inside {
                Interval::new(f64::NEG_INFINITY, -max_distance)
            } else {
                Interval::new(max_distance, f64::INFINITY)
            }
        };
        let mut hull: Option<Interval> = None;
        for region in &parts.wide {
            let (centre, radius) = (region.centre().0, region.half_diagonal());
            let radius = radius * RIM_FACTOR;
            let found = self
                .surface
                .closest_within(centre, max_distance + radius, None);
            if found.1 != usize::MAX {
                let d = found.0.distance + radius;
                return Interval::new(-d, d);
            }
            // No surface within reach of the part: only its sign is unknown.
            let sign_changes_elsewhere = self.boundary.is_some() || self.caps.is_some();
            let part = match hull {
                // The parts touch and contain no surface, so they share their sign.
                Some(hull) if !sign_changes_elsewhere => hull,
                _ => self
                    .regular_sign(centre, radius)
                    .map_or_else(|| self.bound(region), outside_band),
            };
            let joint = hull.map_or(part, |hull| hull.hull(part));
            if joint.may_be_within(max_distance) {
                return joint;
            }
            hull = Some(joint);
        }
        hull.unwrap_or(Interval::REAL_LINE)
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        last_results::fill(self.id, lattice, f64::INFINITY, out, |out| {
            self.fill_band(lattice, f64::INFINITY, out)
        });
    }

    fn fill_within(
        &self,
        lattice: &SampleLattice<WorldPoint>,
        limits: &ValueLimits,
        out: &mut [f32],
    ) -> u64 {
        let Some([low, high]) = limits.hull_of_all() else {
            return 0;
        };
        // Distances of less than a step show that samples have the sign of their neighbours.
        let max_distance = f64::from(high.max(-low)).max(lattice.step);
        last_results::fill(self.id, lattice, max_distance, out, |out| {
            self.fill_band(lattice, max_distance, out)
        })
    }

    fn fill_leaves(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        // An offset rounds differently.
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
            self.fill_band(&lattice, f64::from(leaves.background), values);
            *bits = LeafBits::from_values(values, leaves.background);
        }
        Some(512 * leaves.origins.len() as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The octahedron |x| + |y| + |z| <= radius, each face in `parts`^2 triangles.
    fn octahedron(radius: f64, parts: i32) -> MeshSolid {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for octant in 0..8 {
            let signs = [0, 1, 2].map(|a| if octant >> a & 1 == 0 { 1.0 } else { -1.0 });
            let corner = |i: i32, j: i32| {
                let shares = [i, j, parts - i - j].map(|n| f64::from(n) / f64::from(parts));
                Vec3::from([0, 1, 2].map(|a| signs[a] * shares[a] * radius))
            };
            let mut push = |mut corners: [Vec3; 3]| {
                if signs.iter().product::<f64>() < 0.0 {
                    corners.swap(1, 2);
                }
                let first = vertices.len() as u32;
                vertices.extend(corners);
                triangles.push([first, first + 1, first + 2]);
            };
            for (i, j) in (0..parts).flat_map(|i| (0..parts - i).map(move |j| (i, j))) {
                push([corner(i, j), corner(i + 1, j), corner(i, j + 1)]);
                if i + j + 1 < parts {
                    push([corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]);
                }
            }
        }
        MeshSolid::new(TriMesh::new(vertices, triangles).unwrap())
    }

    #[test]
    fn samples_near_oblique_faces_have_the_sign_of_the_closed_form() {
        // Along the axes these faces pass between most samples and their neighbours, and the distances of neighbours
        // along a diagonal are beyond those that are measured.
        let solid = octahedron(13.0, 26);
        for n in 0..200 {
            let share = |a: u32| f64::from(n * (7 + 4 * a) % 200) / 200.0;
            let origin = Vec3::new(
                3.0 * share(0) - 1.0,
                3.0 * share(1) - 1.0,
                2.0 + 5.0 * share(2),
            );
            let lattice = SampleLattice {
                origin: WorldPoint(origin),
                step: 1.0,
                counts: [8; 3],
            };
            for reach in [0.01, 1.2, 3.0f32] {
                let mut values = [0.0; 512];
                let limits = ValueLimits::uniform(512, [-reach, reach]);
                solid.fill_within(&lattice, &limits, &mut values);
                for (n, v) in values.into_iter().enumerate() {
                    let excess = lattice.point(n).0.abs().sum() - 13.0;
                    assert!(
                        excess.abs() < 1e-9 || v.is_sign_negative() == (excess < 0.0),
                        "{origin:?} {n}: {v}, {excess}"
                    );
                }
            }
        }
    }
}
