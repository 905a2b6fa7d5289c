//! Grids whose voxels are no cubes along the axes: what their voxels are, and the same solid on cubes.
//!
//! The surface is meshed in voxel numbers, where nothing is turned or stretched, and its vertices are mapped to the
//! world: planes stay planes. Distances are then those from the mesh, whatever the grid's values were.

use super::{GridInfo, IndexMap, LevelSet, LevelSetBuilder, Session, VdbError};
use crate::band::Band;
use crate::frame::{Transform, Vec3};
use crate::mesh::MeshSolid;

/// The same solid on cubes: the mesh in voxel numbers, mapped to the world, and its distances.
pub(super) fn on_cubes(
    numbers: &LevelSet,
    map: &IndexMap,
    (edge, half_width): (f64, f64),
    session: Session<'_>,
) -> Result<LevelSet, VdbError> {
    let transform = Transform::new(edge).ok_or(VdbError::Parameter {
        name: "voxel size",
        value: edge,
        expected: "a positive, finite number",
    })?;
    let builder = LevelSetBuilder::new(transform, half_width)?;
    let mesh = numbers.to_mesh(session)?;
    if !mesh.is_empty() {
        let middle = mesh.bounds().centre().0;
        let mapped = mesh.mapped(|v| map.world(v));
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
    /// From voxel numbers to the world, the file's unit.
    pub fn index_map(&self) -> IndexMap {
        self.map.unwrap_or_else(|| {
            let [x, y, z] = self.voxel_size;
            IndexMap::boxes([x, y, z], self.origin)
        })
    }

    /// The middle of the active voxels.
    fn middle(&self) -> Vec3 {
        let [low, high] = self.bbox.unwrap_or_default();
        Vec3::from_fn(|a, _| f64::midpoint(f64::from(low[a]), f64::from(high[a])))
    }

    /// What its voxels are, in words.
    pub fn shape(&self) -> String {
        self.index_map().description(self.middle())
    }

    /// Edge of a cube as fine as its voxels: the shortest edge, in the midst of a frustum.
    pub fn cube_edge(&self) -> f64 {
        match self.map {
            None => self.voxel_size[0],
            Some(map) => map.shortest_edge(self.middle()),
        }
    }
}
