//! A cell in words and as JSON, and cells from the arguments of a command. Commands on cells and the summary of
//! files share these.

use super::failure::Failure;
use crate::cell::{Cell, DesignReport, Surface};
use crate::frame::Element;
use crate::io::read_cell;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;

/// A cell from its file, or from the name of a surface.
pub(super) fn read(path: &Path) -> Result<Cell, Failure> {
    match surface(path, None)? {
        Some(cell) => Ok(cell),
        None => Ok(read_cell(path)?),
    }
}

/// The description of a cell, as an object.
pub(super) fn facts(cell: &Cell) -> Value {
    let form = cell.expression();
    json!({
        "kind": "cell",
        "name": cell.name(),
        "element": cell.element().name(),
        "group": cell.group(),
        "operators": cell.operators().len(),
        "any_numbering": cell.fits_any_numbering(),
        "lattice": form.lattice_name(),
        "coefficients": form.coefficients(),
        "degrees_of_freedom": form.degrees_of_freedom(),
        "band_limit": form.band_limit(),
        "level": cell.level(),
        "solid": cell.solid().name(),
        "volume_fraction": cell.volume_fraction(),
        "gamma": cell.gamma(),
        "report": cell.report(),
    })
}

/// The description of a cell, as text: its symmetry and coefficients, its level, and the fit or design that made it.
pub(super) fn describe(cell: &Cell) -> String {
    let form = cell.expression();
    let mut text = format!(
        "{}: a {} cell, group {} ({} operators), lattice {}\n\
         {} coefficients, {} degrees of freedom, frequencies up to {:.3} per unit of length\n\
         solid {} {:.6}, {:.4} of the element, mean slope on the surface {:.4}\n",
        super::terminal::line(cell.name()),
        cell.element().name(),
        cell.group(),
        cell.operators().len(),
        form.lattice_name().unwrap_or("of several"),
        form.coefficients(),
        form.degrees_of_freedom(),
        form.band_limit(),
        cell.solid().name(),
        cell.level(),
        cell.volume_fraction(),
        cell.gamma(),
    );
    // A designed cell has no source, so its report has other numbers.
    if let Some(design) = cell.report().and_then(|r| r.design.as_ref()) {
        describe_design(design, &mut text);
    } else if let Some(report) = cell.report() {
        let _ = writeln!(
            text,
            "fit: rms {:.5}, greatest on faces {:.5}, kept energy {:.6}",
            report.rms, report.face_max, report.kept_energy
        );
        if let Some(h) = report.hausdorff {
            let _ = writeln!(
                text,
                "fit: Hausdorff distance of the surfaces {:.5}",
                h.max()
            );
        }
        if let Some(source) = report.source {
            let rounded = |c: [f64; 3]| c.map(|c| (c * 1e4).round() / 1e4);
            let size = match (source.triangles, source.points) {
                (0, 0) => source.kind.name().to_owned(),
                (0, points) => format!("{}, {points} samples", source.kind.name()),
                (triangles, _) => format!("{triangles} triangles ({} caps)", source.caps),
            };
            let _ = writeln!(
                text,
                "source: {size}, box {:?} to {:?}, {:.1} % inside",
                rounded(source.box_min),
                rounded(source.box_max),
                100.0 * source.share_inside
            );
        }
    }
    text
}

/// The cell of the surface that an argument names; `None` for another argument, which is a file then. It is made
/// for `element`, or without one for the surface's own.
pub(super) fn surface(argument: &Path, element: Option<Element>) -> Result<Option<Cell>, Failure> {
    let Some(surface) = argument.to_str().and_then(Surface::from_name) else {
        return Ok(None);
    };
    let failed = |e: crate::cell::CellError| Failure::data(argument, e.to_string());
    let element = element.unwrap_or(surface.element());
    surface.cell(element).map(Some).map_err(failed)
}

/// The name of a file without folder and extension; "cell" for a path without one.
pub(super) fn stem(path: &Path) -> String {
    path.file_stem()
        .map_or_else(|| "cell".into(), |s| s.to_string_lossy().into_owned())
}

/// Appends what a design made: its objective and start, the properties on each of its grids of voxels (moduli
/// relative to the solid's, lengths those of the reference cell).
pub(super) fn describe_design(report: &DesignReport, text: &mut String) {
    let _ = writeln!(
        text,
        "target {} at volume fraction {}: objective {:.5}, from {}{}",
        report.target,
        report.volume_fraction,
        report.objective,
        report.start,
        if report.complete { "" } else { ", interrupted" }
    );
    for p in &report.properties {
        let flow = p
            .permeability
            .map_or(String::new(), |k| format!(", permeability {k:.3e}"));
        let lengths = [
            ("opening", p.opening),
            ("least wall", p.least_wall),
            ("least gap", p.least_gap),
        ];
        let lengths: String = lengths
            .iter()
            .filter_map(|(what, found)| found.map(|d| format!(", {what} {d:.4}")))
            .collect();
        let _ = writeln!(
            text,
            "{} sharp voxels: bulk {:.5} ({:.3} of its bound), C44 {:.5}, Zener's ratio {:.3}, Poisson's ratio \
             {:.3}, conductivity {:.4}{flow}{lengths}",
            p.voxels, p.bulk, p.bulk_over_bound, p.c44, p.zener, p.poisson, p.conductivity
        );
    }
}
