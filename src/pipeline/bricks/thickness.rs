//! The thickness of a solid in bricks: measured brick by brick, each with the surface around it.

use super::super::error::RunError;
use super::super::least_wall::{SurfacePoint, points};
use super::super::thickness::{Lattice, Measured, Surface, Thickness};
use super::assemble::part;
use super::solid::StoredSolid;
use super::{Quiet, Yard};
use crate::band::{BLOCK, LEAF, Region};
use crate::frame::{Coord, Vec3};
use crate::mesh::TriMesh;

/// The surface of a solid in bricks, meshed as its points are asked for: of a brick at once, of larger regions
/// block by block.
struct Stored<'a> {
    yard: &'a Yard<'a>,
    solid: &'a StoredSolid,
    lattice: Lattice,
}

impl Surface for Stored<'_> {
    fn regions(&self) -> Vec<Region> {
        let bricks = &self.solid.bricks;
        (0..bricks.len()).map(|n| bricks.region(n)).collect()
    }

    fn region_of(&self, voxel: Coord, level: u32) -> Region {
        let edge = BLOCK << level;
        Region::cube(voxel.aligned(edge), edge)
    }

    fn around(&self, region: Region, halo: i32, level: u32) -> Result<Vec<SurfacePoint>, RunError> {
        let Self {
            yard,
            solid,
            lattice,
        } = self;
        let store = &solid.store;
        let quiet = Quiet(yard.progress);
        let bench = solid.bricks.bench(yard, &quiet);
        let failed = RunError::level_set("thickness");
        let region = region.grown(halo);
        let pieces: Vec<Region> = if level == 0 {
            vec![region]
        } else {
            let blocks = store.blocks_of(region);
            let own = blocks.map(|block| Region::cube(block, BLOCK).common(region));
            own.collect()
        };
        let mut all = Vec::new();
        for own in pieces {
            // Every vertex with all its triangles, and these with all their voxels.
            let around = own.grown(LEAF);
            let part = part(bench, store, around.grown(LEAF), Coord([0; 3]))?;
            let patch = part.patch(around, solid.far(), None, bench.session());
            let patch = patch.map_err(&failed)?;
            let mesh = TriMesh::new(patch.vertices, patch.faces).map_err(|e| failed(e.into()))?;
            let is_own = |p: &SurfacePoint| {
                own.meets(lattice.voxel(p.place), 1) && lattice.keeps(p.place, level)
            };
            let outward = mesh.vertex_normals_by_area();
            all.extend(points(&mesh, &outward).filter(is_own));
        }
        Ok(all)
    }
}

/// The thickness of a solid, the same as in memory.
pub(super) fn thickness(yard: &Yard, solid: &StoredSolid) -> Result<Thickness, RunError> {
    let lattice = Lattice {
        origin: Vec3::zeros(),
        voxel_size: solid.bricks.voxels.scale.voxel_size,
    };
    let [min, max] = solid.store.bounds().unwrap_or([Coord([0; 3]); 2]);
    let sides = (0..3).map(|a| f64::from(max[a]) - f64::from(min[a]) + 1.0);
    let measured = Measured {
        lattice,
        active_voxels: solid.store.active_voxels(),
        extent: sides.fold(0.0, f64::max),
    };
    let surface = Stored {
        yard,
        solid,
        lattice,
    };
    let bench = solid.bricks.bench(yard, yard.progress);
    Thickness::new(bench, &surface, measured)
}
