//! Meshes of fewer triangles, by meshoptimizer: edges collapse where the quadrics of the planes around
//! say that the surface moves least (Garland and Heckbert, *Surface Simplification Using Quadric Error
//! Metrics*, 1997).

use super::error::RunError;
use crate::frame::{Aabb, Vec3};
use crate::mesh::TriMesh;
use crate::mesher::Patch;
use crate::recipe::{Decimate, Scale};
use meshopt::{SimplifyOptions, VertexDataAdapter, simplify, simplify_scale, typed_to_bytes};

/// How few triangles are wanted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wish {
    /// Of the triangles, how many are left.
    share: f64,
    /// Most that the surface may move, in the mesh's unit: more triangles are left where it would.
    error: Option<f64>,
}

impl Wish {
    pub fn new(wish: &Decimate, scale: Scale) -> Self {
        Self {
            share: wish.share.0,
            error: wish.error.map(|e| e.resolve(scale)),
        }
    }

    /// Fewer triangles over the same vertices, none of which moves.
    fn simplified(
        self,
        vertices: &[Vec3],
        triangles: &[[u32; 3]],
        options: SimplifyOptions,
    ) -> Result<Vec<[u32; 3]>, RunError> {
        if triangles.is_empty() {
            return Ok(Vec::new());
        }
        // From the middle of the box, so that single precision suffices.
        let centre = Aabb::of(vertices.iter().copied()).centre().0;
        let place = |v: &Vec3| (v - centre).map(|c| c as f32).into();
        let places: Vec<[f32; 3]> = vertices.iter().map(place).collect();
        let data = VertexDataAdapter::new(typed_to_bytes(&places), 12, 0);
        let data = data.map_err(|e| RunError::Decimate(e.to_string()))?;
        let wanted = (triangles.len() as f64 * self.share).ceil() as usize * 3;
        let relative = self
            .error
            .map_or(1.0, |e| e / f64::from(simplify_scale(&data)));
        let indices = triangles.as_flattened();
        let fewer = simplify(indices, &data, wanted, relative as f32, options, None);
        Ok(fewer.as_chunks().0.to_vec())
    }
}

/// A mesh with about as many of the triangles as wished. Vertices stay where they are; those no longer used
/// are left out.
pub(super) fn decimated(mesh: &TriMesh, wish: Wish) -> Result<TriMesh, RunError> {
    let few = wish.simplified(mesh.vertices(), mesh.triangles(), SimplifyOptions::None)?;
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
    let triangles = few.into_iter().map(|t| t.map(&mut numbered)).collect();
    TriMesh::new(vertices, triangles).map_err(|e| RunError::Decimate(e.to_string()))
}

/// The same of a part of a mesh, with all that it shares with others, so that they still fit together.
/// `last` is the greatest x of the parts that come with it.
pub(super) fn decimated_patch(patch: &Patch, wish: Wish, last: i32) -> Result<Patch, RunError> {
    let options = SimplifyOptions::LockBorder;
    let few = wish.simplified(&patch.vertices, &patch.faces, options)?;
    Ok(patch.with_triangles(&few, last))
}
