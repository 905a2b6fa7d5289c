//! `druse scaffold info FILE`.

use super::{Answer, Failure, Session};
use crate::io::read_scaffold;
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
    /// Kinds and number of elements, quality, inverted and degenerate elements, hanging nodes.
    Info {
        /// The mesh: .msh, .vtu or .vtk.
        file: PathBuf,
    },
}

pub(super) fn answer(p: &Parameters, _: &Session) -> Result<Answer, Failure> {
    let What::Info { file } = &p.what;
    let (text, facts) = describe(file)?;
    Ok(Answer::new(text, facts))
}

/// What a scaffold is, for people and for programs.
pub(super) fn describe(path: &Path) -> Result<(String, Value), Failure> {
    let file = read_scaffold(path)?;
    let report = file.scaffold.report();
    let groups: Vec<Value> = file
        .groups
        .iter()
        .map(|g| json!({ "name": g.name, "elements": g.elements.len() }))
        .collect();
    let bad =
        |list: &[crate::scaffold::BadElement]| list.iter().map(|b| b.number).collect::<Vec<u64>>();
    let kinds: serde_json::Map<String, Value> = report
        .kinds
        .iter()
        .map(|(k, n)| (k.name().to_owned(), json!(n)))
        .collect();
    let [min, max] = [report.bounds.min, report.bounds.max].map(|v| [v.x, v.y, v.z]);
    let facts = json!({
        "kind": "scaffold",
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
        "skipped": file.skipped,
        "warnings": report.warnings(),
    });
    let mut text = screen(path, &report);
    for group in &file.groups {
        let _ = writeln!(
            text,
            "group {:?}: {} elements",
            group.name,
            group.elements.len()
        );
    }
    for warning in report.warnings() {
        let _ = writeln!(text, "note: {warning}");
    }
    Ok((text, facts))
}

fn screen(path: &Path, r: &ScaffoldReport) -> String {
    let kinds: Vec<String> = r
        .kinds
        .iter()
        .map(|(k, n)| format!("{n} {}", k.name()))
        .collect();
    let mut text = format!(
        "{}: {}, {} nodes\n",
        path.display(),
        kinds.join(", "),
        r.nodes
    );
    let _ = writeln!(
        text,
        "box {:?} to {:?}, volume {:.6}",
        r.bounds.min.as_slice(),
        r.bounds.max.as_slice(),
        r.volume
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
