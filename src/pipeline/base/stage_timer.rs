//! Wall times of a run's stages, and the points at which a run notices a cancellation.

use super::memory;
use super::report::Stage;
use crate::progress::{Cancelled, Progress};
use std::time::Instant;

/// Times the stages of a run and checks for cancellation after each.
pub(crate) struct StageTimer<'a> {
    pub progress: &'a dyn Progress,
    last: Instant,
    pub stages: Vec<Stage>,
}

impl<'a> StageTimer<'a> {
    /// Starts the clock of the first stage.
    pub fn new(progress: &'a dyn Progress) -> Self {
        Self {
            progress,
            last: Instant::now(),
            stages: Vec::new(),
        }
    }

    /// Ends a stage that began with the end of the last one. Consecutive stages of one name are merged.
    ///
    /// # Errors
    /// [`Cancelled`] if the user has cancelled the run; the stage is recorded nevertheless.
    pub fn end_stage(&mut self, name: &str) -> Result<(), Cancelled> {
        let seconds = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        match self.stages.last_mut() {
            Some(stage) if stage.name == name => {
                stage.seconds += seconds;
                stage.peak_memory_bytes = memory::peak();
            }
            _ => self.stages.push(Stage {
                name: name.to_owned(),
                seconds,
                peak_memory_bytes: memory::peak(),
            }),
        }
        if self.progress.cancelled() {
            return Err(Cancelled);
        }
        Ok(())
    }
}
