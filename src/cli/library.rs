//! `druse cell library`: a family of designed cells at several volume fractions that meet on their faces.
//!
//! The cell of the middle volume fraction is designed freely; the others keep its trace on the faces.

use super::homogenize::Sweep;
use super::{Answer, Failure, Session};
use crate::cell::Cell;
use crate::frame::Element;
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
    /// The directory of the .cell files.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::context::threads(p.threads)?;
    let fractions = format!("volume_fraction={}", p.volume_fraction)
        .parse::<Sweep>()
        .map_err(|e| Failure::usage(format!("--volume-fraction: {e}")))?
        .into_fractions();
    std::fs::create_dir_all(&p.output)
        .map_err(|e| Failure::usage(format!("{}: {e}", p.output.display())))?;
    let middle = fractions.len() / 2;
    let mut order: Vec<usize> = (0..fractions.len()).collect();
    order.swap(0, middle);
    let mut first: Option<Cell> = None;
    let mut text = String::new();
    let mut rows = Vec::new();
    for (n, place) in order.into_iter().enumerate() {
        let fraction = fractions[place];
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
            ..CellSection::default()
        };
        let name = format!("{:04}", (fraction * 1e4).round());
        let design = pipeline::design(
            &name,
            &section,
            Element::from(p.element),
            first.iter().cloned().collect(),
            &Path::to_path_buf,
        )
        .map_err(|e| Failure::usage(e.to_string()))?;
        let prepared = design.prepare()?;
        let made = threads.install(|| prepared.search(None, session))?;
        let path = p.output.join(format!("{name}.cell"));
        let bytes = write_cell(&path, &made.cell)?;
        if made.is_stopped {
            return Err(Failure::resumable(format!(
                "interrupted; {} of {} cells are in {}",
                n,
                fractions.len(),
                p.output.display()
            )));
        }
        let report = made.cell.report().and_then(|r| r.design.clone());
        let bulk_over_bound = report
            .as_ref()
            .and_then(|r| r.properties.first())
            .map_or(0.0, |f| f.bulk_over_bound);
        let _ = writeln!(
            text,
            "{}  volume fraction {fraction}, bulk modulus {bulk_over_bound:.3} of its bound, {}",
            path.display(),
            super::run::size(bytes)
        );
        rows.push(json!({
            "path": path.display().to_string(),
            "bytes": bytes,
            "volume_fraction": fraction,
            "design": report,
        }));
        first.get_or_insert(made.cell);
    }
    Ok(Answer::new(
        text,
        json!({ "kind": "library", "cells": rows }),
    ))
}
