//! Mesh files of a solid in bricks: written while patches pass, each as its output wants it.

use super::super::Targets;
use super::super::attributes::Attributes;
use super::super::beams::beams as beams_of;
use super::super::decimate::{Wish, decimated_patch};
use super::super::error::RunError;
use super::super::meshing::farthest;
use super::super::operate::Bench;
use super::super::report::MeshFacts;
use super::super::shape::{Shape, shape};
use super::Yard;
use super::solid::Bricks;
use crate::band::Region;
use crate::field::WorldField;
use crate::frame::LengthUnit;
use crate::io::{BeamLattice, MeshPart, MeshStream, write_beams};
use crate::mesh::TriMesh;
use crate::mesher::{Patch, Welder};
use crate::recipe::OutputKind;
use crate::vdb::{LevelSet, VdbError};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A mesh that is written while patches pass.
struct MeshOut<'a> {
    path: PathBuf,
    file: MeshStream,
    /// To its unit.
    factor: f64,
    /// Whether its vertices are where the exact field vanishes.
    is_exact: bool,
    /// With fewer triangles it numbers its vertices for itself.
    fewer: Option<(Wish, Welder)>,
    attributes: Attributes<'a>,
    facts: MeshFacts,
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

fn weld(welder: &mut Welder, patch: &Patch) -> Result<Vec<[u32; 3]>, RunError> {
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
    /// Adds a patch whose triangles are also known in numbers of the whole, and how far its own vertices are
    /// off the exact field.
    fn add(
        &mut self,
        bench: Bench,
        patch: &Patch,
        (numbered, error): (&[[u32; 3]], f64),
    ) -> Result<(), RunError> {
        let own = &patch.vertices[..patch.owned];
        self.file.add(MeshPart {
            vertices: &patch.vertices,
            owned: patch.owned,
            triangles: &patch.triangles,
            numbered,
            numbers: &self.attributes.rows(bench, own),
            factor: self.factor,
        })?;
        self.facts.faces += patch.triangles.len() as u64;
        self.facts.error = self.facts.error.map(|e| e.max(error));
        Ok(())
    }
}

impl<'a> Meshes<'a> {
    /// Begins all files.
    pub fn create(yard: &Yard<'a>, bricks: &Bricks, targets: &Targets) -> Result<Self, RunError> {
        let recipe = yard.stock.recipe;
        let bench = bricks.bench(yard, yard.progress);
        let (mut outs, mut beams) = (Vec::new(), Vec::new());
        let nothing = TriMesh::default();
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
            let attributes = Attributes::new(bench, yard.stock, words, &nothing, factor)?;
            let moved = output.project.then_some(0);
            outs.push(MeshOut {
                path: path.clone(),
                file: MeshStream::create(path, unit, attributes.names())?,
                factor,
                is_exact: output.project,
                fewer: output
                    .decimate
                    .as_ref()
                    .map(|wish| (Wish::new(wish, bench.scale), Welder::default())),
                attributes,
                facts: MeshFacts {
                    creased: moved,
                    kept: moved,
                    error: output.project.then_some(0.0),
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
        let takes = |out: &MeshOut| out.is_exact && out.fewer.is_none();
        let exact = self.exact.as_ref().filter(|_| self.outs.iter().any(takes));
        exact.map(|shape| &*shape.field)
    }

    /// Adds a patch to the files whose vertices are as it has them, of the level set or exact, and that take
    /// all triangles.
    pub fn add(&mut self, bench: Bench, patch: &Patch, is_exact: bool) -> Result<(), RunError> {
        let takes = |out: &&mut MeshOut| out.is_exact == is_exact && out.fewer.is_none();
        let mut outs = self.outs.iter_mut().filter(takes).peekable();
        if outs.peek().is_none() {
            return Ok(());
        }
        let numbered = weld(&mut self.welders[usize::from(is_exact)], patch)?;
        let exact = self.exact.as_ref().filter(|_| is_exact);
        let error = error(bench, patch, exact);
        outs.try_for_each(|out| out.add(bench, patch, (&numbered, error)))
    }

    /// Adds a region of a solid to the files that take fewer triangles: block by block, so that nothing
    /// depends on the bricks. Blocks keep what they share.
    pub fn add_fewer(
        &mut self,
        bench: Bench,
        solid: &LevelSet,
        (region, far): (Region, f64),
    ) -> Result<(), RunError> {
        for out in &mut self.outs {
            let Some((wish, welder)) = &mut out.fewer else {
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
