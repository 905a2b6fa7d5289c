//! From a recipe to files: the module that connects all stages.
//!
//! [`plan`] predicts a run. [`run`] executes it: it reads the inputs, combines them into one field, samples
//! the narrow band, applies level-set operations, measures the solid and writes the outputs atomically.
//!
//! ```
//! use druse::pipeline::{RunOptions, run};
//! use druse::progress::Silent;
//! use druse::recipe::Recipe;
//! let text = "druse = 1\n[band]\nvoxel_size = 0.25\n[[op]]\nunion = { sphere = { radius = 5 } }\n";
//! let recipe = Recipe::parse(text, &[]).unwrap();
//! let report = run(&recipe, &RunOptions::default(), &Silent).unwrap();
//! let volume = 4.0 / 3.0 * std::f64::consts::PI * 125.0;
//! assert!((report.solid.volume / volume - 1.0).abs() < 0.01);
//! ```

use crate::band::{BandStats, Region};
use crate::progress::{Progress, Threads};
use crate::recipe::Recipe;
use crate::vdb::LevelSet;

mod attributes;
mod beams;
mod bricks;
mod build;
mod cavities;
mod cell_cache;
mod cells;
mod chain;
mod crystals;
mod cut_faces;
mod decimate;
mod deck;
mod drains;
mod effective;
mod error;
mod estimate;
mod field_data;
mod field_grid;
mod field_ops;
mod file_measures;
mod fit_options;
mod fractions;
mod frames;
mod grade;
mod grading;
mod group;
mod histogram;
mod homogenize;
mod input_files;
mod inputs;
mod lattice;
mod least_wall;
mod level_set_ops;
mod macro_deck;
mod measure;
mod memory;
mod meshing;
mod motion;
mod nearest;
mod offsets;
mod output;
mod output_targets;
mod palette;
mod period_samples;
mod plot;
mod precision;
mod report;
mod requirements;
mod round_beams;
mod run_cache;
mod run_options;
mod sampling;
mod scaffold;
mod scattered_data;
mod sheets;
mod slices;
mod source;
mod spatial_bins;
mod spatial_value;
mod stage_timer;
mod standalone;
mod targets;
mod thickness;
mod tiling;
mod usda;
mod view;
mod volumes;
mod voxels;
mod warning;

pub use bricks::{BrickPlan, brick_plan, make_bricks, merge_bricks};
pub(crate) use bricks::{check_overridden_outputs, out_of_plan, relative_path};
pub use build::{BuildReport, ProfileStep, StartReport};
pub use cavities::{CavitiesReport, CavityReport};
pub use cells::{make_cell, own_element, with_level};
pub(crate) use cells::{one_element, read_source};
pub(crate) use crystals::{clock_parameters, crystal_script};
pub use drains::DrainReport;
pub use error::RunError;
pub use estimate::Estimate;
pub(crate) use file_measures::{level_set_cavities, level_set_layers};
pub(crate) use fit_options::fit_options;
pub use frames::{
    check_frames, check_output_tokens, check_series, finished_frame, frame_report,
    write_sequence_scenes,
};
pub use grade::{GradeOptions, GradeReport, GradeRule, grade};
pub use grading::{GradedQuantity, level_shifts};
pub(crate) use group::{group_fault, read_group};
pub use histogram::Histogram;
pub use homogenize::{
    CellPeriod, CellProperties, PropertyOptions, beam_period, cell_period, cell_properties,
    period_warnings, resolution_fault,
};
pub(crate) use homogenize::{recipe_period, sampled, shares_of};
pub(crate) use lattice::solid_picture;
pub use macro_deck::{MacroDeckFacts, MacroLawFacts};
pub use plot::{Curve, Plot, contact_sheet, contact_sheet_columns, plot};
pub(crate) use plot::{SweepCurve, modulus_picture, sweep_picture};
pub use report::{
    BandReport, BricksReport, ContinuityReport, Input, MeshFacts, OffsetMethod, OffsetReport,
    OutputFile, Report, RequestedThickness, ScaffoldReport, SolidReport, Stage, ThicknessReport,
    Warning,
};
pub use requirements::Requirement;
pub(crate) use requirements::{judge_level_set, judge_mesh};
pub use run_cache::RunCache;
pub use run_options::RunOptions;
pub(crate) use sampling::FieldSample;
#[doc(hidden)]
pub use sampling::Probe;
pub use slices::{SliceOptions, SliceSummary, slice};
pub use source::{CellFault, set_source};
pub use targets::design;
pub(crate) use view::{cell_block, few_triangles, scaffold_of, solid_extent, wall_thickness};

use inputs::Inputs;
use level_set_ops::StageContext;
use macro_deck::needs_no_voxels;
use measure::{measure, refuse_torn};
pub(crate) use output_targets::{REPORT_NAME, check_confined};
use output_targets::{Targets, output_targets};
use stage_timer::StageTimer;
use thickness::{SolidGeometry, Thickness};

/// Predicts what [`run`] needs and writes, in a few seconds.
///
/// # Errors
/// As [`run`], but for outputs; too little memory is not an error here.
pub fn plan(
    recipe: &Recipe,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Estimate, RunError> {
    let threads = threads(options)?;
    let inputs = Inputs::load(recipe, &threads, options, progress)?;
    if needs_no_voxels(recipe) {
        return estimate::of_macro_decks(&inputs);
    }
    let mut estimate = estimate::estimate(&inputs, &threads, progress)?;
    match bricks::plan_if_needed(&inputs, &threads, options, progress) {
        Ok(Some(plan)) => {
            estimate.bricks = plan.bricks.len() as u64;
            estimate.brick_bytes = bricks::brick_bytes(&inputs, &plan);
            estimate.peak_memory_bytes = plan.memory_bytes;
        }
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

/// As [`run`]; also returns the level set, unless the run goes through bricks.
///
/// # Errors
/// As [`run`].
pub fn run_keeping_solid(
    recipe: &Recipe,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<(Report, Option<LevelSet>), RunError> {
    check_frames(recipe, &[recipe.clock().frame])?;
    let threads = threads(options)?;
    let sections = recipe.sections();
    let mut timer = StageTimer::new(progress);
    let mut inputs = Inputs::load(recipe, &threads, options, progress)?;
    inputs.expect(&options.expected_inputs)?;
    let outputs = output_targets(&inputs, options.out.as_deref(), options)?;
    timer.end_stage("inputs")?;
    if needs_no_voxels(recipe) {
        let context = StageContext::new(recipe, &threads, progress);
        let results = macro_deck::write_all(context, &inputs, &outputs, &mut timer)?;
        let report = finish_report(inputs, results, (&threads, true), &outputs, timer)?;
        return Ok((report, None));
    }

    let needs_bricks = bricks::plan_if_needed(&inputs, &threads, options, progress)?;
    timer.end_stage("estimate")?;
    if let Some(plan) = needs_bricks {
        let results = bricks::run(&inputs, plan, options, &threads, &outputs, &mut timer)?;
        let report = finish_report(inputs, results, (&threads, options.brief), &outputs, timer)?;
        return Ok((report, None));
    }

    let mut context = StageContext::new(recipe, &threads, progress);
    let first = inputs.field_operation_count();
    let (mut solid, stats) = if let Some(start) = inputs.volumes.take_start() {
        (start, BandStats::default())
    } else {
        inputs.clear_visits();
        context.sample(&field_ops::shape(&inputs, context.scale)?, "band")?
    };
    timer.end_stage("band")?;

    let mut measured = SolidReport::default();
    for (n, op) in sections.op.iter().enumerate().skip(first) {
        level_set_ops::apply(&mut context, &inputs, (n, op), &mut solid, &mut measured)?;
        timer.end_stage(&format!("op.{n}.{}", op.name()))?;
    }

    refuse_torn(context, &inputs, &solid, Region::EVERYWHERE)?;
    timer.end_stage("check")?;
    let needs_mesh = !options.brief || outputs.needs_mesh();
    let mesh = measure(
        context,
        &inputs,
        &solid,
        &mut measured,
        (needs_mesh, !options.brief),
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
    let measured_mesh = mesh.as_ref().filter(|_| outputs.needs_thickness());
    let thickness = measured_mesh.map(|mesh| {
        let thickness =
            Thickness::of_mesh(context, mesh, SolidGeometry::of(context, &solid, mesh)?)?;
        timer.end_stage("thickness")?;
        Ok::<_, RunError>(thickness)
    });
    let thickness = thickness.transpose()?;
    // A mesh that no output writes has served its purpose; its memory is freed.
    let mesh = mesh.filter(|_| outputs.writes_meshes());
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
    let report = finish_report(inputs, results, (&threads, options.brief), &outputs, timer)?;
    Ok((report, Some(solid)))
}

/// Results of the stages of a run.
struct StageResults {
    band: BandReport,
    solid: SolidReport,
    bricks: Option<BricksReport>,
    outputs: Vec<OutputFile>,
}

/// Checks the finished solid, judges the requirements and writes the report.
fn finish_report(
    mut inputs: Inputs,
    results: StageResults,
    (threads, is_brief): (&Threads, bool),
    outputs: &Targets,
    mut timer: StageTimer,
) -> Result<Report, RunError> {
    let scale = crate::recipe::Scale {
        voxel_size: results.band.voxel_size,
        ..inputs.recipe.scale()
    };
    inputs.check_solid(&results.solid, scale)?;
    let mut continuity = None;
    let certified = inputs
        .tiling()
        .filter(|_| requests_certificate(inputs.recipe));
    if let Some(tiling) = certified {
        let found = threads.install(|| tiling.certificate())?;
        continuity = Some(ContinuityReport::from(&found));
        timer.end_stage("certificate")?;
    }
    let dropped = results.outputs.iter().filter_map(deck::dropped);
    let notes = results.outputs.iter().flat_map(macro_deck::warnings);
    for message in dropped.chain(notes) {
        inputs.warn(Warning::DECK, message)?;
    }
    if let Some(message) = continuity.as_ref().and_then(ContinuityReport::warning) {
        inputs.warn(Warning::CONTINUITY, message)?;
    }
    let mut report = Report {
        band: BandReport {
            elements_visited: inputs.elements_visited(),
            leaves_by_nodes: inputs.leaves_by_nodes(),
            kernel: inputs.kernel(),
            ..results.band
        },
        solid: results.solid,
        bricks: results.bricks,
        outputs: results.outputs,
        threads: threads.count(),
        continuity,
        ..inputs.report()
    };
    let require = inputs.recipe.sections().require.as_ref();
    if let Some(require) = require.filter(|_| !is_brief) {
        report.solid.mass = requirements::mass(require, &report.solid, scale.unit);
        report.requirements = requirements::judge(require, &report, scale);
    }
    report.stages = timer.stages;
    report.peak_memory_bytes = memory::peak();
    for path in &outputs.reports {
        let text = serde_json::to_string_pretty(&report)
            .map_err(|e| RunError::Empty(format!("writing the report: {e}")))?;
        crate::io::atomic::write_bytes(path, format!("{text}\n").as_bytes())?;
    }
    Ok(report)
}

/// Whether the recipe requests the continuity certificate.
fn requests_certificate(recipe: &Recipe) -> bool {
    let tiling = recipe.sections().tiling.as_ref();
    let require = recipe.sections().require.as_ref();
    tiling.is_some_and(|t| t.certificate) || require.is_some_and(|r| r.value_jump_max.is_some())
}

fn threads(options: &RunOptions) -> Result<Threads, RunError> {
    Threads::new(options.threads).map_err(|e| RunError::Threads(e.to_string()))
}
