//! Scripts: a model as text, one step a line, replayed to the same mesh every time.
//!
//! Steps end with their line or with `;`, `#` begins a comment, `repeat N { ... }` nests, `param` names a value
//! that the caller may override, numbers may be expressions (angles in degrees). [`VERBS`] lists the steps.
//!
//! ```
//! # extern crate druse_crystal as druse;
//! use druse::polymesh::{NoFiles, Script, Interpreter};
//! let script = Script::parse("param n = 1\ncube\nrepeat n { extrude tetrahedral group=1 }").unwrap();
//! let mut interpreter = Interpreter::new(&NoFiles);
//! interpreter.set("n", "1").unwrap();
//! script.run(&mut interpreter, None).unwrap();
//! assert_eq!(interpreter.mesh().unwrap().face_count(), 24);
//! let error = Script::parse("cube\nextrud cubical group=1").unwrap_err();
//! assert_eq!(error.to_string(), "line 2: no step is called \"extrud\"; did you mean \"extrude\"?");
//! ```

use super::expression::Expression;
use super::history::{History, Model};
use super::{PolyMesh, seed};
use druse_geometry::progress::{Progress, Silent};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

mod argument;
mod growth;
mod parse;
mod regroup;
mod step;

use argument::Statement;

/// The steps of a script, with their arguments.
#[rustfmt::skip]
pub const VERBS: &[(&str, &str)] = &[
    ("SOLID", "edge=1: any of the 5 Platonic and 13 Archimedean solids by any of its names"),
    ("polygon", "n=5 edge=1: a two-sided n-gon, face 0 up"),
    ("prism", "n=6 edge=1 height=1"),
    ("antiprism", "n=6 edge=1 height=: equilateral triangles without a height"),
    ("pyramid", "n=4 edge=1 height=: equilateral triangles where they can be"),
    ("grid", "counts=[2, 2, 2] edge=1: the surface of a block of cubes"),
    ("torus", "major=2 minor=0.5 counts=[16, 8]"),
    ("form", "SYSTEM group=m-3m a=1 ... [h,k,l]=DISTANCE ...: a crystal of the forms {hkl}"),
    ("push", "[h,k,l] BY: moves a form of that crystal out or in"),
    ("load", "FILE group_by=material|color|object color_tol=0 weld=0 flip=false allow_open=false"),
    ("extrude", "KIND FACES dihedral=|tilt= tiers=[...] iterations=1 level=false phase=0"),
    ("remesh", "SCHEME parameters groups=class|keep|parent|distinct|[1, 2, 3]"),
    ("subdivide", "FACES into=quads|triangles: about their centres"),
    ("assign", "FACES ID|new"),
    ("merge", "ID ID ...: puts all into the first"),
    ("renumber", "groups from 1, in order of their numbers"),
    ("startvertex", "FACES toward=[x, y, z] | at=VERTEX | lowest"),
    ("symmetrize", "[GROUP] rotations=false: a group for each orbit of faces, under all symmetries or those of a point group"),
    ("move", "[x, y, z]"),
    ("turn", "[x, y, z] ANGLE: about an axis through the origin"),
    ("scale", "FACTOR"),
    ("save", "FILE"),
];

/// Face count above which each step reports progress: on smaller meshes it takes but a moment.
const PROGRESS_MIN_FACES: usize = 10_000;
/// Maximum number of steps that one interpreter runs, loops unrolled.
const MAX_STEPS: usize = 100_000;

/// An error in a script, and its place.
#[derive(Clone, Debug, PartialEq)]
pub struct ScriptError {
    /// The line, from 1.
    pub line: usize,
    /// The character in the line, from 1.
    pub column: usize,
    /// What was found and what was expected.
    pub message: String,
    /// What to do.
    pub hint: Option<String>,
}

impl std::fmt::Display for ScriptError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "line {}: {}", self.line, self.message)?;
        self.hint.as_ref().map_or(Ok(()), |h| write!(f, "; {h}"))
    }
}

impl std::error::Error for ScriptError {}

/// File access of the steps `load` and `save`.
pub trait Files: Sync {
    /// Reads a mesh with the options of the step.
    ///
    /// # Errors
    /// What was found and expected.
    fn load(&self, path: &Path, options: &LoadOptions) -> Result<Loaded, String>;
    /// Writes a mesh.
    ///
    /// # Errors
    /// The reason.
    fn save(&self, path: &Path, mesh: &PolyMesh) -> Result<(), String>;
}

/// Options of reading a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadOptions {
    /// What makes a group.
    pub group_by: GroupBy,
    /// Largest difference of red, green and blue (0 to 1) of colours in one group; 0 separates colours that
    /// differ by 1/255.
    pub color_tolerance: f64,
    /// Distance within which vertices are merged; 0 merges none.
    pub weld: f64,
    /// Whether faces are turned inside out.
    pub flip: bool,
    /// Whether holes are closed, each with one face; these faces form a separate group.
    pub allow_open: bool,
}

/// The property of a file that makes groups.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GroupBy {
    /// The material's name, or `groupN`.
    #[default]
    Material,
    /// The material's colour.
    Color,
    /// The names of `g` and `o`.
    Object,
}

/// A mesh from a file.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The mesh.
    pub mesh: PolyMesh,
    /// Warnings.
    pub warnings: Vec<String>,
}

/// No files: `load` and `save` fail.
pub struct NoFiles;

impl Files for NoFiles {
    fn load(&self, _: &Path, _: &LoadOptions) -> Result<Loaded, String> {
        Err("no files can be read here".into())
    }
    fn save(&self, _: &Path, _: &PolyMesh) -> Result<(), String> {
        Err("no files can be written here".into())
    }
}

/// A note about a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Note {
    /// The step's line.
    pub line: usize,
    /// A sentence in lower case.
    pub text: String,
}

/// The interpreter of scripts: the model, its history, parameters and notes.
#[derive(Clone)]
pub struct Interpreter<'a> {
    history: History,
    files: &'a dyn Files,
    parameters: BTreeMap<String, f64>,
    overrides: BTreeMap<String, f64>,
    notes: Vec<Note>,
    step_count: usize,
    progress: &'a dyn Progress,
}

impl<'a> Interpreter<'a> {
    /// An empty interpreter that keeps one step of history, enough to run a script.
    pub fn new(files: &'a dyn Files) -> Self {
        Self::with_history(files, 1)
    }

    /// An empty interpreter that can undo this many steps.
    pub fn with_history(files: &'a dyn Files, steps: usize) -> Self {
        Self {
            history: History::new(steps),
            files,
            parameters: BTreeMap::new(),
            overrides: BTreeMap::new(),
            notes: Vec::new(),
            step_count: 0,
            progress: &Silent,
        }
    }

    /// Reports each step on a large mesh to `progress`, and stops between two steps when it is cancelled.
    #[must_use]
    pub fn with_progress(self, progress: &'a dyn Progress) -> Self {
        Self { progress, ..self }
    }

    /// Reports the start of a step; returns false if the run is cancelled.
    fn start_step(&self, step: &str) -> bool {
        if self
            .mesh()
            .is_some_and(|m| m.face_count() > PROGRESS_MIN_FACES)
        {
            self.progress.stage(step, None);
        }
        !self.progress.cancelled()
    }

    /// Overrides a parameter before the run; the value may be an expression without names.
    ///
    /// # Errors
    /// When the text is no such expression, or its value is not finite.
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), String> {
        let parsed = Expression::parse(value).map_err(|e| e.message)?;
        let number = parsed.finite(&|_, _| None).map_err(|e| e.message)?;
        self.overrides.insert(name.to_owned(), number);
        Ok(())
    }

    /// The current mesh; `None` before a step makes one.
    pub fn mesh(&self) -> Option<&PolyMesh> {
        self.history.model().mesh.as_deref()
    }

    /// The current mesh, shared.
    pub fn shared_mesh(&self) -> Option<Arc<PolyMesh>> {
        self.history.model().mesh.clone()
    }

    /// The current model.
    pub fn model(&self) -> &Model {
        self.history.model()
    }

    /// The steps done and undone.
    pub fn history(&mut self) -> &mut History {
        &mut self.history
    }

    /// The steps that made the model, as far as the history keeps them.
    pub fn steps(&self) -> Vec<String> {
        self.history.steps().map(str::to_owned).collect()
    }

    /// The parameters that have a value.
    pub fn parameters(&self) -> &BTreeMap<String, f64> {
        &self.parameters
    }

    /// Removes and returns the notes since the last call.
    pub fn take_notes(&mut self) -> Vec<Note> {
        std::mem::take(&mut self.notes)
    }

    fn note(&mut self, line: usize, text: String) {
        let note = Note { line, text };
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }
}

/// A parsed script.
#[derive(Clone, Debug)]
pub struct Script {
    items: Vec<Item>,
}

#[derive(Clone, Debug)]
enum Item {
    Parameter {
        name: String,
        value: Expression,
        line: usize,
        column: usize,
    },
    Repeat {
        count: Expression,
        body: Vec<Item>,
        line: usize,
        column: usize,
    },
    Step(Statement),
}

impl Script {
    /// Reads a script.
    ///
    /// # Errors
    /// [`ScriptError`]: brackets or quotes that do not match, a step that does not exist, a faulty name, value or count
    /// of `param` and `repeat`, loops nested more than 20 deep. Arguments of steps are read when they run.
    pub fn parse(text: &str) -> Result<Self, ScriptError> {
        parse::script(text)
    }

    /// Names of the parameters outside loops, which are those that can be overridden.
    pub fn parameters(&self) -> Vec<&str> {
        self.items
            .iter()
            .filter_map(|item| match item {
                Item::Parameter { name, .. } => Some(name.as_str()),
                _ => None,
            })
            .collect()
    }

    /// Runs the script, up to and including the line `until` if one is given. Each step is added to the history of
    /// `interpreter`; its parameters and notes change too.
    ///
    /// # Errors
    /// [`ScriptError`] at the step that cannot be done or was cancelled; the model stays as the steps before it made it.
    /// At line 1 for an override of a parameter that the script does not have.
    pub fn run(
        &self,
        interpreter: &mut Interpreter,
        until: Option<usize>,
    ) -> Result<(), ScriptError> {
        let known = self.parameters();
        for name in interpreter.overrides.keys() {
            if !known.contains(&name.as_str()) {
                let list = if known.is_empty() {
                    "none".to_owned()
                } else {
                    known.join(", ")
                };
                return Err(ScriptError {
                    line: 1,
                    column: 1,
                    message: format!("no parameter is named {name:?}; the script has {list}"),
                    hint: nearest(name, &known).map(|w| format!("did you mean {w:?}?")),
                });
            }
        }
        items(&self.items, interpreter, until.unwrap_or(usize::MAX)).map(|_| ())
    }
}

/// Runs items up to the line `until`; returns whether to continue, which is false once a later line is reached.
fn items(list: &[Item], interpreter: &mut Interpreter, until: usize) -> Result<bool, ScriptError> {
    for (n, item) in list.iter().enumerate() {
        match item {
            Item::Parameter { line, .. } | Item::Repeat { line, .. } if *line > until => {
                return Ok(false);
            }
            Item::Parameter {
                name,
                value,
                line,
                column,
            } => {
                let value = match interpreter.overrides.get(name) {
                    Some(&value) => value,
                    None => argument::number(value, interpreter, *line, *column)?,
                };
                interpreter.parameters.insert(name.clone(), value);
            }
            Item::Repeat {
                count,
                body,
                line,
                column,
            } => {
                let times = argument::number(count, interpreter, *line, *column)?;
                if times.fract() != 0.0 || !(0.0..=1e5).contains(&times) {
                    return Err(ScriptError {
                        line: *line,
                        column: *column,
                        message: format!(
                            "repeat {times}; expected a whole number from 0 to 100000"
                        ),
                        hint: None,
                    });
                }
                // A mesh that would grow too large is refused before it is made.
                for round in 0..times as usize {
                    // The faults of a step come first: before the first round only large meshes are counted.
                    let min_corners = if round > 0 { 0 } else { growth::MIN_CORNERS };
                    let left = times as usize - round;
                    growth::require_bounded(body, left, interpreter, until, min_corners)?;
                    if !items(body, interpreter, until)? {
                        return Ok(false);
                    }
                }
            }
            Item::Step(statement) => {
                if statement.line > until {
                    return Ok(false);
                }
                interpreter.step_count += 1;
                // Endless or very long scripts end with an error.
                if interpreter.step_count > MAX_STEPS {
                    return Err(statement.fault(0, format!("more than {MAX_STEPS} steps")));
                }
                growth::require_bounded(&list[n..], 1, interpreter, until, growth::MIN_CORNERS)?;
                if !interpreter.start_step(&statement.text) {
                    return Err(statement.fault(0, "stopped before this step"));
                }
                step::run_step(statement, interpreter)?;
            }
        }
    }
    Ok(true)
}

/// Whether a word begins a step that does not name a solid.
fn is_verb(word: &str) -> bool {
    VERBS.iter().any(|v| v.0 == word && word != "SOLID")
}

/// The known word most similar to `word`; `None` where none is within one edit and one more per four letters.
fn nearest<'a, S: AsRef<str> + ?Sized>(word: &str, known: &'a [&S]) -> Option<&'a str> {
    known
        .iter()
        .map(|k| (strsim::damerau_levenshtein(word, k.as_ref()), k.as_ref()))
        .filter(|(distance, k)| *distance <= 1 + k.len() / 4)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, k)| k)
}

impl PolyMesh {
    /// The mesh that the steps of a script make; its `load` and `save` steps fail. [`Interpreter`] has files,
    /// parameters and notes.
    ///
    /// # Errors
    /// [`ScriptError`] at the step that cannot be done, or when none makes a mesh.
    ///
    /// ```
    /// # extern crate druse_crystal as druse;
    /// use druse::polymesh::PolyMesh;
    /// let star = PolyMesh::from_script("cube; extrude tetrahedral all").unwrap();
    /// assert_eq!(star.face_count(), 24);
    /// ```
    pub fn from_script(text: &str) -> Result<Self, ScriptError> {
        let mut interpreter = Interpreter::new(&NoFiles);
        Script::parse(text)?.run(&mut interpreter, None)?;
        let mesh = interpreter.shared_mesh().ok_or_else(|| ScriptError {
            line: 1,
            column: 1,
            message: "no step makes a mesh".to_owned(),
            hint: Some("begin with a solid such as cube".to_owned()),
        })?;
        drop(interpreter);
        Ok(Arc::unwrap_or_clone(mesh))
    }
}
