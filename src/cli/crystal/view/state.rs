//! The state of the viewer: the model that is edited, its history, and the script that reproduces it.

use super::super::super::server::Refused;
use super::super::{Source, begin, self_intersections};
use super::sandbox::Sandbox;
use super::scene;
use crate::cli::context::Session;
use crate::cli::failure::Failure;
use crate::io::DiskFiles;
use crate::io::atomic::write_bytes;
use crate::polymesh::{
    Files, Interpreter, Kind, PolyMesh, Script, extrusion_named, extrusion_names, scheme_names,
};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;

/// Steps that can be undone; each keeps its model in memory.
const MAX_UNDO_STEPS: usize = 500;
/// Maximum number of faces of a mesh that every step checks for self-intersections.
const MAX_CHECKED_FACES: usize = 20_000;

/// Names that the page offers.
pub(super) fn words() -> Value {
    let extrusions = extrusion_names().into_iter().filter_map(|name| {
        let (kind, _): (Kind, _) = extrusion_named(&name)?;
        let angle = kind.regular_dihedral().to_degrees();
        Some(json!({ "name": name, "tiers": kind.tiers(), "dihedral": angle, "iterates": kind.has_top() }))
    });
    let extrusions: Vec<Value> = extrusions.collect();
    json!({ "extrusions": extrusions, "schemes": scheme_names() })
}

/// The model that is edited.
pub(super) struct ViewState<'a> {
    interpreter: Interpreter<'a>,
    sandbox: &'a Sandbox,
    session: &'a Session,
    /// The script that was opened.
    opened_text: String,
    /// The steps that it made.
    opened_steps: Vec<String>,
    /// Whether parameters were set from outside, so that the text alone makes a different model.
    has_outside_parameters: bool,
    notes: Vec<String>,
}

impl<'a> ViewState<'a> {
    /// Runs a script and opens its model.
    pub fn open(
        source: &Source,
        sandbox: &'a Sandbox,
        session: &'a Session,
    ) -> Result<Self, Failure> {
        let mut interpreter = Interpreter::with_history(sandbox, MAX_UNDO_STEPS);
        begin(&mut interpreter, source, None, session)?;
        Ok(Self {
            opened_steps: interpreter.steps(),
            interpreter,
            sandbox,
            session,
            opened_text: source.text.clone(),
            has_outside_parameters: !source.parameters.is_empty(),
            notes: Vec::new(),
        })
    }

    /// The steps that made the model.
    pub fn steps(&self) -> Vec<String> {
        self.interpreter.steps()
    }

    /// Runs steps; on an error the model stays as it was.
    pub fn step(&mut self, text: &str) -> Result<(), Refused> {
        let before = self.interpreter.clone();
        let done = Script::parse(text).and_then(|s| s.run(&mut self.interpreter, None));
        if let Err(e) = done {
            self.interpreter = before;
            return Err(Refused::new(e.to_string()));
        }
        self.notes = self
            .interpreter
            .take_notes()
            .into_iter()
            .map(|n| n.text)
            .collect();
        Ok(())
    }

    /// Replaces the last step by another one.
    pub fn again(&mut self, text: &str) -> Result<(), Refused> {
        let before = self.interpreter.clone();
        self.undo()?;
        let done = self.step(text);
        if done.is_err() {
            self.interpreter = before;
        }
        done
    }

    /// Goes back one step.
    pub fn undo(&mut self) -> Result<(), Refused> {
        self.notes.clear();
        let done = self.interpreter.history().undo().is_some();
        done.then_some(())
            .ok_or_else(|| Refused::new("nothing to undo"))
    }

    /// Goes forward one step.
    pub fn redo(&mut self) -> Result<(), Refused> {
        self.notes.clear();
        let done = self.interpreter.history().redo().is_some();
        done.then_some(())
            .ok_or_else(|| Refused::new("nothing to redo"))
    }

    /// The script that makes the model: the opened one and the steps since. Where some of its own steps were undone, or
    /// parameters were set from outside: the parameters, and all steps one by one.
    pub fn script(&self) -> String {
        let steps = self.interpreter.steps();
        let mut text = String::new();
        let since = if !self.has_outside_parameters && steps.starts_with(&self.opened_steps) {
            text.push_str(&self.opened_text);
            if !text.is_empty() && !text.ends_with('\n') {
                text.push('\n');
            }
            &steps[self.opened_steps.len()..]
        } else {
            for (name, value) in self.interpreter.parameters() {
                let _ = writeln!(text, "param {name} = {value}");
            }
            &steps[..]
        };
        for step in since {
            text.push_str(step);
            text.push('\n');
        }
        text
    }

    /// Writes the script (`.crystal`) or the model under a plain name; returns path and size.
    pub fn save(&self, name: &str) -> Result<Value, Refused> {
        let name = Path::new(name.trim());
        let path = self.sandbox.inside(name).map_err(|message| Refused {
            status: 403,
            message,
        })?;
        let Some(mesh) = self.interpreter.shared_mesh() else {
            return Err(Refused::new("there is no mesh yet"));
        };
        if name.extension().is_none_or(|e| e != "crystal") {
            self.sandbox.save(name, &mesh).map_err(Refused::new)?;
        } else {
            let script = self.script();
            self.replay(&script, &mesh)?;
            write_bytes(&path, script.as_bytes()).map_err(|e| Refused::new(e.to_string()))?;
        }
        let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
        Ok(json!({ "path": path.display().to_string(), "bytes": bytes }))
    }

    /// Refuses a script that does not reproduce the model; its `save` steps write nothing here.
    fn replay(&self, script: &str, mesh: &PolyMesh) -> Result<(), Refused> {
        let files = DiskFiles::new(self.sandbox.directory(), false);
        let made = crate::io::run_script(script, &files, &[]);
        let (made, _) =
            made.map_err(|e| Refused::new(format!("the script does not replay: {e}")))?;
        if made == *mesh {
            return Ok(());
        }
        Err(Refused::new(
            "the script makes a different model: more steps were made than the history keeps, or a file has changed",
        ))
    }

    /// The model for the page.
    pub fn scene(&mut self) -> Vec<u8> {
        let mesh = self.interpreter.shared_mesh();
        let mut notes = self.notes.clone();
        let small = |m: &&PolyMesh| m.face_count() <= MAX_CHECKED_FACES;
        if let Some(mesh) = mesh.as_deref().filter(small) {
            let met = self_intersections(mesh, self.session).ok().flatten();
            notes.extend(met.map(|(line, _)| line));
        }
        let history = self.interpreter.history();
        let (back, forth) = (history.can_undo(), history.can_redo());
        let about = json!({
            "script": self.script(),
            "undo": back,
            "redo": forth,
            "notes": notes,
            "summary": mesh.as_ref().map_or("no mesh yet".into(), |m| m.summary().to_string()),
        });
        scene::pack(mesh.as_deref(), about)
    }
}
