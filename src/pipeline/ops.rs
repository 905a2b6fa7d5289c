//! Operations of a recipe on the level set: `level_set_ops` applies each of them to a solid in memory or to a part
//! of one, `drains` drills channels, `voxels` describes resampling. Runs in bricks use the same functions on
//! parts.

pub mod drains;
pub mod level_set_ops;
pub mod voxels;
