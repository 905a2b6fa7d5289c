//! From leaf files to the files of a run, without the tree in memory.

use super::super::cut_faces::CutFaces;
use super::super::error::RunError;
use super::super::least_wall::Phase;
use super::super::report::{BandReport, BricksReport, OutputFile, SolidReport};
use super::super::{Clock, Parts, Targets, output};
use super::Yard;
use super::deck::deck;
use super::least_wall::sampled_walls;
use super::measure::{measure, picture};
use super::meshes::Meshes;
use super::thickness::thickness;
use super::volumes::Volumes;
use crate::vdb::{stored_components, stored_voids};
use std::path::Path;

/// Opens all bricks, measures the solid and writes the outputs. `plan` is the plan's file, where the
/// bricks were made one by one; walls are measured unless it shall be brief.
pub(super) fn gather(
    yard: &Yard,
    plan: Option<&Path>,
    (targets, is_brief): (&Targets, bool),
    clock: &mut Clock,
) -> Result<Parts, RunError> {
    let mut report = SolidReport::default();
    let solid = yard.finished(plan, &mut report, clock)?;
    let recipe = yard.stock.recipe;
    let bench = solid.bricks.bench(yard, yard.progress);
    let pieces = stored_components(&solid.store, bench.scale.voxel_size, bench.session())?;
    clock.lap("pieces")?;
    let require = recipe.sections().require.as_ref().filter(|_| !is_brief);
    if require.is_some_and(|r| r.closed_cavities.is_some()) {
        let cavities = stored_voids(&solid.store, bench.scale.voxel_size, bench.session())?;
        report.closed_cavities = Some(cavities.len() as u64);
        clock.lap("cavities")?;
    }
    let thickness = if targets.want_thickness() {
        let thickness = thickness(yard, &solid)?;
        clock.lap("thickness")?;
        Some(thickness)
    } else {
        None
    };
    let thickness = thickness.as_ref();
    let mut meshes = Meshes::create(yard, &solid, targets, thickness)?;
    let found = measure(yard, &solid, &mut meshes)?;
    let mut meshes = meshes.commit()?;
    clock.lap("mesh")?;
    if !is_brief {
        let walls = sampled_walls(yard, &solid, Phase::Solid)?;
        let cut = CutFaces::new(yard.stock, bench.scale.voxel_size);
        report.add_walls(walls, yard.stock.thickness_asked(), &cut, yard.threads);
        clock.lap("walls")?;
    }
    if require.is_some_and(|r| r.least_gap.is_some()) {
        report.add_gaps(sampled_walls(yard, &solid, Phase::Void)?);
        clock.lap("gaps")?;
    }
    let volumes = Volumes::new(yard, &solid, found.frame, thickness)?;
    if volumes.are_many() {
        clock.lap("grids")?;
    }
    let mut outputs = Vec::new();
    for (output, path) in &targets.files {
        if output.picture.is_some() {
            picture(yard, &solid, (output, path), found.frame)?;
            outputs.push(output::listed(path, None)?);
            clock.lap("picture")?;
            continue;
        }
        if output.fe.is_some() {
            outputs.push(deck(yard, &solid, output, path)?);
            clock.lap("write")?;
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
            active_voxels: solid.store.active_voxels(),
            leaves: solid.store.leaves(),
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
            ..report
        },
        bricks: Some(BricksReport {
            count: yard.first.len() as u64,
            edge: yard.plan.edge,
            halo: yard.plan.halo,
            found_whole: 0,
        }),
        outputs,
    })
}
