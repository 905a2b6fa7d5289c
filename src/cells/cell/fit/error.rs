//! Defines why the Fourier series of a cell cannot be fitted to a source, or why cells cannot be combined, with the
//! messages that users see.
//!
//! A fit determines the series whose values in an element are nearest to the signed distance to the source (a mesh,
//! struts, plates, voxels). Its unknowns are the real coefficients of the frequencies f with |f| <= R, where R is the
//! *band limit*, in cycles per unit of reference length.

use super::iterative::RESIDUAL_TOLERANCE;
use crate::cell::{CellError, SkeletonError, VoxelError};
use druse_geometry::progress::Cancelled;

/// Why geometry cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// An error of the cell itself.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The fit was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A signed distance to the source that is not finite.
    #[error(
        "the source's distance at ({x}, {y}, {z}) in the {element} is {value}; expected a finite number"
    )]
    NotFinite {
        /// Reference coordinate of the point.
        x: f64,
        /// Reference coordinate of the point.
        y: f64,
        /// Reference coordinate of the point.
        z: f64,
        /// Name of the element, such as "hex".
        element: &'static str,
        /// The distance found there, or the mean of its squares over the images: NaN or infinite.
        value: f64,
    },
    /// A source that leaves the element without solid, or without void.
    #[error(
        "nothing {missing} inside the {element}: the distance to the source runs from {least:.6} to \
         {greatest:.6} there{hint}"
    )]
    NoSurface {
        /// The phase that is missing: "solid" or "void".
        missing: &'static str,
        /// Name of the element.
        element: &'static str,
        /// Least sampled distance, reference lengths, negative inside.
        least: f64,
        /// Greatest sampled distance, reference lengths.
        greatest: f64,
        /// A clause with the position of the source, if it is known, else empty.
        hint: String,
    },
    /// A source whose average over its images under the symmetry group is almost zero.
    #[error(
        "the source has no part with the symmetry {group}: {kept:e} of its energy survives the \
         average over its images; choose another origin or placement"
    )]
    NoSymmetricPart {
        /// Name of the group.
        group: String,
        /// Mean square of the average over that of the source.
        kept: f64,
    },
    /// A band limit with more unknowns than the solver supports.
    #[error(
        "band limit {band_limit} has {unknowns} unknowns; expected at most {limit}, that is a band \
         limit below {largest:.1}"
    )]
    TooLarge {
        /// The band limit R, cycles per unit of reference length.
        band_limit: f64,
        /// Number of unknowns at this band limit, estimated if it is far too large.
        unknowns: usize,
        /// Greatest number of unknowns of the solver.
        limit: usize,
        /// An estimate of the greatest possible band limit.
        largest: f64,
    },
    /// Normal equations that are singular.
    #[error(
        "the least squares with {unknowns} unknowns are singular; expected a regularisation above {least:e}, found {found:e}"
    )]
    Singular {
        /// Number of unknowns.
        unknowns: usize,
        /// A regularisation above which the equations are regular.
        least: f64,
        /// The regularisation of the options: the weight of the penalty (1 + |f|^2) on squared coefficients.
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
         {tolerance:e}: raise the regularisation or choose the dense solver",
        tolerance = RESIDUAL_TOLERANCE
    )]
    NotConverged {
        /// Number of steps made.
        steps: usize,
        /// Norm of the residual over that of the right-hand side.
        residual: f64,
    },
    /// Samples over a period that are too few for the band limit: more than two per cycle are needed (Nyquist).
    #[error(
        "{samples} samples per period do not carry band limit {band_limit}; expected at least \
         {needed} samples, a band limit of at most {largest:.2}, or none, which keeps all that lies below \
         Nyquist on each axis"
    )]
    TooFewSamples {
        /// Number of samples per period along each axis.
        samples: usize,
        /// The band limit R, cycles per unit of reference length.
        band_limit: f64,
        /// Least sufficient number of samples per period.
        needed: usize,
        /// Greatest band limit of these samples.
        largest: f64,
    },
    /// A method that needs the source over a whole period, in an element from which it has no continuation.
    #[error(
        "method {method} has no way to continue the source of a {element} over the period of \
         lattice {lattice}; use method lsq"
    )]
    NoExtension {
        /// Name of the element.
        element: &'static str,
        /// Name of the lattice of periods, or "any".
        lattice: String,
        /// Name of the method.
        method: &'static str,
    },
    /// Cells of two different elements.
    #[error("a {first} cell and a {second} cell cannot be combined; expected one element")]
    Elements {
        /// Name of the first cell's element.
        first: &'static str,
        /// Name of the second cell's element.
        second: &'static str,
    },
    /// A Minkowski sum that has no void, or a Minkowski difference that has no solid.
    #[error("the Minkowski {operation} has no {missing}; expected a smaller second cell")]
    NothingLeft {
        /// "sum" or "difference".
        operation: &'static str,
        /// The phase that is missing: "solid" or "void".
        missing: &'static str,
    },
    /// An invalid placement of the source in the element.
    #[error("placement: {0}")]
    Placement(String),
}
