//! What a run is made of, read once: the meshes of its operations, its scaffold, its cell.

use super::RunOptions;
use super::cells;
use super::error::{RunError, short};
use super::field_ops::{Borrowed, Shape, common_part, field_operations};
use super::fractions;
use super::input_files::{Inputs, hash_text};
use super::lattice::Lattice;
use super::offsets::{self, Offsets};
use super::report::{OffsetReport, Report, SolidReport, Warning};
use super::scaffold;
use super::sheets::SheetOptions;
use super::standalone::StandAlone;
use super::tiling::{Fill, Filled};
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

/// What nodes may take of the tolerance of a tiling; tables have theirs by themselves.
const TOLD: f64 = 0.5;

/// Everything a run reads.
pub(super) struct Stock<'a> {
    /// The recipe.
    pub recipe: &'a Recipe,
    /// Grids of OpenVDB files.
    pub volumes: Volumes,
    inputs: Inputs<'a>,
    solids: BTreeMap<String, Arc<MeshSolid>>,
    /// Beams of the files that the solids are of.
    lattices: BTreeMap<String, Arc<Lattice>>,
    singles: BTreeMap<String, StandAlone>,
    tiling: Option<Fill>,
    offsets: Offsets,
    offset_reports: Vec<OffsetReport>,
    /// How the tiled scaffold finds its values, once it was asked for.
    kernel: OnceLock<Kernel>,
    /// The elements that its sampling came near.
    visits: Visits,
}

impl<'a> Stock<'a> {
    /// Reads all inputs.
    pub fn load(
        recipe: &'a Recipe,
        threads: &Threads,
        options: &'a RunOptions,
        progress: &dyn Progress,
    ) -> Result<Self, RunError> {
        let mut stock = Self {
            recipe,
            inputs: Inputs::new(recipe, options),
            volumes: Volumes::default(),
            solids: BTreeMap::new(),
            lattices: BTreeMap::new(),
            singles: BTreeMap::new(),
            tiling: None,
            offsets: Offsets::default(),
            offset_reports: Vec::new(),
            kernel: OnceLock::new(),
            visits: Visits::default(),
        };
        threads.install(|| {
            progress.stage("read", None);
            stock.load_solids()?;
            stock.load_singles(Session::new(threads, progress))?;
            stock.load_tiling(Session::new(threads, progress))
        })?;
        stock.visits = Visits::new(stock.elements() as usize);
        stock.volumes = Volumes::load(&mut stock.inputs, threads, progress)?;
        stock.inputs.compare_boxes()?;
        (stock.offsets, stock.offset_reports) = offsets::offsets(&stock, threads, progress)?;
        Ok(stock)
    }

    fn load_solids(&mut self) -> Result<(), RunError> {
        type Known = (Arc<MeshSolid>, Option<Arc<Lattice>>);
        let mut seen: Vec<(SurfaceRef, Known)> = Vec::new();
        for (n, op) in self.recipe.sections().op.iter().enumerate() {
            let Some(surface) = op.operand().and_then(Operand::surface) else {
                continue;
            };
            let skin = matches!(op.operand(), Some(Operand::Skin(_)));
            // A skin takes a mesh without beams.
            let is_known = |s: &&(SurfaceRef, Known)| s.0 == surface && !(skin && s.1.1.is_some());
            let (solid, lattice) = if let Some((_, known)) = seen.iter().find(is_known) {
                known.clone()
            } else {
                let path = if skin { ".skin" } else { "" };
                let key = format!("op.{n}.{}{path}.{}", op.name(), surface.word());
                let known: Known = if skin {
                    (Arc::new(self.inputs.solid(&key, surface)?), None)
                } else {
                    let (solid, lattice) = self.inputs.solid_and_beams(&key, surface)?;
                    (Arc::new(solid), lattice.map(Arc::new))
                };
                seen.push((surface, known.clone()));
                known
            };
            if let Some(lattice) = lattice {
                self.lattices.insert(format!("op.{n}"), lattice);
            }
            self.solids.insert(format!("op.{n}"), solid);
        }
        Ok(())
    }

    /// Cells that operations take by themselves.
    fn load_singles(&mut self, session: Session) -> Result<(), RunError> {
        let sections = self.recipe.sections();
        let scale = self.recipe.scale();
        for (n, op) in sections.op.iter().enumerate() {
            let Some(Operand::Cell(single)) = op.operand() else {
                continue;
            };
            session.progress.stage("cell", None);
            let section = &sections.cell[&single.name];
            let key = format!("cell.{}", single.name);
            let inputs = &mut self.inputs;
            let element = cells::recipe_element(inputs.recipe, section)?;
            let cell = cells::make(inputs, &key, section, element, session)?;
            let centre = Vec3::from(single.centre.map(|l| l.resolve(scale)));
            let alone = StandAlone::new(&cell, centre, single.size.resolve(scale))?;
            self.singles.insert(format!("op.{n}"), alone);
        }
        Ok(())
    }

    fn load_tiling(&mut self, session: Session) -> Result<(), RunError> {
        let sections = self.recipe.sections();
        let (Some(section), Some(tiling)) = (&sections.scaffold, &sections.tiling) else {
            return Ok(());
        };
        let loaded = scaffold::load(&mut self.inputs, section)?;
        session.progress.stage("cell", None);
        let envelope = self.envelope().cloned().or_else(|| loaded.envelope.clone());
        let inputs = &mut self.inputs;
        self.tiling = Some(Fill::load(
            inputs,
            loaded,
            tiling,
            envelope.as_deref(),
            session,
        )?);
        Ok(())
    }

    /// The first mesh or crystal without beams that the solid is intersected with.
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

    /// What fills the scaffold, if the recipe has one.
    pub fn fill(&self) -> Option<&Fill> {
        self.tiling.as_ref()
    }

    /// What the finished solid shows: W102 thin walls, W106 loose pieces, W107 cuts that miss it,
    /// W108 much that was dropped.
    pub fn look_at(&mut self, solid: &SolidReport, scale: Scale) -> Result<(), RunError> {
        if let Some(wall) = solid.least_wall.filter(|&w| w < 2.0 * scale.voxel_size) {
            let message = format!(
                "walls under 2 voxels: the least is {wall:.3} {}, {:.1} voxels",
                scale.unit,
                wall / scale.voxel_size
            );
            self.inputs.warn(Warning::THIN, message)?;
        }
        if solid.components > 1 {
            let message = format!(
                "the solid falls into {} pieces; keep_largest = true keeps one",
                solid.components
            );
            self.inputs.warn(Warning::PIECES, message)?;
        }
        let share = solid.dropped_volume / (solid.dropped_volume + solid.volume);
        if share > 0.01 {
            let message = format!(
                "{} pieces with {:.0} % of the solid were dropped; thin walls may have come apart before",
                solid.dropped_components,
                100.0 * share
            );
            self.inputs.warn(Warning::DROPPED, message)?;
        }
        let cuts = self.recipe.sections().output.iter().filter_map(|o| o.cut);
        for (cut, bounds) in cuts.filter_map(|cut| Some((cut, solid.bounds?))) {
            let (from, to) = (bounds.min[cut.axis], bounds.max[cut.axis]);
            if cut.at < from || cut.at > to {
                let message = format!(
                    "the cut at {} misses the part, which spans {} to {} there",
                    cut.at,
                    short(from),
                    short(to)
                );
                self.inputs.warn(Warning::CUT, message)?;
            }
        }
        Ok(())
    }

    /// A warning; the end of a strict run.
    pub fn warn(&mut self, code: &'static str, message: String) -> Result<(), RunError> {
        self.inputs.warn(code, message)
    }

    /// How many operations from the first are done before the level set is there.
    pub fn pointwise(&self) -> usize {
        match self.volumes.start() {
            Some(_) => 1,
            None => field_operations(&self.recipe.sections().op) + self.offsets.count,
        }
    }

    /// The mesh of an operation, by its key `op.N`.
    pub fn solid(&self, key: &str) -> &MeshSolid {
        &self.solids[key]
    }

    /// The beams beside the mesh of an operation, by its key `op.N`.
    pub fn lattice(&self, key: &str) -> Option<&Lattice> {
        self.lattices.get(key).map(Arc::as_ref)
    }

    /// The cell of an operation, by its key `op.N`.
    pub fn single(&self, key: &str) -> &StandAlone {
        &self.singles[key]
    }

    /// What is done to the field after the operations on fields.
    pub fn offsets(&self) -> Offsets {
        self.offsets
    }

    /// How the recipe tiles, for voxels of one size, where distances must hold beyond the band as far
    /// as offsets reach.
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

    /// How far tables and nodes may displace the surface, voxels.
    fn tolerance(&self) -> f64 {
        let section = self.recipe.sections().tiling.as_ref();
        section.map_or(0.0, |t| t.tolerance.0)
    }

    /// The tiled scaffold as a field, if the recipe has one.
    pub fn tiled(&self, scale: Scale, offsets: Offsets) -> Result<Option<Shape<'_>>, RunError> {
        let Some(tiling) = &self.tiling else {
            return Ok(None);
        };
        let options = self.tiling_options(scale, offsets);
        if let Some(round) = tiling.round() {
            return Ok(Some(round.shape(tiling, options, offsets)));
        }
        let failed = |e: tiling::TilingError| RunError::Tiling(e.to_string());
        let scaffold = &tiling.loaded.scaffold;
        let nodes = TOLD * self.tolerance() * options.voxel_size;
        let field: Box<WorldField<'_>> = if let Some(sheets) = tiling.sheets() {
            let how = SheetOptions {
                tiling: options,
                offsets,
                nodes,
                visits: Some(&self.visits),
            };
            let (field, kernel) = sheets.field(tiling, || tiling.tabulated(), how)?;
            self.kernel.get_or_init(|| kernel);
            field
        } else {
            match tiling.tabulated()? {
                Filled::One(table) => {
                    let solid = TiledSolid::new(scaffold, table, options).map_err(failed)?;
                    self.kernel.get_or_init(|| solid.kernel());
                    Box::new(solid.noting(&self.visits).by_nodes(nodes))
                }
                Filled::Many(blend) => {
                    let solid = TiledSolid::owning(scaffold, *blend, options).map_err(failed)?;
                    self.kernel.get_or_init(|| solid.kernel());
                    Box::new(solid.noting(&self.visits).by_nodes(nodes))
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
            // The mesh that was filled ends the solid.
            let borrowed = Box::new(Borrowed(envelope.as_ref()));
            shape.field = common_part(shape.field, borrowed, options.half_width, offsets);
        }
        Ok(Some(shape))
    }

    /// The box that the tiled scaffold lies in, if the recipe has one.
    pub fn tiled_extent(&self, scale: Scale, offsets: Offsets) -> Option<Aabb> {
        let boundary = self.tiling_options(scale, offsets).boundary;
        self.tiling.as_ref().map(|t| tiled_extent(t, boundary))
    }

    /// How the tiled scaffold found its values, if it was asked for any.
    pub fn kernel(&self) -> Option<Kernel> {
        self.kernel.get().copied()
    }

    /// Forgets which elements were visited: what was looked at before is no part of the run's sampling.
    pub fn begin_visits(&self) {
        self.visits.clear();
    }

    /// How many elements of the tiled scaffold were visited since.
    pub fn elements_visited(&self) -> Option<u64> {
        self.kernel().map(|_| self.visits.count())
    }

    /// How many leaves of the tiled scaffold nodes have told since.
    pub fn leaves_by_nodes(&self) -> Option<u64> {
        self.kernel().map(|_| self.visits.leaves_by_nodes())
    }

    /// Elements of the scaffold.
    pub fn elements(&self) -> u64 {
        self.tiling
            .as_ref()
            .map_or(0, |t| t.loaded.scaffold.len() as u64)
    }

    /// Volume that the solid's share is taken of: the first envelope's, or the scaffold's.
    pub fn room(&self) -> Option<f64> {
        self.envelope()
            .map(Arc::as_ref)
            .or_else(|| self.tiling.as_ref()?.loaded.envelope.as_deref())
            .map(|solid| solid.mesh().volume().abs())
            .or_else(|| self.tiling.as_ref().map(|t| t.loaded.report.volume))
    }

    /// Whether a path is one of the inputs.
    pub fn is_input(&self, path: &Path) -> bool {
        self.inputs.contains(path)
    }

    /// Share of its volume that the recipe asked of its cell or its tiling, and that the cell has in the
    /// elements of the scaffold as they are.
    pub fn fractions(&self) -> (Option<f64>, Option<f64>) {
        let Some(tiling) = &self.tiling else {
            return (None, None);
        };
        // Of a blend there is no single one.
        let asked = match &tiling.palette[..] {
            [entry] => self.recipe.sections().cell[&entry.name].volume_fraction,
            _ => None,
        };
        let asked = tiling.fraction_asked.or(asked.map(|f| f.0));
        (asked, fractions::of_cell(tiling))
    }

    /// The thickness that the recipe asks for, least and greatest, in its unit; `None` where it asks for none
    /// in units of length.
    pub fn thickness_asked(&self) -> Option<[f64; 2]> {
        self.tiling.as_ref()?.thickness_asked()
    }

    /// The part of the report that the inputs fill in.
    pub fn report(&self) -> Report {
        let path = self.recipe.source().path.as_ref();
        Report {
            druse: env!("CARGO_PKG_VERSION").into(),
            recipe: path.map_or(String::new(), |p| p.display().to_string()),
            recipe_blake3: hash_text(&self.recipe.source().text()),
            unit: self.recipe.unit().symbol().into(),
            inputs: self.inputs.files.clone(),
            scaffold: self.tiling.as_ref().map(|t| t.loaded.report.clone()),
            cells: self.tiling.iter().flat_map(Fill::facts).collect(),
            offsets: self.offset_reports.clone(),
            warnings: self.inputs.warnings.clone(),
            ..Report::default()
        }
    }
}

/// The box of a tiled scaffold. Where nothing is cut off, an envelope ends the solid; it may reach beyond the
/// scaffold.
fn tiled_extent(tiling: &Fill, boundary: tiling::Boundary) -> Aabb {
    let bounds = tiling.loaded.scaffold.bounds();
    let extent = match boundary {
        tiling::Boundary::Cut => bounds,
        tiling::Boundary::Extend => bounds.dilated(bounds.half_diagonal()),
    };
    let envelope = tiling.loaded.envelope.as_ref();
    envelope.map_or(extent, |e| extent.intersection(e.bounds()))
}
