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
        let shown = self.directory.display();
        let expected = format!("expected the plain name of a file in {shown}");
        let text = name.to_str().unwrap_or_default();
        let plain = !text.is_empty()
            && !text.starts_with('.')
            && text
                .chars()
                .all(|c| !c.is_control() && c != '/' && c != '\\');
        if !plain {
            return Err(format!("found {text:?}; {expected}"));
        }
        let path = self.directory.join(text);
        let real = |p: &Path| std::fs::canonicalize(p).ok();
        let is_link = std::fs::symlink_metadata(&path).is_ok_and(|m| m.is_symlink());
        if is_link
            && real(&path).as_deref().and_then(Path::parent) != real(&self.directory).as_deref()
        {
            return Err(format!(
                "found {text:?}, a link that leads elsewhere; {expected}"
            ));
        }
        Ok(path)
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
