//! Script files of the polygon stage: reading and execution.
//!
//! A script may load files and save results beside itself. Saving from a file is confined to its folder, since scripts
//! come from others; steps that the user types may save anywhere.

use super::confine::leads_out;
use super::error::{Place, ReadError};
use super::polymesh::{read_polymesh, write_polymesh};
use super::source::Source;
use druse_crystal::polymesh::{
    Files, Interpreter, LoadOptions, Loaded, Note, PolyMesh, Script, ScriptError,
};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// The files of a script, relative to a directory; it records loaded and saved files.
pub struct DiskFiles {
    directory: PathBuf,
    saves: bool, // whether `save` steps write files
    /// Whether the steps come from the user's keyboard now, not from a file.
    is_by_hand: AtomicBool,
    saved: Mutex<Vec<(PathBuf, u64)>>, // with their sizes in bytes
    loaded: Mutex<Vec<PathBuf>>,
}

impl DiskFiles {
    /// Files below a directory; without `saves` the script's `save` steps do nothing. They save inside it only, until
    /// [`DiskFiles::open`].
    pub fn new(directory: impl AsRef<Path>, saves: bool) -> Self {
        Self {
            directory: directory.as_ref().to_owned(),
            saves,
            is_by_hand: AtomicBool::new(false),
            saved: Mutex::default(),
            loaded: Mutex::default(),
        }
    }

    /// Files beside a script.
    pub fn beside(script: &Path, saves: bool) -> Self {
        Self::new(script.parent().unwrap_or(Path::new("")), saves)
    }

    /// Lets the steps that follow save anywhere: the script has run, and the user types them.
    pub fn open(&self) {
        self.is_by_hand.store(true, Ordering::Relaxed);
    }

    /// The loaded files.
    pub fn loaded(&self) -> Vec<PathBuf> {
        self.loaded
            .lock()
            .map_or_else(|e| e.into_inner().clone(), |l| l.clone())
    }

    /// The saved files with their sizes in bytes.
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
        // An `.obj` or `.dlfl` comes with a material file beside it: both names are checked.
        if self.saves {
            let materials = path.with_extension("mtl");
            let outside = |name: &Path| leads_out(&self.directory, name);
            let reason = outside(path).or_else(|| outside(&materials));
            if let Some(reason) = reason.filter(|_| !self.is_by_hand.load(Ordering::Relaxed)) {
                let name = path.display();
                return Err(format!(
                    "found {name}, {reason}; expected a name inside the folder of the script"
                ));
            }
            let path = self.directory.join(path);
            let bytes = write_polymesh(&path, mesh).map_err(|e| e.to_string())?;
            if let Ok(mut saved) = self.saved.lock() {
                saved.push((path, bytes));
            }
        }
        Ok(())
    }
}

/// Greatest size of a script, 16 MiB: far above any that is written by hand.
const MAX_SCRIPT_BYTES: u64 = 1 << 24;

/// Reads the text of a script; lines end with a line feed whatever the file has.
///
/// # Errors
/// [`ReadError`] for a file that is missing, unreadable, not text or too long.
pub fn read_script(path: &Path) -> Result<String, ReadError> {
    let mut source = Source::open(path)?;
    // A pipe has no size: it is limited while it is read.
    if source.size() > MAX_SCRIPT_BYTES && source.size() != u64::MAX {
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
        if text.len() as u64 > MAX_SCRIPT_BYTES {
            return Err(source.bad("more than 16 MiB", "a script of at most 16 MiB"));
        }
        text.push_str(line);
        text.push('\n');
    }
    Ok(text)
}

/// Executes a script with these values (name, expression) of its parameters; returns the mesh and the notes of the
/// steps. `files` records what is loaded and saved.
///
/// # Errors
/// [`ScriptError`] at the step that fails, or when no step makes a mesh.
pub fn run_script(
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
    let Some(mesh) = interpreter.shared_mesh() else {
        let hint = "begin with a solid such as cube";
        return Err(whole("no step makes a mesh".into(), Some(hint)));
    };
    drop(interpreter);
    Ok((Arc::unwrap_or_clone(mesh), notes))
}

/// Converts the error of a step into one of the script's file.
pub fn script_error(path: &Path, e: &ScriptError) -> ReadError {
    let expected = e.hint.as_deref();
    let expected = expected.unwrap_or("a step that can be carried out");
    let place = Place::Line(e.line as u64);
    ReadError::data(path, place, e.message.clone(), expected)
}

/// Executes a script file; returns the mesh and the notes of the steps. `save` steps do nothing.
///
/// # Errors
/// [`ReadError`] with the line of the step that fails.
pub fn read_crystal(path: impl AsRef<Path>) -> Result<(PolyMesh, Vec<Note>), ReadError> {
    let path = path.as_ref();
    let text = read_script(path)?;
    let files = DiskFiles::beside(path, false);
    run_script(&text, &files, &[]).map_err(|e| script_error(path, &e))
}
