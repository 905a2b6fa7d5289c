//! How open a surface is, and whether the winding number can close it.
//!
//! A hole is closed where w = 1/2, about the film that a minimal surface would span. That is sound
//! as long as most of the inside is clearly inside; a sheet, or half a box, bounds nothing.

use super::sides::{HalfEdges, Side};
use super::{MeshSolid, TriMesh};
use crate::frame::Vec3;
use std::fmt;

/// Samples per axis of the box in which the winding number is looked at.
const SAMPLES: usize = 20;
/// Winding numbers between this and one minus this are in doubt.
const CLEAR: f64 = 0.25;
/// Points in doubt, per point inside, beyond which a surface bounds nothing.
const HOPELESS: f64 = 0.5;

/// One run of open edges.
#[derive(Clone, Debug, PartialEq)]
pub struct Hole {
    /// Number of its edges.
    pub edges: usize,
    /// Their length together.
    pub length: f64,
    /// The mean of its edges' middles.
    pub centre: Vec3,
}

/// What is open in a surface and how much that matters.
#[derive(Clone, Debug, PartialEq)]
pub struct Openness {
    /// Runs of open edges, longest first.
    pub holes: Vec<Hole>,
    /// Open edges in all, each as often as it is unanswered.
    pub open_edges: usize,
    /// Edges in all.
    pub edges: usize,
    /// Share of the box that is inside (w > 1/2).
    pub inside: f64,
    /// Points with a winding number between 1/4 and 3/4, per point inside.
    pub doubt: f64,
    /// Whether the surface winds inward: more of the box has w < -1/2 than w > 1/2.
    pub inside_out: bool,
}

impl Openness {
    /// Whether nothing is open.
    pub fn is_closed(&self) -> bool {
        self.open_edges == 0
    }

    /// Whether the surface bounds no solid, not even by its winding number.
    pub fn is_hopeless(&self) -> bool {
        self.inside == 0.0 || self.doubt > HOPELESS
    }

    /// Of a solid, given its mesh with vertices merged, and the sides of its triangles.
    pub(super) fn of(solid: &MeshSolid, merged: &TriMesh, sides: &HalfEdges) -> Self {
        let rim = sides.rim();
        let bounds = solid.bounds();
        let (mut inside, mut negative, mut doubt, mut all) = (0usize, 0usize, 0usize, 0usize);
        for n in 0..SAMPLES.pow(3) {
            // Off the middle, where symmetric meshes put faces.
            let at = [n % SAMPLES, n / SAMPLES % SAMPLES, n / SAMPLES / SAMPLES];
            let share = Vec3::from(at.map(|i| (i as f64 + 0.43) / SAMPLES as f64));
            let w = solid.winding_number(bounds.min + share.component_mul(&bounds.size()));
            all += 1;
            inside += usize::from(w > 0.5);
            negative += usize::from(w < -0.5);
            doubt += usize::from((w - 0.5).abs() < 0.5 - CLEAR);
        }
        if solid.mesh().is_empty() {
            (inside, negative, doubt) = (0, 0, 0);
        }
        Self {
            open_edges: rim.iter().map(|s| s.times as usize).sum(),
            edges: sides.edges().count(),
            holes: holes(merged, rim),
            inside: inside as f64 / all as f64,
            doubt: doubt as f64 / inside.max(1) as f64,
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

/// A surface that bounds no solid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "the surface bounds no solid: {openness}; {:.0} % of its box is inside by the winding number, and {:.2} points are in doubt per point inside (expected at most {HOPELESS})",
    openness.inside * 100.0,
    openness.doubt
)]
pub struct HopelessMesh {
    /// What is open and where.
    pub openness: Openness,
}

impl MeshSolid {
    /// How open the surface is, caps counted as surface.
    pub fn openness(&self) -> Openness {
        let merged = self.mesh().merged();
        let sides = HalfEdges::of(merged.triangles(), merged.vertices().len());
        Openness::of(self, &merged, &sides)
    }
}

/// Chains open edges into runs, longest first.
fn holes(mesh: &TriMesh, sides: Vec<Side>) -> Vec<Hole> {
    let hole = |run: Vec<Side>| {
        let mut hole = Hole {
            edges: run.len(),
            length: 0.0,
            centre: Vec3::zeros(),
        };
        for side in &run {
            let [a, b] = [side.from, side.to].map(|v| mesh.vertices()[v as usize]);
            hole.length += (b - a).norm();
            hole.centre += (a + b) / 2.0;
        }
        hole.centre /= hole.edges as f64;
        hole
    };
    let mut holes: Vec<Hole> = runs(sides).into_iter().map(hole).collect();
    holes.sort_by(|a, b| b.length.total_cmp(&a.length));
    holes
}

/// Chains sides into runs, each a closed one where the sides are a rim with each side as often as it
/// stands there.
pub(super) fn runs(mut sides: Vec<Side>) -> Vec<Vec<Side>> {
    sides.sort_by_key(|s| (s.from, s.to));
    let mut used = vec![false; sides.len()];
    let mut runs = Vec::new();
    for start in 0..sides.len() {
        let mut run = Vec::new();
        let mut next = Some(start).filter(|&s| !used[s]);
        while let Some(i) = next {
            used[i] = true;
            run.push(sides[i]);
            let to = sides[i].to;
            let first = sides.partition_point(|s| s.from < to);
            next = (first..sides.len())
                .take_while(|&j| sides[j].from == to)
                .find(|&j| !used[j]);
        }
        if !run.is_empty() {
            runs.push(run);
        }
    }
    runs
}
