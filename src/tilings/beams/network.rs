//! Networks: struts and plates of cells, mapped through the elements of a scaffold.
//!
//! A strut is straight in an affine element and a polyline in a curved one, bisected until the deviation of its chords
//! from the curve is within the given error. Parts that neighbours share on faces and edges are stored once: those
//! whose corners coincide up to 1e-7 of half the scaffold's diagonal. A part is clipped to its element.

use crate::scaffold::{ElementMap, Scaffold};
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Spacing of the grid to which nodes are rounded before merging, as a share of half the scaffold's diagonal.
const NODE_SPACING: f64 = 1e-7;
/// Largest distance between the images of one node in two elements, as a share of [`NODE_SPACING`].
const NODE_TOLERANCE: f64 = 0.01;
/// Tolerance of an element's faces, reference lengths.
const FACE_TOLERANCE: f64 = 1e-9;
/// Maximal number of successive bisections of a curved strut.
const MAX_BISECTIONS: u32 = 10;
/// Maximal number of parts along the side of a curved plate.
const MAX_PLATE_PARTS: f64 = 64.0;
/// Elements mapped per batch.
const BATCH_SIZE: usize = 1 << 14;

/// Why a network cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NetworkError {
    /// More nodes than 32-bit indices.
    #[error(
        "the network has more than 4 billion nodes; expected fewer: use a coarser scaffold, or a cell with fewer struts"
    )]
    TooMany,
    /// No strut and no plate in any element.
    #[error("no strut and no plate lies in an element; expected at least one")]
    Empty,
}

/// Struts and plates in a reference element.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReferenceParts {
    /// Ends and radius of each strut.
    pub struts: Vec<([Vec3; 2], f64)>,
    /// Corners (a flat convex polygon) and half thickness of each plate.
    pub plates: Vec<(Vec<Vec3>, f64)>,
}

impl ReferenceParts {
    /// The parts clipped to an element. What lies outside it is dropped.
    #[must_use]
    pub fn clipped_to(&self, element: Element) -> Self {
        let struts = self.struts.iter();
        let plates = self.plates.iter();
        Self {
            struts: struts
                .filter_map(|(ends, r)| Some((clip_segment(element, *ends)?, *r)))
                .collect(),
            plates: plates
                .map(|(corners, r)| (clip_polygon(element, corners), *r))
                .filter(|(corners, _)| corners.len() > 2)
                .collect(),
        }
    }

    /// The images of the parts under operators, without duplicates. The operators act on the element's frame; the order
    /// is that of the operators, then of the parts.
    #[must_use]
    pub fn symmetrised(&self, operators: &[Mat3]) -> Self {
        let mut all = Self::default();
        // Reference lengths are near 1.
        let same = |a: &Vec3, b: &Vec3| (a - b).norm() < 1e-6;
        // A strut is known in either direction, a plate with its corners in any order.
        for g in operators {
            for (ends, r) in &self.struts {
                let [a, b] = ends.map(|e| g * e);
                let is_known = |s: &&([Vec3; 2], f64)| {
                    let [c, d] = &s.0;
                    (same(&a, c) && same(&b, d)) || (same(&a, d) && same(&b, c))
                };
                if !all.struts.iter().any(|s| is_known(&s)) {
                    all.struts.push(([a, b], *r));
                }
            }
            for (corners, r) in &self.plates {
                let moved: Vec<Vec3> = corners.iter().map(|c| g * c).collect();
                let holds = |p: &(Vec<Vec3>, f64)| {
                    p.0.len() == moved.len() && moved.iter().all(|m| p.0.iter().any(|c| same(m, c)))
                };
                if !all.plates.iter().any(holds) {
                    all.plates.push((moved, *r));
                }
            }
        }
        all
    }
}

/// The part of a segment inside an element. `None` if less than 1e-9 of it remains.
fn clip_segment(element: Element, [a, b]: [Vec3; 2]) -> Option<[Vec3; 2]> {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for face in element.faces() {
        let [u, v] = [a, b].map(|p| face.normal.dot(&p) - face.offset);
        if u <= FACE_TOLERANCE && v <= FACE_TOLERANCE {
            continue;
        }
        if u > FACE_TOLERANCE && v > FACE_TOLERANCE {
            return None;
        }
        let cut = u / (u - v);
        if u > FACE_TOLERANCE {
            from = from.max(cut);
        } else {
            to = to.min(cut);
        }
    }
    let at = |t: f64| match t {
        0.0 => a,
        1.0 => b,
        _ => a + (b - a) * t,
    };
    // Shares of the segment: one that only touches the element has no part.
    (to - from > 1e-9).then(|| [at(from), at(to)])
}

/// The part of a convex polygon inside an element. Empty if nothing remains.
fn clip_polygon(element: Element, corners: &[Vec3]) -> Vec<Vec3> {
    let mut remaining = corners.to_vec();
    for face in element.faces() {
        let over = |p: &Vec3| face.normal.dot(p) - face.offset;
        let mut next = Vec::new();
        for (n, p) in remaining.iter().enumerate() {
            let q = remaining[(n + 1) % remaining.len()];
            let (u, v) = (over(p), over(&q));
            if u <= FACE_TOLERANCE {
                next.push(*p);
            }
            if (u > FACE_TOLERANCE && v < -FACE_TOLERANCE)
                || (u < -FACE_TOLERANCE && v > FACE_TOLERANCE)
            {
                next.push(p + (q - p) * (u / (u - v)));
            }
        }
        remaining = next;
    }
    remaining
}

/// A straight segment of a strut.
#[derive(Clone, Debug)]
pub(super) struct Strut {
    pub ends: [u32; 2],
    /// Radii in reference lengths times the elements' mean scale at the ends, averaged over all images of the
    /// segment: one of each element and cell that has it.
    pub radii: [f64; 2],
    /// The first element of the segment, and its reference coordinates there.
    pub element: u32,
    pub reference: [Vec3; 2],
    /// A bit for each cell that contains the segment.
    pub cells: u8,
    /// Number of images whose radii are summed.
    shared: u32,
}

/// A triangle of a plate.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub corners: [u32; 3],
    /// Half thicknesses, as [`Strut::radii`], from the first element.
    pub radii: [f64; 3],
    pub element: u32,
    pub reference: [Vec3; 3],
    pub cells: u8,
}

/// Struts and plates of a scaffold, without duplicates.
#[derive(Clone, Debug, Default)]
pub struct Network {
    pub(super) nodes: Vec<Vec3>,
    pub(super) struts: Vec<Strut>,
    pub(super) facets: Vec<Facet>,
}

/// The image of a segment or triangle under an element's map.
#[derive(Clone, Copy)]
struct MappedSimplex<const N: usize> {
    cell: u8,
    element: u32,
    points: [Vec3; N],
    reference: [Vec3; N],
    radii: [f64; N],
}

/// The segments and triangles of one element.
type MappedParts = (Vec<MappedSimplex<2>>, Vec<MappedSimplex<3>>);

impl Network {
    /// Maps the parts of cells (for each cell, its parts by element shape) through all elements. `chord`
    /// bounds the deviation of segments and triangles from curved parts, world units.
    ///
    /// # Errors
    /// [`NetworkError::Empty`] where no element has a part, [`NetworkError::TooMany`].
    pub fn new(
        scaffold: &Scaffold,
        cells: &[Vec<(Element, ReferenceParts)>],
        chord: f64,
    ) -> Result<Self, NetworkError> {
        let node_spacing = NODE_SPACING * scaffold.bounds().half_diagonal();
        let mut builder = Builder {
            network: Self::default(),
            node_spacing,
            node_indices: HashMap::new(),
            struts: HashMap::new(),
            facets: HashMap::new(),
        };
        // Elements are mapped in parallel and merged in their order: the numbers do not depend on threads. Batches
        // bound the memory.
        for first in (0..scaffold.len()).step_by(BATCH_SIZE) {
            let last = scaffold.len().min(first + BATCH_SIZE);
            let mapped: Vec<MappedParts> = (first..last)
                .into_par_iter()
                .map(|e| map_parts(&scaffold.element(e), cells, chord))
                .collect();
            for (lines, triangles) in mapped {
                for line in lines {
                    builder.strut(&line)?;
                }
                for triangle in triangles {
                    builder.facet(&triangle)?;
                }
            }
        }
        let mut network = builder.network;
        // Sums become means over the elements that share a segment.
        for strut in &mut network.struts {
            strut.radii = strut.radii.map(|r| r / f64::from(strut.shared));
        }
        if network.struts.is_empty() && network.facets.is_empty() {
            return Err(NetworkError::Empty);
        }
        Ok(network)
    }

    /// Number of nodes, of segments and of triangles.
    pub fn counts(&self) -> [usize; 3] {
        [self.nodes.len(), self.struts.len(), self.facets.len()]
    }
}

/// Merges nodes, segments and triangles.
struct Builder {
    network: Network,
    node_spacing: f64,
    node_indices: HashMap<[i64; 3], u32>,
    struts: HashMap<[u32; 2], u32>,
    facets: HashMap<[u32; 3], u32>,
}

impl Builder {
    /// The number of the node at a point: a known one, or a new one. Points are rounded to a grid of `node_spacing`.
    /// The error is more nodes than 32-bit numbers.
    fn node(&mut self, p: Vec3) -> Result<u32, NetworkError> {
        let next = u32::try_from(self.network.nodes.len()).map_err(|_| NetworkError::TooMany)?;
        let scaled = p / self.node_spacing;
        let key = <[i64; 3]>::from(scaled.map(|c| c.round() as i64));
        if let Some(known) = self.node_indices.get(&key) {
            return Ok(*known);
        }
        // Rounding may have assigned the same node to an adjacent key.
        let offset = scaled.map(|c| {
            let part = c - c.round();
            let near = part.abs() > 0.5 - NODE_TOLERANCE;
            if near { part.signum() as i64 } else { 0 }
        });
        // The up to seven keys beside the point's own, on the sides that are within rounding.
        if offset.iter().any(|&b| b != 0) {
            for n in 1..8 {
                let step = |a: usize| {
                    if n >> a & 1 == 1 { offset[a] } else { 0 }
                };
                let other = [key[0] + step(0), key[1] + step(1), key[2] + step(2)];
                if let Some(known) = self.node_indices.get(&other) {
                    return Ok(*known);
                }
            }
        }
        self.network.nodes.push(p);
        self.node_indices.insert(key, next);
        Ok(next)
    }

    /// Adds a segment, or its radii to those of the same segment in another element or cell. Radii are summed, and
    /// `shared` counts the summands. A segment whose ends are one node is dropped.
    fn strut(&mut self, simplex: &MappedSimplex<2>) -> Result<(), NetworkError> {
        let ends = [self.node(simplex.points[0])?, self.node(simplex.points[1])?];
        // Shorter than the spacing of nodes.
        if ends[0] == ends[1] {
            return Ok(());
        }
        let next = self.network.struts.len() as u32;
        match self
            .struts
            .entry([ends[0].min(ends[1]), ends[0].max(ends[1])])
        {
            Entry::Vacant(entry) => {
                entry.insert(next);
                self.network.struts.push(Strut {
                    ends,
                    radii: simplex.radii,
                    element: simplex.element,
                    reference: simplex.reference,
                    cells: 1 << simplex.cell,
                    shared: 1,
                });
            }
            Entry::Occupied(entry) => {
                let known = &mut self.network.struts[*entry.get() as usize];
                for (n, r) in simplex.radii.into_iter().enumerate() {
                    // The known segment may run the other way.
                    let at = if known.ends[n] == ends[n] { n } else { 1 - n };
                    known.radii[at] += r;
                }
                known.shared += 1;
                known.cells |= 1 << simplex.cell;
            }
        }
        Ok(())
    }

    /// Adds a triangle, unless another element or cell has given it. A known triangle only notes the cell; one with two
    /// corners in one node is dropped.
    fn facet(&mut self, simplex: &MappedSimplex<3>) -> Result<(), NetworkError> {
        let [a, b, c] = simplex.points;
        let corners = [self.node(a)?, self.node(b)?, self.node(c)?];
        let mut key = corners;
        key.sort_unstable();
        // Two corners are one node: the triangle has no area.
        if key[0] == key[1] || key[1] == key[2] {
            return Ok(());
        }
        let next = self.network.facets.len() as u32;
        match self.facets.entry(key) {
            Entry::Vacant(entry) => {
                entry.insert(next);
                self.network.facets.push(Facet {
                    corners,
                    radii: simplex.radii,
                    element: simplex.element,
                    reference: simplex.reference,
                    cells: 1 << simplex.cell,
                });
            }
            Entry::Occupied(entry) => {
                self.network.facets[*entry.get() as usize].cells |= 1 << simplex.cell;
            }
        }
        Ok(())
    }
}

/// The segments and triangles of all cells in one element. `cells` holds for each cell its parts by element shape;
/// `chord` bounds the deviation of chords from curves, world units.
fn map_parts(
    element: &ElementMap,
    cells: &[Vec<(Element, ReferenceParts)>],
    chord: f64,
) -> MappedParts {
    let mut all = MappedParts::default();
    let shape = element.shape();
    // A cell that does not fill this shape adds nothing.
    for (cell, shapes) in cells.iter().enumerate() {
        let Some((_, parts)) = shapes.iter().find(|s| s.0 == shape) else {
            continue;
        };
        let mapper = ElementMapper {
            element,
            cell: cell as u8,
            chord,
        };
        for (ends, radius) in &parts.struts {
            mapper.line(*ends, *radius, &mut all.0);
        }
        // A plate is a flat convex polygon: a fan of triangles covers it.
        for (corners, radius) in &parts.plates {
            for n in 1..corners.len() - 1 {
                let fan = [corners[0], corners[n], corners[n + 1]];
                mapper.triangle(fan, *radius, &mut all.1);
            }
        }
    }
    all
}

/// Maps the parts of one cell through one element.
struct ElementMapper<'a> {
    element: &'a ElementMap<'a>,
    cell: u8,
    chord: f64,
}

impl ElementMapper<'_> {
    fn point(&self, xi: Vec3) -> Vec3 {
        self.element.map(CellPoint(xi)).0
    }

    /// A simplex at its mapped corners. `radius` is in the cell's unit; at each corner it is multiplied by the cube
    /// root of the map's change of volume.
    fn mapped<const N: usize>(&self, reference: [Vec3; N], radius: f64) -> MappedSimplex<N> {
        let at = reference.map(|xi| self.element.map_and_jacobian(CellPoint(xi)));
        MappedSimplex {
            cell: self.cell,
            element: self.element.index() as u32,
            points: at.map(|(p, _)| p.0),
            reference,
            radii: at.map(|(_, j)| radius * libm::cbrt(j.determinant().abs())),
        }
    }

    /// Maps a strut between two reference points: one simplex in an affine element, else those of [`Self::bisect`].
    fn line(&self, ends: [Vec3; 2], radius: f64, out: &mut Vec<MappedSimplex<2>>) {
        if self.element.is_affine() {
            out.push(self.mapped(ends, radius));
            return;
        }
        self.bisect(ends, radius, MAX_BISECTIONS, out);
    }

    /// Halves a strut until each part is off its curve by at most `chord` at three inner points, or until `left`
    /// halvings are spent. Parts are appended to `out` from the first end to the last.
    fn bisect(&self, [a, b]: [Vec3; 2], radius: f64, left: u32, out: &mut Vec<MappedSimplex<2>>) {
        let (from, to) = (self.point(a), self.point(b));
        let off =
            [0.25, 0.5, 0.75].map(|t| distance_to_segment(self.point(a + (b - a) * t), [from, to]));
        if left == 0 || off.iter().all(|&d| d <= self.chord) {
            out.push(self.mapped([a, b], radius));
            return;
        }
        let middle = (a + b) / 2.0;
        self.bisect([a, middle], radius, left - 1, out);
        self.bisect([middle, b], radius, left - 1, out);
    }

    /// Maps a triangle of a plate, given by its reference corners, into one simplex, or in a curved element into equal
    /// parts of it, so that none is off by more than about `chord`, world units. Deviations are measured at the middle
    /// and at nine points of the sides. At most `MAX_PLATE_PARTS` squared parts are made, whatever the deviation.
    fn triangle(&self, corners: [Vec3; 3], radius: f64, out: &mut Vec<MappedSimplex<3>>) {
        let mut count = 1;
        if !self.element.is_affine() {
            let points = corners.map(|c| self.point(c));
            let mut max_deviation = 0.0f64;
            let mut check = |w: [f64; 3]| {
                let mix = |p: &[Vec3; 3]| p[0] * w[0] + p[1] * w[1] + p[2] * w[2];
                max_deviation =
                    max_deviation.max((self.point(mix(&corners)) - mix(&points)).norm());
            };
            check([1.0 / 3.0; 3]);
            for t in [0.25, 0.5, 0.75] {
                check([t, 1.0 - t, 0.0]);
                check([0.0, t, 1.0 - t]);
                check([1.0 - t, 0.0, t]);
            }
            // The deviation falls with the square of the number of parts along a side.
            count = (max_deviation / self.chord)
                .sqrt()
                .ceil()
                .clamp(1.0, MAX_PLATE_PARTS) as usize;
        }
        for part in subdivided(corners, count) {
            out.push(self.mapped(part, radius));
        }
    }
}

/// Distance of a point from a segment.
fn distance_to_segment(p: Vec3, [a, b]: [Vec3; 2]) -> f64 {
    let along = b - a;
    let square = along.norm_squared();
    let t = if square > 0.0 {
        ((p - a).dot(&along) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (p - a - along * t).norm()
}

/// A triangle subdivided into `count`^2 equal parts.
pub(super) fn subdivided([a, b, c]: [Vec3; 3], count: usize) -> impl Iterator<Item = [Vec3; 3]> {
    let share = move |n: usize| n as f64 / count as f64;
    let at = move |i: usize, j: usize| a + (b - a) * share(i) + (c - a) * share(j);
    (0..count).flat_map(move |i| {
        (0..count - i).flat_map(move |j| {
            let first = [at(i, j), at(i + 1, j), at(i, j + 1)];
            let second = [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let has_second = i + j + 2 <= count;
            std::iter::once(first).chain(has_second.then_some(second))
        })
    })
}
