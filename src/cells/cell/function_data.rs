//! What has been evaluated of a cell's function, so that it is evaluated once for all levels and clones.
//!
//! Only what does not depend on the level or the kind of solid is kept. Two threads may evaluate the same at once;
//! either result is kept, since both are equal.

use super::level_search::Samples;
use super::table::Table;
use super::{Cell, CellError, Solid};
use std::collections::BTreeMap;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Evaluations of one function. Nothing is evaluated while a lock is held: a thread that waits for other threads' part
/// of the work may begin work that needs the same lock.
#[derive(Debug, Default)]
pub(super) struct FunctionData {
    /// By number of parts per edge of a flag.
    samples: Mutex<BTreeMap<usize, Samples>>,
    /// The function itself: level 0, solid below.
    table: OnceLock<Table>,
}

impl Cell {
    /// Samples on as many points as a grid of `single_flag_parts` parts per edge has on one flag.
    /// The first call for a number computes and keeps them; clones share the values.
    pub(super) fn samples(&self, single_flag_parts: usize) -> Samples {
        let samples = &self.function_data.samples;
        let lock = || samples.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = lock().get(&single_flag_parts) {
            return known.clone();
        }
        let found = Samples::new(self, single_flag_parts);
        lock().insert(single_flag_parts, found.clone());
        found
    }

    /// The table of the function itself: level 0, solid below.
    /// The first call builds it.
    pub(super) fn function_table(&self) -> Result<&Table, CellError> {
        let table = &self.function_data.table;
        if let Some(known) = table.get() {
            return Ok(known);
        }
        let found = Table::new(&self.clone().with_solid(Solid::Below, 0.0)?)?;
        Ok(table.get_or_init(|| found))
    }
}
