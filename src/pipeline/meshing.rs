//! Meshes of the finished solid, made as an output wants them and written.

use super::attributes::Attributes;
use super::decimate::{Wish, decimated};
use super::error::RunError;
use super::field_ops::shape;
use super::level_set_ops::Bench;
use super::output::Finished;
use super::precision::needs_double;
use super::report::MeshFacts;
use crate::field::WorldField;
use crate::frame::{LengthUnit, Vec3, WorldPoint};
use crate::io::{MeshView, write_beams, write_mesh};
use crate::mesh::{Projection, QuadMesh, TriMesh};
use crate::mesher::clear_of_voxels;
use crate::recipe::Output;
use rayon::prelude::*;
use std::borrow::Cow;
use std::path::Path;

/// A surface as it is written.
enum Surface<'a> {
    Triangles(Cow<'a, TriMesh>),
    Quads(QuadMesh),
}

impl Surface<'_> {
    fn view(&self) -> MeshView<'_> {
        match self {
            Self::Triangles(mesh) => mesh.as_ref().into(),
            Self::Quads(mesh) => mesh.into(),
        }
    }
}

/// Writes the mesh of a solid; `plain` is its mesh without any wish.
pub(super) fn write(
    bench: Bench,
    done: Finished,
    output: &Output,
    (path, unit): (&Path, LengthUnit),
) -> Result<Option<MeshFacts>, RunError> {
    let Some(plain) = done.mesh else {
        return Ok(None);
    };
    let mut facts = MeshFacts::default();
    if output.beams {
        let lattice = super::beams::beams(done.stock)?;
        facts.faces = lattice.beams.len() as u64;
        write_beams(path, &lattice, bench.scale.unit.to(unit), unit)?;
        return Ok(Some(facts));
    }
    let adaptivity = output.merging();
    let of_quads = output.is_meshed_by_openvdb();
    let exact = (output.project || output.sharp)
        .then(|| shape(done.stock, bench.scale))
        .transpose()?;
    let failed = RunError::level_set("mesh");
    let mut surface = if of_quads {
        let mut mesh = done
            .solid
            .to_quads(adaptivity, bench.session())
            .map_err(failed)?;
        if let Some(exact) = exact {
            let how = Projection {
                voxel_size: bench.scale.voxel_size,
                sharp: output.sharp,
            };
            let found = bench
                .threads
                .install(|| mesh.project(&*exact.field, how, bench.progress))?;
            facts.creased = Some(found.creased as u64);
            facts.kept = Some(found.kept as u64);
            facts.error = Some(found.error);
        }
        if output.quads {
            Surface::Quads(mesh)
        } else {
            Surface::Triangles(Cow::Owned(mesh.into_triangles()))
        }
    } else if let Some(exact) = exact {
        let mesh = done
            .solid
            .to_mesh_on(&*exact.field, bench.session())
            .map_err(failed)?;
        facts.creased = Some(0);
        facts.kept = Some(0);
        facts.error = Some(
            bench
                .threads
                .install(|| farthest(mesh.vertices(), &*exact.field)),
        );
        Surface::Triangles(Cow::Owned(mesh))
    } else {
        Surface::Triangles(Cow::Borrowed(plain))
    };
    if let (Some(wish), Surface::Triangles(mesh)) = (&output.decimate, &surface) {
        bench.progress.stage("decimate", None);
        let fewer = decimated(mesh, Wish::new(wish, bench.scale))?;
        surface = Surface::Triangles(Cow::Owned(fewer));
    }
    let factor = bench.scale.unit.to(unit);
    let wished = output.grids.as_deref().unwrap_or_default();
    let attributes = Attributes::new(bench, done.stock, wished, done.thickness, factor)?;
    let numbers = attributes.at_vertices(bench, surface.view().vertices);
    let far = done.solid.far().map_err(RunError::level_set("mesh"))?;
    let centre = plain.bounds().centre().0.into();
    let is_double = needs_double(path, (far, centre), (bench.scale, factor))?;
    if let Surface::Triangles(mesh) = &surface
        && output.decimate.is_none()
        && !of_quads
        && !is_double
        && !is_obj(path)
    {
        let (mut vertices, faces) = (mesh.vertices().to_vec(), mesh.triangles());
        let (h, origin) = (bench.scale.voxel_size, done.solid.origin());
        let install = || clear_of_voxels(&mut vertices, h, origin, far);
        if bench.threads.install(install) {
            surface = Surface::Triangles(Cow::Owned(TriMesh::known(vertices, faces.to_vec())));
        }
    }
    let view = surface.view().scaled(factor).with_attributes(&numbers);
    let view = view.in_double(is_double);
    facts.faces = view.faces.len() as u64;
    bench.progress.stage("write", None);
    write_mesh(path, view, unit)?;
    Ok(Some(facts))
}

/// Whether a file holds double precision always.
pub(super) fn is_obj(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("obj"))
}

/// Greatest magnitude of a field at vertices.
pub(super) fn farthest(vertices: &[Vec3], field: &WorldField) -> f64 {
    let vertices = vertices.par_iter().with_min_len(256);
    vertices
        .map(|&v| field.value(WorldPoint(v)).abs())
        .reduce(|| 0.0, f64::max)
}
