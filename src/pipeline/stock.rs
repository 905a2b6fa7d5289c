//! The inputs of a run, read once: meshes, cells, scaffold; what they are and what looks wrong.

use super::error::{RunError, show};
use super::report::{Input, Report, ScaffoldReport, SolidReport, Warning};
use super::shape::Shape;
use crate::frame::{Aabb, LengthUnit, Vec3};
use crate::io::ReadError;
use crate::mesh::{MeshSolid, TriMesh};
use crate::progress::{Progress, Threads};
use crate::recipe::{FileFrame, Operand, Recipe, Scale, Up};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Boxes that differ by more than this have probably different units.
const UNLIKELY: f64 = 100.0;

/// Everything a run reads.
pub(super) struct Stock<'a> {
    /// The recipe.
    pub recipe: &'a Recipe,
    solids: BTreeMap<String, Arc<MeshSolid>>,
    paths: Vec<PathBuf>,
    inputs: Vec<Input>,
    warnings: Vec<Warning>,
    scaffold: Option<ScaffoldReport>,
    strict: bool,
}

impl<'a> Stock<'a> {
    /// Reads all inputs.
    pub fn load(
        recipe: &'a Recipe,
        threads: &Threads,
        strict: bool,
        progress: &dyn Progress,
    ) -> Result<Self, RunError> {
        let mut stock = Self {
            recipe,
            solids: BTreeMap::new(),
            paths: recipe.source().path.iter().cloned().collect(),
            inputs: Vec::new(),
            warnings: Vec::new(),
            scaffold: None,
            strict,
        };
        progress.stage("read", None);
        threads.install(|| stock.load_solids())?;
        stock.compare_boxes()?;
        Ok(stock)
    }

    fn load_solids(&mut self) -> Result<(), RunError> {
        let mut seen: Vec<(FileFrame, Arc<MeshSolid>)> = Vec::new();
        for (n, op) in self.recipe.sections().op.iter().enumerate() {
            let (file, key) = match op.operand() {
                Some(Operand::Mesh(file)) => (file, format!("op.{n}.{}.mesh", op.name())),
                Some(Operand::Skin(skin)) => {
                    (&skin.mesh, format!("op.{n}.{}.skin.mesh", op.name()))
                }
                _ => continue,
            };
            let known = seen.iter().find(|(f, _)| *f == file.0);
            let solid = if let Some((_, solid)) = known {
                Arc::clone(solid)
            } else {
                let mesh = self.read_mesh(&key, file)?;
                let solid = Arc::new(MeshSolid::new(mesh));
                seen.push((file.0.clone(), Arc::clone(&solid)));
                solid
            };
            self.solids.insert(format!("op.{n}"), solid);
        }
        Ok(())
    }

    /// Reads a mesh into the recipe's unit and frame.
    fn read_mesh(&mut self, key: &str, file: &FileFrame) -> Result<TriMesh, RunError> {
        let path = self.recipe.resolve(&file.path);
        let read = super::pending::read_mesh(&path)?;
        let own = file.unit.map(|u| u.0).or(read.unit);
        let mesh = framed(&read.mesh, file, own, self.recipe.unit());
        if mesh.is_empty() {
            return Err(ReadError::data(
                &path,
                crate::io::Place::File,
                "no triangles",
                "a mesh with triangles",
            )
            .into());
        }
        self.record(key, &path, mesh.bounds())?;
        Ok(mesh)
    }

    /// Notes an input for the report.
    fn record(&mut self, key: &str, path: &Path, bounds: Aabb) -> Result<(), RunError> {
        let (_, hash) = digest(path)?;
        self.inputs.push(Input {
            key: key.to_owned(),
            path: path.display().to_string(),
            hash,
            bounds,
        });
        self.paths.push(path.to_owned());
        Ok(())
    }

    fn warn(&mut self, code: &'static str, message: String) -> Result<(), RunError> {
        if self.strict {
            return Err(RunError::Strict { code, message });
        }
        self.warnings.push(Warning { code, message });
        Ok(())
    }

    /// W101: two inputs whose boxes differ more than a hundredfold.
    fn compare_boxes(&mut self) -> Result<(), RunError> {
        let size = |i: &Input| i.bounds.half_diagonal();
        let world = || self.inputs.iter().filter(|i| !i.key.starts_with("cell."));
        let least = world().min_by(|a, b| size(a).total_cmp(&size(b)));
        let most = world().max_by(|a, b| size(a).total_cmp(&size(b)));
        let Some((least, most)) = least.zip(most) else {
            return Ok(());
        };
        if size(most) <= UNLIKELY * size(least) {
            return Ok(());
        }
        let message = format!(
            "units look wrong: {} spans {}, {} spans {} (in {}); say unit = ... for one of them",
            most.key,
            show(&most.bounds),
            least.key,
            show(&least.bounds),
            self.recipe.unit()
        );
        self.warn(Warning::UNITS, message)
    }

    /// What the finished solid shows: W102 thin walls, W106 loose pieces.
    pub fn look_at(&mut self, solid: &SolidReport, scale: Scale) -> Result<(), RunError> {
        if let Some(wall) = solid.least_wall.filter(|&w| w < 2.0 * scale.voxel_size) {
            let message = format!(
                "walls under 2 voxels: the least is {wall:.3} {}, {:.1} voxels",
                scale.unit,
                wall / scale.voxel_size
            );
            self.warn(Warning::THIN, message)?;
        }
        if solid.components > 1 {
            let message = format!(
                "the solid falls into {} pieces; keep_largest = true keeps one",
                solid.components
            );
            self.warn(Warning::PIECES, message)?;
        }
        Ok(())
    }

    /// The mesh of an operation, by its key `op.N`.
    pub fn solid(&self, key: &str) -> &MeshSolid {
        &self.solids[key]
    }

    /// The tiled scaffold as a field, if the recipe has one.
    pub fn tiled(&self, _scale: Scale) -> Option<Shape<'_>> {
        None
    }

    /// Elements of the scaffold.
    pub fn elements(&self) -> u64 {
        self.scaffold
            .as_ref()
            .map_or(0, |s| s.elements.values().sum())
    }

    /// Volume that the solid's share is taken of: the first envelope's, or the scaffold's.
    pub fn room(&self) -> Option<f64> {
        let ops = &self.recipe.sections().op;
        let envelope = ops.iter().enumerate().find_map(|(n, op)| match op {
            crate::recipe::Op::Intersect(Operand::Mesh(_)) => Some(self.solid(&format!("op.{n}"))),
            _ => None,
        });
        envelope
            .map(|solid| solid.mesh().volume().abs())
            .or_else(|| self.scaffold.as_ref().map(|s| s.volume))
    }

    /// Whether a path is one of the inputs.
    pub fn is_input(&self, path: &Path) -> bool {
        let real = |p: &Path| std::fs::canonicalize(p).ok();
        let target = real(path);
        target.is_some() && self.paths.iter().any(|p| real(p) == target)
    }

    /// The part of the report that the inputs fill in.
    pub fn report(&self) -> Report {
        Report {
            druse: env!("CARGO_PKG_VERSION").into(),
            recipe: self
                .recipe
                .source()
                .path
                .as_ref()
                .map_or(String::new(), |p| p.display().to_string()),
            recipe_blake3: hash_text(&self.recipe.source().text()),
            unit: self.recipe.unit().symbol().into(),
            inputs: self.inputs.clone(),
            scaffold: self.scaffold.clone(),
            warnings: self.warnings.clone(),
            ..Report::default()
        }
    }
}

/// A mesh in the recipe's unit and frame: its own unit, its up axis, then its placement.
pub(super) fn framed(
    mesh: &TriMesh,
    file: &FileFrame,
    own: Option<LengthUnit>,
    recipe: LengthUnit,
) -> TriMesh {
    let map = frame_map(file, own, recipe);
    mesh.mapped(map)
}

/// The change of frame of a file's points.
pub(super) fn frame_map(
    file: &FileFrame,
    own: Option<LengthUnit>,
    recipe: LengthUnit,
) -> impl Fn(Vec3) -> Vec3 {
    let factor = own.map_or(1.0, |u| u.to(recipe));
    let (matrix, shift) = file.transform.matrix();
    let up = file.up;
    move |v| {
        let v = match up {
            Up::Z => v,
            Up::Y => Vec3::new(v.x, -v.z, v.y),
        };
        matrix * (v * factor) + shift
    }
}

/// Size and BLAKE3 of a file.
pub(super) fn digest(path: &Path) -> Result<(u64, String), ReadError> {
    let failed = |e| ReadError::io(path, e);
    let mut file = std::fs::File::open(path).map_err(failed)?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; 1 << 18];
    let mut size = 0;
    loop {
        let n = file.read(&mut buffer).map_err(failed)?;
        if n == 0 {
            return Ok((size, hasher.finalize().to_hex().to_string()));
        }
        hasher.update(&buffer[..n]);
        size += n as u64;
    }
}

/// BLAKE3 of a text.
pub(super) fn hash_text(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().to_string()
}
