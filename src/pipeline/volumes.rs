//! Grids of OpenVDB files that a run reads: solids to combine with, masks, and the solid it starts from.

use super::error::RunError;
use super::inputs::{Inputs, frame_map};
use super::report::Warning;
use crate::frame::{Aabb, LengthUnit, Mat3, Vec3, WorldPoint};
use crate::progress::{Progress, Threads};
use crate::recipe::{FileFrame, Grid, Mask, Op, Operand, Recipe, Scale, Similarity};
use crate::vdb::isolate::Program;
use crate::vdb::{FileError, LevelSet, Placement, Sampled, Session, Volume};
use std::collections::BTreeMap;
use std::path::Path;

/// What has been read, by the operation's key `op.N`.
#[derive(Default)]
pub(super) struct Volumes {
    solids: BTreeMap<String, Sampled>,
    masks: BTreeMap<String, Volume>,
    start: Option<LevelSet>,
}

/// Value on the surface of a fog.
const FOG: f64 = 0.5;

impl Volumes {
    pub fn load(
        inputs: &mut Inputs,
        threads: &Threads,
        progress: &dyn Progress,
    ) -> Result<Self, RunError> {
        let recipe = inputs.recipe;
        let mut found = Self::default();
        let session = Session::new(threads, progress);
        for (n, op) in recipe.sections().op.iter().enumerate() {
            let key = format!("op.{n}");
            if let Some(mask) = op.mask() {
                let path = recipe.resolve(&mask.path);
                let volume = fetch(inputs.reader, &path, mask.grid.as_deref())?;
                let factor = unit_of(&volume, mask.unit.map(|u| u.0)).to(recipe.unit());
                let stage = format!("{key}.{}.mask", op.name());
                let volume = volume
                    .rescaled(factor)
                    .map_err(RunError::level_set(&stage))?;
                inputs.record(&stage, &path, Aabb::EMPTY)?;
                found.masks.insert(key.clone(), volume);
            }
            let Some(Operand::Vdb(grid)) = op.operand() else {
                continue;
            };
            let path = recipe.resolve(&grid.path);
            let stage = format!("{key}.{}.vdb", op.name());
            let name = grid.grid.as_deref();
            let opened = inputs.opened.and_then(|o| o.take(&path, name));
            let volume = match opened {
                Some(volume) => volume,
                None => fetch(inputs.reader, &path, name)?,
            };
            let unit = unit_of(&volume, grid.unit.map(|u| u.0));
            let solid =
                level_set(recipe, grid, volume, &path, session).map_err(|e| e.at(&stage))?;
            let failed = RunError::level_set(&stage);
            let own = placement(&grid.transform, unit.to(recipe.unit()));
            let starts = n == 0
                && recipe.sections().scaffold.is_none()
                && matches!(op, Op::Union(_))
                && own == Placement::NONE
                && has_voxels(&solid, recipe);
            if starts {
                inputs.record(&stage, &path, solid.bounds().map_err(&failed)?)?;
                found.start = Some(solid);
                continue;
            }
            let scale = recipe.scale();
            compare_voxels(inputs, grid, &solid, &stage, own.scale)?;
            let solid = solid.no_finer_than(scale.voxel_size / own.scale, session);
            let solid = solid.map_err(&failed)?;
            let reach = recipe.sections().band.half_width.0 * scale.voxel_size;
            let field = Sampled::new(solid, reach, own, session).map_err(&failed)?;
            inputs.record(&stage, &path, field.bounds())?;
            found.solids.insert(key, field);
        }
        Ok(found)
    }

    /// The solid of an operation, by its key `op.N`.
    pub fn solid(&self, key: &str) -> &Sampled {
        &self.solids[key]
    }

    /// Where an operation acts, by its key `op.N`.
    pub fn mask(&self, key: &str, mask: &Mask) -> crate::vdb::Mask<'_> {
        crate::vdb::Mask {
            by: &self.masks[key],
            range: mask.range.map(|v| v.0),
            inverted: mask.invert,
        }
    }

    /// The level set that the first operation begins with, untouched: no scaffold, and its own voxels.
    pub fn start(&self) -> Option<&LevelSet> {
        self.start.as_ref()
    }

    /// Gives it away.
    pub fn take_start(&mut self) -> Option<LevelSet> {
        self.start.take()
    }
}

/// Whether a path names a file of OpenVDB grids.
pub(super) fn has_volume(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("vdb"))
}

/// A grid of floats as a field of the recipe's space.
pub(super) struct FieldGrid {
    volume: Volume,
    /// From the recipe's space to the file's.
    inward: Mat3,
    origin: Vec3,
    bounds: Aabb,
}

impl FieldGrid {
    /// Reads a grid by its name.
    pub fn read(
        inputs: &Inputs,
        file: &FileFrame,
        path: &Path,
        name: &str,
    ) -> Result<Self, RunError> {
        let volume = fetch(inputs.reader, path, Some(name))?;
        let unit = unit_of(&volume, file.unit.map(|u| u.0));
        let map = frame_map(file, Some(unit), inputs.recipe.unit());
        let origin = map(Vec3::zeros());
        let outward =
            Mat3::from_columns(&[Vec3::x(), Vec3::y(), Vec3::z()].map(|e| map(e) - origin));
        let info = volume.info();
        let [low, high] = info.bbox.unwrap_or_default();
        let corner = |v: [i32; 3]| {
            let at = Vec3::from(v.map(f64::from)).component_mul(&Vec3::from(info.voxel_size));
            at + Vec3::from(info.origin)
        };
        let (low, high) = (corner(low), corner(high));
        let corners = (0..8u8).map(|c| {
            map(Vec3::from_fn(|a, _| {
                if c >> a & 1 == 1 { high[a] } else { low[a] }
            }))
        });
        Ok(Self {
            bounds: Aabb::of(corners),
            volume,
            inward: outward.try_inverse().unwrap_or_default(),
            origin,
        })
    }

    /// The box around its active voxels.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The value at a point.
    pub fn at(&self, p: Vec3) -> f64 {
        let inner = WorldPoint(self.inward * (p - self.origin));
        let found = self.volume.samples(&[inner]);
        found.map_or(f64::NAN, |v| f64::from(v[0]))
    }
}

/// A grid of floats, by way of a child process where there is one.
fn fetch(reader: Option<&Program>, path: &Path, name: Option<&str>) -> Result<Volume, FileError> {
    match reader {
        Some(program) => program.fetch(path, name),
        None => Volume::read(path, name),
    }
}

/// The unit of a file's lengths: as told, by its own word, or metres.
fn unit_of(volume: &Volume, told: Option<LengthUnit>) -> LengthUnit {
    let own = || volume.meta("druse.unit").and_then(|u| u.parse().ok());
    told.or_else(own).unwrap_or(LengthUnit::Metre)
}

/// What a volume could not become, before its stage is known.
enum Unfit {
    File(FileError),
    Tool(crate::vdb::VdbError),
}

impl Unfit {
    fn at(self, stage: &str) -> RunError {
        match self {
            Self::File(e) => e.into(),
            Self::Tool(e) => RunError::level_set(stage)(e),
        }
    }
}

fn level_set(
    recipe: &Recipe,
    grid: &Grid,
    volume: Volume,
    path: &Path,
    session: Session<'_>,
) -> Result<LevelSet, Unfit> {
    let half_width = recipe.sections().band.half_width.0;
    let class = volume.info().class.clone();
    let value = match (grid.value, class.as_str()) {
        (Some(value), _) => value.0,
        (None, "fog volume") => FOG,
        (None, "level set") => {
            let mut solid = volume.into_level_set(path, session).map_err(Unfit::File)?;
            solid.even_band(session).map_err(Unfit::Tool)?;
            return Ok(solid);
        }
        (None, _) => {
            return Err(Unfit::File(FileError::NotALevelSet {
                path: path.to_owned(),
                grid: volume.name().to_owned(),
                found: format!("the class {class}"),
                expected: "a level set, a fog volume, or the value on its surface (value = ...)",
            }));
        }
    };
    volume
        .isosurface(value, half_width, session)
        .map_err(Unfit::Tool)
}

fn placement(similarity: &Similarity, factor: f64) -> Placement {
    let (matrix, shift) = similarity.matrix();
    let scale = similarity.scale.0;
    Placement {
        scale: scale * factor,
        turn: matrix / scale,
        shift,
    }
}

/// Whether a level set stands on the voxels that the recipe asks for.
fn has_voxels(solid: &LevelSet, recipe: &Recipe) -> bool {
    let h = recipe.scale().voxel_size;
    let width = recipe.sections().band.half_width.0;
    (solid.voxel_size() - h).abs() <= 1e-9 * h && (solid.half_width() - width).abs() <= 1e-4
}

/// W111: voxels that are not the recipe's are resampled; refused where the operation asks for it.
fn compare_voxels(
    inputs: &mut Inputs,
    grid: &Grid,
    solid: &LevelSet,
    stage: &str,
    factor: f64,
) -> Result<(), RunError> {
    let scale: Scale = inputs.recipe.scale();
    let own = solid.voxel_size() * factor;
    if (own - scale.voxel_size).abs() <= 1e-6 * scale.voxel_size {
        return Ok(());
    }
    let (found, wanted) = (
        super::error::short(own),
        super::error::short(scale.voxel_size),
    );
    let unit = scale.unit;
    let message = format!("{stage}: voxels of {found} {unit}, the recipe's are {wanted} {unit}");
    if grid.same_voxels {
        return Err(RunError::Voxels(message));
    }
    let bounds = solid.bounds().map_err(RunError::level_set(stage))?;
    let size = bounds.size().max() * factor;
    let note = if size < scale.voxel_size {
        format!(
            "; all of it spans {} {unit}, less than a voxel: is its unit right?",
            super::error::short(size)
        )
    } else {
        String::new()
    };
    inputs.warn(Warning::RESAMPLED, format!("{message}: resampled{note}"))
}

/// The placement of `[[op]] resample`.
pub(super) fn resample_placement(op: &crate::recipe::Resample, scale: Scale) -> Placement {
    let similarity = Similarity {
        scale: op.scale,
        rotate: op.rotate,
        ..Similarity::default()
    };
    Placement {
        shift: Vec3::from(op.translate.map(|l| l.resolve(scale))),
        ..placement(&similarity, 1.0)
    }
}
