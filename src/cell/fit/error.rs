//! Errors of fits.

use crate::cell::{CellError, SkeletonError, VoxelError};
use crate::progress::Cancelled;

/// Why geometry cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// An error of the cell itself.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The fit was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A value of the source that is not finite.
    #[error("the source's distance at ({x}, {y}, {z}) in the {element} is {value}")]
    NotFinite {
        /// Reference coordinates.
        x: f64,
        /// Reference coordinates.
        y: f64,
        /// Reference coordinates.
        z: f64,
        /// The element.
        element: &'static str,
        /// The value.
        value: f64,
    },
    /// No solid, or no void, in the element.
    #[error(
        "nothing {missing} inside the {element}: the distance to the source runs from {least:.6} to \
         {greatest:.6} there{hint}"
    )]
    NoSurface {
        /// "solid" or "void".
        missing: &'static str,
        /// The element.
        element: &'static str,
        /// Smallest sampled distance.
        least: f64,
        /// Largest sampled distance.
        greatest: f64,
        /// The position of the source, if it is known.
        hint: String,
    },
    /// A source without a symmetric part.
    #[error(
        "the source has no part with the symmetry {group}: {kept:e} of its energy survives the \
         average over its images; choose another origin or placement"
    )]
    NoSymmetricPart {
        /// The group.
        group: String,
        /// Share of the mean square that the symmetric part has.
        kept: f64,
    },
    /// More unknowns than the solver supports.
    #[error(
        "band limit {band_limit} has {unknowns} unknowns; expected at most {limit}, that is a band \
         limit below {largest:.1}"
    )]
    TooLarge {
        /// The band limit R.
        band_limit: f64,
        /// Degrees of freedom.
        unknowns: usize,
        /// Maximal number of unknowns.
        limit: usize,
        /// A possible band limit.
        largest: f64,
    },
    /// Singular normal equations.
    #[error(
        "the least squares with {unknowns} unknowns are singular; expected a regularisation above {least:e}, found {found:e}"
    )]
    Singular {
        /// Degrees of freedom.
        unknowns: usize,
        /// A sufficient regularisation.
        least: f64,
        /// The regularisation of the options.
        found: f64,
    },
    /// A mesh that does not bound a solid.
    #[error("mesh: {0}")]
    Mesh(String),
    /// Invalid struts or plates.
    #[error(transparent)]
    Skeleton(#[from] SkeletonError),
    /// Invalid voxels.
    #[error(transparent)]
    Voxels(#[from] VoxelError),
    /// Conjugate gradients that do not converge.
    #[error(
        "the iterative least squares left a residual of {residual:e} after {steps} steps; expected \
         1e-8: raise the regularisation or choose the dense solver"
    )]
    NotConverged {
        /// Number of steps.
        steps: usize,
        /// Residual relative to the right-hand side.
        residual: f64,
    },
    /// Fewer samples than the band limit requires.
    #[error(
        "{samples} samples per period do not carry band limit {band_limit}; expected at least \
         {needed} samples, a band limit of at most {largest:.2}, or none, which keeps all that lies below \
         Nyquist on each axis"
    )]
    TooFewSamples {
        /// Samples per axis.
        samples: usize,
        /// The band limit R.
        band_limit: f64,
        /// Sufficient number of samples per axis.
        needed: usize,
        /// Largest band limit of these samples.
        largest: f64,
    },
    /// An element whose source has no continuation over the period.
    #[error(
        "method {method} has no way to continue the source of a {element} over the period of \
         lattice {lattice}; use method lsq"
    )]
    NoExtension {
        /// The element.
        element: &'static str,
        /// The lattice.
        lattice: String,
        /// The method.
        method: &'static str,
    },
    /// Cells of two different elements.
    #[error("a {first} cell and a {second} cell cannot be combined; expected one element")]
    Elements {
        /// Element of the first.
        first: &'static str,
        /// Element of the second.
        second: &'static str,
    },
    /// A Minkowski sum without void, or a difference without solid.
    #[error("the Minkowski {operation} has no {missing}; expected a smaller second cell")]
    NothingLeft {
        /// "sum" or "difference".
        operation: &'static str,
        /// "solid" or "void".
        missing: &'static str,
    },
    /// An invalid placement.
    #[error("placement: {0}")]
    Placement(String),
}
