//! The cells of [druse](https://docs.rs/druse): symmetric Fourier series whose zero set is a surface.
//!
//! - [`symmetry`]: point groups as integer matrices on a lattice, and orbits of frequencies.
//! - [`cell`]: cells, their fits to geometry, operations on them, and tables for fast evaluation.
//!
//! No item here knows scaffolds, files or volumes. The items have their public names in the crate `druse`.

pub mod cell;
#[doc(hidden)]
pub mod fourier;
pub mod symmetry;
