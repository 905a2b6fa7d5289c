//! All laws and oracles, in one binary; modules are named after those of `src`.

mod band;
mod blend;
mod bricks;
mod cell;
mod certificate;
mod field;
mod homogenize;
mod house;
mod inverse;
mod io;
mod malformed;
mod mesh;
mod mesher;
mod polymesh;
mod recipe;
mod scaffold;
mod sequence;
mod strategy;
mod symmetry;
mod tiling;

#[cfg(feature = "vdb")]
mod cli;
#[cfg(feature = "vdb")]
mod guide;
#[cfg(feature = "vdb")]
mod pipeline;
#[cfg(feature = "vdb")]
mod safety;
#[cfg(feature = "vdb")]
mod truth;
#[cfg(feature = "vdb")]
mod vdb;
#[cfg(feature = "vdb")]
mod vdb_commands;
