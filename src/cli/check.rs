//! `druse check FILE`: checks of a mesh or of the level sets of a file.

use super::kind::FileKind;
use super::{Answer, Failure, Session};
use crate::frame::{LengthUnit, figures, place_figures};
use crate::io::{BeamCap, BeamPart, SolidFile, read_solid};
use crate::mesh::MeshReport;
use crate::progress::Threads;
use crate::vdb::{self, Adopted, FileError, GridInfo};
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    /// A mesh (.stl .obj .ply .off .3mf .vtp, surfaces and solids of .vtu .vtk .msh .inp) or an OpenVDB file.
    file: PathBuf,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
    /// List the cavities of a level set, closed or not, with the radius of the largest ball that can leave.
    #[arg(long)]
    cavities: bool,
    #[command(flatten)]
    layers: super::layers::Parameters,
    #[command(flatten)]
    require: super::require::Parameters,
}

pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::context::threads(p.threads)?;
    let kinds = [FileKind::Mesh, FileKind::Scaffold, FileKind::Vdb];
    match FileKind::of(&p.file, &kinds)? {
        FileKind::Vdb => level_sets(p, &threads, session),
        _ => threads.install(|| mesh(p, session)),
    }
}

fn mesh(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let path = &p.file;
    if p.cavities || p.layers.is_requested() {
        let flag = if p.cavities { "--cavities" } else { "--layer" };
        let found = format!("found {flag} for a mesh; expected a level set");
        return Err(Failure::data(path, found)
            .hint("druse voxelize MESH -o PART.vdb makes one, with voxels of a third of the escape radius or of the wall"));
    }
    let require = p.require.read()?;
    let solid = read_solid(path)?;
    let report = crate::mesh::check_with(&solid.file.mesh, true, session)
        .map_err(|_| Failure::stopped(130))?;
    let (mut text, facts, passed) = solid_screen(path, &solid, &report);
    for warning in &solid.file.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    let requirements = match &require {
        Some(r) => p.require.judge_mesh(r, path, (&solid, &report))?,
        None => Vec::new(),
    };
    Ok(super::require::add(text, facts, passed, &requirements))
}

/// A mesh and its beams, as text and as an object, and whether they bound a solid without repair.
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

/// The lines and facts on beams.
fn beam_screen(parts: &[BeamPart], unit: Option<LengthUnit>) -> (String, Value) {
    let beams = || parts.iter().flat_map(|p| &p.beams);
    let balls = || parts.iter().flat_map(|p| &p.balls);
    let range = |radii: &mut dyn Iterator<Item = f64>| {
        radii.fold([f64::INFINITY, 0.0f64], |r, x| [r[0].min(x), r[1].max(x)])
    };
    let length: f64 = beams().map(|b| (b.ends[1] - b.ends[0]).norm()).sum();
    let symbol = unit.map_or_else(String::new, |u| format!(" {u}"));
    let plural = |n: usize| if n == 1 { "" } else { "s" };
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

/// The report of a mesh, as an object.
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

/// Whether a grid is a level set, or has the values of one and no stated class.
fn may_be_level_set(grid: &GridInfo) -> bool {
    let has_both_signs = grid
        .values
        .is_some_and(|[low, high]| low < 0.0 && high > 0.0);
    match grid.class.as_str() {
        "level set" => true,
        "unknown" => has_both_signs && grid.background.is_some_and(|b| b != 0.0),
        _ => false,
    }
}

/// Reports a level set that commands refuse without repair.
fn refused(error: &FileError, grid: &GridInfo, text: &mut String) -> Value {
    let message = error.to_string();
    let problem = message
        .split_once(&format!("grid {:?} has ", grid.name))
        .map_or(message.as_str(), |m| m.1);
    let hint = error.hint().unwrap_or_default();
    let _ = writeln!(
        text,
        "grid {:?}: {}: NOT sound\n  {problem}\n  hint: {hint}",
        grid.name, grid.class
    );
    json!({ "name": grid.name, "problems": [problem], "hint": hint })
}

/// Checks one level set; the result as text and as an object.
fn level_set(
    adopted: &Adopted,
    (grid, unit): (&GridInfo, &str),
    text: &mut String,
    session: vdb::Session<'_>,
) -> Result<Value, Failure> {
    let mut check = adopted.solid.check(session)?;
    if let Some(at) = check.torn_at.filter(|_| !grid.cubic) {
        check.torn_at = Some(grid.index_map().world(at.into()).into());
    }
    let mut problems = check.problems();
    if !grid.cubic {
        problems.push(format!(
            "{}, which are not cubes along the axes: commands read it with --resample",
            grid.shape()
        ));
    }
    let voxel = if grid.cubic {
        format!("voxel {} {unit}", check.voxel_size)
    } else {
        format!("{} {unit}", grid.shape())
    };
    let _ = writeln!(
        text,
        "grid {:?}: {}, {voxel}, band of {:.3} voxels, {} active voxels: {}",
        grid.name,
        grid.class,
        check.half_width,
        super::run::grouped(check.active_voxels),
        if problems.is_empty() {
            "sound"
        } else {
            "NOT sound"
        }
    );
    for line in problems.iter().chain(&adopted.notes) {
        let _ = writeln!(text, "  {line}");
    }
    let [inside, outside] = check.known_widths;
    if inside.min(outside) < check.half_width {
        let _ = writeln!(
            text,
            "  band of {inside:.3} voxels inside and {outside:.3} outside: operations rebuild it first"
        );
    }
    let mut facts = serde_json::to_value(&check).unwrap_or_default();
    if !grid.cubic {
        facts["voxel_size"] = json!(grid.voxel_size);
    }
    facts["name"] = json!(grid.name);
    facts["problems"] = json!(problems);
    facts["notes"] = json!(adopted.notes);
    Ok(facts)
}

fn level_sets(p: &Parameters, threads: &Threads, shown: &Session) -> Result<Answer, Failure> {
    let (path, session) = (&p.file, vdb::Session::new(threads, shown));
    let require = p.require.read()?;
    let mut requirements = Vec::new();
    let info = super::vdb::inspect(path)?;
    let unit = super::info::unit_of(&info);
    let mut text = format!("{}\n", super::terminal::path(path));
    let (mut passed, mut grids) = (true, Vec::new());
    for grid in &info.grids {
        if !may_be_level_set(grid) {
            let _ = writeln!(text, "grid {:?}: {}, not checked", grid.name, grid.class);
            for note in &grid.notes {
                let _ = writeln!(text, "  {}", super::terminal::line(note));
            }
            continue;
        }
        let facts = match super::vdb::unchecked(path, &grid.name, session)? {
            Ok(adopted) => {
                let mut facts = level_set(&adopted, (grid, &unit), &mut text, session)?;
                if p.cavities {
                    let part = (path.as_path(), &adopted.solid, unit.as_str());
                    let (lines, list) = super::require::list_cavities(part, threads, shown)?;
                    text.push_str(&lines);
                    facts["cavities"] = list;
                }
                let part = (path.as_path(), &adopted.solid, unit.as_str());
                if let Some((lines, found)) = p.layers.list(part, threads, shown)? {
                    text.push_str(&lines);
                    facts["layers"] = found;
                }
                if let Some(require) = require.as_ref().filter(|_| requirements.is_empty()) {
                    let part = (path.as_path(), &adopted.solid, unit.as_str());
                    requirements = super::require::of_level_set(require, part, threads, shown)?;
                }
                facts
            }
            Err(e) if grid.class == "level set" => refused(&e, grid, &mut text),
            Err(_) => {
                let _ = writeln!(text, "grid {:?}: {}, not checked", grid.name, grid.class);
                continue;
            }
        };
        passed &= facts["problems"].as_array().is_some_and(Vec::is_empty);
        grids.push(facts);
    }
    if grids.is_empty() {
        passed = false;
        let _ = writeln!(text, "no level set to check");
    }
    let recorded = info.meta("druse.content_hash").or_else(|| {
        info.grids
            .first()
            .and_then(|g| g.meta("druse.content_hash"))
    });
    let same = recorded
        .as_ref()
        .map(|r| Some(r) == info.content_hash.as_ref());
    match same {
        Some(true) => text.push_str("content hash: as recorded\n"),
        Some(false) => {
            passed = false;
            text.push_str("content hash: NOT as recorded, the grids were changed\n");
        }
        None => text.push_str("content hash: none recorded\n"),
    }
    let facts = json!({
        "kind": "vdb", "path": path.display().to_string(), "unit": unit, "grids": grids,
        "content_hash": info.content_hash, "content_hash_as_recorded": same, "passed": passed,
    });
    Ok(super::require::add(text, facts, passed, &requirements))
}
