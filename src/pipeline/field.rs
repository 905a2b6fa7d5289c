//! The solid of a recipe as one field, before the first operation that needs a voxel's neighbours. `tiling_shape`
//! makes the field of the tiled scaffold, `field_ops` combines it with the operands of the first operations, and
//! `offsets` decides which moves of the surface the field itself can take. All lengths are in the recipe's unit
//! (world units); phi is negative inside. `run` and `bricks` sample it.

pub mod field_ops;
pub mod offsets;
pub mod tiling_shape;
