//! Errors of level sets and of their files.
//!
//! [`VdbError`] is of operations in memory, [`FileError`] of reading and writing, with the file's path and messages of
//! OpenVDB on one line. Cancellation is a variant of both.

use super::Session;
use crate::band::StoreError;
use crate::frame::Coord;
use crate::progress::Cancelled;
use std::io;
use std::path::{Path, PathBuf};

/// Greatest number of elements of a voxel mesh.
pub const MAX_CUBES: u64 = 1 << 28;

/// Why an operation on a level set failed. After a failure of OpenVDB or cancellation the level set is empty, or as
/// before the step that failed; after a refused parameter it is unchanged.
#[derive(Debug, thiserror::Error)]
pub enum VdbError {
    /// The user cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A parameter is out of range.
    #[error("{name} is {value}; expected {expected}")]
    Parameter {
        /// Its name.
        name: &'static str,
        /// The given value.
        value: f64,
        /// The accepted values.
        expected: &'static str,
    },
    /// A leaf holds a value beyond the narrow band.
    #[error("voxel {voxel:?} holds {value}; expected a number within the band of {background}", voxel = .voxel.0)]
    Value {
        /// The voxel.
        voxel: Coord,
        /// Its value, world units.
        value: f32,
        /// Half width of the band, world units.
        background: f32,
    },
    /// Two level sets have different voxels or half widths.
    #[error("the operands differ in {what}: {left} and {right}")]
    Mismatch {
        /// The property that differs.
        what: &'static str,
        /// Its value in the level set.
        left: f64,
        /// Its value in the operand.
        right: f64,
    },
    /// A mesh has too many vertices, or is invalid.
    #[error(transparent)]
    Mesh(#[from] crate::mesh::MeshError),
    /// A part of a level set has no mesh.
    #[error(transparent)]
    Mesher(crate::mesher::MesherError),
    /// A field could not be sampled.
    #[error(transparent)]
    Band(crate::band::BandError),
    /// The surface that values bound is not closed.
    #[error(
        "the surface is open: the grid's values end before it does; expected values on both sides of the whole surface"
    )]
    Open,
    /// A voxel mesh with too many elements.
    #[error(
        "the voxel mesh would have {0} elements or more; expected at most {max}: give a larger element_size",
        max = super::error::MAX_CUBES
    )]
    TooManyCubes(u64),
    /// OpenVDB refused.
    #[error("OpenVDB failed in {operation}: {reason}")]
    OpenVdb {
        /// The operation.
        operation: &'static str,
        /// The message of OpenVDB.
        reason: String,
    },
}

impl From<crate::mesher::MesherError> for VdbError {
    fn from(error: crate::mesher::MesherError) -> Self {
        match error {
            crate::mesher::MesherError::Cancelled(c) => Self::Cancelled(c),
            crate::mesher::MesherError::Mesh(e) => Self::Mesh(e),
            error => Self::Mesher(error),
        }
    }
}

impl From<crate::band::BandError> for VdbError {
    fn from(error: crate::band::BandError) -> Self {
        match error {
            crate::band::BandError::Cancelled(c) => Self::Cancelled(c),
            error => Self::Band(error),
        }
    }
}

impl VdbError {
    /// The error for an exception of OpenVDB during an operation.
    pub(super) fn of(
        operation: &'static str,
        session: Session<'_>,
        error: &cxx::Exception,
    ) -> Self {
        if session.progress.cancelled() || error.what() == "interrupted" {
            return Self::Cancelled(Cancelled);
        }
        Self::plain(operation, error)
    }

    /// The error for a failed band evaluation during an operation.
    pub(super) fn band(operation: &'static str, error: crate::band::BandError) -> Self {
        match error {
            crate::band::BandError::Cancelled(c) => Self::Cancelled(c),
            error => Self::OpenVdb {
                operation,
                reason: error.to_string(),
            },
        }
    }

    /// The error for an exception during an operation that cannot be cancelled.
    pub(super) fn plain(operation: &'static str, error: &cxx::Exception) -> Self {
        Self::OpenVdb {
            operation,
            reason: error.what().to_owned(),
        }
    }
}

/// Why a `.vdb` file could not be read or written. Every variant names the file.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The user cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The system failed: missing file, full disk.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file is not a `.vdb` file, or damaged.
    #[error("{}: {reason}; expected a complete OpenVDB file of format 224 or older", .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was found.
        reason: String,
    },
    /// The file has no such grid.
    #[error("{}: no grid {requested:?}; it holds {}", .path.display(), listed(.present))]
    NoGrid {
        /// The file.
        path: PathBuf,
        /// The requested name.
        requested: String,
        /// Grids of the file, as "name (type, class)".
        present: Vec<String>,
    },
    /// The grid is not a narrow-band level set of floats with cubic voxels and cannot be converted as requested.
    #[error("{}: grid {grid:?} has {found}; expected {expected}", .path.display())]
    NotALevelSet {
        /// The file.
        path: PathBuf,
        /// The grid.
        grid: String,
        /// What was found.
        found: String,
        /// What is expected.
        expected: String,
        /// The remedy.
        hint: String,
    },
    /// A name or key is not allowed in a file.
    #[error("{}: the {what} {name:?} {problem}", .path.display())]
    Name {
        /// The file.
        path: PathBuf,
        /// The kind of name.
        what: &'static str,
        /// The name.
        name: String,
        /// The reason.
        problem: &'static str,
    },
    /// Leaf files cannot be read.
    #[error(transparent)]
    Leaves(StoreError),
    /// OpenVDB failed.
    #[error("{}: OpenVDB failed: {reason}", .path.display())]
    OpenVdb {
        /// The file.
        path: PathBuf,
        /// The message of OpenVDB.
        reason: String,
    },
}

impl From<StoreError> for FileError {
    fn from(e: StoreError) -> Self {
        match e {
            StoreError::Cancelled(c) => Self::Cancelled(c),
            e => Self::Leaves(e),
        }
    }
}

/// The names of the grids of a file, for a message.
fn listed(present: &[String]) -> String {
    if present.is_empty() {
        "no grids".to_owned()
    } else {
        present.join(", ")
    }
}

impl FileError {
    /// The error for an exception while reading `path`.
    pub(super) fn damaged(path: &Path, error: &cxx::Exception) -> Self {
        Self::Damaged {
            path: path.to_owned(),
            reason: reason(error),
        }
    }

    /// The error for an I/O error on `path`.
    pub(super) fn io(path: &Path, source: io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }
}

impl FileError {
    /// A remedy, if there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::NotALevelSet { hint, .. } => Some(hint.clone()).filter(|h| !h.is_empty()),
            Self::NoGrid { present, .. } if !present.is_empty() => Some(
                "--grid NAME chooses one of them; in a recipe grid = \"NAME\" beside the path"
                    .into(),
            ),
            _ => None,
        }
    }
}

/// Greatest length of a message of OpenVDB, characters: it may quote the contents of a damaged file.
const MAX_REASON_CHARS: usize = 200;

/// The message of OpenVDB or NanoVDB without the class of the exception, on one line and of bounded length. Control
/// characters are escaped.
pub(super) fn reason(error: &cxx::Exception) -> String {
    let what = error.what();
    let words = match what.split_once(": ") {
        Some((class, words)) if class.ends_with("Error") && !class.contains(' ') => words,
        Some((class, words)) if class.ends_with(" error") => words,
        _ => what,
    };
    let shown = words
        .trim_end_matches('.')
        .chars()
        .take(MAX_REASON_CHARS)
        .flat_map(char::escape_debug);
    let cut = if words.chars().nth(MAX_REASON_CHARS).is_some() {
        "..."
    } else {
        ""
    };
    shown.chain(cut.chars()).collect()
}
