//! What fills the elements of a scaffold, and all inputs of a run together.

pub mod fractions;
pub mod grading;
pub mod inputs;
pub mod palette;
pub mod round_beams;
pub mod sheets;
pub mod tiling;
