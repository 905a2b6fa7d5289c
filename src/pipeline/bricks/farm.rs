//! Runs shared by several machines: a plan in a file, single bricks, and a merge.
//!
//! A plan fixes the bricks and everything that decides their values: recipe, inputs by their hashes, voxels,
//! kind of arithmetic. Each machine checks it against what it finds and makes some bricks; the merge makes all
//! later passes. Results equal those of a single machine to the bit.

use super::budget::{Budget, DiskNeed, brick_bytes, check_disks, held_bytes};
use super::directory::{Lock, clear, is_derived, make_directory, nearest_existing, size_of};
use super::{BrickPlan, BrickRun, check_disk, choose_layout, make_plan, merge_and_write};
use crate::io::leads_out;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::Report;
use crate::pipeline::base::stage_timer::StageTimer;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::estimate;
use crate::pipeline::inputs::run_options::{RunOptions, threads};
use crate::pipeline::outputs::output_targets::output_targets;
use crate::pipeline::outputs::run_report::{Judging, finish_report};
use crate::progress::{Progress, Threads};
use crate::recipe::Recipe;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Default memory of a process that makes bricks, bytes; the machine that plans may have more than those.
const DEFAULT_MEMORY: u64 = 2 << 30;
/// Greatest size of a plan's file, bytes.
const MAX_PLAN_BYTES: u64 = 256 << 20;

/// Plans a run in bricks and writes the plan to the file `path`. Its paths are relative to that file, so that
/// plan, recipe and inputs can move together.
///
/// # Errors
/// As [`run`](super::super::run); [`RunError::Memory`] or [`RunError::BricksUnsupported`] for a
/// recipe that cannot use bricks.
pub fn brick_plan(
    recipe: &Recipe,
    path: &Path,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<BrickPlan, RunError> {
    let threads = threads(options)?;
    let inputs = Inputs::load(recipe, &threads, options, progress)?;
    let counts = estimate::counts(&inputs, &threads, progress)?;
    let budget = Budget {
        bytes: options.memory.unwrap_or(DEFAULT_MEMORY),
        edge: options.bricks,
        held: held_bytes(&inputs),
    };
    let found = choose_layout(&inputs, &threads, &counts, &budget)?;
    let mut plan = make_plan(&inputs, &found, &counts, &threads, progress)?;
    let base = plan_directory(path);
    let file = recipe.source().path.clone().unwrap_or_default();
    plan.recipe = relative_path(&file, base);
    plan.out = options.out.as_deref().map(|out| relative_path(out, base));
    let text = serde_json::to_string_pretty(&plan).map_err(|e| plan_error(path, e.to_string()))?;
    crate::io::atomic::write_bytes(path, format!("{text}\n").as_bytes())?;
    Ok(plan)
}

/// Makes bricks of the plan in the file `path` and skips complete ones. `bricks` are ranges of their numbers, from
/// 0, end excluded. Returns the number skipped.
///
/// # Errors
/// As [`run`](super::super::run); [`RunError::Plan`] for a plan that is invalid or does not match the recipe and its
/// inputs, and for numbers that it does not have.
pub fn make_bricks(
    path: &Path,
    bricks: &[Range<usize>],
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<usize, RunError> {
    let (plan, recipe) = read_plan(path)?;
    // The numbers come from the command line. They are checked before any input is read.
    for range in bricks {
        if range.end > plan.bricks.len() || range.is_empty() {
            return Err(plan_error(
                path,
                format!(
                    "found bricks {} to {} in the request; expected numbers from 0 to {}",
                    range.start,
                    range.end.saturating_sub(1),
                    plan.bricks.len().saturating_sub(1)
                ),
            ));
        }
    }
    let threads = threads(options)?;
    let inputs = Inputs::load(&recipe, &threads, options, progress)?;
    let brick_run = open_run(path, plan, &inputs, &threads, progress)?;
    make_directory(&brick_run.directory)?;
    let requested: usize = bricks.iter().map(ExactSizeIterator::len).sum();
    // The plan predicts the bytes of all bricks; these take their share.
    let bytes_per_brick = brick_run.plan.leaf_bytes / brick_run.plan.bricks.len().max(1) as u64;
    check_disk(
        &brick_run.directory,
        bytes_per_brick.saturating_mul(requested as u64),
    )?;
    let mut skipped = 0;
    for range in bricks {
        skipped += brick_run
            .make_first_pass(range.clone())
            .map_err(|e| brick_run.as_stopped(e))?
            .1;
    }
    Ok(skipped)
}

/// Merges the bricks of the plan in the file `path` and writes the recipe's outputs. The bricks stay; files that
/// derive from them are removed after a success.
///
/// # Errors
/// As [`make_bricks`]; [`RunError::Bricks`] lists missing or damaged bricks; [`RunError::Busy`] when another
/// merge of the plan is at work.
pub fn merge_bricks(
    path: &Path,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Report, RunError> {
    let (plan, recipe) = read_plan(path)?;
    let mut timer = StageTimer::new(progress);
    let threads = threads(options)?;
    let inputs = Inputs::load(&recipe, &threads, options, progress)?;
    let brick_run = open_run(path, plan, &inputs, &threads, progress)?;
    // Two merges make files of the same names beside the bricks, and remove them.
    let _lock = Lock::take_of_existing(&brick_run.directory)?;
    // The folder that was given to `druse plan` holds unless the merge names another.
    let planned = brick_run.plan.out.as_deref();
    let out = out_of_plan(path, options.out.as_deref(), planned)?;
    let outputs = output_targets(&inputs, out.as_deref(), options)?;
    timer.end_stage("inputs")?;
    let bricks = brick_bytes(&inputs, brick_run.plan.leaf_bytes);
    let remaining = bricks.saturating_sub(size_of(&brick_run.directory));
    let files = estimate::disk_of_bricks(&inputs, brick_run.plan.leaf_bytes);
    let output_directory = outputs.files.first().and_then(|(_, path)| path.parent());
    let output_directory = nearest_existing(output_directory.unwrap_or(Path::new(".")));
    check_disks(
        DiskNeed {
            directory: &brick_run.directory,
            bytes: remaining,
        },
        DiskNeed {
            directory: output_directory,
            bytes: files,
        },
    )?;
    let results = merge_and_write(&brick_run, Some(path), &outputs, options.brief, &mut timer);
    let mut results = results.map_err(|e| brick_run.as_stopped(e))?;
    if let Some(bricks) = &mut results.bricks {
        bricks.found_whole = bricks.count;
    }
    let directory = brick_run.directory.clone();
    let report = finish_report(
        inputs,
        results,
        &threads,
        Judging::of(options),
        &outputs,
        timer,
    )?;
    // The bricks belong to the user; files derived from them are removed.
    clear(&directory, is_derived);
    Ok(report)
}

/// The brick directory of a plan, beside it.
fn directory(plan: &Path) -> PathBuf {
    plan.with_extension("bricks")
}

/// The directory that paths of a plan are relative to.
fn plan_directory(plan: &Path) -> &Path {
    plan.parent().unwrap_or(Path::new(""))
}

/// The error for the plan in the file `path`.
fn plan_error(path: &Path, message: String) -> RunError {
    RunError::Plan {
        plan: path.to_owned(),
        message,
    }
}

/// The folder of the outputs of a plan's run: the user's own, else the plan's, which must lie in the folder of the
/// plan, as a plan may come from elsewhere.
///
/// # Errors
/// [`RunError::Plan`].
pub(crate) fn out_of_plan(
    path: &Path,
    own: Option<&Path>,
    planned: Option<&Path>,
) -> Result<Option<PathBuf>, RunError> {
    let (None, Some(planned)) = (own, planned) else {
        return Ok(own.map(Path::to_owned));
    };
    let folder = plan_directory(path);
    if let Some(reason) = leads_out(folder, planned) {
        let shown = planned.display();
        let message = format!(
            "found the folder {shown} for the outputs, {reason}; expected one inside the folder of the plan, or \
             --out {}",
            folder.join(planned).display()
        );
        return Err(plan_error(path, message));
    }
    Ok(Some(folder.join(planned)))
}

/// Refuses outputs outside the folder of the recipe that only the overrides of a plan name. `set`
/// are the overrides, as `key=value`. A plan can come from another machine, and merging it must not
/// write anywhere on this one.
///
/// # Errors
/// [`RunError::Plan`].
pub(crate) fn check_overridden_outputs(
    path: &Path,
    recipe: &Recipe,
    set: &[String],
) -> Result<(), RunError> {
    let Some(file) = &recipe.source().path else {
        return Ok(());
    };
    // `trim_start_matches` allows for spaces and quotes around a key of TOML.
    // Outputs that the recipe itself names are trusted: they are those without overrides of `output`.
    let is_other = |pair: &&String| {
        !pair
            .trim_start_matches([' ', '"', '\''])
            .starts_with("output")
    };
    let set: Vec<String> = set.iter().filter(is_other).cloned().collect();
    let plain = Recipe::read(file, &set);
    let trusted = plain.iter().flat_map(|r| &r.sections().output);
    let trusted_names: Vec<&Path> = trusted
        .flat_map(|o| o.named())
        .map(|(_, name)| name)
        .collect();
    let names = recipe.sections().output.iter().flat_map(|o| o.named());
    for (_, name) in names.filter(|(_, name)| !trusted_names.contains(name)) {
        if let Some(reason) = leads_out(recipe.source().directory(), name) {
            let name = name.display();
            let message = format!(
                "found the output {name} in its overrides, {reason}; expected a name inside the folder of the recipe"
            );
            return Err(plan_error(path, message));
        }
    }
    Ok(())
}

/// Reads a plan and the recipe beside it, with the plan's overrides. Checks both, but not that they belong
/// together.
fn read_plan(path: &Path) -> Result<(BrickPlan, Recipe), RunError> {
    let failed = |e| crate::io::ReadError::io(path, e);
    if std::fs::metadata(path).map_err(failed)?.len() > MAX_PLAN_BYTES {
        return Err(plan_error(
            path,
            format!("more than {MAX_PLAN_BYTES} bytes; expected a plan"),
        ));
    }
    let text = std::fs::read_to_string(path).map_err(failed)?;
    let plan: BrickPlan = serde_json::from_str(&text)
        .map_err(|e| plan_error(path, format!("{e}; expected a plan made by druse plan")))?;
    plan.check().map_err(|m| plan_error(path, m))?;
    let file = plan_directory(path).join(&plan.recipe);
    if !file.is_file() {
        let message = format!(
            "its recipe {} is missing ({}); keep the relative position of plan and recipe",
            plan.recipe.display(),
            file.display()
        );
        return Err(plan_error(path, message));
    }
    let recipe = Recipe::read(&file, &plan.set)?;
    check_overridden_outputs(path, &recipe, &plan.set)?;
    Ok((plan, recipe))
}

/// The run of a plan, if the plan matches the recipe and its inputs.
fn open_run<'a>(
    path: &Path,
    plan: BrickPlan,
    inputs: &'a Inputs,
    threads: &'a Threads,
    progress: &'a dyn Progress,
) -> Result<BrickRun<'a>, RunError> {
    let found = plan.differences(inputs);
    if !found.is_empty() {
        let message = format!(
            "it does not match the recipe and inputs: {}",
            found.join("; ")
        );
        return Err(plan_error(path, message));
    }
    Ok(BrickRun::new(
        inputs,
        plan,
        directory(path),
        threads,
        progress,
    ))
}

/// A path relative to the directory `from`; unchanged if one of the two cannot be made absolute. Links are not
/// resolved.
pub(crate) fn relative_path(path: &Path, from: &Path) -> PathBuf {
    let absolute = |p: &Path| std::path::absolute(p).ok();
    let (Some(absolute_path), Some(from)) = (absolute(path), absolute(from)) else {
        return path.to_owned();
    };
    let components = |p: &Path| -> Vec<std::ffi::OsString> {
        p.components().map(|c| c.as_os_str().to_owned()).collect()
    };
    let (to, from) = (components(&absolute_path), components(&from));
    let common = to.iter().zip(&from).take_while(|(a, b)| a == b).count();
    let up = from[common..]
        .iter()
        .map(|_| std::ffi::OsString::from(".."));
    up.chain(to[common..].iter().cloned()).collect()
}
