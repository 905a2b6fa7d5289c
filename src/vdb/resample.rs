//! Resampling of grids whose voxels are not axis-aligned cubes.
//!
//! The surface is meshed in index space, where voxels are cubes, and the vertices are mapped to the world. Distances
//! are then measured from this mesh, so that they do not depend on the scale of the grid's values.

use super::builder::LevelSetBuilder;
use super::error::VdbError;
use super::file::GridInfo;
use super::index_map::IndexMap;
use super::{LevelSet, Session};
use crate::band::Band;
use crate::frame::{Transform, Vec3};
use crate::mesh::MeshSolid;

/// The solid on cubic voxels, from a level set in index space and its map to the world. `edge` is that of the new
/// voxels in world units, `half_width` that of the band in voxels.
///
/// # Errors
/// [`VdbError::Parameter`] for an edge or half width out of range, [`VdbError::Open`] for a surface that is not closed,
/// cancellation, errors of OpenVDB.
pub(super) fn on_cubes(
    in_index_space: &LevelSet,
    map: &IndexMap,
    edge: f64,
    half_width: f64,
    session: Session<'_>,
) -> Result<LevelSet, VdbError> {
    let transform = Transform::new(edge).ok_or(VdbError::Parameter {
        name: "voxel size",
        value: edge,
        expected: "a positive, finite number",
    })?;
    let builder = LevelSetBuilder::new(transform, half_width)?;
    let mesh = in_index_space.to_mesh(session)?;
    if !mesh.is_empty() {
        let middle = mesh.bounds().centre().0;
        let mapped = mesh.mapped(|v| map.world(v));
        // A mirrored map turns triangles inside out.
        let mapped = if map.is_mirrored(middle) {
            mapped.flipped()
        } else {
            mapped
        };
        let extent = mapped.bounds();
        let solid = MeshSolid::new(mapped);
        if !solid.is_cycle() {
            return Err(VdbError::Open);
        }
        let band = Band {
            field: &solid,
            transform,
            half_width,
            extent,
        };
        band.evaluate(session.threads, session.progress, &builder)
            .map_err(|e| VdbError::band("resampling", e))?;
    }
    builder.finish(session)
}

impl GridInfo {
    /// The map from index space to the world, in the file's unit.
    pub fn index_map(&self) -> IndexMap {
        self.map.unwrap_or_else(|| {
            let [x, y, z] = self.voxel_size;
            IndexMap::axis_aligned([x, y, z], self.origin)
        })
    }

    /// The middle of the active voxels.
    fn middle(&self) -> Vec3 {
        let [low, high] = self.bbox.unwrap_or_default();
        Vec3::from_fn(|a, _| f64::midpoint(f64::from(low[a]), f64::from(high[a])))
    }

    /// Describes the voxels, as in "voxels of 0.1, turned".
    pub fn shape(&self) -> String {
        self.index_map().description(self.middle())
    }

    /// Edge of a cube as fine as the voxels: their shortest edge, in the middle of a frustum.
    pub fn cube_edge(&self) -> f64 {
        match self.map {
            None => self.voxel_size[0],
            Some(map) => map.shortest_edge(self.middle()),
        }
    }
}
