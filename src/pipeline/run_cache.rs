//! What the runs of a changing recipe share: cells, solids and densities, which are made again only where they change.

use super::cell_cache::CellCache;
use super::lattice::LatticeSolid;
use super::report::{Input, Warning};
use crate::cell::Density;
use crate::mesh::MeshSolid;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Solids and densities that are kept; the cache is emptied when there are more.
const MAX_KEPT: usize = 16;

/// What earlier runs read and made. Clones share it.
#[derive(Clone, Default)]
pub struct RunCache {
    /// Fitted cells.
    pub(super) cells: CellCache,
    /// Solids of mesh files.
    pub(super) solids: Kept<FileSolid>,
    /// Densities of curved elements; `None` where all are affine.
    pub(super) densities: Kept<Option<Density>>,
}

impl fmt::Debug for RunCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RunCache").finish_non_exhaustive()
    }
}

/// A solid of a file with its beams, and what its reading added to the run's lists.
#[derive(Clone)]
pub(super) struct FileSolid {
    pub solid: Arc<MeshSolid>,
    pub lattice: Option<Arc<LatticeSolid>>,
    pub inputs: Vec<Input>,
    pub warnings: Vec<Warning>,
    pub paths: Vec<PathBuf>,
}

/// Values by all that they depend on.
pub(super) struct Kept<T>(Arc<Mutex<BTreeMap<String, T>>>);

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
    /// The kept value, else the one that `make` makes.
    pub fn get_or_make<E>(&self, key: String, make: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kept) = lock().get(&key) {
            return Ok(kept.clone());
        }
        let made = make()?;
        let mut all = lock();
        if all.len() >= MAX_KEPT {
            all.clear();
        }
        all.insert(key, made.clone());
        Ok(made)
    }
}

/// Path, size and time of a file, for keys; `None` where the system does not tell.
pub(super) fn file_key(path: &Path) -> Option<String> {
    let found = std::fs::metadata(path).ok()?;
    let time = found.modified().ok()?;
    Some(format!("{} {} {time:?}", path.display(), found.len()))
}
