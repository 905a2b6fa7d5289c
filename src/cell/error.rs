//! Why a cell cannot be made, or a question about it has no answer.

use crate::symmetry::{GroupTextError, SymmetryError};

/// Why a cell cannot be made, or a question about it has no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CellError {
    /// The group, the lattice or an operator is wrong in itself.
    #[error(transparent)]
    Symmetry(#[from] SymmetryError),
    /// Generators that are no group.
    #[error("group: {0}")]
    GroupText(#[from] GroupTextError),
    /// A coefficient that cannot stand in a series.
    #[error("coefficient {place} (k = {index}): {reason}")]
    Coefficient {
        /// Its place in the list, from 0.
        place: usize,
        /// Its index.
        index: String,
        /// What is wrong.
        reason: String,
    },
    /// A group or lattice that does not go with the element.
    #[error("a {element} cell cannot have {what} {found:?}; expected {expected}")]
    Unfitting {
        /// The element.
        element: &'static str,
        /// "group" or "lattice".
        what: &'static str,
        /// What was given.
        found: String,
        /// What goes with the element.
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
    /// A surface that has no form with the symmetry of the element.
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
        /// What happens to it under the group.
        reason: &'static str,
    },
    /// A field of one sign: no surface in the element.
    #[error(
        "nothing {missing} inside the {element}: the field runs from {least} to {greatest} there, \
         which does not contain the level {level}"
    )]
    NoSurface {
        /// "solid" or "void".
        missing: &'static str,
        /// The element.
        element: &'static str,
        /// Least value sampled.
        least: f64,
        /// Greatest value sampled.
        greatest: f64,
        /// The level.
        level: f64,
    },
    /// A cell that has no table.
    #[error("no table for this cell: {reason}")]
    NoTable {
        /// What it would take.
        reason: String,
    },
    /// Functions that make no expression together.
    #[error("expression: {0}")]
    Expression(String),
    /// A band that no table can hold.
    #[error(
        "the cell's largest index is {index} per period, which needs a table of more than {limit} \
         samples per axis"
    )]
    TableTooLarge {
        /// Largest index on the cubic period.
        index: i32,
        /// Greatest number of samples per axis.
        limit: usize,
    },
}
