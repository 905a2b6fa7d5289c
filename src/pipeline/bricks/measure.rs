//! Volume, area and surface of a solid in bricks: each brick is meshed with the leaves around it, and
//! keeps the triangles that are its own.

use super::super::error::RunError;
use super::super::operate::Bench;
use super::later::part;
use super::{Quiet, Yard};
use crate::band::LeafStore;
use crate::frame::{Aabb, Coord, Vec3};
use crate::io::atomic::write_bytes;
use crate::io::{MeshPart, MeshStream};
use crate::mesh::TriMesh;
use crate::mesher::{Patch, Welder};
use crate::recipe::Output;
use crate::vdb::{VdbError, render_parts};
use std::path::Path;

/// Voxels around a brick that are meshed with it.
const LAYER: i32 = 8;

/// What the surface encloses.
pub(super) struct Measured {
    pub volume: f64,
    pub area: f64,
    pub bounds: Aabb,
    /// The box that pictures are framed by.
    pub frame: Aabb,
}

/// A mesh that is written while bricks pass, and the factor to its unit.
pub(super) struct MeshOut {
    pub file: MeshStream,
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
        frame: Aabb::EMPTY,
    };
    let mut welder = Welder::default();
    // Patches weld from the upper ones down.
    for brick in (0..count).rev() {
        let (patch, frame) = patch_of(yard, store, brick)?;
        found.frame = found.frame.union(frame);
        let unmade = |e: VdbError| RunError::level_set("mesh")(e);
        if !files.is_empty() {
            let numbered = welder.weld(&patch).map_err(|e| unmade(e.into()))?;
            for out in &mut *files {
                out.file.add(MeshPart {
                    vertices: &patch.vertices,
                    owned: patch.owned,
                    triangles: &patch.triangles,
                    numbered: &numbered,
                    factor: out.factor,
                })?;
            }
        }
        let part = TriMesh::new(patch.vertices, patch.triangles).map_err(|e| unmade(e.into()))?;
        // About the one origin: a part by itself is not closed.
        let signed = |[a, b, c]: [Vec3; 3]| a.dot(&b.cross(&c)) / 6.0;
        found.volume += part.iter_corners().map(signed).sum::<f64>();
        found.area += part.area();
        found.bounds = found.bounds.union(part.bounds());
        yard.progress.advance(1);
    }
    Ok(found)
}

/// The mesh of one brick and the box around the solid there, world units.
fn patch_of(yard: &Yard, store: &LeafStore, brick: usize) -> Result<(Patch, Aabb), RunError> {
    let region = yard.plan.region(brick);
    let grown = region.grown(LAYER);
    let quiet = Quiet(yard.progress);
    let bench = Bench::new(yard.stock.recipe, yard.threads, &quiet);
    let solid = part(bench, store, grown, Coord([0; 3]))?;
    let corners = store.bounds().into_iter().flatten();
    let far = corners.flat_map(|c| c.0).map(i32::unsigned_abs).max();
    let far = f64::from(far.unwrap_or(0)) * bench.scale.voxel_size;
    let failed = RunError::level_set("mesh");
    let mesh = solid.patch(region, far, bench.session());
    Ok((mesh.map_err(&failed)?, solid.bounds().map_err(&failed)?))
}

/// Writes a picture of the solid that fills `frame`.
pub(super) fn picture(
    yard: &Yard,
    store: &LeafStore,
    (output, path): (&Output, &Path),
    frame: Aabb,
) -> Result<(), RunError> {
    let count = yard.plan.bricks.len();
    // Coarse, fine, and shadows.
    yard.progress.stage("picture", Some(3 * count as u64));
    let quiet = Quiet(yard.progress);
    let bench = Bench::new(yard.stock.recipe, yard.threads, &quiet);
    let transform = bench.transform()?;
    let wanted = super::super::output::picture(output);
    let image = render_parts(&wanted, frame, bench.session(), |visit| {
        for brick in 0..count {
            let region = yard.plan.region(brick);
            if store.blocks_of(region).next().is_some() {
                let own = part(bench, store, region.grown(LAYER), Coord([0; 3]))?;
                let corners = [region.min, region.max].map(|c| transform.world(c).0);
                let around = Aabb::of(corners).dilated(bench.scale.voxel_size);
                visit(&own, around).map_err(RunError::level_set("picture"))?;
            }
            yard.progress.advance(1);
        }
        Ok::<_, RunError>(())
    })?;
    let png = image.png().map_err(RunError::level_set("picture"))?;
    write_bytes(path, &png)?;
    Ok(())
}
