//! Cells over scaffolds, for [druse](https://docs.rs/druse): fields in world space, and the leaves near their surfaces.
//!
//! - [`scaffold`]: unstructured meshes with the maps of their elements.
//! - [`tiling`]: a cell in each element of a scaffold, as one field.
//! - [`beams`]: struts and plates along a scaffold, round in world space.
//! - [`band`]: which leaves of 8^3 voxels the surface meets, and their values.
//! - [`mesher`]: the surface of a band in triangles.
//!
//! No item here knows files or OpenVDB. The items have their public names in the crate `druse`.

pub mod band;
pub mod beams;
pub mod mesher;
pub mod scaffold;
pub mod tiling;
