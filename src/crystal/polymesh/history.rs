//! Undo and redo: the models before and after each step, shared and not copied.
//!
//! A new step drops the undone ones. Beyond the limit the oldest steps are forgotten; their model remains as the start.

use super::PolyMesh;
use super::form::Form;
use std::sync::Arc;

/// The state of a model after a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// The mesh, once there is one.
    pub mesh: Option<Arc<PolyMesh>>,
    /// The first face that the last operation made; it made all faces after it too.
    pub last: usize,
    /// The tops of the last extrusion.
    pub tops: Vec<usize>,
    /// The crystal form, until another operation changes the mesh.
    pub form: Option<Form>,
}

/// The models in order, each with the step that made it.
#[derive(Clone, Debug)]
pub struct History {
    entries: Vec<(String, Model)>,
    /// Number of entries that are not undone.
    at: usize,
    limit: usize,
    start: Model,
}

impl History {
    /// An empty history that keeps at most `limit` steps, at least one.
    pub fn new(limit: usize) -> Self {
        Self {
            entries: Vec::new(),
            at: 0,
            limit: limit.max(1),
            start: Model::default(),
        }
    }

    /// The current model.
    pub fn model(&self) -> &Model {
        match self.at {
            0 => &self.start,
            n => &self.entries[n - 1].1,
        }
    }

    /// Adds a step and its model; drops the undone steps, and the oldest ones beyond the limit.
    pub fn push(&mut self, step: impl Into<String>, model: Model) {
        self.entries.truncate(self.at);
        self.entries.push((step.into(), model));
        if self.entries.len() > self.limit {
            self.start = self.entries.remove(0).1;
        }
        self.at = self.entries.len();
    }

    /// Goes back one step and returns the text of the step that it undoes; `None` at the beginning of the history.
    pub fn undo(&mut self) -> Option<&str> {
        self.at = self.at.checked_sub(1)?;
        Some(&self.entries[self.at].0)
    }

    /// Goes forward one step and returns its text; `None` when nothing is undone.
    pub fn redo(&mut self) -> Option<&str> {
        let step = self.entries.get(self.at)?;
        self.at += 1;
        Some(&step.0)
    }

    /// Whether there is a step to go back.
    pub fn can_undo(&self) -> bool {
        self.at > 0
    }

    /// Whether there is a step to go forward.
    pub fn can_redo(&self) -> bool {
        self.at < self.entries.len()
    }

    /// The steps that made the model, as far as the history keeps them.
    pub fn steps(&self) -> impl Iterator<Item = &str> {
        self.entries[..self.at].iter().map(|e| e.0.as_str())
    }
}
