//! Fitting to a source: a mesh, points, voxels, struts, plates or a formula.

use super::accuracy::Extra;
use super::{FitError, FitOptions, Placement, fit_with};
use crate::cell::{Caps, Cell, Source};
use crate::frame::Element;
use crate::mesh::TriMesh;
use crate::progress::Progress;

/// Fits a cell to a source.
///
/// The report names the source's box after placement and its share inside the element; what lies
/// outside is not used.
///
/// # Errors
/// As [`super::fit()`].
pub fn fit_source(
    name: &str,
    element: Element,
    source: &Source,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    // A tolerance begins low, and ends at the latest where the source is known no better.
    if options.tolerance.is_none() {
        source.resolves(options.band_limit)?;
    }
    let extra = Extra {
        points: source.surface_points().to_vec(),
        source: Some(source.report()),
        period: None,
        inexact: !source.is_exact(),
    };
    fit_with(
        name,
        element,
        &|p| source.value(p),
        &extra,
        options,
        progress,
    )
}

/// Fits a cell to a triangle mesh: [`Source::mesh`], then [`fit_source`].
///
/// # Errors
/// As [`super::fit()`], and [`FitError::Placement`], [`FitError::Mesh`].
pub fn fit_mesh(
    name: &str,
    element: Element,
    mesh: &TriMesh,
    placement: &Placement,
    caps: Caps,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    let source = Source::mesh(element, mesh, placement, caps)?;
    fit_source(name, element, &source, options, progress)
}
