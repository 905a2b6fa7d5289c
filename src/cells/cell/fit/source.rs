//! Fits to a source: a mesh, points, voxels, struts, plates or a formula.

use super::accuracy::SourceInfo;
use super::{FitError, FitOptions, Placement, fit_with};
use crate::cell::{Caps, Cell, Source};
use druse_geometry::frame::Element;
use druse_geometry::mesh::TriMesh;
use druse_geometry::progress::Progress;

/// Fits a cell to a source.
///
/// The report contains the source's bounding box after placement and its share inside the element. The part
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
    // A search for a tolerance starts with a low band limit and checks the resolution by itself.
    if options.tolerance.is_none() {
        source.check_resolution(options.band_limit)?;
    }
    let info = SourceInfo {
        points: source.surface_points().to_vec(),
        source: Some(source.report()),
        period: None,
        inexact: !source.is_exact(),
    };
    fit_with(
        name,
        element,
        &|p| source.value(p),
        &info,
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
