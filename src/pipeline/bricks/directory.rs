//! The directory in which a run keeps its bricks.

use super::super::error::RunError;
use crate::io::WriteError;
use crate::recipe::{OutputKind, Recipe};
use rustix::fs::{FlockOperation, flock};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// The file that a run locks.
const LOCK: &str = "lock";

/// Where the bricks of a run in bricks are kept: `.NAME.bricks` beside its first output.
pub(crate) fn directory_beside(recipe: &Recipe, out: Option<&Path>) -> PathBuf {
    let outputs = &recipe.sections().output;
    let named = || outputs.iter().flat_map(|o| o.named());
    let vdb = named().find(|(kind, _)| *kind == OutputKind::Vdb);
    let path = vdb.or_else(|| named().next()).map(|(_, path)| path);
    let target = super::super::output::target(recipe, out, path.unwrap_or(Path::new("run")));
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    target.with_file_name(format!(".{name}.bricks"))
}

/// The directory, or of those it will lie in the nearest that is there.
pub(super) fn existing(directory: &Path) -> &Path {
    let mut above = directory.ancestors().filter(|d| d.is_dir());
    // Of a relative path the last is empty: the working directory.
    above.next().unwrap_or(Path::new("."))
}

/// Makes the directory, if it is not there.
pub(super) fn make_directory(directory: &Path) -> Result<(), WriteError> {
    fs::create_dir_all(directory).map_err(|e| WriteError::Create {
        path: directory.to_owned(),
        reason: e.to_string(),
    })
}

/// A run's own hold on its directory; the system lets go of it however the run ends.
pub(super) struct Lock(#[expect(dead_code, reason = "held until dropped")] File);

impl Lock {
    /// Takes hold of a directory.
    ///
    /// # Errors
    /// [`RunError::Busy`] when another run has it. File systems without locks are let be.
    pub fn take(directory: &Path) -> Result<Self, RunError> {
        let path = directory.join(LOCK);
        let file = File::create(&path).map_err(|e| WriteError::Create {
            path: path.clone(),
            reason: e.to_string(),
        })?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Err(rustix::io::Errno::WOULDBLOCK) => Err(RunError::Busy(directory.to_owned())),
            _ => Ok(Self(file)),
        }
    }
}

/// Removes the files whose names are not wanted, but for the lock.
pub(super) fn clear(directory: &Path, unwanted: impl Fn(&str) -> bool) {
    for entry in fs::read_dir(directory).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name != LOCK && unwanted(&name) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Whether a file was made of the first pass's bricks: of a later pass, or numbers.
pub(super) fn is_derived(name: &str) -> bool {
    // brick-000017.leaves, brick-000017.1.leaves, brick-000017.WORD.numbers
    name.starts_with("brick-") && name.split('.').count() > 2
}

/// Bytes of all files.
pub(super) fn size_of(directory: &Path) -> u64 {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    entries
        .filter_map(|e| e.metadata().ok())
        .map(|m| m.len())
        .sum()
}
