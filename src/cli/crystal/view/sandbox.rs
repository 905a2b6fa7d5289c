//! File access of the viewer, restricted to the directory of its script.

use crate::io::{read_polymesh, write_polymesh};
use crate::polymesh::{Files, LoadOptions, Loaded, PolyMesh};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// One directory, without its subdirectories.
pub(super) struct Sandbox {
    directory: PathBuf,
    closed: AtomicBool,
}

impl Sandbox {
    /// Restricts writing to a directory; reading too, once the sandbox is closed.
    pub fn new(directory: &Path) -> Self {
        let here = directory.as_os_str().is_empty();
        Self {
            directory: if here { Path::new(".") } else { directory }.to_owned(),
            closed: AtomicBool::new(false),
        }
    }

    /// Restricts reading to the directory from now on.
    pub fn close(&self) {
        self.closed.store(true, Ordering::Relaxed);
    }

    /// The directory.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The path of a plain name within the directory; links that lead out of it are refused.
    ///
    /// # Errors
    /// What was found and expected.
    pub fn inside(&self, name: &Path) -> Result<PathBuf, String> {
        crate::cli::server::inside(&self.directory, name)
    }
}

impl Files for Sandbox {
    fn load(&self, path: &Path, options: &LoadOptions) -> Result<Loaded, String> {
        let path = if self.closed.load(Ordering::Relaxed) {
            self.inside(path)?
        } else {
            self.directory.join(path)
        };
        read_polymesh(path, options).map_err(|e| e.to_string())
    }

    fn save(&self, path: &Path, mesh: &PolyMesh) -> Result<(), String> {
        self.inside(&path.with_extension("mtl"))?;
        let written = write_polymesh(self.inside(path)?, mesh);
        written.map(|_| ()).map_err(|e| e.to_string())
    }
}
