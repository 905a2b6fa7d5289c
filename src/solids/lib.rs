//! Analyses of a finished solid without OpenVDB, for [druse](https://docs.rs/druse).
//!
//! - [`leaf_source`]: the leaves of a solid, from a tree in memory or from disk. All analyses read them by this trait.
//! - [`cavities`]: voids that a ball cannot leave, and the channels that drain them.
//! - [`layers`]: islands, overhangs, cups and sections of a build.
//! - [`mod@slice`]: outlines and images of plane sections of a field.
//! - [`voxel_mask`], [`dense`]: the voxels of a leaf as bits, and values of a region as an array.
//!
//! The items have their public names in the crate `druse`.

use druse_geometry::progress::{Progress, Threads};

pub mod cavities;
pub mod dense;
pub mod layers;
pub mod leaf_source;
pub mod slice;
pub mod voxel_mask;

/// The threads of an analysis, and its progress.
#[derive(Clone, Copy)]
pub struct Task<'a> {
    /// Threads of parallel loops.
    pub threads: &'a Threads,
    /// Progress; checked for cancellation at least every 0.1 s.
    pub progress: &'a dyn Progress,
}
