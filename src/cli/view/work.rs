//! The work behind a live page: one thread computes what the page shows, in steps from coarse to fine; the next change
//! cancels the step in progress.

use super::recipe_text::{Edit, RecipeText};
use super::sampled::Sampled;
use super::scene::Scene;
use super::{Parameters, load};

use crate::cli::context;
use crate::cli::context::Session;
use crate::cli::failure::Failure;
use crate::cli::server::Refused;
use crate::pipeline::RunCache;
use crate::progress::{Progress, Threads};
use serde_json::{Value, json};
use std::panic::AssertUnwindSafe;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// What the page is about.
pub(super) enum Subject {
    File,
    Recipe(RecipeText),
}

/// A result that the page shows, as the bytes of its scene.
#[derive(Clone)]
pub(super) struct Published {
    /// Counts results; the page fetches a new one.
    pub number: u64,
    pub bytes: Arc<[u8]>,
}

/// What the page knows of the work, values as JSON for it; `sampled` is the grid that its slices show.
#[derive(Default)]
pub(super) struct State {
    /// Changes that are to be computed.
    wanted: Option<Edit>,
    /// The last changes, computed or not: what is saved and run.
    pub edit: Edit,
    pub is_busy: bool,
    pub published: Option<Published>,
    pub error: Option<Value>,
    pub warnings: Vec<Value>,
    pub estimate: Option<Value>,
    /// The voxel size and number of active voxels of the last result; the steps that are done, and their number.
    pub result: Value,
    pub sampled: Option<Arc<Sampled>>,
    /// Voxel size of the first step of the next change, recipe units: at it the last part has the voxels of a first step.
    /// `None` before any part, after a failure or cancellation: the box of the part then gives a guess.
    pub coarse_size: Option<f64>,
    /// The full run for the page: null before any, whether it is in progress, then its files and warnings or its error.
    pub full: Value,
}

/// A piece of work with its stage; it is cancelled when its number is no longer the current one.
#[derive(Default)]
pub(super) struct Task {
    current: AtomicU64,
    stage: Mutex<String>,
    done: AtomicU64,
    total: AtomicU64,
}

impl Task {
    /// Cancels what is in progress; the number of what comes next.
    pub fn next(&self) -> u64 {
        self.current.fetch_add(1, Ordering::Relaxed) + 1
    }

    /// Name and share of the stage.
    pub fn stage(&self) -> Value {
        let name = lock(&self.stage).clone();
        let (done, total) = (
            self.done.load(Ordering::Relaxed),
            self.total.load(Ordering::Relaxed),
        );
        let share = (total > 0).then(|| (done as f64 / total as f64).min(1.0));
        json!({ "name": name, "share": share })
    }
}

/// Progress of one piece of work.
pub(super) struct TaskProgress<'a> {
    task: &'a Task,
    number: u64,
    is_stopped: &'a AtomicBool,
    session: &'a Session,
}

impl Progress for TaskProgress<'_> {
    fn stage(&self, name: &str, total: Option<u64>) {
        name.clone_into(&mut lock(&self.task.stage));
        self.task.done.store(0, Ordering::Relaxed);
        self.task.total.store(total.unwrap_or(0), Ordering::Relaxed);
    }
    fn advance(&self, n: u64) {
        self.task.done.fetch_add(n, Ordering::Relaxed);
    }
    fn cancelled(&self) -> bool {
        self.task.current.load(Ordering::Relaxed) != self.number
            || self.is_stopped.load(Ordering::Relaxed)
            || self.session.signals.stopped()
    }
}

/// The work of one page.
pub(super) struct Work<'a> {
    pub p: &'a Parameters,
    pub session: &'a Session,
    pub subject: Subject,
    pub threads: Threads,
    pub cache: RunCache,
    pub preview: Task,
    pub full: Task,
    state: Mutex<State>,
    changed: Condvar,
    is_stopped: AtomicBool,
}

/// Locks a mutex, also after a thread has panicked while it held it.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<'a> Work<'a> {
    /// The work of a page, which begins with the unchanged subject.
    pub fn new(p: &'a Parameters, session: &'a Session, subject: Subject) -> Result<Self, Failure> {
        let state = State {
            wanted: Some(Edit::default()),
            is_busy: true,
            ..State::default()
        };
        Ok(Self {
            p,
            session,
            subject,
            threads: context::threads(p.threads)?,
            cache: RunCache::default(),
            preview: Task::default(),
            full: Task::default(),
            state: Mutex::new(state),
            changed: Condvar::new(),
            is_stopped: AtomicBool::new(false),
        })
    }

    /// The state, locked until the guard is dropped.
    pub fn state(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }

    /// Ends all work.
    pub fn stop(&self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        self.changed.notify_all();
    }

    /// Begins to compute changes; what is in progress is cancelled.
    pub fn change(&self, edit: Edit) {
        let mut state = self.state();
        self.preview.next();
        // At once, so that the recipe that is saved or run next has these changes.
        state.edit = edit.clone();
        state.wanted = Some(edit);
        state.is_busy = true;
        self.changed.notify_all();
    }

    /// Cancels the preview; what was published stays.
    pub fn cancel(&self) {
        let mut state = self.state();
        self.preview.next();
        state.wanted = None;
        state.coarse_size = None;
    }

    /// The progress of a piece of work with its number.
    pub fn progress_of<'t>(&'t self, task: &'t Task, number: u64) -> TaskProgress<'t> {
        TaskProgress {
            task,
            number,
            is_stopped: &self.is_stopped,
            session: self.session,
        }
    }

    /// The state of all work as the page sees it.
    pub fn describe(&self) -> Value {
        let state = self.state();
        json!({
            "recipe": matches!(self.subject, Subject::Recipe(_)),
            "busy": state.is_busy,
            "stage": self.preview.stage(),
            "number": state.published.as_ref().map_or(0, |p| p.number),
            "error": state.error, "warnings": state.warnings, "estimate": state.estimate, "result": state.result,
            "slices": state.sampled.is_some(),
            "full": state.full, "fullStage": self.full.stage(),
        })
    }

    /// Computes until the page ends: the thread of previews.
    pub fn run(&self) {
        while let Some((edit, number)) = self.next_edit() {
            let progress = self.progress_of(&self.preview, number);
            let done = caught(|| match &self.subject {
                Subject::File => self.show_file(&progress),
                Subject::Recipe(recipe) => super::levels::show(self, recipe, &edit, &progress),
            });
            let mut state = self.state();
            if let Err(failure) = done
                && !progress.cancelled()
            {
                state.error = Some(self.described(&failure, &edit));
                state.coarse_size = None;
            }
            if state.wanted.is_none() {
                state.is_busy = false;
            }
        }
    }

    /// Waits for changes; `None` when the page ends.
    fn next_edit(&self) -> Option<(Edit, u64)> {
        let mut state = self.state();
        loop {
            if self.is_stopped.load(Ordering::Relaxed) {
                return None;
            }
            if let Some(edit) = state.wanted.take() {
                state.error = None;
                state.estimate = None;
                return Some((edit, self.preview.current.load(Ordering::Relaxed)));
            }
            state = self
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// A failure for the page, with the key that it is about.
    pub fn described(&self, failure: &Failure, edit: &Edit) -> Value {
        let message = failure.message();
        let key = match &self.subject {
            Subject::Recipe(recipe) => recipe.key_of(message, edit),
            Subject::File => None,
        };
        json!({ "message": message, "hint": failure.advice(), "key": key })
    }

    /// Shows a file: soon without wall thickness, then with it.
    fn show_file(&self, progress: &TaskProgress) -> Result<(), Failure> {
        let tools = crate::vdb::Session::new(&self.threads, progress);
        let all: &[bool] = match (self.p.no_thickness, load::is_large(&self.p.file)) {
            (true, _) => &[false],
            (false, true) => &[true],
            (false, false) => &[false, true],
        };
        for (step, &has_thickness) in all.iter().enumerate() {
            let p = Parameters {
                no_thickness: !has_thickness,
                ..self.p.clone()
            };
            let (scene, sampled) = self.threads.install(|| load::scene(&p, tools, progress))?;
            if scene.triangles() == 0 {
                return Err(Failure::data(
                    &p.file,
                    "found no surface; expected a solid or elements",
                ));
            }
            let result = json!({ "step": step + 1, "steps": all.len() });
            self.publish(&scene, sampled.map(Arc::new), result, progress)?;
        }
        Ok(())
    }

    /// Publishes a scene with its grid for slices and facts of its step. A cancelled piece of work publishes nothing.
    pub fn publish(
        &self,
        scene: &Scene,
        sampled: Option<Arc<Sampled>>,
        result: Value,
        progress: &TaskProgress,
    ) -> Result<(), Failure> {
        let title = self.p.file.file_name().unwrap_or_default();
        let bytes = super::page::pack(scene, &title.to_string_lossy())
            .map_err(|e| Failure::data(&self.p.file, e.to_string()))?;
        let mut state = self.state();
        if progress.cancelled() {
            return Err(Failure::stopped(130));
        }
        state.published = Some(Published {
            number: state.published.as_ref().map_or(0, |p| p.number) + 1,
            bytes: bytes.into(),
        });
        state.result = result;
        if sampled.is_some() {
            state.sampled = sampled;
        }
        Ok(())
    }
}

/// Runs work; a panic is a failure like any other.
pub(super) fn caught<R>(work: impl FnOnce() -> Result<R, Failure>) -> Result<R, Failure> {
    std::panic::catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| Err(Failure::bug()))
}

/// The refusal of a request that needs a recipe.
pub(super) fn no_recipe() -> Refused {
    Refused::new("found a file; expected a recipe")
}
