//! Effective properties of cells, and cells designed for target properties.

use crate::cell::Cell;
use crate::fault::Fault;
use crate::session;
use druse::homogenize::{Control, Isotropic, Packing, Settings};
use druse::pipeline::{self, CellPeriod, PropertyOptions};
use druse::recipe::CellSection;
use druse::vdb::Session;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

/// Residual for derivatives, whose error is of the order of the residual itself.
const GRADIENT_RESIDUAL: f64 = 1e-7;

/// Voxels along the period; whether they are sharp; whether derivatives are requested.
type Grid = (usize, bool, bool);
/// Young's modulus, Poisson's ratio, conductivity, share of the void, residual.
type Numbers = (f64, f64, f64, f64, f64);

fn settings(
    (_, _, with_gradient): Grid,
    (young, poisson, kappa, void, residual): Numbers,
    [stiffness, conductivity, permeability]: [bool; 3],
) -> Result<Settings, Fault> {
    if !(residual > 0.0 && residual < 1.0) {
        return Err(Fault::Argument(format!(
            "residual is {residual}; expected a number between 0 and 1"
        )));
    }
    if with_gradient && !(stiffness && conductivity) {
        return Err(Fault::Argument(
            "gradient needs stiffness and conductivity; expected both in only".into(),
        ));
    }
    let tolerance = if with_gradient {
        residual.min(GRADIENT_RESIDUAL)
    } else {
        residual
    };
    Ok(Settings {
        solid: Isotropic::new(young, poisson)?,
        kappa,
        void,
        stiffness,
        conductivity,
        permeability,
        all_loads: with_gradient,
        control: Control {
            tolerance,
            ..Control::default()
        },
        ..Settings::default()
    })
}

/// The period of a cell: round beams where the keys of a section describe struts or plates, else the series.
fn period(cell: &Cell, keys: Option<&str>, packing: Packing) -> Result<CellPeriod, Fault> {
    let cell = &cell.cell;
    if let Some(keys) = keys {
        let section = CellSection::parse(keys)?;
        let beams = pipeline::beam_period(cell.name(), &section, cell.element(), packing)?;
        if let Some(found) = beams {
            return Ok(found);
        }
    }
    Ok(pipeline::cell_period(cell.clone(), packing, Vec::new())?)
}

/// Effective properties as JSON, and warnings. `keys` are those of a section of struts or plates.
#[pyfunction]
#[pyo3(signature = (cell, keys, tets, grid, numbers, only, progress=None))]
#[allow(clippy::too_many_arguments)] // Each is an argument of the Python function.
pub(crate) fn homogenize(
    py: Python<'_>,
    cell: Py<Cell>,
    keys: Option<String>,
    tets: &str,
    grid: Grid,
    numbers: Numbers,
    only: [bool; 3],
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, Vec<String>)> {
    let packing = match tets {
        "bcc" => Packing::Bcc,
        "kuhn" => Packing::Kuhn,
        word => {
            let text = format!("tets is {word:?}; expected bcc or kuhn");
            return Err(Fault::Argument(text).raise(py));
        }
    };
    let cell = cell.get();
    session::work(py, progress, |session: Session<'_>| {
        let settings = settings(grid, numbers, only)?;
        let (resolution, is_sharp, with_gradient) = grid;
        if let Some(fault) = pipeline::resolution_fault(resolution, &settings, with_gradient) {
            return Err(Fault::Argument(format!("resolution: {fault}")));
        }
        let source = period(cell, keys.as_deref(), packing)?;
        let options = PropertyOptions {
            resolution,
            is_sharp,
            with_gradient,
            settings,
        };
        let found = pipeline::cell_properties(&source, &options, session.progress)?;
        let warnings =
            pipeline::period_warnings(&source, &found.fine, resolution, found.level).into_iter();
        Ok((
            found.json(&source).to_string(),
            warnings.map(|w| w.message).collect(),
        ))
    })
}

/// The cell that a section with a target describes. It is also written to `save`, even if the search is
/// interrupted; `earlier` is a cell whose search continues.
#[pyfunction]
#[pyo3(signature = (name, keys, matched, earlier, save, progress=None))]
pub(crate) fn design(
    py: Python<'_>,
    name: &str,
    keys: &str,
    matched: Vec<Py<Cell>>,
    earlier: Option<Py<Cell>>,
    save: Option<PathBuf>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Cell> {
    let matched: Vec<&Cell> = matched.iter().map(Py::get).collect();
    let earlier = earlier.as_ref().map(|c| &c.get().cell);
    session::work(py, progress, |session: Session<'_>| {
        let section = CellSection::parse(keys)?;
        let element = section.own_element().unwrap_or(druse::frame::Element::Hex);
        let matched = matched.iter().map(|c| c.cell.clone()).collect();
        let design = pipeline::design(name, &section, element, matched, &Path::to_path_buf)?;
        let made = design.prepare()?.search(earlier, session.progress)?;
        if let Some(path) = &save {
            druse::io::write_cell(path, &made.cell)?;
        }
        Ok(Cell::of(made.cell))
    })
}
