//! Cells from samples over a whole period, which are transformed as they are.

use super::source::{Found, Reader, SourceFault, has_extension, in_file};
use crate::cell::{
    Cell, Filter, FitOptions, Method, Solver, Voxels, fit_samples, fit_samples_least_squares,
};
use crate::frame::{Aabb, Element};
use crate::io::{Place, ReadError};
use crate::recipe::{CellPlace, CellSection, FileRef};

impl Reader<'_> {
    /// The cell of the samples of a `.npy`, which stand at lattice coordinates u = j/N - 1/2 of the
    /// period: with method fft, and by least squares where the element is the period and no band limit
    /// is asked for. `None` if the section says something else.
    pub(super) fn of_samples(
        &self,
        name: &str,
        section: &CellSection,
        (element, options): (Element, &FitOptions),
        found: &mut Found,
    ) -> Result<Option<Cell>, SourceFault> {
        let Some(file) = samples_file(section, element, options) else {
            return Ok(None);
        };
        let path = self.resolve(&file.path);
        let array = crate::io::read_npy(&path)?;
        if array.shape.len() != element.dimension() {
            // A square of samples is a source of a hex, too, the same along z.
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
        let samples = voxels.signed(true);
        found.file = Some(("voxels", path, Aabb::of(element.vertices())));
        let progress = self.session.progress;
        let fit = match options.method {
            Method::Lsq => fit_samples_least_squares,
            _ => fit_samples,
        };
        Ok(Some(fit(name, element, &samples, n, &options, progress)?))
    }
}

/// The file of samples over a whole period that are to be transformed.
fn samples_file<'a>(
    section: &'a CellSection,
    element: Element,
    options: &FitOptions,
) -> Option<&'a FileRef> {
    let file = section.voxels.as_ref()?;
    let placed = section
        .place
        .as_ref()
        .is_some_and(|p| *p != CellPlace::Reference);
    let whole = matches!(element, Element::Hex | Element::Quad)
        && section.band_limit.is_none()
        && section.tolerance.is_none()
        && options.solver == Solver::Auto
        && options.filter == Filter::None;
    let transformed = match options.method {
        Method::Fft => true,
        Method::Lsq => whole,
        Method::Paper => false,
    };
    (transformed && !placed && !has_extension(&file.path, &["vdb"])).then_some(file)
}
