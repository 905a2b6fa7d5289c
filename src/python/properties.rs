//! Computes effective properties of cells and designs cells for target properties, for the Python package.
//! Properties own their inputs, so that an interrupted call returns at once; a design borrows them, and an interrupted
//! call returns after its best cell is written.
//! `_properties.py` of the package `druse` checks the arguments of users and calls these functions by position.

use crate::cell::Cell;
use crate::fault::Fault;
use crate::session;
use druse::homogenize::{Control, Isotropic, Packing, Settings};
use druse::pipeline::{self, CellPeriod, PropertyOptions};
use druse::recipe::CellSection;
use druse::vdb::Session;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

/// Greatest residual of the solver, over that of the load, where derivatives are requested: their error is linear in
/// the residual, that of stiffness and conductivity quadratic.
const GRADIENT_RESIDUAL: f64 = 1e-7;

/// The grid of a period: in Python a tuple of these fields in this order.
#[derive(Clone, Copy, FromPyObject)]
pub(crate) struct GridArguments {
    /// Voxels along the period.
    #[pyo3(item(0))]
    resolution: usize,
    /// Whether voxels are rounded to solid or void.
    #[pyo3(item(1))]
    is_sharp: bool,
    /// Whether derivatives by the level and by every coefficient are computed.
    #[pyo3(item(2))]
    with_gradient: bool,
}

/// The materials and the accuracy: in Python a tuple of these fields in this order.
#[derive(Clone, Copy, FromPyObject)]
pub(crate) struct MaterialArguments {
    /// Young's modulus of the solid; effective stiffnesses have its unit.
    #[pyo3(item(0))]
    young: f64,
    /// Poisson's ratio of the solid.
    #[pyo3(item(1))]
    poisson: f64,
    /// Conductivity of the solid; effective conductivities have its unit.
    #[pyo3(item(2))]
    conductivity: f64,
    /// Moduli and conductivity of the void over those of the solid, from 0 on, below 1.
    #[pyo3(item(3))]
    void_ratio: f64,
    /// Residual at which iterations end, over that of the load; between 0 and 1.
    #[pyo3(item(4))]
    residual: f64,
}

/// The settings of the solver; `requested` states whether stiffness, conductivity and permeability are computed.
fn settings(
    materials: MaterialArguments,
    with_gradient: bool,
    requested: [bool; 3],
) -> Result<Settings, Fault> {
    let residual = materials.residual;
    if !(residual > 0.0 && residual < 1.0) {
        return Err(Fault::Argument(format!(
            "residual is {residual}; expected a number between 0 and 1"
        )));
    }
    let [stiffness, conductivity, permeability] = requested;
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
        solid: Isotropic::new(materials.young, materials.poisson)?,
        kappa: materials.conductivity,
        void: materials.void_ratio,
        stiffness,
        conductivity,
        permeability,
        // Derivatives need the solutions of all load cases, also of those that symmetry makes redundant.
        all_loads: with_gradient,
        control: Control {
            tolerance,
            ..Control::default()
        },
        ..Settings::default()
    })
}

/// The period of a cell: round beams where `section_toml`, the recipe section that the cell was made from, describes
/// struts or plates, else the cell's series.
fn period(
    cell: &druse::cell::Cell,
    section_toml: Option<&str>,
    packing: Packing,
) -> Result<CellPeriod, Fault> {
    if let Some(text) = section_toml {
        let section = CellSection::parse(text)?;
        let beams = pipeline::beam_period(cell.name(), &section, cell.element(), packing)?;
        if let Some(beams) = beams {
            return Ok(beams);
        }
    }
    Ok(pipeline::cell_period(cell.clone(), packing, Vec::new())?)
}

/// Effective properties of a cell as JSON text, and the texts of warnings.
///
/// `section_toml` is the recipe section of a cell of struts or plates, which is then computed with round beams; `None`
/// takes the cell's series. `tets` is the periodic packing of a cell of a tet, "bcc" or "kuhn". `requested` states
/// whether stiffness, conductivity and permeability are computed. `progress` is a callable of stage, done and total.
///
/// # Errors
/// Invalid arguments, a grid too coarse for the cell or too large for the memory, iterations that do not converge, and
/// any exception of `progress` or of a signal handler, such as `KeyboardInterrupt`.
#[pyfunction]
#[pyo3(signature = (cell, section_toml, tets, grid, materials, requested, progress=None))]
#[allow(clippy::too_many_arguments)] // Each is an argument of the Python function.
pub(crate) fn homogenize(
    py: Python<'_>,
    cell: Py<Cell>,
    section_toml: Option<String>,
    tets: &str,
    grid: GridArguments,
    materials: MaterialArguments,
    requested: [bool; 3],
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, Vec<String>)> {
    let packing = match tets {
        "bcc" => Packing::Bcc,
        "kuhn" => Packing::Kuhn,
        word => {
            let text = format!("tets is {word:?}; expected bcc or kuhn");
            return Err(Fault::Argument(text).into());
        }
    };
    let cell = cell.get().cell.clone();
    let GridArguments {
        resolution,
        is_sharp,
        with_gradient,
    } = grid;
    session::work_owned(py, progress, move |session: Session<'_>| {
        // Everything is checked before the long computation, in the words of the arguments.
        let settings = settings(materials, with_gradient, requested)?;
        if let Some(fault) = pipeline::resolution_fault(resolution, &settings, with_gradient) {
            return Err(Fault::Argument(format!("resolution: {fault}")));
        }
        let period = period(&cell, section_toml.as_deref(), packing)?;
        let options = PropertyOptions {
            resolution,
            is_sharp,
            with_gradient,
            settings,
        };
        let found = pipeline::cell_properties(&period, &options, session.progress)?;
        let warnings =
            pipeline::period_warnings(&period, &found.fine, resolution, found.level).into_iter();
        Ok((
            found.json(&period).to_string(),
            warnings.map(|w| w.message).collect(),
        ))
    })
}

/// Designs the cell that a recipe section with a target describes.
///
/// The cell keeps the traces on the faces of `matched_cells`. `earlier` is a cell of an earlier search, which
/// continues. The cell is also written to the .cell file `save`, if one is given.
///
/// # Errors
/// Invalid arguments, a search without a connected cell, a file that cannot be written, and any exception of `progress`
/// or of a signal handler. After such an exception `save` holds the best connected cell so far, if there was
/// one, whose report has `design.complete` = false; a cell that is returned is always complete.
#[pyfunction]
#[pyo3(signature = (name, section_toml, matched_cells, earlier, save, progress=None))]
pub(crate) fn design(
    py: Python<'_>,
    name: &str,
    section_toml: &str,
    matched_cells: Vec<Py<Cell>>,
    earlier: Option<Py<Cell>>,
    save: Option<PathBuf>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Cell> {
    let matched_cells: Vec<&Cell> = matched_cells.iter().map(Py::get).collect();
    let earlier = earlier.as_ref().map(|c| &c.get().cell);
    session::work(py, progress, |session: Session<'_>| {
        let section = CellSection::parse(section_toml)?;
        let element = section.own_element().unwrap_or(druse::frame::Element::Hex);
        let matched_cells = matched_cells.iter().map(|c| c.cell.clone()).collect();
        // Paths in the section are relative to the working directory.
        let design = pipeline::design(name, &section, element, matched_cells, &Path::to_path_buf)?;
        let designed = design.prepare()?.search(earlier, session.progress)?;
        if let Some(path) = &save {
            druse::io::write_cell(path, &designed.cell)?;
        }
        Ok(Cell::of(designed.cell))
    })
}
