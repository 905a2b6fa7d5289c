//! Surfaces that a mesh gives more than once: triangles given twice, and several open scans of one object.
//!
//! Each copy would add to the winding number, and a hole that several copies leave open would be closed far beyond its
//! edge. One copy counts.

use super::shells::{ShellMeasures, Shells};
use super::{MeshSolid, TriMesh};
use crate::frame::Vec3;
use std::collections::HashSet;

/// Least ratio of the mean of n.(c - m) to that of |c - m| over an outward shell, with the centres c of its triangles and
/// their mean m.
const MIN_OUTWARD_RATIO: f64 = 0.3;
/// Greatest distance between two scans of one surface, over the diagonal of the larger one's box.
const SCAN_DISTANCE_RATIO: f64 = 0.02;
/// Least area of an open shell that may be a scan, over that of the largest.
const MIN_AREA_RATIO: f64 = 0.05;
/// Greatest number of open shells that are compared. Meshes of more are torn everywhere.
const MAX_SCANS: usize = 16;
/// Greatest number of points of a scan that are compared with another.
const SCAN_SAMPLES: usize = 256;
/// Least share of a scan's points near another by which the orientations of the two are compared.
const MIN_NEAR_SHARE: f64 = 0.1;

/// The triangles that repeat an earlier one: the same vertices in the same orientation.
pub(super) fn repeated_triangles(merged: &TriMesh) -> Vec<bool> {
    let mut seen = HashSet::new();
    let is_repeated = |t: &[u32; 3]| {
        let mut corners = *t;
        let least = (0..3).min_by_key(|&n| corners[n]).unwrap_or(0);
        corners.rotate_left(least);
        !seen.insert(corners)
    };
    merged.triangles().iter().map(is_repeated).collect()
}

/// What becomes of the open shells of a mesh, by shell.
#[derive(Default)]
pub(super) struct Scans {
    /// Shells that lie along another one, which is larger, or within the solid that it bounds.
    pub covered: Vec<usize>,
    /// Shells oriented against the larger one that they overlap.
    pub opposed: Vec<usize>,
}

impl Scans {
    /// Compares the open shells of a mesh. The result is empty if there are fewer than two large open shells, or more
    /// than `MAX_SCANS`. Numbers are those of shells.
    pub(super) fn of(mesh: &TriMesh, shells: &Shells, measured: &[ShellMeasures]) -> Self {
        let mut scans = Self::default();
        // Open shells, largest first; small ones are no scans.
        let mut open: Vec<usize> = (0..shells.count)
            .filter(|&s| !measured[s].is_closed)
            .collect();
        open.sort_by(|&a, &b| {
            measured[b]
                .area
                .total_cmp(&measured[a].area)
                .then(a.cmp(&b))
        });
        let Some(largest) = open.first().map(|&s| measured[s].area) else {
            return scans;
        };
        open.retain(|&s| measured[s].area > MIN_AREA_RATIO * largest);
        if !(2..=MAX_SCANS).contains(&open.len()) {
            return scans;
        }
        let mut kept: Vec<(usize, MeshSolid)> = Vec::new();
        for &shell in &open {
            let part = part(mesh, shells, shell);
            // The first larger shell that covers this one, or overlaps it, decides; lazily, since a comparison is
            // costly.
            let mut comparisons = kept.iter().map(|(other, solid)| {
                let reach = SCAN_DISTANCE_RATIO * measured[*other].bounds.size().norm();
                Comparison::of(&part, solid, reach)
            });
            let overlap = comparisons
                .find(|c| c.is_covered() || c.near as f64 > MIN_NEAR_SHARE * c.samples as f64);
            let Some(overlap) = overlap else {
                kept.push((shell, MeshSolid::new(part)));
                continue;
            };
            if overlap.is_covered() {
                scans.covered.push(shell);
                continue;
            }
            let is_opposed = 2 * overlap.opposed > overlap.near;
            if is_opposed {
                scans.opposed.push(shell);
            }
            let part = if is_opposed { part.flipped() } else { part };
            kept.push((shell, MeshSolid::new(part)));
        }
        scans
    }
}

/// The triangles of one shell.
fn part(mesh: &TriMesh, shells: &Shells, shell: usize) -> TriMesh {
    let numbered = mesh.triangles().iter().zip(&shells.of);
    let triangles = numbered
        .filter(|(_, s)| **s as usize == shell)
        .map(|(t, _)| *t);
    TriMesh::new_unchecked(mesh.vertices().to_vec(), triangles.collect())
}

/// Points of one surface against another.
struct Comparison {
    samples: usize,
    /// Points near the other.
    near: usize,
    /// Further points inside the solid of the other, if both are wound outward.
    inside: usize,
    /// Near points whose normals oppose the other's.
    opposed: usize,
}

impl Comparison {
    /// Compares triangles' centres with a surface; those within `reach`, world units, are near. Centres are taken at
    /// equal steps of their numbers.
    fn of(part: &TriMesh, solid: &MeshSolid, reach: f64) -> Self {
        let mut found = Self {
            samples: 0,
            near: 0,
            inside: 0,
            opposed: 0,
        };
        // The inner wall of a vessel is wound inward and stays.
        let may_be_buried = is_outward(part) && is_outward(solid.mesh());
        let step = part.triangles().len().div_ceil(SCAN_SAMPLES).max(1);
        for [a, b, c] in part.iter_corners().step_by(step) {
            found.samples += 1;
            let centre = (a + b + c) / 3.0;
            let Some(nearest) = solid.closest_within(centre, reach) else {
                found.inside += usize::from(may_be_buried && solid.contains(centre));
                continue;
            };
            found.near += 1;
            let [p, q, r] = solid.mesh().corners(nearest.triangle as usize);
            let normals = [(b - a).cross(&(c - a)), (q - p).cross(&(r - p))];
            found.opposed += usize::from(normals[0].dot(&normals[1]) < 0.0);
        }
        found
    }

    fn is_covered(&self) -> bool {
        self.near + self.inside == self.samples
    }
}

/// Whether the normals of a surface point away from its middle.
fn is_outward(mesh: &TriMesh) -> bool {
    let faces = || {
        mesh.iter_corners()
            .map(|[a, b, c]| ((a + b + c) / 3.0, (b - a).cross(&(c - a))))
    };
    let area: f64 = faces().map(|(_, normal)| normal.norm()).sum();
    let middle = faces().map(|(c, normal)| c * normal.norm()).sum::<Vec3>() / area;
    let outward: f64 = faces().map(|(c, normal)| normal.dot(&(c - middle))).sum();
    let whole: f64 = faces()
        .map(|(c, normal)| normal.norm() * (c - middle).norm())
        .sum();
    outward > MIN_OUTWARD_RATIO * whole
}
