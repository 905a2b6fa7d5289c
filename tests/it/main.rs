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

/// Whether the long series are wanted: `tests/run full` sets the variable.
fn is_full() -> bool {
    std::env::var_os("DRUSE_FULL").is_some()
}

/// Random cases of a law: all of them in the long series, else half.
fn cases(all: u32) -> u32 {
    if is_full() { all } else { all / 2 }
}

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
