//! Finite-element decks of a solid in bricks: each brick adds the solid in its own voxels. The deck equals that of
//! a run in memory; only its cubes must fit there.

use super::BrickRun;
use super::assemble::part;
use super::solid::StoredSolid;
use crate::frame::{Coord, Vec3};
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::OutputFile;
use crate::pipeline::outputs::deck;
use crate::progress::CancelOnly;
use crate::recipe::Output;
use std::path::Path;

/// Voxels around a brick: its border cells need one, and parts consist of whole leaves.
const HALO: i32 = 8;

/// Writes the deck of a solid in bricks to `path` and returns its entry in the report. The cubes of all bricks are
/// in memory together; their voxels are not.
pub(super) fn deck(
    brick_run: &BrickRun,
    solid: &StoredSolid,
    output: &Output,
    path: &Path,
) -> Result<OutputFile, RunError> {
    let StoredSolid { bricks, store } = solid;
    brick_run
        .progress
        .stage("elements", Some(bricks.len() as u64));
    let quiet = CancelOnly(brick_run.progress);
    let context = bricks.context(brick_run, &quiet);
    let recipe = brick_run.inputs.recipe;
    let mut cubes = deck::cubes(context, recipe, output)?;
    for brick in 0..bricks.len() {
        let region = bricks.region(brick);
        // Its voxels have the numbers that they have in the whole, whose voxel (0, 0, 0) is at the origin.
        let with_halo = part(context, store, region.grown(HALO), Coord([0; 3]))?;
        cubes
            .add(&with_halo, Some(region), context.session())
            .map_err(RunError::level_set("fe"))?;
        brick_run.progress.advance(1);
    }
    deck::write_cubes(context, recipe, Vec3::zeros(), &cubes, output, path)
}
