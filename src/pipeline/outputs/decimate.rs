//! Decimation of triangle meshes by the collapse of edges. Vertices keep their positions, so that a decimated mesh
//! has no vertex off the surface; the topology stays except in `triangles_to_count`, which serves pictures.

use crate::frame::Vec3;
use crate::mesh::{CollapseGoal, TriMesh, collapsed};
use crate::mesher::Patch;
use crate::pipeline::base::error::RunError;
use crate::recipe::{Decimate, Scale};
use meshopt::{SimplifyOptions, VertexDataAdapter, simplify, typed_to_bytes};

/// The target of a decimation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Decimation {
    /// Share of the triangles that remains.
    share: f64,
    /// Greatest displacement of the surface, in the mesh's unit; it limits the decimation.
    error: Option<f64>,
}

impl Decimation {
    /// The target of an output's key `decimate`.
    pub fn new(section: &Decimate, scale: Scale) -> Self {
        Self {
            share: section.share.0,
            error: section.error.map(|e| e.resolve(scale)),
        }
    }

    /// Decimated triangles over the same vertices, by their numbers. No vertex moves, and the border stays.
    fn simplified(self, vertices: &[Vec3], triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
        let goal = CollapseGoal {
            triangles: (triangles.len() as f64 * self.share).ceil() as usize,
            error: self.error,
        };
        collapsed(vertices, triangles, goal)
    }
}

/// A mesh with about the target share of its triangles. Vertices keep their positions; unused vertices
/// are removed.
pub(crate) fn decimated(mesh: &TriMesh, decimation: Decimation) -> Result<TriMesh, RunError> {
    let kept = decimation.simplified(mesh.vertices(), mesh.triangles());
    let mut number = vec![u32::MAX; mesh.vertices().len()];
    let mut vertices = Vec::new();
    let mut numbered = |v: u32| {
        let entry = &mut number[v as usize];
        if *entry == u32::MAX {
            *entry = vertices.len() as u32;
            vertices.push(mesh.vertices()[v as usize]);
        }
        *entry
    };
    let triangles = kept.into_iter().map(|t| t.map(&mut numbered)).collect();
    TriMesh::new(vertices, triangles).map_err(|e| RunError::Decimate(e.to_string()))
}

/// About `count` triangles over the same vertices, for pictures of any mesh, by meshoptimizer: open and
/// non-manifold meshes have fewer, too, and the topology may change.
pub(crate) fn triangles_to_count(mesh: &TriMesh, count: usize) -> Result<Vec<[u32; 3]>, RunError> {
    if mesh.is_empty() {
        return Ok(Vec::new());
    }
    // Coordinates relative to the centre of the box, so that single precision suffices.
    let centre = mesh.vertex_bounds().centre().0;
    let position = |v: &Vec3| (v - centre).map(|c| c as f32).into();
    let positions: Vec<[f32; 3]> = mesh.vertices().iter().map(position).collect();
    // meshoptimizer reads three floats per vertex: a stride of 12 bytes from offset 0. The error 1.0, relative to
    // the box, sets no limit.
    let data = VertexDataAdapter::new(typed_to_bytes(&positions), 12, 0);
    let data = data.map_err(|e| RunError::Decimate(e.to_string()))?;
    let indices = mesh.triangles().as_flattened();
    let kept = simplify(indices, &data, 3 * count, 1.0, SimplifyOptions::None, None);
    Ok(kept.as_chunks().0.to_vec())
}

/// Decimates a patch of a mesh and keeps its border, so that patches still fit. `last` is the greatest x
/// of the regions of the same brick.
pub(crate) fn decimated_patch(patch: &Patch, decimation: Decimation, last: i32) -> Patch {
    let kept = decimation.simplified(&patch.vertices, &patch.faces);
    patch.with_triangles(&kept, last)
}
