//! Effective properties of a tiling's elements: which cell fills each, how it is graded there, and how it lies.
//!
//! The cell of an element is the one with the greatest weight at its centre. Its law is that of the cell's period
//! at the element's thickness (over the element's size), volume fraction or level, in the element's frame. The
//! mean stretch of a cell's hexes is part of the period; deviations from it, and stretches of tets, are not.

use super::base::error::RunError;
use super::content::inputs::Inputs;
use super::content::tiling::{CellTiling, GradedQuantity};
use crate::frame::{Element, Mat3};
use crate::homogenize::Packing;
use crate::pipeline::content::tiling::Content;
use crate::scaffold::ElementMap;
use crate::vdb::Session;
use frames::{ElementFrame, frames, mean_aspect};
use std::collections::HashMap;

mod frames;
mod law;

pub(super) use law::{Law, LawCell, LawSettings};

/// Tabulated values of a graded law, each a homogenisation; cubics join them.
const TABLE_POINTS: usize = 9;
/// Relative range of a quantity below which one value is tabulated: that of rounding.
const MIN_RELATIVE_RANGE: f64 = 1e-6;
/// Weight at an element's centre below which the element is counted as a blend, which its law is not.
const MIN_CELL_WEIGHT: f64 = 0.95;
/// Stretch beside the mean above which an element is reported, since its law leaves it out.
const REPORTED_STRETCH: f64 = 1.25;

/// The cells and gradings of all elements.
pub(super) struct EffectiveElements<'a> {
    pub tiling: &'a CellTiling,
    pub cells: Vec<LawCell<'a>>,
    /// The cell of each element.
    pub cell_of: Vec<usize>,
    /// The graded quantity of each element: a thickness over the element's size, a volume fraction or a level; 0
    /// without one.
    pub parameters: Vec<f64>,
    /// World length per reference length.
    pub scales: Vec<f64>,
    /// Volumes, in cubes of the recipe's unit.
    pub volumes: Vec<f64>,
    frames: Vec<ElementFrame>,
    /// Number of elements that are blends of cells.
    pub blended: usize,
}

impl<'a> EffectiveElements<'a> {
    /// The elements of the recipe's tiling.
    ///
    /// # Errors
    /// [`RunError`]: no tiling, elements other than hexes and tets, an element that is degenerate at its centre,
    /// weights or a grading that fail, or a graded quantity that is not finite.
    pub fn of(inputs: &'a Inputs) -> Result<Self, RunError> {
        let Some(tiling) = inputs.tiling() else {
            return Err(RunError::Tiling(
                "found no [scaffold] with a [tiling]; expected both for effective properties"
                    .into(),
            ));
        };
        let scaffold = &tiling.loaded.scaffold;
        check_shapes(tiling)?;
        let (frames, packing) = frames(scaffold);
        let frames: Option<Vec<ElementFrame>> = frames.into_iter().collect();
        let frames = frames.ok_or_else(|| {
            RunError::Tiling("an element is degenerate at its centre; it has no frame".into())
        })?;
        let recipe = inputs.recipe;
        let section = recipe.sections().tiling.as_ref();
        let weights = tiling.cell_weights()?;
        let graded = tiling.graded_by_element()?;
        let is_round = matches!(tiling.content(), Content::Beams(_));
        let mut found = Self {
            tiling,
            cells: Vec::new(),
            cell_of: Vec::with_capacity(scaffold.len()),
            parameters: Vec::with_capacity(scaffold.len()),
            scales: Vec::with_capacity(scaffold.len()),
            volumes: scaffold.elements().map(|e| e.volume().abs()).collect(),
            frames,
            blended: 0,
        };
        // A law for each cell of the palette in each shape of element.
        let mut known: HashMap<(usize, Element), usize> = HashMap::new();
        let mut fixed: Vec<Option<f64>> = Vec::new();
        for e in scaffold.elements() {
            let element_weights = weights.list(e.index(), e.shape().centroid());
            // A blend has no law of its own: the cell with the greatest weight at the centre stands for it. `max_by`
            // returns the last of equal ones; comparing the numbers backwards makes it the first.
            let greatest = (0..element_weights.len()).max_by(|&a, &b| {
                element_weights[a]
                    .total_cmp(&element_weights[b])
                    .then(b.cmp(&a))
            });
            let cell = greatest.unwrap_or(0);
            found.blended += usize::from(element_weights[cell] < MIN_CELL_WEIGHT);
            let index = *known.entry((cell, e.shape())).or_insert_with(|| {
                let name = &tiling.palette[cell].name;
                let cell_section = &recipe.sections().cell[name];
                // The cell's own thickness where it has a unit of length; a bare one is in its law.
                let thickness = cell_section
                    .physical_thickness()
                    .filter(|_| is_round && section.is_none_or(|t| t.thickness.is_none()))
                    .map(|t| t.resolve(recipe.scale()));
                // Beams of one diameter, by the volume fraction of the whole or by the cell's own thickness, have one
                // value everywhere, which `fixed` holds for each law.
                let fraction = tiling.target_fraction.filter(|_| is_round);
                let quantity = tiling
                    .graded_quantity()
                    .or(fraction.map(|_| GradedQuantity::VolumeFraction))
                    .or(thickness.map(|_| GradedQuantity::Thickness));
                fixed.push(fraction.or(thickness));
                found.cells.push(LawCell {
                    name,
                    shape: e.shape(),
                    packing,
                    is_round,
                    quantity,
                    aspect: [1.0; 3],
                });
                found.cells.len() - 1
            });
            let scale = size_of(&e);
            let value = graded.as_ref().map(|g| g[e.index()]).or(fixed[index]);
            let value = value.unwrap_or(0.0);
            // Laws are in reference lengths, t / size of the element; without a quantity the parameter is unused.
            let parameter = match found.cells[index].quantity {
                Some(GradedQuantity::Thickness) => value / scale,
                _ => value,
            };
            if !parameter.is_finite() {
                return Err(RunError::Tiling(format!(
                    "the graded quantity is {value} in element {}; expected a finite number",
                    scaffold.number(e.index())
                )));
            }
            found.cell_of.push(index);
            found.parameters.push(parameter);
            found.scales.push(scale);
        }
        for index in 0..found.cells.len() {
            if found.cells[index].shape == Element::Hex {
                found.cells[index].aspect = mean_aspect(found.frames_of(index));
            }
        }
        Ok(found)
    }

    /// Frames and volumes of the elements of a cell.
    fn frames_of(&self, cell: usize) -> impl Iterator<Item = (&ElementFrame, f64)> {
        let members = (0..self.cell_of.len()).filter(move |&e| self.cell_of[e] == cell);
        members.map(|e| (&self.frames[e], self.volumes[e]))
    }

    /// Rotations from the laws' axes to the world's.
    pub fn rotations(&self) -> Vec<Mat3> {
        self.frames.iter().map(|f| f.rotation).collect()
    }

    /// Greatest stretch of an element beside its cell's period, and how many exceed `REPORTED_STRETCH`.
    pub fn stretched(&self) -> (f64, usize) {
        let ratios = self.frames.iter().zip(&self.cell_of);
        let ratios = ratios.map(|(f, &c)| f.ratio_beside(self.cells[c].aspect));
        ratios.fold((1.0, 0), |(most, count), r| {
            (most.max(r), count + usize::from(r > REPORTED_STRETCH))
        })
    }

    /// Least and greatest parameter of the elements of a cell.
    pub fn range(&self, cell: usize) -> [f64; 2] {
        let pairs = self.cell_of.iter().zip(&self.parameters);
        let parameters = pairs.filter(|(c, _)| **c == cell).map(|(_, p)| *p);
        parameters.fold([f64::INFINITY, f64::NEG_INFINITY], |r, p| {
            [r[0].min(p), r[1].max(p)]
        })
    }

    /// The parameters at which a cell is homogenised.
    pub fn table(&self, cell: usize) -> Vec<f64> {
        let [low, high] = self.range(cell);
        let is_graded = self.cells[cell].quantity.is_some()
            && high - low > MIN_RELATIVE_RANGE * high.abs().max(low.abs());
        if !is_graded {
            return vec![f64::midpoint(low, high)];
        }
        let step = (high - low) / (TABLE_POINTS - 1) as f64;
        (0..TABLE_POINTS).map(|n| low + step * n as f64).collect()
    }

    /// The laws of all cells, over the parameters of their elements.
    pub fn laws(
        &self,
        inputs: &Inputs,
        settings: LawSettings,
        session: Session,
    ) -> Result<Vec<Law>, RunError> {
        let law = |cell: usize| {
            let table = self.table(cell);
            Law::new(inputs.recipe, self.cells[cell], &table, settings, session)
        };
        (0..self.cells.len()).map(law).collect()
    }
}

/// World length per reference length of an element: the cube root of its volume over that of its shape.
fn size_of(e: &ElementMap) -> f64 {
    libm::cbrt(e.volume().abs() / e.shape().measure())
}

/// Refuses scaffolds with elements other than hexes and tets: wedges and pyramids have no period.
fn check_shapes(tiling: &CellTiling) -> Result<(), RunError> {
    let scaffold = &tiling.loaded.scaffold;
    let other = scaffold
        .elements()
        .find(|e| !matches!(e.shape(), Element::Hex | Element::Tet));
    let Some(first) = other else {
        return Ok(());
    };
    let count = scaffold
        .elements()
        .filter(|e| e.shape() == first.shape())
        .count();
    Err(RunError::Tiling(format!(
        "found {count} {}s, the first of them element {}, which no periodic cell fills; expected hexes and tets for \
         homogenised cells: [scaffold] all_hex = true divides every element into hexes",
        first.shape().name(),
        scaffold.number(first.index())
    )))
}

/// The number of homogenised cells that decks of the scaffold's elements need.
pub(super) fn table_points(inputs: &Inputs) -> Result<usize, RunError> {
    let elements = EffectiveElements::of(inputs)?;
    Ok((0..elements.cells.len())
        .map(|c| elements.table(c).len())
        .sum())
}

/// The packing's name, for messages.
pub(super) fn packing_name(cell: &LawCell) -> &'static str {
    match cell.packing {
        Packing::Bcc => "bcc",
        Packing::Kuhn => "kuhn",
    }
}
