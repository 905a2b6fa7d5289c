//! The merge of bricks: from leaf files to measures and outputs, without the whole tree in memory. It gives the figures
//! of a run in memory; only inscribed balls are sampled otherwise and limited in size.

use super::BrickRun;
use super::deck::deck;
use super::least_wall::sampled_walls;
use super::measure::{measure, picture};
use super::meshes::Meshes;
use super::thickness::thickness;
use super::volumes::Volumes;
use crate::frame::Vec3;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::layer_facts::BuildReport;
use crate::pipeline::base::report::{
    BandReport, BricksReport, OutputFile, SolidReport, StageResults,
};
use crate::pipeline::base::stage_timer::StageTimer;
use crate::pipeline::base::void_facts::CavitiesReport;
use crate::pipeline::measure::cut_faces::CutFaces;
use crate::pipeline::measure::least_wall::Phase;
use crate::pipeline::measure::{build, cavities};
use crate::pipeline::outputs::output_targets::Targets;
use crate::pipeline::outputs::{macro_deck, output};
use crate::vdb::{stored_build_layers, stored_cavities, stored_components, stored_voids};
use std::path::Path;

/// Opens all bricks, measures the solid and writes the outputs. `plan` is the plan's file if bricks were made one by
/// one. Unless the run is brief, walls are measured, and cavities, gaps and layers where the recipe requests them. The
/// sampling counts of the result are 0; the caller sets them.
pub(super) fn merge_and_write(
    brick_run: &BrickRun,
    plan: Option<&Path>,
    targets: &Targets,
    is_brief: bool,
    timer: &mut StageTimer,
) -> Result<StageResults, RunError> {
    let mut report = SolidReport::default();
    let solid = brick_run.assemble(plan, &mut report, timer)?;
    let recipe = brick_run.inputs.recipe;
    let context = solid.bricks.context(brick_run, brick_run.progress);
    let components = stored_components(&solid.store, context.scale.voxel_size, context.session())?;
    timer.end_stage("pieces")?;
    // The analysis of ways out counts closed cavities too. Without it the cheaper count of closed voids
    // is enough.
    let require = recipe.sections().require.as_ref().filter(|_| !is_brief);
    if let Some(require) = require.filter(|r| r.escape_radius.is_some()) {
        let h = context.scale.voxel_size;
        let reach = cavities::reach(require, context.scale);
        let found = stored_cavities(&solid.store, h, reach, context.session())?;
        let found = CavitiesReport::new(&found, Vec3::zeros(), h);
        report.closed_cavities = require.closed_cavities.map(|_| found.closed);
        report.cavities = Some(found);
        timer.end_stage("cavities")?;
    } else if require.is_some_and(|r| r.closed_cavities.is_some()) {
        let cavities = stored_voids(&solid.store, context.scale.voxel_size, context.session())?;
        report.closed_cavities = Some(cavities.len() as u64);
        timer.end_stage("cavities")?;
    }
    if let Some(section) = recipe.sections().build.as_ref().filter(|_| !is_brief) {
        let request = build::request(section, context.scale)?;
        let h = context.scale.voxel_size;
        let found = stored_build_layers(&solid.store, h, &request, context.session())?;
        report.build = Some(BuildReport::new(&request, &found, Vec3::zeros()));
        timer.end_stage("layers")?;
    }
    // Thickness is measured before the meshes and grids that show it.
    let thickness = if targets.needs_thickness() {
        let thickness = thickness(brick_run, &solid)?;
        timer.end_stage("thickness")?;
        Some(thickness)
    } else {
        None
    };
    let thickness = thickness.as_ref();
    // All mesh files grow together while the bricks are meshed once; the same patches give volume and
    // area.
    let mut meshes = Meshes::create(brick_run, &solid, targets, thickness)?;
    let found = measure(brick_run, &solid, &mut meshes)?;
    let mut meshes = meshes.commit()?;
    timer.end_stage("mesh")?;
    if !is_brief {
        let walls = sampled_walls(brick_run, &solid, Phase::Solid)?;
        let cut = CutFaces::new(brick_run.inputs, context.scale.voxel_size);
        report.add_walls(
            walls,
            brick_run.inputs.target_thickness(),
            &cut,
            brick_run.threads,
        );
        timer.end_stage("walls")?;
    }
    if require.is_some_and(|r| r.least_gap.is_some()) {
        report.add_gaps(sampled_walls(brick_run, &solid, Phase::Void)?);
        timer.end_stage("gaps")?;
    }
    // The volumes need the box of the solid, which the meshes gave.
    let volumes = Volumes::new(brick_run, &solid, found.frame, thickness)?;
    if volumes.has_more_than_surface() {
        timer.end_stage("grids")?;
    }
    let mut outputs = Vec::new();
    // The report lists the files in the order of the recipe.
    for (output, path) in &targets.files {
        if output.picture.is_some() {
            picture(brick_run, &solid, output, path, found.frame)?;
            outputs.push(output::file_entry(path, None)?);
            timer.end_stage("picture")?;
            continue;
        }
        if output.is_macro_deck() {
            outputs.push(macro_deck::write(context, brick_run.inputs, output, path)?);
            timer.end_stage("write")?;
            continue;
        }
        if output.fe.is_some() {
            outputs.push(deck(brick_run, &solid, output, path)?);
            timer.end_stage("write")?;
            continue;
        }
        if output.mesh.is_some() {
            let unit = output.unit_or_default(recipe.unit());
            outputs.push(OutputFile {
                mesh: meshes.remove(path),
                ..output::file_entry(path, Some(unit))?
            });
        } else {
            outputs.extend(volumes.write(output, path)?);
        }
        timer.end_stage("write")?;
    }
    let (target, cell_fraction) = brick_run.inputs.volume_fractions();
    Ok(StageResults {
        band: BandReport {
            voxel_size: context.scale.voxel_size,
            half_width: context.half_width,
            active_voxels: solid.store.active_voxels(),
            leaves: solid.store.leaves(),
            ..BandReport::default()
        },
        solid: SolidReport {
            volume: found.volume,
            area: found.area,
            bounds: Some(found.bounds),
            volume_fraction: brick_run
                .inputs
                .reference_volume()
                .map(|whole| found.volume / whole),
            volume_fraction_target: target,
            volume_fraction_cell: cell_fraction,
            components: components.len() as u64,
            ..report
        },
        bricks: Some(BricksReport {
            count: brick_run.first.len() as u64,
            edge: brick_run.plan.edge,
            halo: brick_run.plan.halo,
            found_whole: 0,
        }),
        outputs,
    })
}
