//! Fitting a cell to geometry: weighted least squares over the element only.
//!
//! Minimises (1/V) int w (Phi - g)^2 + lambda sum (1 + |f|^2) a^2 over the real orthonormal
//! coefficients a, where g is the signed distance to the geometry (negative inside) and the mean is
//! taken over the element's interior, plus 0.3 times that over its faces, plus 0.1 times that over its
//! edges. Nothing outside the element is used: this is a Fourier extension, whose normal equations
//! are ill-conditioned and whose regularised solution is accurate all the same. On the lattice
//! spanned by the tet's edges it is continuous from element to element without any reflection.
//!
//! By symmetry only the fundamental simplex is sampled. Geometry that lacks the element's symmetry
//! is averaged over its images, which is the orthogonal projection; the report says how much of its
//! energy survives and how far it was from symmetric.
//!
//! Conventions: lengths and distances in reference units; `band_limit` R keeps |f| <= R, in cycles
//! per unit of reference length; results do not depend on the number of threads.

use super::{Cell, CellError, Series};
use crate::frame::{CellPoint, Element};
use crate::progress::Progress;
use crate::symmetry::Basis;

mod accuracy;
mod error;
mod pieces;
mod place;
mod report;
mod sampling;
mod solve;
mod source;
pub use error::FitError;
pub use place::Placement;
pub use report::{Components, FitReport, Hausdorff, SourceReport};
pub use solve::{Sample, least_squares};
pub use source::{fit_mesh, fit_source};

use sampling::{Images, Target, parts, sample};

/// How a cell is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct FitOptions {
    /// R: keeps |f| <= R, in cycles per unit of reference length.
    pub band_limit: f64,
    /// Name of the lattice; `None` for the element's default.
    pub lattice: Option<String>,
    /// Weight lambda of the penalty (1 + |f|^2) a^2.
    pub regularisation: f64,
    /// Least number of samples along an edge of the element's cube; more are taken where the
    /// unknowns ask for them (at least 12 samples each).
    pub samples: usize,
    /// Whether to measure the Hausdorff distance and the number of pieces.
    pub measure: bool,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            band_limit: 8.0,
            lattice: None,
            regularisation: 1e-5,
            samples: 32,
            measure: true,
        }
    }
}

/// Greatest number of unknowns of the dense solver.
const MOST_UNKNOWNS: usize = 4000;
/// Share of the mean square below which nothing of the source is symmetric, and below which it is
/// worth a warning.
const NO_SYMMETRIC_PART: f64 = 1e-6;
const LITTLE_SYMMETRIC_PART: f64 = 0.9;

/// Below this share of its root mean square a source's asymmetry is rounding.
const SYMMETRIC: f64 = 1e-6;

/// A signed distance in the reference frame of an element, negative inside.
pub type Distance<'a> = dyn Fn(CellPoint<3>) -> f64 + Sync + 'a;

/// Fits a cell of `element` to a signed distance (negative inside) given in its reference frame.
///
/// The solid is below level 0. The work takes seconds and stops early when `progress` says so.
///
/// # Errors
/// [`FitError`]: a source that is not finite, leaves nothing solid or nothing void inside the
/// element, or has no symmetric part; a band that is too large; a lattice that does not fit.
///
/// ```
/// use druse::cell::{FitOptions, fit};
/// use druse::{frame::Element, progress::Silent};
/// let options = FitOptions { band_limit: 4.0, ..FitOptions::default() };
/// let ball = fit("ball", Element::Tet, &|p| p.0.norm() - 0.2, &options, &Silent).unwrap();
/// assert!(ball.report().unwrap().rms < 0.005);
/// ```
pub fn fit(
    name: &str,
    element: Element,
    source: &Distance,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    let job = accuracy::Extra::default();
    fit_with(name, element, source, &job, options, progress)
}

/// [`fit`], with what is known about the source beside its distance.
fn fit_with(
    name: &str,
    element: Element,
    source: &Distance,
    extra: &accuracy::Extra,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    check(options)?;
    if !matches!(element, Element::Tet | Element::Hex) {
        return Err(FitError::Element {
            element: element.name(),
        });
    }
    let (group, lattice) = Cell::symmetry(element, options.lattice.as_deref())?;
    // The number of orbits, about that of unknowns, without listing them.
    let ball = 4.0 / 3.0 * std::f64::consts::PI * options.band_limit.powi(3) * lattice.volume();
    let estimate = ball / group.order() as f64;
    let too_large = |unknowns: usize| FitError::TooLarge {
        band_limit: options.band_limit,
        unknowns,
        limit: MOST_UNKNOWNS,
        largest: options.band_limit * (MOST_UNKNOWNS as f64 * 0.8 / unknowns as f64).cbrt(),
    };
    if estimate > 2.0 * MOST_UNKNOWNS as f64 {
        return Err(too_large(estimate as usize));
    }
    let basis = Basis::new(group, lattice, options.band_limit);
    if basis.len() > MOST_UNKNOWNS {
        return Err(too_large(basis.len()));
    }
    progress.stage("fit: samples", None);
    let mut target = Target {
        images: Images {
            source,
            operators: basis.group().cartesian(basis.lattice()),
        },
        symmetric: false,
    };
    let parts = parts(element, basis.len(), options.samples);
    let (samples, quality) = sample(element, &target, parts, extra, progress)?;
    if quality.kept_energy < NO_SYMMETRIC_PART {
        return Err(FitError::NoSymmetricPart {
            group: basis.group().name().to_owned(),
            kept: quality.kept_energy,
        });
    }
    target.symmetric = quality.residual <= SYMMETRIC * quality.rms;
    progress.stage("fit: least squares", None);
    let real = least_squares(&basis, &samples, options.regularisation, progress)?;
    let series = Series::new(
        basis.group().clone(),
        basis.lattice().clone(),
        &basis.coefficients(&real),
    )?;
    let cell = Cell::new(name, element, series)?;
    cell.check_surface()?;
    progress.stage("fit: accuracy", None);
    let mut report = accuracy::measure(&cell, &target, parts, options, extra, progress)?;
    report.degrees_of_freedom = basis.len();
    report.kept_energy = quality.kept_energy;
    report.symmetry_residual = quality.residual;
    if quality.kept_energy < LITTLE_SYMMETRIC_PART {
        report.warnings.push(format!(
            "only {:.3} of the source's energy has the symmetry {}: the cell differs from it by rms {:.4}",
            quality.kept_energy,
            basis.group().name(),
            quality.residual,
        ));
    }
    Ok(cell.with_report(report))
}

fn check(options: &FitOptions) -> Result<(), CellError> {
    let positive = |what, found: f64, expected: &str| {
        if found.is_finite() && found > 0.0 {
            return Ok(());
        }
        Err(CellError::OutOfRange {
            what,
            found,
            expected: expected.to_owned(),
        })
    };
    positive(
        "band_limit",
        options.band_limit,
        "a positive number of cycles per unit of reference length",
    )?;
    positive(
        "regularisation",
        options.regularisation,
        "a positive number, such as 1e-5",
    )?;
    if options.samples > 1024 {
        return Err(CellError::OutOfRange {
            what: "samples",
            found: options.samples as f64,
            expected: "at most 1024 along an edge of the element's cube".to_owned(),
        });
    }
    Ok(())
}
