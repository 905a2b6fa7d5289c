//! Plans of sequences: one item per frame, and per brick where a frame has bricks.
//!
//! The plan of a sequence is a `.json` file that lists its items. Frames in bricks have plans of their own beside it.
//! `druse run PLAN --brick N` makes item N, `druse merge PLAN` completes the frames, as for a plan of bricks.

use super::context::Session;
use super::failure::Failure;
use super::frames::{Sequence, overrides, summary};
use super::job::Items;
use super::output::Answer;
use super::plan::Parameters;
use crate::pipeline::{
    RunOptions, brick_plan, check_overridden_outputs, finished_frame, frame_report, make_bricks,
    merge_bricks, out_of_plan, plan as estimate, shell_word,
};
use crate::recipe::Recipe;
use crate::sequence::FrameList;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Version of the format.
const VERSION: u32 = 1;

/// The plan of a sequence: recipe, overrides `set`, folder `out` of the outputs. Paths are relative to its folder.
#[derive(Serialize, Deserialize)]
pub(super) struct SequencePlan {
    /// Version of the format.
    druse_sequence: u32,
    recipe: PathBuf,
    set: Vec<String>,
    out: Option<PathBuf>,
    /// The items, in order of frame and brick.
    items: Vec<Item>,
}

/// A part of the work that one machine does.
#[derive(Clone, Serialize, Deserialize)]
struct Item {
    frame: i32,
    /// The plan of a frame in bricks and the brick; `None` where the item is a whole frame.
    plan: Option<PathBuf>,
    brick: Option<usize>,
}

/// Whether a file is the plan of a sequence.
pub(super) fn is_sequence(path: &Path) -> bool {
    read(path).is_ok()
}

/// Reads the plan of a sequence; any other file is an error.
fn read(path: &Path) -> Result<SequencePlan, Failure> {
    let text = std::fs::read_to_string(path).map_err(|e| crate::io::ReadError::io(path, e))?;
    let plan: SequencePlan = serde_json::from_str(&text).map_err(|e| {
        Failure::data(
            path,
            format!("{e}; expected a plan made by druse plan --frames"),
        )
    })?;
    if plan.druse_sequence != VERSION {
        let found = plan.druse_sequence;
        return Err(Failure::data(
            path,
            format!("found version {found} of the plan; expected {VERSION}"),
        ));
    }
    Ok(plan)
}

/// A plan of a sequence and its files.
pub(super) struct Planned {
    pub items: Items,
    pub files: Vec<PathBuf>,
}

/// Plans a sequence and writes its file, and a plan of its own beside it for each frame that needs bricks or is to
/// have them.
pub(super) fn plan(
    p: &Parameters,
    frames: &FrameList,
    options: &RunOptions,
    session: &Session,
) -> Result<Planned, Failure> {
    let sequence = Sequence {
        recipe: &p.recipe,
        set: &p.set,
        frames,
        options,
    };
    sequence.checked()?;
    let folder = p.output.parent().unwrap_or(Path::new(""));
    let mut items = Vec::new();
    let mut files = vec![p.output.clone()];
    let mut memory_bytes = 0;
    for &frame in frames.frames() {
        session.require_running()?;
        let recipe = sequence.at(frame)?;
        // A frame that fits into memory is one item; else each of its bricks is.
        if p.bricks.is_none() {
            let estimate = estimate(&recipe, options, session)?;
            if estimate.bricks == 0 {
                memory_bytes = memory_bytes.max(estimate.peak_memory_bytes);
                items.push(Item {
                    frame,
                    plan: None,
                    brick: None,
                });
                continue;
            }
        }
        let path = frame_plan_path(&p.output, frame);
        refuse_other_file(&path)?;
        let bricks = brick_plan(&recipe, &path, options, session)?;
        memory_bytes = memory_bytes.max(bricks.memory_bytes);
        let name = PathBuf::from(path.file_name().unwrap_or_default());
        items.extend((0..bricks.bricks.len()).map(|brick| Item {
            frame,
            plan: Some(name.clone()),
            brick: Some(brick),
        }));
        files.push(path);
    }
    let plan = SequencePlan {
        druse_sequence: VERSION,
        recipe: crate::pipeline::relative_path(&p.recipe, folder),
        set: p.set.clone(),
        out: p
            .out
            .as_deref()
            .map(|out| crate::pipeline::relative_path(out, folder)),
        items,
    };
    let text = serde_json::to_string_pretty(&plan).unwrap_or_default();
    crate::io::atomic::write_bytes(&p.output, format!("{text}\n").as_bytes())?;
    Ok(Planned {
        items: Items {
            count: plan.items.len(),
            memory_bytes,
            out: super::plan::out_elsewhere(p, session),
        },
        files,
    })
}

/// Refuses to replace a file that is no plan by the plan of a frame, whose name the user does not give.
fn refuse_other_file(path: &Path) -> Result<(), Failure> {
    let Ok(text) = std::fs::read(path) else {
        return Ok(());
    };
    let plan: Value = serde_json::from_slice(&text).unwrap_or_default();
    if plan["recipe_blake3"].is_string() && plan["bricks"].is_array() {
        return Ok(());
    }
    let message = "found a file that is no plan; expected the plan of a frame, or nothing there";
    Err(Failure::output(path, message).hint("another name for the plan: -o PLAN.json"))
}

/// `seq.json` at frame 7 is `seq.0007.json`.
fn frame_plan_path(plan: &Path, frame: i32) -> PathBuf {
    let stem = plan.file_stem().unwrap_or_default().to_string_lossy();
    let sign = if frame < 0 { "-" } else { "" };
    plan.with_file_name(format!("{stem}.{sign}{:04}.json", frame.unsigned_abs()))
}

/// A plan with its recipe and the options of its runs.
struct Opened {
    plan: SequencePlan,
    folder: PathBuf,
    recipe: PathBuf,
    options: RunOptions,
    frames: FrameList,
}

impl Opened {
    /// Opens the plan of a sequence, and checks that it has items, that the plans of its frames lie beside it, and that
    /// its overrides send no output elsewhere: a plan may come from another machine.
    fn new(path: &Path, options: RunOptions) -> Result<Self, Failure> {
        let plan = read(path)?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let out = out_of_plan(path, options.out.as_deref(), plan.out.as_deref())?;
        let frames = FrameList::of(plan.items.iter().map(|i| i.frame));
        if frames.frames().is_empty() {
            return Err(Failure::data(
                path,
                "found no items; expected at least one frame",
            ));
        }
        // Bricks lie beside their plans, which druse plan writes beside this one.
        let plans = plan.items.iter().filter_map(|i| i.plan.as_deref());
        let mut elsewhere = plans.filter(|p| p.file_name() != Some(p.as_os_str()));
        if let Some(other) = elsewhere.next() {
            let found = format!("found the plan {} of a frame", other.display());
            let message = format!("{found}; expected the name of a file beside this one");
            return Err(Failure::data(path, message));
        }
        let recipe = folder.join(&plan.recipe);
        let set = overrides(&plan.set, frames.frames()[0]);
        check_overridden_outputs(path, &Recipe::read(&recipe, &set)?, &set)?;
        Ok(Self {
            recipe,
            options: RunOptions { out, ..options },
            frames,
            folder,
            plan,
        })
    }

    /// The sequence that the plan describes.
    fn sequence(&self) -> Sequence<'_> {
        Sequence {
            recipe: &self.recipe,
            set: &self.plan.set,
            frames: &self.frames,
            options: &self.options,
        }
    }
}

/// `druse run PLAN --brick N` on the plan of a sequence: makes the items of these numbers, unless they are there.
pub(super) fn make_items(p: &super::run::Parameters, session: &Session) -> Result<Answer, Failure> {
    if p.brick.is_empty()
        || p.dry_run
        || !p.set.is_empty()
        || p.bricks.is_some()
        || p.frames.is_some()
    {
        return Err(Failure::usage(
            "a plan is run by --brick N; keys, frames and sizes of bricks are fixed in it",
        ));
    }
    let options = RunOptions {
        memory: p.memory,
        out: p.out.clone(),
        ..super::vdb::run_options(p.threads, session)?
    };
    let opened = Opened::new(&p.recipe, options)?;
    let count = opened.plan.items.len();
    let (mut made, mut left, mut passed) = (0, 0, true);
    for n in p.brick.iter().flat_map(Clone::clone) {
        session.require_running()?;
        // Numbers come from the command line.
        let Some(item) = opened.plan.items.get(n) else {
            return Err(Failure::data(
                &p.recipe,
                format!(
                    "found item {n} in the request; expected numbers from 0 to {}",
                    count - 1
                ),
            ));
        };
        // An item is a brick of a frame's plan, or a whole frame.
        let is_new = if let (Some(plan), Some(brick)) = (&item.plan, item.brick) {
            let plan = opened.folder.join(plan);
            let bricks = brick..brick + 1;
            let bricks = std::slice::from_ref(&bricks);
            let skipped = make_bricks(&plan, bricks, &opened.options, session)?;
            skipped == 0
        } else {
            let (_, answer, is_new) = opened.sequence().make(item.frame, session)?;
            passed &= answer.passed();
            is_new
        };
        // The line of progress of each item ends here.
        session.finish();
        made += usize::from(is_new);
        left += usize::from(!is_new);
    }
    let text = format!("{made} items made, {left} were there");
    Ok(Answer::new(text, json!({ "made": made, "left": left })).verdict(passed))
}

/// `druse merge PLAN` on the plan of a sequence: merges frames in bricks and writes the scenes. Frames that are
/// complete are left as they are.
pub(super) fn merge(
    path: &Path,
    options: RunOptions,
    session: &Session,
) -> Result<Answer, Failure> {
    let opened = Opened::new(path, options)?;
    let mut reports: Vec<(i32, Value)> = Vec::new();
    let mut lines = Vec::new();
    let (mut made, mut passed) = (0, true);
    for &frame in opened.frames.frames() {
        session.require_running()?;
        let recipe = Recipe::read(&opened.recipe, &overrides(&opened.plan.set, frame))?;
        let report_path = frame_report(&recipe, opened.options.out.as_deref());
        // Whole frames are complete already, and so are frames that an earlier merge made.
        if let Some(report) = finished_frame(&recipe, &report_path) {
            reports.push((frame, report));
            continue;
        }
        let item = opened.plan.items.iter().find(|i| i.frame == frame);
        let Some(plan) = item.and_then(|i| i.plan.as_ref()) else {
            return Err(Failure::data(
                path,
                format!(
                    "found no files of frame {frame}, or files of other inputs; \
                expected those that druse run {} --brick N makes",
                    shell_word(&path.display().to_string())
                ),
            ));
        };
        let options = RunOptions {
            report: Some(report_path),
            ..opened.options.clone()
        };
        let report = merge_bricks(&opened.folder.join(plan), &options, session)?;
        reports.push((frame, serde_json::to_value(&report).unwrap_or_default()));
        let answer = super::run_text::reported(&report, session);
        passed &= answer.passed();
        lines.push(answer.into_parts().0);
        made += 1;
    }
    let scenes = opened.sequence().scenes(&reports)?;
    Ok(summary(&reports, made, &scenes, lines).verdict(passed))
}
