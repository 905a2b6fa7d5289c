//! Errors of a run: those of its stages, and rules between its parts.
//!
//! An error names its place, what was found and what was expected. Most hints on flags and commands are added by the
//! command line.

use crate::band::BandError;
use crate::cell::{CellError, FitError, SkeletonError};
use crate::frame::Aabb;
use crate::io::{ReadError, WriteError};
use crate::progress::Cancelled;
use crate::recipe::RecipeError;
use crate::vdb::{FileError, VdbError};
use std::path::PathBuf;

/// Why a cell of a recipe cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum CellFault {
    /// A level, a surface, a lattice.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The source or the fit to it.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// An invalid formula.
    #[error(transparent)]
    Formula(#[from] crate::field::FormulaError),
    /// A target that cannot be met.
    #[error(transparent)]
    Target(#[from] crate::inverse::InverseError),
    /// The recipe's request cannot be met.
    #[error("{0}")]
    Rule(String),
}

impl From<SkeletonError> for CellFault {
    fn from(e: SkeletonError) -> Self {
        Self::Fit(e.into())
    }
}

/// Why a run stopped. No partial output remains.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The recipe, or a rule between it and its inputs.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// An input could not be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// An output could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A `.vdb` could not be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The narrow band could not be evaluated.
    #[error("{stage}: {error}")]
    Band {
        /// The stage that sampled.
        stage: String,
        /// The cause.
        error: BandError,
    },
    /// An operation on the level set failed.
    #[error("{stage}: {error}")]
    LevelSet {
        /// The operation, as in `op.2.gaussian`.
        stage: String,
        /// The cause.
        error: VdbError,
    },
    /// A cell cannot be made.
    #[error("{key}: {fault}")]
    Cell {
        /// The cell's key, as in `cell.strut`.
        key: String,
        /// The cause.
        fault: CellFault,
    },
    /// The scaffold is invalid or cannot be made.
    #[error("scaffold: {message}")]
    Scaffold {
        /// Its file; `None` where no file holds it.
        file: Option<PathBuf>,
        /// The element at fault, in the file's numbering.
        element: Option<u64>,
        /// What is wrong.
        message: String,
    },
    /// The scaffold has elements of several shapes and no cell fits any of them.
    #[error("the scaffold has {0} elements; expected elements of one shape")]
    MixedElements(String),
    /// The cells cannot tile the scaffold.
    #[error("tiling: {0}")]
    Tiling(String),
    /// No turns of the scaffold's elements make the cells continue over all faces.
    #[error("tiling: {misfit}")]
    Misfit {
        /// The edges and faces at fault.
        misfit: Box<crate::tiling::Misfit>,
        /// The scaffold to whose nodes they refer.
        scaffold: std::sync::Arc<crate::scaffold::Scaffold>,
    },
    /// Two solids to intersect have no common part.
    #[error(
        "{left_name} and {right_name} do not meet: {left_name} spans {}, {right_name} spans {}",
        box_text(left),
        box_text(right)
    )]
    Disjoint {
        /// The solid before the operation.
        left_name: String,
        /// Its box, recipe units.
        left: Aabb,
        /// The operand.
        right_name: String,
        /// Its box.
        right: Aabb,
    },
    /// The run needs more memory than is available.
    #[error(
        "the run needs about {} of memory and {} are available; it cannot be divided into bricks: {reason}; a voxel size of {fitting} {unit} would fit",
        gibibytes(*needed), gibibytes(*available)
    )]
    Memory {
        /// Predicted peak, bytes.
        needed: u64,
        /// Memory that the run may use, bytes.
        available: u64,
        /// A voxel size that would fit, recipe units.
        fitting: String,
        /// The recipe's unit.
        unit: &'static str,
        /// Why it cannot go through in bricks.
        reason: String,
    },
    /// The user requests bricks, the run cannot use them, and it fits in memory.
    #[error(
        "the run cannot be divided into bricks: {reason}; in memory it needs about {}, which is within the budget",
        gibibytes(*needed)
    )]
    BricksUnsupported {
        /// Predicted peak, bytes.
        needed: u64,
        /// Why it cannot go through bricks.
        reason: String,
    },
    /// Even bricks of one block need more memory than is available.
    #[error(
        "the run needs at least {} of memory even in the smallest bricks; the budget is {}",
        gibibytes(*least), gibibytes(*budget)
    )]
    Budget {
        /// Memory for the smallest bricks, bytes.
        least: u64,
        /// Memory that the run may use, bytes.
        budget: u64,
    },
    /// Bricks of the requested size need more memory than is available.
    #[error(
        "bricks of {edge} blocks a side (--bricks {edge}) need {} of memory; the budget is {}{}",
        gibibytes(*needed), gibibytes(*budget), fitting_bricks_text(*fitting)
    )]
    BrickSize {
        /// Blocks along an edge.
        edge: u32,
        /// Memory for such bricks, bytes.
        needed: u64,
        /// Memory that the run may use, bytes.
        budget: u64,
        /// Largest edge that fits, blocks; `None` if none does.
        fitting: Option<u32>,
    },
    /// Bricks of the requested size with their halo span more voxels than one part may have.
    #[error(
        "bricks of {edge} blocks a side (--bricks {edge}) with a halo of {halo} voxels span more than {max_span} voxels; the largest that do not have {fitting}"
    )]
    BrickSpan {
        /// Blocks along an edge.
        edge: u32,
        /// Voxels around a brick.
        halo: i32,
        /// Greatest span of a brick with its halo, voxels.
        max_span: i32,
        /// Largest edge within that span, blocks.
        fitting: u32,
    },
    /// The disk has too little space for bricks and outputs.
    #[error(
        "{}: the bricks and outputs of the run need about {}, and {} are free",
        .directory.display(), gibibytes(*needed), gibibytes(*free)
    )]
    Disk {
        /// Their directory.
        directory: PathBuf,
        /// Predicted bytes.
        needed: u64,
        /// Free bytes.
        free: u64,
    },
    /// Bricks that are missing or damaged.
    #[error("{}: bricks {faults}", .directory.display())]
    Bricks {
        /// Their directory.
        directory: PathBuf,
        /// Their numbers.
        faults: String,
        /// The command that makes them.
        advice: String,
    },
    /// A run in bricks was cancelled; its finished bricks are kept.
    #[error(
        "stopped with {made} of {count} bricks made; they are kept in {}",
        .directory.display()
    )]
    Stopped {
        /// Their directory.
        directory: PathBuf,
        /// Finished bricks.
        made: usize,
        /// All bricks.
        count: usize,
    },
    /// Another run uses the same brick directory.
    #[error("{}: another run uses these bricks", .0.display())]
    Busy(PathBuf),
    /// A plan is invalid or does not match the recipe and its inputs.
    #[error("{}: {message}", .plan.display())]
    Plan {
        /// The plan's file.
        plan: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A step is refused: channels, layers of a build, or the check of a surface that is torn.
    #[error("{stage}: {message}")]
    Refused {
        /// Its key, as in `op.2.drain`.
        stage: String,
        /// What is wrong.
        message: String,
        /// A remedy.
        hint: &'static str,
    },
    /// Decimation failed.
    #[error("decimate: {0}")]
    Decimate(String),
    /// A solid cannot be cut into these layers.
    #[error(transparent)]
    Slices(#[from] crate::slice::PlanError),
    /// An unbounded solid is added.
    #[error("{0} is unbounded; expected a bounded solid (a plane can only intersect or subtract)")]
    Unbounded(String),
    /// The solid has no surface.
    #[error("the solid is empty after {0}")]
    Empty(String),
    /// An output would overwrite an input.
    #[error("the output {} would overwrite an input of the recipe", .0.display())]
    Overwrite(PathBuf),
    /// An output would lie outside the folder of the outputs, and its name is not the user's own.
    #[error("found the output {}, {reason}; expected a name inside {}", .name.display(), .folder.display())]
    Outside {
        /// The output.
        name: PathBuf,
        /// The folder of the outputs.
        folder: PathBuf,
        /// How it leads out.
        reason: String,
    },
    /// Inputs are not those of the run that is repeated: key and path of each.
    #[error("found inputs that have changed since the run: {}; expected the same bytes", .0.join(", "))]
    ChangedInputs(Vec<String>),
    /// Worker threads could not be started.
    #[error("cannot start threads: {0}")]
    Threads(String),
    /// A warning, in a strict run.
    #[error("{code}: {message} (warnings are errors here)")]
    Strict {
        /// Code of the warning.
        code: &'static str,
        /// Its text.
        message: String,
    },
    /// The user cancelled the run.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl RunError {
    /// Whether the error is a cancellation, in whichever stage.
    pub(crate) fn is_cancelled(&self) -> bool {
        matches!(
            self,
            Self::Cancelled(_) | Self::File(FileError::Cancelled(_))
        )
    }

    /// Converts an error of the sampling and names its stage; a cancellation stays one.
    pub(crate) fn band(stage: &str) -> impl Fn(BandError) -> Self + '_ {
        move |error| match error {
            BandError::Cancelled(c) => Self::Cancelled(c),
            error => Self::Band {
                stage: stage.to_owned(),
                error,
            },
        }
    }

    /// Converts an error of OpenVDB and names its stage, as in `op.2.gaussian`; a cancellation stays one.
    pub(crate) fn level_set(stage: &str) -> impl Fn(VdbError) -> Self + '_ {
        move |error| match error {
            VdbError::Cancelled(c) => Self::Cancelled(c),
            error => Self::LevelSet {
                stage: stage.to_owned(),
                error,
            },
        }
    }
}

/// A box as "[0, 0, 0] to [60, 40, 20]".
pub(crate) fn box_text(b: &Aabb) -> String {
    let corner = |v: crate::frame::Vec3| {
        let [x, y, z] = [v.x, v.y, v.z].map(short_number);
        format!("[{x}, {y}, {z}]")
    };
    format!("{} to {}", corner(b.min), corner(b.max))
}

/// A path as one word of a shell.
pub(crate) fn shell_word(path: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-".contains(c);
    if path.chars().all(is_plain) {
        return path.to_owned();
    }
    format!("'{}'", path.replace('\'', r"'\''"))
}

/// A number with about five significant digits, at most 12 of them behind the point, without trailing zeros.
pub(crate) fn short_number(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        // Adding 0 turns -0 into 0.
        return format!("{}", v + 0.0);
    }
    let digits = (4 - v.abs().log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{v:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

fn fitting_bricks_text(edge: Option<u32>) -> String {
    match edge {
        Some(edge) => format!("; the largest that fit have {edge}"),
        None => "; none fit".to_owned(),
    }
}

/// A size in bytes rounded up: in GiB (2^30 bytes) with one digit, or in whole MiB (2^20 bytes) below one GiB.
fn gibibytes(bytes: u64) -> String {
    let (mebi, gibi) = (bytes as f64 / 1048576.0, bytes as f64 / 1073741824.0);
    if gibi < 1.0 {
        format!("{:.0} MiB", mebi.ceil())
    } else {
        format!("{:.1} GiB", (10.0 * gibi).ceil() / 10.0)
    }
}
