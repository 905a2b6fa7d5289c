//! A solid of a file in words and as JSON: its mesh with defects, and its beams. Lengths are in the file's unit.

use crate::frame::{LengthUnit, figures, place_figures};
use crate::io::{BeamCap, BeamPart, SolidFile};
use crate::mesh::MeshReport;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;

/// A mesh and its beams, as text and as an object, and whether they bound a solid without repair. `report` is that
/// of the mesh.
pub(super) fn solid_screen(
    path: &Path,
    solid: &SolidFile,
    report: &MeshReport,
) -> (String, Value, bool) {
    let mesh = &solid.file.mesh;
    let unit = solid.file.unit;
    let shown = unit.map_or("of no stated unit", LengthUnit::symbol);
    let mut text = format!("{} ({shown})\n", super::terminal::path(path));
    let mut facts = mesh_facts(path, report);
    facts["unit"] = json!(unit.map(LengthUnit::symbol));
    facts["notes"] = json!(solid.file.warnings);
    if !mesh.is_empty() || solid.beams.is_empty() {
        let _ = writeln!(text, "{}", report.text(unit));
    }
    let mut passed = report.is_solid();
    if !solid.beams.is_empty() {
        if mesh.is_empty() {
            // Every beam is closed by its ends.
            passed = true;
            for (word, _) in report.properties() {
                facts[word.replace([' ', '-'], "_")] = Value::Null;
            }
            facts["passed"] = json!(true);
        }
        let (lines, found) = beam_screen(&solid.beams, unit);
        text.push_str(&lines);
        facts["beams"] = found;
        let bounds = solid.bounds();
        let _ = writeln!(
            text,
            "box {} to {} with the beams",
            place_figures(bounds.min),
            place_figures(bounds.max)
        );
        facts["box"] = json!([bounds.min, bounds.max].map(|v| [v.x, v.y, v.z]));
    }
    (text, facts, passed)
}

/// The lines and facts on the beams and balls of a file.
pub(super) fn beam_screen(parts: &[BeamPart], unit: Option<LengthUnit>) -> (String, Value) {
    let beams = || parts.iter().flat_map(|p| &p.beams);
    let balls = || parts.iter().flat_map(|p| &p.balls);
    let range = |radii: &mut dyn Iterator<Item = f64>| {
        radii.fold([f64::INFINITY, 0.0f64], |r, x| [r[0].min(x), r[1].max(x)])
    };
    let length: f64 = beams().map(|b| (b.ends[1] - b.ends[0]).norm()).sum();
    let symbol = unit.map_or_else(String::new, |u| format!(" {u}"));
    let plural = |n: usize| if n == 1 { "" } else { "s" };
    // One number where all radii are equal.
    let span = |r: [f64; 2]| {
        if r[0] == r[1] {
            format!("radius {}{symbol}", figures(r[0]))
        } else {
            format!("radii {} to {}{symbol}", figures(r[0]), figures(r[1]))
        }
    };
    let count = beams().count();
    let mut text = String::new();
    let mut facts = json!({ "count": count, "length": length, "balls": balls().count() });
    if count > 0 {
        let radii = range(&mut beams().flat_map(|b| b.radii));
        facts["radii"] = json!(radii);
        let _ = write!(text, "{count} beam{}, {}", plural(count), span(radii));
        let _ = write!(text, ", {}{symbol} long in all", figures(length));
        let caps = [
            ("sphere", BeamCap::Sphere),
            ("hemisphere", BeamCap::Hemisphere),
            ("butt", BeamCap::Butt),
        ];
        let mut ends = Vec::new();
        for (name, cap) in caps {
            let n = beams().flat_map(|b| b.caps).filter(|c| *c == cap).count();
            facts["caps"][name] = json!(n);
            if n > 0 {
                ends.push(format!("{n} {name}"));
            }
        }
        let _ = writeln!(text, "; ends: {}", ends.join(", "));
    }
    if balls().count() > 0 {
        let radii = range(&mut balls().map(|b| b.1));
        facts["ball_radii"] = json!(radii);
        let n = balls().count();
        let _ = writeln!(text, "{n} ball{}, {}", plural(n), span(radii));
    }
    let clipped = |inside: bool| {
        let clips = parts.iter().filter_map(|p| p.clip.as_ref());
        clips.filter(|c| c.keeps_inside == inside).count()
    };
    let clips = [clipped(true), clipped(false)];
    facts["clipped"] = json!({ "inside": clips[0], "outside": clips[1] });
    for (n, side) in clips.into_iter().zip(["inside", "outside"]) {
        if n > 0 {
            let _ = writeln!(text, "{n} lattice{} kept {side} a mesh", plural(n));
        }
    }
    (text, facts)
}

/// The report of a mesh, as an object: counts, measures in the file's unit, defects with some of their places,
/// shells, and a flag for each property (closed, manifold and so on).
pub(super) fn mesh_facts(path: &Path, r: &MeshReport) -> Value {
    let defects: serde_json::Map<String, Value> = r
        .defects()
        .into_iter()
        .map(|(name, finding)| {
            let places: Vec<[f64; 3]> = finding.places.iter().map(|d| d.at.into()).collect();
            let facts = json!({ "count": finding.count, "places": places });
            (name.to_owned(), facts)
        })
        .collect();
    let corners = [r.bounds.min, r.bounds.max].map(|v| [v.x, v.y, v.z]);
    let mut facts = json!({
        "kind": "mesh", "path": path.display().to_string(),
        "vertices": r.vertices, "triangles": r.triangles, "components": r.components,
        "volume": r.volume, "area": r.area,
        "box": corners,
        "defects": defects, "passed": r.is_solid(),
    });
    if let Some(shells) = &r.shells {
        facts["shells"] = json!({
            "count": shells.shells,
            "inconsistent_faces": shells.inconsistent_faces,
            "inward": shells.inward_shells,
            "overlapping": shells.overlapping_shells,
            "nested": shells.nested_shells,
            "open": shells.open_shells,
        });
    }
    for (word, answer) in r.properties() {
        facts[word.replace([' ', '-'], "_")] = json!(answer);
    }
    facts
}
