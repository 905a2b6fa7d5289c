//! `druse info FILE`: a summary of any file that Druse reads, as text and as an object. The file is not changed.

use super::context::Session;
use super::failure::Failure;
use super::kind::FileKind;
use super::output::Answer;
use crate::frame::{Aabb, Vec3};
use crate::io::{read_cell, read_solid};
use crate::mesh::{SelfIntersections, check_with};
use crate::recipe::Recipe;
use crate::vdb::FileInfo;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    /// A recipe, cell, mesh, scaffold or .vdb file.
    file: PathBuf,
}

/// Summarises a file by its kind.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    use FileKind::{Cell, Mesh, Recipe, Scaffold, Vdb};
    let path = &p.file;
    let (text, facts) = match FileKind::of(path, &[Recipe, Cell, Mesh, Scaffold, Vdb])? {
        Recipe => recipe(path)?,
        Cell => {
            let cell = read_cell(path)?;
            (
                super::cell_text::describe(&cell),
                super::cell_text::facts(&cell),
            )
        }
        Mesh => mesh(path, session)?,
        Scaffold => {
            let (text, facts) = super::scaffold::describe(path)?;
            // A mesh of surface elements is a scaffold or a solid: both views are shown.
            if facts["kind"] == "surface" {
                surface(path, text, facts, session)?
            } else {
                (text, facts)
            }
        }
        Vdb => {
            let info = super::vdb::inspect(path)?;
            (vdb_screen(path, &info), vdb_facts(path, &info))
        }
    };
    Ok(Answer::new(text, facts))
}

/// The sections of a recipe, as lines and as an object. The recipe is checked, but no other file is read.
fn recipe(path: &Path) -> Result<(String, Value), Failure> {
    let recipe = Recipe::read(path, &[])?;
    let s = recipe.sections();
    let cells: Vec<&String> = s.cell.keys().collect();
    let ops: Vec<&str> = s.op.iter().map(crate::recipe::Op::name).collect();
    let outputs: Vec<String> = s
        .output
        .iter()
        .flat_map(|o| o.named().into_iter().map(|(_, p)| p.display().to_string()))
        .collect();
    let scaffold = s.scaffold.as_ref().map(|scaffold| match &scaffold.file {
        Some(file) => file.path.display().to_string(),
        None => scaffold.sources().concat(),
    });
    let voxel = recipe.scale().voxel_size;
    let mut text = format!(
        "{}: a recipe in {}\n",
        super::terminal::path(path),
        recipe.unit()
    );
    let list = |items: &[&str]| {
        if items.is_empty() {
            "none".to_owned()
        } else {
            super::terminal::line(&items.join(", ")).into_owned()
        }
    };
    let names: Vec<&str> = cells.iter().map(|c| c.as_str()).collect();
    let _ = writeln!(text, "cells       {}", list(&names));
    let _ = writeln!(
        text,
        "scaffold    {}",
        super::terminal::line(scaffold.as_deref().unwrap_or("none"))
    );
    let _ = writeln!(text, "voxel size  {voxel} {}", recipe.unit());
    let _ = writeln!(text, "operations  {}", list(&ops));
    let files: Vec<&str> = outputs.iter().map(String::as_str).collect();
    let _ = writeln!(text, "outputs     {}", list(&files));
    let facts = json!({
        "kind": "recipe", "path": path.display().to_string(), "unit": recipe.unit().symbol(),
        "cells": cells, "scaffold": scaffold, "voxel_size": voxel,
        "half_width": s.band.half_width.0, "operations": ops, "outputs": outputs,
    });
    Ok((text, facts))
}

/// The summary of a mesh with its defects, without a search for self-intersections.
fn mesh(path: &Path, session: &Session) -> Result<(String, Value), Failure> {
    let solid = read_solid(path)?;
    let report = check_with(&solid.file.mesh, SelfIntersections::Skip, session)
        .map_err(|_| Failure::stopped(130))?;
    let (mut text, facts, _) = super::solid_text::solid_screen(path, &solid, &report);
    for warning in &solid.file.warnings {
        let _ = writeln!(text, "note: {}", super::terminal::line(warning));
    }
    Ok((text, facts))
}

/// Adds the description of a surface as a triangle mesh to that of its elements.
fn surface(
    path: &Path,
    mut text: String,
    mut facts: Value,
    session: &Session,
) -> Result<(String, Value), Failure> {
    let (more, measured) = mesh(path, session)?;
    text.push_str(more.split_once('\n').map_or("", |(_, report)| report));
    if let (Some(facts), Value::Object(measured)) = (facts.as_object_mut(), measured) {
        for (key, value) in measured {
            facts.entry(key).or_insert(value);
        }
    }
    Ok((text, facts))
}

/// The contents of a `.vdb`, as an object.
pub(super) fn vdb_facts(path: &Path, info: &FileInfo) -> Value {
    let mut facts = serde_json::to_value(info).unwrap_or_default();
    facts["kind"] = json!("vdb");
    facts["path"] = json!(path.display().to_string());
    facts["unit"] = json!(unit_of(info));
    facts
}

/// The unit of a file's lengths: as stated in its metadata, else metres.
pub(super) fn unit_of(info: &FileInfo) -> String {
    let stated = info.meta("druse.unit");
    let of_grid = || info.grids.first().and_then(|g| g.meta("druse.unit"));
    stated.or_else(of_grid).unwrap_or_else(|| "m".into())
}

/// The grids of an OpenVDB file, as lines: their class, voxels, boxes and tags, in the file's unit.
fn vdb_screen(path: &Path, info: &FileInfo) -> String {
    let unit = unit_of(info);
    let mut text = format!(
        "{}: OpenVDB, format {} ({}), {}\n",
        super::terminal::path(path),
        info.version,
        super::terminal::line(&info.writer),
        super::numbers::size(info.bytes)
    );
    for g in &info.grids {
        let map = g.index_map();
        let voxel = if g.cubic {
            format!("voxel {}", g.voxel_size[0])
        } else {
            g.shape()
        };
        let _ = writeln!(
            text,
            "grid {:?}: {}, {}, {voxel} {unit}",
            g.name,
            super::terminal::line(&g.class),
            super::terminal::line(&g.grid_type)
        );
        let _ = writeln!(
            text,
            "  {} active voxels, {} leaves, {} in memory{}",
            super::numbers::grouped(g.active_voxels),
            super::numbers::grouped(g.leaves),
            super::numbers::size(g.bytes),
            if g.half { ", half floats" } else { "" }
        );
        if let Some([min, max]) = g.bbox {
            // A turned grid needs all eight corners for its box.
            let corners = (0..8u8).map(|c| {
                map.world(Vec3::from_fn(|a, _| {
                    f64::from(if (c >> a) & 1 == 1 { max[a] } else { min[a] })
                }))
            });
            let b = Aabb::of(corners);
            let _ = writeln!(
                text,
                "  voxels {min:?} to {max:?}, {:?} to {:?} {unit}",
                <[f64; 3]>::from(b.min),
                <[f64; 3]>::from(b.max)
            );
        }
        if let Some([low, high]) = g.values {
            let _ = writeln!(text, "  active values {low} to {high}");
        }
        // A file holds single precision: more digits would be none of its own.
        if let Some(background) = g.background.filter(|_| g.class == "level set" && g.cubic) {
            let _ = writeln!(
                text,
                "  background {} {unit} ({:.3} voxels)",
                background as f32,
                background / g.voxel_size[0]
            );
        } else if let Some(background) = g.background {
            let _ = writeln!(text, "  background {}", background as f32);
        }
        for note in &g.notes {
            let _ = writeln!(text, "  note: {}", super::terminal::line(note));
        }
        for (key, value) in &g.metadata {
            // The recipe is long; it has a command of its own.
            if key.starts_with("druse.") && key != "druse.recipe" {
                let _ = writeln!(
                    text,
                    "  {} {}",
                    super::terminal::line(key),
                    value.escape_debug()
                );
            }
        }
    }
    if let Some(hash) = &info.content_hash {
        let _ = writeln!(text, "content hash {hash}");
    }
    text
}
