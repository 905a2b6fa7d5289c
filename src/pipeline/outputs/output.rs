//! The output files of a run. Each is written completely under its name, or not at all.
//!
//! One function for each kind of file; runs in memory and in bricks share the parts that do not depend on where
//! the solid is: names of grids, tags, entries of the report.

use super::attributes::Attributes;
use crate::frame::{Aabb, LengthUnit, Transform};
use crate::io::atomic::{StagedPath, write_bytes};
use crate::mesh::TriMesh;
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::OutputFile;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::measure::thickness::Thickness;
use crate::recipe::{
    Compression as RecipeCompression, GridWord, Op, Output, OutputKind, Recipe, Segments,
};
use crate::vdb::{Compression, LevelSet, Picture, Placement, VdbWriter};
use std::path::{Path, PathBuf};

/// The path of an output: in the output directory `out`, or beside the recipe without one.
pub(crate) fn target(recipe: &Recipe, out: Option<&Path>, path: &Path) -> PathBuf {
    match out {
        Some(directory) => directory.join(path),
        None => recipe.resolve(path),
    }
}

/// The finished solid, with what outputs need of it.
#[derive(Clone, Copy)]
pub(crate) struct FinishedSolid<'a> {
    pub inputs: &'a Inputs<'a>,
    pub solid: &'a LevelSet,
    /// Its mesh, where any output needs one.
    pub mesh: Option<&'a TriMesh>,
    /// Its thickness, where any output holds it.
    pub thickness: Option<&'a Thickness>,
}

/// Writes one output and returns the entries of its files; none for a report, which is written last.
pub(crate) fn write(
    context: StageContext,
    done: FinishedSolid,
    output: &Output,
    path: &Path,
) -> Result<Vec<OutputFile>, RunError> {
    let recipe = done.inputs.recipe;
    let unit = output.unit_or_default(recipe.unit());
    // An output names one file, which decides its kind; the recipe's check refuses an output without one.
    let Some((kind, _)) = output.named().first().copied() else {
        return Ok(Vec::new());
    };
    context.progress.stage("write", None);
    Ok(match kind {
        OutputKind::Vdb => {
            let written = volumes(context, done, output, path, unit)?;
            let mut files = Vec::new();
            for (path, content_hash) in written {
                files.push(OutputFile {
                    content_hash,
                    ..file_entry(&path, Some(unit))?
                });
            }
            files
        }
        OutputKind::Mesh => {
            let facts = super::meshing::write(context, done, output, path, unit)?;
            vec![OutputFile {
                mesh: facts,
                ..file_entry(path, Some(unit))?
            }]
        }
        OutputKind::Deck if output.is_macro_deck() => {
            vec![super::macro_deck::write(
                context,
                done.inputs,
                output,
                path,
            )?]
        }
        OutputKind::Deck => {
            vec![super::deck::write(
                context,
                done.inputs,
                done.solid,
                output,
                path,
            )?]
        }
        OutputKind::Picture => {
            let failed = RunError::level_set("picture");
            let image = done.solid.render(&picture(output), context.session());
            let png = image.and_then(|i| i.png()).map_err(failed)?;
            write_bytes(path, &png)?;
            vec![file_entry(path, None)?]
        }
        OutputKind::Report => Vec::new(),
    })
}

/// The picture that an output describes.
pub(crate) fn picture(output: &Output) -> Picture {
    let size = output.size.unwrap_or_default();
    Picture {
        width: size.0 as usize,
        height: size.1 as usize,
        cut: output.cut.map(|c| (c.axis, c.at)),
        ..Picture::default()
    }
}

/// The report's entry for a written file.
pub(crate) fn file_entry(path: &Path, unit: Option<LengthUnit>) -> Result<OutputFile, RunError> {
    let (bytes, hash) = crate::pipeline::inputs::input_files::digest(path)?;
    Ok(OutputFile {
        path: path.display().to_string(),
        bytes,
        unit: unit.map(|u| u.symbol().to_owned()),
        hash,
        content_hash: None,
        mesh: None,
        deck: None,
        macro_deck: None,
    })
}

/// A writer of a `.vdb` or `.nvdb` without grids yet: its unit, tags and compression. Nothing is written.
pub(crate) fn vdb_file<'a>(
    context: StageContext<'a>,
    inputs: &Inputs,
    output: &Output,
    path: &Path,
) -> Result<VdbWriter<'a>, RunError> {
    let recipe = inputs.recipe;
    let unit = output.unit_or_default(recipe.unit());
    let factor = recipe.unit().to(unit);
    let mut file = VdbWriter::new(path, context.session())?
        .scaled(factor)
        .compression(match output.compression {
            Some(RecipeCompression::None) => Compression::None,
            Some(RecipeCompression::Zip) => Compression::Zip,
            Some(RecipeCompression::Blosc) | None => Compression::Blosc,
        });
    // The tags make a file reproducible: recipe, hashes of its inputs, unit and voxels.
    let text = recipe.source().text();
    file.tag("druse.recipe", &text)?;
    file.tag(
        "druse.recipe_blake3",
        &crate::pipeline::inputs::input_files::hash_text(&text),
    )?;
    file.tag("druse.inputs", &hashes(inputs))?;
    file.tag("druse.unit", unit.symbol())?;
    let voxel = context.scale.voxel_size * factor;
    file.tag("druse.voxel_size", &voxel.to_string())?;
    Ok(file)
}

/// Adds a level set to a file, as half floats if the output requests them.
pub(crate) fn add_surface<'a>(
    file: &mut VdbWriter<'a>,
    output: &Output,
    name: &str,
    solid: &'a LevelSet,
) -> Result<(), RunError> {
    if output.half {
        file.level_set_as_half(name, solid)?;
    } else {
        file.level_set(name, solid)?;
    }
    Ok(())
}

/// The grids of an output, in order: those that it names, or the surface; with `fog` the density too. After a final
/// operation `fog` it has the density, and the surface only by its name.
pub(crate) fn words(recipe: &Recipe, output: &Output) -> Vec<GridWord> {
    let fog_alone = matches!(recipe.sections().op.last(), Some(Op::Fog(true)));
    let mut words = match &output.grids {
        Some(words) => words.clone(),
        None if fog_alone => Vec::new(),
        None => vec![GridWord::Surface],
    };
    if (output.fog || fog_alone) && !words.contains(&GridWord::Density) {
        words.push(GridWord::Density);
    }
    words
}

/// Writes the volumes of an output and scenes beside them; returns their paths and content hashes. A scene has no
/// content hash.
fn volumes(
    context: StageContext,
    done: FinishedSolid,
    output: &Output,
    path: &Path,
    unit: LengthUnit,
) -> Result<Vec<(PathBuf, Option<String>)>, RunError> {
    let failed = RunError::level_set("segments");
    let mut files: Vec<(PathBuf, Vec<(String, LevelSet)>)> = Vec::new();
    if let Some(segments) = output.segments {
        let components = done.solid.segments(context.session()).map_err(&failed)?;
        let named = components.into_iter().enumerate().map(|(n, p)| (n + 1, p));
        match segments {
            Segments::Grids => {
                let grids = named.map(|(n, component)| (component_name(n), component));
                files.push((path.to_owned(), grids.collect()));
            }
            Segments::Files => files.extend(named.map(|(n, component)| {
                let path = numbered(path, n);
                (path, vec![("surface".to_owned(), component)])
            })),
        }
    } else {
        files.push((path.to_owned(), coarser(context, done, output)?));
    }
    // A file of components holds no grids of the whole solid.
    let is_divided = output.segments.is_some();
    let mut written = Vec::new();
    for (path, grids) in files {
        let hash = volume(context, done, output, &path, unit, &grids, is_divided)?;
        let names = grids.iter().map(|(name, _)| name.clone());
        let words = words(done.inputs.recipe, output);
        let words = words
            .iter()
            .filter(|_| !is_divided)
            .map(ToString::to_string);
        let names: Vec<String> = words.chain(names).collect();
        written.push((path.clone(), Some(hash)));
        if output.usda {
            let scene = path.with_extension("usda");
            let bounds = done.solid.bounds().map_err(&failed)?;
            let factor = context.scale.unit.to(unit);
            let in_unit = Aabb {
                min: bounds.min * factor,
                max: bounds.max * factor,
            };
            let text = super::usda::scene(&path, unit, in_unit, &names);
            write_bytes(&scene, text.as_bytes())?;
            written.push((scene, None));
        }
    }
    Ok(written)
}

/// The inputs of a run as JSON: the recipe's key, the file's name and its BLAKE3.
fn hashes(inputs: &Inputs) -> String {
    let name = |path: &str| {
        let name = Path::new(path).file_name();
        name.map_or(String::new(), |n| n.to_string_lossy().into_owned())
    };
    let entries = inputs.report().inputs;
    let rows = entries
        .iter()
        .map(|i| serde_json::json!({ "key": i.key, "file": name(&i.path), "blake3": i.hash }));
    serde_json::Value::Array(rows.collect()).to_string()
}

/// `part.vdb` as `part_2.vdb`.
pub(crate) fn numbered(path: &Path, n: usize) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push(format!("_{n}."));
    name.push(path.extension().unwrap_or_default());
    path.with_file_name(name)
}

/// Grid name of a component; the largest is number 1.
pub(crate) fn component_name(n: usize) -> String {
    format!("surface_{n}")
}

/// Grid name of a copy on voxels of 2^level times the edge.
pub(crate) fn coarser_copy_name(level: usize) -> String {
    format!("surface_lod_{level}")
}

/// Copies on coarser voxels, each resampled from the one before, with their grid names.
fn coarser(
    context: StageContext,
    done: FinishedSolid,
    output: &Output,
) -> Result<Vec<(String, LevelSet)>, RunError> {
    let mut copies: Vec<(String, LevelSet)> = Vec::new();
    for level in 1..=usize::from(output.lod.unwrap_or(0)) {
        let stage = format!("lod {level}");
        context.progress.stage(&stage, None);
        let finer = copies.last().map_or(done.solid, |(_, solid)| solid);
        let voxel = 2.0 * finer.voxel_size();
        let transform = Transform::new(voxel)
            .ok_or_else(|| RunError::Empty(format!("a voxel size of {voxel}")))?;
        let copy = finer
            .resampled(
                transform,
                finer.half_width(),
                Placement::IDENTITY,
                context.session(),
            )
            .map_err(RunError::level_set(&stage))?;
        copies.push((coarser_copy_name(level), copy));
    }
    Ok(copies)
}

/// Writes one `.vdb` or `.nvdb`: `level_sets` by their names, and the output's own grids unless it is divided into
/// components. Returns the content hash.
fn volume(
    context: StageContext,
    done: FinishedSolid,
    output: &Output,
    path: &Path,
    unit: LengthUnit,
    level_sets: &[(String, LevelSet)],
    is_divided: bool,
) -> Result<String, RunError> {
    let recipe = done.inputs.recipe;
    let words = if is_divided {
        Vec::new()
    } else {
        words(recipe, output)
    };
    let factor = recipe.unit().to(unit);
    let has_fog = words.contains(&GridWord::Density);
    let fog_grid = has_fog.then(|| done.solid.to_fog(context.session()));
    let fog_grid = fog_grid.transpose().map_err(RunError::level_set("fog"))?;
    let attributes = Attributes::new(context, done.inputs, &words, done.thickness, factor)?;
    let numbers = attributes.grids(context, done.solid)?;
    let staged = StagedPath::create(path)?;
    let mut file = vdb_file(context, done.inputs, output, path)?;
    if words.contains(&GridWord::Surface) {
        add_surface(&mut file, output, "surface", done.solid)?;
    }
    for (name, solid) in level_sets {
        add_surface(&mut file, output, name, solid)?;
    }
    if let Some(fog_grid) = &fog_grid {
        file.fog("density", fog_grid, output.half)?;
    }
    for (word, grid) in attributes.words().iter().zip(&numbers) {
        file.attribute(&word.to_string(), grid)?;
    }
    let is_nanovdb = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("nvdb"));
    let written = if is_nanovdb {
        file.write_nano_to(staged.path())?
    } else {
        file.write_to(staged.path())?
    };
    staged.commit()?;
    Ok(written.content_hash)
}
