//! Costs of decks of the scaffold's elements: homogenised cells, memory, disk space and time.

use super::super::effective::table_points;
use super::Estimate;
use crate::homogenize::{Settings, bytes_per_voxel};
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::memory;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::outputs::macro_deck::RESOLUTION;
use crate::recipe::Output;

/// Seconds per voxel of one homogenised cell with six load cases, on two threads.
const VOXEL_SECONDS: f64 = 2e-5;
/// Bytes of an element of a deck on disk, with its share of the nodes and sets.
const ELEMENT_DISK_BYTES: f64 = 250.0;
/// Bytes of an element in memory beside the scaffold.
const ELEMENT_BYTES: f64 = 400.0;

/// The estimate of a run whose files are all decks of the scaffold's elements.
pub(crate) fn of_macro_decks(inputs: &Inputs) -> Result<Estimate, RunError> {
    let mut estimate = Estimate {
        elements: inputs.elements(),
        peak_memory_bytes: memory::resident(),
        ..Estimate::default()
    };
    estimate.add_macro_decks(inputs)?;
    Ok(estimate)
}

impl Estimate {
    /// Adds the costs of the recipe's decks of the scaffold's elements.
    pub(crate) fn add_macro_decks(&mut self, inputs: &Inputs) -> Result<(), RunError> {
        let outputs = &inputs.recipe.sections().output;
        let decks: Vec<&Output> = outputs.iter().filter(|o| o.is_macro_deck()).collect();
        if decks.is_empty() {
            return Ok(());
        }
        let cells = table_points(inputs)? as f64;
        let elements = inputs.elements() as f64;
        for deck in decks {
            let voxels = f64::from(deck.resolution.unwrap_or(RESOLUTION)).powi(3);
            let each = bytes_per_voxel(&Settings::default(), true) as f64;
            let peak = memory::resident() + (voxels * each + elements * ELEMENT_BYTES) as u64;
            self.peak_memory_bytes = self.peak_memory_bytes.max(peak);
            self.homogenised_cells += cells as u64;
            self.disk_bytes += (elements * ELEMENT_DISK_BYTES) as u64;
            self.seconds += cells * voxels * VOXEL_SECONDS;
        }
        Ok(())
    }
}
