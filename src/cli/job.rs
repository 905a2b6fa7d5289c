//! Job files for the items of a plan (bricks, frames) and their merge, for common queue systems. Scripts come from
//! templates, in which words with `@` are replaced and names are quoted for the shell; Open Job Description is JSON.

use clap::ValueEnum;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Queues that job files are written for.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Queue {
    /// A Slurm job array and a merge that waits for it; run the script to submit both.
    Slurm,
    /// An Open Job Description template (Deadline Cloud, openjd).
    Openjd,
    /// A script for GNU parallel on this machine or several.
    Parallel,
}

/// The items of a plan: bricks, or frames and bricks of frames.
pub(super) struct Items {
    /// How many; they are numbered from 0.
    pub count: usize,
    /// Memory of the greatest, bytes.
    pub memory_bytes: u64,
    /// The folder of the outputs, where it is not in that of the plan and must be named.
    pub out: Option<PathBuf>,
}

/// The job file of the plan at `path`: its name, beside the plan, and its text. `threads` are those of each item;
/// 0 means all cores, for Slurm one.
pub(super) fn of(queue: Queue, path: &Path, items: &Items, threads: usize) -> (PathBuf, String) {
    let last = items.count.saturating_sub(1);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let threads_flag = match threads {
        0 => String::new(),
        n => format!(" --threads {n}"),
    };
    // Quoted, so that the shell reads any text as one word.
    let word = |text: &str| format!("'{}'", text.replace('\'', r"'\''"));
    let out = items.out.as_deref().map(Path::to_string_lossy);
    let out_variable = out.as_ref().map(|o| format!(" OUT={}", word(o)));
    let (out_variable, [out_flag, out_export]) = match &out_variable {
        Some(variable) => (variable.as_str(), [r#" --out "$OUT""#, " --env OUT"]),
        None => ("", [""; 2]),
    };
    let script = |text: &str| {
        let text = text.replace("@OUT_VARIABLE", out_variable);
        text.replace("@OUT", out_flag)
            .replace("@EXPORT", out_export)
    };
    let (suffix, text) = match queue {
        Queue::Slurm => (
            "slurm.sh",
            script(SLURM)
                .replace("@LAST", &last.to_string())
                // Slurm grants cores by number, so that 0 becomes 1; memory is in MiB, at least 64.
                .replace("@CPUS", &threads.max(1).to_string())
                .replace(
                    "@MEGABYTES",
                    &(items.memory_bytes >> 20).max(64).to_string(),
                )
                .replace("@THREADS", &format!(" --threads {}", threads.max(1)))
                .replace("@PLAN", &word(&name)),
        ),
        Queue::Parallel => (
            "parallel.sh",
            script(PARALLEL_SCRIPT)
                .replace("@LAST", &last.to_string())
                .replace("@LOG", &word(&format!("{stem}.joblog")))
                .replace("@THREADS", &threads_flag)
                .replace("@PLAN", &word(&name)),
        ),
        Queue::Openjd => (
            "openjd.json",
            openjd(&name, &stem, last, threads, out.as_deref()),
        ),
    };
    (path.with_file_name(format!("{stem}.{suffix}")), text)
}

/// The template for Slurm.
const SLURM: &str = r#"#!/bin/sh
# Submits the bricks of a plan as a job array, and the merge, which waits for all of them.
# Flags of this script go to both jobs, as in --partition=long. DRUSE names the program.
# A brick that fails or is requeued may run again: what is there and whole is left as it is.
set -e
cd "$(dirname "$0")"
export PLAN=@PLAN DRUSE="${DRUSE:-druse}"@OUT_VARIABLE
bricks=$(sbatch --parsable --requeue --array=0-@LAST --cpus-per-task=@CPUS --mem=@MEGABYTESM "$@" \
    --wrap '"$DRUSE" run "$PLAN" --brick "$SLURM_ARRAY_TASK_ID"@THREADS@OUT')
sbatch --dependency="afterok:${bricks%%;*}" --cpus-per-task=@CPUS --mem=@MEGABYTESM "$@" \
    --wrap '"$DRUSE" merge "$PLAN"@THREADS@OUT'
"#;

/// The template for GNU parallel.
const PARALLEL_SCRIPT: &str = r#"#!/bin/sh
# Makes the bricks of a plan with GNU parallel, then merges them; run again, it goes on where it was.
# Flags of this script go to parallel, as in --jobs 4 or --sshlogin. DRUSE names the program.
set -e
cd "$(dirname "$0")"
export PLAN=@PLAN DRUSE="${DRUSE:-druse}"@OUT_VARIABLE
seq 0 @LAST | parallel --joblog @LOG --resume-failed --retries 3 --env PLAN --env DRUSE@EXPORT "$@" \
    '"$DRUSE" run "$PLAN" --brick {}@THREADS@OUT'
"$DRUSE" merge "$PLAN"@THREADS@OUT
"#;

/// A job template of Open Job Description: a task for each brick, then the merge. `name` is the plan's file, `stem` the
/// name of the job and `last` the number of the last brick; 0 `threads` means all.
fn openjd(name: &str, stem: &str, last: usize, threads: usize, out: Option<&str>) -> String {
    let step = |arguments: &[&str]| {
        let mut words: Vec<String> = arguments.iter().map(|&a| a.to_owned()).collect();
        if threads > 0 {
            words.extend(["--threads".to_owned(), threads.to_string()]);
        }
        words.extend(
            out.into_iter()
                .flat_map(|out| ["--out".to_owned(), out.to_owned()]),
        );
        json!({ "actions": { "onRun": { "command": "{{Param.Druse}}", "args": words } } })
    };
    let template = json!({
        "specificationVersion": "jobtemplate-2023-09",
        "name": stem,
        "parameterDefinitions": [
            {
                "name": "Plan", "type": "PATH", "objectType": "FILE", "dataFlow": "IN",
                "default": name, "description": "The plan; its bricks go beside it."
            },
            { "name": "Druse", "type": "STRING", "default": "druse", "description": "The program." }
        ],
        "steps": [
            {
                "name": "Bricks",
                "parameterSpace": { "taskParameterDefinitions": [
                    { "name": "Brick", "type": "INT", "range": format!("0-{last}") }
                ] },
                "script": step(&["run", "{{Param.Plan}}", "--brick", "{{Task.Param.Brick}}"])
            },
            {
                "name": "Merge",
                "dependencies": [{ "dependsOn": "Bricks" }],
                "script": step(&["merge", "{{Param.Plan}}"])
            }
        ]
    });
    let text = serde_json::to_string_pretty(&template).unwrap_or_default();
    format!("{text}\n")
}
