//! Fitting a cell to geometry: weighted least squares over the element only.
//!
//! Minimises (1/V) int w (Phi - g)^2 + lambda sum (1 + |f|^2) a^2 over the real orthonormal
//! coefficients a, where g is the signed distance to the geometry (negative inside) and the mean is
//! taken over the element's interior, plus 0.3 times that over its faces, plus 0.1 times that over its
//! edges (0.03 and 0.01 for face-normal cells). Nothing outside the element is used: this is a Fourier extension, whose normal equations
//! are ill-conditioned and whose regularised solution is accurate all the same. On the lattice
//! spanned by the tet's edges it is continuous from element to element without any reflection.
//!
//! By symmetry only the fundamental simplex is sampled. Geometry that lacks the element's symmetry
//! is averaged over its images, which is the orthogonal projection; the report says how much of its
//! energy survives and how far it was from symmetric.
//!
//! Conventions: lengths and distances in reference units; `band_limit` R keeps |f| <= R, in cycles
//! per unit of reference length; results do not depend on the number of threads.

use super::{Cell, CellError};
use crate::frame::{CellPoint, Element, Mat3};
use crate::progress::Progress;

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

use accuracy::Extra;
use run::Job;

/// A signed distance in the reference frame of an element, negative inside.
pub type Distance<'a> = dyn Fn(CellPoint<3>) -> f64 + Sync + 'a;

/// The first band limit that a tolerance tries, and the factor to the next.
const FIRST_BAND: f64 = 4.0;
const NEXT_BAND: f64 = 1.5;

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
    fit_with(name, element, source, &Extra::default(), options, progress)
}

/// Fits a cell to samples of a signed distance over one whole period of the lattice, by the plain
/// Fourier transform: exact where the samples are symmetric and of a band below half their number.
///
/// The samples stand at u = j/N - 1/2 in lattice coordinates, the last axis fastest. An infinite band
/// limit keeps every orbit all of whose members k have `|k_i| < N/2` on each axis, which is what N samples
/// tell apart; on skew lattices an orbit with a member beyond is dropped as a whole. A finite one
/// keeps the ball |f| <= R of these, [`largest_band`] at most. `method` and `samples` of the options are
/// not used. The report's differences are those to the samples' trilinear interpolant.
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
    fit_period(name, element, (samples, n), &options, progress)
}

/// The least squares of samples over one whole period, [`fit_samples`] but for its name in the report and
/// the penalty if the options have one: over the period the waves are orthogonal.
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
    fit_period(name, element, (samples, n), &options, progress)
}

/// The fit of `n` samples an axis over a period, by the method of the options.
fn fit_period(
    name: &str,
    element: Element,
    (samples, n): (&[f64], usize),
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
        interpolated(samples, n, &u[..dimension])
    };
    let extra = Extra {
        period: Some((samples, n)),
        ..Extra::default()
    };
    let options = FitOptions {
        tolerance: None,
        ..options.clone()
    };
    fit_with(name, element, &source, &extra, &options, progress)
}

/// The greatest band limit that `n` samples along every axis of the period carry, for the lattice
/// that the options name.
///
/// # Errors
/// [`CellError::Unfitting`] for a lattice or group of another element.
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
pub(super) fn interpolated(samples: &[f64], n: usize, u: &[f64]) -> f64 {
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

/// [`fit`], with what is known about the source beside its distance.
fn fit_with(
    name: &str,
    element: Element,
    source: &Distance,
    extra: &Extra,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    options.check(extra.period.is_some())?;
    let job = |options: &FitOptions| {
        Job {
            element,
            source,
            extra,
            options,
            progress,
        }
        .run(name)
    };
    let Some(tolerance) = options.tolerance else {
        return job(options);
    };
    let greatest = options.band_limit;
    let mut own = FitOptions {
        band_limit: FIRST_BAND.min(greatest),
        measure: true,
        ..options.clone()
    };
    loop {
        let tried = job(&own);
        let distance = match &tried {
            Ok(cell) => cell.report().and_then(|r| r.hausdorff).map(Hausdorff::max),
            // A coarse band may lose the whole surface.
            Err(FitError::Cell(CellError::NoSurface { .. })) => None,
            Err(_) => return tried,
        };
        if distance.is_some_and(|d| d <= tolerance) {
            return tried;
        }
        if own.band_limit >= greatest {
            let mut cell = tried?;
            cell.warn(format!(
                "the surfaces are {} apart at band limit {}, the greatest allowed; the tolerance \
                 was {tolerance}",
                distance.map_or_else(|| "not measurably".to_owned(), |d| format!("{d:.4}")),
                own.band_limit
            ));
            return Ok(cell);
        }
        own.band_limit = (own.band_limit * NEXT_BAND).min(greatest);
    }
}
