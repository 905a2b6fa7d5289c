//! The union of overlapping shells: the parts of triangles that separate inside from outside.
//!
//! The solid is the set where the winding number exceeds 1/2. Triangles of shells that overlap, or that lie in
//! others of the same orientation, may be buried in the solid: both of their sides are inside. A triangle that
//! others intersect is split along the intersections into convex parts. A part belongs to the surface if the
//! winding numbers just in front of it and just behind it differ in their inside test. Triangles without
//! intersection are classified once per connected region. The sign of a distance never depends on the
//! parts: it comes from the winding number of the whole mesh, so rounding in a split moves the surface by
//! rounding only. Where the mesh is open, only parts that are provably buried are removed.

use super::TriMesh;
use super::boundary_edges::BoundaryEdges;
use super::crossing;
use super::half_edges::HalfEdges;
use super::open_winding::OpenWinding;
use super::shells::{COPLANAR_TOLERANCE_RATIO, Nesting, Shells};
use super::soup::Soup;
use crate::frame::{Aabb, Vec3, WorldPoint};
use crate::union_find::UnionFind;
use rayon::prelude::*;

/// Distance from a part at which the winding number is evaluated, relative to the greatest coordinate. It
/// exceeds single-precision rounding, so that touching faces leave no crack.
const SIDE_OFFSET_RATIO: f64 = 1e-6;

/// The same distance for a shell that touches no other, over that: its own walls may be closer together.
const UNTOUCHED_OFFSET_SHARE: f64 = 1e-4;

/// The result of [`unite`].
pub(crate) struct United {
    /// Parts of the surface with the numbers of their triangles.
    pub(crate) surface: Vec<([Vec3; 3], u32)>,
    /// Triangles that lie at least partly inside the solid.
    pub(crate) buried: Vec<([Vec3; 3], u32)>,
    /// Distance from buried triangles within which the solid has no crack.
    pub(crate) side_offset: f64,
    /// Shells that overlap others or lie in them.
    pub(crate) shells: usize,
}

/// The class of one triangle.
enum Classification {
    /// Without intersection: its region decides.
    Uncut,
    /// Without area.
    Degenerate,
    Surface,
    Buried,
    /// Partly buried: the remaining triangles.
    Cut(Vec<[Vec3; 3]>),
}

/// The surface of some triangles; `None` where nothing is buried. `soup` contains the triangles of the merged `mesh` by
/// number; `open` is required if they are no cycle. With `is_thorough` a shell that meets no other may also bury parts
/// of itself. `sides` are the half-edges of `mesh`, in which equal corners are merged; lengths are world units.
pub(crate) fn unite(
    mesh: &TriMesh,
    sides: &HalfEdges,
    shells: &Shells,
    nesting: &Nesting,
    soup: &Soup,
    open: Option<(&OpenWinding, &BoundaryEdges)>,
    is_thorough: bool,
) -> Option<United> {
    // Shells apart bury nothing.
    if !is_thorough && !nesting.meets.contains(&true) {
        return None;
    }
    let bounds = mesh.bounds();
    let size = bounds.min.amax().max(bounds.max.amax());
    let tolerance = COPLANAR_TOLERANCE_RATIO * size;
    let touches = if is_thorough {
        vec![true; shells.count]
    } else {
        touching_shells(mesh, shells, nesting, soup, tolerance)
    };
    let classifier = Classifier {
        mesh,
        shells,
        nesting,
        is_thorough,
        soup,
        open,
        bounds,
        side_offset: SIDE_OFFSET_RATIO * size,
        tolerance,
        touches,
    };
    // Each triangle by itself, in tasks of many, since most take no time; then the uncut ones by region.
    let classes: Vec<Classification> = (0..mesh.triangles().len())
        .into_par_iter()
        .with_min_len(64)
        .map(|t| classifier.classify(t))
        .collect();
    let is_uncut_or_degenerate =
        |c: &Classification| matches!(c, Classification::Uncut | Classification::Degenerate);
    // One open shell whose triangles meet no others buries nothing.
    if open.is_some() && shells.count == 1 && classes.iter().all(is_uncut_or_degenerate) {
        return None;
    }
    let is_surface = classifier.surface_flags(&classes, sides);
    let mut union = United {
        surface: Vec::new(),
        buried: Vec::new(),
        side_offset: classifier.side_offset,
        shells: 0,
    };
    let mut is_involved = vec![false; shells.count];
    // A cut triangle gives its parts to the surface; as a whole it counts as buried.
    for ((t, class), is_surface) in (0u32..).zip(&classes).zip(is_surface) {
        let corners = mesh.corners(t as usize);
        match class {
            Classification::Cut(parts) => {
                union.surface.extend(parts.iter().map(|&p| (p, t)));
                union.buried.push((corners, t));
                is_involved[shells.of[t as usize] as usize] = true;
            }
            Classification::Degenerate => {}
            _ if is_surface => union.surface.push((corners, t)),
            _ => {
                union.buried.push((corners, t));
                is_involved[shells.of[t as usize] as usize] = true;
            }
        }
    }
    if union.buried.is_empty() {
        return None;
    }
    // A shell around a buried one overlaps it.
    for s in 0..shells.count {
        if is_involved[s] {
            for &w in &nesting.within[s] {
                is_involved[w as usize] = true;
            }
        }
    }
    union.shells = is_involved.iter().filter(|i| **i).count();
    Some(union)
}

/// Whether the box of a triangle of each shell touches that of a triangle of another one. A shell that lies in another
/// touches it seldom; its own triangles may be close together, and are no contact. Boxes touch within `tolerance`,
/// world units.
fn touching_shells(
    mesh: &TriMesh,
    shells: &Shells,
    nesting: &Nesting,
    soup: &Soup,
    tolerance: f64,
) -> Vec<bool> {
    // Only shells whose boxes meet those of others are searched, each triangle up to the first box of another shell.
    let touches_another = |t: &usize| {
        let shell = shells.of[*t];
        let region = Aabb::of(mesh.corners(*t)).dilated(tolerance);
        let mut found = false;
        if nesting.meets[shell as usize] {
            soup.bvh.overlapping(&region, |slot| {
                let is_other = shells.of[soup.number[slot] as usize] != shell;
                found = is_other && Aabb::of(soup.corners[slot]).meets(region);
                !found
            });
        }
        found
    };
    let triangles = (0..mesh.triangles().len()).into_par_iter().with_min_len(64);
    let touching: Vec<usize> = triangles.filter(touches_another).collect();
    let mut touches = vec![false; shells.count];
    for t in touching {
        touches[shells.of[t] as usize] = true;
    }
    touches
}

/// Classifies triangles as surface or buried.
struct Classifier<'a> {
    mesh: &'a TriMesh,
    shells: &'a Shells,
    nesting: &'a Nesting,
    /// Whether shells that meet no other may bury parts of themselves.
    is_thorough: bool,
    soup: &'a Soup,
    open: Option<(&'a OpenWinding, &'a BoundaryEdges)>,
    bounds: Aabb,
    side_offset: f64,
    tolerance: f64,
    /// Whether triangles of each shell may intersect others.
    touches: Vec<bool>,
}

impl Classifier<'_> {
    /// Whether a shell may have parts in others, or intersect them.
    fn may_meet(&self, shell: u32) -> bool {
        self.is_thorough || self.nesting.meets[shell as usize]
    }

    /// Classifies triangle `t`: it is cut along the segments in which others intersect it, and each part is tested.
    /// Nothing changes; a degenerate triangle is skipped, one without intersections is left to its region.
    fn classify(&self, t: usize) -> Classification {
        let shell = self.shells.of[t];
        let corners = self.mesh.corners(t);
        let Some(plane) = Plane::of(&corners) else {
            return Classification::Degenerate;
        };
        if !self.touches[shell as usize] {
            return Classification::Uncut;
        }
        let region = Aabb::of(corners).dilated(self.tolerance);
        let tri = self.mesh.triangles()[t];
        let mut segments = Vec::new();
        let mut is_alone_in_plane = true;
        self.soup.bvh.overlapping(&region, |slot| {
            let number = self.soup.number[slot] as usize;
            let other = &self.soup.corners[slot];
            // Neighbours within a shell share corners; that is no intersection.
            let is_neighbour = self.shells.of[number] == shell
                && self.mesh.triangles()[number]
                    .iter()
                    .any(|v| tri.contains(v));
            if !is_neighbour && Aabb::of(*other).meets(region) {
                is_alone_in_plane &= plane.add_intersection(other, self.tolerance, &mut segments);
            }
            true
        });
        let triangle: Vec<[f64; 2]> = corners.iter().map(|&c| plane.project(c)).collect();
        segments.retain_mut(|s| clip_segment(&triangle, s, self.tolerance));
        if segments.is_empty() {
            return Classification::Uncut;
        }
        // Each convex part is inside or outside on both of its sides as a whole: its centre decides.
        let parts = split_polygon(triangle, segments, self.tolerance);
        let classified: Vec<(Vec<[f64; 2]>, bool)> = parts
            .into_iter()
            .map(|p| {
                let centre = centroid(&p);
                let away = p.iter().map(|c| (c[0] - centre[0]).hypot(c[1] - centre[1]));
                let radius = away.fold(0.0, f64::max);
                let is_surface = self.is_surface(
                    plane.point(centre),
                    radius,
                    plane.normal,
                    shell,
                    is_alone_in_plane,
                );
                (p, is_surface)
            })
            .collect();
        if classified.iter().all(|p| p.1) {
            return Classification::Surface;
        }
        if classified.iter().all(|p| !p.1) {
            return Classification::Buried;
        }
        let mut triangles = Vec::new();
        for (part, _) in classified.iter().filter(|p| p.1) {
            let points: Vec<Vec3> = part.iter().map(|&p| plane.point(p)).collect();
            triangles.extend((2..points.len()).map(|i| [points[0], points[i - 1], points[i]]));
        }
        Classification::Cut(triangles)
    }

    /// The winding number of the whole mesh.
    fn winding(&self, q: Vec3) -> f64 {
        if let Some((open, _)) = self.open {
            open.winding_number(self.soup, &self.bounds, q)
        } else if self.bounds.contains(WorldPoint(q)) {
            crossing::winding(self.soup, &self.bounds, q) as f64
        } else {
            0.0
        }
    }

    /// Whether a part of a triangle, with a radius about `p`, separates inside from outside. Where no other triangle
    /// lies in its plane (`is_alone_in_plane`), the winding number in front is that behind minus 1. `p` is a point of
    /// the part, `radius` bounds its extent about `p` (world units), `normal` is the unit normal, `shell` the
    /// triangle's shell.
    fn is_surface(
        &self,
        p: Vec3,
        radius: f64,
        normal: Vec3,
        shell: u32,
        is_alone_in_plane: bool,
    ) -> bool {
        let is_untouched = self.open.is_none() && !self.touches[shell as usize];
        let share = if is_untouched {
            UNTOUCHED_OFFSET_SHARE
        } else {
            1.0
        };
        let winding = |side: f64| self.winding(p + normal * (side * share * self.side_offset));
        let behind = winding(-1.0);
        if let Some((_, boundary)) = self.open {
            // Buried only if inside on both sides at every point of the part.
            return behind.min(winding(1.0)) - boundary.winding_variation(p, radius) <= 0.5;
        }
        if is_alone_in_plane {
            // 1 behind and 0 in front: the only way across 1/2 with a jump of 1.
            return behind == 1.0;
        }
        (behind > 0.5) != (winding(1.0) > 0.5)
    }

    /// As [`Self::is_surface`], for a whole triangle.
    fn is_uncut_surface(&self, t: usize) -> bool {
        let corners = self.mesh.corners(t);
        let [a, b, c] = corners;
        let centroid = (a + b + c) / 3.0;
        let away = corners.iter().map(|p| (p - centroid).norm());
        let radius = away.fold(0.0, f64::max);
        Plane::of(&corners).is_none_or(|plane| {
            self.is_surface(centroid, radius, plane.normal, self.shells.of[t], false)
        })
    }

    /// Whether each triangle belongs to the surface. Triangles without intersection are classified by region, or one by
    /// one where the mesh is open. One flag per triangle, in the order of `classes`.
    fn surface_flags(&self, classes: &[Classification], sides: &HalfEdges) -> Vec<bool> {
        let is_uncut = |t: u32| matches!(classes[t as usize], Classification::Uncut);
        if self.open.is_some() {
            let is_surface = |t: usize| match classes[t] {
                Classification::Buried | Classification::Degenerate => false,
                Classification::Uncut => {
                    !self.may_meet(self.shells.of[t]) || self.is_uncut_surface(t)
                }
                Classification::Surface | Classification::Cut(_) => true,
            };
            return (0..classes.len()).into_par_iter().map(is_surface).collect();
        }
        // Regions: uncut triangles connected through edges of two. Nothing crosses them, so all are alike.
        let mut sets = UnionFind::new(classes.len());
        for edge in sides.edges() {
            if let [s, t] = edge
                && is_uncut(s.triangle())
                && is_uncut(t.triangle())
            {
                sets.union(s.triangle() as usize, t.triangle() as usize);
            }
        }
        // The largest triangle decides for its region.
        let (region, count) = sets.labels(0..classes.len());
        let mut largest = vec![(0.0, u32::MAX); count];
        for (t, [a, b, c]) in self.mesh.iter_corners().enumerate() {
            let area = (b - a).cross(&(c - a)).norm();
            let best = &mut largest[region[t] as usize];
            if area > best.0 {
                *best = (area, t as u32);
            }
        }
        let surface: Vec<bool> = largest
            .par_iter()
            .map(|&(_, t)| {
                // The flag of a region without uncut triangles is not read.
                if t == u32::MAX || !is_uncut(t) {
                    return true;
                }
                !self.may_meet(self.shells.of[t as usize]) || self.is_uncut_surface(t as usize)
            })
            .collect();
        classes
            .iter()
            .zip(region)
            .map(|(class, region)| match class {
                Classification::Buried | Classification::Degenerate => false,
                Classification::Uncut => surface[region as usize],
                Classification::Surface | Classification::Cut(_) => true,
            })
            .collect()
    }
}

/// The plane of a triangle with orthonormal axes.
struct Plane {
    origin: Vec3,
    normal: Vec3,
    axes: [Vec3; 2],
}

impl Plane {
    /// `None` for a triangle without area.
    fn of(&[a, b, c]: &[Vec3; 3]) -> Option<Self> {
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
        let first = (b - a).try_normalize(0.0)?;
        Some(Self {
            origin: a,
            normal,
            axes: [first, normal.cross(&first)],
        })
    }

    /// Coordinates in the plane.
    fn project(&self, p: Vec3) -> [f64; 2] {
        self.axes.map(|a| a.dot(&(p - self.origin)))
    }

    /// The point with these coordinates.
    fn point(&self, [u, v]: [f64; 2]) -> Vec3 {
        self.origin + self.axes[0] * u + self.axes[1] * v
    }

    /// Adds the segments in which a triangle intersects the plane: all its sides if it is coplanar. Corners within
    /// `tolerance`, world units, lie in the plane. Returns whether the triangle is not coplanar.
    fn add_intersection(
        &self,
        other: &[Vec3; 3],
        tolerance: f64,
        segments: &mut Vec<[[f64; 2]; 2]>,
    ) -> bool {
        let heights = other.map(|p| {
            let h = self.normal.dot(&(p - self.origin));
            if h.abs() <= tolerance { 0.0 } else { h }
        });
        if heights.iter().all(|&h| h > 0.0) || heights.iter().all(|&h| h < 0.0) {
            return true;
        }
        let project = other.map(|p| self.project(p));
        let mut points: Vec<[f64; 2]> = Vec::with_capacity(3);
        // A corner in the plane, or a side that crosses it.
        for i in 0..3 {
            let j = (i + 1) % 3;
            if heights[i] == 0.0 {
                points.push(project[i]);
            }
            if heights[i] * heights[j] < 0.0 {
                let fraction = heights[i] / (heights[i] - heights[j]);
                points.push(
                    [0, 1].map(|k| project[i][k] + (project[j][k] - project[i][k]) * fraction),
                );
            }
        }
        // One point alone is no segment: the triangle touches the plane.
        match points[..] {
            [a, b] => segments.push([a, b]),
            [a, b, c] => segments.extend([[a, b], [b, c], [c, a]]),
            _ => {}
        }
        heights != [0.0; 3]
    }
}

/// The signed distance of c from the line a b, positive to its left.
fn height([a, b]: [[f64; 2]; 2], c: [f64; 2]) -> f64 {
    let (x, y) = (b[0] - a[0], b[1] - a[1]);
    (x * (c[1] - a[1]) - y * (c[0] - a[0])) / x.hypot(y)
}

/// Clips a segment to a convex polygon; returns whether more than `tolerance` of its length remains. The polygon is
/// counter-clockwise; heights over its sides are positive inside.
fn clip_segment(polygon: &[[f64; 2]], segment: &mut [[f64; 2]; 2], tolerance: f64) -> bool {
    for i in 0..polygon.len() {
        let [a, b] = [polygon[i], polygon[(i + 1) % polygon.len()]];
        // Rounding decides where the side of two splits that meet, shorter than that, points.
        if (b[0] - a[0]).hypot(b[1] - a[1]) <= tolerance {
            continue;
        }
        let heights = segment.map(|p| height([a, b], p));
        if heights.iter().all(|&h| h < -tolerance) {
            return false;
        }
        for k in 0..2 {
            if heights[k] < -tolerance && heights[1 - k] > heights[k] {
                let fraction = ((-heights[k]) / (heights[1 - k] - heights[k])).min(1.0);
                let (p, q) = (segment[k], segment[1 - k]);
                segment[k] = [0, 1].map(|a| p[a] + (q[a] - p[a]) * fraction);
            }
        }
    }
    let [a, b] = *segment;
    (b[0] - a[0]).hypot(b[1] - a[1]) > tolerance
}

/// Splits a convex polygon into convex parts that no segment crosses. Crossings shallower than `tolerance`, world
/// units, do not split. Both consist of points in the triangle's plane. The parts have no fixed order.
fn split_polygon(
    polygon: Vec<[f64; 2]>,
    segments: Vec<[[f64; 2]; 2]>,
    tolerance: f64,
) -> Vec<Vec<[f64; 2]>> {
    let mut convex_parts = Vec::new();
    let mut pending = vec![(polygon, segments)];
    while let Some((polygon, mut segments)) = pending.pop() {
        let mut split = None;
        while !segments.is_empty() {
            // Start in the middle: splits in order along a curve would produce a chain of slivers.
            let line = segments.swap_remove(segments.len() / 2);
            let heights: Vec<f64> = polygon.iter().map(|&p| height(line, p)).collect();
            let highest = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let lowest = heights.iter().copied().fold(f64::INFINITY, f64::min);
            if highest > tolerance && lowest < -tolerance {
                split = Some((line, heights));
                break;
            }
        }
        let Some((line, heights)) = split else {
            convex_parts.push(polygon);
            continue;
        };
        for sign in [1.0, -1.0] {
            let part = clip_half_plane(&polygon, &heights, sign);
            let inside: Vec<[[f64; 2]; 2]> = segments
                .iter()
                .filter(|s| s.iter().any(|&p| sign * height(line, p) > tolerance))
                .filter_map(|s| {
                    let mut s = *s;
                    clip_segment(&part, &mut s, tolerance).then_some(s)
                })
                .collect();
            pending.push((part, inside));
        }
    }
    convex_parts
}

/// The part of a convex polygon on one side of a line, given the heights of its corners over the line.
fn clip_half_plane(polygon: &[[f64; 2]], heights: &[f64], sign: f64) -> Vec<[f64; 2]> {
    let mut part = Vec::with_capacity(polygon.len() + 1);
    for i in 0..polygon.len() {
        let j = (i + 1) % polygon.len();
        let (p, q, h, k) = (polygon[i], polygon[j], sign * heights[i], sign * heights[j]);
        if h >= 0.0 {
            part.push(p);
        }
        if (h > 0.0 && k < 0.0) || (h < 0.0 && k > 0.0) {
            let fraction = h / (h - k);
            part.push([0, 1].map(|a| p[a] + (q[a] - p[a]) * fraction));
        }
    }
    part
}

/// The centroid of a convex polygon.
fn centroid(polygon: &[[f64; 2]]) -> [f64; 2] {
    let first = polygon[0];
    let (mut area, mut sum) = (0.0, [0.0; 2]);
    for pair in polygon[1..].windows(2) {
        let [p, q] = [pair[0], pair[1]].map(|c| [c[0] - first[0], c[1] - first[1]]);
        let double_area = p[0] * q[1] - p[1] * q[0];
        area += double_area;
        for a in 0..2 {
            sum[a] += double_area * (p[a] + q[a]) / 3.0;
        }
    }
    if area == 0.0 {
        return first;
    }
    [0, 1].map(|a| first[a] + sum[a] / area)
}
