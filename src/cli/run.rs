//! `druse run RECIPE`, and `druse run PLAN --brick N`; `druse run FILE.vdb` is in `repeat`, plans of sequences are
//! in `sequence_plan`. Requirements that are not met give the exit code 1 after all files are written.

use super::context::Session;
use super::failure::Failure;
use super::numbers::{grouped, memory, size};
use super::output::Answer;
use super::run_text::reported;
use crate::pipeline;
use crate::pipeline::{Estimate, RunOptions, plan, run};
use crate::recipe::Recipe;
use crate::sequence::FrameList;
use clap::Args;
use serde_json::json;
use std::ops::Range;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct Parameters {
    /// The recipe (.toml), a plan (.json) whose bricks are to be made, or a .vdb that a run wrote: the run is
    /// repeated and the content hashes are compared.
    pub(super) recipe: PathBuf,
    /// Override a key of the recipe, as in tiling.cell=octet or op.2.dilate=0.2 (entries of arrays
    /// are numbered from 0).
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,
    /// Directory for the outputs [default: the recipe's own].
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Print an estimate of voxels, memory, disk and time, and stop.
    #[arg(long)]
    pub(super) dry_run: bool,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub(super) threads: usize,
    /// Memory that the run may use, as in 2G; a part that needs more is made in bricks on the disk
    /// [default: the memory of the machine].
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    pub(super) memory: Option<u64>,
    /// Make the part in bricks of N blocks of 128 voxels a side, regardless of the memory.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(super) bricks: Option<u32>,
    /// Frames to make, as in 1001-1240, 1-24x2 or 1,5,9-20x2: the recipe is run at each of them, with frame tokens
    /// ($F4, $F, ####, %04d) in its file names and frame, time and fps in its formulas. Frames whose recipe and
    /// inputs have not changed are left as they are.
    #[arg(long, value_name = "FRAMES", value_parser = super::frames::parse, allow_hyphen_values = true)]
    pub(super) frames: Option<FrameList>,
    /// The brick of a plan to make, or several as in 0-7; may be given again. Existing complete bricks are
    /// kept.
    #[arg(long, value_name = "N", value_parser = bricks)]
    pub(super) brick: Vec<Range<usize>>,
    /// Folder that the relative paths of a .vdb's recipe start from [default: the folder of the file].
    #[arg(long, value_name = "DIR")]
    pub(super) from: Option<PathBuf>,
}

/// Runs a recipe, a plan, a sequence, or the recipe of a `.vdb`: the name of the file and the flags decide.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let is_plan = p.recipe.extension().is_some_and(|e| e == "json");
    if is_plan && super::sequence_plan::is_sequence(&p.recipe) {
        return super::sequence_plan::make_items(p, session);
    }
    if is_plan || !p.brick.is_empty() {
        return make_bricks(p, is_plan, session);
    }
    if p.recipe
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("vdb"))
    {
        return super::repeat::answer(p, session);
    }
    if let Some(frames) = &p.frames {
        return sequence(p, frames, session);
    }
    if p.from.is_some() {
        return Err(Failure::usage(
            "found --from with a recipe; expected it with a .vdb only",
        ));
    }
    let recipe = Recipe::read(&p.recipe, &p.set)?;
    // A damaged grid of a cell can crash OpenVDB; a child opens it first.
    inspect_voxels(&recipe)?;
    let options = options(p, session)?;
    if p.dry_run {
        let estimate = plan(&recipe, &options, session)?;
        let json = serde_json::to_value(estimate).unwrap_or_default();
        return Ok(Answer::new(prediction(&estimate), json));
    }
    let report = run(&recipe, &options, session)?;
    Ok(reported(&report, session))
}

/// Runs the recipe at several frames; with `--dry-run` only the first is estimated.
fn sequence(p: &Parameters, frames: &FrameList, session: &Session) -> Result<Answer, Failure> {
    let options = options(p, session)?;
    let sequence = super::frames::Sequence {
        recipe: &p.recipe,
        set: &p.set,
        frames,
        options: &options,
    };
    let first = sequence.checked()?;
    inspect_voxels(&first)?;
    if p.dry_run {
        let estimate = plan(&first, &options, session)?;
        let count = frames.frames().len();
        let text = format!(
            "each of {count} frames, as the first\n{}",
            prediction(&estimate)
        );
        let json = json!({ "frames": frames.frames(), "each": estimate });
        return Ok(Answer::new(text, json));
    }
    sequence.run(session)
}

/// Opens the grids of cells within limits, in a child process, before the run does: a damaged file is an error then.
fn inspect_voxels(recipe: &Recipe) -> Result<(), Failure> {
    for cell in recipe.sections().cell.values() {
        if let Some(file) = &cell.voxels {
            super::vdb::inspect_voxels(&recipe.resolve(&file.path))?;
        }
    }
    Ok(())
}

/// The options of a run from its flags.
fn options(p: &Parameters, session: &Session) -> Result<RunOptions, Failure> {
    Ok(RunOptions {
        memory: p.memory,
        bricks: p.bricks,
        out: p.out.clone(),
        ..super::vdb::run_options(p.threads, session)?
    })
}

/// Makes some bricks of a plan; complete ones are left as they are.
fn make_bricks(p: &Parameters, is_plan: bool, session: &Session) -> Result<Answer, Failure> {
    if !is_plan {
        return Err(Failure::usage("--brick goes with a plan (.json)")
            .hint("druse plan RECIPE -o PLAN.json makes one"));
    }
    if p.brick.is_empty() || p.dry_run || !p.set.is_empty() || p.bricks.is_some() {
        return Err(Failure::usage(
            "a plan is run by --brick N; keys and sizes of bricks are fixed in it",
        ));
    }
    let options = RunOptions {
        memory: p.memory,
        ..super::vdb::run_options(p.threads, session)?
    };
    // Number of bricks that were complete already.
    let left = pipeline::make_bricks(&p.recipe, &p.brick, &options, session)?;
    session.finish();
    let made = p.brick.iter().map(ExactSizeIterator::len).sum::<usize>() - left;
    let text = format!("{made} bricks made, {left} were there");
    Ok(Answer::new(text, json!({ "made": made, "left": left })))
}

/// A prediction as lines; numbers that do not apply to the recipe are left out, as bricks of a run in memory.
fn prediction(e: &Estimate) -> String {
    let lines = [
        ("elements", grouped(e.elements)),
        ("blocks", grouped(e.blocks)),
        ("leaves", grouped(e.leaves)),
        ("active voxels", grouped(e.active_voxels)),
        ("peak memory", size(e.peak_memory_bytes)),
        ("tables", size(e.table_bytes)),
        ("on disk", size(e.disk_bytes)),
        ("bricks", grouped(e.bricks)),
        ("their size", size(e.brick_bytes)),
        (
            "homogenised",
            format!("{} cells", grouped(e.homogenised_cells)),
        ),
        ("time", format!("{:.1} s", e.seconds)),
    ];
    let shown = lines.iter().filter(|(name, _)| match *name {
        "bricks" | "their size" => e.bricks > 0,
        "tables" => e.table_bytes > 0,
        "blocks" | "leaves" | "active voxels" => e.leaves > 0 || e.homogenised_cells == 0,
        "homogenised" => e.homogenised_cells > 0,
        _ => true,
    });
    let shown: Vec<String> = shown
        .map(|(name, value)| format!("{name:<14}{value}"))
        .collect();
    shown.join("\n")
}

/// Parses "3" and "0-7" into a range whose end is excluded.
fn bricks(text: &str) -> Result<Range<usize>, String> {
    let parsed = match text.split_once('-') {
        Some((first, last)) => first.trim().parse().ok().zip(last.trim().parse().ok()),
        None => text.trim().parse().ok().map(|n| (n, n)),
    };
    parsed
        .filter(|&(first, last): &(usize, usize)| first <= last && last < usize::MAX)
        .map(|(first, last)| first..last + 1)
        .ok_or_else(|| format!("found {text:?}, expected a number or a range such as 0-7"))
}
