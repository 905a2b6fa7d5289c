//! The inputs of a run, read once: meshes of its operations, its scaffold, its cells, its grids.
//!
//! Files are read in the order: solids of operations, standalone cells, the scaffold with its tiling, grids. All are
//! read before the sampling, so that the stages agree on their contents. Offsets are chosen last (in `field::offsets`),
//! because they need the field.

use super::fractions;
use super::tiling::CellTiling;
use crate::frame::Vec3;
use crate::mesh::MeshSolid;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::offset::Offsets;
use crate::pipeline::base::report::{OffsetReport, Report};
use crate::pipeline::base::shape::field_operations;
use crate::pipeline::inputs::input_files::{InputFiles, SolidAndBeams, hash_text};
use crate::pipeline::inputs::lattice::LatticeSolid;
use crate::pipeline::inputs::run_options::RunOptions;
use crate::pipeline::inputs::standalone::StandAlone;
use crate::pipeline::inputs::volumes::Volumes;
use crate::pipeline::inputs::{cells, scaffold};
use crate::progress::{Progress, Threads};
use crate::recipe::{Op, Operand, Recipe, SurfaceRef};
use crate::tiling::{Kernel, Visits};
use crate::vdb::Session;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// All inputs of a run.
pub(crate) struct Inputs<'a> {
    /// The recipe.
    pub recipe: &'a Recipe,
    /// Grids of OpenVDB files.
    pub volumes: Volumes,
    files: InputFiles<'a>,
    /// Solids of meshes and crystals, by the operation's key `op.N`; the next two maps likewise.
    solids: BTreeMap<String, Arc<MeshSolid>>,
    /// Beams of the files that the solids come from.
    lattices: BTreeMap<String, Arc<LatticeSolid>>,
    standalone_cells: BTreeMap<String, StandAlone>,
    pub tiling: Option<CellTiling>,
    /// The moves of the surface that the field takes, and the report on all of them.
    pub offsets: Offsets,
    pub offset_reports: Vec<OffsetReport>,
    /// The kernel that evaluates the tiling, once its field exists.
    pub kernel: OnceLock<Kernel>,
    /// The elements that the sampling visits.
    pub visits: Visits,
}

impl<'a> Inputs<'a> {
    /// Reads all inputs. The offsets of their field are left to [`Inputs::load`].
    pub fn read(
        recipe: &'a Recipe,
        threads: &Threads,
        options: &'a RunOptions,
        progress: &dyn Progress,
    ) -> Result<Self, RunError> {
        let mut inputs = Self {
            recipe,
            files: InputFiles::new(recipe, options),
            volumes: Volumes::default(),
            solids: BTreeMap::new(),
            lattices: BTreeMap::new(),
            standalone_cells: BTreeMap::new(),
            tiling: None,
            offsets: Offsets::default(),
            offset_reports: Vec::new(),
            kernel: OnceLock::new(),
            visits: Visits::default(),
        };
        threads.install(|| {
            progress.stage("read", None);
            inputs.load_solids()?;
            inputs.load_standalone_cells(Session::new(threads, progress))?;
            inputs.load_tiling(Session::new(threads, progress))
        })?;
        // The counts need the number of elements, and the comparison of boxes all files.
        inputs.visits = Visits::new(inputs.elements() as usize);
        inputs.volumes = Volumes::load(&mut inputs.files, threads, progress)?;
        inputs.files.compare_boxes()?;
        Ok(inputs)
    }

    /// Reads the solids of all operations, and the beams of their files. A file that several
    /// operations name in the same frame is read once.
    fn load_solids(&mut self) -> Result<(), RunError> {
        // Whether a surface was loaded as a skin goes with what it gave.
        let mut seen: Vec<(SurfaceRef, bool, SolidAndBeams)> = Vec::new();
        for (n, op) in self.recipe.sections().op.iter().enumerate() {
            let Some(surface) = op.operand().and_then(Operand::surface) else {
                continue;
            };
            let is_skin = matches!(op.operand(), Some(Operand::Skin(_)));
            // The skin of a file with beams needs its mesh alone, and then does not know of its beams.
            let is_known = |(known, was_skin, (_, beams)): &&(SurfaceRef, bool, SolidAndBeams)| {
                *known == surface && (*was_skin == is_skin || (!was_skin && beams.is_none()))
            };
            let (solid, lattice) = if let Some((_, _, solid_and_beams)) = seen.iter().find(is_known)
            {
                solid_and_beams.clone()
            } else {
                let suffix = if is_skin { ".skin" } else { "" };
                let key = format!("op.{n}.{}{suffix}.{}", op.name(), surface.word());
                let solid_and_beams = if is_skin {
                    (self.files.solid(&key, surface)?, None)
                } else {
                    self.files.solid_and_beams(&key, surface)?
                };
                seen.push((surface, is_skin, solid_and_beams.clone()));
                solid_and_beams
            };
            if let Some(lattice) = lattice {
                self.lattices.insert(format!("op.{n}"), lattice);
            }
            self.solids.insert(format!("op.{n}"), solid);
        }
        Ok(())
    }

    /// Loads the standalone cells of operations.
    fn load_standalone_cells(&mut self, session: Session) -> Result<(), RunError> {
        let sections = self.recipe.sections();
        let scale = self.recipe.scale();
        for (n, op) in sections.op.iter().enumerate() {
            let Some(Operand::Cell(section)) = op.operand() else {
                continue;
            };
            session.progress.stage("cell", None);
            let cell_section = &sections.cell[&section.name];
            let key = format!("cell.{}", section.name);
            let files = &mut self.files;
            let element = cells::recipe_element(files.recipe, cell_section)?;
            let cell = cells::make(files, &key, cell_section, element, session)?;
            let centre = Vec3::from(section.centre.map(|l| l.resolve(scale)));
            let alone = StandAlone::new(&cell, centre, section.size.resolve(scale))?;
            self.standalone_cells.insert(format!("op.{n}"), alone);
        }
        Ok(())
    }

    /// Loads the scaffold and its tiling, if the recipe has both.
    fn load_tiling(&mut self, session: Session) -> Result<(), RunError> {
        let sections = self.recipe.sections();
        let (Some(section), Some(tiling)) = (&sections.scaffold, &sections.tiling) else {
            return Ok(());
        };
        let loaded = scaffold::load(&mut self.files, section, session.progress)?;
        session.progress.stage("cell", None);
        // An operation's mesh counts before the one that the scaffold fills.
        let envelope = self.envelope().cloned().or_else(|| loaded.envelope.clone());
        let files = &mut self.files;
        self.tiling = Some(CellTiling::load(
            files,
            loaded,
            tiling,
            envelope.as_deref(),
            session,
        )?);
        Ok(())
    }

    /// The envelope: the first mesh or crystal without beams that an operation intersects the solid with. The
    /// variable d of formulas is the distance to it.
    fn envelope(&self) -> Option<&Arc<MeshSolid>> {
        let ops = &self.recipe.sections().op;
        ops.iter().enumerate().find_map(|(n, op)| match op {
            Op::Intersect(Operand::Mesh(_) | Operand::Crystal(_)) => {
                let key = format!("op.{n}");
                let has_beams = self.lattices.contains_key(&key);
                self.solids.get(&key).filter(|_| !has_beams)
            }
            _ => None,
        })
    }

    /// The scaffold with its cells, if the recipe has one.
    pub fn tiling(&self) -> Option<&CellTiling> {
        self.tiling.as_ref()
    }

    /// Records a warning; an error in a strict run.
    pub fn warn(&mut self, code: &'static str, message: String) -> Result<(), RunError> {
        self.files.warn(code, message)
    }

    /// Number of leading operations that the first level set already contains.
    pub fn field_operation_count(&self) -> usize {
        match self.volumes.start() {
            // A run that starts from a stored level set has done its first operation.
            Some(_) => 1,
            None => field_operations(&self.recipe.sections().op) + self.offsets.count,
        }
    }

    /// The mesh of an operation, by its key `op.N`. Every operation with a surface has one after `read`.
    pub fn solid(&self, key: &str) -> &MeshSolid {
        &self.solids[key]
    }

    /// The beams of the file of an operation's mesh, by its key `op.N`.
    pub fn lattice(&self, key: &str) -> Option<&LatticeSolid> {
        self.lattices.get(key).map(Arc::as_ref)
    }

    /// The standalone cell of an operation, by its key `op.N`.
    pub fn standalone_cell(&self, key: &str) -> &StandAlone {
        &self.standalone_cells[key]
    }

    /// The offsets of the field after the operations on fields.
    pub fn offsets(&self) -> Offsets {
        self.offsets
    }

    /// The kernel that evaluated the tiling; `None` before its field exists, and always for round beams.
    pub fn kernel(&self) -> Option<Kernel> {
        self.kernel.get().copied()
    }

    /// Resets the visits, so that they count the run's own sampling only.
    pub fn clear_visits(&self) {
        self.visits.clear();
    }

    /// Number of elements visited since the reset; `None` where [`Self::kernel`] is.
    pub fn elements_visited(&self) -> Option<u64> {
        self.kernel().map(|_| self.visits.count())
    }

    /// Number of leaves interpolated between nodes since the reset; `None` as above.
    pub fn leaves_by_nodes(&self) -> Option<u64> {
        self.kernel().map(|_| self.visits.interpolated_leaves())
    }

    /// Number of triangles of the solids.
    pub fn triangles(&self) -> u64 {
        let mut solids: Vec<&Arc<MeshSolid>> = self.solids.values().collect();
        // Operations of one file have one solid.
        solids.sort_by_key(|s| Arc::as_ptr(s));
        solids.dedup_by(|a, b| Arc::ptr_eq(a, b));
        solids
            .iter()
            .map(|s| s.mesh().triangles().len() as u64)
            .sum()
    }

    /// Number of elements of the scaffold.
    pub fn elements(&self) -> u64 {
        self.tiling
            .as_ref()
            .map_or(0, |t| t.loaded.scaffold.len() as u64)
    }

    /// The volume that the volume fraction relates to: of the first envelope, or of the scaffold.
    pub fn reference_volume(&self) -> Option<f64> {
        self.envelope()
            .map(Arc::as_ref)
            .or_else(|| self.tiling.as_ref()?.loaded.envelope.as_deref())
            .map(|solid| solid.mesh().volume().abs())
            .or_else(|| self.tiling.as_ref().map(|t| t.loaded.report.volume))
    }

    /// Whether a path is one of the inputs.
    pub fn is_input(&self, path: &Path) -> bool {
        self.files.contains(path)
    }

    /// The volume fraction that the recipe requests of its cell or its tiling, and the fraction that the
    /// cell has in the elements as they are.
    pub fn volume_fractions(&self) -> (Option<f64>, Option<f64>) {
        let Some(tiling) = &self.tiling else {
            return (None, None);
        };
        // A blend has no single target.
        let target = match &tiling.palette[..] {
            [entry] => self.recipe.sections().cell[&entry.name].volume_fraction,
            _ => None,
        };
        let target = tiling.target_fraction.or(target.map(|f| f.0));
        (target, fractions::cell_fraction(tiling))
    }

    /// Least and greatest thickness that the recipe requests, in its unit; `None` where it requests none
    /// in units of length.
    pub fn target_thickness(&self) -> Option<[f64; 2]> {
        self.tiling.as_ref()?.target_thickness()
    }

    /// Checks the hashes of the inputs, by key, against those of an earlier run. Keys that the run does not have
    /// pass.
    pub fn expect(&self, hashes: &BTreeMap<String, String>) -> Result<(), RunError> {
        let found = &self.files.inputs;
        let changed = hashes.iter().filter_map(|(key, expected)| {
            let input = found.iter().find(|i| i.key == *key)?;
            (input.hash != *expected).then(|| format!("{key}: {}", input.path))
        });
        let changed: Vec<String> = changed.collect();
        if changed.is_empty() {
            return Ok(());
        }
        Err(RunError::ChangedInputs(changed))
    }

    /// The part of the report that describes the inputs.
    pub fn report(&self) -> Report {
        let path = self.recipe.source().path.as_ref();
        Report {
            druse: env!("CARGO_PKG_VERSION").into(),
            recipe: path.map_or(String::new(), |p| p.display().to_string()),
            recipe_blake3: hash_text(&self.recipe.source().text()),
            unit: self.recipe.unit().symbol().into(),
            inputs: self.files.inputs.clone(),
            scaffold: self.tiling.as_ref().map(|t| t.loaded.report.clone()),
            cells: self.tiling.iter().flat_map(CellTiling::facts).collect(),
            offsets: self.offset_reports.clone(),
            warnings: self.files.warnings.clone(),
            ..Report::default()
        }
    }
}
