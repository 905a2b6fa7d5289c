//! Holes of a surface, and whether the winding number can close them.
//!
//! A closed surface bounds a solid if its signed volume, the integral of the winding number w, is positive. The
//! winding number closes a hole by its level w = 1/2, which resembles a minimal surface across the hole. The result
//! is meaningful if w is clearly above 1/2 in most of the inside; a sheet or half a box bounds no solid. Points of
//! the bounding box decide, or points beside the triangles where the walls are too thin for those.

use super::half_edges::{BoundaryEdge, HalfEdges};
use super::{MeshSolid, TriMesh};
use crate::frame::Vec3;
use std::fmt;

/// Samples of the winding number per axis of the bounding box.
const SAMPLES_PER_AXIS: usize = 20;
/// Mean thickness (volume over area) of a closed surface below which it is flat, over the size of its box. A product of
/// three differences from the centre of the box is good to four roundings of double precision, so its sign is known.
const FLAT_THICKNESS_RATIO: f64 = 1e-15;
/// One of the 20^3 samples of the box as a fraction.
const MIN_FRACTION: f64 = 1.0 / 8000.0;
/// Samples of the winding number beside the triangles.
const SAMPLES_AT_TRIANGLES: usize = 4000;
/// Distance of these samples from their triangles, over the greatest coordinate.
const SIDE_OFFSET_RATIO: f64 = 1e-12;
/// Least fraction of the bounding box inside an open surface by which the box decides.
const MIN_INSIDE: f64 = 0.025;
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
    /// The fraction of the samples that are inside (w > 1/2): in the bounding box, or just behind the triangles
    /// where less than 2.5 % of the box is inside, or inside out. For a closed surface that is not flat, the ratio
    /// of its volume to that of the box, 0 to 1.
    pub inside: f64,
    /// The ratio of samples with a winding number between 1/4 and 3/4 to samples inside.
    pub uncertain: f64,
    /// Whether the surface is oriented inward: its volume is negative, or if it is open or flat, more samples have
    /// w < -1/2 than w > 1/2.
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
        let boundary = sides.boundary();
        let samples = if boundary.is_empty() {
            Samples::of_closed(solid)
        } else {
            Samples::of_open(solid)
        };
        Self {
            open_edges: boundary.iter().map(|s| s.multiplicity as usize).sum(),
            edges: sides.edges().count(),
            holes: holes(merged, boundary),
            inside: samples.inside,
            uncertain: samples.uncertain / samples.inside.max(MIN_FRACTION),
            inside_out: samples.negative > samples.inside,
        }
    }
}

/// Fractions of some samples of the winding number w.
#[derive(Clone, Copy, Default)]
struct Samples {
    /// w > 1/2.
    inside: f64,
    /// w < -1/2.
    negative: f64,
    /// 1/4 < w < 3/4.
    uncertain: f64,
}

impl Samples {
    /// The volume of a closed surface decides, or the space beside the triangles where the volume vanishes.
    fn of_closed(solid: &MeshSolid) -> Self {
        let mesh = solid.mesh();
        let volume = mesh.volume();
        let size = solid.bounds().size();
        if volume.abs() <= FLAT_THICKNESS_RATIO * size.amax() * mesh.area() {
            return Self::beside_triangles(solid);
        }
        let fraction = volume / size.product();
        Self {
            inside: fraction.clamp(0.0, 1.0),
            negative: (-fraction).clamp(0.0, 1.0),
            uncertain: 0.0,
        }
    }

    fn of_open(solid: &MeshSolid) -> Self {
        let in_box = Self::of_box(solid);
        // Thin walls lie between the samples of the box.
        if in_box.inside.max(in_box.negative) < MIN_INSIDE {
            Self::beside_triangles(solid)
        } else {
            in_box
        }
    }

    /// Samples of a regular lattice in the bounding box.
    fn of_box(solid: &MeshSolid) -> Self {
        const N: usize = SAMPLES_PER_AXIS;
        let bounds = solid.bounds();
        let mut counts = Self::default();
        for n in 0..N.pow(3) {
            // Off the cell centres: symmetric meshes have faces there.
            let index = [n % N, n / N % N, n / N / N];
            let fraction = Vec3::from(index.map(|i| (i as f64 + 0.43) / N as f64));
            let w = solid.winding_number(bounds.min + fraction.component_mul(&bounds.size()));
            counts.add(w, w);
        }
        counts.over(N.pow(3))
    }

    /// Samples just behind and in front of the triangles, spread evenly over the area. Each sample counts the winding
    /// numbers on both sides; a mesh without area has no counts.
    fn beside_triangles(solid: &MeshSolid) -> Self {
        let mesh = solid.mesh();
        // Twice the areas of the triangles before each one, for sampling by area.
        let mut area_before = Vec::with_capacity(mesh.triangles().len());
        let mut area = 0.0;
        for [a, b, c] in mesh.iter_corners() {
            area_before.push(area);
            area += (b - a).cross(&(c - a)).norm();
        }
        let mut counts = Self::default();
        if area == 0.0 {
            return counts;
        }
        let bounds = solid.bounds();
        // The offset follows the greatest coordinate, so that it exceeds the rounding of points.
        let offset = SIDE_OFFSET_RATIO * bounds.min.amax().max(bounds.max.amax());
        for n in 0..SAMPLES_AT_TRIANGLES {
            let at = (n as f64 + 0.5) / SAMPLES_AT_TRIANGLES as f64 * area;
            // The triangle at this share of the total area.
            let t = area_before.partition_point(|before| *before <= at) - 1;
            let [a, b, c] = mesh.corners(t);
            // A sequence of low discrepancy in the unit square (Roberts 2018), folded onto the triangle.
            let [u, v] = [0.754_877_666, 0.569_840_291].map(|step| (n as f64 * step).fract());
            let [u, v] = if u + v > 1.0 {
                [1.0 - u, 1.0 - v]
            } else {
                [u, v]
            };
            let normal = (b - a).cross(&(c - a)).try_normalize(0.0);
            let side = normal.unwrap_or_default() * offset;
            let p = a + (b - a) * u + (c - a) * v;
            counts.add(
                solid.winding_number(p - side),
                solid.winding_number(p + side),
            );
        }
        counts.over(SAMPLES_AT_TRIANGLES)
    }

    /// Counts a winding number where the inside may be, and one where it may be if the surface is inside out.
    fn add(&mut self, behind: f64, in_front: f64) {
        let count = |holds: bool| f64::from(u8::from(holds));
        self.inside += count(behind > 0.5);
        self.negative += count(in_front < -0.5);
        self.uncertain += count((behind - 0.5).abs() < 0.5 - UNCERTAIN_WINDING);
    }

    /// Counts as fractions of `count` samples.
    fn over(self, count: usize) -> Self {
        let count = count as f64;
        Self {
            inside: self.inside / count,
            negative: self.negative / count,
            uncertain: self.uncertain / count,
        }
    }
}

impl fmt::Display for Openness {
    /// The openness in words, for messages: the numbers of open edges, edges and holes, and the longest hole with its
    /// place, in world units. Without holes, whether there is a volume.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(hole) = self.holes.first() else {
            let volume = if self.inside == 0.0 {
                ", and no volume beyond the rounding of its coordinates"
            } else {
                ""
            };
            return write!(f, "no open edges{volume}");
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
    "the surface bounds no solid: {openness}; {:.0} % of the samples of its box or its sides are inside by the winding number, and the ratio of uncertain to inside points is {:.2} (expected at most {MAX_UNCERTAIN_RATIO})",
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
