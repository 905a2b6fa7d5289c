//! Cells of a recipe: from their source to a level and a side that is solid.
//!
//! A cell is made of its source, or of other cells of the recipe; then a level, a volume fraction or a thickness sets
//! its level. A cell with a target comes from a search, which sets its level too. A cell that is made of others is made
//! after them; the recipe's check has refused circles.

use super::input_files::InputFiles;
use super::source::{SourceFault, SourceReader, SourceRecord, scaffold_hint};
use super::standalone::StandAlone;
use crate::cell::{Cell, Solid, Surface};
use crate::frame::{Element, Vec3};
use crate::io::ReadError;
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::{CellFault, RunError};
use crate::pipeline::base::warning::Warning;
use crate::recipe;
use crate::recipe::{CellSection, Recipe};
use crate::tiling::TilingOptions;
use crate::vdb::Session;
use std::path::{Path, PathBuf};

/// Makes the cell that a section describes, for one element shape, with its level. `key` names it in errors and in
/// the report, as in `cell.strut`. Files and warnings are recorded in `files`.
pub(crate) fn make(
    files: &mut InputFiles,
    key: &str,
    section: &CellSection,
    element: Element,
    session: Session,
) -> Result<Cell, RunError> {
    let fail = |fault: CellFault| RunError::Cell {
        key: key.to_owned(),
        fault,
    };
    if let Some(own) = section.own_element().filter(|e| *e != element) {
        return Err(fail(CellFault::Rule(format!(
            "the cell is made for a {}; the scaffold has {} elements{}",
            own.name(),
            element.name(),
            scaffold_hint(own)
        ))));
    }
    // The name is the last word of the key.
    let name = key.rsplit('.').next().unwrap_or(key);
    let recipe = files.recipe;
    if let Some(hybrid) = section.hybrid() {
        // The recipe's check guarantees that every part exists and that no part contains itself.
        let mut parts = Vec::new();
        for part in hybrid.parts() {
            let part_section = &recipe.sections().cell[part];
            parts.push(make(
                files,
                &format!("cell.{part}"),
                part_section,
                element,
                session,
            )?);
        }
        let options = super::fit_options::fit_options(section);
        let cell = hybrid
            .make(name, &parts, &options, session.progress)
            .map_err(|e| SourceFault::from(e).of(key))?;
        return with_level(cell, section).map_err(fail);
    }
    if section.target.is_some() {
        // Its level is found with its coefficients.
        let mut matched = Vec::new();
        for other in section.matched.iter().flatten() {
            let other_section = &recipe.sections().cell[other];
            matched.push(make(
                files,
                &format!("cell.{other}"),
                other_section,
                element,
                session,
            )?);
        }
        let resolve = |path: &Path| recipe.resolve(path);
        return super::targets::make(name, section, element, matched, &resolve, session)
            .map_err(|e| e.of(key));
    }
    let reader = SourceReader {
        recipe: Some(recipe),
        session,
    };
    let mut record = SourceRecord::default();
    let cell = match files.cache {
        Some(cache) => cache
            .cells
            .cell(&reader, name, section, element, &mut record),
        None => reader.cell(name, section, element, &mut record),
    };
    let cell = cell.map_err(|e| e.of(key))?;
    let mut source_key = key.to_owned();
    if let Some((word, path, bounds)) = record.file {
        source_key = format!("{key}.{word}");
        files.record(&source_key, &path, bounds)?;
    }
    if let Some((crystal, bounds)) = record.crystal {
        files.record_crystal(&format!("{key}.crystal"), &crystal, bounds)?;
    }
    for Warning { code, message } in record.warnings {
        files.warn(code, format!("{source_key}: {message}"))?;
    }
    let levelled = match files.cache {
        Some(cache) => cache.cells.with_level(&reader, name, section, cell),
        None => with_level(cell, section),
    };
    levelled.map_err(fail)
}

/// The element of a cell without a scaffold: the one that its section names or its file holds, the named
/// surface's own, or the hex.
///
/// # Errors
/// [`ReadError`] of a `.cell` file.
pub fn own_element(
    section: &CellSection,
    resolve: &dyn Fn(&Path) -> PathBuf,
) -> Result<Element, ReadError> {
    if let Some(element) = section.own_element() {
        return Ok(element);
    }
    if let Some(file) = &section.file {
        return Ok(crate::io::read_cell(resolve(&file.path))?.element());
    }
    let surface = section.surface.as_deref().and_then(Surface::from_name);
    Ok(surface.map_or(Element::Hex, Surface::element))
}

/// The element of a cell of a recipe; a hybrid takes that of its first part.
pub(crate) fn recipe_element(recipe: &Recipe, section: &CellSection) -> Result<Element, ReadError> {
    let hybrid = section.hybrid().filter(|_| section.own_element().is_none());
    let first = hybrid.as_ref().and_then(|h| h.parts().next());
    match first.and_then(|part| recipe.sections().cell.get(part)) {
        Some(part) => recipe_element(recipe, part),
        None => own_element(section, &|path| recipe.resolve(path)),
    }
}

/// Makes the cell of a section outside a recipe, with its level. Paths are relative to the working
/// directory. Returns the warnings too.
///
/// # Errors
/// [`RunError`]: no source, or more than one; a fault of the source, the fit or the level.
pub fn make_cell(
    name: &str,
    section: &CellSection,
    element: Element,
    session: Session,
) -> Result<(Cell, Vec<Warning>), RunError> {
    let reader = SourceReader {
        recipe: None,
        session,
    };
    let mut record = SourceRecord::default();
    let cell = reader.cell(name, section, element, &mut record);
    let cell = cell.map_err(|e| e.of(name))?;
    let cell = with_level(cell, section).map_err(|fault| RunError::Cell {
        key: name.to_owned(),
        fault,
    })?;
    Ok((cell, record.warnings))
}

/// The source that a section describes, for an element; paths are relative to the working directory.
///
/// # Errors
/// As [`make_cell`].
pub fn read_source(
    section: &CellSection,
    element: Element,
    session: Session,
) -> Result<crate::cell::Source, RunError> {
    let reader = SourceReader {
        recipe: None,
        session,
    };
    let source = reader.source(section, element, &mut SourceRecord::default());
    source.map_err(|e| e.of("source"))
}

/// The cell with another solid side, at a provisional level; any level serves, since the caller sets the final
/// one.
fn with_side(cell: Cell, side: Solid) -> Result<Cell, CellFault> {
    Ok(if side == Solid::Sheet {
        cell.sheet(1.0)?
    } else {
        cell.with_solid(side, 0.0)?
    })
}

/// Sets level and solid side of a cell as a section requests; keys that the section leaves out change
/// nothing.
///
/// # Errors
/// A level without a surface, a volume fraction or thickness that no level gives, a thickness in units of length.
pub fn with_level(cell: Cell, section: &CellSection) -> Result<Cell, CellFault> {
    let side = section.solid.map(|s| match s {
        recipe::Solid::Below => Solid::Below,
        recipe::Solid::Above => Solid::Above,
        recipe::Solid::Sheet => Solid::Sheet,
    });
    // The request describes the final solid, so inversion comes first.
    let invert = section.invert == Some(true);
    let invert_if_requested = |cell: Cell| if invert { cell.inverted() } else { cell };
    if let Some(thickness) = section.thickness {
        let side = side.unwrap_or(cell.solid());
        let cell = invert_if_requested(with_side(cell, side)?);
        let recipe::Length::Bare(thickness) = thickness.0 else {
            return Err(CellFault::Rule(format!(
                "thickness = \"{}\" is a length in space, and a fitted cell has reference lengths only; expected a \
                 number of reference lengths, [tiling] thickness, or a graph with section = \"round\"",
                thickness.0
            )));
        };
        let level = cell.level_for_thickness(thickness)?;
        let side = cell.solid();
        return Ok(cell.with_solid(side, level)?);
    }
    if let Some(fraction) = section.volume_fraction {
        let side = side.unwrap_or(cell.solid());
        let cell = invert_if_requested(with_side(cell, side)?);
        let level = cell.level_for_volume_fraction(fraction.0)?;
        let side = cell.solid();
        return Ok(cell.with_solid(side, level)?);
    }
    let mut cell = cell;
    if section.level.is_some() || side.is_some() {
        let level = section.level.map_or(cell.level(), |l| l.0);
        let side = side.unwrap_or(cell.solid());
        cell = cell.with_solid(side, level)?;
    }
    Ok(invert_if_requested(cell))
}

/// The report's entry for a cell.
pub(crate) fn facts(cell: &Cell) -> serde_json::Value {
    let mut facts = serde_json::json!({
        "element": cell.element().name(),
        "solid": cell.solid().name(),
        "level": cell.level(),
        "gamma": cell.gamma(),
        "volume_fraction": cell.volume_fraction(),
        "group": cell.group(),
        "coefficients": cell.expression().coefficients(),
    });
    if let Some(report) = cell.report() {
        facts["fit"] = serde_json::to_value(report).unwrap_or_default();
    }
    facts
}

/// The report's entry for the cells of one name: the facts of the first; in a mixed scaffold also those
/// of each element shape under `elements`.
pub(crate) fn facts_by_element(cells: &[Cell]) -> serde_json::Value {
    let mut all = facts(&cells[0]);
    if cells.len() > 1 {
        all["elements"] = cells
            .iter()
            .map(|cell| (cell.element().name().to_owned(), facts(cell)))
            .collect();
    }
    all
}

/// One element of a cell as a level set, for a picture. `voxel_size` is in reference lengths, `half_width` in
/// voxels.
///
/// # Errors
/// A cell without a surface; an error of the band or of OpenVDB.
pub fn one_element(
    cell: &Cell,
    voxel_size: f64,
    half_width: f64,
    session: crate::vdb::Session,
) -> Result<crate::vdb::LevelSet, RunError> {
    let alone = StandAlone::new(cell, Vec3::zeros(), 1.0)?;
    let options = TilingOptions {
        voxel_size,
        half_width: half_width * voxel_size,
        distance: crate::tiling::Distance::Fast,
        boundary: crate::tiling::Boundary::Cut,
    };
    let scale = recipe::Scale {
        unit: crate::frame::LengthUnit::default(),
        voxel_size,
    };
    let context = StageContext::of_solid(session, scale, half_width);
    let shape = alone.shape(options, "the element".into())?;
    Ok(context.sample(&shape, "band")?.0)
}
