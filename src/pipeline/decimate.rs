//! Meshes of fewer triangles, by meshoptimizer: edges collapse where the quadrics of the planes around
//! say that the surface moves least (Garland and Heckbert, *Surface Simplification Using Quadric Error
//! Metrics*, 1997).

use super::error::RunError;
use crate::mesh::TriMesh;
use meshopt::{SimplifyOptions, VertexDataAdapter, simplify, simplify_scale, typed_to_bytes};

/// A mesh with about `share` of the triangles, more where the surface would move by more than `error`
/// (the mesh's unit). Vertices stay where they are; those no longer used are left out.
pub(super) fn decimated(
    mesh: &TriMesh,
    share: f64,
    error: Option<f64>,
) -> Result<TriMesh, RunError> {
    if mesh.is_empty() {
        return Ok(mesh.clone());
    }
    // From the middle of the box, so that single precision suffices.
    let centre = mesh.bounds().centre().0;
    let places: Vec<[f32; 3]> = mesh
        .vertices()
        .iter()
        .map(|v| (v - centre).map(|c| c as f32).into())
        .collect();
    let failed = |e: &dyn std::fmt::Display| RunError::Decimate(e.to_string());
    let data = VertexDataAdapter::new(typed_to_bytes(&places), 12, 0).map_err(|e| failed(&e))?;
    let wanted = (mesh.triangles().len() as f64 * share).ceil() as usize * 3;
    let relative = error.map_or(1.0, |e| e / f64::from(simplify_scale(&data)));
    let indices = simplify(
        mesh.triangles().as_flattened(),
        &data,
        wanted,
        relative as f32,
        SimplifyOptions::None,
        None,
    );
    let mut number = vec![u32::MAX; places.len()];
    let mut vertices = Vec::new();
    let mut triangles = Vec::with_capacity(indices.len() / 3);
    for corners in indices.chunks_exact(3) {
        let mut triangle = [0; 3];
        for (own, &v) in triangle.iter_mut().zip(corners) {
            let entry = &mut number[v as usize];
            if *entry == u32::MAX {
                *entry = vertices.len() as u32;
                vertices.push(mesh.vertices()[v as usize]);
            }
            *own = *entry;
        }
        triangles.push(triangle);
    }
    TriMesh::new(vertices, triangles).map_err(|e| failed(&e))
}
