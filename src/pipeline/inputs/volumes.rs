//! Grids of OpenVDB files that a run reads: operands, masks, and the initial solid. Files are read in a child
//! process where the options have one, because a damaged file can crash OpenVDB.

use super::input_files::InputFiles;
use crate::frame::{Aabb, LengthUnit, Vec3};
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::warning::Warning;
use crate::progress::{Progress, Threads};
use crate::recipe::{Grid, Mask, Onto, Op, Operand, Recipe, Scale, Similarity};
use crate::vdb::subprocess::Program;
use crate::vdb::{
    Cubes, FileError, GridReading, LevelSet, Placement, SampledLevelSet, Session, Volume,
};
use std::collections::BTreeMap;
use std::path::Path;

/// The grids, by the operation's key `op.N`.
#[derive(Default)]
pub(crate) struct Volumes {
    solids: BTreeMap<String, SampledLevelSet>,
    masks: BTreeMap<String, Volume>,
    initial: Option<LevelSet>,
}

impl Volumes {
    /// Reads the grids of all operations: masks, and solids in the recipe's frame and unit. Records files and adds
    /// warnings to `files`.
    pub fn load(
        files: &mut InputFiles,
        threads: &Threads,
        progress: &dyn Progress,
    ) -> Result<Self, RunError> {
        let recipe = files.recipe;
        let mut found = Self::default();
        let session = Session::new(threads, progress);
        for (n, op) in recipe.sections().op.iter().enumerate() {
            let key = format!("op.{n}");
            if let Some(mask) = op.mask() {
                let path = recipe.resolve(&mask.path);
                let volume =
                    fetch(files.reader, &path, mask.grid.as_deref())?.require_cubes(&path)?;
                let factor = unit_of(&volume, mask.unit.map(|u| u.0)).to(recipe.unit());
                let stage = format!("{key}.{}.mask", op.name());
                let volume = volume
                    .rescaled(factor)
                    .map_err(RunError::level_set(&stage))?;
                files.record(&stage, &path, Aabb::EMPTY)?;
                found.masks.insert(key.clone(), volume);
            }
            let Some(Operand::Vdb(grid)) = op.operand() else {
                continue;
            };
            let path = recipe.resolve(&grid.path);
            let stage = format!("{key}.{}.vdb", op.name());
            let name = grid.grid.as_deref();
            let opened = files.opened.and_then(|o| o.take(&path, name));
            let volume = match opened {
                Some(volume) => volume,
                None => fetch(files.reader, &path, name)?,
            };
            let unit = unit_of(&volume, grid.unit.map(|u| u.0));
            let frame = placement(&grid.transform, unit.to(recipe.unit()));
            let failed = RunError::level_set(&stage);
            // The grid's own key or a following `resample` may request other voxels.
            let is_resampled = matches!(recipe.sections().op.get(n + 1), Some(Op::Resample(_)));
            let options = reading(recipe, grid, frame.scale, is_resampled);
            let adopted = volume.solid(&path, &options, session)?;
            for note in adopted.notes {
                let name = name.map_or_else(String::new, |n| format!(", grid {n:?}"));
                let message = format!("{stage}: {}{name}: {note}", path.display());
                files.warn(Warning::GRID, message)?;
            }
            let mut solid = adopted.solid;
            // A level set of another program may have a narrow band on one side; an isosurface is new.
            if options.value.is_none() {
                solid.rebuild_narrow_side(session).map_err(&failed)?;
            }
            // A first `union` without scaffold and placement, on the recipe's own voxels, is taken as it is.
            let starts = n == 0
                && recipe.sections().scaffold.is_none()
                && matches!(op, Op::Union(_))
                && frame == Placement::IDENTITY
                && has_voxels(&solid, recipe);
            if starts {
                files.record(&stage, &path, solid.bounds().map_err(&failed)?)?;
                found.initial = Some(solid);
                continue;
            }
            let scale = recipe.scale();
            compare_voxels(files, grid, &solid, &stage, frame.scale)?;
            // Much finer voxels are doubled first: a band that wide would not fit into memory.
            let solid = solid.coarsened_to(scale.voxel_size / frame.scale, session);
            let solid = solid.map_err(&failed)?;
            let reach = recipe.sections().band.half_width.0 * scale.voxel_size;
            let field = SampledLevelSet::new(solid, reach, frame, session).map_err(&failed)?;
            files.record(&stage, &path, field.bounds())?;
            found.solids.insert(key, field);
        }
        Ok(found)
    }

    /// The solid of an operation, by its key `op.N`.
    pub fn solid(&self, key: &str) -> &SampledLevelSet {
        &self.solids[key]
    }

    /// The mask of an operation, by its key `op.N`.
    pub fn mask(&self, key: &str, mask: &Mask) -> crate::vdb::Mask<'_> {
        crate::vdb::Mask {
            by: &self.masks[key],
            range: mask.range.map(|v| v.0),
            inverted: mask.invert,
        }
    }

    /// The level set of a file that the run starts from unchanged: without a scaffold, and on the
    /// recipe's voxels.
    pub fn start(&self) -> Option<&LevelSet> {
        self.initial.as_ref()
    }

    /// Moves the level set of [`Volumes::start`] out, which the run then changes; `None` from then on.
    pub fn take_start(&mut self) -> Option<LevelSet> {
        self.initial.take()
    }
}

/// Reads a grid of floats, in a child process if there is one.
pub(crate) fn fetch(
    reader: Option<&Program>,
    path: &Path,
    name: Option<&str>,
) -> Result<Volume, FileError> {
    match reader {
        Some(program) => program.fetch(path, name),
        None => Volume::read(path, name),
    }
}

/// The unit of a file's lengths: as requested, from the tag that Druse writes, or metres, as OpenVDB files of
/// other programs have.
pub(crate) fn unit_of(volume: &Volume, requested: Option<LengthUnit>) -> LengthUnit {
    let tagged = || volume.meta("druse.unit").and_then(|u| u.parse().ok());
    requested.or_else(tagged).unwrap_or(LengthUnit::Metre)
}

/// How the grid of an operation is read; `scale` converts lengths of the file to the recipe's unit.
fn reading(recipe: &Recipe, grid: &Grid, scale: f64, is_resampled: bool) -> GridReading {
    let recipe_scale = recipe.scale();
    let edge = match grid.resample {
        Some(Onto::Edge(size)) => Some(size.resolve(recipe_scale)),
        Some(Onto::Recipe(true)) => Some(recipe_scale.voxel_size),
        Some(Onto::Recipe(false)) => None,
        None => is_resampled.then_some(recipe_scale.voxel_size),
    };
    GridReading {
        value: grid.value.map(|v| v.0),
        invert: grid.invert,
        cubes: edge.map_or(Cubes::Refuse, |edge| Cubes::Edge(edge / scale)),
        half_width: recipe.sections().band.half_width.0,
        allow_torn: false,
    }
}

/// A recipe's placement of a grid whose lengths `factor` converts to the recipe's unit.
fn placement(similarity: &Similarity, factor: f64) -> Placement {
    let (matrix, translation) = similarity.matrix();
    let scale = similarity.scale.0;
    Placement {
        scale: scale * factor,
        rotation: matrix / scale,
        translation,
    }
}

/// Whether a level set has the recipe's voxels and band.
fn has_voxels(solid: &LevelSet, recipe: &Recipe) -> bool {
    let h = recipe.scale().voxel_size;
    let width = recipe.sections().band.half_width.0;
    // The edge up to rounding, as the grid is used unchanged; the half width is of a background in single precision.
    (solid.voxel_size() - h).abs() <= 1e-9 * h && (solid.half_width() - width).abs() <= 1e-4
}

/// W111: warns that a grid with other voxels than the recipe's is resampled, unless its own key `resample` requests it;
/// a following operation does not. `factor` converts the grid's lengths to the recipe's unit.
fn compare_voxels(
    files: &mut InputFiles,
    grid: &Grid,
    solid: &LevelSet,
    stage: &str,
    factor: f64,
) -> Result<(), RunError> {
    let scale: Scale = files.recipe.scale();
    let voxel_size = solid.voxel_size() * factor;
    // Closer edges would print as the same number.
    if (voxel_size - scale.voxel_size).abs() <= 1e-6 * scale.voxel_size {
        return Ok(());
    }
    let (found, expected) = (
        crate::pipeline::base::error::short_number(voxel_size),
        crate::pipeline::base::error::short_number(scale.voxel_size),
    );
    let unit = scale.unit;
    let message = format!("{stage}: voxels of {found} {unit}, the recipe's are {expected} {unit}");
    if grid.resample.is_some_and(Onto::is_wanted) {
        return Ok(());
    }
    let bounds = solid.bounds().map_err(RunError::level_set(stage))?;
    let size = bounds.size().max() * factor;
    let note = if size < scale.voxel_size {
        format!(
            "; all of it spans {} {unit}, less than a voxel: is its unit right?",
            crate::pipeline::base::error::short_number(size)
        )
    } else {
        String::new()
    };
    files.warn(Warning::RESAMPLED, format!("{message}: resampled{note}"))
}

/// The placement of `[[op]] resample`.
pub(crate) fn resample_placement(op: &crate::recipe::Resample, scale: Scale) -> Placement {
    let similarity = Similarity {
        scale: op.scale,
        rotate: op.rotate,
        ..Similarity::default()
    };
    Placement {
        translation: Vec3::from(op.translate.map(|l| l.resolve(scale))),
        ..placement(&similarity, 1.0)
    }
}
