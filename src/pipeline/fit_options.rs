//! From the words of `[cell.NAME]` to the options of a fit.

use crate::cell::{Filter, FitOptions, Method, Solver, Symmetrise};
use crate::recipe::{self, CellSection, FitMethod};

/// The greatest band limit that a tolerance tries when the section names none.
const BAND_FOR_TOLERANCE: f64 = 24.0;

/// The options of a fit that a section (of a recipe or of a command line) asks for.
pub fn fit_options(section: &CellSection) -> FitOptions {
    let default = FitOptions::default();
    let band_limit = if section.tolerance.is_some() {
        BAND_FOR_TOLERANCE
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
