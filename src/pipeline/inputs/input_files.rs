//! The input files of a run: their frames, hashes, boxes and warnings.
//!
//! Every file that decides the solid is recorded with its hash and box, under the key that names it. A session
//! of runs keeps what was read under a key of path, size and time; the records of kept inputs are repeated in
//! each run.

use super::crystals::Crystal;
use super::lattice::LatticeSolid;
use super::run_cache::{Kept, ReadInput, RunCache, file_key};
use super::run_options::RunOptions;
use crate::frame::{Aabb, LengthUnit, Vec3};
use crate::io::{Place, ReadError, SolidFile};
use crate::mesh::{MeshSolid, NoSolidError, RepairKind, TriMesh};
use crate::pipeline::base::error::{RunError, box_text};
use crate::pipeline::base::report::Input;
use crate::pipeline::base::warning::Warning;
use crate::recipe::{CrystalFrame, FileFrame, Recipe, SurfaceRef, Up};
use crate::vdb::subprocess::{PrefetchedGrid, Program};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Ratio of two boxes' sizes above which their units probably differ.
const MAX_SIZE_RATIO: f64 = 100.0;

/// A solid, and the beams of its file.
pub(crate) type SolidAndBeams = (Arc<MeshSolid>, Option<Arc<LatticeSolid>>);

/// The files read so far, for the report; no output may replace `paths`. In a `strict` run a warning is an error.
pub(crate) struct InputFiles<'a> {
    pub recipe: &'a Recipe,
    pub inputs: Vec<Input>,
    pub warnings: Vec<Warning>,
    /// The child process that reads OpenVDB files, if there is one.
    pub reader: Option<&'a Program>,
    /// A grid that is in memory already, if there is one.
    pub opened: Option<&'a PrefetchedGrid>,
    /// What earlier runs read and made, if there are any.
    pub cache: Option<&'a RunCache>,
    paths: Vec<PathBuf>,
    strict: bool,
}

/// What becomes of the beams of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FileBeams {
    Read,
    Ignored,
}

impl<'a> InputFiles<'a> {
    /// No files yet, except for the recipe's own.
    pub fn new(recipe: &'a Recipe, options: &'a RunOptions) -> Self {
        Self {
            recipe,
            inputs: Vec::new(),
            warnings: Vec::new(),
            reader: options.isolated.as_ref(),
            opened: options.opened.as_ref(),
            cache: options.cache.as_ref(),
            paths: recipe.source().path.iter().cloned().collect(),
            strict: options.strict,
        }
    }

    /// The solid that a surface (a mesh file or a crystal) of the recipe bounds, in the recipe's frame. `key`
    /// names the input in report and errors.
    pub fn solid(&mut self, key: &str, surface: SurfaceRef) -> Result<Arc<MeshSolid>, RunError> {
        match surface {
            SurfaceRef::Mesh(file) => Ok(self.file_solid(key, file, FileBeams::Ignored)?.0),
            SurfaceRef::Crystal(frame) => Ok(Arc::new(self.crystal_solid(key, frame)?)),
        }
    }

    /// The solid that a surface of the recipe bounds, and the beams that its file holds.
    pub fn solid_and_beams(
        &mut self,
        key: &str,
        surface: SurfaceRef,
    ) -> Result<SolidAndBeams, RunError> {
        match surface {
            SurfaceRef::Mesh(file) => self.file_solid(key, file, FileBeams::Read),
            SurfaceRef::Crystal(_) => Ok((self.solid(key, surface)?, None)),
        }
    }

    /// The solid of a file, kept from an earlier run or read, and its beams if they are wanted. `key` names the
    /// input, as in `op.2.union.mesh`.
    fn file_solid(
        &mut self,
        key: &str,
        file: &FileFrame,
        beams: FileBeams,
    ) -> Result<SolidAndBeams, RunError> {
        let path = self.recipe.resolve(&file.path);
        // All that decides the solid: the file with its size and time, its frame, and the recipe's unit.
        let whole = file_key(&path).map(|f| {
            let unit = self.recipe.unit();
            (key.to_owned(), format!("{file:?} {beams:?} {unit:?} {f}"))
        });
        self.kept(
            |cache| &cache.solids,
            whole,
            |files| {
                let read = if beams == FileBeams::Read {
                    crate::io::read_solid(&path)?
                } else {
                    SolidFile {
                        file: crate::io::read_mesh(&path)?,
                        beams: Vec::new(),
                    }
                };
                let (solid, lattice) = files.read_solid(key, file, read)?;
                Ok((Arc::new(solid), lattice.map(Arc::new)))
            },
        )
    }

    /// What `make` makes, or made in an earlier run of this session for the same place and key. `kept` selects the
    /// cache of its kind; `key` is place and key, and `None` where the value cannot be kept.
    pub fn kept<T: Clone>(
        &mut self,
        kept: impl Fn(&RunCache) -> &Kept<ReadInput<T>>,
        key: Option<(String, String)>,
        make: impl FnOnce(&mut Self) -> Result<T, RunError>,
    ) -> Result<T, RunError> {
        let (Some(cache), Some((place, key))) = (self.cache, key) else {
            return make(self);
        };
        // `make` also records inputs, warnings and paths. They are kept with the value, and recorded
        // again in each run.
        let before = (self.inputs.len(), self.warnings.len(), self.paths.len());
        let mut is_new = false;
        let found = kept(cache).get_or_make(place, key, || {
            is_new = true;
            Ok::<_, RunError>(ReadInput {
                value: make(self)?,
                inputs: self.inputs[before.0..].to_vec(),
                warnings: self.warnings[before.1..].to_vec(),
                paths: self.paths[before.2..].to_vec(),
            })
        })?;
        if !is_new {
            self.inputs.extend(found.inputs);
            self.paths.extend(found.paths);
            for Warning { code, message } in found.warnings {
                self.warn(code, message)?;
            }
        }
        Ok(found.value)
    }

    /// Makes a crystal and records it.
    pub fn crystal(&mut self, key: &str, frame: &CrystalFrame) -> Result<Crystal, RunError> {
        let crystal = Crystal::make(self.recipe, frame)?;
        self.record_crystal(key, &crystal, crystal.mesh.bounds())?;
        Ok(crystal)
    }

    /// Records a crystal for the report, and the notes of its steps as warnings.
    pub fn record_crystal(
        &mut self,
        key: &str,
        crystal: &Crystal,
        bounds: Aabb,
    ) -> Result<(), RunError> {
        self.inputs.push(Input {
            key: key.to_owned(),
            path: crystal.origin.clone(),
            hash: crystal.hash.clone(),
            bounds,
        });
        self.paths.extend(crystal.files.iter().cloned());
        for note in &crystal.notes {
            self.warn(Warning::MESH, format!("{key}: {note}"))?;
        }
        Ok(())
    }

    fn crystal_solid(&mut self, key: &str, frame: &CrystalFrame) -> Result<MeshSolid, RunError> {
        let crystal = self.crystal(key, frame)?;
        let mesh = crystal.solid(self.recipe, frame)?;
        self.repaired(key, mesh, Path::new(&crystal.origin))
    }

    /// A mesh as a solid, with a warning for each repair.
    fn repaired(&mut self, key: &str, mesh: TriMesh, path: &Path) -> Result<MeshSolid, RunError> {
        let (solid, repairs) = MeshSolid::repaired(mesh).map_err(|e| not_a_solid(path, &e))?;
        for repair in repairs {
            log::info!(target: "druse::mesh", "{}: {repair}", path.display());
            let code = match repair.kind {
                RepairKind::United | RepairKind::Repeated => Warning::OVERLAP,
                RepairKind::Flipped | RepairKind::Closed => Warning::MESH,
            };
            self.warn(code, format!("{key}: {repair}"))?;
        }
        Ok(solid)
    }

    /// Converts a file's mesh and beams to the recipe's unit and frame and makes solids of them: the mesh, which
    /// may be empty, and the beams, if there are any. Records the file.
    fn read_solid(
        &mut self,
        key: &str,
        file: &FileFrame,
        SolidFile { file: read, beams }: SolidFile,
    ) -> Result<(MeshSolid, Option<LatticeSolid>), RunError> {
        let path = self.recipe.resolve(&file.path);
        // The recipe's word on the unit counts before that of the file; without both, it is the recipe's own unit.
        let unit = file.unit.map(|u| u.0).or(read.unit);
        let recipe = self.recipe.unit();
        let mesh = mapped_mesh(&read.mesh, file, unit, recipe);
        // `factor` scales the radii of beams, as `map` their ends.
        let factor = unit.map_or(1.0, |u| u.to(recipe)) * file.transform.scale.0;
        let map = frame_map(file, unit, recipe);
        let clip = |mesh| self.repaired(key, mesh, &path);
        let lattice = LatticeSolid::new(&beams, map, factor, clip)?;
        let bounds = match &lattice {
            Some(lattice) if mesh.is_empty() => lattice.bounds(),
            Some(lattice) => lattice.bounds().union(mesh.bounds()),
            None => nonempty_bounds(&mesh, &path)?,
        };
        self.record(key, &path, bounds)?;
        for warning in read.warnings {
            self.warn(Warning::MESH, format!("{key}: {warning}"))?;
        }
        // A file may hold beams alone.
        let solid = if mesh.is_empty() {
            MeshSolid::new(mesh)
        } else {
            self.repaired(key, mesh, &path)?
        };
        Ok((solid, lattice))
    }

    /// Records an input for the report, with the hash of its bytes; `bounds` is its box in the recipe's unit, or
    /// in reference coordinates for a cell.
    pub fn record(&mut self, key: &str, path: &Path, bounds: Aabb) -> Result<(), RunError> {
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

    /// Records a warning; an error in a strict run.
    pub fn warn(&mut self, code: &'static str, message: String) -> Result<(), RunError> {
        if self.strict {
            return Err(RunError::Strict { code, message });
        }
        self.warnings.push(Warning { code, message });
        Ok(())
    }

    /// W101: the boxes of two inputs in world space differ more than a hundredfold.
    pub fn compare_boxes(&mut self) -> Result<(), RunError> {
        let size = |i: &Input| i.bounds.half_diagonal();
        // Boxes of cells are in reference coordinates.
        let is_in_world = |i: &&Input| !i.key.starts_with("cell.") && !i.bounds.is_empty();
        let in_world = || self.inputs.iter().filter(is_in_world);
        let smallest = in_world().min_by(|a, b| size(a).total_cmp(&size(b)));
        let largest = in_world().max_by(|a, b| size(a).total_cmp(&size(b)));
        let Some((smallest, largest)) = smallest.zip(largest) else {
            return Ok(());
        };
        if size(largest) <= MAX_SIZE_RATIO * size(smallest) {
            return Ok(());
        }
        let message = format!(
            "units look wrong: {} spans {}, {} spans {} (in {}); set unit = ... for one of them",
            largest.key,
            box_text(&largest.bounds),
            smallest.key,
            box_text(&smallest.bounds),
            self.recipe.unit()
        );
        self.warn(Warning::UNITS, message)
    }

    /// Whether a path is one of the inputs.
    pub fn contains(&self, path: &Path) -> bool {
        let real = |p: &Path| std::fs::canonicalize(p).ok();
        let target = real(path);
        target.is_some() && self.paths.iter().any(|p| real(p) == target)
    }
}

/// The box of a mesh; an error for one without triangles.
fn nonempty_bounds(mesh: &TriMesh, path: &Path) -> Result<Aabb, ReadError> {
    if mesh.is_empty() {
        let (found, expected) = ("no triangles", "a mesh with triangles");
        return Err(ReadError::data(path, Place::File, found, expected));
    }
    Ok(mesh.bounds())
}

/// The error for a mesh that bounds no solid and cannot be repaired.
pub(crate) fn not_a_solid(path: &Path, error: &NoSolidError) -> ReadError {
    ReadError::data(
        path,
        Place::File,
        error.to_string(),
        "a surface that bounds a solid",
    )
}

/// A mesh in the recipe's frame: converted from its own unit, turned to the recipe's up axis, then
/// placed.
fn mapped_mesh(
    mesh: &TriMesh,
    file: &FileFrame,
    own: Option<LengthUnit>,
    recipe: LengthUnit,
) -> TriMesh {
    mesh.mapped(frame_map(file, own, recipe))
}

/// The map of a file's points to the recipe's frame: converted from the unit `own` (`None`: the recipe's), turned
/// so that z is up, then placed.
pub(crate) fn frame_map(
    file: &FileFrame,
    own: Option<LengthUnit>,
    recipe: LengthUnit,
) -> impl Fn(Vec3) -> Vec3 + use<> {
    let factor = own.map_or(1.0, |u| u.to(recipe));
    let (matrix, shift) = file.transform.matrix();
    let up = file.up;
    move |v| {
        let v = match up {
            Up::Z => v,
            // A right-handed turn by 90 degrees about x.
            Up::Y => Vec3::new(v.x, -v.z, v.y),
        };
        matrix * (v * factor) + shift
    }
}

/// Size and BLAKE3 of a file.
pub(crate) fn digest(path: &Path) -> Result<(u64, String), ReadError> {
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
pub(crate) fn hash_text(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().to_string()
}
