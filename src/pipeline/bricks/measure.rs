//! Volume, area and surface of a solid in bricks: each brick is meshed with the leaves around it, and
//! keeps the triangles that are its own.

use super::super::error::RunError;
use super::super::operate::Bench;
use super::{Quiet, Yard};
use crate::band::{LeafSink, LeafStore, SinkError, StoreError};
use crate::frame::{Aabb, Coord, Vec3};
use crate::io::StlStream;
use crate::mesh::TriMesh;
use crate::vdb::{FileError, LevelSetBuilder, VdbError};

/// Voxels around a brick that are meshed with it.
const LAYER: i32 = 8;

/// What the surface encloses.
pub(super) struct Measured {
    pub volume: f64,
    pub area: f64,
    pub bounds: Aabb,
}

/// A mesh that is written while bricks pass, and the factor to its unit.
pub(super) struct MeshOut {
    pub file: StlStream,
    pub factor: f64,
}

/// Meshes all bricks; adds their triangles to the files.
pub(super) fn measure(
    yard: &Yard,
    store: &LeafStore,
    files: &mut [MeshOut],
) -> Result<Measured, RunError> {
    let count = yard.plan.bricks.len();
    yard.progress.stage("mesh", Some(count as u64));
    let mut found = Measured {
        volume: 0.0,
        area: 0.0,
        bounds: Aabb::EMPTY,
    };
    for brick in 0..count {
        let part = triangles(yard, store, brick)?;
        // About the one origin: a part by itself is not closed.
        let signed = |[a, b, c]: [Vec3; 3]| a.dot(&b.cross(&c)) / 6.0;
        found.volume += part.iter_corners().map(signed).sum::<f64>();
        found.area += part.area();
        found.bounds = found.bounds.union(part.bounds());
        for out in &mut *files {
            for t in part.iter_corners() {
                out.file.add(t.map(|v| v * out.factor))?;
            }
        }
        yard.progress.advance(1);
    }
    Ok(found)
}

/// The triangles of one brick, world units.
fn triangles(yard: &Yard, store: &LeafStore, brick: usize) -> Result<TriMesh, RunError> {
    let region = yard.plan.region(brick);
    let grown = region.grown(LAYER);
    let quiet = Quiet(yard.progress);
    let bench = Bench::new(yard.stock.recipe, yard.threads, &quiet);
    let failed = RunError::level_set("mesh");
    let builder = LevelSetBuilder::of_part(bench.transform()?, bench.half_width, Coord([0; 3]))
        .map_err(&failed)?;
    for block in store.blocks_of(grown) {
        let leaves = store
            .read(block, grown)
            .map_err(|e| FileError::from(StoreError::from(e)))?;
        let refused = |e: SinkError| match e.into_inner().downcast::<VdbError>() {
            Ok(e) => failed(*e),
            Err(other) => RunError::band("mesh")(SinkError::new(other).into()),
        };
        builder.block(block, &leaves).map_err(refused)?;
    }
    builder.inside(&store.inside(grown));
    let solid = builder.finish(bench.session()).map_err(&failed)?;
    let corners = store.bounds().into_iter().flatten();
    let far = corners.flat_map(|c| c.0).map(i32::unsigned_abs).max();
    let far = f64::from(far.unwrap_or(0)) * bench.scale.voxel_size;
    solid
        .triangles_of(region, far, bench.session())
        .map_err(&failed)
}
