//! Files, for [druse](https://docs.rs/druse).
//!
//! - [`io`]: readers and writers of meshes, scaffolds, cells, tables and packages, and files that are whole or absent.
//!
//! OpenVDB's files are the business of the crate `druse`, which has the public names of the items here too. Nothing
//! here computes with geometry beyond what a format needs.

pub mod io;
