//! What a cell is as a material, for [druse](https://docs.rs/druse), and cells that are a wanted material.
//!
//! - [`homogenize`]: stiffness, conductivity and permeability of a periodic cell.
//! - [`inverse`]: cells designed for such properties.
//!
//! No item here knows files or OpenVDB. The items have their public names in the crate `druse`.

pub mod homogenize;
pub mod inverse;
