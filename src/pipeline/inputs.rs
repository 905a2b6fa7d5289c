//! From the files that a recipe names to data: cells, scaffolds, crystals, volumes and values in space.

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
