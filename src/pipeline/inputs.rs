//! The inputs of a run, read once: meshes of its operations, its scaffold, its cells, its grids.

use super::RunOptions;
use super::cells;
use super::error::{RunError, short_number};
use super::field_ops::{Borrowed, Shape, field_operations, intersection};
use super::fractions;
use super::input_files::{InputFiles, SolidAndBeams, hash_text};
use super::lattice::LatticeSolid;
use super::offsets::{self, Offsets};
use super::report::{OffsetReport, Report, RequestedThickness, SolidReport, Warning};
use super::scaffold;
use super::sheets::SheetOptions;
use super::standalone::StandAlone;
use super::tiling::{CellTiling, ElementContent};
use super::volumes::Volumes;
use crate::field::WorldField;
use crate::frame::{Aabb, Vec3};
use crate::mesh::MeshSolid;
use crate::progress::{Progress, Threads};
use crate::recipe::{Boundary, Distance, Op, Operand, Recipe, Scale, SurfaceRef};
use crate::tiling::{self, Kernel, TiledSolid, TilingOptions, Visits};
use crate::vdb::Session;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Share of a tiling's tolerance that interpolation between nodes may use; tables have a separate
/// tolerance.
const NODE_TOLERANCE_SHARE: f64 = 0.5;
/// Share of the requested thickness below which half of the walls count as too thin.
const MIN_THICKNESS_SHARE: f64 = 0.75;

/// All inputs of a run.
pub(super) struct Inputs<'a> {
    /// The recipe.
    pub recipe: &'a Recipe,
    /// Grids of OpenVDB files.
    pub volumes: Volumes,
    files: InputFiles<'a>,
    solids: BTreeMap<String, Arc<MeshSolid>>,
    /// Beams of the files that the solids come from.
    lattices: BTreeMap<String, Arc<LatticeSolid>>,
    standalone_cells: BTreeMap<String, StandAlone>,
    tiling: Option<CellTiling>,
    offsets: Offsets,
    offset_reports: Vec<OffsetReport>,
    /// The kernel that evaluates the tiling, once its field exists.
    kernel: OnceLock<Kernel>,
    /// The elements that the sampling visits.
    visits: Visits,
}

impl<'a> Inputs<'a> {
    /// Reads all inputs.
    pub fn load(
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
        inputs.visits = Visits::new(inputs.elements() as usize);
        inputs.volumes = Volumes::load(&mut inputs.files, threads, progress)?;
        inputs.files.compare_boxes()?;
        (inputs.offsets, inputs.offset_reports) =
            offsets::field_offsets(&inputs, threads, progress)?;
        Ok(inputs)
    }

    fn load_solids(&mut self) -> Result<(), RunError> {
        let mut seen: Vec<(SurfaceRef, SolidAndBeams)> = Vec::new();
        for (n, op) in self.recipe.sections().op.iter().enumerate() {
            let Some(surface) = op.operand().and_then(Operand::surface) else {
                continue;
            };
            let is_skin = matches!(op.operand(), Some(Operand::Skin(_)));
            // The skin of a file with beams needs its mesh alone.
            let is_known =
                |s: &&(SurfaceRef, SolidAndBeams)| s.0 == surface && !(is_skin && s.1.1.is_some());
            let (solid, lattice) = if let Some((_, solid_and_beams)) = seen.iter().find(is_known) {
                solid_and_beams.clone()
            } else {
                let suffix = if is_skin { ".skin" } else { "" };
                let key = format!("op.{n}.{}{suffix}.{}", op.name(), surface.word());
                let solid_and_beams = if is_skin {
                    (self.files.solid(&key, surface)?, None)
                } else {
                    self.files.solid_and_beams(&key, surface)?
                };
                seen.push((surface, solid_and_beams.clone()));
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

    fn load_tiling(&mut self, session: Session) -> Result<(), RunError> {
        let sections = self.recipe.sections();
        let (Some(section), Some(tiling)) = (&sections.scaffold, &sections.tiling) else {
            return Ok(());
        };
        let loaded = scaffold::load(&mut self.files, section)?;
        session.progress.stage("cell", None);
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

    /// The first mesh or crystal without beams that an operation intersects the solid with.
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

    /// Warns of defects of the finished solid: W102 thin walls, W106 several components, W107 cuts that
    /// miss the part, W108 a large share of removed components.
    pub fn check_solid(&mut self, solid: &SolidReport, scale: Scale) -> Result<(), RunError> {
        if let Some(wall) = solid.least_wall.filter(|&w| w < 2.0 * scale.voxel_size) {
            let message = format!(
                "walls under 2 voxels: the thinnest is {wall:.3} {}, {:.1} voxels",
                scale.unit,
                wall / scale.voxel_size
            );
            self.files.warn(Warning::THIN_WALLS, message)?;
        }
        if let Some(message) = self.missed_thickness(solid, scale) {
            self.files.warn(Warning::THICKNESS, message)?;
        }
        if solid.components > 1 {
            let message = format!(
                "the solid has {} components; keep_largest = true keeps the largest",
                solid.components
            );
            self.files.warn(Warning::COMPONENTS, message)?;
        }
        let removed_share = solid.dropped_volume / (solid.dropped_volume + solid.volume);
        if removed_share > 0.01 {
            let message = format!(
                "{} components with {:.0} % of the solid were removed; thin walls may have broken before",
                solid.dropped_components,
                100.0 * removed_share
            );
            self.files.warn(Warning::REMOVED_COMPONENTS, message)?;
        }
        let cuts = self.recipe.sections().output.iter().filter_map(|o| o.cut);
        for (cut, bounds) in cuts.filter_map(|cut| Some((cut, solid.bounds?))) {
            let (from, to) = (bounds.min[cut.axis], bounds.max[cut.axis]);
            if cut.at < from || cut.at > to {
                let message = format!(
                    "the cut at {} misses the part, which spans {} to {} there",
                    cut.at,
                    short_number(from),
                    short_number(to)
                );
                self.files.warn(Warning::MISSED_CUT, message)?;
            }
        }
        Ok(())
    }

    /// Records a warning; an error in a strict run.
    pub fn warn(&mut self, code: &'static str, message: String) -> Result<(), RunError> {
        self.files.warn(code, message)
    }

    /// What to say of walls that are thinner than one thickness that was requested everywhere.
    fn missed_thickness(&self, solid: &SolidReport, scale: Scale) -> Option<String> {
        let found = solid.thickness.as_ref()?;
        let Some(RequestedThickness::Uniform(requested)) = found.requested else {
            return None;
        };
        // All other operations may change the thickness.
        let mut operations = self.recipe.sections().op.iter();
        let keeps_thickness = operations.all(|op| op.name() == "intersect");
        let is_missed = found.p50 < MIN_THICKNESS_SHARE * requested;
        (keeps_thickness && is_missed).then(|| {
            format!(
                "tiling.thickness: half of the walls are thinner than {:.3} {unit} where {requested:.3} {unit} is \
                 requested; a level has this thickness by its chords, which do not measure so full a solid; use \
                 volume_fraction, a sheet or a graph",
                found.p50,
                unit = scale.unit
            )
        })
    }

    /// Number of leading operations that the first level set already contains.
    pub fn field_operation_count(&self) -> usize {
        match self.volumes.start() {
            // A run that starts from a stored level set has done its first operation.
            Some(_) => 1,
            None => field_operations(&self.recipe.sections().op) + self.offsets.count,
        }
    }

    /// The mesh of an operation, by its key `op.N`.
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

    /// The tiling options for voxels of one size. Distances must hold as far beyond the band as the
    /// offsets reach.
    pub fn tiling_options(&self, scale: Scale, offsets: Offsets) -> TilingOptions {
        let sections = self.recipe.sections();
        let boundary = sections.scaffold.as_ref().map(|s| s.boundary);
        TilingOptions {
            voxel_size: scale.voxel_size,
            half_width: scale.voxel_size * sections.band.half_width.0 + offsets.reach(),
            distance: match sections.band.distance {
                Distance::Fast if !offsets.exact => tiling::Distance::Fast,
                _ => tiling::Distance::Exact,
            },
            boundary: match boundary.unwrap_or_default() {
                Boundary::Cut => tiling::Boundary::Cut,
                Boundary::Extend => tiling::Boundary::Extend,
            },
        }
    }

    /// Displacement of the surface that tables and interpolation may cause, voxels.
    fn tolerance(&self) -> f64 {
        let section = self.recipe.sections().tiling.as_ref();
        section.map_or(0.0, |t| t.tolerance.0)
    }

    /// The tiled scaffold as a field, if the recipe has one.
    pub fn tiling_shape(
        &self,
        scale: Scale,
        offsets: Offsets,
    ) -> Result<Option<Shape<'_>>, RunError> {
        let Some(tiling) = &self.tiling else {
            return Ok(None);
        };
        let options = self.tiling_options(scale, offsets);
        // Their distances are closed forms, which need no tables.
        if let Some(beams) = tiling.round() {
            return Ok(Some(beams.shape(tiling, options, offsets)));
        }
        let failed = |e: tiling::TilingError| RunError::Tiling(e.to_string());
        let scaffold = &tiling.loaded.scaffold;
        let node_tolerance = NODE_TOLERANCE_SHARE * self.tolerance() * options.voxel_size;
        let field: Box<WorldField<'_>> = if let Some(sheets) = tiling.sheets() {
            let sheet_options = SheetOptions {
                tiling: options,
                offsets,
                node_tolerance,
                visits: Some(&self.visits),
            };
            let (field, kernel) = sheets.field(tiling, || tiling.tabulated(), sheet_options)?;
            self.kernel.get_or_init(|| kernel);
            field
        } else {
            match tiling.tabulated()? {
                ElementContent::Cell(table) => {
                    let solid = TiledSolid::new(scaffold, table, options).map_err(failed)?;
                    self.kernel.get_or_init(|| solid.kernel());
                    Box::new(
                        solid
                            .with_visits(&self.visits)
                            .with_interpolation(node_tolerance),
                    )
                }
                ElementContent::Blend(blend) => {
                    let solid = TiledSolid::with_owned_filling(scaffold, *blend, options)
                        .map_err(failed)?;
                    self.kernel.get_or_init(|| solid.kernel());
                    Box::new(
                        solid
                            .with_visits(&self.visits)
                            .with_interpolation(node_tolerance),
                    )
                }
            }
        };
        let extent = tiled_extent(tiling, options.boundary);
        let mut shape = Shape {
            field,
            extent,
            name: "the scaffold".into(),
        };
        if let Some(envelope) = &tiling.loaded.envelope {
            // The mesh that the scaffold fills bounds the solid.
            let borrowed = Box::new(Borrowed(envelope.as_ref()));
            shape.field = intersection(shape.field, borrowed, options.half_width, offsets);
        }
        Ok(Some(shape))
    }

    /// The bounding box of the tiled scaffold, if the recipe has one.
    pub fn tiled_extent(&self, scale: Scale, offsets: Offsets) -> Option<Aabb> {
        let boundary = self.tiling_options(scale, offsets).boundary;
        self.tiling.as_ref().map(|t| tiled_extent(t, boundary))
    }

    /// The kernel that evaluated the tiling; `None` before its field exists.
    pub fn kernel(&self) -> Option<Kernel> {
        self.kernel.get().copied()
    }

    /// Resets the visits, so that they count the run's own sampling only.
    pub fn clear_visits(&self) {
        self.visits.clear();
    }

    /// Number of elements visited since the reset.
    pub fn elements_visited(&self) -> Option<u64> {
        self.kernel().map(|_| self.visits.count())
    }

    /// Number of leaves interpolated between nodes since the reset.
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

    /// Checks the hashes of the inputs against those of an earlier run.
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

/// The bounding box of a tiled scaffold. Without a cut at its boundary the solid may extend beyond the
/// scaffold; an envelope bounds it.
fn tiled_extent(tiling: &CellTiling, boundary: tiling::Boundary) -> Aabb {
    let bounds = tiling.loaded.scaffold.bounds();
    let extent = match boundary {
        tiling::Boundary::Cut => bounds,
        tiling::Boundary::Extend => bounds.dilated(bounds.half_diagonal()),
    };
    let envelope = tiling.loaded.envelope.as_ref();
    envelope.map_or(extent, |e| extent.intersection(e.bounds()))
}
