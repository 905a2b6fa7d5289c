//! `druse check FILE`: checks of a mesh or of the level sets of a file, and of requirements on the part. The exit
//! code is 1 if a check or a requirement fails; the file is not changed.

use super::context::Session;
use super::failure::Failure;
use super::kind::FileKind;
use super::output::Answer;
use super::require::MeasuredPart;
use super::solid_text::solid_screen;
use crate::io::read_solid;
use crate::mesh::{SelfIntersections, check_with};
use crate::progress::Threads;
use crate::vdb;
use crate::vdb::{Adopted, FileError, GridInfo};
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::PathBuf;

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

/// Checks a file by its kind.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::context::threads(p.threads)?;
    p.layers.require_writable()?;
    let kinds = [FileKind::Mesh, FileKind::Scaffold, FileKind::Vdb];
    match FileKind::of(&p.file, &kinds)? {
        FileKind::Vdb => level_sets(p, &threads, session),
        _ => threads.install(|| mesh(p, session)),
    }
}

/// Checks a mesh. Cavities and layers need a level set and are refused.
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
    let report = check_with(&solid.file.mesh, SelfIntersections::Search, session)
        // The only error is a cancellation.
        .map_err(|_| Failure::stopped(130))?;
    let (mut text, facts, passed) = solid_screen(path, &solid, &report);
    for warning in &solid.file.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    let requirements = match &require {
        Some(r) => p.require.judge_mesh(r, path, &solid, &report)?,
        None => Vec::new(),
    };
    Ok(super::require::add(text, facts, passed, &requirements))
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

/// Reports a grid that is stated to be a level set and cannot be read as one, in a line of `text` and as an object.
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

/// Checks one level set. Appends lines to `text` and returns the result as an object; `unit` is the
/// name of the file's unit.
fn level_set(
    adopted: &Adopted,
    grid: &GridInfo,
    unit: &str,
    text: &mut String,
    session: vdb::Session<'_>,
) -> Result<Value, Failure> {
    let mut check = adopted.solid.check(session)?;
    // Grids that are not cubes are checked in index space; the place is shown in the world.
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
        super::numbers::grouped(check.active_voxels),
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
    // Some programs cut the band off on one side.
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

/// Checks all level sets of a file, its requirements, and its content hash (of the grids' values, as recorded by
/// the run that wrote them). Other grids are listed and not checked.
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
                let mut facts = level_set(&adopted, grid, &unit, &mut text, session)?;
                let part = MeasuredPart {
                    path,
                    solid: &adopted.solid,
                    unit: &unit,
                };
                if p.cavities {
                    let (lines, list) = super::require::list_cavities(part, threads, shown)?;
                    text.push_str(&lines);
                    facts["cavities"] = list;
                }
                if let Some((lines, found)) = p.layers.list(part, threads, shown)? {
                    text.push_str(&lines);
                    facts["layers"] = found;
                }
                // Requirements are those of one part: the first level set.
                if let Some(require) = require.as_ref().filter(|_| requirements.is_empty()) {
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
    // The hash is recorded in the file, or in its first grid where a program dropped the tags of the file.
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
