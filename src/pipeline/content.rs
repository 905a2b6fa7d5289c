//! What fills the elements of a scaffold, and all inputs of a run together. `palette` makes the cells, `tiling`
//! joins them with their weights and grading, `round_beams` and `sheets` are the contents whose thickness holds in
//! space; `fractions`, `grading` and `orientation` serve them. Nothing here samples or writes.

pub mod fractions;
pub mod grading;
pub mod inputs;
mod orientation;
pub mod palette;
pub mod round_beams;
pub mod sheets;
pub mod tiling;
