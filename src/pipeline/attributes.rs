//! Numbers to shade a solid by, at any point near it: cells, weights, reference coordinates, thickness.
//!
//! Beyond the scaffold a point takes the numbers of the closest point of the scaffold's boundary.

use super::error::RunError;
use super::inputs::Stock;
use super::level_set_ops::Bench;
use super::thickness::Thickness;
use super::tiling::{CellWeights, Fill};
use crate::frame::{Aabb, CellPoint, Element, Vec3, WorldPoint};
use crate::io::VertexAttribute;
use crate::mesh::MeshSolid;
use crate::recipe::GridWord;
use crate::scaffold::Scaffold;
use crate::vdb::{Attribute, LevelSet};
use rayon::prelude::*;

/// What answers for some words.
pub(super) struct Attributes<'a> {
    words: Vec<GridWord>,
    filling: Option<Filling<'a>>,
    thickness: Option<&'a Thickness>,
    /// Factor on lengths: from the recipe's unit to the file's.
    factor: f32,
}

/// A scaffold with its cells and its boundary.
struct Filling<'a> {
    fill: &'a Fill,
    weights: CellWeights<'a>,
    boundaries: Vec<MeshSolid>,
    slack: f64,
}

impl<'a> Attributes<'a> {
    /// For the words that are numbers; the solid's thickness where that is among them.
    pub fn new(
        bench: Bench,
        stock: &'a Stock,
        words: &[GridWord],
        thickness: Option<&'a Thickness>,
        factor: f64,
    ) -> Result<Self, RunError> {
        let words: Vec<GridWord> = words.iter().filter(|w| w.is_attribute()).cloned().collect();
        let slack = 0.05 * bench.scale.voxel_size;
        let filling = match stock.fill() {
            Some(fill) if words.iter().any(GridWord::needs_scaffold) => Some(Filling {
                fill,
                weights: fill.cell_weights()?,
                boundaries: boundaries(&fill.loaded.scaffold, slack),
                slack,
            }),
            _ => None,
        };
        Ok(Self {
            words,
            filling,
            thickness,
            factor: factor as f32,
        })
    }

    /// The words, in order.
    pub fn words(&self) -> &[GridWord] {
        &self.words
    }

    /// Numbers at each point.
    pub fn row(&self) -> usize {
        self.words.iter().map(GridWord::components).sum()
    }

    /// All numbers at points, one after the other.
    pub fn numbers(&self, points: impl Iterator<Item = Vec3>) -> Vec<f32> {
        let mut out = Vec::new();
        for p in points {
            let spot = self.filling.as_ref().and_then(|f| Some((f, f.spot(p)?)));
            let weights = spot.as_ref().map(|(f, (e, xi))| f.weights.list(*e, *xi));
            for word in &self.words {
                match (word, &spot) {
                    (GridWord::Thickness, _) => {
                        let t = self.thickness.map_or(0.0, |t| t.at(p));
                        out.push(t * self.factor);
                    }
                    (GridWord::CellId, Some(_)) => out.push(greatest(weights.as_deref())),
                    (GridWord::ElementId, Some((f, (e, _)))) => {
                        out.push(f.fill.loaded.scaffold.number(*e) as f32);
                    }
                    (GridWord::Weight(name), Some((f, _))) => {
                        let place = f.fill.palette.iter().position(|entry| entry.name == *name);
                        let own = place.and_then(|n| weights.as_ref()?.get(n));
                        out.push(own.map_or(0.0, |w| *w as f32));
                    }
                    (GridWord::Uvw, Some((_, (_, xi)))) => {
                        out.extend(xi.0.map(|c| c as f32).iter());
                    }
                    (GridWord::Fold, Some((f, (e, xi)))) => {
                        let shape = f.fill.loaded.scaffold.element(*e).shape();
                        out.extend(folded(shape, *xi).map(|c| c as f32));
                    }
                    (GridWord::CellId | GridWord::ElementId, None) => out.push(-1.0),
                    (word, None) => out.extend(std::iter::repeat_n(0.0, word.components())),
                    (GridWord::Surface | GridWord::Density, _) => {}
                }
            }
        }
        out
    }

    /// As grids on the voxels of a level set, in the order of the words.
    pub fn grids(&self, bench: Bench, solid: &LevelSet) -> Result<Vec<Attribute>, RunError> {
        let components: Vec<usize> = self.words.iter().map(GridWord::components).collect();
        if components.is_empty() {
            return Ok(Vec::new());
        }
        let leaves = solid.info().map_err(RunError::level_set("grids"))?.leaves;
        bench.progress.stage("grids", Some(leaves));
        let numbers = |points: &[WorldPoint]| self.numbers(points.iter().map(|p| p.0));
        solid
            .attributes(&components, numbers, bench.session())
            .map_err(RunError::level_set("grids"))
    }

    /// All numbers at points, point by point.
    pub fn rows(&self, bench: Bench, points: &[Vec3]) -> Vec<f32> {
        if self.words.is_empty() {
            return Vec::new();
        }
        bench.threads.install(|| {
            let chunks = points.par_chunks(4096);
            let numbers = chunks.flat_map_iter(|c| self.numbers(c.iter().copied()));
            numbers.collect()
        })
    }

    /// A name for each number of a point.
    pub fn names(&self) -> Vec<String> {
        self.words.iter().flat_map(names).collect()
    }

    /// As numbers at vertices.
    pub fn at_vertices(&self, bench: Bench, vertices: &[Vec3]) -> Vec<VertexAttribute> {
        let all = self.rows(bench, vertices);
        let mut start = 0;
        self.words
            .iter()
            .map(|word| {
                let count = word.components();
                let own = start..start + count;
                start += count;
                let rows = all.chunks_exact(self.row());
                VertexAttribute {
                    names: names(word),
                    values: rows.flat_map(|r| r[own.clone()].to_vec()).collect(),
                }
            })
            .collect()
    }
}

/// The outer faces of each component.
fn boundaries(scaffold: &Scaffold, slack: f64) -> Vec<MeshSolid> {
    let components = 0..scaffold.components().len();
    let outer = components.map(|c| MeshSolid::new(scaffold.boundary(c, slack).mesh));
    outer.collect()
}

/// The names of a word's numbers.
fn names(word: &GridWord) -> Vec<String> {
    if word.components() == 1 {
        return vec![word.to_string()];
    }
    ["x", "y", "z"].map(|a| format!("{word}_{a}")).into()
}

/// The place of the greatest weight; the first of equals.
fn greatest(weights: Option<&[f64]>) -> f32 {
    let weights = weights.unwrap_or_default();
    let mut best = 0;
    for (n, w) in weights.iter().enumerate() {
        if *w > weights[best] {
            best = n;
        }
    }
    best as f32
}

impl Filling<'_> {
    /// The element at a point or, beyond the scaffold, at its closest point, with the reference point.
    fn spot(&self, p: Vec3) -> Option<(usize, CellPoint<3>)> {
        let scaffold = &self.fill.loaded.scaffold;
        if let Some((e, xi)) = scaffold.locate(WorldPoint(p)) {
            return Some((e as usize, xi));
        }
        let closest = self.boundaries.iter().map(|b| b.closest(p).point);
        let q = closest.min_by(|a, b| (a - p).norm().total_cmp(&(b - p).norm()))?;
        let mut found = Vec::new();
        let near = Aabb { min: q, max: q }.dilated(2.0 * self.slack);
        scaffold.candidates(&near, &mut found);
        let mut best: Option<(f64, usize, CellPoint<3>)> = None;
        for e in found {
            let element = scaffold.element(e as usize);
            let Ok(xi) = element.inverse(WorldPoint(q)) else {
                continue;
            };
            let beyond = element.shape().face_distance(xi);
            if best.is_none_or(|b| beyond < b.0) {
                best = Some((beyond, e as usize, xi));
            }
        }
        best.map(|(_, e, xi)| (e, xi))
    }
}

/// Reference coordinates folded by all renumberings of the element's nodes.
fn folded(shape: Element, xi: CellPoint<3>) -> [f64; 3] {
    let falling = |v: &mut [f64]| v.sort_by(|a, b| b.total_cmp(a));
    let u = xi.0;
    match shape {
        Element::Tet => {
            let v = shape.vertices();
            let edges = crate::frame::Mat3::from_columns(&[v[1] - v[0], v[2] - v[0], v[3] - v[0]]);
            // The reference tet has a volume.
            let b = edges.try_inverse().unwrap_or_default() * (u - v[0]);
            let mut all = [1.0 - b.sum(), b.x, b.y, b.z];
            falling(&mut all);
            [all[0], all[1], all[2]]
        }
        Element::Wedge | Element::Tri => {
            let v = shape.vertices();
            let (a, b, p) = (v[1] - v[0], v[2] - v[0], u - v[0]);
            let area = a.x * b.y - a.y * b.x;
            let s = (p.x * b.y - p.y * b.x) / area;
            let t = (a.x * p.y - a.y * p.x) / area;
            let mut all = [1.0 - s - t, s, t];
            falling(&mut all);
            [all[0], all[1], u.z.abs()]
        }
        Element::Hex => {
            let mut all = [u.x.abs(), u.y.abs(), u.z.abs()];
            falling(&mut all);
            all
        }
        // Never an element of a scaffold.
        Element::Ball => u.into(),
        Element::Pyramid | Element::Quad => {
            let mut all = [u.x.abs(), u.y.abs()];
            falling(&mut all);
            [all[0], all[1], u.z]
        }
    }
}
