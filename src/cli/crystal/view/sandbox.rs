//! Restricts the files that the viewer reads and writes to the directory of its script.
//!
//! The viewer runs the steps that its page sends, and a page must not reach other files of the user. The script itself
//! comes from the user: while it runs, before the page is served, it may read files of any directory.

use crate::io::{read_polymesh, write_polymesh};
use crate::polymesh::{Files, LoadOptions, Loaded, PolyMesh};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// File access within one directory, without its subdirectories.
pub(super) struct Sandbox {
    directory: PathBuf,
    /// Whether reading is restricted, too. Atomic, since the interpreter of steps shares the sandbox.
    is_closed: AtomicBool,
}

impl Sandbox {
    /// Restricts writing to a directory, empty for the working directory; reading too, once the sandbox is closed.
    pub fn new(directory: &Path) -> Self {
        // The directory of a script that is given by its plain name is empty.
        let is_empty = directory.as_os_str().is_empty();
        let directory = if is_empty { Path::new(".") } else { directory };
        Self {
            directory: directory.to_owned(),
            is_closed: AtomicBool::new(false),
        }
    }

    /// Restricts reading to the directory from now on: the script has run, and steps of the page follow.
    pub fn close(&self) {
        self.is_closed.store(true, Ordering::Relaxed);
    }

    /// The directory, never empty.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The path of a plain name within the directory; links that lead out of it are refused.
    ///
    /// # Errors
    /// A message, for a name with a separator or a leading dot and for such a link.
    pub fn inside(&self, name: &Path) -> Result<PathBuf, String> {
        crate::cli::server::inside(&self.directory, name)
    }
}

impl Files for Sandbox {
    fn load(&self, path: &Path, options: &LoadOptions) -> Result<Loaded, String> {
        let path = if self.is_closed.load(Ordering::Relaxed) {
            self.inside(path)?
        } else {
            self.directory.join(path)
        };
        read_polymesh(path, options).map_err(|e| e.to_string())
    }

    fn save(&self, path: &Path, mesh: &PolyMesh) -> Result<(), String> {
        // A mesh in .obj or .dlfl comes with a material file of the same name, which may be a link, too.
        self.inside(&path.with_extension("mtl"))?;
        let written = write_polymesh(self.inside(path)?, mesh);
        written.map(|_| ()).map_err(|e| e.to_string())
    }
}
