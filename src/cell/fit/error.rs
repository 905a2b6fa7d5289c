//! Why geometry cannot be fitted.

use crate::cell::{CellError, SkeletonError, VoxelError};
use crate::progress::Cancelled;

/// Why geometry cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// The cell itself is wrong.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The user asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The source gives something that is no distance.
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
        /// What the source gave.
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
        /// Least distance sampled.
        least: f64,
        /// Greatest distance sampled.
        greatest: f64,
        /// Where the source stands, if that is known.
        hint: String,
    },
    /// Nothing of the surface is symmetric.
    #[error(
        "the source has no part with the symmetry {group}: {kept:e} of its energy survives the \
         average over its images; choose another origin or placement"
    )]
    NoSymmetricPart {
        /// The group.
        group: String,
        /// Share of the mean square that is left.
        kept: f64,
    },
    /// More unknowns than the dense solver takes.
    #[error(
        "band limit {band_limit} has {unknowns} unknowns; expected at most {limit}, that is a band \
         limit below {largest:.1}"
    )]
    TooLarge {
        /// R.
        band_limit: f64,
        /// Degrees of freedom.
        unknowns: usize,
        /// Greatest number of them.
        limit: usize,
        /// A band limit that is possible.
        largest: f64,
    },
    /// The normal equations cannot be solved.
    #[error(
        "the least squares with {unknowns} unknowns are singular; expected a regularisation above {least:e}, found {found:e}"
    )]
    Singular {
        /// Degrees of freedom.
        unknowns: usize,
        /// What would do.
        least: f64,
        /// What was given.
        found: f64,
    },
    /// A mesh that bounds no solid.
    #[error("mesh: {0}")]
    Mesh(String),
    /// Struts or plates that cannot be.
    #[error(transparent)]
    Skeleton(#[from] SkeletonError),
    /// Voxels that cannot be.
    #[error(transparent)]
    Voxels(#[from] VoxelError),
    /// The conjugate gradients did not arrive.
    #[error(
        "the iterative least squares left a residual of {residual:e} after {steps} steps; expected \
         1e-8: raise the regularisation or choose the dense solver"
    )]
    NotConverged {
        /// Steps taken.
        steps: usize,
        /// Share of the right-hand side that is left.
        residual: f64,
    },
    /// A transform of fewer samples than the band asks for.
    #[error(
        "{samples} samples per period do not carry band limit {band_limit}; expected at least \
         {needed} samples, a band limit of at most {largest:.2}, or none, which keeps all that lies below \
         Nyquist on each axis"
    )]
    TooFewSamples {
        /// Samples per axis.
        samples: usize,
        /// R.
        band_limit: f64,
        /// Samples per axis that would do.
        needed: usize,
        /// Band limit that would do.
        largest: f64,
    },
    /// An element whose source cannot be continued over the period.
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
    /// Two cells that do not fill the same element.
    #[error("a {first} cell and a {second} cell cannot be put together; expected one element")]
    Elements {
        /// Element of the first.
        first: &'static str,
        /// Element of the second.
        second: &'static str,
    },
    /// A sum that fills everything, a difference that leaves nothing.
    #[error("the Minkowski {operation} has no {missing}; expected a smaller second cell")]
    NothingLeft {
        /// "sum" or "difference".
        operation: &'static str,
        /// "solid" or "void".
        missing: &'static str,
    },
    /// A placement that is no map.
    #[error("placement: {0}")]
    Placement(String),
}
