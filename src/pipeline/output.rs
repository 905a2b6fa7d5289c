//! The files of a run: each appears whole under its name, or not at all.

use super::error::RunError;
use super::operate::Bench;
use super::report::OutputFile;
use crate::frame::LengthUnit;
use crate::io::atomic::{StagedPath, write_bytes};
use crate::mesh::TriMesh;
use crate::recipe::{Compression as Wanted, Op, Output, OutputKind, Recipe};
use crate::vdb::{Compression, LevelSet, VdbWriter};
use std::path::{Path, PathBuf};

/// Where an output goes: beside the recipe, or under the directory asked for.
pub(super) fn target(recipe: &Recipe, out: Option<&Path>, path: &Path) -> PathBuf {
    match out {
        Some(directory) => directory.join(path),
        None => recipe.resolve(path),
    }
}

/// Writes one output and says what was written.
pub(super) fn write(
    bench: Bench,
    recipe: &Recipe,
    output: &Output,
    path: &Path,
    solid: &LevelSet,
    mesh: Option<&TriMesh>,
) -> Result<Option<OutputFile>, RunError> {
    let unit = output.unit_or_default(recipe.unit());
    let factor = recipe.unit().to(unit);
    let mut content_hash = None;
    let Some((kind, _)) = output.named().first().copied() else {
        return Ok(None);
    };
    bench.progress.stage("write", None);
    let shown_unit = match kind {
        OutputKind::Vdb => {
            content_hash = Some(write_vdb(bench, recipe, output, path, solid, unit)?);
            Some(unit)
        }
        OutputKind::Mesh => {
            let Some(mesh) = mesh else { return Ok(None) };
            if factor == 1.0 {
                crate::io::write_mesh(path, mesh, unit)?;
            } else {
                crate::io::write_mesh(path, &mesh.mapped(|v| v * factor), unit)?;
            }
            Some(unit)
        }
        OutputKind::Picture => {
            let size = output.size.unwrap_or_default();
            let cut = output.cut.map(|c| (c.axis, c.at));
            let png = solid
                .picture(size.0 as usize, size.1 as usize, cut, bench.session())
                .map_err(RunError::level_set("picture"))?;
            write_bytes(path, &png)?;
            None
        }
        OutputKind::Report => return Ok(None),
    };
    let (bytes, hash) = super::inputs::digest(path)?;
    Ok(Some(OutputFile {
        path: path.display().to_string(),
        bytes,
        unit: shown_unit.map(|u| u.symbol().to_owned()),
        hash,
        content_hash,
    }))
}

fn write_vdb(
    bench: Bench,
    recipe: &Recipe,
    output: &Output,
    path: &Path,
    solid: &LevelSet,
    unit: LengthUnit,
) -> Result<String, RunError> {
    let staged = StagedPath::create(path)?;
    let fog_alone = matches!(recipe.sections().op.last(), Some(Op::Fog(true)));
    let fog = if output.fog || fog_alone {
        Some(
            solid
                .to_fog(bench.session())
                .map_err(RunError::level_set("fog"))?,
        )
    } else {
        None
    };
    let factor = recipe.unit().to(unit);
    let mut file = VdbWriter::new(path, bench.session())?
        .scaled(factor)
        .compression(match output.compression {
            Some(Wanted::None) => Compression::None,
            Some(Wanted::Zip) => Compression::Zip,
            Some(Wanted::Blosc) | None => Compression::Blosc,
        });
    if !fog_alone {
        if output.half {
            file.level_set_as_half("surface", solid)?;
        } else {
            file.level_set("surface", solid)?;
        }
    }
    if let Some(fog) = &fog {
        file.fog("density", fog, output.half)?;
    }
    let text = recipe.source().text();
    file.tag("druse.recipe", &text)?;
    file.tag("druse.recipe_blake3", &super::inputs::hash_text(&text))?;
    file.tag("druse.unit", unit.symbol())?;
    let voxel = bench.scale.voxel_size * factor;
    file.tag("druse.voxel_size", &voxel.to_string())?;
    let written = file.write_to(staged.path())?;
    staged.commit()?;
    Ok(written.content_hash)
}
