//! From leaf files to the files of a run, without the tree in memory.

use super::super::error::RunError;
use super::super::operate::Bench;
use super::super::report::{BandReport, BricksReport, OutputFile, SolidReport};
use super::super::{Clock, Parts, Targets, output};
use super::Yard;
use super::measure::{measure, picture};
use super::meshes::Meshes;
use super::volumes::Volumes;
use super::walls::least_wall;
use crate::vdb::stored_components;
use std::path::Path;

/// Opens all bricks, measures the solid and writes the outputs. `plan` is the plan's file, where the
/// bricks were made one by one; walls are measured unless it shall be brief.
pub(super) fn gather(
    yard: &Yard,
    plan: Option<&Path>,
    (targets, is_brief): (&Targets, bool),
    clock: &mut Clock,
) -> Result<Parts, RunError> {
    let count = yard.plan.bricks.len();
    let mut solid = SolidReport::default();
    let store = yard.finished(plan, &mut solid, clock)?;
    let recipe = yard.stock.recipe;
    let bench = Bench::new(recipe, yard.threads, yard.progress);
    let pieces = stored_components(&store, bench.scale.voxel_size, bench.session())?;
    clock.lap("pieces")?;
    let mut meshes = Meshes::create(yard, targets)?;
    let found = measure(yard, &store, &mut meshes)?;
    let mut meshes = meshes.commit()?;
    clock.lap("mesh")?;
    let wall = if is_brief {
        None
    } else {
        let wall = least_wall(yard, &store)?;
        clock.lap("walls")?;
        wall
    };
    let volumes = Volumes::new(yard, &store, found.frame)?;
    if volumes.are_shaded() {
        clock.lap("grids")?;
    }
    let mut outputs = Vec::new();
    for (output, path) in &targets.files {
        if output.picture.is_some() {
            picture(yard, &store, (output, path), found.frame)?;
            outputs.push(output::listed(path, None)?);
            clock.lap("picture")?;
            continue;
        }
        if output.mesh.is_some() {
            let unit = output.unit_or_default(recipe.unit());
            outputs.push(OutputFile {
                mesh: meshes.remove(path),
                ..output::listed(path, Some(unit))?
            });
        } else {
            outputs.extend(volumes.write(output, path)?);
        }
        clock.lap("write")?;
    }
    let (asked, cell) = yard.stock.fractions();
    Ok(Parts {
        band: BandReport {
            voxel_size: bench.scale.voxel_size,
            half_width: bench.half_width,
            active_voxels: store.active_voxels(),
            leaves: store.leaves(),
            ..BandReport::default()
        },
        solid: SolidReport {
            volume: found.volume,
            area: found.area,
            bounds: Some(found.bounds),
            volume_fraction: yard.stock.room().map(|room| found.volume / room),
            volume_fraction_asked: asked,
            volume_fraction_cell: cell,
            components: pieces.len() as u64,
            least_wall: wall.map(|w| w.thickness),
            least_wall_place: wall.map(|w| w.place.into()),
            ..solid
        },
        bricks: Some(BricksReport {
            count: count as u64,
            edge: yard.plan.edge,
            halo: yard.plan.halo,
            found_whole: 0,
        }),
        outputs,
    })
}
