//! Fits to a source: a mesh, points, voxels, struts, plates or a formula.
//!
//! A source is already placed in the reference frame. Here its distance becomes the target of a fit, and its known
//! points, position and exactness go to the measurement of the result.

use super::accuracy::SourceInfo;
use super::{FitError, FitOptions, Placement, fit_with};
use crate::cell::{Caps, Cell, Source};
use druse_geometry::frame::Element;
use druse_geometry::mesh::TriMesh;
use druse_geometry::progress::Progress;

/// Fits a cell to a source.
/// `name` is that of the new cell.
///
/// The report in the cell contains the source's bounding box after placement and its share inside the element. The
/// part outside is not used.
///
/// # Errors
/// As [`super::fit()`], and [`FitError::Voxels`] for samples too coarse for the band limit (1 with a tolerance).
pub fn fit_source(
    name: &str,
    element: Element,
    source: &Source,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    // Without a tolerance the band limit is that of the options. A search for a tolerance starts with a low one and
    // ends where the samples of the source do.
    let mut options = options.clone();
    if options.tolerance.is_some() {
        options.band_limit = options.band_limit.min(source.max_band_limit());
    }
    source.check_resolution(options.band_limit)?;
    let info = SourceInfo {
        // Points of the surface, at which the error of the fit is measured.
        points: source.surface_points().to_vec(),
        source: Some(source.report()),
        // The source is evaluated at points; samples of a period are fitted elsewhere.
        period: None,
        // Whether values are no exact distances: the report then measures distances by Newton steps on the source
        // instead of taking its values.
        inexact: !source.is_exact(),
    };
    fit_with(
        name,
        element,
        &|p| source.value(p),
        &info,
        &options,
        progress,
    )
}

/// Fits a cell to a triangle mesh: [`Source::mesh`], then [`fit_source`].
///
/// # Errors
/// As [`fit_source`], and [`FitError::Placement`], [`FitError::Mesh`].
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
