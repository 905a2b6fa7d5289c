//! Periods of cells for homogenization: from a section, a finished cell or a cell of a recipe. A period is the
//! repeating box of a structure: a cell's own for a hex or quad, several cells in a packing (an arrangement of tets
//! that fills a cube) for a tet. `properties` computes with them.

use super::base::error::{CellFault, RunError};
use super::base::warning::Warning;
use super::inputs::cells::{make, recipe_element};
use super::inputs::input_files::InputFiles;
use super::inputs::run_options::RunOptions;
use super::inputs::source::skeleton_by;
use crate::cell::Cell;
use crate::frame::Element;
use crate::homogenize::{HomogenizeError, Packing, Period};
use crate::recipe::{CellPlace, CellSection, Length, Positive, Recipe, Section, Solid};
use crate::vdb::Session;
use std::path::{Path, PathBuf};

mod properties;

pub use properties::{
    CellProperties, PropertyOptions, cell_properties, period_warnings, resolution_fault,
};
pub(crate) use properties::{sampled, shares_of};

/// A period and the volume fraction that its section requests.
pub struct CellPeriod {
    /// The cell's name.
    pub name: String,
    /// The repeating part of the structure.
    pub period: Period,
    /// Target volume fraction of round beams; `None` without one, and for a fitted cell, which has its level.
    pub volume_fraction: Option<f64>,
    /// Warnings of the cell.
    pub warnings: Vec<Warning>,
}

/// An error of a cell's period as an error of the cell.
pub fn period_fault(key: &str, error: HomogenizeError) -> RunError {
    match error {
        HomogenizeError::Cancelled(c) => RunError::Cancelled(c),
        error => RunError::Cell {
            key: key.to_owned(),
            fault: CellFault::Rule(error.to_string()),
        },
    }
}

/// The period of a cell that has been made.
///
/// # Errors
/// [`RunError::Cell`] for an element without a period, or a cell of a tet that depends on the numbering.
pub fn cell_period(
    cell: Cell,
    packing: Packing,
    warnings: Vec<Warning>,
) -> Result<CellPeriod, RunError> {
    let name = cell.name().to_owned();
    Ok(CellPeriod {
        period: Period::of_cell(cell, packing).map_err(|e| period_fault(&name, e))?,
        name,
        volume_fraction: None,
        warnings,
    })
}

/// The struts or plates of a section as round beams; `None` where it describes something else, or a form that only a
/// fitted cell has. Paths are used as they are; diameters are in reference lengths.
///
/// # Errors
/// [`RunError`]: an error of the graph; a thickness in units of length.
pub fn beam_period(
    name: &str,
    section: &CellSection,
    element: Element,
    packing: Packing,
) -> Result<Option<CellPeriod>, RunError> {
    round(name, section, element, packing, &Path::to_path_buf)
}

/// As [`beam_period`]; `resolve` completes paths of graphs.
fn round(
    name: &str,
    section: &CellSection,
    element: Element,
    packing: Packing,
    resolve: &dyn Fn(&Path) -> PathBuf,
) -> Result<Option<CellPeriod>, RunError> {
    // Inversion, another placement or a level belong to fitted cells.
    let is_round = (section.graph.is_some() || section.plates.is_some())
        && section.section != Some(Section::Fitted)
        && matches!(element, Element::Hex | Element::Tet)
        && section.invert != Some(true)
        && section.solid.is_none_or(|s| s == Solid::Below)
        && section
            .place
            .as_ref()
            .is_none_or(|p| *p == CellPlace::Reference)
        && section.level.is_none();
    if !is_round {
        return Ok(None);
    }
    let fault = |message: String| RunError::Cell {
        key: name.to_owned(),
        fault: CellFault::Rule(message),
    };
    let mut section = section.clone();
    if let Some(thickness) = section.thickness {
        let Length::Bare(diameter) = thickness.0 else {
            return Err(fault(format!(
                "thickness = \"{}\" is a length in space, and a period has reference lengths only; expected a number of \
                 reference lengths, or volume_fraction",
                thickness.0
            )));
        };
        // A size is positive, so that neither conversion fails.
        section.radius = Positive::try_from(diameter / 2.0).ok();
        section.plate_thickness = Positive::try_from(diameter).ok();
    }
    let skeleton = skeleton_by(&section, element, resolve).map_err(|e| e.of(name))?;
    let period =
        Period::of_skeleton(element, &skeleton, packing).map_err(|e| period_fault(name, e))?;
    Ok(Some(CellPeriod {
        name: name.to_owned(),
        period,
        volume_fraction: section.volume_fraction.map(|f| f.0),
        warnings: Vec::new(),
    }))
}

/// The period of a cell of a recipe, changed by `flags`: element, level rule, radius, plate thickness, section.
///
/// # Errors
/// [`RunError`]: no cell of that name, no element, or an error of the cell or its period.
pub fn recipe_period(
    recipe: &Recipe,
    name: &str,
    flags: &CellSection,
    packing: Packing,
    session: Session,
) -> Result<CellPeriod, RunError> {
    let key = format!("cell.{name}");
    let fault = |message: String| RunError::Cell {
        key: key.clone(),
        fault: CellFault::Rule(message),
    };
    let sections = recipe.sections();
    let Some(section) = sections.cell.get(name) else {
        let known: Vec<&str> = sections.cell.keys().map(String::as_str).collect();
        return Err(fault(format!(
            "found no such cell in the recipe; expected one of {}",
            known.join(", ")
        )));
    };
    let mut section = section.clone();
    // A level rule of the command line replaces that of the recipe: a cell has one rule at most.
    if !flags.levels().is_empty() {
        section.level = flags.level;
        section.volume_fraction = flags.volume_fraction;
        section.thickness = flags.thickness;
    }
    section.element = flags.element.or(section.element);
    section.radius = flags.radius.or(section.radius);
    section.plate_thickness = flags.plate_thickness.or(section.plate_thickness);
    section.section = flags.section.or(section.section);
    // A tiled cell takes the elements of the scaffold, which can be of several kinds.
    let has_element = section.own_element().is_some()
        || section.file.is_some()
        || section.surface.is_some()
        || section.hybrid().is_some();
    if sections.scaffold.is_some() && !has_element {
        return Err(fault(
            "the cell takes the scaffold's element; expected one by name, as in --element tet"
                .to_owned(),
        ));
    }
    let element = recipe_element(recipe, &section)?;
    // Struts and plates are taken as exact round beams where the section allows it.
    if let Some(found) = round(name, &section, element, packing, &|path| {
        recipe.resolve(path)
    })? {
        return Ok(found);
    }
    let options = RunOptions::default();
    let mut files = InputFiles::new(recipe, &options);
    let cell = make(&mut files, &key, &section, element, session)?;
    cell_period(cell, packing, files.warnings)
}
