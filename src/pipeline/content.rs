//! What fills the elements of a scaffold, and all inputs of a run together.

pub mod fractions;
pub mod grading;
pub mod inputs;
mod orientation;
pub mod palette;
pub mod round_beams;
pub mod sheets;
pub mod tiling;
