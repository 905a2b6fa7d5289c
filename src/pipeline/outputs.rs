//! The files of a run: level sets, scenes, meshes, beams, decks, pictures and the report. `output_targets` resolves
//! their paths, `output` writes each kind, `attributes` computes the values that shade them, `run_report` ends the run.
//! A file appears under its name only when it is complete.

pub mod attributes;
pub mod beams;
pub mod decimate;
pub mod deck;
pub mod macro_deck;
pub mod meshing;
pub mod output;
pub mod output_targets;
pub mod precision;
pub mod run_report;
pub mod usda;
