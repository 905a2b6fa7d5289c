//! The guide: one subject a page, each with a recipe that runs.
//!
//! The pages are Markdown files in `src/guide`, readable without rustdoc.

// Names of programs and of the recipe's words stand in prose.
#![allow(clippy::doc_markdown)]

#[doc = include_str!("guide/getting_started.md")]
pub mod getting_started {}
#[doc = include_str!("guide/cells.md")]
pub mod cells {}
#[doc = include_str!("guide/scaffolds.md")]
pub mod scaffolds {}
#[doc = include_str!("guide/operations.md")]
pub mod operations {}
#[doc = include_str!("guide/printing.md")]
pub mod printing {}
#[doc = include_str!("guide/large_parts.md")]
pub mod large_parts {}
#[doc = include_str!("guide/film.md")]
pub mod film {}
#[doc = include_str!("guide/blender.md")]
pub mod blender {}
#[doc = include_str!("guide/houdini.md")]
pub mod houdini {}
#[doc = include_str!("guide/crystals.md")]
pub mod crystals {}
#[doc = include_str!("guide/files.md")]
pub mod files {}
#[doc = include_str!("guide/formats.md")]
pub mod formats {}
#[doc = include_str!("guide/views.md")]
pub mod views {}
#[doc = include_str!("guide/grading.md")]
pub mod grading {}
#[doc = include_str!("guide/accuracy.md")]
pub mod accuracy {}
#[doc = include_str!("guide/performance.md")]
pub mod performance {}
#[doc = include_str!("guide/python.md")]
pub mod python {}
#[doc = include_str!("guide/recipe.md")]
pub mod recipe {}
