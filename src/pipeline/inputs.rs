//! From the files that a recipe names to data: cells, scaffolds, crystals, volumes and values in space.
//!
//! `input_files` reads meshes and records every file for the report, `source` and `cells` make cells, `scaffold`
//! and `motion` make scaffolds, `field_data` and `spatial_value` give values in space. `cell_cache` and
//! `run_cache` keep what repeated runs share. All geometry leaves here in the recipe's unit and frame.

pub mod cell_cache;
pub mod cells;
pub mod crystals;
pub mod field_data;
pub mod field_grid;
pub mod fit_options;
pub mod group;
pub mod input_files;
pub mod lattice;
pub mod motion;
pub mod period_samples;
pub mod run_cache;
pub mod run_options;
pub mod scaffold;
pub mod scattered_data;
pub mod source;
pub mod spatial_value;
pub mod standalone;
pub mod targets;
pub mod volumes;
