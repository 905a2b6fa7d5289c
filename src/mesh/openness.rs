//! Holes of a surface, and whether the winding number can close them.
//!
//! The winding number w closes a hole by its level w = 1/2, which resembles a minimal surface across the hole.
//! The result is meaningful if w is clearly above 1/2 in most of the inside; a sheet or half a box bounds no
//! solid.

use super::half_edges::{BoundaryEdge, HalfEdges};
use super::{MeshSolid, TriMesh};
use crate::frame::Vec3;
use std::fmt;

/// Samples of the winding number per axis of the bounding box.
const SAMPLES_PER_AXIS: usize = 20;
/// Winding numbers between this value and 1 minus this value are uncertain.
const UNCERTAIN_WINDING: f64 = 0.25;
/// Greatest ratio of uncertain samples to inside samples of a surface that bounds a solid.
const MAX_UNCERTAIN_RATIO: f64 = 0.5;

/// One loop of open edges.
#[derive(Clone, Debug, PartialEq)]
pub struct Hole {
    /// The number of edges.
    pub edges: usize,
    /// The total length of the edges.
    pub length: f64,
    /// The mean of the edges' midpoints.
    pub centre: Vec3,
}

/// The open edges of a surface and their effect on the winding number.
#[derive(Clone, Debug, PartialEq)]
pub struct Openness {
    /// Loops of open edges, longest first.
    pub holes: Vec<Hole>,
    /// The number of open edges, counted with multiplicity.
    pub open_edges: usize,
    /// The number of all edges.
    pub edges: usize,
    /// The fraction of the bounding box that is inside (w > 1/2).
    pub inside: f64,
    /// The ratio of samples with a winding number between 1/4 and 3/4 to samples inside.
    pub uncertain: f64,
    /// Whether the surface is oriented inward: more of the box has w < -1/2 than w > 1/2.
    pub inside_out: bool,
}

impl Openness {
    /// Whether the surface has no open edge.
    pub fn is_closed(&self) -> bool {
        self.open_edges == 0
    }

    /// Whether even the winding number defines no solid.
    pub fn bounds_no_solid(&self) -> bool {
        self.inside == 0.0 || self.uncertain > MAX_UNCERTAIN_RATIO
    }

    /// The openness of a solid, from its mesh with merged vertices and the half-edges of that mesh.
    pub(super) fn of(solid: &MeshSolid, merged: &TriMesh, sides: &HalfEdges) -> Self {
        const N: usize = SAMPLES_PER_AXIS;
        let boundary = sides.boundary();
        let bounds = solid.bounds();
        let (mut inside, mut negative, mut uncertain, mut samples) =
            (0usize, 0usize, 0usize, 0usize);
        for n in 0..N.pow(3) {
            // Off the cell centres: symmetric meshes have faces there.
            let index = [n % N, n / N % N, n / N / N];
            let fraction = Vec3::from(index.map(|i| (i as f64 + 0.43) / N as f64));
            let w = solid.winding_number(bounds.min + fraction.component_mul(&bounds.size()));
            samples += 1;
            inside += usize::from(w > 0.5);
            negative += usize::from(w < -0.5);
            uncertain += usize::from((w - 0.5).abs() < 0.5 - UNCERTAIN_WINDING);
        }
        if solid.mesh().is_empty() {
            (inside, negative, uncertain) = (0, 0, 0);
        }
        Self {
            open_edges: boundary.iter().map(|s| s.multiplicity as usize).sum(),
            edges: sides.edges().count(),
            holes: holes(merged, boundary),
            inside: inside as f64 / samples as f64,
            uncertain: uncertain as f64 / inside.max(1) as f64,
            inside_out: negative > inside,
        }
    }
}

impl fmt::Display for Openness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(hole) = self.holes.first() else {
            return write!(f, "no open edges");
        };
        let c = hole.centre;
        write!(
            f,
            "{} of {} edges are open, in {}; the longest has {} edges, length {:.4}, around ({:.4}, {:.4}, {:.4})",
            self.open_edges,
            self.edges,
            if self.holes.len() == 1 {
                "1 hole".into()
            } else {
                format!("{} holes", self.holes.len())
            },
            hole.edges,
            hole.length,
            c.x,
            c.y,
            c.z
        )
    }
}

/// The error of a surface that bounds no solid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "the surface bounds no solid: {openness}; {:.0} % of its box is inside by the winding number, and the ratio of uncertain to inside points is {:.2} (expected at most {MAX_UNCERTAIN_RATIO})",
    openness.inside * 100.0,
    openness.uncertain
)]
pub struct NoSolidError {
    /// The open edges.
    pub openness: Openness,
}

impl MeshSolid {
    /// The openness of the surface, caps included.
    pub fn openness(&self) -> Openness {
        let merged = self.mesh().merged();
        let sides = HalfEdges::of(merged.triangles(), merged.vertices().len());
        Openness::of(self, &merged, &sides)
    }
}

/// The holes of a mesh with these open edges, longest first.
fn holes(mesh: &TriMesh, sides: Vec<BoundaryEdge>) -> Vec<Hole> {
    let hole = |boundary_loop: Vec<BoundaryEdge>| {
        let mut hole = Hole {
            edges: boundary_loop.len(),
            length: 0.0,
            centre: Vec3::zeros(),
        };
        for side in &boundary_loop {
            let [a, b] = [side.from, side.to].map(|v| mesh.vertices()[v as usize]);
            hole.length += (b - a).norm();
            hole.centre += (a + b) / 2.0;
        }
        hole.centre /= hole.edges as f64;
        hole
    };
    let mut holes: Vec<Hole> = boundary_loops(sides).into_iter().map(hole).collect();
    holes.sort_by(|a, b| b.length.total_cmp(&a.length));
    holes
}

/// Chains edges into loops. Every loop is closed if the edges are a whole boundary, each edge repeated by its
/// multiplicity.
pub(super) fn boundary_loops(mut sides: Vec<BoundaryEdge>) -> Vec<Vec<BoundaryEdge>> {
    sides.sort_by_key(|s| (s.from, s.to));
    let mut used = vec![false; sides.len()];
    let mut boundary_loops = Vec::new();
    for start in 0..sides.len() {
        let mut boundary_loop = Vec::new();
        let mut next = Some(start).filter(|&s| !used[s]);
        while let Some(i) = next {
            used[i] = true;
            boundary_loop.push(sides[i]);
            let to = sides[i].to;
            let first = sides.partition_point(|s| s.from < to);
            next = (first..sides.len())
                .take_while(|&j| sides[j].from == to)
                .find(|&j| !used[j]);
        }
        if !boundary_loop.is_empty() {
            boundary_loops.push(boundary_loop);
        }
    }
    boundary_loops
}
