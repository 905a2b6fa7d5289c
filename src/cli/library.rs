//! `druse cell library`: designs cells with several volume fractions whose surfaces meet on shared faces.
//!
//! The cell of the middle volume fraction is designed freely; the others keep its trace on the faces of the element.
//! Each cell is written as soon as it is complete.

use super::context::Session;
use super::failure::Failure;
use super::homogenize::Sweep;
use super::output::Answer;
use crate::cell::Cell;
use crate::frame::Element;
use crate::io::atomic::require_directory;
use crate::io::write_cell;
use crate::pipeline;
use crate::recipe::{CellSection, ElementName, Fraction, Positive, TargetWord};
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    /// The target, as for `druse fit --target`.
    #[arg(long, value_name = "TARGET")]
    target: TargetWord,
    /// Volume fractions.
    #[arg(long, value_name = "FROM:TO:STEP")]
    volume_fraction: String,
    /// The element: hex or tet.
    #[arg(long, default_value = "hex")]
    element: ElementName,
    /// Frequencies up to this many cycles per unit of reference length.
    #[arg(long, value_name = "R", default_value = "4")]
    band_limit: Positive,
    /// A surface or a .cell file to start from.
    #[arg(long, value_name = "NAME")]
    start: Option<String>,
    /// Seed of random cells to start from.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Least width of walls and gaps, in reference lengths.
    #[arg(long, value_name = "LENGTH")]
    min_feature: Option<Positive>,
    /// The directory of the .cell files.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Designs the cells in turn, the middle one first, whose faces the others match, and writes each into the folder.
///
/// # Errors
/// Invalid arguments, a search without a connected cell, a file that cannot be written, and an interruption.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::context::threads(p.threads)?;
    let fractions = format!("volume_fraction={}", p.volume_fraction)
        .parse::<Sweep>()
        .map_err(|e| Failure::usage(format!("--volume-fraction: {e}")))?
        .into_fractions();
    check_names(&fractions)?;
    require_directory(&p.output)?;
    let mut design_order = fractions.clone();
    design_order.swap(0, fractions.len() / 2);
    let mut middle_cell: Option<Cell> = None;
    let mut complete_names: Vec<String> = Vec::new();
    let mut text = String::new();
    let mut rows = Vec::new();
    for (n, &fraction) in design_order.iter().enumerate() {
        session.note(&format!(
            "cell {} of {}: volume fraction {fraction}",
            n + 1,
            fractions.len()
        ));
        let section = CellSection {
            target: Some(p.target.clone()),
            volume_fraction: Some(Fraction(fraction)),
            band_limit: Some(p.band_limit),
            start: p.start.clone(),
            seed: p.seed,
            min_feature: p.min_feature,
            ..CellSection::default()
        };
        let name = cell_name(fraction);
        let design = pipeline::design(
            &name,
            &section,
            Element::from(p.element),
            middle_cell.iter().cloned().collect(),
            &Path::to_path_buf,
        )
        .map_err(|e| Failure::usage(e.to_string()))?;
        let prepared = design.prepare()?;
        let designed = threads.install(|| prepared.search(None, session))?;
        let file_name = format!("{name}.cell");
        let path = p.output.join(&file_name);
        let bytes = write_cell(&path, &designed.cell)?;
        // The complete cells and the best one of this search stay as files; another run begins anew.
        if designed.is_stopped {
            return Err(interrupted(&path, &complete_names, fractions.len()));
        }
        let report = designed.cell.report().and_then(|r| r.design.clone());
        let properties = report.as_ref().and_then(|r| r.properties.first());
        let bulk = properties.map_or_else(String::new, |found| {
            format!(
                "bulk modulus {:.3} of its upper Hashin-Shtrikman bound, ",
                found.bulk_over_bound
            )
        });
        let _ = writeln!(
            text,
            "{}  volume fraction {fraction}, {bulk}{}",
            super::terminal::path(&path),
            super::numbers::size(bytes)
        );
        rows.push(json!({
            "path": path.display().to_string(),
            "bytes": bytes,
            "volume_fraction": fraction,
            "design": report,
        }));
        complete_names.push(file_name);
        middle_cell.get_or_insert(designed.cell);
    }
    Ok(Answer::new(
        text,
        json!({ "kind": "library", "cells": rows }),
    ))
}

/// Name of the cell with a volume fraction: four digits, in ten thousandths.
fn cell_name(fraction: f64) -> String {
    format!("{:04}", (fraction * 1e4).round())
}

/// Refuses volume fractions, in ascending order, whose cells would have the same name and overwrite each other.
fn check_names(fractions: &[f64]) -> Result<(), Failure> {
    let same = fractions
        .windows(2)
        .find(|pair| cell_name(pair[0]) == cell_name(pair[1]));
    match same {
        None => Ok(()),
        Some(pair) => Err(Failure::usage(format!(
            "--volume-fraction: {} and {} both have the file {}.cell; expected fractions that differ \
             when rounded to four decimals",
            pair[0],
            pair[1],
            cell_name(pair[0])
        ))),
    }
}

/// The failure of a search that was interrupted, after it wrote its best cell to `path`.
fn interrupted(path: &Path, complete_names: &[String], count: usize) -> Failure {
    let complete = match complete_names {
        [] => "no cell is complete".to_owned(),
        names => format!(
            "{} of {count} cells are complete: {}",
            names.len(),
            names.join(", ")
        ),
    };
    Failure::resumable(format!(
        "interrupted; {complete}; {} is the best cell so far",
        path.display()
    ))
    .hint("the same command designs every cell anew")
}
