//! Crystal-like modelling, for [druse](https://docs.rs/druse).
//!
//! - [`polymesh`]: polygon meshes, extrusions in tiers, face groups, remeshing, and scripts of such steps.
//!
//! No item here knows files or OpenVDB. Lengths are in the unit of the model, which is not converted. The items have
//! their public names in the crate `druse`.

pub mod polymesh;
