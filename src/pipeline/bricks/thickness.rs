//! The local thickness of a solid in bricks, measured brick by brick with a halo; the measure itself is that of
//! runs in memory, with the same result.

use super::BrickRun;
use super::assemble::part;
use super::solid::StoredSolid;
use crate::band::{BLOCK, LEAF, Region};
use crate::frame::{Coord, Vec3};
use crate::mesh::TriMesh;
use crate::pipeline::base::context::VoxelLattice;
use crate::pipeline::base::error::RunError;
use crate::pipeline::measure::least_wall::{SurfacePoint, surface_points};
use crate::pipeline::measure::thickness::{RegionalSurface, SolidGeometry, Thickness};
use crate::progress::CancelOnly;

/// The surface of a solid in bricks, meshed on demand. Level 0 measures thin walls brick by brick; each further
/// level takes wider balls, cubes of twice the edge and fewer points, and is meshed block by block.
struct BrickSurface<'a> {
    brick_run: &'a BrickRun<'a>,
    solid: &'a StoredSolid,
    lattice: VoxelLattice,
}

impl RegionalSurface for BrickSurface<'_> {
    fn regions(&self) -> Vec<Region> {
        let bricks = &self.solid.bricks;
        (0..bricks.len()).map(|n| bricks.region(n)).collect()
    }

    // Cubes of blocks, twice as wide with each level.
    fn region_of(&self, voxel: Coord, level: u32) -> Region {
        let edge = BLOCK << level;
        Region::cube(voxel.aligned(edge), edge)
    }

    // The surface points in a region grown by `halo` voxels; each further level keeps fewer of them.
    fn around(&self, region: Region, halo: i32, level: u32) -> Result<Vec<SurfacePoint>, RunError> {
        let Self {
            brick_run,
            solid,
            lattice,
        } = self;
        let store = &solid.store;
        let quiet = CancelOnly(brick_run.progress);
        let context = solid.bricks.context(brick_run, &quiet);
        let failed = RunError::level_set("thickness");
        let region = region.grown(halo);
        // Regions of wider balls have many blocks; one after the other bounds the memory for their voxels.
        let parts: Vec<Region> = if level == 0 {
            vec![region]
        } else {
            let blocks = store.blocks_in(region);
            let common = blocks.map(|block| Region::cube(block, BLOCK).common(region));
            common.collect()
        };
        let mut all = Vec::new();
        for own in parts {
            // Every vertex needs all its triangles, and these need all their voxels.
            let around = own.grown(LEAF);
            let part = part(context, store, around.grown(LEAF), Coord([0; 3]))?;
            let patch = part.patch(around, solid.far(), None, context.session());
            let patch = patch.map_err(&failed)?;
            let mesh = TriMesh::new(patch.vertices, patch.faces).map_err(|e| failed(e.into()))?;
            let is_own = |p: &SurfacePoint| {
                own.meets(lattice.voxel(p.position), 1) && lattice.keeps(p.position, level)
            };
            let outward = mesh.vertex_normals_by_area();
            all.extend(surface_points(&mesh, &outward).filter(is_own));
        }
        Ok(all)
    }
}

/// The thickness of a solid in bricks, equal to that of a run in memory.
pub(super) fn thickness(brick_run: &BrickRun, solid: &StoredSolid) -> Result<Thickness, RunError> {
    let lattice = VoxelLattice {
        origin: Vec3::zeros(),
        voxel_size: solid.bricks.voxels.scale.voxel_size,
    };
    let [min, max] = solid.store.bounds().unwrap_or([Coord([0; 3]); 2]);
    // Edges of the box in voxels; both ends count.
    let edges = (0..3).map(|a| f64::from(max[a]) - f64::from(min[a]) + 1.0);
    let geometry = SolidGeometry {
        lattice,
        active_voxels: solid.store.active_voxels(),
        extent: edges.fold(0.0, f64::max),
    };
    let surface = BrickSurface {
        brick_run,
        solid,
        lattice,
    };
    let context = solid.bricks.context(brick_run, brick_run.progress);
    Thickness::new(context, &surface, geometry)
}
