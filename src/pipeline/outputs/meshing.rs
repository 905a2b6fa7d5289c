//! Meshes of the finished solid in memory, as an output requests them: by OpenVDB's mesher, by the zeros of the exact
//! field, or as the level set has them; decimated and with values at vertices on request. Faces that are not decimated
//! are those of a run in bricks.

use super::attributes::Attributes;
use super::decimate::{Decimation, decimated};
use super::output::FinishedSolid;
use super::precision::needs_double;
use crate::field::WorldField;
use crate::frame::{LengthUnit, Vec3, WorldPoint};
use crate::io::{MeshView, write_beams, write_mesh};
use crate::mesh::{ProjectionOptions, QuadMesh, TriMesh};
use crate::mesher::move_off_voxels;
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::MeshFacts;
use crate::pipeline::field::field_ops::shape;
use crate::recipe::Output;
use rayon::prelude::*;
use std::borrow::Cow;
use std::path::Path;

/// The faces of a mesh output.
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

/// Writes the mesh of a solid to `path` in `unit`, as an output requests it, and returns its facts. `None`, and no
/// file, without a mesh in `done`, which callers make for every mesh output.
pub(crate) fn write(
    context: StageContext,
    done: FinishedSolid,
    output: &Output,
    path: &Path,
    unit: LengthUnit,
) -> Result<Option<MeshFacts>, RunError> {
    let Some(base_mesh) = done.mesh else {
        return Ok(None);
    };
    let mut facts = MeshFacts::default();
    if output.beams {
        let lattice = super::beams::beams(done.inputs)?;
        facts.faces = lattice.beams.len() as u64;
        write_beams(path, &lattice, context.scale.unit.to(unit), unit)?;
        return Ok(Some(facts));
    }
    let adaptivity = output.merging();
    let by_openvdb = output.is_meshed_by_openvdb();
    let exact = (output.project || output.sharp)
        .then(|| shape(done.inputs, context.scale))
        .transpose()?;
    let failed = RunError::level_set("mesh");
    // Three sources of faces: OpenVDB's mesher, the zeros of the exact field along edges of voxels, and
    // the mesh of the level set that is there already.
    let mut surface = if by_openvdb {
        let mut mesh = done
            .solid
            .to_quads(adaptivity, context.session())
            .map_err(failed)?;
        if let Some(exact) = exact {
            let projection = ProjectionOptions {
                voxel_size: context.scale.voxel_size,
                sharp: output.sharp,
            };
            let found = context
                .threads
                .install(|| mesh.project(&*exact.field, projection, context.progress))?;
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
            .to_exact_mesh(&*exact.field, context.session())
            .map_err(failed)?;
        // Vertices on the exact field are not projected: none is moved or kept.
        facts.creased = Some(0);
        facts.kept = Some(0);
        facts.error = Some(
            context
                .threads
                .install(|| max_magnitude(mesh.vertices(), &*exact.field)),
        );
        Surface::Triangles(Cow::Owned(mesh))
    } else {
        Surface::Triangles(Cow::Borrowed(base_mesh))
    };
    // Decimation comes after the projection, so that it removes what the surface does not need.
    if let (Some(section), Surface::Triangles(mesh)) = (&output.decimate, &surface) {
        context.progress.stage("decimate", None);
        let decimation = Decimation::new(section, context.scale);
        let decimated_mesh = context.threads.install(|| decimated(mesh, decimation))?;
        surface = Surface::Triangles(Cow::Owned(decimated_mesh));
    }
    let factor = context.scale.unit.to(unit);
    let words = output.grids.as_deref().unwrap_or_default();
    let attributes = Attributes::new(context, done.inputs, words, done.thickness, factor)?;
    let values = attributes.at_vertices(context, surface.view().vertices);
    // Far from the origin, single precision cannot hold the vertices apart.
    let far = done
        .solid
        .max_coordinate()
        .map_err(RunError::level_set("mesh"))?;
    let centre = base_mesh.vertex_bounds().centre().0.into();
    let is_double = needs_double(path, far, centre, context.scale, factor)?;
    if let Surface::Triangles(mesh) = &surface
        && output.decimate.is_none()
        && !by_openvdb
        && !is_double
        && !is_obj(path)
    {
        // Only vertices that still lie on edges of voxels can be moved along them.
        let (mut vertices, faces) = (mesh.vertices().to_vec(), mesh.triangles());
        let (h, origin) = (context.scale.voxel_size, done.solid.origin());
        let clear = || move_off_voxels(&mut vertices, h, origin, far);
        if context.threads.install(clear) {
            surface =
                Surface::Triangles(Cow::Owned(TriMesh::new_unchecked(vertices, faces.to_vec())));
        }
    }
    let view = surface.view().scaled(factor).with_attributes(&values);
    let view = view.in_double(is_double);
    facts.faces = view.faces.len() as u64;
    context.progress.stage("write", None);
    write_mesh(path, view, unit)?;
    Ok(Some(facts))
}

/// Whether a file is an OBJ, which always holds double precision.
pub(crate) fn is_obj(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("obj"))
}

/// Greatest magnitude of a field at vertices, both in world units; 0 without vertices.
pub(crate) fn max_magnitude(vertices: &[Vec3], field: &WorldField) -> f64 {
    let vertices = vertices.par_iter().with_min_len(256);
    vertices
        .map(|&v| field.value(WorldPoint(v)).abs())
        .reduce(|| 0.0, f64::max)
}
