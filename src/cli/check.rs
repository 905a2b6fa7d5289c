//! `druse check FILE`: a mesh in four words, a level set against its promise.

use super::kind::FileKind;
use super::{Answer, Failure, Session};
use crate::io::read_mesh;
use crate::mesh::MeshReport;
use crate::progress::Threads;
use crate::vdb;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    /// A mesh (.stl, .obj, .ply, .3mf) or an OpenVDB file.
    file: PathBuf,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
    #[command(flatten)]
    require: super::require::Parameters,
}

pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::session::threads(p.threads)?;
    match FileKind::of(&p.file, &[FileKind::Mesh, FileKind::Vdb])? {
        FileKind::Vdb => level_sets(p, &threads, session),
        _ => threads.install(|| mesh(p, session)),
    }
}

fn mesh(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let path = &p.file;
    let require = p.require.read()?;
    let file = read_mesh(path)?;
    let report =
        crate::mesh::check_with(&file.mesh, true, session).map_err(|_| Failure::stopped(130))?;
    let text = format!("{}\n{report}", path.display());
    let requirements = match &require {
        Some(r) => p.require.judge_mesh(r, path, (&file, &report))?,
        None => Vec::new(),
    };
    let facts = mesh_facts(path, &report);
    Ok(super::require::add(
        text,
        facts,
        report.is_solid(),
        &requirements,
    ))
}

/// What is known of a mesh, as an object.
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
    for (word, answer) in r.words() {
        facts[word.replace([' ', '-'], "_")] = json!(answer);
    }
    facts
}

fn level_sets(p: &Parameters, threads: &Threads, shown: &Session) -> Result<Answer, Failure> {
    let (path, session) = (&p.file, vdb::Session::new(threads, shown));
    let require = p.require.read()?;
    let mut requirements = Vec::new();
    let info = super::vdb::inspect(path)?;
    let unit = super::info::unit_of(&info);
    let mut text = format!("{}\n", path.display());
    let (mut passed, mut grids) = (true, Vec::new());
    for grid in &info.grids {
        if grid.class != "level set" {
            let _ = writeln!(text, "grid {:?}: {}, not checked", grid.name, grid.class);
            continue;
        }
        let solid = super::vdb::level_set(path, Some(&grid.name), session)?;
        let check = solid.check(session)?;
        let problems = check.problems();
        passed &= problems.is_empty();
        let _ = writeln!(
            text,
            "grid {:?}: level set, voxel {} {unit}, band of {:.3} voxels, {} active voxels: {}",
            grid.name,
            check.voxel_size,
            check.half_width,
            super::run::grouped(check.active_voxels),
            if problems.is_empty() {
                "sound"
            } else {
                "NOT sound"
            }
        );
        for problem in &problems {
            let _ = writeln!(text, "  {problem}");
        }
        let [inside, outside] = check.known_widths;
        if inside.min(outside) < check.half_width {
            let _ = writeln!(
                text,
                "  band of {inside:.3} voxels inside and {outside:.3} outside: operations rebuild it first"
            );
        }
        let mut facts = serde_json::to_value(&check).unwrap_or_default();
        facts["name"] = json!(grid.name);
        facts["problems"] = json!(problems);
        if let Some(require) = require.as_ref().filter(|_| requirements.is_empty()) {
            let part = (path.as_path(), &solid, unit.as_str());
            requirements = super::require::of_level_set(require, part, threads, shown)?;
        }
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
