//! Why a run stopped: the stage's own error, or a rule that only the whole run knows.

use super::source::CellFault;
use crate::band::BandError;
use crate::frame::Aabb;
use crate::io::{ReadError, WriteError};
use crate::progress::Cancelled;
use crate::recipe::RecipeError;
use crate::vdb::{FileError, VdbError};
use std::path::PathBuf;

/// Why a recipe was not run to its end. Nothing half-written remains.
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
        /// What was being sampled.
        stage: String,
        /// Why not.
        error: BandError,
    },
    /// An operation on the level set failed.
    #[error("{stage}: {error}")]
    LevelSet {
        /// The operation, as in `op.2.gaussian`.
        stage: String,
        /// Why.
        error: VdbError,
    },
    /// A cell cannot be made.
    #[error("{key}: {fault}")]
    Cell {
        /// The cell's key, as in `cell.strut`.
        key: String,
        /// Why not.
        fault: CellFault,
    },
    /// The scaffold cannot be filled.
    #[error("scaffold: {message}")]
    Scaffold {
        /// Its file.
        file: Option<PathBuf>,
        /// The element at fault, in the file's numbering.
        element: Option<u64>,
        /// What is wrong.
        message: String,
    },
    /// The scaffold has elements of several shapes, and the recipe one cell.
    #[error("the scaffold has {0} elements; expected elements of one shape")]
    Mixed(String),
    /// The cell does not go over the scaffold.
    #[error("tiling: {0}")]
    Tiling(String),
    /// Two solids that shall meet lie apart.
    #[error(
        "{left_name} and {right_name} do not meet: {left_name} spans {}, {right_name} spans {}",
        show(left),
        show(right)
    )]
    Apart {
        /// What has been made so far.
        left_name: String,
        /// Its box, recipe units.
        left: Aabb,
        /// What it is intersected with.
        right_name: String,
        /// Its box.
        right: Aabb,
    },
    /// The run would need more memory than there is.
    #[error(
        "this run would need about {} of memory, and {} are available; it cannot go through in bricks: {reason}; a voxel size of {fitting} {unit} would fit",
        gibibytes(*needed), gibibytes(*available)
    )]
    Memory {
        /// Predicted peak, bytes.
        needed: u64,
        /// What may be used, bytes.
        available: u64,
        /// A voxel size that would fit, recipe units.
        fitting: String,
        /// The recipe's unit.
        unit: &'static str,
        /// Why it cannot go through in bricks.
        reason: String,
    },
    /// Bricks are asked for of a run that has room as a whole, and cannot go through them.
    #[error(
        "this run cannot go through bricks: {reason}; as a whole it needs about {} of memory, which the budget has room for",
        gibibytes(*needed)
    )]
    Whole {
        /// Predicted peak, bytes.
        needed: u64,
        /// Why it cannot go through bricks.
        reason: String,
    },
    /// Not even one brick fits into the memory that may be used.
    #[error(
        "this run goes through bricks and needs at least {} of memory even so; the budget is {}",
        gibibytes(*least), gibibytes(*budget)
    )]
    Budget {
        /// The least that would do, bytes.
        least: u64,
        /// What may be used, bytes.
        budget: u64,
    },
    /// Bricks of the size asked for do not fit into the memory that may be used.
    #[error(
        "bricks of {edge} blocks a side (--bricks {edge}) need {} of memory; the budget is {}{}",
        gibibytes(*needed), gibibytes(*budget), fitting_bricks(*fitting)
    )]
    BrickSize {
        /// Blocks along an edge.
        edge: u32,
        /// What they need, bytes.
        needed: u64,
        /// What may be used, bytes.
        budget: u64,
        /// The largest that fit.
        fitting: Option<u32>,
    },
    /// Bricks of the size asked for span more voxels, with what operations reach, than are operated on together.
    #[error(
        "bricks of {edge} blocks a side (--bricks {edge}) and the {halo} voxels that the operations reach span more than {most} voxels; bricks of {fitting} do not"
    )]
    BrickSpan {
        /// Blocks along an edge.
        edge: u32,
        /// Voxels around a brick.
        halo: i32,
        /// The most that a brick may span, voxels.
        most: i32,
        /// The largest that do, blocks.
        fitting: u32,
    },
    /// The disk has no room for bricks and outputs.
    #[error(
        "{}: the bricks and files of this run need about {} and {} are free",
        .directory.display(), gibibytes(*needed), gibibytes(*free)
    )]
    Disk {
        /// Where they would stand.
        directory: PathBuf,
        /// Predicted bytes.
        needed: u64,
        /// Free bytes.
        free: u64,
    },
    /// Bricks that are not there or not whole.
    #[error("{}: bricks {faults}", .directory.display())]
    Bricks {
        /// Where they shall be.
        directory: PathBuf,
        /// Their numbers.
        faults: String,
        /// The command that makes them.
        advice: String,
    },
    /// A run in bricks was asked to stop; what it has made is kept.
    #[error(
        "stopped with {made} of {count} bricks made; they are kept in {}",
        .directory.display()
    )]
    Stopped {
        /// Where they are.
        directory: PathBuf,
        /// Bricks that are there.
        made: usize,
        /// All bricks.
        count: usize,
    },
    /// Another run works on the same outputs.
    #[error("{}: another run works on these bricks", .0.display())]
    Busy(PathBuf),
    /// A plan cannot be used, or not with what is here.
    #[error("{}: {message}", .plan.display())]
    Plan {
        /// The plan's file.
        plan: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// Triangles could not be merged.
    #[error("decimate: {0}")]
    Decimate(String),
    /// A level set has other voxels than the recipe, which wants the same.
    #[error("{0}; same_voxels = true refuses that")]
    Voxels(String),
    /// A solid cannot be cut so.
    #[error(transparent)]
    Slices(#[from] crate::slice::PlanError),
    /// Something without end is to be added.
    #[error("{0} has no end; expected a solid within a box (a plane only cuts)")]
    Endless(String),
    /// The solid has no surface.
    #[error("the solid is empty after {0}")]
    Empty(String),
    /// An output has the name of an input.
    #[error("the output {} would overwrite an input of the recipe", .0.display())]
    Overwrite(PathBuf),
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
    /// The user asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl From<VdbError> for RunError {
    fn from(error: VdbError) -> Self {
        Self::level_set("picture")(error)
    }
}

impl RunError {
    /// Whether the user asked to stop, wherever that was noticed.
    pub(super) fn is_cancelled(&self) -> bool {
        matches!(
            self,
            Self::Cancelled(_) | Self::File(FileError::Cancelled(_))
        )
    }

    pub(super) fn band(stage: &str) -> impl Fn(BandError) -> Self + '_ {
        move |error| match error {
            BandError::Cancelled(c) => Self::Cancelled(c),
            error => Self::Band {
                stage: stage.to_owned(),
                error,
            },
        }
    }

    pub(super) fn level_set(stage: &str) -> impl Fn(VdbError) -> Self + '_ {
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
pub(super) fn show(b: &Aabb) -> String {
    let corner = |v: crate::frame::Vec3| {
        let [x, y, z] = [v.x, v.y, v.z].map(short);
        format!("[{x}, {y}, {z}]")
    };
    format!("{} to {}", corner(b.min), corner(b.max))
}

/// A number with five digits, without trailing zeros.
pub(super) fn short(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
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

fn fitting_bricks(edge: Option<u32>) -> String {
    match edge {
        Some(edge) => format!("; the largest that fit have {edge}"),
        None => "; none fit".to_owned(),
    }
}

/// Rounded up, in MiB where that is less than a GiB.
fn gibibytes(bytes: u64) -> String {
    let (mebi, gibi) = (bytes as f64 / 1048576.0, bytes as f64 / 1073741824.0);
    if gibi < 1.0 {
        format!("{:.0} MiB", mebi.ceil())
    } else {
        format!("{:.1} GiB", (10.0 * gibi).ceil() / 10.0)
    }
}
