//! Mesh files of a solid in bricks, written while patches pass, each as its output requests.
//!
//! Bricks come in descending order, so that vertices on a seam have the number of the brick behind it. A file takes all
//! triangles of the patches, the decimated ones, or the faces of OpenVDB's mesher. Decimated and projected faces are
//! made block by block with a halo. No vertex or face depends on the edge of the bricks.

use super::BrickRun;
use super::assemble::part;
use super::solid::StoredSolid;
use crate::band::{BLOCK, LEAF, Region};
use crate::field::WorldField;
use crate::frame::{Coord, LengthUnit, Vec3};
use crate::io::{BeamLattice, Faces, MeshPart, MeshStream, write_beams};
use crate::mesh::{ProjectionOptions, ProjectionSummary};
use crate::mesher::{Patch, Welder, move_off_voxels};
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::MeshFacts;
use crate::pipeline::base::shape::Shape;
use crate::pipeline::field::field_ops::shape;
use crate::pipeline::measure::thickness::Thickness;
use crate::pipeline::outputs::attributes::Attributes;
use crate::pipeline::outputs::beams::beams as beams_of;
use crate::pipeline::outputs::decimate::{Decimation, decimated_patch};
use crate::pipeline::outputs::meshing::{is_obj, max_magnitude};
use crate::pipeline::outputs::output_targets::Targets;
use crate::pipeline::outputs::precision::needs_double;
use crate::recipe::{Output, OutputKind, Scale};
use crate::vdb::{LevelSet, VdbError};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Halo of a block, voxels, in which vertices can limit the projection of the block's vertices: one that
/// spoils a triangle goes back, which may spoil the next; three leaves hold such chains.
pub(super) const UNTANGLING_HALO: i32 = 24;

/// A mesh file in progress.
struct MeshOutput<'a> {
    path: PathBuf,
    file: MeshStream,
    /// Factor from the recipe's unit to the file's. The next field is in recipe units, before that factor.
    factor: f64,
    /// Greatest magnitude of coordinates, world units, if vertices must stay distinct in single
    /// precision.
    max_coordinate: Option<f64>,
    /// Whether its vertices are projected onto the exact field.
    is_exact: bool,
    face_source: FaceSource,
    attributes: Attributes<'a>,
    facts: MeshFacts,
}

/// The faces of a mesh file. Other than `All` they have their own vertex numbers.
enum FaceSource {
    /// All triangles of the band.
    All,
    /// Decimated triangles.
    Decimated(Decimation, Welder),
    /// OpenVDB's quads, or triangles cut from them.
    OpenVdb {
        adaptivity: f64,
        /// The projection onto the field and its creases, if the output requests it.
        projection: Option<ProjectionOptions>,
        as_triangles: bool,
        /// The decimation of the triangles.
        decimation: Option<Decimation>,
        welder: Welder,
    },
}

/// Beams that are written with the meshes; `factor` takes lengths of the recipe to `unit`.
struct BeamOutput {
    path: PathBuf,
    lattice: BeamLattice,
    unit: LengthUnit,
    factor: f64,
}

/// Where the vertices of a patch lie.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum VertexSource {
    /// At the zeros of the interpolated level set.
    LevelSet,
    /// At the zeros of the exact field.
    ExactField,
}

/// All mesh files of a run.
pub(super) struct Meshes<'a> {
    outputs: Vec<MeshOutput<'a>>,
    beams: Vec<BeamOutput>,
    /// The exact field of the solid, where any output projects vertices onto it.
    exact: Option<Shape<'a>>,
    /// Welders for all triangles: of the level set, and of the exact field.
    welders: [Welder; 2],
}

/// Numbers of a patch's faces in vertices of the whole mesh: vertices on a seam get the number that an earlier
/// patch gave them.
fn weld<const N: usize>(welder: &mut Welder, patch: &Patch<N>) -> Result<Vec<[u32; N]>, RunError> {
    let mesh_error = |e| RunError::level_set("mesh")(VdbError::from(e));
    welder.weld(patch).map_err(mesh_error)
}

/// Greatest distance of a patch's own vertices from the exact field, world units; 0 without one.
fn projection_error(context: StageContext, patch: &Patch, exact: Option<&Shape>) -> f64 {
    let owned = &patch.vertices[..patch.owned];
    let measure = |exact: &Shape| {
        context
            .threads
            .install(|| max_magnitude(owned, &*exact.field))
    };
    exact.map_or(0.0, measure)
}

impl MeshOutput<'_> {
    /// Adds a patch. `numbered` are its faces in vertex numbers of the whole mesh, `projection_error` is the
    /// distance of its own vertices from the exact field.
    fn add<const N: usize>(
        &mut self,
        context: StageContext,
        patch: &Patch<N>,
        numbered: &[[u32; N]],
        projection_error: f64,
    ) -> Result<(), RunError>
    where
        for<'f> Faces<'f>: From<&'f [[u32; N]]>,
    {
        let owned = &patch.vertices[..patch.owned];
        // Vertices near a voxel may become equal in single precision. They are moved off it, by the same
        // amount in every brick. Meshes with own faces are exempt, because their vertices lie elsewhere.
        let mut distinct = Vec::new();
        if let Some(far) = self.max_coordinate.filter(|_| self.face_source.is_all()) {
            distinct.clone_from(&patch.vertices);
            let (h, origin) = (context.scale.voxel_size, Vec3::zeros());
            let clear = || move_off_voxels(&mut distinct, h, origin, far);
            if !context.threads.install(clear) {
                // Near the origin the margin of the mesher is enough: nothing was moved.
                distinct.clear();
            }
        }
        self.file.add(MeshPart {
            vertices: if distinct.is_empty() {
                &patch.vertices
            } else {
                &distinct
            },
            owned: patch.owned,
            faces: patch.faces.as_slice().into(),
            numbered: numbered.into(),
            numbers: &self.attributes.rows_at(context, owned),
            factor: self.factor,
        })?;
        self.facts.faces += patch.faces.len() as u64;
        self.facts.error = self.facts.error.map(|e| e.max(projection_error));
        Ok(())
    }

    /// Adds the faces that OpenVDB's mesher makes in a region of voxels, projected onto a field if there is one.
    /// `solid` is the region with its halo. `far` is the greatest magnitude of a coordinate of the whole solid,
    /// world units, on which the margin of the mesher depends. `last` is the greatest x of the regions of the same
    /// brick, voxels.
    fn add_quad_region(
        &mut self,
        context: StageContext,
        solid: &LevelSet,
        exact: Option<&Shape>,
        region: Region,
        far: f64,
        last: i32,
    ) -> Result<(), RunError> {
        let FaceSource::OpenVdb {
            adaptivity,
            projection,
            as_triangles,
            decimation,
            welder,
        } = &mut self.face_source
        else {
            return Ok(());
        };
        let failed = RunError::level_set("mesh");
        let mesh = solid.part_to_quads(*adaptivity, far, context.session());
        let mut mesh = mesh.map_err(&failed)?;
        // The part has a halo around the region; only the region's own quads are written.
        let own_quads = solid.region_quads(&mesh, region, last, *adaptivity);
        let mut projection_error = 0.0;
        if let (Some(projection), Some(exact)) = (*projection, exact) {
            // The projection moves all vertices, because those of the halo limit how far the region's
            // own ones may go. Only the latter are counted.
            let project = || mesh.project_each(&*exact.field, projection, context.progress);
            let outcomes = context.threads.install(project)?;
            let found =
                ProjectionSummary::of(own_quads.owned().iter().map(|&v| outcomes[v as usize]));
            projection_error = found.error;
            let add = |sum: Option<u64>, more: usize| sum.map(|n| n + more as u64);
            self.facts.creased = add(self.facts.creased, found.creased);
            self.facts.kept = add(self.facts.kept, found.kept);
        }
        let patch = own_quads.patch(&mesh);
        // A patch is decimated alone and keeps its border, so that it fits its neighbours.
        if *as_triangles {
            let mut patch = patch.into_triangles();
            if let Some(decimation) = *decimation {
                let decimated = || decimated_patch(&patch, decimation, last);
                patch = context.threads.install(decimated);
            }
            let numbered = weld(welder, &patch)?;
            self.add(context, &patch, &numbered, projection_error)
        } else {
            let numbered = weld(welder, &patch)?;
            self.add(context, &patch, &numbered, projection_error)
        }
    }
}

impl FaceSource {
    /// The faces that an output requests, for voxels of the size in `scale`.
    fn of(output: &Output, scale: Scale) -> Self {
        if output.is_meshed_by_openvdb() {
            return Self::OpenVdb {
                adaptivity: output.merging(),
                projection: output.moves_open_vdb().then_some(ProjectionOptions {
                    voxel_size: scale.voxel_size,
                    sharp: output.sharp,
                }),
                as_triangles: !output.quads,
                decimation: output.decimate.as_ref().map(|d| Decimation::new(d, scale)),
                welder: Welder::default(),
            };
        }
        match &output.decimate {
            Some(section) => Self::Decimated(Decimation::new(section, scale), Welder::default()),
            None => Self::All,
        }
    }

    fn is_all(&self) -> bool {
        matches!(self, Self::All)
    }
}

impl<'a> Meshes<'a> {
    /// Creates the files of all mesh outputs and writes their heads. Beams are only collected; they are written
    /// with `commit`. `thickness` is the measured local thickness, for outputs whose attributes (`grids`) contain
    /// it.
    pub fn create(
        brick_run: &BrickRun<'a>,
        solid: &StoredSolid,
        targets: &Targets,
        thickness: Option<&'a Thickness>,
    ) -> Result<Self, RunError> {
        let recipe = brick_run.inputs.recipe;
        let context = solid.bricks.context(brick_run, brick_run.progress);
        // Greatest magnitude of a coordinate, and the centre, world units: they decide the precision of a file.
        let (far, centre) = (solid.far(), solid.centre());
        let (mut outputs, mut beams) = (Vec::new(), Vec::new());
        for (output, path) in targets.of_kind(OutputKind::Mesh) {
            let unit = output.unit_or_default(recipe.unit());
            let factor = recipe.unit().to(unit);
            // Beams are written from the lattice and need no surface.
            if output.beams {
                beams.push(BeamOutput {
                    path: path.clone(),
                    lattice: beams_of(brick_run.inputs)?,
                    unit,
                    factor,
                });
                continue;
            }
            // The attributes of a mesh are the grids that its output names; they become values per vertex.
            let words = output.grids.as_deref().unwrap_or_default();
            let attributes = Attributes::new(context, brick_run.inputs, words, thickness, factor)?;
            let is_exact = output.project || output.sharp;
            let is_double = needs_double(path, far, centre, context.scale, factor)?;
            // Counts of a projection start at 0. Files without a projection report none.
            let moved_count = is_exact.then_some(0);
            outputs.push(MeshOutput {
                path: path.clone(),
                file: MeshStream::create(path, unit, output.quads, attributes.names())?
                    .in_double(is_double),
                factor,
                // Files in double precision keep near vertices distinct; an OBJ always has the digits of doubles.
                max_coordinate: (!is_double && !is_obj(path)).then_some(far),
                is_exact,
                face_source: FaceSource::of(output, context.scale),
                attributes,
                facts: MeshFacts {
                    creased: moved_count,
                    kept: moved_count,
                    error: is_exact.then_some(0.0),
                    ..MeshFacts::default()
                },
            });
        }
        let needs_exact = outputs.iter().any(|output| output.is_exact);
        let exact = needs_exact.then(|| shape(brick_run.inputs, context.scale));
        Ok(Self {
            outputs,
            beams,
            exact: exact.transpose()?,
            welders: Default::default(),
        })
    }

    /// The exact field, if an output with all triangles needs it.
    pub fn exact(&self) -> Option<&WorldField<'a>> {
        let accepts = |output: &MeshOutput| output.is_exact && output.face_source.is_all();
        let exact = self
            .exact
            .as_ref()
            .filter(|_| self.outputs.iter().any(accepts));
        exact.map(|shape| &*shape.field)
    }

    /// Adds a patch to the files with all triangles whose vertices have the same source; does nothing if no file
    /// wants them.
    pub fn add(
        &mut self,
        context: StageContext,
        patch: &Patch,
        source: VertexSource,
    ) -> Result<(), RunError> {
        let is_exact = source == VertexSource::ExactField;
        let accepts =
            |output: &&mut MeshOutput| output.is_exact == is_exact && output.face_source.is_all();
        let mut outputs = self.outputs.iter_mut().filter(accepts).peekable();
        if outputs.peek().is_none() {
            return Ok(());
        }
        let numbered = weld(&mut self.welders[usize::from(is_exact)], patch)?;
        let exact = self.exact.as_ref().filter(|_| is_exact);
        let projection_error = projection_error(context, patch, exact);
        outputs.try_for_each(|output| output.add(context, patch, &numbered, projection_error))
    }

    /// Halo of a region on which its faces depend, voxels.
    pub fn halo(&self) -> i32 {
        let halos = self.outputs.iter().map(|output| match output.face_source {
            FaceSource::All | FaceSource::Decimated(..) => LEAF,
            FaceSource::OpenVdb { adaptivity, .. } => LevelSet::quad_halo(adaptivity),
        });
        halos.fold(LEAF, i32::max)
    }

    /// Adds a region of a solid to the files with other faces than all triangles. `solid` is the part around the
    /// region of the solid `stored`; `far` is the greatest magnitude of its coordinates, world units.
    pub fn add_other_faces(
        &mut self,
        context: StageContext,
        stored: &StoredSolid,
        solid: &LevelSet,
        region: Region,
        far: f64,
    ) -> Result<(), RunError> {
        self.add_decimated(context, solid, region, far)?;
        self.add_quads(context, stored, solid, region, far)
    }

    /// Adds the decimated triangles of a region. Decimates block by block, so that nothing depends on the bricks.
    /// Blocks keep their shared border.
    fn add_decimated(
        &mut self,
        context: StageContext,
        solid: &LevelSet,
        region: Region,
        far: f64,
    ) -> Result<(), RunError> {
        for output in &mut self.outputs {
            let FaceSource::Decimated(decimation, welder) = &mut output.face_source else {
                continue;
            };
            let decimation = *decimation;
            let exact = self.exact.as_ref().filter(|_| output.is_exact);
            let field = exact.map(|shape| &*shape.field);
            let patches = solid.block_patches(region, far, field, context.session(), |patch| {
                decimated_patch(&patch, decimation, region.max[0])
            });
            let patches = patches.map_err(RunError::level_set("mesh"))?;
            // Vertices on seams get the numbers that earlier patches gave them.
            let numbered = patches.iter().map(|patch| weld(welder, patch));
            let numbered = numbered.collect::<Result<Vec<_>, _>>()?;
            for (patch, numbered) in patches.iter().zip(&numbered) {
                output.add(
                    context,
                    patch,
                    numbered,
                    projection_error(context, patch, exact),
                )?;
            }
        }
        Ok(())
    }

    /// Adds the faces of OpenVDB's mesher. Whether a vertex may move depends on the faces around it. So
    /// projection and decimation work block by block with a halo, and nothing depends on the bricks.
    fn add_quads(
        &mut self,
        context: StageContext,
        stored: &StoredSolid,
        solid: &LevelSet,
        region: Region,
        far: f64,
    ) -> Result<(), RunError> {
        let last = region.max[0];
        for output in &mut self.outputs {
            let FaceSource::OpenVdb {
                adaptivity,
                projection,
                decimation,
                ..
            } = &output.face_source
            else {
                continue;
            };
            // Without projection and decimation a quad depends on few voxels, and the part of the whole brick has them.
            let projection_halo = match (projection, decimation) {
                (None, None) => {
                    output.add_quad_region(context, solid, None, region, far, last)?;
                    continue;
                }
                (Some(_), _) => UNTANGLING_HALO,
                (None, Some(_)) => 0,
            };
            // Merged quads need a wider halo than single ones; projected vertices need single quads around them.
            let halo =
                LevelSet::quad_halo(*adaptivity).max(LevelSet::quad_halo(0.0) + projection_halo);
            let blocks: Vec<Coord> = stored.store.blocks_in(region).collect();
            // Descending, as the welder of the seams expects.
            for block in blocks.into_iter().rev() {
                let block_region = Region::cube(block, BLOCK);
                let part = part(
                    context,
                    &stored.store,
                    block_region.grown(halo),
                    Coord([0; 3]),
                )?;
                let exact = self.exact.as_ref().filter(|_| output.is_exact);
                output.add_quad_region(context, &part, exact, block_region, far, last)?;
            }
        }
        Ok(())
    }

    /// Completes all files and writes the beams. Returns their facts by path. Until then none of the files exists
    /// under its name.
    pub fn commit(self) -> Result<BTreeMap<PathBuf, MeshFacts>, RunError> {
        let mut done = BTreeMap::new();
        for output in self.outputs {
            output.file.commit()?;
            done.insert(output.path, output.facts);
        }
        for output in self.beams {
            write_beams(&output.path, &output.lattice, output.factor, output.unit)?;
            let facts = MeshFacts {
                faces: output.lattice.beams.len() as u64,
                ..MeshFacts::default()
            };
            done.insert(output.path, facts);
        }
        Ok(done)
    }
}
