//! `druse merge PLAN`: merges the bricks or frames of a plan and writes the recipe's outputs.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::pipeline::{RunOptions, merge_bricks};
use clap::Args;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct Parameters {
    /// The plan (.json) whose bricks or frames have been made.
    plan: PathBuf,
    /// Directory for the outputs [default: the plan's, or the recipe's own].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Merges a plan of bricks, or a sequence of frames.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let options = RunOptions {
        out: p.out.clone(),
        ..super::vdb::run_options(p.threads, session)?
    };
    if super::sequence_plan::is_sequence(&p.plan) {
        return super::sequence_plan::merge(&p.plan, options, session);
    }
    let report = merge_bricks(&p.plan, &options, session)?;
    Ok(super::run_text::reported(&report, session))
}
