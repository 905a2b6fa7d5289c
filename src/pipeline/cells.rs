//! Cells of a recipe: from their source to a level and a side that is solid.

use super::error::RunError;
use super::input_files::Inputs;
use super::level_set_ops::Bench;
use super::report::Warning;
use super::source::{CellFault, Found, Reader, SourceFault, alone};
use super::standalone::StandAlone;
use crate::cell::{Cell, Solid, Surface};
use crate::frame::{Element, Vec3};
use crate::io::ReadError;
use crate::recipe::{self, CellSection, Recipe};
use crate::tiling::TilingOptions;
use crate::vdb::Session;
use std::path::{Path, PathBuf};

/// Makes the cell that a section describes, for an element.
pub(super) fn make(
    inputs: &mut Inputs,
    key: &str,
    section: &CellSection,
    element: Element,
    session: Session,
) -> Result<Cell, RunError> {
    let fail = |fault: CellFault| RunError::Cell {
        key: key.to_owned(),
        fault,
    };
    if let Some(asked) = section.own_element().filter(|e| *e != element) {
        return Err(fail(CellFault::Rule(format!(
            "the cell is made for a {}, the scaffold has {} elements{}",
            asked.name(),
            element.name(),
            alone(asked)
        ))));
    }
    let name = key.rsplit('.').next().unwrap_or(key);
    let recipe = inputs.recipe;
    if let Some(hybrid) = section.hybrid() {
        // The recipe's check has made sure that every part exists and none contains itself.
        let mut parts = Vec::new();
        for part in hybrid.parts() {
            let own = &recipe.sections().cell[part];
            parts.push(make(
                inputs,
                &format!("cell.{part}"),
                own,
                element,
                session,
            )?);
        }
        let options = super::fit_options(section);
        let cell = hybrid
            .make(name, &parts, &options, session.progress)
            .map_err(|e| SourceFault::from(e).of(key))?;
        return levelled(cell, section).map_err(fail);
    }
    let reader = Reader {
        recipe: Some(recipe),
        session,
    };
    let mut found = Found::default();
    let cell = reader.cell(name, section, element, &mut found);
    let cell = cell.map_err(|e| e.of(key))?;
    let mut own = key.to_owned();
    if let Some((word, path, bounds)) = found.file {
        own = format!("{key}.{word}");
        inputs.record(&own, &path, bounds)?;
    }
    if let Some((crystal, bounds)) = found.crystal {
        inputs.record_crystal(&format!("{key}.crystal"), &crystal, bounds)?;
    }
    for Warning { code, message } in found.warnings {
        inputs.warn(code, format!("{own}: {message}"))?;
    }
    levelled(cell, section).map_err(fail)
}

/// The element of a cell that no scaffold asks for: the one that its section names or its file has, a
/// surface's own, else the hex.
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

/// The same of a cell of a recipe; of a hybrid its first part's.
pub(super) fn recipe_element(recipe: &Recipe, section: &CellSection) -> Result<Element, ReadError> {
    let hybrid = section.hybrid().filter(|_| section.own_element().is_none());
    let first = hybrid.as_ref().and_then(|h| h.parts().next());
    match first.and_then(|part| recipe.sections().cell.get(part)) {
        Some(part) => recipe_element(recipe, part),
        None => own_element(section, &|path| recipe.resolve(path)),
    }
}

/// Makes the cell that a section (of a command line, say) describes, its level found; paths are relative
/// to the working directory. Gives what was odd, too.
///
/// # Errors
/// [`RunError`]: no source, or more than one; what the source, the fit or the level refuse.
pub fn make_cell(
    name: &str,
    section: &CellSection,
    element: Element,
    session: Session,
) -> Result<(Cell, Vec<Warning>), RunError> {
    let reader = Reader {
        recipe: None,
        session,
    };
    let mut found = Found::default();
    let cell = reader.cell(name, section, element, &mut found);
    let cell = cell.map_err(|e| e.of(name))?;
    let cell = levelled(cell, section).map_err(|fault| RunError::Cell {
        key: name.to_owned(),
        fault,
    })?;
    Ok((cell, found.warnings))
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
    let reader = Reader {
        recipe: None,
        session,
    };
    let source = reader.source(section, element, &mut Found::default());
    source.map_err(|e| e.of("source"))
}

/// The cell with another side solid, at a level that is still to be found.
fn sided(cell: Cell, side: Solid) -> Result<Cell, CellFault> {
    Ok(if side == Solid::Sheet {
        cell.sheet(1.0)?
    } else {
        cell.with_solid(side, 0.0)?
    })
}

/// Level and solid side of a cell as a section says; what it leaves out stays as it is.
///
/// # Errors
/// When no level gives the volume fraction or thickness asked for.
pub fn levelled(cell: Cell, section: &CellSection) -> Result<Cell, CellFault> {
    let side = section.solid.map(|s| match s {
        recipe::Solid::Below => Solid::Below,
        recipe::Solid::Above => Solid::Above,
        recipe::Solid::Sheet => Solid::Sheet,
    });
    // What is asked of the solid is asked of it as it ends: after the exchange with the void.
    let invert = section.invert == Some(true);
    let ended = |cell: Cell| if invert { cell.inverted() } else { cell };
    if let Some(thickness) = section.thickness {
        let side = side.unwrap_or(cell.solid());
        let cell = ended(sided(cell, side)?);
        let recipe::Length::Bare(thickness) = thickness.0 else {
            return Err(CellFault::Rule(format!(
                "thickness = \"{}\" is a length in space, which a fitted cell does not have; expected a \
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
        let cell = ended(sided(cell, side)?);
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
    Ok(ended(cell))
}

/// What a report says of a cell.
pub(super) fn facts(cell: &Cell) -> serde_json::Value {
    let mut facts = serde_json::json!({
        "element": cell.element().name(),
        "solid": cell.solid().name(),
        "level": cell.level(),
        "gamma": cell.gamma(),
        "volume_fraction": cell.volume_fraction(),
        "group": cell.group(),
        "coefficients": cell.form().coefficients(),
    });
    if let Some(report) = cell.report() {
        facts["fit"] = serde_json::to_value(report).unwrap_or_default();
    }
    facts
}

/// What a report says of a name's cells, one for each shape of element: the first's facts and, in a mixed
/// scaffold, those of each shape under `elements`.
pub(super) fn facts_by_element(cells: &[Cell]) -> serde_json::Value {
    let mut all = facts(&cells[0]);
    if cells.len() > 1 {
        all["elements"] = cells
            .iter()
            .map(|cell| (cell.element().name().to_owned(), facts(cell)))
            .collect();
    }
    all
}

/// One element of a cell as a level set with voxels of edge `voxel_size` in reference lengths: what a
/// picture of it shows.
///
/// # Errors
/// A cell without a surface; what the band and OpenVDB refuse.
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
    let bench = Bench {
        threads: session.threads,
        progress: session.progress,
        scale: recipe::Scale {
            unit: crate::frame::LengthUnit::default(),
            voxel_size,
        },
        half_width,
        region: None,
    };
    let shape = alone.shape(options, "the element".into())?;
    Ok(bench.sample(&shape, "band")?.0)
}
