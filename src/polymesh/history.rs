//! Undo and redo: every model that was, shared and not copied, restored bit for bit.

use super::PolyMesh;
use super::form::Form;
use std::sync::Arc;

/// A model at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// The mesh, once there is one.
    pub mesh: Option<Arc<PolyMesh>>,
    /// The first face made by the last operation; those after it were made by it, too.
    pub last: usize,
    /// The tops of the last extrusion.
    pub tops: Vec<usize>,
    /// The crystal form it is, as long as nothing else was done to it.
    pub form: Option<Form>,
}

/// Models in the order of their making, with what made them.
#[derive(Clone, Debug)]
pub struct History {
    entries: Vec<(String, Model)>,
    /// How many of the entries count; those after are undone.
    at: usize,
    limit: usize,
    start: Model,
}

impl History {
    /// An empty history that remembers so many steps, at least one.
    pub fn new(limit: usize) -> Self {
        Self {
            entries: Vec::new(),
            at: 0,
            limit: limit.max(1),
            start: Model::default(),
        }
    }

    /// The model as it is.
    pub fn model(&self) -> &Model {
        match self.at {
            0 => &self.start,
            n => &self.entries[n - 1].1,
        }
    }

    /// Adds a model and what made it; forgets what was undone, and the oldest beyond the limit.
    pub fn push(&mut self, step: impl Into<String>, model: Model) {
        self.entries.truncate(self.at);
        self.entries.push((step.into(), model));
        if self.entries.len() > self.limit {
            self.start = self.entries.remove(0).1;
        }
        self.at = self.entries.len();
    }

    /// Goes back one step and returns its text; `None` at the beginning of the history.
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

    /// The steps that made the model, as far as they are remembered.
    pub fn steps(&self) -> impl Iterator<Item = &str> {
        self.entries[..self.at].iter().map(|e| e.0.as_str())
    }
}
