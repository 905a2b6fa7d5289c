//! The report of a run as the terminal shows it: notes and warnings on stderr, a line for each file and
//! requirement on stdout, and the whole report as the object of `--json`.

use super::context::Session;
use super::numbers::{grouped, size};
use super::output::Answer;
use crate::frame::figures;
use crate::pipeline::{MacroDeckFacts, Report};
use serde_json::json;

/// The summary printed at the end of a run or a merge. Prints the notes at once; the answer passes if all
/// requirements are met.
pub(super) fn reported(report: &Report, session: &Session) -> Answer {
    session.finish();
    for note in report.scaffold.iter().flat_map(|s| &s.notes) {
        session.note(&format!("scaffold: {note}"));
    }
    // Masks have no box.
    for input in report.inputs.iter().filter(|i| !i.bounds.is_empty()) {
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
    // Work that was done already shows that a run went on.
    if let Some(bricks) = report.bricks {
        let found = match bricks.found_whole {
            0 => String::new(),
            n => format!(", {n} of them there already"),
        };
        session.note(&format!(
            "went through {} bricks of {} voxels a side{found}",
            grouped(bricks.count),
            bricks.edge * 128 // voxels of a block
        ));
    }
    if let (Some(n), Some(scaffold)) = (report.band.elements_visited, &report.scaffold) {
        session.note(&format!(
            "evaluated {} samples in {} leaves ({} of {} elements)",
            grouped(report.band.voxels_evaluated),
            grouped(report.band.leaves_touched),
            grouped(n),
            grouped(scaffold.elements.values().sum())
        ));
        if let Some(count) = report.band.leaves_by_nodes.filter(|n| *n > 0) {
            session.note(&format!(
                "interpolated {} leaves from samples at coarser nodes",
                grouped(count)
            ));
        }
    }
    for o in &report.outputs {
        if let Some(deck) = &o.macro_deck {
            session.note(&deck_summary(
                deck,
                &o.path,
                o.unit.as_deref().unwrap_or(""),
            ));
        }
    }
    session.note(&summary(report));
    let mut lines: Vec<String> = report
        .outputs
        .iter()
        .map(|o| {
            let unit = o
                .unit
                .as_deref()
                .map_or(String::new(), |u| format!("  {u}"));
            format!(
                "{}  {}{unit}",
                super::terminal::line(&o.path),
                size(o.bytes)
            )
        })
        .collect();
    lines.extend(report.requirements.iter().map(ToString::to_string));
    let json = serde_json::to_value(report).unwrap_or_else(|e| json!({ "error": e.to_string() }));
    Answer::new(lines.join("\n"), json).verdict(report.meets_requirements())
}

/// One line about the solid, time and memory.
fn summary(report: &Report) -> String {
    let solid = &report.solid;
    let seconds: f64 = report.stages.iter().map(|s| s.seconds).sum();
    let unit = &report.unit;
    // None where nothing was sampled.
    let components = match solid.components {
        0 => String::new(),
        1 => "1 component, ".to_owned(),
        n => format!("{n} components, "),
    };
    if report.band.active_voxels == 0 {
        return format!(
            "no voxels, {seconds:.1} s, {}",
            size(report.peak_memory_bytes)
        );
    }
    format!(
        "{} active voxels, volume {} {unit}^3, area {} {unit}^2, {components}{seconds:.1} s, {}",
        grouped(report.band.active_voxels),
        figures(solid.volume),
        figures(solid.area),
        size(report.peak_memory_bytes)
    )
}

/// One line about a deck of the scaffold's elements.
fn deck_summary(deck: &MacroDeckFacts, path: &str, unit: &str) -> String {
    let materials: usize = deck.laws.iter().map(|l| l.materials).sum();
    let mass = deck
        .mass
        .map_or(String::new(), |m| format!(", mass {}", figures(m)));
    format!(
        "{path}: {} elements, {materials} materials from {} homogenised cells, {} of {} {unit}^3 solid{mass}",
        grouped(deck.elements),
        deck.laws.iter().map(|l| l.points).sum::<usize>(),
        figures(deck.solid_volume),
        figures(deck.volume)
    )
}
