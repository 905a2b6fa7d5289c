//! The directory of a run's bricks, and its lock.

use super::super::error::RunError;
use crate::io::WriteError;
use crate::recipe::{OutputKind, Recipe};
use rustix::fs::{FlockOperation, flock};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// File name of the lock.
const LOCK_FILE: &str = "lock";

/// The brick directory of a run: `.NAME.bricks` beside its first output.
pub(crate) fn directory_beside(recipe: &Recipe, out: Option<&Path>) -> PathBuf {
    let outputs = &recipe.sections().output;
    let named = || outputs.iter().flat_map(|o| o.named());
    let vdb = named().find(|(kind, _)| *kind == OutputKind::Vdb);
    let path = vdb.or_else(|| named().next()).map(|(_, path)| path);
    let target = super::super::output::target(recipe, out, path.unwrap_or(Path::new("run")));
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    target.with_file_name(format!(".{name}.bricks"))
}

/// The directory or its nearest existing ancestor.
pub(super) fn nearest_existing(directory: &Path) -> &Path {
    let mut existing_ancestors = directory.ancestors().filter(|d| d.is_dir());
    // The last ancestor of a relative path is empty and stands for the working directory.
    existing_ancestors.next().unwrap_or(Path::new("."))
}

/// Creates the directory if it does not exist.
pub(super) fn make_directory(directory: &Path) -> Result<(), WriteError> {
    fs::create_dir_all(directory).map_err(|e| WriteError::Create {
        path: directory.to_owned(),
        reason: e.to_string(),
    })
}

/// The lock of a run on its directory. The system releases it however the process ends.
pub(super) struct Lock(#[expect(dead_code, reason = "held until dropped")] File);

impl Lock {
    /// Locks a directory.
    ///
    /// # Errors
    /// [`RunError::Busy`] when another run holds the lock. File systems without locks are used
    /// unlocked.
    pub fn take(directory: &Path) -> Result<Self, RunError> {
        let path = directory.join(LOCK_FILE);
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

/// Removes the files whose names `is_unwanted` admits, except for the lock.
pub(super) fn clear(directory: &Path, is_unwanted: impl Fn(&str) -> bool) {
    for entry in fs::read_dir(directory).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name != LOCK_FILE && is_unwanted(&name) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Whether a file derives from the bricks of the first pass: a later pass or attributes.
pub(super) fn is_derived(name: &str) -> bool {
    // brick-000017.leaves, brick-000017.1.leaves, brick-000017.WORD.numbers
    name.starts_with("brick-") && name.split('.').count() > 2
}

/// Total size of the files in the directory, bytes.
pub(super) fn size_of(directory: &Path) -> u64 {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    entries
        .filter_map(|e| e.metadata().ok())
        .map(|m| m.len())
        .sum()
}
