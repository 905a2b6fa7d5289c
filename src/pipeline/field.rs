//! The solid of a recipe as one field, before the first operation that needs a voxel's neighbours.

pub mod field_ops;
pub mod offsets;
pub mod tiling_shape;
