//! `--pareto X.png`: bulk modulus over permeability of a cell, of others beside it, and of the named surfaces.
//!
//! Voxels are wholly solid or void, so that no figure crosses its bound. The surfaces have the volume fraction of
//! the cell, each as a network and as a sheet.

use super::{Parameters, with_files};
use crate::cell::{Cell, DesignProperties, Solid, Surface};
use crate::cli::context::Session;
use crate::cli::failure::Failure;
use crate::cli::output::Answer;
use crate::frame::Element;
use crate::homogenize::Settings;
use crate::inverse::properties_of;
use crate::io::atomic::write_bytes;
use crate::pipeline::{CellPeriod, SweepCurve, sweep_picture};
use crate::progress::Progress;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;

/// The surfaces beside the cells.
const SURFACES: [Surface; 5] = [
    Surface::SchwarzP,
    Surface::Gyroid,
    Surface::Diamond,
    Surface::Iwp,
    Surface::FRd,
];

/// A cell in the picture.
struct Entry {
    name: String,
    found: DesignProperties,
    /// Whether no other cell is at least as good in both figures and better in one.
    is_best: bool,
}

impl Entry {
    /// Permeability and bulk modulus over its bound; a closed cell has no permeability.
    fn place(&self) -> [f64; 2] {
        [
            self.found.permeability.unwrap_or(0.0),
            self.found.bulk_over_bound,
        ]
    }
}

/// The named surfaces at a volume fraction, as networks and sheets.
fn surfaces(element: Element, fraction: f64) -> Vec<Cell> {
    let kinds = SURFACES
        .into_iter()
        .flat_map(|s| [(s, Solid::Below), (s, Solid::Sheet)]);
    // A surface without a cell in this element, or without a level for the fraction, is left out. The level 0.1 is
    // provisional: that of a sheet must be above 0.
    let made = kinds.filter_map(|(surface, solid)| {
        let cell = surface.cell(element).ok()?.with_solid(solid, 0.1).ok()?;
        let level = cell.level_for_volume_fraction(fraction).ok()?;
        cell.with_solid(solid, level).ok()
    });
    made.collect()
}

/// Pictures the cells, and returns the text and table of their figures. `source` is the cell itself;
/// `picture` is the file of the picture.
///
/// # Errors
/// A period without a cell of a hex or a tet, a file that cannot be read or written, and those of the solver.
pub(super) fn answer(
    p: &Parameters,
    source: &CellPeriod,
    picture: &Path,
    settings: &Settings,
    session: &Session,
) -> Result<Answer, Failure> {
    let refused = |name: &str| {
        Failure::usage(format!(
            "--pareto: found {name}; expected a cell of a hex or a tet that is a series, as druse fit makes one"
        ))
    };
    let check = |cell: &Cell| match cell.element() {
        Element::Hex | Element::Tet => Ok(()),
        _ => Err(refused(cell.name())),
    };
    let first_cell = source.period.cell().ok_or_else(|| refused(&source.name))?;
    check(first_cell)?;
    let mut cells = vec![first_cell.clone()];
    for path in &p.beside {
        let cell = crate::cli::cell_text::read(path)?;
        check(&cell)?;
        cells.push(cell);
    }
    // Named surfaces at the same volume fraction are the measure for all cells.
    cells.extend(surfaces(first_cell.element(), first_cell.volume_fraction()));
    let mut entries: Vec<Entry> = Vec::new();
    session.stage("cells", Some(cells.len() as u64));
    for cell in &cells {
        let kind = if cell.solid().is_symmetric() {
            "sheet"
        } else {
            "network"
        };
        entries.push(Entry {
            name: format!("{} {kind}", cell.name()),
            found: properties_of(cell, p.resolution, settings, session)?,
            is_best: false,
        });
        session.advance(1);
    }
    let places: Vec<[f64; 2]> = entries.iter().map(Entry::place).collect();
    for entry in &mut entries {
        let [k, bulk] = entry.place();
        entry.is_best = !places
            .iter()
            .any(|o| (o[0] >= k && o[1] > bulk) || (o[0] > k && o[1] >= bulk));
    }
    let rows: Vec<Value> = entries.iter().map(row).collect();
    let facts = json!({ "kind": "pareto", "voxels": p.resolution, "cells": rows });
    let mut text = String::new();
    for e in &entries {
        let _ = writeln!(
            text,
            "{:<26} permeability {:.2e}, bulk {:.3} of its bound, opening {:.4}{}",
            crate::cli::terminal::line(&e.name),
            e.place()[0],
            e.place()[1],
            e.found.opening.unwrap_or(0.0),
            if e.is_best { ", best" } else { "" }
        );
    }
    let mut files = Vec::new();
    if let Some(path) = &p.output {
        let is_csv = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("csv"));
        let table = if is_csv {
            csv(&entries)
        } else {
            format!("{facts:#}\n")
        };
        files.push((path.as_path(), write_bytes(path, table.as_bytes())?));
    }
    let title = format!(
        "bulk modulus over its bound, volume fraction {:.3}",
        first_cell.volume_fraction()
    );
    let image = sweep_picture(
        &title,
        "permeability, logarithm to base 10",
        &curves(&entries),
    );
    files.push((picture, write_bytes(picture, &image.png()?)?));
    Ok(with_files(text, facts, &files))
}

/// An entry as an object.
fn row(e: &Entry) -> Value {
    json!({
        "name": e.name,
        "volume_fraction": e.found.volume_fraction,
        "permeability": e.found.permeability,
        "bulk": e.found.bulk,
        "bulk_over_bound": e.found.bulk_over_bound,
        "zener": e.found.zener,
        "opening": e.found.opening,
        "is_best": e.is_best,
    })
}

/// The entries as a table; a closed cell has the permeability and opening 0.
fn csv(entries: &[Entry]) -> String {
    let mut text =
        "name,volume_fraction,permeability,bulk,bulk_over_bound,zener,opening,is_best\n".to_owned();
    for e in entries {
        let f = &e.found;
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{}",
            e.name.replace([',', '"', '\n'], " "),
            f.volume_fraction,
            e.place()[0],
            f.bulk,
            f.bulk_over_bound,
            f.zener,
            f.opening.unwrap_or(0.0),
            e.is_best
        );
    }
    text
}

/// One point for each cell, and the line through the best ones.
fn curves(entries: &[Entry]) -> Vec<SweepCurve> {
    // A closed cell has no logarithm: it stands a decade below the others.
    let positive = entries.iter().map(|e| e.place()[0]).filter(|k| *k > 0.0);
    let least = positive.fold(1.0, f64::min) / 10.0;
    let point = |e: &Entry| [e.place()[0].max(least).log10(), e.place()[1]];
    let mut best: Vec<[f64; 2]> = entries.iter().filter(|e| e.is_best).map(point).collect();
    best.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let front = SweepCurve {
        name: "best".to_owned(),
        points: best,
    };
    let singles = entries.iter().map(|e| SweepCurve {
        name: e.name.clone(),
        points: vec![point(e)],
    });
    std::iter::once(front).chain(singles).collect()
}
