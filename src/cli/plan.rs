//! `druse plan RECIPE -o PLAN`.

use super::job::{self, Queue};
use super::run::{grouped, memory, size};
use super::{Answer, Failure, Session};
use crate::pipeline::{RunOptions, brick_plan};
use crate::recipe::Recipe;
use clap::Args;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct Parameters {
    /// The recipe (.toml).
    recipe: PathBuf,
    /// The plan (.json). Bricks go into a directory beside it, `PLAN.bricks`; paths in it are relative
    /// to it, so that it may be moved together with the recipe and its inputs.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Override a key of the recipe, as in tiling.cell=octet.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Directory for the outputs of the merge [default: the recipe's own].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Memory of each machine; it determines the size of bricks.
    #[arg(long, value_name = "SIZE", value_parser = memory, default_value = "2G")]
    memory: u64,
    /// Edge of a brick in blocks of 128 voxels [default: the largest that fits the memory].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    bricks: Option<u32>,
    /// Also write a job file for a queue beside the plan; may be given again.
    #[arg(long, value_name = "QUEUE", value_enum)]
    emit: Vec<Queue>,
    /// Worker threads of each brick in job files [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    if p.output.extension().is_none_or(|e| e != "json") {
        return Err(Failure::usage(format!(
            "found -o {}, expected a name that ends in .json",
            p.output.display()
        )));
    }
    let recipe = Recipe::read(&p.recipe, &p.set)?;
    let options = RunOptions {
        threads: p.threads,
        memory: Some(p.memory),
        bricks: p.bricks,
        out: p.out.clone(),
        strict: session.strict(),
        isolated: Some(super::vdb::reader()?),
        ..RunOptions::default()
    };
    let plan = brick_plan(&recipe, &p.output, &options, session)?;
    let mut files = vec![p.output.clone()];
    for queue in &p.emit {
        let (file, text) = job::of(*queue, &p.output, &plan, p.threads);
        crate::io::atomic::write_bytes(&file, text.as_bytes())?;
        files.push(file);
    }
    session.finish();
    session.note(&format!(
        "{} bricks of {} voxels a side, halo {} voxels, about {} of leaf files and {} of memory",
        grouped(plan.bricks.len() as u64),
        plan.edge * 128,
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
    Ok(Answer::new(lines.join("\n"), json))
}
