//! Mesh files of a solid in bricks: written while patches pass, each as its output wants it.

use super::super::Targets;
use super::super::attributes::Attributes;
use super::super::beams::beams as beams_of;
use super::super::decimate::{Wish, decimated_patch};
use super::super::error::RunError;
use super::super::field_ops::{Shape, shape};
use super::super::level_set_ops::Bench;
use super::super::meshing::{farthest, is_obj};
use super::super::precision::needs_double;
use super::super::report::MeshFacts;
use super::super::thickness::Thickness;
use super::Yard;
use super::assemble::part;
use super::solid::StoredSolid;
use crate::band::{BLOCK, LEAF, Region};
use crate::field::WorldField;
use crate::frame::{Coord, LengthUnit, Vec3};
use crate::io::{BeamLattice, Faces, MeshPart, MeshStream, write_beams};
use crate::mesh::{Projected, Projection};
use crate::mesher::{Patch, Welder, clear_of_voxels};
use crate::recipe::{Output, OutputKind, Scale};
use crate::vdb::{LevelSet, VdbError};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Voxels around a block whose vertices may keep those of the block from moving.
pub(super) const UNTANGLED: i32 = 24;

/// A mesh that is written while patches pass.
struct MeshOut<'a> {
    path: PathBuf,
    file: MeshStream,
    /// To its unit.
    factor: f64,
    /// How far coordinates reach, world units, if vertices must be kept apart in single precision.
    clears: Option<f64>,
    /// Whether its vertices are where the exact field vanishes.
    is_exact: bool,
    way: Way,
    attributes: Attributes<'a>,
    facts: MeshFacts,
}

/// What faces a mesh takes. Other than all triangles it numbers them for itself.
enum Way {
    /// All triangles.
    All,
    /// Fewer of them.
    Fewer(Wish, Welder),
    /// OpenVDB's quads, as they are or cut.
    OpenVdb {
        adaptivity: f64,
        /// Onto the field, and onto its creases.
        moves: Option<Projection>,
        is_cut: bool,
        /// Of the triangles.
        fewer: Option<Wish>,
        welder: Welder,
    },
}

/// Beams that are written with the meshes.
struct BeamsOut {
    path: PathBuf,
    lattice: BeamLattice,
    unit: LengthUnit,
    factor: f64,
}

/// All mesh files of a run.
pub(super) struct Meshes<'a> {
    outs: Vec<MeshOut<'a>>,
    beams: Vec<BeamsOut>,
    /// The field that the solid is a sample of, where any vertices are moved onto it.
    exact: Option<Shape<'a>>,
    /// Of all triangles of the level set, and of the exact field.
    welders: [Welder; 2],
}

fn weld<const N: usize>(welder: &mut Welder, patch: &Patch<N>) -> Result<Vec<[u32; N]>, RunError> {
    let unmade = |e| RunError::level_set("mesh")(VdbError::from(e));
    welder.weld(patch).map_err(unmade)
}

/// How far a patch's own vertices are off the exact field, if they were moved onto one.
fn error(bench: Bench, patch: &Patch, exact: Option<&Shape>) -> f64 {
    let own = &patch.vertices[..patch.owned];
    let measure = |exact: &Shape| bench.threads.install(|| farthest(own, &*exact.field));
    exact.map_or(0.0, measure)
}

impl MeshOut<'_> {
    /// Adds a patch whose faces are also known in numbers of the whole, and how far its own vertices are
    /// off the exact field.
    fn add<const N: usize>(
        &mut self,
        bench: Bench,
        patch: &Patch<N>,
        (numbered, error): (&[[u32; N]], f64),
    ) -> Result<(), RunError>
    where
        for<'f> Faces<'f>: From<&'f [[u32; N]]>,
    {
        let own = &patch.vertices[..patch.owned];
        let mut cleared = Vec::new();
        if let Some(far) = self.clears.filter(|_| self.way.takes_all()) {
            cleared.clone_from(&patch.vertices);
            let (h, origin) = (bench.scale.voxel_size, Vec3::zeros());
            let clear = || clear_of_voxels(&mut cleared, h, origin, far);
            if !bench.threads.install(clear) {
                cleared.clear();
            }
        }
        self.file.add(MeshPart {
            vertices: if cleared.is_empty() {
                &patch.vertices
            } else {
                &cleared
            },
            owned: patch.owned,
            faces: patch.faces.as_slice().into(),
            numbered: numbered.into(),
            numbers: &self.attributes.rows(bench, own),
            factor: self.factor,
        })?;
        self.facts.faces += patch.faces.len() as u64;
        self.facts.error = self.facts.error.map(|e| e.max(error));
        Ok(())
    }

    /// Adds what OpenVDB's mesher makes in a region, moved onto a field if it has one; `last` is the
    /// greatest x of the regions that come with it.
    fn add_share(
        &mut self,
        bench: Bench,
        solid: &LevelSet,
        exact: Option<&Shape>,
        (region, far, last): (Region, f64, i32),
    ) -> Result<(), RunError> {
        let Way::OpenVdb {
            adaptivity,
            moves,
            is_cut,
            fewer,
            welder,
        } = &mut self.way
        else {
            return Ok(());
        };
        let failed = RunError::level_set("mesh");
        let mesh = solid.part_to_quads(*adaptivity, far, bench.session());
        let mut mesh = mesh.map_err(&failed)?;
        let share = solid.share(&mesh, (region, last), *adaptivity);
        let mut error = 0.0;
        if let (Some(how), Some(exact)) = (*moves, exact) {
            let project = || mesh.project_each(&*exact.field, how, bench.progress);
            let fates = bench.threads.install(project)?;
            let found = Projected::of(share.owned().iter().map(|&v| fates[v as usize]));
            error = found.error;
            let add = |sum: Option<u64>, more: usize| sum.map(|n| n + more as u64);
            self.facts.creased = add(self.facts.creased, found.creased);
            self.facts.kept = add(self.facts.kept, found.kept);
        }
        let patch = share.patch(&mesh);
        if *is_cut {
            let mut patch = patch.into_triangles();
            if let Some(wish) = *fewer {
                patch = decimated_patch(&patch, wish, last)?;
            }
            let numbered = weld(welder, &patch)?;
            self.add(bench, &patch, (&numbered, error))
        } else {
            let numbered = weld(welder, &patch)?;
            self.add(bench, &patch, (&numbered, error))
        }
    }
}

impl Way {
    fn of(output: &Output, scale: Scale) -> Self {
        if output.is_meshed_by_openvdb() {
            return Self::OpenVdb {
                adaptivity: output.merging(),
                moves: output.moves_open_vdb().then_some(Projection {
                    voxel_size: scale.voxel_size,
                    sharp: output.sharp,
                }),
                is_cut: !output.quads,
                fewer: output.decimate.as_ref().map(|d| Wish::new(d, scale)),
                welder: Welder::default(),
            };
        }
        match &output.decimate {
            Some(wish) => Self::Fewer(Wish::new(wish, scale), Welder::default()),
            None => Self::All,
        }
    }

    fn takes_all(&self) -> bool {
        matches!(self, Self::All)
    }
}

impl<'a> Meshes<'a> {
    /// Begins all files.
    pub fn create(
        yard: &Yard<'a>,
        solid: &StoredSolid,
        targets: &Targets,
        thickness: Option<&'a Thickness>,
    ) -> Result<Self, RunError> {
        let recipe = yard.stock.recipe;
        let bench = solid.bricks.bench(yard, yard.progress);
        let (far, centre) = (solid.far(), solid.centre());
        let (mut outs, mut beams) = (Vec::new(), Vec::new());
        for (output, path) in targets.of(OutputKind::Mesh) {
            let unit = output.unit_or_default(recipe.unit());
            let factor = recipe.unit().to(unit);
            if output.beams {
                beams.push(BeamsOut {
                    path: path.clone(),
                    lattice: beams_of(yard.stock)?,
                    unit,
                    factor,
                });
                continue;
            }
            let words = output.grids.as_deref().unwrap_or_default();
            let attributes = Attributes::new(bench, yard.stock, words, thickness, factor)?;
            let is_exact = output.project || output.sharp;
            let is_double = needs_double(path, (far, centre), (bench.scale, factor))?;
            let moved = is_exact.then_some(0);
            outs.push(MeshOut {
                path: path.clone(),
                file: MeshStream::create(path, unit, output.quads, attributes.names())?
                    .in_double(is_double),
                factor,
                clears: (!is_double && !is_obj(path)).then_some(far),
                is_exact,
                way: Way::of(output, bench.scale),
                attributes,
                facts: MeshFacts {
                    creased: moved,
                    kept: moved,
                    error: is_exact.then_some(0.0),
                    ..MeshFacts::default()
                },
            });
        }
        let wants_exact = outs.iter().any(|out| out.is_exact);
        let exact = wants_exact.then(|| shape(yard.stock, bench.scale));
        Ok(Self {
            outs,
            beams,
            exact: exact.transpose()?,
            welders: Default::default(),
        })
    }

    /// The field onto which vertices are moved, if those of all triangles are.
    pub fn exact(&self) -> Option<&WorldField<'a>> {
        let takes = |out: &MeshOut| out.is_exact && out.way.takes_all();
        let exact = self.exact.as_ref().filter(|_| self.outs.iter().any(takes));
        exact.map(|shape| &*shape.field)
    }

    /// Adds a patch to the files whose vertices are as it has them, of the level set or exact, and that take
    /// all triangles.
    pub fn add(&mut self, bench: Bench, patch: &Patch, is_exact: bool) -> Result<(), RunError> {
        let takes = |out: &&mut MeshOut| out.is_exact == is_exact && out.way.takes_all();
        let mut outs = self.outs.iter_mut().filter(takes).peekable();
        if outs.peek().is_none() {
            return Ok(());
        }
        let numbered = weld(&mut self.welders[usize::from(is_exact)], patch)?;
        let exact = self.exact.as_ref().filter(|_| is_exact);
        let error = error(bench, patch, exact);
        outs.try_for_each(|out| out.add(bench, patch, (&numbered, error)))
    }

    /// Voxels around a region on which its faces depend.
    pub fn halo(&self) -> i32 {
        let halos = self.outs.iter().map(|out| match out.way {
            Way::All | Way::Fewer(..) => LEAF,
            Way::OpenVdb { adaptivity, .. } => LevelSet::quad_halo(adaptivity),
        });
        halos.fold(LEAF, i32::max)
    }

    /// Adds a region of a solid to the files that take other faces than all triangles.
    pub fn add_others(
        &mut self,
        bench: Bench,
        (stored, solid): (&StoredSolid, &LevelSet),
        place: (Region, f64),
    ) -> Result<(), RunError> {
        self.add_fewer(bench, solid, place)?;
        self.add_quads(bench, (stored, solid), place)
    }

    /// Fewer triangles: block by block, so that nothing depends on the bricks. Blocks keep what they share.
    fn add_fewer(
        &mut self,
        bench: Bench,
        solid: &LevelSet,
        (region, far): (Region, f64),
    ) -> Result<(), RunError> {
        for out in &mut self.outs {
            let Way::Fewer(wish, welder) = &mut out.way else {
                continue;
            };
            let wish = *wish;
            let exact = self.exact.as_ref().filter(|_| out.is_exact);
            let field = exact.map(|shape| &*shape.field);
            let patches = solid.block_patches(region, far, field, bench.session(), |patch| {
                decimated_patch(&patch, wish, region.max[0])
            })?;
            let numbered = patches.iter().map(|patch| weld(welder, patch));
            let numbered = numbered.collect::<Result<Vec<_>, _>>()?;
            for (patch, numbered) in patches.iter().zip(&numbered) {
                out.add(bench, patch, (numbered, error(bench, patch, exact)))?;
            }
        }
        Ok(())
    }

    /// The faces of OpenVDB's mesher. Which vertices may not move is known from faces around, and theirs:
    /// where they move, or triangles become fewer, that is decided block by block, so that nothing depends on
    /// the bricks.
    fn add_quads(
        &mut self,
        bench: Bench,
        (stored, solid): (&StoredSolid, &LevelSet),
        (region, far): (Region, f64),
    ) -> Result<(), RunError> {
        let last = region.max[0];
        for out in &mut self.outs {
            let Way::OpenVdb {
                adaptivity,
                moves,
                fewer,
                ..
            } = &out.way
            else {
                continue;
            };
            let untangled = match (moves, fewer) {
                (None, None) => {
                    out.add_share(bench, solid, None, (region, far, last))?;
                    continue;
                }
                (Some(_), _) => UNTANGLED,
                (None, Some(_)) => 0,
            };
            let halo = LevelSet::quad_halo(*adaptivity).max(LevelSet::quad_halo(0.0) + untangled);
            let blocks: Vec<Coord> = stored.store.blocks_of(region).collect();
            for block in blocks.into_iter().rev() {
                let own = Region::cube(block, BLOCK);
                let part = part(bench, &stored.store, own.grown(halo), Coord([0; 3]))?;
                let exact = self.exact.as_ref().filter(|_| out.is_exact);
                out.add_share(bench, &part, exact, (own, far, last))?;
            }
        }
        Ok(())
    }

    /// Completes all files: what they are, by their paths.
    pub fn commit(self) -> Result<BTreeMap<PathBuf, MeshFacts>, RunError> {
        let mut done = BTreeMap::new();
        for out in self.outs {
            out.file.commit()?;
            done.insert(out.path, out.facts);
        }
        for out in self.beams {
            write_beams(&out.path, &out.lattice, out.factor, out.unit)?;
            let facts = MeshFacts {
                faces: out.lattice.beams.len() as u64,
                ..MeshFacts::default()
            };
            done.insert(out.path, facts);
        }
        Ok(done)
    }
}
