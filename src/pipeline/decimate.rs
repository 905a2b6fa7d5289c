//! Decimation of triangle meshes by meshoptimizer.
//!
//! Edges collapse in the order of their quadric error (Garland and Heckbert, *Surface Simplification
//! Using Quadric Error Metrics*, 1997).

use super::error::RunError;
use crate::frame::{Aabb, Vec3};
use crate::mesh::TriMesh;
use crate::mesher::Patch;
use crate::recipe::{Decimate, Scale};
use meshopt::{SimplifyOptions, VertexDataAdapter, simplify, simplify_scale, typed_to_bytes};

/// The target of a decimation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Decimation {
    /// Share of the triangles that remains.
    share: f64,
    /// Greatest displacement of the surface, in the mesh's unit; it limits the decimation.
    error: Option<f64>,
}

impl Decimation {
    pub fn new(section: &Decimate, scale: Scale) -> Self {
        Self {
            share: section.share.0,
            error: section.error.map(|e| e.resolve(scale)),
        }
    }

    /// Decimated triangles over the same vertices. No vertex moves.
    fn simplified(
        self,
        vertices: &[Vec3],
        triangles: &[[u32; 3]],
        options: SimplifyOptions,
    ) -> Result<Vec<[u32; 3]>, RunError> {
        if triangles.is_empty() {
            return Ok(Vec::new());
        }
        // Coordinates relative to the centre of the box, so that single precision suffices.
        let centre = Aabb::of(vertices.iter().copied()).centre().0;
        let position = |v: &Vec3| (v - centre).map(|c| c as f32).into();
        let positions: Vec<[f32; 3]> = vertices.iter().map(position).collect();
        let data = VertexDataAdapter::new(typed_to_bytes(&positions), 12, 0);
        let data = data.map_err(|e| RunError::Decimate(e.to_string()))?;
        let target_indices = (triangles.len() as f64 * self.share).ceil() as usize * 3;
        let relative = self
            .error
            .map_or(1.0, |e| e / f64::from(simplify_scale(&data)));
        let indices = triangles.as_flattened();
        let kept = simplify(
            indices,
            &data,
            target_indices,
            relative as f32,
            options,
            None,
        );
        Ok(kept.as_chunks().0.to_vec())
    }
}

/// A mesh with about the target share of its triangles. Vertices keep their positions; unused vertices
/// are removed.
pub(super) fn decimated(mesh: &TriMesh, decimation: Decimation) -> Result<TriMesh, RunError> {
    let kept = decimation.simplified(mesh.vertices(), mesh.triangles(), SimplifyOptions::None)?;
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

/// About `count` triangles over the same vertices.
pub(super) fn triangles_to_count(mesh: &TriMesh, count: usize) -> Result<Vec<[u32; 3]>, RunError> {
    let decimation = Decimation {
        share: count as f64 / mesh.triangles().len().max(1) as f64,
        error: None,
    };
    decimation.simplified(mesh.vertices(), mesh.triangles(), SimplifyOptions::None)
}

/// Decimates a patch of a mesh and keeps its border, so that patches still fit. `last` is the greatest x
/// of the regions of the same brick.
pub(super) fn decimated_patch(
    patch: &Patch,
    decimation: Decimation,
    last: i32,
) -> Result<Patch, RunError> {
    let options = SimplifyOptions::LockBorder;
    let kept = decimation.simplified(&patch.vertices, &patch.faces, options)?;
    Ok(patch.with_triangles(&kept, last))
}
