//! Mesh files of a solid in bricks: written while patches pass, each as its output wants it.

use super::super::Targets;
use super::super::attributes::Attributes;
use super::super::beams::beams as beams_of;
use super::super::error::RunError;
use super::super::meshing::farthest;
use super::super::operate::Bench;
use super::super::report::MeshFacts;
use super::super::shape::{Shape, shape};
use super::Yard;
use super::solid::Bricks;
use crate::field::WorldField;
use crate::frame::LengthUnit;
use crate::io::{BeamLattice, MeshPart, MeshStream, write_beams};
use crate::mesh::TriMesh;
use crate::mesher::{Patch, Welder};
use crate::recipe::OutputKind;
use crate::vdb::VdbError;
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
    /// Of the triangles of the level set, and of the exact field.
    welders: [Welder; 2],
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

    /// The field onto which vertices are moved, if any are.
    pub fn exact(&self) -> Option<&WorldField<'a>> {
        self.exact.as_ref().map(|shape| &*shape.field)
    }

    /// Adds a patch to the files whose vertices are as it has them: of the level set, or exact.
    pub fn add(&mut self, bench: Bench, patch: &Patch, is_exact: bool) -> Result<(), RunError> {
        if !self.outs.iter().any(|out| out.is_exact == is_exact) {
            return Ok(());
        }
        let welder = &mut self.welders[usize::from(is_exact)];
        let unmade = |e| RunError::level_set("mesh")(VdbError::from(e));
        let numbered = welder.weld(patch).map_err(unmade)?;
        let own = &patch.vertices[..patch.owned];
        let error = match &self.exact {
            Some(exact) if is_exact => {
                let measure = || farthest(own, &*exact.field);
                bench.threads.install(measure)
            }
            _ => 0.0,
        };
        for out in self.outs.iter_mut().filter(|out| out.is_exact == is_exact) {
            out.file.add(MeshPart {
                vertices: &patch.vertices,
                owned: patch.owned,
                triangles: &patch.triangles,
                numbered: &numbered,
                numbers: &out.attributes.rows(bench, own),
                factor: out.factor,
            })?;
            out.facts.faces += patch.triangles.len() as u64;
            out.facts.error = out.facts.error.map(|e| e.max(error));
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
