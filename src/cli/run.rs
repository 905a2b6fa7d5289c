//! `druse run RECIPE`.

use super::{Answer, Failure, Session};
use crate::pipeline::{Estimate, Report, RunOptions, plan, run};
use crate::recipe::Recipe;
use clap::Args;
use serde_json::json;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct Parameters {
    /// The recipe (.toml).
    recipe: PathBuf,
    /// Override a key of the recipe, as in tiling.cell=octet or op.2.dilate=0.2 (entries of arrays
    /// are numbered from 0).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Directory for the outputs [default: the recipe's own].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print an estimate of voxels, memory, disk and time, and stop.
    #[arg(long)]
    dry_run: bool,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
    /// Memory that the run may use, as in 2G [default: what the machine has].
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    memory: Option<u64>,
}

pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let recipe = Recipe::read(&p.recipe, &p.set)?;
    for cell in recipe.sections().cell.values() {
        if let Some(file) = &cell.voxels {
            super::vdb::inspect_voxels(&recipe.resolve(&file.path))?;
        }
    }
    let options = RunOptions {
        threads: p.threads,
        memory: p.memory,
        out: p.out.clone(),
        strict: session.strict(),
        brief: false,
        isolated: Some(super::vdb::reader()?),
    };
    if p.dry_run {
        let estimate = plan(&recipe, &options, session)?;
        let json = serde_json::to_value(estimate).unwrap_or_default();
        return Ok(Answer::new(prediction(&estimate), json));
    }
    let report = run(&recipe, &options, session)?;
    session.finish();
    for input in &report.inputs {
        let [a, b] =
            [input.bounds.min, input.bounds.max].map(|v| v.map(|c| (c * 1e4).round() / 1e4));
        session.note(&format!(
            "{}: {} spans [{}, {}, {}] to [{}, {}, {}]{}",
            input.key,
            input.path,
            a.x,
            a.y,
            a.z,
            b.x,
            b.y,
            b.z,
            if input.key.starts_with("cell.") {
                " (reference coordinates)".to_owned()
            } else {
                format!(" {}", report.unit)
            }
        ));
    }
    if session.verbose() {
        for stage in &report.stages {
            session.note(&format!("{:>8.2} s  {}", stage.seconds, stage.name));
        }
    }
    for warning in &report.warnings {
        session.warn(warning);
    }
    session.note(&summary(&report));
    let lines: Vec<String> = report
        .outputs
        .iter()
        .map(|o| {
            let unit = o
                .unit
                .as_deref()
                .map_or(String::new(), |u| format!("  {u}"));
            format!("{}  {}{unit}", o.path, size(o.bytes))
        })
        .collect();
    let json = serde_json::to_value(&report).unwrap_or_else(|e| json!({ "error": e.to_string() }));
    Ok(Answer::new(lines.join("\n"), json))
}

fn summary(report: &Report) -> String {
    let solid = &report.solid;
    let seconds: f64 = report.stages.iter().map(|s| s.seconds).sum();
    let unit = &report.unit;
    format!(
        "{} active voxels, volume {:.6} {unit}^3, area {:.6} {unit}^2, {} piece{}, {seconds:.1} s, {}",
        grouped(report.band.active_voxels),
        solid.volume,
        solid.area,
        solid.components,
        if solid.components == 1 { "" } else { "s" },
        size(report.peak_memory_bytes)
    )
}

fn prediction(e: &Estimate) -> String {
    [
        ("elements", grouped(e.elements)),
        ("blocks", grouped(e.blocks)),
        ("leaves", grouped(e.leaves)),
        ("active voxels", grouped(e.active_voxels)),
        ("peak memory", size(e.peak_memory_bytes)),
        ("on disk", size(e.disk_bytes)),
        ("time", format!("{:.1} s", e.seconds)),
    ]
    .map(|(name, value)| format!("{name:<14}{value}"))
    .join("\n")
}

/// A count with its thousands apart.
pub(super) fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place) % 3 == 0 {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Bytes for people; K, M, G are powers of 1024.
pub(super) fn size(bytes: u64) -> String {
    let mut value = bytes as f64;
    for unit in ["B", "KiB", "MiB"] {
        if value < 1024.0 {
            return if unit == "B" {
                format!("{bytes} B")
            } else {
                format!("{value:.1} {unit}")
            };
        }
        value /= 1024.0;
    }
    format!("{value:.1} GiB")
}

/// Parses "2G", "512M", "1073741824".
fn memory(text: &str) -> Result<u64, String> {
    let upper = text.trim().to_ascii_uppercase();
    let number = upper.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let power = match upper[number.len()..]
        .trim_end_matches("IB")
        .trim_end_matches('B')
    {
        "" => 0,
        "K" => 1,
        "M" => 2,
        "G" => 3,
        "T" => 4,
        _ => 5,
    };
    let value: Option<f64> = number.trim().parse().ok().filter(|v| *v > 0.0 && power < 5);
    value
        .map(|v| (v * 1024f64.powi(power)) as u64)
        .ok_or_else(|| format!("found {text:?}, expected a size such as 512M or 2G"))
}
