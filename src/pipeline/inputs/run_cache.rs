//! What the runs of a changing recipe share: cells, solids, scaffolds and densities, which are made again only where
//! they change.

use super::cell_cache::CellCache;
use super::input_files::SolidAndBeams;
use super::scaffold::CheckedScaffold;
use crate::cell::Density;
use crate::pipeline::base::report::Input;
use crate::pipeline::base::warning::Warning;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// What earlier runs read and made. Clones share it.
#[derive(Clone, Default)]
pub struct RunCache {
    /// Fitted cells.
    pub(crate) cells: CellCache,
    /// Solids of mesh files.
    pub(crate) solids: Kept<ReadInput<SolidAndBeams>>,
    /// Scaffolds of files.
    pub(crate) scaffolds: Kept<ReadInput<CheckedScaffold>>,
    /// Densities of curved elements; `None` where all are affine.
    pub(crate) densities: Kept<Option<Density>>,
}

impl fmt::Debug for RunCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RunCache").finish_non_exhaustive()
    }
}

/// What was read, and what its reading added to the run's lists.
#[derive(Clone)]
pub(crate) struct ReadInput<T> {
    pub value: T,
    pub inputs: Vec<Input>,
    pub warnings: Vec<Warning>,
    pub paths: Vec<PathBuf>,
}

/// The latest value of each place in the recipe, with all that it depends on: a changing key never keeps more than one
/// value of a place.
pub(crate) struct Kept<T>(Arc<Mutex<BTreeMap<String, (String, T)>>>);

impl<T> Clone for Kept<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T> Default for Kept<T> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<T: Clone> Kept<T> {
    /// The kept value of a place, if it was made with the same key, else the one that `make` makes, which replaces
    /// it. The lock is free while `make` works, so that two threads may both make it.
    pub fn get_or_make<E>(
        &self,
        place: String,
        key: String,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, kept)) = lock().get(&place).filter(|(own, _)| *own == key) {
            return Ok(kept.clone());
        }
        let made = make()?;
        lock().insert(place, (key, made.clone()));
        Ok(made)
    }
}

/// Path, size and time of a file, for keys; `None` where the system does not tell.
pub(crate) fn file_key(path: &Path) -> Option<String> {
    let found = std::fs::metadata(path).ok()?;
    let time = found.modified().ok()?;
    Some(format!("{} {} {time:?}", path.display(), found.len()))
}
