//! The keys of a fit in `[cell.NAME]`: choices by name. What they do is in the fit itself.

use schemars::JsonSchema;
use serde::Deserialize;

/// The method that computes the coefficients of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum FitMethod {
    /// Weighted least squares over the element only.
    #[default]
    Lsq,
    /// Fourier transform of the source over the whole period, continued by reflection where the
    /// element is not the period.
    Fft,
    /// The mirror extension of the literature on the cubic lattice, for comparison.
    Paper,
}

/// The filter on the spectrum of a fit by Fourier transform.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// No filter: best for distances.
    #[default]
    None,
    /// Lanczos' sigma factors, which damp Gibbs oscillations and round edges.
    Lanczos,
}

/// How the images of a source without the symmetry are combined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Symmetrise {
    /// Their mean, the orthogonal projection.
    #[default]
    Average,
    /// Their union.
    Union,
    /// Their intersection.
    Intersection,
}

/// How the least squares are solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Solver {
    /// Dense up to 3000 unknowns; then over a grid of the period, dense up to 8000 (1 GiB), then
    /// iterative.
    #[default]
    Auto,
    /// Normal equations and Cholesky, up to 4000 unknowns.
    Dense,
    /// Matrix-free: conjugate gradients with two Fourier transforms a step.
    Iterative,
}
