//! What all of [druse](https://docs.rs/druse) stands on: frames, fields, lanes and triangle meshes.
//!
//! - [`frame`]: cell, world and index frames, a type each.
//! - [`field`]: real functions on a frame, negative inside the solid, with bounds over boxes.
//! - [`mesh`]: triangle meshes, their repair, and meshes as solids with signed distances.
//! - [`progress`]: threads, progress and cancellation, which belong to the caller.
//! - [`simd`]: arithmetic on rows of numbers, chosen for the processor at run time.
//!
//! No item here knows cells, scaffolds, files or volumes. The items have their public names in the crate `druse`.

pub mod field;
pub mod frame;
pub mod mesh;
pub mod progress;
#[doc(hidden)]
pub mod simd;
#[doc(hidden)]
pub mod union_find;
