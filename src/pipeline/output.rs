//! The files of a run: each appears whole under its name, or not at all.

use super::attributes::Attributes;
use super::error::RunError;
use super::inputs::Stock;
use super::level_set_ops::Bench;
use super::report::OutputFile;
use super::thickness::Thickness;
use crate::frame::{Aabb, LengthUnit, Transform};
use crate::io::atomic::{StagedPath, write_bytes};
use crate::mesh::TriMesh;
use crate::recipe::{Compression as Wanted, GridWord, Op, Output, OutputKind, Recipe, Segments};
use crate::vdb::{Compression, LevelSet, Picture, Placement, VdbWriter};
use std::path::{Path, PathBuf};

/// Where an output goes: beside the recipe, or under the directory asked for.
pub(super) fn target(recipe: &Recipe, out: Option<&Path>, path: &Path) -> PathBuf {
    match out {
        Some(directory) => directory.join(path),
        None => recipe.resolve(path),
    }
}

/// What outputs are made of.
#[derive(Clone, Copy)]
pub(super) struct Finished<'a> {
    pub stock: &'a Stock<'a>,
    pub solid: &'a LevelSet,
    /// Its mesh, where any output needs one.
    pub mesh: Option<&'a TriMesh>,
    /// Its thickness, where any output holds it.
    pub thickness: Option<&'a Thickness>,
}

/// Writes one output and says what was written.
pub(super) fn write(
    bench: Bench,
    done: Finished,
    output: &Output,
    path: &Path,
) -> Result<Vec<OutputFile>, RunError> {
    let recipe = done.stock.recipe;
    let unit = output.unit_or_default(recipe.unit());
    let Some((kind, _)) = output.named().first().copied() else {
        return Ok(Vec::new());
    };
    bench.progress.stage("write", None);
    Ok(match kind {
        OutputKind::Vdb => {
            let written = volumes(bench, done, output, path, unit)?;
            let mut files = Vec::new();
            for (path, content_hash) in written {
                files.push(OutputFile {
                    content_hash,
                    ..listed(&path, Some(unit))?
                });
            }
            files
        }
        OutputKind::Mesh => {
            let facts = super::meshing::write(bench, done, output, (path, unit))?;
            vec![OutputFile {
                mesh: facts,
                ..listed(path, Some(unit))?
            }]
        }
        OutputKind::Deck => {
            vec![super::deck::write(
                bench, done.stock, done.solid, output, path,
            )?]
        }
        OutputKind::Picture => {
            let failed = RunError::level_set("picture");
            let image = done.solid.render(&picture(output), bench.session());
            let png = image.and_then(|i| i.png()).map_err(failed)?;
            write_bytes(path, &png)?;
            vec![listed(path, None)?]
        }
        OutputKind::Report => Vec::new(),
    })
}

/// The picture that an output asks for.
pub(super) fn picture(output: &Output) -> Picture {
    let size = output.size.unwrap_or_default();
    Picture {
        width: size.0 as usize,
        height: size.1 as usize,
        cut: output.cut.map(|c| (c.axis, c.at)),
        ..Picture::default()
    }
}

/// What the report says of any file.
pub(super) fn listed(path: &Path, unit: Option<LengthUnit>) -> Result<OutputFile, RunError> {
    let (bytes, hash) = super::input_files::digest(path)?;
    Ok(OutputFile {
        path: path.display().to_string(),
        bytes,
        unit: unit.map(|u| u.symbol().to_owned()),
        hash,
        content_hash: None,
        mesh: None,
        deck: None,
    })
}

/// A `.vdb` without grids, with its unit, its tags, and its way of storing values.
pub(super) fn vdb_file<'a>(
    bench: Bench<'a>,
    stock: &Stock,
    output: &Output,
    path: &Path,
) -> Result<VdbWriter<'a>, RunError> {
    let recipe = stock.recipe;
    let unit = output.unit_or_default(recipe.unit());
    let factor = recipe.unit().to(unit);
    let mut file = VdbWriter::new(path, bench.session())?
        .scaled(factor)
        .compression(match output.compression {
            Some(Wanted::None) => Compression::None,
            Some(Wanted::Zip) => Compression::Zip,
            Some(Wanted::Blosc) | None => Compression::Blosc,
        });
    let text = recipe.source().text();
    file.tag("druse.recipe", &text)?;
    file.tag("druse.recipe_blake3", &super::input_files::hash_text(&text))?;
    file.tag("druse.inputs", &hashes(stock))?;
    file.tag("druse.unit", unit.symbol())?;
    let voxel = bench.scale.voxel_size * factor;
    file.tag("druse.voxel_size", &voxel.to_string())?;
    Ok(file)
}

/// Adds a level set to its file, as half floats if so wished.
pub(super) fn add_surface<'a>(
    file: &mut VdbWriter<'a>,
    output: &Output,
    (name, solid): (&str, &'a LevelSet),
) -> Result<(), RunError> {
    if output.half {
        file.level_set_as_half(name, solid)?;
    } else {
        file.level_set(name, solid)?;
    }
    Ok(())
}

/// The grids of an output, in order.
pub(super) fn words(recipe: &Recipe, output: &Output) -> Vec<GridWord> {
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

/// Writes the volumes of an output: paths, and hashes of what `.vdb` files say.
fn volumes(
    bench: Bench,
    done: Finished,
    output: &Output,
    path: &Path,
    unit: LengthUnit,
) -> Result<Vec<(PathBuf, Option<String>)>, RunError> {
    let failed = RunError::level_set("segments");
    let mut files: Vec<(PathBuf, Vec<(String, LevelSet)>)> = Vec::new();
    if let Some(how) = output.segments {
        let pieces = done.solid.segments(bench.session()).map_err(&failed)?;
        let named = pieces.into_iter().enumerate().map(|(n, p)| (n + 1, p));
        match how {
            Segments::Grids => {
                let grids = named.map(|(n, piece)| (name_of_piece(n), piece));
                files.push((path.to_owned(), grids.collect()));
            }
            Segments::Files => files.extend(named.map(|(n, piece)| {
                let own = numbered(path, n);
                (own, vec![("surface".to_owned(), piece)])
            })),
        }
    } else {
        files.push((path.to_owned(), coarser(bench, done, output)?));
    }
    let divided = output.segments.is_some();
    let mut written = Vec::new();
    for (path, grids) in files {
        let hash = volume(bench, done, output, (&path, unit), &grids, divided)?;
        let names = grids.iter().map(|(name, _)| name.clone());
        let own = words(done.stock.recipe, output);
        let own = own.iter().filter(|_| !divided).map(ToString::to_string);
        let names: Vec<String> = own.chain(names).collect();
        written.push((path.clone(), Some(hash)));
        if output.usda {
            let scene = path.with_extension("usda");
            let bounds = done.solid.bounds().map_err(&failed)?;
            let factor = bench.scale.unit.to(unit);
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

/// What a run read, as JSON: the recipe's key, the file's name and its BLAKE3.
fn hashes(stock: &Stock) -> String {
    let name = |path: &str| {
        let name = Path::new(path).file_name();
        name.map_or(String::new(), |n| n.to_string_lossy().into_owned())
    };
    let inputs = stock.report().inputs;
    let rows = inputs
        .iter()
        .map(|i| serde_json::json!({ "key": i.key, "file": name(&i.path), "blake3": i.hash }));
    serde_json::Value::Array(rows.collect()).to_string()
}

/// `part.vdb` as `part_2.vdb`.
pub(super) fn numbered(path: &Path, n: usize) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push(format!("_{n}."));
    name.push(path.extension().unwrap_or_default());
    path.with_file_name(name)
}

/// What a piece is called; the largest is the first.
pub(super) fn name_of_piece(n: usize) -> String {
    format!("surface_{n}")
}

/// What a copy on voxels of 2^level times the edge is called.
pub(super) fn name_of_coarser(level: usize) -> String {
    format!("surface_lod_{level}")
}

/// Copies on coarser voxels, each made from the one before.
fn coarser(
    bench: Bench,
    done: Finished,
    output: &Output,
) -> Result<Vec<(String, LevelSet)>, RunError> {
    let mut copies: Vec<(String, LevelSet)> = Vec::new();
    for level in 1..=usize::from(output.lod.unwrap_or(0)) {
        let stage = format!("lod {level}");
        bench.progress.stage(&stage, None);
        let finer = copies.last().map_or(done.solid, |(_, solid)| solid);
        let voxel = 2.0 * finer.voxel_size();
        let transform = Transform::new(voxel)
            .ok_or_else(|| RunError::Empty(format!("a voxel size of {voxel}")))?;
        let copy = finer
            .resampled(
                transform,
                finer.half_width(),
                Placement::NONE,
                bench.session(),
            )
            .map_err(RunError::level_set(&stage))?;
        copies.push((name_of_coarser(level), copy));
    }
    Ok(copies)
}

/// Writes one `.vdb` or `.nvdb`: the grids of the output unless it is divided, and others.
fn volume(
    bench: Bench,
    done: Finished,
    output: &Output,
    (path, unit): (&Path, LengthUnit),
    others: &[(String, LevelSet)],
    divided: bool,
) -> Result<String, RunError> {
    let recipe = done.stock.recipe;
    let words = if divided {
        Vec::new()
    } else {
        words(recipe, output)
    };
    let factor = recipe.unit().to(unit);
    let fog = words.contains(&GridWord::Density);
    let fog = fog.then(|| done.solid.to_fog(bench.session()));
    let fog = fog.transpose().map_err(RunError::level_set("fog"))?;
    let attributes = Attributes::new(bench, done.stock, &words, done.thickness, factor)?;
    let numbers = attributes.grids(bench, done.solid)?;
    let staged = StagedPath::create(path)?;
    let mut file = vdb_file(bench, done.stock, output, path)?;
    if words.contains(&GridWord::Surface) {
        add_surface(&mut file, output, ("surface", done.solid))?;
    }
    for (name, solid) in others {
        add_surface(&mut file, output, (name, solid))?;
    }
    if let Some(fog) = &fog {
        file.fog("density", fog, output.half)?;
    }
    for (word, grid) in attributes.words().iter().zip(&numbers) {
        file.attribute(&word.to_string(), grid)?;
    }
    let nano = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("nvdb"));
    let written = if nano {
        file.write_nano_to(staged.path())?
    } else {
        file.write_to(staged.path())?
    };
    staged.commit()?;
    Ok(written.content_hash)
}
