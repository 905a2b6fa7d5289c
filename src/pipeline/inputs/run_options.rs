//! The options of a run: threads, memory, bricks, outputs, and what it may take from earlier runs.

use super::run_cache::RunCache;
use crate::pipeline::base::error::RunError;
use crate::progress::Threads;
use crate::vdb::subprocess::{PrefetchedGrid, Program};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// How a recipe is run.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// Worker threads; 0 means one per core.
    pub threads: usize,
    /// Memory that the run may use, bytes; by default what the machine has available.
    pub memory: Option<u64>,
    /// Edge of a brick in blocks of 128 voxels. With a value the run always goes through bricks. Without
    /// one it does so only if it needs more memory than it may use.
    pub bricks: Option<u32>,
    /// Directory of the outputs and of `report.json`; by default the recipe's own, without a report.
    pub out: Option<PathBuf>,
    /// Whether every file must lie in `out`, without links below it: the recipe came with a file, or is one of several
    /// that must not write the same files.
    pub confined: bool,
    /// The report of a run whose recipe names none; `report.json` in `out` when left out.
    pub report: Option<PathBuf>,
    /// Whether a warning ends the run.
    pub strict: bool,
    /// Whether to skip slow measures that no output needs: wall thickness, layers and requirements.
    pub brief: bool,
    /// The child process that opens `.vdb` input files. Without one, this process reads them, and a
    /// damaged file can crash it.
    pub isolated: Option<Program>,
    /// A grid of such a file that is in memory already; the run does not read it again.
    pub opened: Option<PrefetchedGrid>,
    /// What earlier runs read and made; what depends on the same keys and files is not made again.
    pub cache: Option<RunCache>,
    /// Hashes that the inputs must have, by the recipe's key; empty for any inputs.
    pub expected_inputs: BTreeMap<String, String>,
}

/// The worker threads that the options request.
pub(crate) fn threads(options: &RunOptions) -> Result<Threads, RunError> {
    Threads::new(options.threads).map_err(|e| RunError::Threads(e.to_string()))
}
