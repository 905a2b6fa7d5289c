//! Cells of a recipe: from a mesh, a named surface or a file to a level and a side that is solid.

use super::error::RunError;
use super::inputs::Inputs;
use super::operate::Bench;
use super::report::Warning;
use super::shape::Shape;
use crate::cell::{
    Caps, Cell, CellError, FitError, FitOptions, Placement, Solid, Surface, Table, fit_mesh,
};
use crate::frame::{Aabb, Element, Vec3};
use crate::progress::Progress;
use crate::recipe::{self, CellPlace, CellSection};
use crate::scaffold::{Connectivity, Kind, Scaffold};
use crate::tiling::{TiledSolid, TilingOptions};
use std::path::Path;

/// Why a cell of a recipe cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum CellFault {
    /// A level, a surface, a lattice.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The fit to a mesh.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// What the recipe asks for cannot be.
    #[error("{0}")]
    Rule(String),
}

/// Makes the cell that a section describes, for an element.
pub(super) fn make(
    inputs: &mut Inputs,
    key: &str,
    section: &CellSection,
    element: Element,
    progress: &dyn Progress,
) -> Result<Cell, RunError> {
    let fail = |fault: CellFault| RunError::Cell {
        key: key.to_owned(),
        fault,
    };
    if let Some(asked) = section.element.map(Element::from).filter(|e| *e != element) {
        return Err(fail(CellFault::Rule(format!(
            "the cell is made for a {}, the scaffold has {} elements",
            asked.name(),
            element.name()
        ))));
    }
    let name = key.rsplit('.').next().unwrap_or(key);
    let cell = if let Some(file) = &section.mesh {
        let mesh_key = format!("{key}.mesh");
        let path = inputs.recipe.resolve(&file.path);
        let mesh = inputs.read_cell_mesh(&mesh_key, file)?;
        let cell = fit(name, section, element, &mesh, progress).map_err(|e| fit_fault(e, key))?;
        note(inputs, &mesh_key, &path, &cell)?;
        cell
    } else if let Some(file) = &section.file {
        let path = inputs.recipe.resolve(&file.path);
        let cell = crate::io::read_cell(&path)?;
        if cell.element() != element {
            return Err(fail(CellFault::Rule(format!(
                "{} is a cell for a {}, the scaffold has {} elements",
                path.display(),
                cell.element().name(),
                element.name()
            ))));
        }
        inputs.record(&format!("{key}.file"), &path, element_box(element))?;
        cell.named(name)
    } else {
        let wanted = section.surface.as_deref().unwrap_or_default();
        named_surface(wanted, element).map_err(fail)?.named(name)
    };
    levelled(cell, section).map_err(fail)
}

/// A surface by its name.
pub(super) fn named_surface(name: &str, element: Element) -> Result<Cell, CellFault> {
    let surface = Surface::from_name(name).ok_or_else(|| {
        let known: Vec<&str> = Surface::ALL.iter().map(|s| s.name()).collect();
        CellFault::Rule(format!(
            "no surface is named {name:?}; expected one of {}",
            known.join(", ")
        ))
    })?;
    Ok(surface.cell(element)?)
}

/// Fits a cell to a mesh as a section (of a recipe or of a command line) says.
///
/// # Errors
/// When the mesh cannot be placed, closed or fitted, or the section's level cannot be reached.
pub fn fit(
    name: &str,
    section: &CellSection,
    element: Element,
    mesh: &crate::mesh::TriMesh,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    let default = FitOptions::default();
    let options = FitOptions {
        band_limit: section.band_limit.map_or(default.band_limit, |r| r.0),
        samples: section.samples.map_or(default.samples, |n| n as usize),
        ..default
    };
    let place = section
        .place
        .as_ref()
        .map_or(Placement::Reference, placement);
    let caps = match section.caps.unwrap_or_default() {
        recipe::Caps::Exclude => Caps::Exclude,
        recipe::Caps::Keep => Caps::Keep,
    };
    fit_mesh(name, element, mesh, &place, caps, &options, progress)
}

fn placement(place: &CellPlace) -> Placement {
    match place {
        CellPlace::Reference => Placement::Reference,
        CellPlace::Fit => Placement::Fit,
        CellPlace::Similarity(s) => Placement::Similarity {
            scale: s.scale.0,
            rotate: s.rotate.map(|r| r.0),
            translate: Vec3::from(s.translate.map(|t| t.0)),
        },
        CellPlace::Vertices(v) => Placement::Vertices(v.iter().map(|p| Vec3::from(*p)).collect()),
    }
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
    let mut cell = cell;
    if let Some(thickness) = section.thickness {
        let side = side.unwrap_or(cell.solid());
        cell = sided(cell, side)?;
        let level = cell.level_for_thickness(thickness.0)?;
        cell = cell.with_solid(side, level)?;
    } else if let Some(fraction) = section.volume_fraction {
        let side = side.unwrap_or(cell.solid());
        cell = sided(cell, side)?;
        let level = cell.level_for_volume_fraction(fraction.0)?;
        cell = cell.with_solid(side, level)?;
    } else if section.level.is_some() || side.is_some() {
        let level = section.level.map_or(cell.level(), |l| l.0);
        let side = side.unwrap_or(cell.solid());
        cell = cell.with_solid(side, level)?;
    }
    if section.invert == Some(true) {
        cell = cell.inverted();
    }
    Ok(cell)
}

/// Notes where a cell's source stands, and what its fit warns of.
fn note(inputs: &mut Inputs, key: &str, path: &Path, cell: &Cell) -> Result<(), RunError> {
    let Some(report) = cell.report() else {
        return Ok(());
    };
    let bounds = report.source.map_or(Aabb::EMPTY, |s| Aabb {
        min: Vec3::from(s.box_min),
        max: Vec3::from(s.box_max),
    });
    inputs.record(key, path, bounds)?;
    for warning in report.warnings.clone() {
        inputs.warn(Warning::CELL, format!("{key}: {warning}"))?;
    }
    Ok(())
}

fn fit_fault(error: FitError, key: &str) -> RunError {
    match error {
        FitError::Cancelled(c) => RunError::Cancelled(c),
        error => RunError::Cell {
            key: key.to_owned(),
            fault: CellFault::Fit(error),
        },
    }
}

fn element_box(element: Element) -> Aabb {
    Aabb::of(element.vertices())
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
    let failed = |e: String| RunError::Tiling(e);
    let (kind, vertices) = match cell.element() {
        Element::Tet => (Kind::Tet4, cell.element().vertices()),
        _ => (Kind::Hex8, Element::Hex.vertices()),
    };
    let mut elements = Connectivity::default();
    let nodes: Vec<u32> = (0..vertices.len() as u32).collect();
    elements.push(kind, &nodes);
    let scaffold = Scaffold::new(vertices, elements).map_err(|e| failed(e.to_string()))?;
    let table = Table::new(cell).map_err(|e| failed(e.to_string()))?;
    let options = TilingOptions {
        voxel_size,
        half_width: half_width * voxel_size,
        distance: crate::tiling::Distance::Fast,
        boundary: crate::tiling::Boundary::Cut,
    };
    let solid = TiledSolid::new(&scaffold, &table, options).map_err(|e| failed(e.to_string()))?;
    let bench = Bench {
        threads: session.threads,
        progress: session.progress,
        scale: recipe::Scale {
            unit: crate::frame::LengthUnit::default(),
            voxel_size,
        },
        half_width,
    };
    let shape = Shape {
        field: Box::new(solid),
        extent: scaffold.bounds(),
        name: "the element".into(),
    };
    Ok(bench.sample(&shape, "band")?.0)
}
