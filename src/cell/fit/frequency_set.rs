//! The frequencies of a fit: a ball, or all that samples of the period can represent.
//!
//! N samples along every lattice vector represent the indices `|k_i| < N/2`. An orbit is below Nyquist if all
//! its members lie in that box. On skew lattices the group does not map the box onto itself, so a frequency
//! in the box is dropped if an image is outside. On square and cubic lattices the box is invariant. A band
//! limit R keeps the ball |f| <= R, which must lie in the box.

use super::accuracy::SourceInfo;
use super::{FitError, FitOptions};
use crate::frame::Element;
use crate::symmetry::{Basis, Lattice, PointGroup};

/// Share of the maximal number of unknowns to which a ball of estimated size is reduced.
const ESTIMATED_SHARE: f64 = 0.8;

/// Largest band limit that N samples per period can represent.
pub fn largest_band<const D: usize>(lattice: &Lattice<D>, n: usize) -> f64 {
    let longest = (0..D).map(|a| lattice.columns().column(a).norm());
    f64::from(max_index(n)) / longest.fold(0.0, f64::max)
}

/// Largest index below the Nyquist index of `n` samples.
fn max_index(n: usize) -> i32 {
    (n.max(1) as i32 - 1) / 2
}

/// Volume of the ball of radius 1 in 2, 3 or 6 dimensions.
fn unit_ball(dimension: usize) -> f64 {
    use std::f64::consts::PI;
    match dimension {
        2 => PI,
        3 => 4.0 / 3.0 * PI,
        _ => PI.powi(3) / 6.0,
    }
}

/// Number of samples per period that a band limit needs: more than twice its largest index.
pub(super) fn needed_samples<const D: usize>(lattice: &Lattice<D>, band_limit: f64) -> usize {
    let reach = |a| (band_limit * lattice.columns().column(a).norm() + 1e-9).floor() as usize;
    2 * (0..D).map(reach).max().unwrap_or(0) + 1
}

/// The basis for the options. An infinite band limit, allowed only for samples over a period, selects every
/// orbit below the Nyquist index. If these are more than a fit supports, the basis is the largest supported
/// ball, with a warning.
///
/// # Errors
/// [`FitError::TooLarge`] if the band limit has too many unknowns, [`FitError::TooFewSamples`] if the
/// samples cannot represent it.
pub(super) fn basis<const D: usize>(
    element: Element,
    (group, lattice): (PointGroup<D>, Lattice<D>),
    options: &FitOptions,
    info: &SourceInfo,
) -> Result<(Basis<D>, Option<String>), FitError> {
    let limit = options.max_unknowns(element);
    // The number of orbits in a ball of radius 1 approximates the number of unknowns.
    let density = unit_ball(D) * lattice.volume() / group.order() as f64;
    let mut band_limit = options.band_limit;
    let mut warning = None;
    if let Some((_, n)) = info.period {
        let needed = if band_limit.is_finite() {
            needed_samples(&lattice, band_limit)
        } else {
            0
        };
        if n < needed {
            return Err(FitError::TooFewSamples {
                samples: n,
                band_limit,
                needed,
                largest: largest_band(&lattice, n),
            });
        }
        if !band_limit.is_finite() {
            let h = max_index(n);
            let estimate = f64::from(2 * h + 1).powi(D as i32) / group.order() as f64;
            if estimate <= limit as f64 {
                return Ok((Basis::below(group, lattice, h), None));
            }
            let ball = (limit as f64 * ESTIMATED_SHARE / density).powf(1.0 / D as f64);
            band_limit = ball.min(largest_band(&lattice, n));
            warning = Some(format!(
                "{n} samples per period resolve about {estimate:.0} unknowns, more than the limit of {limit} of \
                 a fit: the fit keeps |f| <= {band_limit:.2}; set band_limit to choose another limit"
            ));
        }
    }
    let too_large = |unknowns: usize| FitError::TooLarge {
        band_limit,
        unknowns,
        limit,
        largest: band_limit
            * (limit as f64 * ESTIMATED_SHARE / unknowns as f64).powf(1.0 / D as f64),
    };
    let estimate = density * band_limit.powi(D as i32);
    if estimate > 2.0 * limit as f64 {
        return Err(too_large(estimate as usize));
    }
    let basis = Basis::new(group, lattice, band_limit);
    if basis.len() > limit {
        return Err(too_large(basis.len()));
    }
    Ok((basis, warning))
}
