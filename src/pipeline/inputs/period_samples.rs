//! Cells from samples over a whole period, by a direct transform, or by least squares over the samples where the
//! element is the period. No surface is made of them first.

use super::source::{SourceFault, SourceReader, SourceRecord, has_extension, in_file};
use crate::cell::{
    Cell, Filter, FitOptions, Method, Solver, Voxels, fit_samples, fit_samples_least_squares,
};
use crate::frame::{Aabb, Element};
use crate::io::{Place, ReadError};
use crate::recipe::{CellPlace, CellSection, FileRef};

impl SourceReader<'_> {
    /// The cell of the samples of a `.npy` at lattice coordinates u = j/N - 1/2 of the period. Method fft transforms
    /// them; least squares fits them where the element is the period and no band limit, tolerance, solver or filter is
    /// set. `None` for other sections.
    pub(crate) fn cell_from_samples(
        &self,
        name: &str,
        section: &CellSection,
        element: Element,
        options: &FitOptions,
        record: &mut SourceRecord,
    ) -> Result<Option<Cell>, SourceFault> {
        let Some(file) = samples_file(section, element, options) else {
            return Ok(None);
        };
        let path = self.resolve(&file.path);
        let array = crate::io::read_npy(&path)?;
        if array.shape.len() != element.dimension() {
            // A two-dimensional array is also a source of a hex, constant along z.
            if options.method == Method::Lsq {
                return Ok(None);
            }
            let found = format!("an array of {} dimensions", array.shape.len());
            let expected = match element.dimension() {
                2 => "one of shape [N, N] for a planar element",
                _ => "one of shape [N, N, N] for a solid element",
            };
            return Err(ReadError::data(&path, Place::File, found, expected).into());
        }
        let voxels = Voxels::new(&array.shape, array.values, array.binary)
            .map_err(|e| in_file(&path, e.into()))?;
        let n = voxels.counts()[0];
        let mut options = options.clone();
        if section.band_limit.is_none() {
            options.band_limit = f64::INFINITY;
        }
        let samples = voxels.signed_over_period();
        record.file = Some(("voxels", path, Aabb::of(element.vertices())));
        let progress = self.session.progress;
        let fit = match options.method {
            Method::Lsq => fit_samples_least_squares,
            _ => fit_samples,
        };
        Ok(Some(fit(name, element, &samples, n, &options, progress)?))
    }
}

/// The file of samples over a whole period, if the section transforms one.
fn samples_file<'a>(
    section: &'a CellSection,
    element: Element,
    options: &FitOptions,
) -> Option<&'a FileRef> {
    let file = section.voxels.as_ref()?;
    let is_placed = section
        .place
        .as_ref()
        .is_some_and(|p| *p != CellPlace::Reference);
    let is_plain_least_squares = matches!(element, Element::Hex | Element::Quad)
        && section.band_limit.is_none()
        && section.tolerance.is_none()
        && options.solver == Solver::Auto
        && options.filter == Filter::None;
    let is_transformed = match options.method {
        Method::Fft => true,
        Method::Lsq => is_plain_least_squares,
        Method::Paper => false,
    };
    (is_transformed && !is_placed && !has_extension(&file.path, &["vdb"])).then_some(file)
}
