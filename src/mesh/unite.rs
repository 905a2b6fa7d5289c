//! The surface of overlapping shells: the parts of triangles across which inside and outside change.
//!
//! The solid is where the winding number exceeds 1/2. Triangles of shells that overlap, or lie in others
//! wound alike, may be buried in the solid: both of their sides are inside. Each triangle that others
//! meet is cut along the segments where they do, into convex pieces that none of them crosses; each piece
//! is kept or not by the winding numbers a hair in front of it and behind it. Triangles that no other
//! meets are judged once per connected region. The sign of a distance never depends on the pieces: it
//! comes from the winding number of the whole mesh, so that an error of rounding in a cut moves the
//! surface by rounding only. Where the mesh is open, only what the winding number proves to be buried is
//! left out.

use super::TriMesh;
use super::boundary_edges::Rim;
use super::crossing;
use super::open_winding::Open;
use super::shells::{Nesting, Shells};
use super::sides::HalfEdges;
use super::soup::Soup;
use crate::frame::{Aabb, Vec3, WorldPoint};
use crate::union_find::Sets;
use rayon::prelude::*;

/// Distance from a piece at which inside is decided, relative to the greatest coordinate: more than single
/// precision rounds, so that faces that touch are no crack.
const HAIR: f64 = 1e-6;
/// Distance below which a corner lies in a plane, relative to the greatest coordinate.
const COPLANAR: f64 = 2.5e-7;

/// What a union left of the triangles.
pub(crate) struct United {
    /// Pieces of the surface with the numbers of their triangles.
    pub(crate) surface: Vec<([Vec3; 3], u32)>,
    /// Triangles of which at least a part is inside the solid.
    pub(crate) buried: Vec<([Vec3; 3], u32)>,
    /// Distance from buried parts within which the solid has no crack.
    pub(crate) hair: f64,
    /// Shells that overlap others or lie in them.
    pub(crate) shells: usize,
}

/// What becomes of one triangle.
enum Fate {
    /// No other meets it: as its region.
    Whole,
    /// It has no area.
    Flat,
    Kept,
    Buried,
    /// What is left of it.
    Cut(Vec<[Vec3; 3]>),
}

/// The surface of some triangles; `None` where nothing is buried. `soup` holds the triangles of `mesh`, a
/// merged one, by their numbers; `open` is what they need if they are no cycle.
pub(crate) fn unite(
    mesh: &TriMesh,
    sides: &HalfEdges,
    shells: &Shells,
    nesting: &Nesting,
    soup: &Soup,
    open: Option<(&Open, &Rim)>,
    is_thorough: bool,
) -> Option<United> {
    if !is_thorough && !nesting.meets.contains(&true) {
        return None;
    }
    let bounds = mesh.bounds();
    let size = bounds.min.amax().max(bounds.max.amax());
    let tools = Tools {
        mesh,
        shells,
        nesting,
        is_thorough,
        soup,
        open,
        bounds,
        hair: HAIR * size,
        tolerance: COPLANAR * size,
    };
    let fates: Vec<Fate> = (0..mesh.triangles().len())
        .into_par_iter()
        .with_min_len(64)
        .map(|t| tools.fate(t))
        .collect();
    let meets_none = |f: &Fate| matches!(f, Fate::Whole | Fate::Flat);
    if open.is_some() && shells.count == 1 && fates.iter().all(meets_none) {
        return None;
    }
    let kept = tools.regions(&fates, sides);
    let mut united = United {
        surface: Vec::new(),
        buried: Vec::new(),
        hair: tools.hair,
        shells: 0,
    };
    let mut involved = vec![false; shells.count];
    for ((t, fate), kept) in (0u32..).zip(&fates).zip(kept) {
        let corners = mesh.corners(t as usize);
        match fate {
            Fate::Cut(pieces) => {
                united.surface.extend(pieces.iter().map(|&p| (p, t)));
                united.buried.push((corners, t));
                involved[shells.of[t as usize] as usize] = true;
            }
            Fate::Flat => {}
            _ if kept => united.surface.push((corners, t)),
            _ => {
                united.buried.push((corners, t));
                involved[shells.of[t as usize] as usize] = true;
            }
        }
    }
    if united.buried.is_empty() {
        return None;
    }
    // A shell that holds buried ones overlaps them.
    for s in 0..shells.count {
        if involved[s] {
            for &w in &nesting.within[s] {
                involved[w as usize] = true;
            }
        }
    }
    united.shells = involved.iter().filter(|i| **i).count();
    Some(united)
}

struct Tools<'a> {
    mesh: &'a TriMesh,
    shells: &'a Shells,
    nesting: &'a Nesting,
    /// Whether shells that meet no other may bury parts of themselves.
    is_thorough: bool,
    soup: &'a Soup,
    open: Option<(&'a Open, &'a Rim)>,
    bounds: Aabb,
    hair: f64,
    tolerance: f64,
}

impl Tools<'_> {
    fn may_meet(&self, shell: u32) -> bool {
        self.is_thorough || self.nesting.meets[shell as usize]
    }

    fn fate(&self, t: usize) -> Fate {
        let own = self.shells.of[t];
        let corners = self.mesh.corners(t);
        let Some(plane) = Plane::of(&corners) else {
            return Fate::Flat;
        };
        if !self.may_meet(own) {
            return Fate::Whole;
        }
        let region = Aabb::of(corners).dilated(self.tolerance);
        let tri = self.mesh.triangles()[t];
        let mut segments = Vec::new();
        let mut is_plain = true;
        self.soup.bvh.overlapping(&region, |slot| {
            let number = self.soup.number[slot] as usize;
            let other = &self.soup.corners[slot];
            // Neighbours within a shell meet where they should.
            let is_neighbour = self.shells.of[number] == own
                && self.mesh.triangles()[number]
                    .iter()
                    .any(|v| tri.contains(v));
            if !is_neighbour && Aabb::of(*other).meets(region) {
                is_plain &= plane.meeting(other, self.tolerance, &mut segments);
            }
            true
        });
        let whole: Vec<[f64; 2]> = corners.iter().map(|&c| plane.flat(c)).collect();
        segments.retain_mut(|s| clip(&whole, s, self.tolerance));
        if segments.is_empty() {
            return Fate::Whole;
        }
        let pieces = cut(whole, segments, self.tolerance);
        let judged: Vec<(Vec<[f64; 2]>, bool)> = pieces
            .into_iter()
            .map(|p| {
                let centre = middle(&p);
                let away = p.iter().map(|c| (c[0] - centre[0]).hypot(c[1] - centre[1]));
                let radius = away.fold(0.0, f64::max);
                let kept = self.is_surface(plane.point(centre), plane.normal, radius, is_plain);
                (p, kept)
            })
            .collect();
        if judged.iter().all(|p| p.1) {
            return Fate::Kept;
        }
        if judged.iter().all(|p| !p.1) {
            return Fate::Buried;
        }
        let mut left = Vec::new();
        for (piece, _) in judged.iter().filter(|p| p.1) {
            let points: Vec<Vec3> = piece.iter().map(|&p| plane.point(p)).collect();
            left.extend((2..points.len()).map(|i| [points[0], points[i - 1], points[i]]));
        }
        Fate::Cut(left)
    }

    fn winding(&self, q: Vec3) -> f64 {
        if let Some((open, _)) = self.open {
            open.winding_number(self.soup, &self.bounds, q)
        } else if self.bounds.contains(WorldPoint(q)) {
            crossing::winding(self.soup, &self.bounds, q) as f64
        } else {
            0.0
        }
    }

    /// Whether inside and outside change across a piece of a triangle, of a radius about `p`. Where no other
    /// triangle lies in its plane (`is_plain`), the winding number before it is one less than that behind.
    fn is_surface(&self, p: Vec3, normal: Vec3, radius: f64, is_plain: bool) -> bool {
        let winding = |side: f64| self.winding(p + normal * (side * self.hair));
        let behind = winding(-1.0);
        if let Some((_, rim)) = self.open {
            // Inside on both sides, at every point of the piece.
            return behind.min(winding(1.0)) - rim.drift(p, radius) <= 0.5;
        }
        if is_plain {
            return behind == 1.0;
        }
        (behind > 0.5) != (winding(1.0) > 0.5)
    }

    /// The same of a whole triangle.
    fn is_surface_whole(&self, t: usize) -> bool {
        let corners = self.mesh.corners(t);
        let [a, b, c] = corners;
        let middle = (a + b + c) / 3.0;
        let away = corners.iter().map(|p| (p - middle).norm());
        let radius = away.fold(0.0, f64::max);
        Plane::of(&corners).is_none_or(|plane| self.is_surface(middle, plane.normal, radius, false))
    }

    /// Whether each triangle that is not cut is surface: those that no other meets as one of their region,
    /// or one by one where the mesh is open.
    fn regions(&self, fates: &[Fate], sides: &HalfEdges) -> Vec<bool> {
        let is_whole = |t: u32| matches!(fates[t as usize], Fate::Whole);
        if self.open.is_some() {
            let single = |t: usize| match fates[t] {
                Fate::Buried | Fate::Flat => false,
                Fate::Whole => !self.may_meet(self.shells.of[t]) || self.is_surface_whole(t),
                Fate::Kept | Fate::Cut(_) => true,
            };
            return (0..fates.len()).into_par_iter().map(single).collect();
        }
        let mut sets = Sets::new(fates.len());
        for edge in sides.edges() {
            if let [s, t] = edge
                && is_whole(s.triangle())
                && is_whole(t.triangle())
            {
                sets.join(s.triangle() as usize, t.triangle() as usize);
            }
        }
        // Each region is judged at its largest triangle.
        let (region, count) = sets.numbered(0..fates.len());
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
                if t == u32::MAX || !is_whole(t) {
                    return true;
                }
                !self.may_meet(self.shells.of[t as usize]) || self.is_surface_whole(t as usize)
            })
            .collect();
        fates
            .iter()
            .zip(region)
            .map(|(fate, region)| match fate {
                Fate::Buried | Fate::Flat => false,
                Fate::Whole => surface[region as usize],
                Fate::Kept | Fate::Cut(_) => true,
            })
            .collect()
    }
}

/// The plane of a triangle, with coordinates in it.
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

    fn flat(&self, p: Vec3) -> [f64; 2] {
        self.axes.map(|a| a.dot(&(p - self.origin)))
    }

    fn point(&self, [u, v]: [f64; 2]) -> Vec3 {
        self.origin + self.axes[0] * u + self.axes[1] * v
    }

    /// Adds the segments in which another triangle meets the plane: all its sides if it lies in it; whether
    /// it does not.
    fn meeting(
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
        let flat = other.map(|p| self.flat(p));
        let mut ends: Vec<[f64; 2]> = Vec::with_capacity(3);
        for i in 0..3 {
            let j = (i + 1) % 3;
            if heights[i] == 0.0 {
                ends.push(flat[i]);
            }
            if heights[i] * heights[j] < 0.0 {
                let share = heights[i] / (heights[i] - heights[j]);
                ends.push([0, 1].map(|k| flat[i][k] + (flat[j][k] - flat[i][k]) * share));
            }
        }
        match ends[..] {
            [a, b] => segments.push([a, b]),
            [a, b, c] => segments.extend([[a, b], [b, c], [c, a]]),
            _ => {}
        }
        heights != [0.0; 3]
    }
}

/// Twice the area of a, b, c over the length of a b: the height of c over the line, to the left positive.
fn height([a, b]: [[f64; 2]; 2], c: [f64; 2]) -> f64 {
    let (x, y) = (b[0] - a[0], b[1] - a[1]);
    (x * (c[1] - a[1]) - y * (c[0] - a[0])) / x.hypot(y)
}

/// Clips a segment to a convex polygon; whether more than a point of the tolerance's size is left.
fn clip(polygon: &[[f64; 2]], segment: &mut [[f64; 2]; 2], tolerance: f64) -> bool {
    for i in 0..polygon.len() {
        let side = [polygon[i], polygon[(i + 1) % polygon.len()]];
        let heights = segment.map(|p| height(side, p));
        if heights.iter().any(|h| h.is_nan()) {
            continue;
        }
        if heights.iter().all(|&h| h < -tolerance) {
            return false;
        }
        for k in 0..2 {
            if heights[k] < -tolerance && heights[1 - k] > heights[k] {
                let share = ((-heights[k]) / (heights[1 - k] - heights[k])).min(1.0);
                let (p, q) = (segment[k], segment[1 - k]);
                segment[k] = [0, 1].map(|a| p[a] + (q[a] - p[a]) * share);
            }
        }
    }
    let [a, b] = *segment;
    (b[0] - a[0]).hypot(b[1] - a[1]) > tolerance
}

/// Cuts a convex polygon into convex pieces that no segment crosses.
fn cut(polygon: Vec<[f64; 2]>, segments: Vec<[[f64; 2]; 2]>, tolerance: f64) -> Vec<Vec<[f64; 2]>> {
    let mut done = Vec::new();
    let mut waiting = vec![(polygon, segments)];
    while let Some((polygon, mut segments)) = waiting.pop() {
        let mut split = None;
        while !segments.is_empty() {
            // From the middle: cuts in order along a curve would make a chain of slivers.
            let line = segments.swap_remove(segments.len() / 2);
            let heights: Vec<f64> = polygon.iter().map(|&p| height(line, p)).collect();
            let most = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let least = heights.iter().copied().fold(f64::INFINITY, f64::min);
            if most > tolerance && least < -tolerance {
                split = Some((line, heights));
                break;
            }
        }
        let Some((line, heights)) = split else {
            done.push(polygon);
            continue;
        };
        for sign in [1.0, -1.0] {
            let part = half(&polygon, &heights, sign);
            let inside: Vec<[[f64; 2]; 2]> = segments
                .iter()
                .filter(|s| s.iter().any(|&p| sign * height(line, p) > tolerance))
                .filter_map(|s| {
                    let mut s = *s;
                    clip(&part, &mut s, tolerance).then_some(s)
                })
                .collect();
            waiting.push((part, inside));
        }
    }
    done
}

/// The part of a convex polygon on one side of a line, by the heights of its corners.
fn half(polygon: &[[f64; 2]], heights: &[f64], sign: f64) -> Vec<[f64; 2]> {
    let mut part = Vec::with_capacity(polygon.len() + 1);
    for i in 0..polygon.len() {
        let j = (i + 1) % polygon.len();
        let (p, q, h, k) = (polygon[i], polygon[j], sign * heights[i], sign * heights[j]);
        if h >= 0.0 {
            part.push(p);
        }
        if (h > 0.0 && k < 0.0) || (h < 0.0 && k > 0.0) {
            let share = h / (h - k);
            part.push([0, 1].map(|a| p[a] + (q[a] - p[a]) * share));
        }
    }
    part
}

/// The centroid of a convex polygon.
fn middle(polygon: &[[f64; 2]]) -> [f64; 2] {
    let first = polygon[0];
    let (mut area, mut sum) = (0.0, [0.0; 2]);
    for pair in polygon[1..].windows(2) {
        let [p, q] = [pair[0], pair[1]].map(|c| [c[0] - first[0], c[1] - first[1]]);
        let twice = p[0] * q[1] - p[1] * q[0];
        area += twice;
        for a in 0..2 {
            sum[a] += twice * (p[a] + q[a]) / 3.0;
        }
    }
    if area == 0.0 {
        return first;
    }
    [0, 1].map(|a| first[a] + sum[a] / area)
}
