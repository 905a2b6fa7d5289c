//! Options of a fit from the keys of `[cell.NAME]`. Keys that a section leaves out take the default of the fit.

use crate::cell::{Filter, FitOptions, Method, Solver, Symmetrise};
use crate::recipe;
use crate::recipe::{CellSection, FitMethod};

/// Greatest band limit that a fit to a tolerance tries when the section names none.
const MAX_TOLERANCE_BAND_LIMIT: f64 = 24.0;

/// The fit options of a section of a recipe or of the command line.
pub fn fit_options(section: &CellSection) -> FitOptions {
    let default = FitOptions::default();
    // With a tolerance the fit chooses the band limit, up to a greater bound.
    let band_limit = if section.tolerance.is_some() {
        MAX_TOLERANCE_BAND_LIMIT
    } else {
        default.band_limit
    };
    FitOptions {
        method: match section.method.unwrap_or_default() {
            FitMethod::Lsq => Method::Lsq,
            FitMethod::Fft => Method::Fft,
            FitMethod::Paper => Method::Paper,
        },
        group: section.group.clone(),
        lattice: section.lattice.clone(),
        filter: match section.filter.unwrap_or_default() {
            recipe::Filter::None => Filter::None,
            recipe::Filter::Lanczos => Filter::Lanczos,
        },
        band_limit: section.band_limit.map_or(band_limit, |r| r.0),
        regularisation: section.regularisation.map(|r| r.0),
        samples: section.samples.map_or(default.samples, |n| n as usize),
        solver: match section.solver.unwrap_or_default() {
            recipe::Solver::Auto => Solver::Auto,
            recipe::Solver::Dense => Solver::Dense,
            recipe::Solver::Iterative => Solver::Iterative,
        },
        keep: section.keep.map(|m| m as usize),
        face_normal: section.face_normal.unwrap_or(default.face_normal),
        tolerance: section.tolerance.map(|t| t.0),
        symmetrise: match section.symmetrise.unwrap_or_default() {
            recipe::Symmetrise::Average => Symmetrise::Average,
            recipe::Symmetrise::Union => Symmetrise::Union,
            recipe::Symmetrise::Intersection => Symmetrise::Intersection,
        },
        ..default
    }
}
