//! The end of a run: verdicts on the finished solid, and the report. All ways of running end here, in memory, in
//! bricks, and decks without a solid.

use super::output_targets::Targets;
use super::{deck, macro_deck};
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::memory;
use crate::pipeline::base::report::{BandReport, ContinuityReport, Report, StageResults};
use crate::pipeline::base::stage_timer::StageTimer;
use crate::pipeline::base::warning::Warning;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::inputs::run_options::RunOptions;
use crate::pipeline::measure::requirements;
use crate::progress::Threads;
use crate::recipe::Recipe;

/// What a run judges at its end.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Judging {
    /// The requirements of the recipe.
    Requirements,
    /// Nothing: a brief run, or one without a solid.
    Nothing,
}

impl Judging {
    /// What a run with these options judges.
    pub fn of(options: &RunOptions) -> Self {
        if options.brief {
            Self::Nothing
        } else {
            Self::Requirements
        }
    }
}

/// Checks the finished solid, judges the requirements and writes the report to all its paths. A requirement that
/// is not met is no error here; a warning is one in a strict run.
pub(crate) fn finish_report(
    mut inputs: Inputs,
    results: StageResults,
    threads: &Threads,
    judging: Judging,
    outputs: &Targets,
    mut timer: StageTimer,
) -> Result<Report, RunError> {
    // Resampling may have changed the voxels: those of the results count.
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
        continuity = Some(tiling.continuity(&found));
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
    if let Some(require) = require.filter(|_| judging == Judging::Requirements) {
        report.solid.mass = requirements::mass(require, &report.solid, scale.unit);
        report.requirements = requirements::judge(require, &report, scale);
    }
    // Times and memory come last, so that they include the verdicts.
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
