//! `druse run RECIPE`, and `druse run PLAN --brick N`. `druse run FILE.vdb` is in `repeat`.

use super::{Answer, Failure, Session};
use crate::frame::figures;
use crate::pipeline::{self, Estimate, MacroDeckFacts, Report, RunOptions, plan, run};
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

/// The recipe at several frames.
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

/// Opens the grids of cells within limits before the run does.
fn inspect_voxels(recipe: &Recipe) -> Result<(), Failure> {
    for cell in recipe.sections().cell.values() {
        if let Some(file) = &cell.voxels {
            super::vdb::inspect_voxels(&recipe.resolve(&file.path))?;
        }
    }
    Ok(())
}

fn options(p: &Parameters, session: &Session) -> Result<RunOptions, Failure> {
    Ok(RunOptions {
        threads: p.threads,
        memory: p.memory,
        bricks: p.bricks,
        out: p.out.clone(),
        strict: session.strict(),
        brief: false,
        isolated: Some(super::vdb::reader()?),
        ..RunOptions::default()
    })
}

/// Some bricks of a plan.
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
        threads: p.threads,
        memory: p.memory,
        strict: session.strict(),
        isolated: Some(super::vdb::reader()?),
        ..RunOptions::default()
    };
    let left = pipeline::make_bricks(&p.recipe, &p.brick, &options, session)?;
    session.finish();
    let made = p.brick.iter().map(ExactSizeIterator::len).sum::<usize>() - left;
    let text = format!("{made} bricks made, {left} were there");
    Ok(Answer::new(text, json!({ "made": made, "left": left })))
}

/// The summary printed at the end of a run or a merge.
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
    if let Some(bricks) = report.bricks {
        let found = match bricks.found_whole {
            0 => String::new(),
            n => format!(", {n} of them there already"),
        };
        session.note(&format!(
            "went through {} bricks of {} voxels a side{found}",
            grouped(bricks.count),
            bricks.edge * 128
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

fn summary(report: &Report) -> String {
    let solid = &report.solid;
    let seconds: f64 = report.stages.iter().map(|s| s.seconds).sum();
    let unit = &report.unit;
    // Components are not counted in bricks.
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

/// A count with separated thousands.
pub(super) fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Bytes as text; K, M, G are powers of 1024.
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

/// Parses "3" and "0-7".
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

/// Parses "2G", "512M", "1073741824".
pub(super) fn memory(text: &str) -> Result<u64, String> {
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
