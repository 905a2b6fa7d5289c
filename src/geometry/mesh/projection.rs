//! Projection of mesh vertices onto the zero set of an exact field, and choice of the diagonals of quads.
//!
//! A mesh of a sampled level set is accurate to the square of the voxel size on smooth parts, but bevels creases by a
//! voxel. Where the exact field is available, each vertex moves along its normal to the zero of the field (regula
//! falsi, Illinois variant), by at most one voxel. With `sharp`, a vertex whose voxel cell contains a crease moves onto
//! the crease: the field is evaluated around the vertex, each sample gives a tangent plane, and planes of different
//! normals are intersected; two planes define an edge, three a corner (Ju, Losasso, Schaefer and Warren, *Dual
//! Contouring of Hermite Data*, 2002). A corner in a cell without a vertex goes to the nearest vertex beside it.
//!
//! Then vertices go back where quads would flip, points coincide or triangles intersect, until no such place is left.
//! So the result adds no self-intersection in single precision; it does not promise that every vertex lies on the zero
//! set.

use super::meeting::meeting_pairs;
use super::soup::Soup;
use super::{QuadMesh, TriMesh};
use crate::field::WorldField;
use crate::frame::{Mat3, Vec3, WorldPoint};
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashSet};

/// Options of a projection.
#[derive(Clone, Copy, Debug)]
pub struct ProjectionOptions {
    /// Voxel size of the level set that the mesh was extracted from, world units; samples lie at its multiples.
    pub voxel_size: f64,
    /// Whether vertices near creases move onto them.
    pub sharp: bool,
}

/// The result of a projection for a whole mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProjectionSummary {
    /// Vertices that moved onto an edge or a corner.
    pub creased: usize,
    /// Vertices that kept their position: no surface was found near them, they would have coincided with another one,
    /// or a triangle would have flipped, lost its area or met another one.
    pub kept: usize,
    /// Greatest magnitude of the field at moved vertices, world units.
    pub error: f64,
}

/// Normals whose cosine is at least this (25 degrees) count as those of one plane.
const SAME_PLANE_COSINE: f64 = 0.9;
/// Below this cosine between the normals of a face and of its vertex, the vertex may lie near a crease.
const MIN_SMOOTH_COSINE: f64 = 0.975;
/// Radii of the field samples around a vertex, voxels. The first is large enough to reach the other planes of
/// an edge or a corner from the vertex's own plane.
const SAMPLE_RADII: [f64; 3] = [1.0, 0.2, 0.04];
/// Least second difference over a voxel, in voxels, that indicates a kink of the field.
const MIN_KINK: f64 = 0.2;
/// Singular values of the matrix of unit normals below this are treated as zero: nearly parallel planes then count as
/// one.
const MIN_SINGULAR_VALUE: f64 = 0.15;
/// How far beyond its cell a vertex may move, voxels.
const MAX_CELL_OVERSHOOT: f64 = 0.05;
/// How far beyond the cell a corner may lie, voxels, if no vertex has it in its own cell.
const MAX_CORNER_OVERSHOOT: f64 = 0.75;

/// The result of a projection for one vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VertexProjection {
    /// Whether it moved onto an edge or a corner.
    pub creased: bool,
    /// Whether it did not reach its target.
    pub kept: bool,
    /// Magnitude of the field at its new position, world units; 0 if it did not move.
    pub error: f64,
}

impl ProjectionSummary {
    /// The summary of some vertices.
    pub fn of(outcomes: impl Iterator<Item = VertexProjection>) -> Self {
        outcomes.fold(Self::default(), |all, outcome| Self {
            creased: all.creased + usize::from(outcome.creased),
            kept: all.kept + usize::from(outcome.kept),
            error: all.error.max(outcome.error),
        })
    }
}

impl QuadMesh {
    /// Moves the vertices onto the zero set of a field, and splits quads along creases.
    ///
    /// # Errors
    /// When cancelled; the mesh is unchanged.
    pub fn project(
        &mut self,
        field: &WorldField,
        options: ProjectionOptions,
        progress: &dyn Progress,
    ) -> Result<ProjectionSummary, Cancelled> {
        let outcomes = self.project_each(field, options, progress)?;
        Ok(ProjectionSummary::of(outcomes.into_iter()))
    }

    /// As [`QuadMesh::project`], with the result for each vertex.
    ///
    /// # Errors
    /// As [`QuadMesh::project`].
    pub fn project_each(
        &mut self,
        field: &WorldField,
        options: ProjectionOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<VertexProjection>, Cancelled> {
        let before = self.triangulated();
        let normals = before.vertex_normals();
        let near_creases = near_creases(&before, &normals);
        let surface = ZeroSet {
            field,
            h: options.voxel_size,
        };
        progress.stage("project", Some(before.vertices.len() as u64));
        let mut targets: Vec<Target> = before
            .vertices
            .par_iter()
            .enumerate()
            .with_min_len(256)
            .map(|(n, &p)| {
                // One in 256 vertices reports, for all of them.
                if n % 256 == 0 {
                    if progress.cancelled() {
                        return Err(Cancelled);
                    }
                    progress.advance(256);
                }
                let mut target = Target::default();
                if options.sharp && near_creases[n] {
                    surface.project_to_crease(p, &mut target);
                }
                if target.position.is_none() {
                    target.position = surface.project_along(p, normals[n]);
                }
                Ok(target)
            })
            .collect::<Result<_, _>>()?;
        assign_corners(&before.vertices, &mut targets, options.voxel_size);
        let mut points: Vec<Vec3> = before.vertices.clone();
        for (position, target) in points.iter_mut().zip(&targets) {
            *position = target.position.unwrap_or(*position);
        }
        // A vertex that spoils a triangle goes back, which may spoil others: rounds go on until none does.
        let swapped = loop {
            revert_invalid(self, &mut points, options.voxel_size);
            let swapped = self.choose_diagonals(&points, &targets, &surface);
            let intersecting = self.intersecting_vertices(&points, &swapped, progress)?;
            if intersecting.is_empty() {
                break swapped;
            }
            for n in intersecting {
                points[n] = before.vertices[n];
            }
        };
        let outcome = |(n, position): (usize, &Vec3)| {
            let moved = *position != before.vertices[n];
            VertexProjection {
                creased: moved && targets[n].creased,
                kept: targets[n].position != Some(*position),
                error: if moved {
                    surface.value(*position).abs()
                } else {
                    0.0
                },
            }
        };
        let outcomes = points.par_iter().enumerate().map(outcome).collect();
        self.set_vertices(points, &swapped);
        Ok(outcomes)
    }

    /// Whether to split each quad along its second diagonal: at creases the diagonal nearer to the surface is used,
    /// elsewhere the shorter one. A diagonal that would flip a triangle gives way to the other. `points` and `targets`
    /// are by vertex; the result has one flag per quad. Triangles (quads that repeat a corner) keep theirs.
    fn choose_diagonals(&self, points: &[Vec3], targets: &[Target], field: &ZeroSet) -> Vec<bool> {
        let is_creased = |v: u32| {
            points[v as usize] != self.vertices()[v as usize] && targets[v as usize].creased
        };
        let cost = |a: u32, b: u32, at_crease: bool| {
            let (p, q) = (points[a as usize], points[b as usize]);
            let length = (p - q).norm() / field.h;
            if at_crease {
                let depth = field.value((p + q) / 2.0).abs() / field.h;
                // At a crease the distance of the diagonal's middle from the surface decides: 0.01 voxels of it, the
                // rounding of a fit, weigh as much as a voxel of length. Below that the length decides.
                100.0 * depth.max(0.01) + length
            } else {
                length
            }
        };
        self.quads()
            .par_iter()
            .map(|&[a, b, c, d]| {
                let at_crease = [a, b, c, d].into_iter().any(is_creased);
                let shorter = cost(b, d, at_crease) < cost(a, c, at_crease);
                let [first, second] = valid_diagonals(self, points, field.h, [a, b, c, d]);
                c != d && second && (shorter || !first)
            })
            .collect()
    }

    /// The moved vertices of quads whose triangles intersect others, in single precision. `points` are all vertices
    /// after the move, `swapped` marks the quads that are split along the second diagonal.
    fn intersecting_vertices(
        &self,
        points: &[Vec3],
        swapped: &[bool],
        progress: &dyn Progress,
    ) -> Result<BTreeSet<usize>, Cancelled> {
        // Files may store single precision: what intersects there counts.
        let rounded: Vec<Vec3> = points
            .par_iter()
            .map(|p| p.map(|c| f64::from(c as f32)))
            .collect();
        let mut triangles = Vec::with_capacity(2 * swapped.len());
        for (n, (&quad, &swapped)) in self.quads().iter().zip(swapped).enumerate() {
            let [a, b, c, d] = quad.map(|v| rounded[v as usize]);
            let both = if swapped {
                [[a, b, d], [b, c, d]]
            } else {
                [[a, b, c], [a, c, d]]
            };
            // A quad that repeats its last corner is one triangle.
            let count = if quad[2] == quad[3] { 1 } else { 2 };
            triangles.extend(both.into_iter().take(count).map(|t| (t, n as u32)));
        }
        // Pairs of quads, whose numbers the triangles have.
        let pairs = meeting_pairs(&Soup::uncut(&triangles), progress)?;
        let corners = pairs.as_flattened().iter();
        let corners = corners.flat_map(|&n| self.quads()[n as usize]);
        let moved = |&v: &usize| points[v] != self.vertices()[v];
        Ok(corners.map(|v| v as usize).filter(moved).collect())
    }
}

/// The target of a vertex.
#[derive(Clone, Copy, Default)]
struct Target {
    position: Option<Vec3>,
    /// Whether the position lies on an edge or a corner.
    creased: bool,
    /// A corner in a neighbouring cell, which may have no vertex.
    corner: Option<Vec3>,
}

/// Assigns corners that no vertex has in its own cell to the nearest vertex of a neighbouring cell; changes the target
/// of that vertex. `h` is the voxel size, world units.
fn assign_corners(vertices: &[Vec3], targets: &mut [Target], h: f64) {
    // Several vertices find one corner up to the accuracy of the fit: points in the same hundredth of a voxel count as
    // one.
    let key = |x: Vec3| <[i64; 3]>::from(x.map(|c| (c / (0.01 * h)).round() as i64));
    let claimed: HashSet<[i64; 3]> = targets
        .iter()
        .filter(|f| f.creased)
        .filter_map(|f| f.position.map(key))
        .collect();
    let mut nearest: BTreeMap<[i64; 3], (f64, usize)> = BTreeMap::new();
    for (n, f) in targets.iter().enumerate() {
        let Some(x) = f.corner.filter(|&x| !claimed.contains(&key(x))) else {
            continue;
        };
        let distance = (x - vertices[n]).norm();
        let best = nearest.entry(key(x)).or_insert((distance, n));
        if distance < best.0 {
            *best = (distance, n);
        }
    }
    for (_, n) in nearest.into_values() {
        targets[n].position = targets[n].corner;
        targets[n].creased = true;
    }
}

/// Marks vertices where face normals differ more than on a smooth surface. One flag per vertex; `normals` are those of
/// the vertices.
fn near_creases(mesh: &TriMesh, normals: &[Vec3]) -> Vec<bool> {
    let mut flags = vec![false; normals.len()];
    for (t, [a, b, c]) in mesh.triangles.iter().zip(mesh.iter_corners()) {
        let Some(n) = (b - a).cross(&(c - a)).try_normalize(0.0) else {
            continue;
        };
        for &v in t {
            flags[v as usize] |= n.dot(&normals[v as usize]) < MIN_SMOOTH_COSINE;
        }
    }
    flags
}

/// Whether a quad can be split along its first and along its second diagonal after its corners moved to `points`:
/// neither triangle may flip or lose its area. `h` is the voxel size, world units.
fn valid_diagonals(mesh: &QuadMesh, points: &[Vec3], h: f64, quad: [u32; 4]) -> [bool; 2] {
    let old = quad.map(|v| mesh.vertices()[v as usize]);
    let facing = (old[2] - old[0]).cross(&(old[3] - old[1]));
    let [a, b, c, d] = quad.map(|v| points[v as usize]);
    let is_valid = |p: Vec3, q: Vec3, r: Vec3| {
        let area = (q - p).cross(&(r - p));
        // A triangle may turn by at most 87 degrees (cosine 0.05) from the old quad, and keeps a millionth of a voxel's
        // face.
        area.dot(&facing) > 0.05 * area.norm() * facing.norm() && area.norm() > 1e-6 * h * h
    };
    // A triangle has no diagonal: both answers are whether it keeps its side.
    if quad[2] == quad[3] {
        let facing = (old[1] - old[0]).cross(&(old[2] - old[0]));
        let area = (b - a).cross(&(c - a));
        return [area.dot(&facing) > 0.0; 2];
    }
    [
        is_valid(a, b, c) && is_valid(a, c, d),
        is_valid(b, c, d) && is_valid(b, d, a),
    ]
}

/// Restores the points of vertices that coincide with another in 32 bits, and of the corners of quads
/// without valid diagonal.
fn revert_invalid(mesh: &QuadMesh, points: &mut [Vec3], h: f64) {
    let before = mesh.vertices();
    // + 0.0 makes -0 and 0 one key.
    let key = |p: &Vec3| [p.x, p.y, p.z].map(|c| (c as f32 + 0.0).to_bits());
    let mut used = HashSet::with_capacity(points.len());
    for (position, old) in points.iter_mut().zip(before) {
        if !used.insert(key(position)) {
            *position = *old;
            used.insert(key(old));
        }
    }
    drop(used);
    // A restored point changes its other quads: until all are valid.
    loop {
        let invalid: Vec<[u32; 4]> = mesh
            .quads()
            .par_iter()
            .copied()
            .filter(|q| {
                let moved = q.iter().any(|&v| points[v as usize] != before[v as usize]);
                moved && valid_diagonals(mesh, points, h, *q) == [false; 2]
            })
            .collect();
        if invalid.is_empty() {
            return;
        }
        for &v in invalid.as_flattened() {
            points[v as usize] = before[v as usize];
        }
    }
}

/// The field with the voxel size `h`.
struct ZeroSet<'a> {
    field: &'a WorldField<'a>,
    h: f64,
}

/// A tangent plane: unit normal, and signed distance of the reference point.
#[derive(Clone, Copy)]
struct Tangent {
    normal: Vec3,
    distance: f64,
}

impl ZeroSet<'_> {
    fn value(&self, p: Vec3) -> f64 {
        self.field.value(WorldPoint(p))
    }

    /// The zero on the line through `p` along the unit vector `normal`, within a voxel of it; `None` if the field has
    /// no change of sign there or the iteration does not end, and for a zero normal.
    fn project_along(&self, p: Vec3, normal: Vec3) -> Option<Vec3> {
        if normal == Vec3::zeros() {
            return None;
        }
        let at = |t: f64| self.value(p + normal * t);
        // A value this small counts as 0.
        let tolerance = 1e-8 * self.h;
        let (mut a, mut fa) = (0.0, at(0.0));
        if fa.abs() <= tolerance {
            return Some(p);
        }
        // The field increases outward: step against its sign until it changes.
        // For a distance the first step passes the zero; at most a quarter of a voxel, so that it does not pass two,
        // and enough to leave a value near 0.
        let step = (fa.abs() * 1.5).clamp(1e-4 * self.h, 0.25 * self.h);
        let (mut b, mut fb) = (a, fa);
        while fb.signum() == fa.signum() {
            b -= step * fa.signum();
            if b.abs() > self.h {
                return None;
            }
            fb = at(b);
        }
        // Illinois method: regula falsi that halves the value at an end that stays.
        // Usually fewer than ten steps; 60 bound the time for fields with jumps.
        for _ in 0..60 {
            let t = b - fb * (b - a) / (fb - fa);
            let ft = at(t);
            if ft.abs() <= tolerance || (b - a).abs() <= tolerance {
                return Some(p + normal * t);
            }
            if ft.signum() == fb.signum() {
                fa /= 2.0;
            } else {
                (a, fa) = (b, fb);
            }
            (b, fb) = (t, ft);
        }
        None
    }

    /// Sets the target to the corner or edge point nearest to `p` in its voxel cell, or records a corner in a
    /// neighbouring cell. The target does not change if there is no crease.
    fn project_to_crease(&self, p: Vec3, target: &mut Target) {
        if !self.may_kink(p) {
            return;
        }
        // Planes that may meet in the cell or next to it: within 1.5 voxels. All of them first, so that a corner comes
        // before the edge of its two nearest planes.
        let planes = self.tangent_planes(p, SAMPLE_RADII[0] * self.h, 1.5 * self.h);
        for count in (2..=planes.len()).rev() {
            // A point off the surface by more than rounding comes from planes that do not meet on it.
            let on_surface = |x: &Vec3| self.value(*x).abs() < 1e-3 * self.h;
            let Some(x) = self.crease_point(p, &planes[..count]).filter(on_surface) else {
                continue;
            };
            // How far x lies beyond the voxel cell that holds p along an axis, voxels; negative inside.
            let overshoot = |a: usize| {
                let at = x[a] / self.h - (p[a] / self.h).floor();
                (at - 0.5).abs() - 0.5
            };
            let overshoot = (0..3).map(overshoot).fold(f64::NEG_INFINITY, f64::max);
            if overshoot <= MAX_CELL_OVERSHOOT {
                target.position = Some(x);
                target.creased = true;
                return;
            }
            if count == 3 && overshoot <= MAX_CORNER_OVERSHOOT {
                target.corner = Some(x);
            }
        }
    }

    /// Whether the field bends more around `p` than one of moderate curvature. The test takes 14 samples, a
    /// small part of the cost of a crease.
    fn may_kink(&self, p: Vec3) -> bool {
        let centre2 = 2.0 * self.value(p);
        // The axes and the space diagonals, of length 1 (0.577 = 1 / sqrt 3).
        let directions = [
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.577, 0.577, 0.577],
            [0.577, 0.577, -0.577],
            [0.577, -0.577, 0.577],
            [-0.577, 0.577, 0.577],
        ];
        directions.into_iter().any(|direction| {
            let step = Vec3::from(direction) * self.h;
            let bend = self.value(p + step) + self.value(p - step) - centre2;
            bend.abs() > MIN_KINK * self.h
        })
    }

    /// The intersection of tangent planes near `p`, refined by samples at smaller radii; `None` if it leaves the
    /// surroundings of `p` (1.5 voxels) or if fewer planes are found around it than `tangents` holds.
    fn crease_point(&self, p: Vec3, tangents: &[Tangent]) -> Option<Vec3> {
        let count = tangents.len();
        let mut x = p + intersect_planes(tangents)?;
        for radius in &SAMPLE_RADII[1..] {
            if (x - p).norm() > 1.5 * self.h {
                return None;
            }
            let radius = radius * self.h;
            // A plane somewhat beyond the samples counts: x is not exact yet.
            let mut planes = self.tangent_planes(x, radius, 2.5 * radius);
            planes.truncate(count);
            if planes.len() < count {
                return None;
            }
            x += intersect_planes(&planes)?;
        }
        Some(x)
    }

    /// Up to three tangent planes of the field around `x` with different normals, nearest first. The field is sampled
    /// at `radius` from `x`; planes farther than `reach` are left out. Both are world units.
    fn tangent_planes(&self, x: Vec3, radius: f64, reach: f64) -> Vec<Tangent> {
        // The field in the directions of the 6 face middles and the 8 corners of a cube around x: each value gives a
        // tangent plane.
        let mut all = Vec::with_capacity(14);
        for n in (0..27).filter(|&n| n != 13) {
            let direction = Vec3::new(
                f64::from(n / 9 - 1),
                f64::from(n / 3 % 3 - 1),
                f64::from(n % 3 - 1),
            );
            // The middles of the cube's 12 edges, with a squared length of 2, are left out.
            if direction.norm_squared() == 2.0 {
                continue;
            }
            let s = x + direction.normalize() * radius;
            let (value, gradient) = self.field.value_and_gradient(WorldPoint(s));
            let slope = gradient.norm();
            // A distance has the slope 1. A far smaller one belongs to a kink or to values that are no distances.
            if !(slope > 0.3 && slope.is_finite()) {
                continue;
            }
            let normal = gradient / slope;
            let distance = value / slope + normal.dot(&(x - s));
            if distance.abs() <= reach {
                all.push(Tangent { normal, distance });
            }
        }
        all.sort_by(|a, b| a.distance.abs().total_cmp(&b.distance.abs()));
        let mut planes: Vec<Tangent> = Vec::with_capacity(3);
        for t in all {
            if planes.len() < 3
                && planes
                    .iter()
                    .all(|f| f.normal.dot(&t.normal) < SAME_PLANE_COSINE)
            {
                planes.push(t);
            }
        }
        planes
    }
}

/// The shortest vector from the reference point to the intersection of at most three planes (least squares). `None`
/// cannot occur: both factors of the decomposition are computed.
fn intersect_planes(planes: &[Tangent]) -> Option<Vec3> {
    let mut normals_matrix = Mat3::zeros();
    let mut rhs = Vec3::zeros();
    for (n, t) in planes.iter().enumerate().take(3) {
        normals_matrix.set_row(n, &t.normal.transpose());
        rhs[n] = -t.distance;
    }
    normals_matrix
        .svd(true, true)
        .solve(&rhs, MIN_SINGULAR_VALUE)
        .ok()
}
