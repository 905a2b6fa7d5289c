//! `druse grade`: a new thickness or volume fraction of each element from results of a deck of the scaffold.
//!
//! A measure of each element is compared with one target. With stresses it is the von Mises stress of the mean
//! stress in the solid: the effective stress over the volume fraction f, since the void carries none. With energies
//! it is the strain energy per volume of solid. An element above the target gets more solid: f grows with the
//! power `exponent` of their ratio, within a factor `step`, and within bounds. The target is the limit (fully
//! stressed), or the value at which the part has the required mass (optimality criteria, Bendsoe and Sigmund 2003;
//! for stiffness the exponent is 1/2). A filter takes means of the measure within a radius, against checkerboards.

use super::base::error::RunError;
use super::content::inputs::Inputs;
use super::content::tiling::GradedQuantity;
use super::effective::{EffectiveElements, Law, LawSettings};
use super::inputs::run_options::RunOptions;
use super::outputs::macro_deck::solid_material;
use crate::frame::{LengthUnit, Vec3};
use crate::io::write_vtu_fields;
use crate::pipeline::content::tiling::Content;
use crate::progress::{Progress, Threads};
use crate::recipe::Recipe;
use crate::vdb::Session;
use serde::Serialize;
use std::path::{Path, PathBuf};
use update::{Grading, Update};

mod results;
mod update;

/// Voxels along the period for volume fractions.
const RESOLUTION: usize = 32;
/// Tabulated volume fractions of a cell.
const TABLE_POINTS: usize = 33;
/// Factor by which tables go below and above the present thickness: the volume fraction of struts grows with its
/// square, by 36.
const THICKNESS_RANGE: f64 = 6.0;
/// Greatest tabulated thickness over the size of an element, unless a present one is greater: near 1 the void closes.
const MAX_THICKNESS: f64 = 0.9;
/// Bounds of the volume fraction, unless others are given.
const FRACTION_BOUNDS: [f64; 2] = [0.05, 0.8];

/// What elements are compared by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum GradeRule {
    /// Von Mises stress of the mean stress in the solid.
    Stress,
    /// Strain energy per volume of solid.
    Energy,
}

/// How a part is graded.
#[derive(Clone, Debug)]
pub struct GradeOptions {
    /// Results: .frd of `CalculiX`, .vtu or .vtk.
    pub results: PathBuf,
    /// The field: a stress (six or nine numbers) or an energy density (one number).
    pub field: String,
    /// What elements are compared by; by the field's number of components when left out.
    pub rule: Option<GradeRule>,
    /// The measure (stress or energy) of a fully stressed element, in the deck's units: the target without `mass`.
    pub limit: Option<f64>,
    /// The mass of the new part over that of the present one; 1 when both this and the limit are left out.
    pub mass: Option<f64>,
    /// Least and greatest thickness (in the recipe's unit) or volume fraction.
    pub bounds: Option<[f64; 2]>,
    /// Radius of the filter, in the recipe's unit; one and a half elements when left out.
    pub filter: Option<f64>,
    /// Greatest factor by which an element's volume fraction changes.
    pub step: f64,
    /// Power of the ratio of measure and target; 1 for stress, 1/2 for energy when left out.
    pub exponent: Option<f64>,
    /// Unit of the results' lengths; that of the recipe's deck when left out.
    pub unit: Option<LengthUnit>,
}

/// The grading of a part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GradeReport {
    /// The graded quantity, "thickness" or "`volume_fraction`": the name of the field.
    pub quantity: &'static str,
    /// What elements are compared by.
    pub rule: GradeRule,
    /// Number of elements.
    pub elements: usize,
    /// Greatest measure, before the filter.
    pub greatest: f64,
    /// Mean of the measure over the solid.
    pub mean: f64,
    /// The target that elements are compared with.
    pub target: f64,
    /// Elements above the limit; `None` without one.
    pub above_limit: Option<usize>,
    /// Volume of the solid of the present part, in cubes of the recipe's unit.
    pub solid_volume: f64,
    /// Volume of the solid of the new part.
    pub new_solid_volume: f64,
    /// Least and greatest present value of the quantity.
    pub range: [f64; 2],
    /// Least and greatest new value.
    pub new_range: [f64; 2],
    /// Elements at a bound.
    pub at_bounds: usize,
    /// Bytes of the written `.vtu`.
    pub bytes: u64,
}

/// Grades a recipe's part by results and writes the new quantity at the scaffold's nodes as a `.vtu`.
///
/// # Errors
/// [`RunError`]: an input, results of another mesh or without the field, a part without a graded quantity, a mass
/// that the bounds exclude, or a file that cannot be written.
pub fn grade(
    recipe: &Recipe,
    run: &RunOptions,
    options: &GradeOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<GradeReport, RunError> {
    let threads = Threads::new(run.threads).map_err(|e| RunError::Threads(e.to_string()))?;
    let inputs = Inputs::load(recipe, &threads, run, progress)?;
    let session = Session::new(&threads, progress);
    threads.install(|| graded(&inputs, options, output, session))
}

/// Makes the new grading from the results of the recipe's deck, writes it with measure and fractions, and reports it.
fn graded(
    inputs: &Inputs,
    options: &GradeOptions,
    output: &Path,
    session: Session,
) -> Result<GradeReport, RunError> {
    let elements = EffectiveElements::of(inputs)?;
    let deck = inputs
        .recipe
        .sections()
        .output
        .iter()
        .find(|o| o.is_macro_deck());
    let unit = inputs.recipe.unit();
    let unit_of_results = options
        .unit
        .or(deck.map(|o| o.unit_or_default(unit)))
        .unwrap_or(unit);
    let scaffold = &elements.tiling.loaded.scaffold;
    let read = results::read(options, scaffold, unit.to(unit_of_results))?;
    let quantity = quantity(&elements)?;
    // A thickness needs the law of its cell to become a fraction; a fraction is its own parameter.
    let is_thickness = quantity == GradedQuantity::Thickness;
    let present = elements.parameters.clone();
    // The fraction of each element before: by the law of its cell, as graded, or that of the cell.
    let (laws, fraction) = if is_thickness {
        let laws = laws(inputs, &elements, session)?;
        let pairs = elements.cell_of.iter().zip(&present);
        let fraction = pairs.map(|(&c, &p)| laws[c].fraction(p)).collect();
        (laws, fraction)
    } else if elements.cells.iter().all(|c| c.quantity.is_some()) {
        (Vec::new(), present.clone())
    } else {
        // Cells at their own level have one volume fraction each.
        (Vec::new(), own_fractions(inputs, &elements, session)?)
    };
    // Results are those of the homogenised element; the solid in it carries 1 / fraction of them.
    let measure: Vec<f64> = read
        .values
        .iter()
        .zip(&fraction)
        .map(|(v, f)| v / f)
        .collect();
    let grading = Grading {
        scaffold,
        elements: &elements,
        laws: &laws,
        is_thickness,
        fraction: &fraction,
        measure: &measure,
    };
    let bounds = match options.bounds {
        Some(bounds) => bounds,
        None => grading.default_bounds(FRACTION_BOUNDS),
    };
    let update = Update {
        rule: read.rule,
        limit: options.limit,
        mass: options.mass,
        bounds,
        filter: options.filter,
        step: options.step,
        exponent: options.exponent,
    };
    let new = grading.update(&update)?;
    let name = if grading.is_thickness {
        "thickness"
    } else {
        "volume_fraction"
    };
    let measure_name = match read.rule {
        GradeRule::Stress => "stress_in_solid",
        GradeRule::Energy => "energy_in_solid",
    };
    let bytes = write_vtu_fields(
        output,
        scaffold,
        &[(name, &new.nodes)],
        &[
            (measure_name, &measure),
            ("fraction_before", &fraction),
            ("fraction_after", &new.fraction),
        ],
    )?;
    let solid = |f: &[f64]| -> f64 { f.iter().zip(&elements.volumes).map(|(f, v)| f * v).sum() };
    let whole = solid(&fraction);
    // The mean over the solid: sum m f v / sum f v.
    let weighted = measure.iter().zip(&fraction).zip(&elements.volumes);
    let mean = weighted.map(|((m, f), v)| m * f * v).sum::<f64>() / whole;
    let range = |all: &[f64]| {
        all.iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |r, &v| {
                [r[0].min(v), r[1].max(v)]
            })
    };
    Ok(GradeReport {
        quantity: name,
        rule: read.rule,
        elements: measure.len(),
        greatest: range(&measure)[1],
        mean,
        target: new.target,
        above_limit: options
            .limit
            .map(|l| measure.iter().filter(|m| **m > l).count()),
        solid_volume: whole,
        new_solid_volume: solid(&new.fraction),
        range: range(&grading.values(&present, &fraction)),
        new_range: range(&new.values),
        at_bounds: new.at_bounds,
        bytes,
    })
}

/// The quantity that a grading changes: the recipe's thickness, else the volume fraction. Refuses a level, and beams
/// without a thickness.
fn quantity(elements: &EffectiveElements) -> Result<GradedQuantity, RunError> {
    let own = elements.cells.first().and_then(|c| c.quantity);
    match own {
        Some(GradedQuantity::Level) => Err(RunError::Tiling(
            "found tiling.level; expected thickness or volume_fraction, which a grading changes".into(),
        )),
        own if matches!(elements.tiling.content(), Content::Beams(_)) && own != Some(GradedQuantity::Thickness) => Err(RunError::Tiling(
            "found round beams without a thickness in units of length; expected [tiling] thickness, which a \
             grading changes"
                .into(),
        )),
        Some(quantity) => Ok(quantity),
        None => Ok(GradedQuantity::VolumeFraction),
    }
}

/// Volume fractions of all cells over a wide range of thickness (in element sizes): a new thickness may lie far
/// from the present ones.
fn laws(
    inputs: &Inputs,
    elements: &EffectiveElements,
    session: Session,
) -> Result<Vec<Law>, RunError> {
    let settings = settings()?;
    let law = |c: usize| {
        let cell = elements.cells[c];
        let [low, high] = elements.range(c);
        // A present thickness above the limit stays in the table.
        let most = MAX_THICKNESS.max(high);
        let low = low / THICKNESS_RANGE;
        let high = (high * THICKNESS_RANGE).min(most);
        let step = (high - low) / (TABLE_POINTS - 1) as f64;
        let table: Vec<f64> = (0..TABLE_POINTS).map(|n| low + step * n as f64).collect();
        Law::new(inputs.recipe, cell, &table, settings, session)
    };
    (0..elements.cells.len()).map(law).collect()
}

/// Settings of laws that give volume fractions alone, for which the material does not matter.
fn settings() -> Result<LawSettings, RunError> {
    Ok(LawSettings {
        solid: solid_material(None)?,
        resolution: RESOLUTION,
        stiffness: false,
    })
}

/// Volume fractions of elements whose cells have a level of their own.
fn own_fractions(
    inputs: &Inputs,
    elements: &EffectiveElements,
    session: Session,
) -> Result<Vec<f64>, RunError> {
    let laws = elements.laws(inputs, settings()?, session)?;
    let pairs = elements.cell_of.iter().zip(&elements.parameters);
    Ok(pairs.map(|(&c, &p)| laws[c].fraction(p)).collect())
}

/// The centre of each element, recipe units.
fn centres(elements: &EffectiveElements) -> Vec<Vec3> {
    let scaffold = &elements.tiling.loaded.scaffold;
    scaffold
        .elements()
        .map(|e| e.map(e.shape().centroid()).0)
        .collect()
}
