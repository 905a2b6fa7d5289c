//! Attributes that shade a solid, at any point near it: numbers of cells and elements, weights, reference coordinates,
//! velocity and place at rest, thickness.
//!
//! Outside the scaffold a point takes all but the thickness from the closest point of the scaffold's boundary.

use crate::frame::{Aabb, CellPoint, Element, Vec3, WorldPoint};
use crate::io::VertexAttribute;
use crate::mesh::MeshSolid;
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::RunError;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::content::tiling::{CellTiling, CellWeights};
use crate::pipeline::measure::thickness::Thickness;
use crate::recipe::GridWord;
use crate::scaffold::Scaffold;
use crate::vdb::{Attribute, LevelSet};
use rayon::prelude::*;

/// Evaluates the attributes that an output names.
pub(crate) struct Attributes<'a> {
    words: Vec<GridWord>,
    tiling: Option<TilingAttributes<'a>>,
    thickness: Option<&'a Thickness>,
    /// Factor on lengths: from the recipe's unit to the file's.
    factor: f32,
}

/// A tiled scaffold with its cell weights and its boundary.
struct TilingAttributes<'a> {
    tiling: &'a CellTiling,
    weights: CellWeights<'a>,
    boundaries: Vec<MeshSolid>,
    /// Chordal error of the boundaries, world units.
    slack: f64,
}

impl<'a> Attributes<'a> {
    /// Keeps the words that are attributes. Without `thickness` the values of that word are 0. `factor` converts
    /// lengths from the recipe's unit to the file's.
    pub fn new(
        context: StageContext,
        inputs: &'a Inputs,
        words: &[GridWord],
        thickness: Option<&'a Thickness>,
        factor: f64,
    ) -> Result<Self, RunError> {
        let words: Vec<GridWord> = words.iter().filter(|w| w.is_attribute()).cloned().collect();
        // A twentieth of a voxel cannot be seen in the shading.
        let slack = 0.05 * context.scale.voxel_size;
        let tiling = match inputs.tiling() {
            Some(tiling) if words.iter().any(GridWord::needs_scaffold) => Some(TilingAttributes {
                tiling,
                weights: tiling.cell_weights()?,
                boundaries: boundaries(&tiling.loaded.scaffold, slack),
                slack,
            }),
            _ => None,
        };
        Ok(Self {
            words,
            tiling,
            thickness,
            factor: factor as f32,
        })
    }

    /// The words, in order.
    pub fn words(&self) -> &[GridWord] {
        &self.words
    }

    /// Number of values per point.
    pub fn values_per_point(&self) -> usize {
        self.words.iter().map(GridWord::components).sum()
    }

    /// The values of all words at points, point by point in one list; words with several components
    /// take as many places.
    pub fn values(&self, points: impl Iterator<Item = Vec3>) -> Vec<f32> {
        let mut out = Vec::new();
        for p in points {
            let located = self.tiling.as_ref().and_then(|f| Some((f, f.locate(p)?)));
            let weights = located.as_ref().map(|(f, (e, xi))| f.weights.list(*e, *xi));
            for word in &self.words {
                match (word, &located) {
                    (GridWord::Thickness, _) => {
                        let t = self.thickness.map_or(0.0, |t| t.at(p));
                        out.push(t * self.factor);
                    }
                    (GridWord::Vel, Some((f, (e, xi)))) => {
                        let velocity = &f.tiling.loaded.motion.velocity;
                        out.extend(f.interpolated(velocity, *e, *xi, self.factor));
                    }
                    (GridWord::Rest, Some((f, (e, xi)))) => {
                        let rest = &f.tiling.loaded.motion.rest;
                        out.extend(f.interpolated(rest, *e, *xi, self.factor));
                    }
                    (GridWord::CellId, Some(_)) => out.push(index_of_greatest(weights.as_deref())),
                    (GridWord::ElementId, Some((f, (e, _)))) => {
                        out.push(f.tiling.loaded.scaffold.number(*e) as f32);
                    }
                    (GridWord::Weight(name), Some((f, _))) => {
                        let index = f
                            .tiling
                            .palette
                            .iter()
                            .position(|entry| entry.name == *name);
                        let weight = index.and_then(|n| weights.as_ref()?.get(n));
                        out.push(weight.map_or(0.0, |w| *w as f32));
                    }
                    (GridWord::Uvw, Some((_, (_, xi)))) => {
                        out.extend(xi.0.map(|c| c as f32).iter());
                    }
                    (GridWord::Fold, Some((f, (e, xi)))) => {
                        let shape = f.tiling.loaded.scaffold.element(*e).shape();
                        out.extend(folded(shape, *xi).map(|c| c as f32));
                    }
                    // Where no element is found: -1 for numbers, 0 for all words but the thickness.
                    (GridWord::CellId | GridWord::ElementId, None) => out.push(-1.0),
                    (word, None) => out.extend(std::iter::repeat_n(0.0, word.components())),
                    (GridWord::Surface | GridWord::Density, _) => {}
                }
            }
        }
        out
    }

    /// The values as grids on the voxels of a level set, in the order of the words.
    pub fn grids(
        &self,
        context: StageContext,
        solid: &LevelSet,
    ) -> Result<Vec<Attribute>, RunError> {
        let components: Vec<usize> = self.words.iter().map(GridWord::components).collect();
        if components.is_empty() {
            return Ok(Vec::new());
        }
        let leaves = solid.info().map_err(RunError::level_set("grids"))?.leaves;
        context.progress.stage("grids", Some(leaves));
        let values = |points: &[WorldPoint]| self.values(points.iter().map(|p| p.0));
        solid
            .attributes(&components, values, context.session())
            .map_err(RunError::level_set("grids"))
    }

    /// The values at points, computed in parallel.
    pub fn rows_at(&self, context: StageContext, points: &[Vec3]) -> Vec<f32> {
        if self.words.is_empty() {
            return Vec::new();
        }
        context.threads.install(|| {
            let chunks = points.par_chunks(4096);
            let values = chunks.flat_map_iter(|c| self.values(c.iter().copied()));
            values.collect()
        })
    }

    /// A name for each value of a point.
    pub fn names(&self) -> Vec<String> {
        self.words.iter().flat_map(names).collect()
    }

    /// The values at vertices, grouped by word.
    pub fn at_vertices(&self, context: StageContext, vertices: &[Vec3]) -> Vec<VertexAttribute> {
        let all = self.rows_at(context, vertices);
        let mut start = 0;
        self.words
            .iter()
            .map(|word| {
                let count = word.components();
                let columns = start..start + count;
                start += count;
                let rows = all.chunks_exact(self.values_per_point());
                VertexAttribute {
                    names: names(word),
                    values: rows.flat_map(|row| row[columns.clone()].to_vec()).collect(),
                }
            })
            .collect()
    }
}

/// The outer faces of each component, to a chordal error of `slack` (world units).
fn boundaries(scaffold: &Scaffold, slack: f64) -> Vec<MeshSolid> {
    let components = 0..scaffold.components().len();
    let outer = components.map(|c| MeshSolid::new(scaffold.boundary(c, slack).mesh));
    outer.collect()
}

/// The names of a word's values.
fn names(word: &GridWord) -> Vec<String> {
    if word.components() == 1 {
        return vec![word.to_string()];
    }
    ["x", "y", "z"].map(|a| format!("{word}_{a}")).into()
}

/// The index of the greatest weight; the first of equal ones.
fn index_of_greatest(weights: Option<&[f64]>) -> f32 {
    let weights = weights.unwrap_or_default();
    let mut best = 0;
    for (n, w) in weights.iter().enumerate() {
        if *w > weights[best] {
            best = n;
        }
    }
    best as f32
}

impl TilingAttributes<'_> {
    /// The value of a vector field, given at the `nodes` of the scaffold, at a reference point of an element,
    /// times a factor.
    fn interpolated(
        &self,
        nodes: &[Vec3],
        element: usize,
        xi: CellPoint<3>,
        factor: f32,
    ) -> [f32; 3] {
        let element = self.tiling.loaded.scaffold.element(element);
        let weights = element.kind().shape_functions(xi);
        let pairs = element.nodes().iter().zip(weights);
        let sum = pairs.fold(Vec3::zeros(), |sum, (&n, w)| {
            sum + nodes.get(n as usize).copied().unwrap_or_default() * w
        });
        [
            sum.x as f32 * factor,
            sum.y as f32 * factor,
            sum.z as f32 * factor,
        ]
    }

    /// The element at a point and its reference point; outside the scaffold, those of the closest boundary point.
    /// `None` only where no element holds that point.
    fn locate(&self, p: Vec3) -> Option<(usize, CellPoint<3>)> {
        let scaffold = &self.tiling.loaded.scaffold;
        if let Some((e, xi)) = scaffold.locate(WorldPoint(p)) {
            return Some((e as usize, xi));
        }
        let closest = self.boundaries.iter().map(|b| b.closest(p).point);
        let q = closest.min_by(|a, b| (a - p).norm().total_cmp(&(b - p).norm()))?;
        let mut found = Vec::new();
        // The faces deviate from the elements by `slack`; twice that, for rounding.
        let region = Aabb { min: q, max: q }.dilated(2.0 * self.slack);
        scaffold.candidates(&region, &mut found);
        let mut best: Option<(f64, usize, CellPoint<3>)> = None;
        for e in found {
            let element = scaffold.element(e as usize);
            let Ok(xi) = element.inverse(WorldPoint(q)) else {
                continue;
            };
            let face_distance = element.shape().face_distance(xi);
            // The element that holds the point deepest: face distances are negative inside.
            if best.is_none_or(|b| face_distance < b.0) {
                best = Some((face_distance, e as usize, xi));
            }
        }
        best.map(|(_, e, xi)| (e, xi))
    }
}

/// Reference coordinates reduced by the symmetry of the element: equal for all numberings of its nodes. For tets,
/// wedges and triangles the greatest barycentric coordinates, for others absolute coordinates in falling order; heights
/// of wedges and pyramids stand last.
fn folded(shape: Element, xi: CellPoint<3>) -> [f64; 3] {
    let sort_descending = |v: &mut [f64]| v.sort_by(|a, b| b.total_cmp(a));
    let u = xi.0;
    match shape {
        Element::Tet => {
            let v = shape.vertices();
            let edges = crate::frame::Mat3::from_columns(&[v[1] - v[0], v[2] - v[0], v[3] - v[0]]);
            // The edges of the reference tet are independent, so the inverse exists.
            let b = edges.try_inverse().unwrap_or_default() * (u - v[0]);
            let mut barycentric = [1.0 - b.sum(), b.x, b.y, b.z];
            sort_descending(&mut barycentric);
            [barycentric[0], barycentric[1], barycentric[2]]
        }
        Element::Wedge | Element::Tri => {
            let v = shape.vertices();
            let (a, b, p) = (v[1] - v[0], v[2] - v[0], u - v[0]);
            let area = a.x * b.y - a.y * b.x;
            let s = (p.x * b.y - p.y * b.x) / area;
            let t = (a.x * p.y - a.y * p.x) / area;
            let mut barycentric = [1.0 - s - t, s, t];
            sort_descending(&mut barycentric);
            [barycentric[0], barycentric[1], u.z.abs()]
        }
        Element::Hex => {
            let mut folded = [u.x.abs(), u.y.abs(), u.z.abs()];
            sort_descending(&mut folded);
            folded
        }
        // The ball is not an element of scaffolds.
        Element::Ball => u.into(),
        Element::Pyramid | Element::Quad => {
            let mut folded = [u.x.abs(), u.y.abs()];
            sort_descending(&mut folded);
            [folded[0], folded[1], u.z]
        }
    }
}
