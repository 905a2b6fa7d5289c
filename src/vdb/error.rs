//! What can go wrong with a level set, and with a file of them.

use super::Session;
use crate::band::StoreError;
use crate::frame::Coord;
use crate::progress::Cancelled;
use std::io;
use std::path::{Path, PathBuf};

/// Why an operation on a level set was refused or failed. The level set it would have changed is
/// empty afterwards when OpenVDB failed or the user stopped it, untouched when a parameter was refused.
#[derive(Debug, thiserror::Error)]
pub enum VdbError {
    /// The user asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A parameter is out of range.
    #[error("{name} is {value}; expected {expected}")]
    Parameter {
        /// Its name.
        name: &'static str,
        /// What was given.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// A leaf holds a value that no narrow band has.
    #[error("voxel {voxel:?} holds {value}; expected a number within the band of {background}", voxel = .voxel.0)]
    Value {
        /// Which voxel.
        voxel: Coord,
        /// Its value, world units.
        value: f32,
        /// Half width of the band, world units.
        background: f32,
    },
    /// Two level sets do not share their voxels.
    #[error("the operands differ in {what}: {left} and {right}")]
    Mismatch {
        /// In what.
        what: &'static str,
        /// Of the level set that was to change.
        left: f64,
        /// Of the operand.
        right: f64,
    },
    /// A mesh is too large to be numbered, or cannot be a mesh.
    #[error(transparent)]
    Mesh(#[from] crate::mesh::MeshError),
    /// A part of a level set has no mesh.
    #[error(transparent)]
    Mesher(crate::mesher::MesherError),
    /// The surface that values bound is not closed.
    #[error(
        "the surface is open: the grid's values end where it goes on; expected values on both sides of all of it"
    )]
    Open,
    /// A voxel mesh with too many elements.
    #[error(
        "the voxel mesh would have {0} elements or more; expected at most {max}: give a larger element_size",
        max = super::MAX_CUBES
    )]
    TooManyCubes(u64),
    /// OpenVDB refused.
    #[error("OpenVDB failed in {doing}: {reason}")]
    OpenVdb {
        /// In which operation.
        doing: &'static str,
        /// Its own words.
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

impl VdbError {
    /// An exception that came out of OpenVDB while `doing` something.
    pub(super) fn of(doing: &'static str, session: Session<'_>, error: &cxx::Exception) -> Self {
        if session.progress.cancelled() || error.what() == "interrupted" {
            return Self::Cancelled(Cancelled);
        }
        Self::plain(doing, error)
    }

    /// A field that could not be sampled while `doing` something.
    pub(super) fn band(doing: &'static str, error: crate::band::BandError) -> Self {
        match error {
            crate::band::BandError::Cancelled(c) => Self::Cancelled(c),
            error => Self::OpenVdb {
                doing,
                reason: error.to_string(),
            },
        }
    }

    /// The same where nothing can be cancelled.
    pub(super) fn plain(doing: &'static str, error: &cxx::Exception) -> Self {
        Self::OpenVdb {
            doing,
            reason: error.what().to_owned(),
        }
    }
}

/// Why a `.vdb` file could not be read or written. Every variant names the file.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The user asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The system failed: missing file, full disk.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Its error.
        source: io::Error,
    },
    /// It is no `.vdb` file, or a damaged one.
    #[error("{}: {reason}; expected an OpenVDB file of format 224 or older, whole", .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was found.
        reason: String,
    },
    /// There is no such grid.
    #[error("{}: no grid {wanted:?}; it holds {}", .path.display(), listed(.present))]
    NoGrid {
        /// The file.
        path: PathBuf,
        /// The name asked for.
        wanted: String,
        /// Grids of the file, as "name (type, class)".
        present: Vec<String>,
    },
    /// The grid is no narrow-band level set of floats with cubic voxels, and cannot be made one as requested.
    #[error("{}: grid {grid:?} has {found}; expected {expected}", .path.display())]
    NotALevelSet {
        /// The file.
        path: PathBuf,
        /// The grid.
        grid: String,
        /// What was found.
        found: String,
        /// What a level set has.
        expected: String,
        /// What to do.
        hint: String,
    },
    /// A name or key that a file must not have.
    #[error("{}: the {what} {name:?} {problem}", .path.display())]
    Name {
        /// The file.
        path: PathBuf,
        /// What it names.
        what: &'static str,
        /// The name.
        name: String,
        /// Why not.
        problem: &'static str,
    },
    /// The leaf files that a file is put together from.
    #[error(transparent)]
    Leaves(StoreError),
    /// OpenVDB refused.
    #[error("{}: OpenVDB failed: {reason}", .path.display())]
    OpenVdb {
        /// The file.
        path: PathBuf,
        /// Its own words.
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

fn listed(present: &[String]) -> String {
    if present.is_empty() {
        "no grids".to_owned()
    } else {
        present.join(", ")
    }
}

impl FileError {
    /// An exception met while reading `path`.
    pub(super) fn damaged(path: &Path, error: &cxx::Exception) -> Self {
        Self::Damaged {
            path: path.to_owned(),
            reason: reason(error),
        }
    }

    /// The system's error on `path`.
    pub(super) fn io(path: &Path, source: io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }
}

impl FileError {
    /// What to do about it, where that is known.
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

/// Longest message of OpenVDB that is passed on, characters: it may quote what a damaged file holds.
const LONGEST: usize = 200;

/// OpenVDB's words without its class of exception, on one line and of bounded length.
pub(super) fn reason(error: &cxx::Exception) -> String {
    let what = error.what();
    let words = match what.split_once(": ") {
        Some((class, words)) if class.ends_with("Error") && !class.contains(' ') => words,
        _ => what,
    };
    let shown = words
        .trim_end_matches('.')
        .chars()
        .take(LONGEST)
        .flat_map(char::escape_debug);
    let cut = if words.chars().nth(LONGEST).is_some() {
        "..."
    } else {
        ""
    };
    shown.chain(cut.chars()).collect()
}
