//! `druse plan RECIPE -o PLAN`: plans the bricks or frames of a run for several machines, and job files for their
//! queues. No brick is made.

use super::context::Session;
use super::failure::Failure;
use super::job;
use super::job::{Items, Queue};
use super::numbers::{grouped, memory, size};
use super::output::Answer;
use crate::io::leads_out;
use crate::pipeline::{RunOptions, brick_plan, relative_path};
use crate::recipe::Recipe;
use crate::sequence::FrameList;
use clap::Args;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    /// The recipe (.toml).
    pub(super) recipe: PathBuf,
    /// The plan (.json). Bricks go into a directory beside it, `PLAN.bricks`; paths in it are relative
    /// to it, so that it may be moved together with the recipe and its inputs.
    #[arg(short, long, value_name = "FILE")]
    pub(super) output: PathBuf,
    /// Override a key of the recipe, as in tiling.cell=octet.
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,
    /// Directory for the outputs of the merge [default: the recipe's own].
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Memory of each machine; it determines the size of bricks.
    #[arg(long, value_name = "SIZE", value_parser = memory, default_value = "2G")]
    memory: u64,
    /// Edge of a brick in blocks of 128 voxels [default: the largest that fits the memory].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(super) bricks: Option<u32>,
    /// Frames to plan, as in 1001-1240, 1-24x2 or 1,5,9-20x2: one item of the plan per frame, and per brick where a
    /// frame needs bricks.
    #[arg(long, value_name = "FRAMES", value_parser = super::frames::parse, allow_hyphen_values = true)]
    frames: Option<FrameList>,
    /// Also write a job file for a queue beside the plan; may be given again.
    #[arg(long, value_name = "QUEUE", value_enum)]
    emit: Vec<Queue>,
    /// Worker threads of each brick in job files [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Plans the bricks or frames of a recipe and writes the plan and job files for queue systems beside it.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    if p.output.extension().is_none_or(|e| e != "json") {
        return Err(Failure::usage(format!(
            "found -o {}, expected a name that ends in .json",
            p.output.display()
        )));
    }
    crate::io::atomic::require_writable(&p.output)?;
    let options = RunOptions {
        memory: Some(p.memory),
        bricks: p.bricks,
        out: p.out.clone(),
        ..super::vdb::run_options(p.threads, session)?
    };
    // A sequence has a plan of frames, which may have bricks.
    if let Some(frames) = &p.frames {
        return sequence(p, frames, &options, session);
    }
    let recipe = Recipe::read(&p.recipe, &p.set)?;
    let plan = brick_plan(&recipe, &p.output, &options, session)?;
    let mut files = vec![p.output.clone()];
    let items = Items {
        count: plan.bricks.len(),
        memory_bytes: plan.memory_bytes,
        out: out_elsewhere(p, session),
    };
    files.extend(job_files(p, &items)?);
    session.finish();
    session.note(&format!(
        "{} bricks of {} voxels a side, halo {} voxels, about {} of leaf files and {} of memory",
        grouped(plan.bricks.len() as u64),
        plan.edge * 128, // voxels of a block
        plan.halo,
        size(plan.leaf_bytes),
        size(plan.memory_bytes)
    ));
    let lines: Vec<String> = files.iter().map(|f| f.display().to_string()).collect();
    let json = serde_json::json!({
        "bricks": plan.bricks.len(),
        "edge": plan.edge,
        "halo": plan.halo,
        "leaf_bytes": plan.leaf_bytes,
        "memory_bytes": plan.memory_bytes,
        "files": lines,
    });
    let shown: Vec<_> = lines.iter().map(|l| super::terminal::line(l)).collect();
    Ok(Answer::new(shown.join("\n"), json))
}

/// The folder of the outputs as an absolute path, where it is not in the folder of the plan, so that the plan by itself
/// does not send files there; `None` where it is, or the user names none. A note shows the flag of the merge.
pub(super) fn out_elsewhere(p: &Parameters, session: &Session) -> Option<PathBuf> {
    let folder = p.output.parent().unwrap_or(Path::new(""));
    let out = p.out.as_deref()?;
    leads_out(folder, &relative_path(out, folder))?;
    let shown = out.display();
    session.note(&format!(
        "the outputs go to {shown}, outside the folder of the plan: druse merge needs --out {shown}"
    ));
    Some(std::path::absolute(out).unwrap_or(out.to_owned()))
}

/// Writes the job files of a plan and returns their paths.
fn job_files(p: &Parameters, items: &Items) -> Result<Vec<PathBuf>, Failure> {
    let mut files = Vec::new();
    for queue in &p.emit {
        let (file, text) = job::of(*queue, &p.output, items, p.threads);
        crate::io::atomic::write_bytes(&file, text.as_bytes())?;
        files.push(file);
    }
    Ok(files)
}

/// Writes the plan of a sequence and its job files.
fn sequence(
    p: &Parameters,
    frames: &FrameList,
    options: &RunOptions,
    session: &Session,
) -> Result<Answer, Failure> {
    let planned = super::sequence_plan::plan(p, frames, options, session)?;
    let mut files = planned.files;
    files.extend(job_files(p, &planned.items)?);
    // The bar of progress ends before lines follow.
    session.finish();
    let (count, frames) = (planned.items.count, frames.frames().len());
    session.note(&format!(
        "{} items of {} frames, about {} of memory each",
        grouped(count as u64),
        grouped(frames as u64),
        size(planned.items.memory_bytes)
    ));
    let lines: Vec<String> = files.iter().map(|f| f.display().to_string()).collect();
    let json = serde_json::json!({
        "items": count,
        "frames": frames,
        "memory_bytes": planned.items.memory_bytes,
        "files": lines,
    });
    let shown: Vec<_> = lines.iter().map(|l| super::terminal::line(l)).collect();
    Ok(Answer::new(shown.join("\n"), json))
}
