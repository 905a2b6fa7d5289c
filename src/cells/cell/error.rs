//! Errors of making and evaluating cells.
//!
//! Numbers are in the units of the parameter: lengths are reference lengths, levels are values of the function.
//! `FitError` has the further errors of fits.

use crate::symmetry::{GroupTextError, SymmetryError};

/// Why a cell cannot be made, or why a property of it does not exist.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CellError {
    /// An invalid group, lattice or operator.
    #[error(transparent)]
    Symmetry(#[from] SymmetryError),
    /// Generators that do not form a group.
    #[error("group: {0}")]
    GroupText(#[from] GroupTextError),
    /// An invalid coefficient of a series.
    #[error("coefficient {place} (k = {index}): {reason}")]
    Coefficient {
        /// Its position in the list, from 0.
        place: usize,
        /// Its index.
        index: String,
        /// What is wrong.
        reason: String,
    },
    /// A group, a lattice or an option of a fit that is not compatible with the element.
    #[error("a {element} cell cannot have {what} {found:?}; expected {expected}")]
    Unfitting {
        /// The element.
        element: &'static str,
        /// "dimension", "group", "lattice" or the option.
        what: &'static str,
        /// What was given.
        found: String,
        /// What is compatible with the element.
        expected: String,
    },
    /// A number that is out of its range.
    #[error("{what} is {found}; expected {expected}")]
    OutOfRange {
        /// The parameter.
        what: &'static str,
        /// What was given.
        found: f64,
        /// Its range.
        expected: String,
    },
    /// A surface without a form that has the symmetry of the element.
    #[error(
        "surface {surface} has no form with group {group}, as a {element} cell needs: {reason}"
    )]
    NoSuchForm {
        /// The surface.
        surface: &'static str,
        /// The element.
        element: &'static str,
        /// The element's group.
        group: &'static str,
        /// How the group changes the surface.
        reason: &'static str,
    },
    /// A field of one sign, without a surface in the element.
    #[error(
        "nothing {missing} inside the {element}: the field runs from {least} to {greatest} there, \
         which does not contain the level {level}"
    )]
    NoSurface {
        /// "solid" or "void".
        missing: &'static str,
        /// The element.
        element: &'static str,
        /// The smallest sampled value.
        least: f64,
        /// The largest sampled value.
        greatest: f64,
        /// The level.
        level: f64,
    },
    /// A cell that cannot be tabulated.
    #[error("no table for this cell: {reason}")]
    NoTable {
        /// The reason.
        reason: String,
    },
    /// An invalid combination of functions.
    #[error("expression: {0}")]
    Expression(String),
    /// A band limit that exceeds the largest table.
    #[error(
        "the cell's largest index is {index} per period, which needs a table of more than {limit} \
         samples per axis"
    )]
    TableTooLarge {
        /// Largest index per cubic period.
        index: i32,
        /// Maximal number of samples per axis.
        limit: usize,
    },
}
