//! Scripts of the polygon stage as files: carried out, they are meshes like any other.

use super::{Place, ReadError, Source, read_polymesh, write_polymesh};
use crate::polymesh::{Files, LoadOptions, Loaded, Note, PolyMesh, Script, ScriptError, Workshop};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Files of a script, relative to a directory; what it saves is noted, or left out.
pub struct DiskFiles {
    directory: PathBuf,
    saves: bool,
    saved: Mutex<Vec<(PathBuf, u64)>>,
}

impl DiskFiles {
    /// Files below a directory; without `saves` the script's `save` steps do nothing.
    pub fn new(directory: impl AsRef<Path>, saves: bool) -> Self {
        Self {
            directory: directory.as_ref().to_owned(),
            saves,
            saved: Mutex::default(),
        }
    }

    /// Files beside a script.
    pub fn beside(script: &Path, saves: bool) -> Self {
        Self::new(script.parent().unwrap_or(Path::new("")), saves)
    }

    /// What was saved, with its size in bytes.
    pub fn saved(&self) -> Vec<(PathBuf, u64)> {
        self.saved
            .lock()
            .map_or_else(|e| e.into_inner().clone(), |s| s.clone())
    }
}

impl Files for DiskFiles {
    fn load(&self, path: &Path, options: &LoadOptions) -> Result<Loaded, String> {
        read_polymesh(self.directory.join(path), options).map_err(|e| e.to_string())
    }

    fn save(&self, path: &Path, mesh: &PolyMesh) -> Result<(), String> {
        if self.saves {
            let path = self.directory.join(path);
            let bytes = write_polymesh(&path, mesh).map_err(|e| e.to_string())?;
            if let Ok(mut saved) = self.saved.lock() {
                saved.push((path, bytes));
            }
        }
        Ok(())
    }
}

/// Most bytes of a script: more is no script.
const MOST: u64 = 1 << 24;

/// The text of a script's file.
///
/// # Errors
/// [`ReadError`]: missing, unreadable, no text, too long.
pub fn read_script(path: &Path) -> Result<String, ReadError> {
    let mut source = Source::open(path)?;
    if source.size() > MOST && source.size() != u64::MAX {
        let found = format!("{} bytes", source.size());
        return Err(ReadError::data(
            path,
            Place::File,
            found,
            "a script of at most 16 MiB",
        ));
    }
    let mut text = String::new();
    while let Some(line) = source.line()? {
        if text.len() as u64 > MOST {
            return Err(source.bad("more than 16 MiB", "a script of at most 16 MiB"));
        }
        text.push_str(line);
        text.push('\n');
    }
    Ok(text)
}

/// The mesh that a script's file makes, and the notes on its steps. Its `save` steps do nothing.
///
/// # Errors
/// [`ReadError`] with the line of the step that cannot be done.
pub fn read_crystal(path: impl AsRef<Path>) -> Result<(PolyMesh, Vec<Note>), ReadError> {
    let path = path.as_ref();
    let text = read_script(path)?;
    let files = DiskFiles::beside(path, false);
    let mut workshop = Workshop::new(&files);
    let fault = |e: &ScriptError| {
        let expected = e
            .hint
            .as_deref()
            .unwrap_or("a step that can be carried out");
        ReadError::data(
            path,
            Place::Line(e.line as u64),
            e.message.clone(),
            expected,
        )
    };
    let script = Script::parse(&text).map_err(|e| fault(&e))?;
    script.run(&mut workshop, None).map_err(|e| fault(&e))?;
    let notes = workshop.take_notes();
    match workshop.mesh() {
        Some(mesh) => Ok((mesh.clone(), notes)),
        None => Err(ReadError::data(
            path,
            Place::File,
            "no step that makes a mesh",
            "a script that begins with a solid such as cube",
        )),
    }
}
