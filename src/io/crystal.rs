//! Scripts of the polygon stage as files: carried out, they are meshes like any other.

use super::{Place, ReadError, Source, read_polymesh, write_polymesh};
use crate::polymesh::{
    Files, Interpreter, LoadOptions, Loaded, Note, PolyMesh, Script, ScriptError,
};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Files of a script, relative to a directory; what it saves is noted, or left out.
pub struct DiskFiles {
    directory: PathBuf,
    saves: bool,
    saved: Mutex<Vec<(PathBuf, u64)>>,
    loaded: Mutex<Vec<PathBuf>>,
}

impl DiskFiles {
    /// Files below a directory; without `saves` the script's `save` steps do nothing.
    pub fn new(directory: impl AsRef<Path>, saves: bool) -> Self {
        Self {
            directory: directory.as_ref().to_owned(),
            saves,
            saved: Mutex::default(),
            loaded: Mutex::default(),
        }
    }

    /// Files beside a script.
    pub fn beside(script: &Path, saves: bool) -> Self {
        Self::new(script.parent().unwrap_or(Path::new("")), saves)
    }

    /// What was loaded.
    pub fn loaded(&self) -> Vec<PathBuf> {
        self.loaded
            .lock()
            .map_or_else(|e| e.into_inner().clone(), |l| l.clone())
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
        let path = self.directory.join(path);
        let mesh = read_polymesh(&path, options).map_err(|e| e.to_string())?;
        if let Ok(mut loaded) = self.loaded.lock() {
            loaded.push(path);
        }
        Ok(mesh)
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

/// The mesh that a script's text makes with these values of its parameters, and the notes on its steps.
///
/// # Errors
/// [`ScriptError`] at the step that cannot be done, or when none makes a mesh.
pub fn carry_out(
    text: &str,
    files: &DiskFiles,
    set: &[(String, String)],
) -> Result<(PolyMesh, Vec<Note>), ScriptError> {
    let whole = |message: String, hint: Option<&str>| ScriptError {
        line: 1,
        column: 1,
        message,
        hint: hint.map(str::to_owned),
    };
    let mut interpreter = Interpreter::new(files);
    for (name, value) in set {
        let set = interpreter.set(name, value);
        set.map_err(|e| whole(format!("{name} = {value}: {e}"), None))?;
    }
    Script::parse(text)?.run(&mut interpreter, None)?;
    let notes = interpreter.take_notes();
    let Some(mesh) = interpreter.shared() else {
        let hint = "begin with a solid such as cube";
        return Err(whole("no step makes a mesh".into(), Some(hint)));
    };
    drop(interpreter);
    Ok((Arc::unwrap_or_clone(mesh), notes))
}

/// A step of a script's file that cannot be done, as an error of that file.
pub fn script_fault(path: &Path, e: &ScriptError) -> ReadError {
    let expected = e.hint.as_deref();
    let expected = expected.unwrap_or("a step that can be carried out");
    let place = Place::Line(e.line as u64);
    ReadError::data(path, place, e.message.clone(), expected)
}

/// The mesh that a script's file makes, and the notes on its steps. Its `save` steps do nothing.
///
/// # Errors
/// [`ReadError`] with the line of the step that cannot be done.
pub fn read_crystal(path: impl AsRef<Path>) -> Result<(PolyMesh, Vec<Note>), ReadError> {
    let path = path.as_ref();
    let text = read_script(path)?;
    let files = DiskFiles::beside(path, false);
    carry_out(&text, &files, &[]).map_err(|e| script_fault(path, &e))
}
