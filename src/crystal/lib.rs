//! Crystal-like modelling, for [druse](https://docs.rs/druse).
//!
//! - [`polymesh`]: polygon meshes, extrusions in tiers, face groups, remeshing, and scripts of such steps.
//!
//! No item here knows files or OpenVDB. The items have their public names in the crate `druse`.

pub mod polymesh;
