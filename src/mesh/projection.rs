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

use super::intersect::meeting_pairs;
use super::soup::Soup;
use super::{QuadMesh, TriMesh};
use crate::field::WorldField;
use crate::frame::{Mat3, Vec3, WorldPoint};
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashSet};

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
/// Radii around a vertex at which the field is asked, voxels: at first so wide that from the side of an
/// edge, or from two edges of a corner, the other planes are in sight.
const RADII: [f64; 3] = [1.0, 0.2, 0.04];
/// Second difference over a voxel, in voxels, from which on the field may have a kink there.
const KINK: f64 = 0.2;
/// Singular values below this say nothing.
const SINGULAR: f64 = 0.15;
/// How far beyond its cell a vertex may go, voxels.
const BEYOND: f64 = 0.05;
/// How far beyond it a corner may lie that no vertex has in its own cell, voxels.
const BESIDE: f64 = 0.75;

/// What a projection did to a vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fate {
    /// It went onto an edge or a corner.
    pub creased: bool,
    /// It is not where it should have gone.
    pub kept: bool,
    /// Magnitude of the field at it, world units; 0 where it did not move.
    pub error: f64,
}

impl Projected {
    /// Of some vertices together.
    pub fn of(fates: impl Iterator<Item = Fate>) -> Self {
        fates.fold(Self::default(), |all, fate| Self {
            creased: all.creased + usize::from(fate.creased),
            kept: all.kept + usize::from(fate.kept),
            error: all.error.max(fate.error),
        })
    }
}

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
        let fates = self.project_each(field, how, progress)?;
        Ok(Projected::of(fates.into_iter()))
    }

    /// The same, with what became of each vertex.
    ///
    /// # Errors
    /// As [`QuadMesh::project`].
    pub fn project_each(
        &mut self,
        field: &WorldField,
        how: Projection,
        progress: &dyn Progress,
    ) -> Result<Vec<Fate>, Cancelled> {
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
        let turned = loop {
            untangle(self, &mut places, how.voxel_size);
            let turned = self.cuts(&places, &found, &surface);
            let entangled = self.entangled(&places, &turned, progress)?;
            if entangled.is_empty() {
                break turned;
            }
            for n in entangled {
                places[n] = before.vertices[n];
            }
        };
        let fate = |(n, place): (usize, &Vec3)| {
            let moved = *place != before.vertices[n];
            Fate {
                creased: moved && found[n].creased,
                kept: found[n].place != Some(*place),
                error: if moved {
                    surface.value(*place).abs()
                } else {
                    0.0
                },
            }
        };
        let fates = places.par_iter().enumerate().map(fate).collect();
        self.place(places, &turned);
        Ok(fates)
    }

    /// Which quads are cut along their second diagonal: the one that is nearer to the surface at creases,
    /// elsewhere the shorter.
    fn cuts(&self, places: &[Vec3], found: &[Found], surface: &Surface) -> Vec<bool> {
        let is_creased =
            |v: u32| places[v as usize] != self.vertices()[v as usize] && found[v as usize].creased;
        let cost = |a: u32, b: u32, at_crease: bool| {
            let (p, q) = (places[a as usize], places[b as usize]);
            let length = (p - q).norm() / surface.h;
            if at_crease {
                let depth = surface.value((p + q) / 2.0).abs() / surface.h;
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
                let [first, second] = fits(self, places, surface.h, [a, b, c, d]);
                c != d && second && (shorter || !first)
            })
            .collect()
    }

    /// The vertices that moved of triangles that meet others where they should not, in single precision.
    fn entangled(
        &self,
        places: &[Vec3],
        turned: &[bool],
        progress: &dyn Progress,
    ) -> Result<BTreeSet<usize>, Cancelled> {
        let places32: Vec<Vec3> = places
            .par_iter()
            .map(|p| p.map(|c| f64::from(c as f32)))
            .collect();
        let mut triangles = Vec::with_capacity(2 * turned.len());
        for (n, (&quad, &turned)) in self.quads().iter().zip(turned).enumerate() {
            let [a, b, c, d] = quad.map(|v| places32[v as usize]);
            let both = if turned {
                [[a, b, d], [b, c, d]]
            } else {
                [[a, b, c], [a, c, d]]
            };
            let count = if quad[2] == quad[3] { 1 } else { 2 };
            triangles.extend(both.into_iter().take(count).map(|t| (t, n as u32)));
        }
        let pairs = meeting_pairs(&Soup::new(&triangles), progress)?;
        let corners = pairs.as_flattened().iter();
        let corners = corners.flat_map(|&n| self.quads()[n as usize]);
        let moved = |&v: &usize| places[v] != self.vertices()[v];
        Ok(corners.map(|v| v as usize).filter(moved).collect())
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

/// Whether a quad can be cut along its first diagonal and along its second, after its corners went from
/// the mesh's vertices to `places`: neither triangle turns over or loses its area.
fn fits(mesh: &QuadMesh, places: &[Vec3], h: f64, quad: [u32; 4]) -> [bool; 2] {
    let old = quad.map(|v| mesh.vertices()[v as usize]);
    let facing = (old[2] - old[0]).cross(&(old[3] - old[1]));
    let [a, b, c, d] = quad.map(|v| places[v as usize]);
    let whole = |p: Vec3, q: Vec3, r: Vec3| {
        let area = (q - p).cross(&(r - p));
        area.dot(&facing) > 0.05 * area.norm() * facing.norm() && area.norm() > 1e-6 * h * h
    };
    if quad[2] == quad[3] {
        let facing = (old[1] - old[0]).cross(&(old[2] - old[0]));
        let area = (b - a).cross(&(c - a));
        return [area.dot(&facing) > 0.0; 2];
    }
    [
        whole(a, b, c) && whole(a, c, d),
        whole(b, c, d) && whole(b, d, a),
    ]
}

/// Sends back to where they came from: vertices that met another, to 32 bits, and those of quads that
/// can no longer be cut into triangles facing the way they did.
fn untangle(mesh: &QuadMesh, places: &mut [Vec3], h: f64) {
    let before = mesh.vertices();
    let key = |p: &Vec3| [p.x, p.y, p.z].map(|c| (c as f32 + 0.0).to_bits());
    let mut taken = HashSet::with_capacity(places.len());
    for (place, old) in places.iter_mut().zip(before) {
        if !taken.insert(key(place)) {
            *place = *old;
            taken.insert(key(old));
        }
    }
    drop(taken);
    loop {
        let bad: Vec<[u32; 4]> = mesh
            .quads()
            .par_iter()
            .copied()
            .filter(|q| {
                let moved = q.iter().any(|&v| places[v as usize] != before[v as usize]);
                moved && fits(mesh, places, h, *q) == [false; 2]
            })
            .collect();
        if bad.is_empty() {
            return;
        }
        for &v in bad.as_flattened() {
            places[v as usize] = before[v as usize];
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
        if !self.may_kink(p) {
            return;
        }
        let around = self.tangents(p, RADII[0] * self.h, 1.5 * self.h);
        for planes in (2..=around.len()).rev() {
            let on_surface = |x: &Vec3| self.value(*x).abs() < 1e-3 * self.h;
            let Some(x) = self.meeting(p, &around[..planes]).filter(on_surface) else {
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

    /// Whether the field bends around `p` more than a smooth one of moderate curvature: asked at 14
    /// points, a small part of what a crease takes.
    fn may_kink(&self, p: Vec3) -> bool {
        let middle = 2.0 * self.value(p);
        let ways = [
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.577, 0.577, 0.577],
            [0.577, 0.577, -0.577],
            [0.577, -0.577, 0.577],
            [-0.577, 0.577, 0.577],
        ];
        ways.into_iter().any(|way| {
            let step = Vec3::from(way) * self.h;
            let bend = self.value(p + step) + self.value(p - step) - middle;
            bend.abs() > KINK * self.h
        })
    }

    /// Where tangent planes at `p` meet, found again with those that are nearer.
    fn meeting(&self, p: Vec3, around: &[Tangent]) -> Option<Vec3> {
        let planes = around.len();
        let mut x = p + meet(around)?;
        for radius in &RADII[1..] {
            if (x - p).norm() > 1.5 * self.h {
                return None;
            }
            let radius = radius * self.h;
            let mut found = self.tangents(x, radius, 2.5 * radius);
            found.truncate(planes);
            if found.len() < planes {
                return None;
            }
            x += meet(&found)?;
        }
        Some(x)
    }

    /// Up to three planes of different normals, the nearest first, that the field has around `x`.
    fn tangents(&self, x: Vec3, radius: f64, reach: f64) -> Vec<Tangent> {
        let mut all = Vec::with_capacity(14);
        for n in (0..27).filter(|&n| n != 13) {
            let way = Vec3::new(
                f64::from(n / 9 - 1),
                f64::from(n / 3 % 3 - 1),
                f64::from(n % 3 - 1),
            );
            // Faces and corners of the cube around x.
            if way.norm_squared() == 2.0 {
                continue;
            }
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
        let mut found: Vec<Tangent> = Vec::with_capacity(3);
        for t in all {
            if found.len() < 3 && found.iter().all(|f| f.normal.dot(&t.normal) < ONE_PLANE) {
                found.push(t);
            }
        }
        found
    }
}

/// The shortest way to where planes meet.
fn meet(planes: &[Tangent]) -> Option<Vec3> {
    let mut rows = Mat3::zeros();
    let mut right = Vec3::zeros();
    for (n, t) in planes.iter().enumerate().take(3) {
        rows.set_row(n, &t.normal.transpose());
        right[n] = -t.distance;
    }
    rows.svd(true, true).solve(&right, SINGULAR).ok()
}
