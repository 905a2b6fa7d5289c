//! Fitting a cell to geometry by weighted least squares over the element.
//!
//! The cell's function Phi is a sum of waves of frequencies f with real orthonormal coefficients a; g is the signed
//! distance to the geometry (negative inside). The fit minimises mean (Phi - g)^2 + lambda sum (1 + |f|^2) a^2, with
//! lambda [`FitOptions::regularisation`]. The mean is that over the element's interior plus 0.3 times that over its
//! faces plus 0.1 times that over its edges (0.03 and 0.01 for face-normal cells). Nothing outside the element is used:
//! this is a Fourier extension, whose normal equations are ill-conditioned but whose regularised solution is accurate.
//! On the lattice spanned by the tet's edges it is continuous across elements without reflection.
//!
//! By symmetry only the fundamental simplex is sampled. Geometry without the element's symmetry is averaged
//! over its images, which is the orthogonal projection; the report gives the kept energy and the residual.
//!
//! Lengths are in reference units; `band_limit` R keeps |f| <= R, in cycles per unit of reference length.
//! Results do not depend on the number of threads.

use super::{Cell, CellError};
use druse_geometry::frame::{CellPoint, Element, Mat3};
use druse_geometry::progress::Progress;

mod accuracy;
mod components;
mod error;
mod extension;
mod frequency_set;
mod grid;
mod grid_solver;
mod iterative;
mod matched;
mod options;
mod placement;
mod projection;
mod report;
mod run;
mod sampling;
mod solve;
mod source;
mod transform;
pub use error::FitError;
pub use frequency_set::largest_band;
pub use matched::fit_matched;
pub use options::{Filter, FitOptions, Method, Solver, Symmetrise};
pub use placement::Placement;
pub use projection::{fourier_coefficients, lanczos};
pub use report::{Components, FitReport, Hausdorff, SourceReport};
pub use solve::{Sample, least_squares};
pub use source::{fit_mesh, fit_source};
pub use transform::{Spectrum, Transform};

pub(super) use extension::Extension;
pub(super) use grid::grid_size;

use accuracy::SourceInfo;
use run::Job;

/// A signed distance in the reference frame of an element, negative inside.
pub type Distance<'a> = dyn Fn(CellPoint<3>) -> f64 + Sync + 'a;

/// The first band limit of a search for a tolerance, cycles per reference length, and the factor to the next.
const INITIAL_BAND_LIMIT: f64 = 4.0;
const BAND_LIMIT_FACTOR: f64 = 1.5;

/// Fits a cell of `element` to a signed distance (negative inside) in the element's reference frame.
/// A tolerance in the options raises the band limit until the measured distance of the surfaces is within it, or the
/// limit is reached, which gives a warning.
///
/// The solid is below level 0. A fit takes seconds; `progress` can cancel it.
///
/// # Errors
/// [`FitError`]: a source that is not finite, has no solid or no void inside the element, or has no
/// symmetric part; an option out of range or unfit for the element; equations that are singular or do not converge;
/// cancelling.
///
/// ```
/// # mod druse { pub use druse_cells::*; pub use druse_geometry::*; }
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
    fit_with(
        name,
        element,
        source,
        &SourceInfo::default(),
        options,
        progress,
    )
}

/// Fits a cell to samples of a signed distance over a whole period of the lattice, by Fourier transform.
/// The fit is exact if the samples are symmetric and their band limit is below half their number.
///
/// The samples lie at u = j/N - 1/2 in lattice coordinates, the last axis fastest. An infinite band limit
/// keeps every orbit whose members k all have `|k_i| < N/2` on each axis, which N samples can represent.
/// On skew lattices an orbit with a member outside that box is dropped as a whole. A finite band limit R
/// keeps those of them with |f| <= R; it is at most [`largest_band`]. `method` and `samples` of the options are
/// ignored. The report compares the cell with the trilinear interpolant of the samples.
///
/// # Errors
/// As [`fit()`], and [`FitError::TooFewSamples`].
///
/// # Panics
/// If there are not `n`^3 samples (`n`^2 for a planar element).
pub fn fit_samples(
    name: &str,
    element: Element,
    samples: &[f64],
    n: usize,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    let options = FitOptions {
        method: Method::Fft,
        ..options.clone()
    };
    fit_period(name, element, samples, n, &options, progress)
}

/// Fits a cell to samples over a whole period by least squares. Waves are orthogonal over the period, so
/// the result is that of [`fit_samples`], except for the method in the report and an optional penalty.
/// The layout of the samples is the same.
///
/// # Errors
/// As [`fit_samples`].
///
/// # Panics
/// As [`fit_samples`].
pub fn fit_samples_least_squares(
    name: &str,
    element: Element,
    samples: &[f64],
    n: usize,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    let options = FitOptions {
        method: Method::Lsq,
        ..options.clone()
    };
    fit_period(name, element, samples, n, &options, progress)
}

/// The fit of `n` samples per axis over a period, by the method of the options.
/// Samples are as in [`fit_samples`]. Their band is fixed, so that a tolerance in the options does not count.
fn fit_period(
    name: &str,
    element: Element,
    samples: &[f64],
    n: usize,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    let dimension = element.dimension();
    assert_eq!(
        samples.len(),
        n.pow(dimension as u32),
        "n samples along every axis"
    );
    if element == Element::Ball {
        options.check_ball()?;
    }
    let (group, lattice_name) = (&options.group, &options.lattice);
    // u = L^-1 x maps a point to fractions of the periods; a planar lattice leaves z out.
    let inverse = if dimension == 2 {
        let (_, lattice) =
            super::symmetry::<2>(element, group.as_deref(), lattice_name.as_deref())?;
        Mat3::from_fn(|i, j| {
            if i < 2 && j < 2 {
                lattice.inverse()[(i, j)]
            } else {
                0.0
            }
        })
    } else {
        let (_, lattice) =
            super::symmetry::<3>(element, group.as_deref(), lattice_name.as_deref())?;
        *lattice.inverse()
    };
    let source = |p: CellPoint<3>| {
        let u: [f64; 3] = (inverse * p.0).into();
        multilinear(samples, n, &u[..dimension])
    };
    let info = SourceInfo {
        period: Some((samples, n)),
        ..SourceInfo::default()
    };
    // The samples fix the band limit, so that there is no search for a tolerance.
    let options = FitOptions {
        tolerance: None,
        ..options.clone()
    };
    fit_with(name, element, &source, &info, &options, progress)
}

/// The largest band limit that `n` samples along every axis of the period can represent, for the lattice
/// of the options.
/// In cycles per unit of reference length.
///
/// # Errors
/// [`CellError::Unfitting`] for a lattice, group or option of another element, and the errors of an invalid group.
pub fn band_of_samples(element: Element, options: &FitOptions, n: usize) -> Result<f64, CellError> {
    if element == Element::Ball {
        options.check_ball()?;
    }
    let (group, lattice) = (options.group.as_deref(), options.lattice.as_deref());
    Ok(if element.dimension() == 2 {
        largest_band(&super::symmetry::<2>(element, group, lattice)?.1, n)
    } else {
        largest_band(&super::symmetry::<3>(element, group, lattice)?.1, n)
    })
}

/// The multilinear interpolant of periodic samples at u = j/N - 1/2.
/// `u` are lattice coordinates, two or three, anywhere; the last axis of the samples is the fastest.
pub(super) fn multilinear(samples: &[f64], n: usize, u: &[f64]) -> f64 {
    let mut sum = 0.0;
    for corner in 0..1u8 << u.len() {
        let (mut index, mut weight) = (0, 1.0);
        for (a, c) in u.iter().enumerate() {
            let place = (c + 0.5) * n as f64;
            let low = place.floor();
            let up = i64::from(corner >> a & 1);
            let t = place - low;
            weight *= if up == 1 { t } else { 1.0 - t };
            index = index * n + (low as i64 + up).rem_euclid(n as i64) as usize;
        }
        if weight > 0.0 {
            sum += weight * samples[index];
        }
    }
    sum
}

/// [`fit`] with additional information about the source.
/// Without a tolerance it is one fit. With one, each trial measures the distance of the surfaces.
fn fit_with(
    name: &str,
    element: Element,
    source: &Distance,
    info: &SourceInfo,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    options.check(info.period.is_some())?;
    let job = |options: &FitOptions| {
        Job {
            element,
            source,
            info,
            options,
            progress,
        }
        .run(name)
    };
    let Some(tolerance) = options.tolerance else {
        return job(options);
    };
    // With a tolerance the band grows from a low limit until the measured distance is within it.
    let max_band_limit = options.band_limit;
    let mut trial = FitOptions {
        band_limit: INITIAL_BAND_LIMIT.min(max_band_limit),
        measure: true,
        ..options.clone()
    };
    loop {
        let result = job(&trial);
        let distance = match &result {
            Ok(cell) => cell.report().and_then(|r| r.hausdorff).map(Hausdorff::max),
            // With a coarse band the surface may vanish.
            Err(FitError::Cell(CellError::NoSurface { .. })) => None,
            Err(_) => return result,
        };
        if distance.is_some_and(|d| d <= tolerance) {
            return result;
        }
        if trial.band_limit >= max_band_limit {
            let mut cell = result?;
            cell.warn(format!(
                "the surfaces are {} apart at band limit {}, the largest allowed; the tolerance \
                 was {tolerance}",
                distance.map_or_else(|| "an unknown distance".to_owned(), |d| format!("{d:.4}")),
                trial.band_limit
            ));
            return Ok(cell);
        }
        trial.band_limit = (trial.band_limit * BAND_LIMIT_FACTOR).min(max_band_limit);
    }
}
