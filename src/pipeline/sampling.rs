//! Probes of a recipe's tiled field at points, and its continuity over shared faces, without sampling a
//! band.

use super::base::error::RunError;
use super::base::offset::Offsets;
use super::base::report::{ContinuityReport, ScaffoldReport};
use super::base::warning::Warning;
use super::content::inputs::Inputs;
use super::content::round_beams::RoundBeams;
use super::content::sheets::SheetOptions;
use super::content::tiling::{CellTiling, ElementContent};
use super::inputs::run_options::{RunOptions, threads};
use crate::cell::{Cell, Table};
use crate::field::{Field, WorldField};
use crate::frame::{Vec3, WorldPoint};
use crate::pipeline::content::tiling::Content;
use crate::progress::{Progress, Threads};
use crate::recipe::Recipe;
use crate::tiling::{CellField, TiledSolid, TilingError, TilingOptions};
use rayon::prelude::*;
use std::path::Path;

/// The tiled field at a point.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldSample {
    /// The field's value in the units of the cell; NaN outside the scaffold. Of beams and sheets it is a distance.
    pub phi: f64,
    /// Its gradient per world length; NaN where the element's map has no inverse.
    pub gradient: [f64; 3],
    /// Signed distance of the tiled solid before any operation, recipe units, clamped to the band; outside the
    /// scaffold too.
    pub distance: f64,
    /// The element's number in its file; -1 outside.
    pub element: i64,
    /// Reference coordinates in the element.
    pub reference: [f64; 3],
    /// Weights of the cells, in the order of [`Probe::cells`].
    pub weights: Vec<f64>,
}

impl FieldSample {
    /// The values at a point outside the scaffold.
    fn outside(distance: f64, cells: usize) -> Self {
        Self {
            phi: f64::NAN,
            gradient: [f64::NAN; 3],
            distance,
            element: -1,
            reference: [f64::NAN; 3],
            weights: vec![f64::NAN; cells],
        }
    }
}

/// A recipe's scaffold and cells, ready for evaluation.
pub struct Probe<'a> {
    inputs: Inputs<'a>,
    threads: Threads,
}

impl<'a> Probe<'a> {
    /// Reads a recipe's scaffold and cells.
    ///
    /// # Errors
    /// As [`super::run`]; a recipe without a scaffold.
    pub fn new(
        recipe: &'a Recipe,
        options: &'a RunOptions,
        progress: &dyn Progress,
    ) -> Result<Self, RunError> {
        let threads = threads(options)?;
        let inputs = Inputs::load(recipe, &threads, options, progress)?;
        if inputs.tiling().is_none() {
            return Err(RunError::Tiling(
                "the recipe has no scaffold; expected [scaffold] and [tiling]".into(),
            ));
        }
        Ok(Self { inputs, threads })
    }

    /// The tiling, which `new` has checked to exist.
    fn tiling(&self) -> Result<&CellTiling, RunError> {
        let none = || RunError::Tiling("the recipe has no scaffold".into());
        self.inputs.tiling().ok_or_else(none)
    }

    /// Names of the cells.
    pub fn cells(&self) -> Vec<String> {
        let palette = self.inputs.tiling().map(|f| &f.palette);
        let names = palette.into_iter().flatten().map(|e| e.name.clone());
        names.collect()
    }

    /// The report's entry for the scaffold.
    pub fn scaffold(&self) -> Option<&ScaffoldReport> {
        self.inputs.tiling().map(|f| &f.loaded.report)
    }

    /// Warnings of the inputs.
    pub fn warnings(&self) -> Vec<Warning> {
        self.inputs.report().warnings
    }

    /// The field at points in the recipe's unit, in their order. Cells other than round beams are evaluated by their
    /// tables, or by their series if `exact`.
    ///
    /// # Errors
    /// Cells that do not fit the scaffold, or an invalid voxel size.
    pub fn evaluate(&self, points: &[[f64; 3]], exact: bool) -> Result<Vec<FieldSample>, RunError> {
        let tiling = self.tiling()?;
        let options = self
            .inputs
            .tiling_options(self.inputs.recipe.scale(), Offsets::default());
        let points: Vec<Vec3> = points.iter().map(|&p| p.into()).collect();
        self.threads.install(|| match tiling.content() {
            Content::Beams(beams) => {
                let shape = beams.shape(tiling, options, Offsets::default());
                probe_beams(tiling, beams, &*shape.field, options.half_width, &points)
            }
            Content::Sheets(sheets) => {
                // A tolerance of 0 only keeps the mid-surface from being interpolated between nodes.
                let sheet_options = SheetOptions {
                    tiling: options,
                    offsets: Offsets::default(),
                    node_tolerance: 0.0,
                    visits: None,
                };
                let (field, _) = if exact {
                    sheets.field(tiling, || tiling.exact(), sheet_options)?
                } else {
                    sheets.field(tiling, || tiling.tabulated(), sheet_options)?
                };
                probe_sheets(tiling, &*field, options.half_width, &points)
            }
            Content::Fitted if exact => {
                probe_cells::<Cell>(tiling, &tiling.exact()?, options, &points)
            }
            Content::Fitted => probe_cells::<Table>(tiling, &tiling.tabulated()?, options, &points),
        })
    }

    /// The continuity over all shared faces. With a path, also writes it as fields of a `.vtu` of the
    /// scaffold.
    ///
    /// # Errors
    /// A file that cannot be written, and cells that do not fit the scaffold.
    pub fn certificate(&self, vtu: Option<&Path>) -> Result<ContinuityReport, RunError> {
        let tiling = self.tiling()?;
        let found = self.threads.install(|| tiling.certificate())?;
        if let Some(path) = vtu {
            let scaffold = &tiling.loaded.scaffold;
            let quality: Vec<f64> = scaffold.elements().map(|e| e.quality()).collect();
            let cell_weights = tiling.cell_weights()?;
            let names = self.cells();
            // One field per cell: its weight at the centre of each element.
            let mut weights = vec![Vec::with_capacity(scaffold.len()); names.len()];
            for e in scaffold.elements() {
                let element_weights = cell_weights.list(e.index(), e.shape().centroid());
                for (all, w) in weights.iter_mut().zip(element_weights) {
                    all.push(w);
                }
            }
            let titles: Vec<String> = names.iter().map(|n| format!("weight_{n}")).collect();
            let mut fields: Vec<(&str, &[f64])> = vec![
                ("quality", &quality),
                ("value_jump", &found.jump_of_element),
                ("crease_degrees", &found.crease_of_element),
            ];
            for (title, own) in titles.iter().zip(&weights) {
                fields.push((title, own));
            }
            crate::io::write_vtu(path, scaffold, &fields)?;
        }
        Ok(tiling.continuity(&found))
    }
}

/// Round beams at points. phi is the signed distance to the uncut beams, `distance` that of the
/// solid, within the half width. World units.
fn probe_beams(
    tiling: &CellTiling,
    round: &RoundBeams,
    solid: &WorldField,
    half_width: f64,
    points: &[Vec3],
) -> Result<Vec<FieldSample>, RunError> {
    let scaffold = &tiling.loaded.scaffold;
    let weights = tiling.cell_weights()?;
    let count = tiling.palette.len();
    let sample_at = |&p: &Vec3| {
        let p = WorldPoint(p);
        let distance = solid.value(p).clamp(-half_width, half_width);
        let Some((e, xi)) = scaffold.locate(p) else {
            return FieldSample::outside(distance, count);
        };
        // Beams have no field of a cell; their own distance takes its place.
        let (phi, gradient) = round.beams().value_and_gradient(p);
        FieldSample {
            phi,
            gradient: gradient.into(),
            distance,
            element: scaffold.number(e as usize) as i64,
            reference: xi.0.into(),
            weights: weights.list(e as usize, xi),
        }
    };
    Ok(points.par_iter().map(sample_at).collect())
}

/// Sheets at points. phi is the signed distance before it is clamped to the half width of the band,
/// world units.
fn probe_sheets(
    tiling: &CellTiling,
    field: &WorldField,
    half_width: f64,
    points: &[Vec3],
) -> Result<Vec<FieldSample>, RunError> {
    let scaffold = &tiling.loaded.scaffold;
    let count = tiling.palette.len();
    // Only for the weights of the cells.
    let cells = tiling.tabulated()?;
    let sample_at = |&p: &Vec3| {
        let (phi, gradient) = field.value_and_gradient(WorldPoint(p));
        let distance = phi.clamp(-half_width, half_width);
        match scaffold.locate(WorldPoint(p)) {
            None => FieldSample::outside(distance, count),
            Some((e, xi)) => FieldSample {
                phi,
                gradient: gradient.into(),
                distance,
                element: scaffold.number(e as usize) as i64,
                reference: xi.0.into(),
                weights: cells.weights(e as usize, xi),
            },
        }
    };
    Ok(points.par_iter().map(sample_at).collect())
}

/// Fitted cells at points in the recipe's unit: phi is the value of the field, `distance` that of the solid within
/// the band, world units. The gradient is NaN where an element's map has no inverse.
fn probe_cells<C: CellField>(
    tiling: &CellTiling,
    cells: &ElementContent<'_, C>,
    options: TilingOptions,
    points: &[Vec3],
) -> Result<Vec<FieldSample>, RunError> {
    let scaffold = &tiling.loaded.scaffold;
    let failed = |e: TilingError| RunError::Tiling(e.to_string());
    let count = tiling.palette.len();
    let sample_at = |p: Vec3, distance: f64, cells: &ElementContent<'_, C>| match scaffold
        .locate(WorldPoint(p))
    {
        None => FieldSample::outside(distance, count),
        Some((e, xi)) => {
            let (phi, slope) = cells.value_and_gradient(e as usize, xi);
            // grad phi in the world = J^-T times that in the reference frame.
            let inverse = scaffold.element(e as usize).jacobian(xi).try_inverse();
            let gradient = inverse.map_or(Vec3::repeat(f64::NAN), |i| i.tr_mul(&slope));
            FieldSample {
                phi,
                gradient: gradient.into(),
                distance,
                element: scaffold.number(e as usize) as i64,
                reference: xi.0.into(),
                weights: cells.weights(e as usize, xi),
            }
        }
    };
    // Both branches do the same with contents of two types.
    Ok(match cells {
        ElementContent::Cell(cell) => {
            let tiled = TiledSolid::new(scaffold, *cell, options).map_err(failed)?;
            let sample = |&p: &Vec3| sample_at(p, tiled.value(WorldPoint(p)), cells);
            points.par_iter().map(sample).collect()
        }
        ElementContent::Blend(blend) => {
            let tiled = TiledSolid::new(scaffold, &**blend, options).map_err(failed)?;
            let sample = |&p: &Vec3| sample_at(p, tiled.value(WorldPoint(p)), cells);
            points.par_iter().map(sample).collect()
        }
    })
}
