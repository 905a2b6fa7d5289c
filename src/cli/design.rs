//! `druse fit --target`: a cell by its properties instead of a source.
//!
//! A search that is interrupted leaves the best cell so far; `--resume` continues from it. A target is an
//! effective property of the cell, as its bulk modulus; see `pipeline::design`.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::frame::Element;
use crate::inverse::{InverseError, Prepared};
use crate::io::atomic::require_writable;
use crate::io::{read_cell, write_cell};
use crate::pipeline;
use crate::progress::Threads;
use crate::recipe::{CellSection, Positive, Solid, TargetWord};
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct DesignFlags {
    /// Design a cell with target properties: bulk, shear, young, conductivity or permeability (the largest at
    /// the volume fraction), or a table such as '{ maximise = "bulk", zener = 1 }' with maximise, zener,
    /// poisson, stiffness, weight, `min_opening`, `min_permeability`, `max_permeability`, starts, evaluations, voxels.
    #[arg(
        long,
        value_name = "TARGET",
        requires = "output",
        help_heading = "Design"
    )]
    pub(super) target: Option<TargetWord>,
    /// A sheet around the surface instead of a network: the same as --solid sheet.
    #[arg(long, conflicts_with = "solid", help_heading = "Design")]
    sheet: bool,
    /// A surface or a .cell file to start from.
    #[arg(long, value_name = "NAME", help_heading = "Design")]
    start: Option<String>,
    /// Seed of random cells to start from.
    #[arg(long, value_name = "N", help_heading = "Design")]
    seed: Option<u64>,
    /// Least width of walls and gaps, in reference lengths.
    #[arg(long, value_name = "LENGTH", help_heading = "Design")]
    min_feature: Option<Positive>,
    /// A .cell file or a surface; the new cell has the same trace on the element's faces. May be repeated.
    #[arg(long = "match", value_name = "CELL", help_heading = "Design")]
    matched: Vec<PathBuf>,
    /// Print unknowns, stages and bounds, and stop.
    #[arg(long, help_heading = "Design")]
    dry_run: bool,
    /// Continue from the output of an earlier search.
    #[arg(long, help_heading = "Design")]
    resume: bool,
}

impl DesignFlags {
    /// The flags that go with a target, where they are given.
    pub(super) fn given(&self) -> Vec<&'static str> {
        let all = [
            ("--sheet", self.sheet),
            ("--start", self.start.is_some()),
            ("--seed", self.seed.is_some()),
            ("--min-feature", self.min_feature.is_some()),
            ("--match", !self.matched.is_empty()),
            ("--dry-run", self.dry_run),
            ("--resume", self.resume),
        ];
        all.iter().filter(|g| g.1).map(|g| g.0).collect()
    }
}

impl From<InverseError> for Failure {
    fn from(e: InverseError) -> Self {
        if e.is_cancelled() {
            return Self::stopped(130);
        }
        let hint = match &e {
            InverseError::Homogenize(_) => "--target '{ ..., voxels = N }' with another N",
            InverseError::Band { .. } => {
                "a larger grid, --target '{ ..., voxels = N }', or a smaller --band-limit"
            }
            InverseError::Disconnected(_) => {
                "other starts (--start, --seed, starts = N), another volume fraction, or more evaluations"
            }
            InverseError::Infeasible { .. } => {
                "the nearest value in target, a smaller volume fraction, or more evaluations"
            }
            _ => return Self::usage(e.to_string()),
        };
        Self::usage(e.to_string()).hint(hint)
    }
}

/// Searches a cell by its properties and writes it to `output`, also if the search is interrupted. `section` holds
/// the other flags of the cell. With `--dry-run` only the plan is shown.
pub(super) fn answer(
    flags: &DesignFlags,
    section: &CellSection,
    output: &Path,
    threads: &Threads,
    session: &Session,
) -> Result<Answer, Failure> {
    // The flags become keys of a cell's section, so that its rules check them.
    let mut section = section.clone();
    section.target.clone_from(&flags.target);
    section.start.clone_from(&flags.start);
    section.seed = flags.seed;
    section.min_feature = flags.min_feature;
    if flags.sheet {
        section.solid = Some(Solid::Sheet);
    }
    if let Some((_, reason)) = section.target_fault() {
        return Err(Failure::usage(reason));
    }
    if !section.levels().contains(&"volume_fraction") || section.levels().len() > 1 {
        return Err(Failure::usage(format!(
            "found {} beside --target; expected --volume-fraction alone",
            section.levels().join(" and ")
        )));
    }
    if section.hybrid().is_some() {
        return Err(Failure::usage(
            "found other cells beside --target; expected either a target or a join of cells",
        ));
    }
    let mut matched = Vec::new();
    for path in &flags.matched {
        matched.push(super::cell_text::read(path)?);
    }
    let element = section.own_element().unwrap_or(Element::Hex);
    let name = super::cell_text::stem(output);
    let design = pipeline::design(&name, &section, element, matched, &Path::to_path_buf)
        .map_err(|e| Failure::usage(e.to_string()))?;
    let prepared = design.prepare()?;
    if flags.dry_run {
        return plan(&prepared);
    }
    require_writable(output)?;
    let earlier = if flags.resume {
        let cell = read_cell(output)?;
        let design = cell.report().and_then(|r| r.design.as_ref());
        if design.is_none() {
            return Err(Failure::data(
                output,
                "found a cell without a design; expected one that --target made",
            )
            .hint("omit --resume, or begin a new search from it with --start FILE"));
        }
        Some(cell)
    } else {
        None
    };
    let made = threads.install(|| prepared.search(earlier.as_ref(), session))?;
    // The best cell so far is kept for --resume.
    let bytes = write_cell(output, &made.cell)?;
    if made.is_stopped {
        return Err(Failure::resumable(format!(
            "interrupted; the best cell so far is in {}",
            output.display()
        ))
        .hint("the same command with --resume continues from it"));
    }
    let mut text = super::cell_text::describe(&made.cell);
    let _ = write!(
        text,
        "{}  {}",
        super::terminal::path(output),
        super::numbers::size(bytes)
    );
    let mut facts = super::cell_text::facts(&made.cell);
    facts["path"] = json!(output.display().to_string());
    facts["bytes"] = json!(bytes);
    Ok(Answer::new(text, facts))
}

/// The plan of a search in words and as an object: its unknowns, grids and evaluations, and the bounds that no cell of
/// this volume fraction exceeds.
fn plan(prepared: &Prepared) -> Result<Answer, Failure> {
    let basis = prepared.basis();
    let (unknowns, bounds) = (prepared.unknowns()?, prepared.bounds());
    let grids: Vec<String> = prepared.grids().iter().map(ToString::to_string).collect();
    let text = format!(
        "coefficients   {} (group {})\nunknowns       {unknowns}\nstages         {} voxels\nevaluations    at most {}\n\
         bounds         bulk {:.5}, shear {:.5}, young {:.5}, conductivity {:.5} of the solid's E and conductivity",
        basis.len(),
        basis.group().name(),
        grids.join(", "),
        prepared.max_evaluations(),
        bounds.bulk,
        bounds.shear,
        bounds.young,
        bounds.conductivity
    );
    let facts = json!({
        "coefficients": basis.len(),
        "group": basis.group().name(),
        "unknowns": unknowns,
        "voxels": prepared.grids(),
        "max_evaluations": prepared.max_evaluations(),
        "bounds": {
            "bulk": bounds.bulk,
            "shear": bounds.shear,
            "young": bounds.young,
            "conductivity": bounds.conductivity,
        },
    });
    Ok(Answer::new(text, facts))
}
