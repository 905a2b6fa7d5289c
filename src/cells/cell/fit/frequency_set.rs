//! Chooses the frequencies of a fit: those in a ball, or all that samples of the period can represent.
//!
//! A frequency f has D integer indices `k_i`, its components in the basis of the reciprocal lattice. D is 2 for planar
//! elements and 3 for the others, but 6 for icosahedral symmetry, which no lattice in space has: such a function is
//! quasi-periodic, the section of a function with six periods. A group maps a frequency to its images, its orbit.
//!
//! N samples along every lattice vector represent the indices `|k_i| < N/2` (Nyquist). An orbit is represented if all
//! its frequencies are. On skew lattices the group does not map that box of indices onto itself, so a frequency in
//! the box is dropped if an image is outside. A band limit R keeps the ball |f| <= R, in all D dimensions and in cycles
//! per unit of reference length. It must lie in the box.

use super::accuracy::SourceInfo;
use super::{FitError, FitOptions};
use crate::symmetry::{Basis, Lattice, PointGroup};
use druse_geometry::frame::Element;

/// Share of the greatest number of unknowns for which a ball is chosen, since the number in it is only estimated.
const ESTIMATE_MARGIN: f64 = 0.8;
/// Estimated number of unknowns over the greatest number, from which a band limit is refused without a count.
const MAX_ESTIMATE_RATIO: f64 = 2.0;
/// Rounding error of a band limit times the length of a lattice vector, which may be an index.
const INDEX_TOLERANCE: f64 = 1e-9;

/// Greatest band limit, cycles per unit of reference length, that `n` samples along each vector of a lattice represent.
/// The limit that holds for every direction.
pub fn largest_band<const D: usize>(lattice: &Lattice<D>, n: usize) -> f64 {
    let lengths = (0..D).map(|a| lattice.columns().column(a).norm());
    f64::from(index_below_nyquist(n)) / lengths.fold(0.0, f64::max)
}

/// Greatest index that `n` samples per period represent.
/// 0 for one or two samples.
fn index_below_nyquist(n: usize) -> i32 {
    (n.max(1) as i32 - 1) / 2
}

/// Volume of the ball of radius 1 in as many dimensions as lattices have.
fn unit_ball_volume(dimension: usize) -> f64 {
    use std::f64::consts::PI;
    match dimension {
        2 => PI,
        3 => 4.0 / 3.0 * PI,
        6 => PI.powi(3) / 6.0,
        _ => unreachable!("lattices have 2, 3 or 6 dimensions"),
    }
}

/// Number of samples per period that a band limit needs: more than twice its greatest index.
pub(super) fn needed_samples<const D: usize>(lattice: &Lattice<D>, band_limit: f64) -> usize {
    // |k_i| = |f . v_i| <= R |v_i| for the lattice vector v_i.
    let max_index = |a| {
        let bound = band_limit * lattice.columns().column(a).norm();
        (bound + INDEX_TOLERANCE).floor() as usize
    };
    2 * (0..D).map(max_index).max().unwrap_or(0) + 1
}

/// The basis functions for the options, and a warning. An infinite band limit, allowed only for samples over a period,
/// selects every orbit that they represent. If these are more than a fit supports, the basis is a ball that it
/// supports, with a warning.
///
/// # Errors
/// [`FitError::TooLarge`] if the band limit has too many unknowns, [`FitError::TooFewSamples`] if the
/// samples cannot represent it.
pub(super) fn basis<const D: usize>(
    element: Element,
    group: PointGroup<D>,
    lattice: Lattice<D>,
    options: &FitOptions,
    info: &SourceInfo,
) -> Result<(Basis<D>, Option<String>), FitError> {
    let max_unknowns = options.max_unknowns(element);
    // The number of orbits in a ball approximates that of unknowns. There is one frequency in each 1 / volume of
    // frequency space, and most orbits have as many members as the group.
    let unknowns_in_unit_ball = unit_ball_volume(D) * lattice.volume() / group.order() as f64;
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
            let max_index = index_below_nyquist(n);
            let estimate = f64::from(2 * max_index + 1).powi(D as i32) / group.order() as f64;
            if estimate <= max_unknowns as f64 {
                return Ok((Basis::below(group, lattice, max_index), None));
            }
            let radius = (max_unknowns as f64 * ESTIMATE_MARGIN / unknowns_in_unit_ball)
                .powf(1.0 / D as f64);
            band_limit = radius.min(largest_band(&lattice, n));
            warning = Some(format!(
                "{n} samples per period resolve about {estimate:.0} unknowns, more than the limit of {max_unknowns} of \
                 a fit: the fit keeps |f| <= {band_limit:.2}; set band_limit to choose another limit"
            ));
        }
    }
    let too_large = |unknowns: usize| FitError::TooLarge {
        band_limit,
        unknowns,
        limit: max_unknowns,
        largest: band_limit
            * (max_unknowns as f64 * ESTIMATE_MARGIN / unknowns as f64).powf(1.0 / D as f64),
    };
    // The basis of a band limit that is far too large would take too long to list.
    let estimate = unknowns_in_unit_ball * band_limit.powi(D as i32);
    if estimate > MAX_ESTIMATE_RATIO * max_unknowns as f64 {
        return Err(too_large(estimate as usize));
    }
    let basis = Basis::new(group, lattice, band_limit);
    if basis.len() > max_unknowns {
        return Err(too_large(basis.len()));
    }
    Ok((basis, warning))
}
