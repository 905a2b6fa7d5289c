//! Vertices put onto the surface of an exact field.
//!
//! A mesh of a level set knows the surface from its voxels: smooth parts to the square of the voxel
//! size, creases only to the voxel itself, as a bevel. Where the field is still at hand, each vertex is
//! moved along its normal until the field vanishes there (secants, kept between a point inside and one
//! outside). With `sharp`, a vertex whose cell of voxels the surface crosses in a crease goes onto the
//! crease: the field is asked around the vertex, each answer is a plane, the planes of different normals
//! are intersected, and the same is done around the new place with a quarter of the radius, twice. Two
//! planes make an edge, three a corner. A vertex stays within its cell, so that quads keep their order
//! (Ju, Losasso, Schaefer and Warren, *Dual Contouring of Hermite Data*, 2002).

use super::{QuadMesh, TriMesh};
use crate::field::WorldField;
use crate::frame::{Mat3, Vec3, WorldPoint};
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};

/// How vertices are projected.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    /// Edge of the voxels that the mesh was made from, world units; samples stand at its multiples.
    pub voxel_size: f64,
    /// Whether vertices near creases go onto them.
    pub sharp: bool,
}

/// What a projection did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Projected {
    /// Vertices that went onto an edge or a corner.
    pub creased: usize,
    /// Vertices that stayed: no surface was found near them, or a triangle would have turned over.
    pub kept: usize,
    /// Greatest magnitude of the field at the vertices that moved, world units.
    pub error: f64,
}

/// Cosine of the angle between normals of one crease: 25 degrees.
const ONE_PLANE: f64 = 0.9;
/// Cosine of the angle between a face and its vertex's normal beyond which a crease is looked for.
const SUSPECT: f64 = 0.975;
/// Radii around a vertex at which the field is asked for two planes and for three, voxels: from the side
/// of an edge, or from two edges of a corner, the other planes must be in sight.
const RADII: [[f64; 3]; 2] = [[0.6, 0.15, 0.04], [1.1, 0.2, 0.04]];
/// Singular values below this say nothing.
const SINGULAR: f64 = 0.15;
/// How far beyond its cell a vertex may go, voxels.
const BEYOND: f64 = 0.05;
/// How far beyond it a corner may lie that no vertex has in its own cell, voxels.
const BESIDE: f64 = 0.75;

impl QuadMesh {
    /// Moves the vertices onto the zero set of a field, and cuts quads along creases.
    ///
    /// # Errors
    /// When cancelled; the mesh is as it was.
    pub fn project(
        &mut self,
        field: &WorldField,
        how: Projection,
        progress: &dyn Progress,
    ) -> Result<Projected, Cancelled> {
        let before = self.triangulated();
        let normals = before.vertex_normals();
        let suspects = suspects(&before, &normals);
        let surface = Surface {
            field,
            h: how.voxel_size,
        };
        progress.stage("project", Some(before.vertices.len() as u64));
        let mut found: Vec<Found> = before
            .vertices
            .par_iter()
            .enumerate()
            .with_min_len(256)
            .map(|(n, &p)| {
                if n % 256 == 0 {
                    if progress.cancelled() {
                        return Err(Cancelled);
                    }
                    progress.advance(256);
                }
                let mut found = Found::default();
                if how.sharp && suspects[n] {
                    surface.crease(p, &mut found);
                }
                if found.place.is_none() {
                    found.place = surface.along(p, normals[n]);
                }
                Ok(found)
            })
            .collect::<Result<_, _>>()?;
        claim_corners(&before.vertices, &mut found, how.voxel_size);
        let mut places: Vec<Vec3> = before.vertices.clone();
        for (place, found) in places.iter_mut().zip(&found) {
            *place = found.place.unwrap_or(*place);
        }
        untangle(&before, &mut places, how.voxel_size);
        let moved = |n: usize| places[n] != before.vertices[n];
        let is_creased = |n: usize| moved(n) && found[n].creased;
        let creased = (0..places.len()).filter(|&n| is_creased(n)).count();
        let kept = (0..places.len())
            .filter(|&n| found[n].place != Some(places[n]))
            .count();
        let error = (0..places.len())
            .into_par_iter()
            .filter(|&n| moved(n))
            .map(|n| surface.value(places[n]).abs())
            .reduce(|| 0.0, f64::max);
        // The diagonal that is nearer to the surface at creases; elsewhere the shorter.
        let cost = |a: u32, b: u32, at_crease: bool| {
            let (p, q) = (places[a as usize], places[b as usize]);
            let length = (p - q).norm() / how.voxel_size;
            if at_crease {
                let depth = surface.value((p + q) / 2.0).abs() / how.voxel_size;
                100.0 * depth.max(0.01) + length
            } else {
                length
            }
        };
        let turned: Vec<bool> = self
            .quads()
            .par_iter()
            .map(|&[a, b, c, d]| {
                let at_crease = [a, b, c, d].iter().any(|&v| is_creased(v as usize));
                c != d && cost(b, d, at_crease) < cost(a, c, at_crease)
            })
            .collect();
        self.place(places, &turned);
        Ok(Projected {
            creased,
            kept,
            error,
        })
    }
}

/// Where a vertex goes.
#[derive(Clone, Copy, Default)]
struct Found {
    place: Option<Vec3>,
    /// Whether that is on an edge or a corner.
    creased: bool,
    /// A corner in a cell beside its own, which may have no vertex.
    corner: Option<Vec3>,
}

/// Gives corners that no vertex found in its own cell to the nearest that found them beside it.
fn claim_corners(vertices: &[Vec3], found: &mut [Found], h: f64) {
    let key = |x: Vec3| <[i64; 3]>::from(x.map(|c| (c / (0.01 * h)).round() as i64));
    let owned: HashSet<[i64; 3]> = found
        .iter()
        .filter(|f| f.creased)
        .filter_map(|f| f.place.map(key))
        .collect();
    let mut nearest: BTreeMap<[i64; 3], (f64, usize)> = BTreeMap::new();
    for (n, f) in found.iter().enumerate() {
        let Some(x) = f.corner.filter(|&x| !owned.contains(&key(x))) else {
            continue;
        };
        let distance = (x - vertices[n]).norm();
        let best = nearest.entry(key(x)).or_insert((distance, n));
        if distance < best.0 {
            *best = (distance, n);
        }
    }
    for (_, n) in nearest.into_values() {
        found[n].place = found[n].corner;
        found[n].creased = true;
    }
}

/// Vertices around which faces turn by more than a smooth surface's would.
fn suspects(mesh: &TriMesh, normals: &[Vec3]) -> Vec<bool> {
    let mut found = vec![false; normals.len()];
    for (t, [a, b, c]) in mesh.triangles.iter().zip(mesh.iter_corners()) {
        let Some(n) = (b - a).cross(&(c - a)).try_normalize(0.0) else {
            continue;
        };
        for &v in t {
            found[v as usize] |= n.dot(&normals[v as usize]) < SUSPECT;
        }
    }
    found
}

/// Sends back to where they came from: vertices that met another, to 32 bits, and those of triangles
/// that turned over or lost their area.
fn untangle(before: &TriMesh, places: &mut [Vec3], h: f64) {
    let key = |p: &Vec3| [p.x, p.y, p.z].map(|c| (c as f32 + 0.0).to_bits());
    let mut taken = HashSet::with_capacity(places.len());
    for (place, old) in places.iter_mut().zip(&before.vertices) {
        if !taken.insert(key(place)) {
            *place = *old;
            taken.insert(key(old));
        }
    }
    drop(taken);
    let area = |[a, b, c]: [Vec3; 3]| (b - a).cross(&(c - a));
    loop {
        let corners = |t: &[u32; 3], of: &[Vec3]| t.map(|v| of[v as usize]);
        let bad: Vec<usize> = (0..before.triangles.len())
            .into_par_iter()
            .filter(|&n| {
                let t = &before.triangles[n];
                if t.iter()
                    .all(|&v| places[v as usize] == before.vertices[v as usize])
                {
                    return false;
                }
                let (old, new) = (area(corners(t, &before.vertices)), area(corners(t, places)));
                new.dot(&old) <= 0.05 * new.norm() * old.norm() || new.norm() < 1e-6 * h * h
            })
            .collect();
        if bad.is_empty() {
            return;
        }
        for v in bad.iter().flat_map(|&n| before.triangles[n]) {
            places[v as usize] = before.vertices[v as usize];
        }
    }
}

/// A field with the length that counts as near.
struct Surface<'a> {
    field: &'a WorldField<'a>,
    h: f64,
}

/// A tangent plane: unit normal, and signed distance of the point at hand.
#[derive(Clone, Copy)]
struct Tangent {
    normal: Vec3,
    distance: f64,
}

impl Surface<'_> {
    fn value(&self, p: Vec3) -> f64 {
        self.field.value(WorldPoint(p))
    }

    /// The zero on the line through `p` along `normal`, within a voxel of it.
    fn along(&self, p: Vec3, normal: Vec3) -> Option<Vec3> {
        if normal == Vec3::zeros() {
            return None;
        }
        let at = |t: f64| self.value(p + normal * t);
        let tolerance = 1e-8 * self.h;
        let (mut a, mut fa) = (0.0, at(0.0));
        if fa.abs() <= tolerance {
            return Some(p);
        }
        // Outward the field rises: step against its sign until it changes.
        let step = (fa.abs() * 1.5).clamp(1e-4 * self.h, 0.25 * self.h);
        let (mut b, mut fb) = (a, fa);
        while fb.signum() == fa.signum() {
            b -= step * fa.signum();
            if b.abs() > self.h {
                return None;
            }
            fb = at(b);
        }
        // Illinois: false position that halves the weight of an end that stays.
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

    /// The corner or the place on an edge nearest to `p`, in its cell of voxels; a corner beside it.
    fn crease(&self, p: Vec3, found: &mut Found) {
        for planes in (2..=3).rev() {
            let on_surface = |x: &Vec3| self.value(*x).abs() < 1e-3 * self.h;
            let Some(x) = self.meeting(p, planes).filter(on_surface) else {
                continue;
            };
            let beyond = |a: usize| {
                let at = x[a] / self.h - (p[a] / self.h).floor();
                (at - 0.5).abs() - 0.5
            };
            let beyond = (0..3).map(beyond).fold(f64::NEG_INFINITY, f64::max);
            if beyond <= BEYOND {
                found.place = Some(x);
                found.creased = true;
                return;
            }
            if planes == 3 && beyond <= BESIDE {
                found.corner = Some(x);
            }
        }
    }

    /// Where so many tangent planes around `p` meet.
    fn meeting(&self, p: Vec3, planes: usize) -> Option<Vec3> {
        let mut x = p;
        for (round, radius) in RADII[planes - 2].into_iter().enumerate() {
            let radius = radius * self.h;
            let reach = if round == 0 {
                1.5 * self.h
            } else {
                2.5 * radius
            };
            let found = self.tangents(x, radius, reach, planes);
            if found.len() < planes {
                return None;
            }
            let mut rows = Mat3::zeros();
            let mut right = Vec3::zeros();
            for (n, t) in found.iter().enumerate() {
                rows.set_row(n, &t.normal.transpose());
                right[n] = -t.distance;
            }
            x += rows.svd(true, true).solve(&right, SINGULAR).ok()?;
            if (x - p).norm() > 1.5 * self.h {
                return None;
            }
        }
        Some(x)
    }

    /// Planes of different normals, the nearest first, that the field has around `x`.
    fn tangents(&self, x: Vec3, radius: f64, reach: f64, most: usize) -> Vec<Tangent> {
        let mut all = Vec::with_capacity(26);
        for n in (0..27).filter(|&n| n != 13) {
            let way = Vec3::new(
                f64::from(n / 9 - 1),
                f64::from(n / 3 % 3 - 1),
                f64::from(n % 3 - 1),
            );
            let s = x + way.normalize() * radius;
            let (value, gradient) = self.field.value_and_gradient(WorldPoint(s));
            let slope = gradient.norm();
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
        let mut found: Vec<Tangent> = Vec::with_capacity(most);
        for t in all {
            if found.len() < most && found.iter().all(|f| f.normal.dot(&t.normal) < ONE_PLANE) {
                found.push(t);
            }
        }
        found
    }
}
