//! Operations on the level set.

pub mod drains;
pub mod level_set_ops;
pub mod voxels;
