//! A run in the order of its stages, and its prediction: inputs, estimate, band (the sampling), operations, check,
//! measures, outputs, report. A run in bricks has the same stages brick by brick. Files appear only when they are
//! complete; one that is complete when a later one fails stays.

use super::base::context::StageContext;
use super::base::error::RunError;
use super::base::report::{BandReport, Report, SolidReport, StageResults};
use super::base::stage_timer::StageTimer;
use super::content::inputs::Inputs;
use super::estimate::Estimate;
use super::field::field_ops;
use super::frames::check_frames;
use super::inputs::run_options::{RunOptions, threads};
use super::measure::solid_measures::{measure, refuse_torn};
use super::measure::thickness::{SolidGeometry, Thickness};
use super::ops::level_set_ops;
use super::outputs::macro_deck::needs_no_voxels;
use super::outputs::output_targets::output_targets;
use super::outputs::run_report::{Judging, finish_report};
use super::outputs::{macro_deck, output};
use super::{bricks, estimate};
use crate::band::{BandStats, Region};
use crate::progress::Progress;
use crate::recipe::Recipe;
use crate::vdb::LevelSet;

/// Predicts what [`run`] needs and writes, in a few seconds.
///
/// # Errors
/// As [`run`], but for outputs; too little memory is not an error here, unless bricks are requested.
pub fn plan(
    recipe: &Recipe,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Estimate, RunError> {
    let threads = threads(options)?;
    let inputs = Inputs::load(recipe, &threads, options, progress)?;
    let mut estimate = Estimate::default();
    if needs_no_voxels(recipe) {
        estimate.add_macro_decks(&inputs)?;
        return Ok(estimate);
    }
    let counts = estimate::counts(&inputs, &threads, progress)?;
    estimate = estimate::predict(&inputs, &threads, &counts);
    match bricks::plan_if_needed(&inputs, &threads, options, progress) {
        Ok(Some(plan)) => {
            estimate.bricks = plan.bricks.len() as u64;
            estimate.brick_bytes = bricks::brick_bytes(&inputs, &plan);
            estimate.peak_memory_bytes = plan.memory_bytes;
        }
        // `Ok(None)` is a run in memory. Too little memory is a fact of the prediction; the run itself refuses.
        Ok(None)
        | Err(
            RunError::Memory { .. } | RunError::BricksUnsupported { .. } | RunError::Budget { .. },
        ) => {}
        Err(other) => return Err(other),
    }
    estimate.add_macro_decks(&inputs)?;
    Ok(estimate)
}

/// Runs a recipe and writes its outputs.
///
/// # Errors
/// [`RunError`]: a fault of the recipe, an input, an output or the solid; too little memory; cancellation.
pub fn run(
    recipe: &Recipe,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Report, RunError> {
    run_keeping_solid(recipe, options, progress).map(|r| r.0)
}

/// As [`run`]; also returns the level set, unless the run goes through bricks or samples nothing.
///
/// # Errors
/// As [`run`].
pub fn run_keeping_solid(
    recipe: &Recipe,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<(Report, Option<LevelSet>), RunError> {
    // A missing file of a series is named with the frames that exist.
    check_frames(recipe, &[recipe.clock().frame])?;
    let threads = threads(options)?;
    log::debug!(target: "druse::run",
        "run with {} threads, instructions: {:?}",
        threads.count(),
        crate::simd::instruction_set()
    );
    let sections = recipe.sections();
    let mut timer = StageTimer::new(progress);
    let mut inputs = Inputs::load(recipe, &threads, options, progress)?;
    inputs.expect(&options.expected_inputs)?;
    let outputs = output_targets(&inputs, options.out.as_deref(), options)?;
    timer.end_stage("inputs")?;
    // Decks of the scaffold's elements alone: the solid is never sampled.
    if needs_no_voxels(recipe) {
        let context = StageContext::new(recipe, &threads, progress);
        let results = macro_deck::write_all(context, &inputs, &outputs, &mut timer)?;
        let report = finish_report(inputs, results, &threads, Judging::Nothing, &outputs, timer)?;
        return Ok((report, None));
    }

    let needs_bricks = bricks::plan_if_needed(&inputs, &threads, options, progress)?;
    timer.end_stage("estimate")?;
    // Too large for the memory, or bricks are requested: the same stages brick by brick.
    if let Some(plan) = needs_bricks {
        let results = bricks::run(&inputs, plan, options, &threads, &outputs, &mut timer)?;
        let report = finish_report(
            inputs,
            results,
            &threads,
            Judging::of(options),
            &outputs,
            timer,
        )?;
        return Ok((report, None));
    }

    let mut context = StageContext::new(recipe, &threads, progress);
    let first = inputs.field_operation_count();
    // The tiling and all field operations are one field, sampled once; a file's level set needs no
    // sampling.
    let (mut solid, stats) = if let Some(start) = inputs.volumes.take_start() {
        (start, BandStats::default())
    } else {
        inputs.clear_visits();
        context.sample(&field_ops::shape(&inputs, context.scale)?, "band")?
    };
    timer.end_stage("band")?;

    let mut measured = SolidReport::default();
    for (n, op) in sections.op.iter().enumerate().skip(first) {
        level_set_ops::apply(&mut context, &inputs, n, op, &mut solid, &mut measured)?;
        timer.end_stage(&format!("op.{n}.{}", op.name()))?;
    }

    // Before anything is written: no program could read a torn surface.
    refuse_torn(context, &inputs, &solid, Region::EVERYWHERE)?;
    timer.end_stage("check")?;
    let mesh = measure(
        context,
        &inputs,
        &solid,
        &mut measured,
        !options.brief,
        &mut timer,
    )?;
    let info = solid.info().map_err(RunError::level_set("counting"))?;
    let band = BandReport {
        voxel_size: context.scale.voxel_size,
        half_width: context.half_width,
        active_voxels: info.active_voxels,
        leaves: info.leaves,
        active_voxels_sampled: stats.active_voxels,
        leaves_touched: stats.leaves_evaluated,
        leaves_kept: stats.leaves_kept,
        voxels_evaluated: stats.samples_evaluated,
        ..BandReport::default()
    };
    let thickness = outputs.needs_thickness().then(|| {
        let geometry = SolidGeometry::of(context, &solid, &mesh)?;
        let thickness = Thickness::of_mesh(context, &mesh, geometry)?;
        timer.end_stage("thickness")?;
        Ok::<_, RunError>(thickness)
    });
    let thickness = thickness.transpose()?;
    // A mesh that no output writes has served its purpose; its memory is freed.
    let mesh = Some(mesh).filter(|_| outputs.writes_meshes());
    let finished = output::FinishedSolid {
        inputs: &inputs,
        solid: &solid,
        mesh: mesh.as_ref(),
        thickness: thickness.as_ref(),
    };
    let mut written = Vec::new();
    for (output, path) in &outputs.files {
        written.extend(output::write(context, finished, output, path)?);
        timer.end_stage("write")?;
    }
    let results = StageResults {
        band,
        solid: measured,
        bricks: None,
        outputs: written,
    };
    let report = finish_report(
        inputs,
        results,
        &threads,
        Judging::of(options),
        &outputs,
        timer,
    )?;
    Ok((report, Some(solid)))
}
