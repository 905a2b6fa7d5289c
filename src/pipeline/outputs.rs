//! The files of a run: level sets, meshes, beams and decks.

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
