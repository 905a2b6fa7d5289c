//! `druse sweep RECIPE KEY=VALUES... -o TABLE.csv`: runs all combinations of values of a recipe's keys.
//!
//! Each combination is a recipe of its own and has a row, known by its hash. Rows that are complete are kept,
//! so that an interrupted sweep goes on; rows with errors are run again.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::io::atomic::{require_directory, require_writable};
use crate::pipeline;
use crate::pipeline::{REPORT_NAME, Report, RunOptions, check_confined};
use crate::progress::Progress;
use crate::recipe::Recipe;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

mod axis;
mod table;

use axis::Axis;
use table::Table;

/// Greatest number of combinations.
const MAX_COMBINATIONS: usize = 10_000;

#[derive(Args)]
pub(super) struct Parameters {
    /// The recipe (.toml).
    recipe: PathBuf,
    /// Keys and their values: a list, as in build.up=[0,0,1],[1,0,0], or a range FIRST:LAST:STEP, as in
    /// cell.c.thickness=0.6:1.2:0.2. All combinations are run.
    #[arg(required = true, value_name = "KEY=VALUES")]
    keys: Vec<String>,
    /// The table to write: a row per combination. Rows that it has already are kept.
    #[arg(short, long, value_name = "TABLE.csv")]
    output: PathBuf,
    /// Override a key of the recipe in all runs, as in `band.voxel_size=0.4`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Write the files of each run into a folder of its own here: 0001, 0002, ... [default: no files].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// List the combinations with their estimates, and stop.
    #[arg(long)]
    dry_run: bool,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// A combination: its values in the order of the keys, and its recipe.
struct Combination {
    values: Vec<String>,
    recipe: Recipe,
    /// BLAKE3 of the recipe's text with its overrides.
    hash: String,
}

/// Runs all combinations of values that the table does not hold yet, and writes the table after each. A
/// combination that fails has a row with its error; faults of the machine end the sweep.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let axes: Vec<Axis> = p
        .keys
        .iter()
        .map(|text| Axis::parse(text))
        .collect::<Result<_, _>>()?;
    let combinations = combinations(p, &axes)?;
    if p.dry_run {
        return dry_run(p, &axes, &combinations, session);
    }
    require_writable(&p.output)?;
    let names = axes.iter().map(|a| a.key.clone()).collect();
    let mut table = Table::read(&p.output, names)?;
    let known = combinations.iter().filter(|c| table.holds(&c.hash)).count();
    if known > 0 {
        session.note(&format!(
            "{known} of {} rows are there already",
            combinations.len()
        ));
    }
    if let Some(out) = &p.out {
        check_folders(out, &combinations)?;
        require_directory(out)?;
    }
    let mut failed = 0;
    for (n, c) in combinations.iter().enumerate() {
        let label = label(&axes, &c.values);
        if table.holds(&c.hash) {
            continue;
        }
        let options = RunOptions {
            out: p.out.as_deref().map(|out| folder_of(out, n)),
            confined: true,
            ..super::vdb::run_options(p.threads, session)?
        };
        let head = format!("{}/{} {label}", n + 1, combinations.len());
        match pipeline::run(&c.recipe, &options, session) {
            Ok(report) => {
                session.note(&format!(
                    "{head}: volume {}",
                    crate::frame::figures(report.solid.volume)
                ));
                table.add(&c.values, &c.hash, &numbers(&report));
            }
            Err(e) if session.cancelled() => return Err(e.into()),
            Err(e) => {
                let message = e.to_string();
                let failure = Failure::from(e);
                // A full disk or a folder that takes no files stops the other combinations, too.
                if failure.is_of_machine() {
                    return Err(failure);
                }
                session.note(&format!("{head}: {message}"));
                table.add_failure(&c.values, &c.hash, &message);
                failed += 1;
            }
        }
        // After each run, so that an interruption loses one at most.
        table.write(&p.output, combinations.iter().map(|c| c.hash.as_str()))?;
    }
    session.finish();
    // Rows of an interrupted sweep come into order at its end.
    table.write(&p.output, combinations.iter().map(|c| c.hash.as_str()))?;
    let path = p.output.display().to_string();
    let mut text = format!(
        "{}  {} rows, {known} kept",
        super::terminal::line(&path),
        combinations.len()
    );
    if failed > 0 {
        let _ = write!(text, ", {failed} failed");
    }
    let facts = json!({
        "path": path, "rows": combinations.len(), "kept": known, "failed": failed,
    });
    Ok(Answer::new(text, facts).verdict(failed == 0))
}

/// The folder of the files of combination `n`, counted from 0: 0001 for the first.
fn folder_of(out: &Path, n: usize) -> PathBuf {
    out.join(format!("{:04}", n + 1))
}

/// Refuses combinations whose files would lie outside their own folders, where others may write them too, and folders
/// with the files of another combination, as of a sweep whose values were listed otherwise.
fn check_folders(out: &Path, combinations: &[Combination]) -> Result<(), Failure> {
    for (n, c) in combinations.iter().enumerate() {
        let folder = folder_of(out, n);
        if folder.is_symlink() {
            return Err(Failure::output(
                &folder,
                "found a link; expected a folder for the files of one combination, or none",
            ));
        }
        check_confined(&c.recipe, &folder)?;
        let outputs = &c.recipe.sections().output;
        let report = outputs.iter().find_map(|o| o.report.as_deref());
        let report = folder.join(report.unwrap_or(Path::new(REPORT_NAME)));
        let report = std::fs::read(report).unwrap_or_default();
        let report: Value = serde_json::from_slice(&report).unwrap_or_default();
        // The hash of the recipe in a report shows which combination wrote the folder.
        let is_other = |(m, other): (usize, &Combination)| {
            m != n && report["recipe_blake3"] == other.hash && other.hash != c.hash
        };
        if combinations.iter().enumerate().any(is_other) {
            return Err(Failure::output(
                &folder,
                format!(
                    "found the files of another combination of these values; expected those of {}, or none",
                    c.values.join(" ")
                ),
            )
            .hint("another folder for --out, or the values in the order in which they were run"));
        }
    }
    Ok(())
}

/// All combinations, the last key varying fastest. Each is a valid recipe.
fn combinations(p: &Parameters, axes: &[Axis]) -> Result<Vec<Combination>, Failure> {
    // Checked before the list is made: products of axes grow fast.
    let count = axes
        .iter()
        .try_fold(1usize, |n, a| n.checked_mul(a.values.len()))
        .filter(|n| *n <= MAX_COMBINATIONS);
    let Some(count) = count else {
        return Err(Failure::usage(format!(
            "found more than {MAX_COMBINATIONS} combinations; expected fewer values"
        )));
    };
    let mut found = Vec::with_capacity(count);
    for n in 0..count {
        // The digits of n in the mixed base of the axes, the last axis first.
        let mut rest = n;
        let mut values: Vec<String> = axes
            .iter()
            .rev()
            .map(|axis| {
                let value = axis.values[rest % axis.values.len()].clone();
                rest /= axis.values.len();
                value
            })
            .collect();
        values.reverse();
        let mut overrides = p.set.clone();
        overrides.extend(
            axes.iter()
                .zip(&values)
                .map(|(a, v)| format!("{}={v}", a.key)),
        );
        // Without a folder only the numbers are wanted.
        if p.out.is_none() {
            overrides.push("output=[]".into());
        }
        let recipe = Recipe::read(&p.recipe, &overrides)?;
        let hash = blake3::hash(recipe.source().text().as_bytes());
        found.push(Combination {
            values,
            recipe,
            hash: hash.to_hex().to_string(),
        });
    }
    Ok(found)
}

/// The values of a combination as KEY=VALUE, for messages.
fn label(axes: &[Axis], values: &[String]) -> String {
    let pairs = axes.iter().zip(values);
    let pairs: Vec<String> = pairs.map(|(a, v)| format!("{}={v}", a.key)).collect();
    pairs.join(" ")
}

/// Lists the combinations with their estimates and the sum of their times; nothing is run.
fn dry_run(
    p: &Parameters,
    axes: &[Axis],
    combinations: &[Combination],
    session: &Session,
) -> Result<Answer, Failure> {
    let options = super::vdb::run_options(p.threads, session)?;
    let (mut text, mut facts) = (String::new(), Vec::new());
    let (mut seconds, mut memory) = (0.0, 0);
    for (n, c) in combinations.iter().enumerate() {
        let estimate = pipeline::plan(&c.recipe, &options, session)?;
        seconds += estimate.seconds;
        // Runs come one after the other: times add up, memory does not.
        memory = memory.max(estimate.peak_memory_bytes);
        let _ = writeln!(
            text,
            "{:>4}  {}  {:.1} s, {}",
            n + 1,
            label(axes, &c.values),
            estimate.seconds,
            super::numbers::size(estimate.peak_memory_bytes)
        );
        facts.push(json!({ "values": c.values, "estimate": estimate }));
    }
    session.finish();
    let _ = write!(
        text,
        "{} runs, {seconds:.1} s, at most {}",
        combinations.len(),
        super::numbers::size(memory)
    );
    let keys: Vec<&String> = axes.iter().map(|a| &a.key).collect();
    let facts = json!({ "keys": keys, "runs": facts, "seconds": seconds });
    Ok(Answer::new(text, facts))
}

/// The numbers of a report by the name of their column, in the order of the table; lengths in the recipe's unit,
/// null for what was not measured.
fn numbers(report: &Report) -> Vec<(&'static str, Value)> {
    let s = &report.solid;
    let build = s.build.as_ref();
    let size = s.bounds.map(crate::frame::Aabb::size);
    let seconds: f64 = report.stages.iter().map(|s| s.seconds).sum();
    let missed = report.requirements.iter().filter(|r| !r.met).count();
    vec![
        ("volume", json!(s.volume)),
        ("area", json!(s.area)),
        ("volume_fraction", json!(s.volume_fraction)),
        ("size_x", json!(size.map(|v| v.x))),
        ("size_y", json!(size.map(|v| v.y))),
        ("size_z", json!(size.map(|v| v.z))),
        ("components", json!(s.components)),
        ("least_wall", json!(s.least_wall)),
        ("least_gap", json!(s.least_gap)),
        ("closed_cavities", json!(s.closed_cavities)),
        (
            "escape_radius",
            json!(s.cavities.as_ref().and_then(|c| c.escape_radius)),
        ),
        ("mass", json!(s.mass)),
        ("channels", json!(s.drains.len())),
        ("layers", json!(build.map(|b| b.layers))),
        ("islands", json!(build.map(|b| b.islands))),
        ("cups", json!(build.map(|b| b.cups))),
        ("overhang_area", json!(build.map(|b| b.overhang_area))),
        ("section_max", json!(build.map(|b| b.section_max[0]))),
        ("section_jump", json!(build.map(|b| b.section_jump[0]))),
        ("requirements", json!(report.requirements.len())),
        ("requirements_missed", json!(missed)),
        ("active_voxels", json!(report.band.active_voxels)),
        ("seconds", json!((seconds * 1e3).round() / 1e3)),
    ]
}
