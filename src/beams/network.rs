//! The struts and plates of cells, mapped through the elements of a scaffold.
//!
//! A strut is straight in an affine element and a polyline in a curved one, bisected until its chords leave
//! the curve by no more than the given error. Parts that neighbours share, on faces and edges, count
//! once: those whose corners coincide to 1e-7 of the scaffold's size. A part ends at the faces of its element.

use crate::frame::{CellPoint, Element, Mat3, Vec3};
use crate::scaffold::{ElementMap, Scaffold};
use rayon::prelude::*;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Size of a node's place, as a share of half the scaffold's diagonal.
const GRAIN: f64 = 1e-7;
/// How far the same node may lie apart in two elements, as a share of that size.
const ROUNDING: f64 = 0.01;
/// Slack of an element's faces, reference lengths.
const SLACK: f64 = 1e-9;
/// Most bisections of a curved strut, and most parts along the side of a curved plate.
const MOST_BISECTIONS: u32 = 10;
const MOST_PARTS: f64 = 64.0;
/// Elements mapped at a time.
const BATCH: usize = 1 << 14;

/// Why a network cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NetworkError {
    /// More nodes than are numbered.
    #[error("more than 4 billion nodes of beams; expected fewer: a coarser scaffold or graph")]
    TooMany,
    /// No strut and no plate is in any element.
    #[error("no strut and no plate lies in an element; expected at least one")]
    Empty,
}

/// Struts and plates in one shape of element, reference coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shapes {
    /// Ends and radius of each strut.
    pub struts: Vec<([Vec3; 2], f64)>,
    /// Corners (a flat convex polygon) and half thickness of each plate.
    pub plates: Vec<(Vec<Vec3>, f64)>,
}

impl Shapes {
    /// What of them lies in an element.
    #[must_use]
    pub fn within(&self, element: Element) -> Self {
        let struts = self.struts.iter();
        let plates = self.plates.iter();
        Self {
            struts: struts
                .filter_map(|(ends, r)| Some((clipped(element, *ends)?, *r)))
                .collect(),
            plates: plates
                .map(|(corners, r)| (cropped(element, corners), *r))
                .filter(|(corners, _)| corners.len() > 2)
                .collect(),
        }
    }

    /// Their images under some operators, each part once.
    #[must_use]
    pub fn symmetrised(&self, operators: &[Mat3]) -> Self {
        let mut all = Self::default();
        let same = |a: &Vec3, b: &Vec3| (a - b).norm() < 1e-6;
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

/// The part of a segment inside an element.
fn clipped(element: Element, [a, b]: [Vec3; 2]) -> Option<[Vec3; 2]> {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for face in element.faces() {
        let [u, v] = [a, b].map(|p| face.normal.dot(&p) - face.offset);
        if u <= SLACK && v <= SLACK {
            continue;
        }
        if u > SLACK && v > SLACK {
            return None;
        }
        let cut = u / (u - v);
        if u > SLACK {
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
    (to - from > 1e-9).then(|| [at(from), at(to)])
}

/// The part of a convex polygon inside an element.
fn cropped(element: Element, corners: &[Vec3]) -> Vec<Vec3> {
    let mut left = corners.to_vec();
    for face in element.faces() {
        let over = |p: &Vec3| face.normal.dot(p) - face.offset;
        let mut next = Vec::new();
        for (n, p) in left.iter().enumerate() {
            let q = left[(n + 1) % left.len()];
            let (u, v) = (over(p), over(&q));
            if u <= SLACK {
                next.push(*p);
            }
            if (u > SLACK && v < -SLACK) || (u < -SLACK && v > SLACK) {
                next.push(p + (q - p) * (u / (u - v)));
            }
        }
        left = next;
    }
    left
}

/// A straight piece of a strut.
#[derive(Clone, Debug)]
pub(super) struct Strut {
    pub ends: [u32; 2],
    /// Radii in reference lengths times the elements' mean scale at the ends: the mean over all elements that
    /// share the piece.
    pub radii: [f64; 2],
    /// The first element that has it, and where it lies there.
    pub element: u32,
    pub reference: [Vec3; 2],
    /// A bit for each cell that has it.
    pub cells: u8,
    shared: u32,
}

/// A flat piece of a plate.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub corners: [u32; 3],
    /// Half thicknesses, as [`Strut::radii`], of the first element.
    pub radii: [f64; 3],
    pub element: u32,
    pub reference: [Vec3; 3],
    pub cells: u8,
}

/// Struts and plates over a scaffold, each once.
#[derive(Clone, Debug, Default)]
pub struct Network {
    pub(super) nodes: Vec<Vec3>,
    pub(super) struts: Vec<Strut>,
    pub(super) facets: Vec<Facet>,
}

/// A piece as an element maps it.
#[derive(Clone, Copy)]
struct Mapped<const N: usize> {
    cell: u8,
    element: u32,
    places: [Vec3; N],
    reference: [Vec3; N],
    radii: [f64; N],
}

/// The pieces of one element.
type Pieces = (Vec<Mapped<2>>, Vec<Mapped<3>>);

impl Network {
    /// Maps the parts of cells (for each, its parts by shape of element) through all elements; `chord` bounds
    /// how far pieces leave curved parts, world units.
    ///
    /// # Errors
    /// [`NetworkError`].
    pub fn new(
        scaffold: &Scaffold,
        cells: &[Vec<(Element, Shapes)>],
        chord: f64,
    ) -> Result<Self, NetworkError> {
        let grain = GRAIN * scaffold.bounds().half_diagonal();
        let mut builder = Builder {
            network: Self::default(),
            grain,
            numbers: HashMap::new(),
            struts: HashMap::new(),
            facets: HashMap::new(),
        };
        for first in (0..scaffold.len()).step_by(BATCH) {
            let last = scaffold.len().min(first + BATCH);
            let mapped: Vec<Pieces> = (first..last)
                .into_par_iter()
                .map(|e| pieces(&scaffold.element(e), cells, chord))
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
        for strut in &mut network.struts {
            strut.radii = strut.radii.map(|r| r / f64::from(strut.shared));
        }
        if network.struts.is_empty() && network.facets.is_empty() {
            return Err(NetworkError::Empty);
        }
        Ok(network)
    }

    /// Number of nodes, of straight pieces of struts and of flat pieces of plates.
    pub fn counts(&self) -> [usize; 3] {
        [self.nodes.len(), self.struts.len(), self.facets.len()]
    }
}

/// Numbers nodes and pieces.
struct Builder {
    network: Network,
    grain: f64,
    numbers: HashMap<[i64; 3], u32>,
    struts: HashMap<[u32; 2], u32>,
    facets: HashMap<[u32; 3], u32>,
}

impl Builder {
    fn node(&mut self, p: Vec3) -> Result<u32, NetworkError> {
        let next = u32::try_from(self.network.nodes.len()).map_err(|_| NetworkError::TooMany)?;
        let scaled = p / self.grain;
        let key = <[i64; 3]>::from(scaled.map(|c| c.round() as i64));
        if let Some(known) = self.numbers.get(&key) {
            return Ok(*known);
        }
        // Rounding may have put the same place into a neighbouring cube.
        let beside = scaled.map(|c| {
            let part = c - c.round();
            let near = part.abs() > 0.5 - ROUNDING;
            if near { part.signum() as i64 } else { 0 }
        });
        if beside.iter().any(|&b| b != 0) {
            for n in 1..8 {
                let step = |a: usize| if n >> a & 1 == 1 { beside[a] } else { 0 };
                let other = [key[0] + step(0), key[1] + step(1), key[2] + step(2)];
                if let Some(known) = self.numbers.get(&other) {
                    return Ok(*known);
                }
            }
        }
        self.network.nodes.push(p);
        self.numbers.insert(key, next);
        Ok(next)
    }

    fn strut(&mut self, piece: &Mapped<2>) -> Result<(), NetworkError> {
        let ends = [self.node(piece.places[0])?, self.node(piece.places[1])?];
        if ends[0] == ends[1] {
            return Ok(());
        }
        let next = self.network.struts.len() as u32;
        match self
            .struts
            .entry([ends[0].min(ends[1]), ends[0].max(ends[1])])
        {
            Entry::Vacant(place) => {
                place.insert(next);
                self.network.struts.push(Strut {
                    ends,
                    radii: piece.radii,
                    element: piece.element,
                    reference: piece.reference,
                    cells: 1 << piece.cell,
                    shared: 1,
                });
            }
            Entry::Occupied(place) => {
                let known = &mut self.network.struts[*place.get() as usize];
                for (n, r) in piece.radii.into_iter().enumerate() {
                    let at = if known.ends[n] == ends[n] { n } else { 1 - n };
                    known.radii[at] += r;
                }
                known.shared += 1;
                known.cells |= 1 << piece.cell;
            }
        }
        Ok(())
    }

    fn facet(&mut self, piece: &Mapped<3>) -> Result<(), NetworkError> {
        let [a, b, c] = piece.places;
        let corners = [self.node(a)?, self.node(b)?, self.node(c)?];
        let mut key = corners;
        key.sort_unstable();
        if key[0] == key[1] || key[1] == key[2] {
            return Ok(());
        }
        let next = self.network.facets.len() as u32;
        match self.facets.entry(key) {
            Entry::Vacant(place) => {
                place.insert(next);
                self.network.facets.push(Facet {
                    corners,
                    radii: piece.radii,
                    element: piece.element,
                    reference: piece.reference,
                    cells: 1 << piece.cell,
                });
            }
            Entry::Occupied(place) => {
                self.network.facets[*place.get() as usize].cells |= 1 << piece.cell;
            }
        }
        Ok(())
    }
}

/// All pieces of all cells in one element.
fn pieces(element: &ElementMap, cells: &[Vec<(Element, Shapes)>], chord: f64) -> Pieces {
    let mut all = Pieces::default();
    let shape = element.shape();
    for (cell, shapes) in cells.iter().enumerate() {
        let Some((_, parts)) = shapes.iter().find(|s| s.0 == shape) else {
            continue;
        };
        let maker = Maker {
            element,
            cell: cell as u8,
            chord,
        };
        for (ends, radius) in &parts.struts {
            maker.line(*ends, *radius, &mut all.0);
        }
        for (corners, radius) in &parts.plates {
            for n in 1..corners.len() - 1 {
                let fan = [corners[0], corners[n], corners[n + 1]];
                maker.triangle(fan, *radius, &mut all.1);
            }
        }
    }
    all
}

/// Makes the pieces of one cell in one element.
struct Maker<'a> {
    element: &'a ElementMap<'a>,
    cell: u8,
    chord: f64,
}

impl Maker<'_> {
    fn place(&self, xi: Vec3) -> Vec3 {
        self.element.map(CellPoint(xi)).0
    }

    fn mapped<const N: usize>(&self, reference: [Vec3; N], radius: f64) -> Mapped<N> {
        let at = reference.map(|xi| self.element.map_and_jacobian(CellPoint(xi)));
        Mapped {
            cell: self.cell,
            element: self.element.index() as u32,
            places: at.map(|(p, _)| p.0),
            reference,
            radii: at.map(|(_, j)| radius * libm::cbrt(j.determinant().abs())),
        }
    }

    fn line(&self, ends: [Vec3; 2], radius: f64, out: &mut Vec<Mapped<2>>) {
        if self.element.is_affine() {
            out.push(self.mapped(ends, radius));
            return;
        }
        self.bisect(ends, radius, MOST_BISECTIONS, out);
    }

    fn bisect(&self, [a, b]: [Vec3; 2], radius: f64, left: u32, out: &mut Vec<Mapped<2>>) {
        let (from, to) = (self.place(a), self.place(b));
        let off = [0.25, 0.5, 0.75].map(|t| beside(self.place(a + (b - a) * t), [from, to]));
        if left == 0 || off.iter().all(|&d| d <= self.chord) {
            out.push(self.mapped([a, b], radius));
            return;
        }
        let middle = (a + b) / 2.0;
        self.bisect([a, middle], radius, left - 1, out);
        self.bisect([middle, b], radius, left - 1, out);
    }

    fn triangle(&self, corners: [Vec3; 3], radius: f64, out: &mut Vec<Mapped<3>>) {
        let mut count = 1;
        if !self.element.is_affine() {
            let places = corners.map(|c| self.place(c));
            let mut worst = 0.0f64;
            let mut look = |w: [f64; 3]| {
                let mix = |p: &[Vec3; 3]| p[0] * w[0] + p[1] * w[1] + p[2] * w[2];
                worst = worst.max((self.place(mix(&corners)) - mix(&places)).norm());
            };
            look([1.0 / 3.0; 3]);
            for t in [0.25, 0.5, 0.75] {
                look([t, 1.0 - t, 0.0]);
                look([0.0, t, 1.0 - t]);
                look([1.0 - t, 0.0, t]);
            }
            count = (worst / self.chord).sqrt().ceil().clamp(1.0, MOST_PARTS) as usize;
        }
        for part in divided(corners, count) {
            out.push(self.mapped(part, radius));
        }
    }
}

/// How far a point lies beside a segment.
fn beside(p: Vec3, [a, b]: [Vec3; 2]) -> f64 {
    let along = b - a;
    let square = along.norm_squared();
    let t = if square > 0.0 {
        ((p - a).dot(&along) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (p - a - along * t).norm()
}

/// A triangle in `count`^2 equal parts.
pub(super) fn divided([a, b, c]: [Vec3; 3], count: usize) -> impl Iterator<Item = [Vec3; 3]> {
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
