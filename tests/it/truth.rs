//! Right values of real inputs: closed forms and brute force that share no code with Druse.

mod beams;
mod certificate;
mod decks;
mod far;
mod fields;
mod fits;
mod foreign_grids;
mod lattices;
mod level_set_files;
mod moved_solids;
mod offsets;
mod sheets;
mod signs;
mod solids;
mod touching;
