//! `druse scaffold info FILE`, `druse scaffold make PART` and `druse scaffold check FILE`.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::frame::figures;
use crate::io::atomic::require_writable;
use crate::io::{
    DataField, ElementFile, FieldAt, Group, ScaffoldFile, SurfaceFile, read_elements,
    write_vtu_edges,
};
use crate::pipeline::{Probe, RunError, RunOptions};
use crate::recipe::Recipe;
use crate::scaffold::ScaffoldReport;
use clap::{Args, Subcommand};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Describe a mesh: kinds and number of elements, quality, inverted and degenerate elements, hanging nodes.
    Info {
        /// The mesh: .msh, .vtu, .vtk, .inp, .bdf, .nas, .mesh, .meshb, .unv or .usda; of surfaces also .off,
        /// .obj, .ply, .stl.
        file: PathBuf,
        /// Write the elements with their quality for ParaView or pyvista.
        #[arg(short, long, value_name = "X.vtu")]
        output: Option<PathBuf>,
    },
    /// Fill a closed mesh or a part of CAD with tets that keep its edges and corners, and show their quality.
    Make(super::scaffold_make::MakeFlags),
    /// Check that a mesh can be tiled and its elements conform; for a recipe also that its field is continuous
    /// across all shared faces. Exit code 1 if the check fails.
    Check {
        /// The mesh, or a recipe with a scaffold.
        file: PathBuf,
        /// For a recipe: write jumps, creases and weights of the elements for ParaView or pyvista; where no turns of
        /// the elements make its cells continue, the edges around which they do not.
        #[arg(short, long, value_name = "X.vtu")]
        output: Option<PathBuf>,
        /// For a recipe: maximum accepted jump of the value, over the range of the field [default: 1e-5].
        #[arg(long, value_name = "SHARE")]
        tolerance: Option<f64>,
        /// Override a key of the recipe, as in tiling.cell=octet.
        #[arg(long, value_name = "KEY=VALUE")]
        set: Vec<String>,
    },
}

/// Describes a scaffold, makes one, or checks one or the continuity of a recipe's tiling.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    match &p.what {
        What::Info { file, output } => {
            output.as_ref().map_or(Ok(()), require_writable)?;
            let (text, facts) = describe(file)?;
            if let Some(output) = output {
                write(file, output)?;
            }
            Ok(Answer::new(text, facts))
        }
        What::Make(flags) => {
            flags.write(session)?;
            let (text, facts) = describe(&flags.output)?;
            Ok(Answer::new(text, facts))
        }
        What::Check {
            file,
            output,
            tolerance,
            set,
        } => {
            // A recipe is checked as a tiling, another file as a mesh of elements.
            if file.extension().is_some_and(|e| e == "toml") {
                let tolerance = tolerance.unwrap_or(1e-5);
                return certificate(file, output.as_deref(), tolerance, set, session);
            }
            if output.is_some() || tolerance.is_some() || !set.is_empty() {
                let message =
                    "found --output, --tolerance or --set with a mesh; expected a recipe for these";
                let hint =
                    "druse scaffold info MESH -o X.vtu writes the elements with their quality";
                return Err(Failure::usage(message).hint(hint));
            }
            let (mut text, facts) = describe(file)?;
            let is_empty = |key: &str| {
                let list = facts[key].as_array();
                list.is_none_or(Vec::is_empty)
            };
            let passed = ["inverted", "degenerate", "warnings"]
                .into_iter()
                .all(is_empty);
            text.push_str(if passed { "sound\n" } else { "NOT sound\n" });
            Ok(Answer::new(text, facts).verdict(passed))
        }
    }
}

/// The continuity of a recipe's field over shared faces. It passes if no jump of the value exceeds
/// `tolerance`, a share of the field's range; `output` is a `.vtu` for the elements.
fn certificate(
    path: &Path,
    output: Option<&Path>,
    tolerance: f64,
    set: &[String],
    session: &Session,
) -> Result<Answer, Failure> {
    let recipe = Recipe::read(path, set)?;
    output.map_or(Ok(()), require_writable)?;
    let options = RunOptions {
        isolated: Some(super::vdb::reader()?),
        ..RunOptions::default()
    };
    let probe = match (Probe::new(&recipe, &options, session), output) {
        // Elements whose cells cannot continue: the file shows the edges around which they fail.
        (Err(RunError::Misfit { misfit, scaffold }), Some(path)) if !misfit.edges.is_empty() => {
            let edges: Vec<[u32; 2]> = misfit.edges.iter().map(|e| e.nodes).collect();
            let around: Vec<f64> = misfit.edges.iter().map(|e| e.elements as f64).collect();
            write_vtu_edges(path, scaffold.nodes(), &edges, &[("elements", &around)])?;
            return Err(RunError::Misfit { misfit, scaffold }.into());
        }
        (probe, _) => probe?,
    };
    let found = probe.certificate(output)?;
    let mut text = String::new();
    for kind in &found.faces {
        let _ = writeln!(
            text,
            "{} {} faces, {} points: value jump at most {:.3e} of the range (99 %: {:.3e}); \
             {} crossings: crease at most {:.3} degrees (99 %: {:.3})",
            kind.faces,
            kind.kind,
            kind.points,
            kind.value_jump_max,
            kind.value_jump_p99,
            kind.crossings,
            kind.crease_degrees_max,
            kind.crease_degrees_p99
        );
    }
    if found.turned_elements > 0 {
        let _ = writeln!(
            text,
            "{} elements turned so that the cells continue over their faces",
            found.turned_elements
        );
    }
    if found.blended_elements > 0 {
        let _ = writeln!(
            text,
            "{} elements hold the cells in several turns, where no turn alone makes them continue",
            found.blended_elements
        );
    }
    if found.faces.is_empty() {
        text.push_str("no faces are shared\n");
    }
    let passed = found.value_jump_max <= tolerance;
    // The worst faces whose jump exceeds the tolerance, with their elements and places.
    for seam in found.worst.iter().filter(|s| s.value_jump > tolerance) {
        let _ = writeln!(
            text,
            "elements {} and {}: jump {:.3e} at ({}, {}, {}), their faces {:.3e} apart",
            seam.elements[0],
            seam.elements[1],
            seam.value_jump,
            seam.at[0],
            seam.at[1],
            seam.at[2],
            seam.gap
        );
    }
    for warning in probe.warnings() {
        let _ = writeln!(text, "{}: {}", warning.code, warning.message);
    }
    text.push_str(if passed {
        "continuous\n"
    } else {
        "NOT continuous\n"
    });
    let facts = json!({
        "kind": "certificate", "path": path.display().to_string(), "continuity": found,
        "warnings": probe.warnings(), "passed": passed,
    });
    Ok(Answer::new(text, facts).verdict(passed))
}

/// Writes a scaffold with its quality.
fn write(path: &Path, output: &Path) -> Result<(), Failure> {
    let file = crate::io::read_scaffold(path)?;
    let quality: Vec<f64> = file.scaffold.elements().map(|e| e.quality()).collect();
    let volume: Vec<f64> = file.scaffold.elements().map(|e| e.volume()).collect();
    let number: Vec<f64> = (0..file.scaffold.len())
        .map(|e| file.scaffold.number(e) as f64)
        .collect();
    let fields: [(&str, &[f64]); 3] = [
        ("quality", &quality),
        ("volume", &volume),
        ("number", &number),
    ];
    crate::io::write_vtu(output, &file.scaffold, &fields)?;
    Ok(())
}

/// The description of a mesh of elements, as text and as an object.
pub(super) fn describe(path: &Path) -> Result<(String, Value), Failure> {
    match read_elements(path)? {
        ElementFile::Solids(file) => Ok(describe_solids(path, &file)),
        ElementFile::Surface(file) => Ok(describe_surface(path, &file)),
    }
}

/// The groups as objects; appends a line for each to `text`, as `fields_of` does.
fn groups_of(groups: &[Group], text: &mut String) -> Vec<Value> {
    let mut all = Vec::new();
    for group in groups {
        let count = group.elements.len();
        let _ = writeln!(text, "group {:?}: {count} elements", group.name);
        all.push(json!({ "name": group.name, "elements": count }));
    }
    all
}

/// The fields of a file with the range of each component, as lines in `text` and as objects.
fn fields_of(fields: &[DataField], text: &mut String) -> Vec<Value> {
    let mut all = Vec::new();
    for field in fields {
        let at = match field.at {
            FieldAt::Points => "points",
            FieldAt::Cells => "cells",
        };
        let ranges = ranges(field);
        let _ = writeln!(
            text,
            "field {:?}: {} number{} at {at}{}",
            field.name,
            field.components,
            if field.components == 1 { "" } else { "s" },
            spans(&ranges)
        );
        all.push(json!({
            "name": field.name, "at": at, "components": field.components, "range": ranges,
        }));
    }
    all
}

/// Minimum and maximum of each component that has a number; NaN is ignored.
fn ranges(field: &DataField) -> Vec<[f64; 2]> {
    let components = field.components.max(1);
    let mut all = vec![[f64::INFINITY, f64::NEG_INFINITY]; components];
    for (n, &v) in field.values.iter().enumerate() {
        let range = &mut all[n % components];
        *range = [range[0].min(v), range[1].max(v)];
    }
    all.retain(|r| r[0] <= r[1]);
    all
}

fn spans(ranges: &[[f64; 2]]) -> String {
    let span = |r: &[f64; 2]| format!("{} to {}", figures(r[0]), figures(r[1]));
    let all: Vec<String> = ranges.iter().take(9).map(span).collect(); // as many as a tensor has
    if all.is_empty() {
        return String::new();
    }
    format!(", {}", all.join("; "))
}

/// Reports skipped elements, unused nodes and notes of a reader.
fn left_out(skipped: usize, unused_nodes: usize, notes: &[String], text: &mut String) {
    let plural = |n: usize| if n == 1 { "" } else { "s" };
    if skipped > 0 {
        let s = plural(skipped);
        let _ = writeln!(text, "{skipped} element{s} of lower dimension passed over");
    }
    if unused_nodes > 0 {
        let s = plural(unused_nodes);
        let _ = writeln!(text, "{unused_nodes} node{s} without an element");
    }
    for note in notes {
        let _ = writeln!(text, "note: {}", super::terminal::line(note));
    }
}

/// The description of a mesh of surface elements, as text and as an object.
fn describe_surface(path: &Path, file: &SurfaceFile) -> (String, Value) {
    let kinds = file.surface.kinds();
    let listed: Vec<String> = kinds
        .iter()
        .map(|(k, n)| format!("{n} {}", k.name()))
        .collect();
    let bounds = file.surface.bounds();
    let [min, max] = [bounds.min, bounds.max].map(|v| [v.x, v.y, v.z]);
    let mut text = format!(
        "{}: a surface of {}, {} nodes\nbox {min:?} to {max:?}\n",
        super::terminal::path(path),
        listed.join(", "),
        file.surface.nodes().len()
    );
    let groups = groups_of(&file.groups, &mut text);
    let fields = fields_of(&file.fields, &mut text);
    left_out(file.skipped, file.unused_nodes, &file.notes, &mut text);
    let kinds: serde_json::Map<String, Value> = kinds
        .iter()
        .map(|(k, n)| (k.name().to_owned(), json!(n)))
        .collect();
    let facts = json!({
        "kind": "surface", "unit": null, "path": path.display().to_string(), "elements": kinds,
        "nodes": file.surface.nodes().len(), "box": [min, max], "groups": groups,
        "fields": fields, "skipped": file.skipped, "unused_nodes": file.unused_nodes,
        "notes": file.notes, "warnings": file.warnings,
    });
    for note in &file.warnings {
        let _ = writeln!(text, "note: {}", super::terminal::line(note));
    }
    (text, facts)
}

/// The description of a scaffold, as text and as an object.
fn describe_solids(path: &Path, file: &ScaffoldFile) -> (String, Value) {
    let report = file.scaffold.report();
    // Elements by their numbers in the file; `inverted` are the folded ones, whose Jacobian changes sign.
    let bad =
        |list: &[crate::scaffold::BadElement]| list.iter().map(|b| b.number).collect::<Vec<u64>>();
    let kinds: serde_json::Map<String, Value> = report
        .kinds
        .iter()
        .map(|(k, n)| (k.name().to_owned(), json!(n)))
        .collect();
    let [min, max] = [report.bounds.min, report.bounds.max].map(|v| [v.x, v.y, v.z]);
    let mut text = screen(path, &report);
    let groups = groups_of(&file.groups, &mut text);
    let fields = fields_of(&file.fields, &mut text);
    left_out(file.skipped, file.unused_nodes, &file.notes, &mut text);
    let mut warnings = file.warnings.clone();
    warnings.extend(report.warnings());
    let places = |list: &[crate::scaffold::BadElement]| {
        let place = |b: &crate::scaffold::BadElement| {
            json!({ "element": b.number, "kind": b.kind.name(), "jacobian": b.determinant,
                    "at": b.at.to_string() })
        };
        list.iter().map(place).collect::<Vec<Value>>()
    };
    let facts = json!({
        "kind": "scaffold",
        "unit": null,
        "inverted_at": places(&report.folded),
        "degenerate_at": places(&report.degenerate),
        "path": path.display().to_string(),
        "elements": kinds,
        "nodes": report.nodes,
        "volume": report.volume,
        "box": [min, max],
        "quality": { "worst": report.worst_quality.0, "element": report.worst_quality.1,
                     "mean": report.mean_quality },
        "curved": report.curved,
        "inverted": bad(&report.folded),
        "degenerate": bad(&report.degenerate),
        "mirrored": report.mirrored.len(),
        "hanging": report.defects.hanging.len(),
        "components": report.components,
        "outer_faces": report.outer_faces,
        "groups": groups,
        "fields": fields,
        "skipped": file.skipped,
        "unused_nodes": file.unused_nodes,
        "notes": file.notes,
        "warnings": warnings,
    });
    for note in &warnings {
        let _ = writeln!(text, "note: {}", super::terminal::line(note));
    }
    (text, facts)
}

/// The report of a scaffold as lines; the first inverted and the first degenerate element are named.
fn screen(path: &Path, r: &ScaffoldReport) -> String {
    let kinds: Vec<String> = r
        .kinds
        .iter()
        .map(|(k, n)| format!("{n} {}", k.name()))
        .collect();
    let mut text = format!(
        "{}: {}, {} nodes\n",
        super::terminal::path(path),
        kinds.join(", "),
        r.nodes
    );
    let _ = writeln!(
        text,
        "box {:?} to {:?}, volume {}",
        r.bounds.min.as_slice(),
        r.bounds.max.as_slice(),
        figures(r.volume)
    );
    let _ = writeln!(
        text,
        "quality {:.4} on average, worst {:.4} (element {}); {} curved",
        r.mean_quality, r.worst_quality.0, r.worst_quality.1, r.curved
    );
    let _ = writeln!(
        text,
        "{} inverted, {} degenerate, {} hanging nodes, {} component{}, {} outer faces",
        r.folded.len(),
        r.degenerate.len(),
        r.defects.hanging.len(),
        r.components,
        if r.components == 1 { "" } else { "s" },
        r.outer_faces
    );
    let first = |name: &str, list: &[crate::scaffold::BadElement], text: &mut String| {
        if let Some(bad) = list.first() {
            let _ = writeln!(
                text,
                "{name}: element {} ({}), Jacobian {:.3e} at {}",
                bad.number,
                bad.kind.name(),
                bad.determinant,
                bad.at
            );
        }
    };
    first("inverted", &r.folded, &mut text);
    first("degenerate", &r.degenerate, &mut text);
    text
}
