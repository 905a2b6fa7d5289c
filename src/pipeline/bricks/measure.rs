//! Volume, area and pictures of a solid in bricks: each brick is meshed with the leaves around it, and
//! keeps the triangles that are its own.

use super::super::error::RunError;
use super::assemble::part;
use super::meshes::Meshes;
use super::solid::StoredSolid;
use super::{Quiet, Yard};
use crate::frame::{Aabb, Coord, Vec3};
use crate::io::atomic::write_bytes;
use crate::mesh::TriMesh;
use crate::recipe::Output;
use crate::vdb::render_parts;
use std::path::Path;

/// Voxels around a brick that are seen with it.
const LAYER: i32 = 8;

/// What the surface encloses.
pub(super) struct Measured {
    pub volume: f64,
    pub area: f64,
    pub bounds: Aabb,
    /// The box that pictures are framed by.
    pub frame: Aabb,
}

/// Meshes all bricks; adds their triangles to the files.
pub(super) fn measure(
    yard: &Yard,
    solid: &StoredSolid,
    files: &mut Meshes,
) -> Result<Measured, RunError> {
    let StoredSolid { bricks, store } = solid;
    let count = bricks.len();
    yard.progress.stage("mesh", Some(count as u64));
    let mut found = Measured {
        volume: 0.0,
        area: 0.0,
        bounds: Aabb::EMPTY,
        frame: Aabb::EMPTY,
    };
    let quiet = Quiet(yard.progress);
    let bench = bricks.bench(yard, &quiet);
    let failed = RunError::level_set("mesh");
    let far = solid.far();
    let centre = Vec3::from(solid.centre());
    let halo = files.halo();
    // Patches weld from the upper ones down.
    for brick in (0..count).rev() {
        let region = bricks.region(brick);
        let own = part(bench, store, region.grown(halo), Coord([0; 3]))?;
        found.frame = found.frame.union(own.bounds().map_err(&failed)?);
        let session = bench.session();
        let patch = own.patch(region, far, None, session).map_err(&failed)?;
        files.add(bench, &patch, false)?;
        let mesh = TriMesh::new(patch.vertices, patch.faces).map_err(|e| failed(e.into()))?;
        // About one place for all: a part by itself is not closed. In the solid, so that no digits are lost.
        let signed =
            |[a, b, c]: [Vec3; 3]| (a - centre).dot(&(b - centre).cross(&(c - centre))) / 6.0;
        found.volume += mesh.iter_corners().map(signed).sum::<f64>();
        found.area += mesh.area();
        found.bounds = found.bounds.union(mesh.bounds());
        drop(mesh);
        if let Some(field) = files.exact() {
            let patch = own.patch(region, far, Some(field), session);
            files.add(bench, &patch.map_err(&failed)?, true)?;
        }
        files.add_others(bench, (solid, &own), (region, far))?;
        yard.progress.advance(1);
    }
    Ok(found)
}

/// Writes a picture of the solid that fills `frame`.
pub(super) fn picture(
    yard: &Yard,
    solid: &StoredSolid,
    (output, path): (&Output, &Path),
    frame: Aabb,
) -> Result<(), RunError> {
    let StoredSolid { bricks, store } = solid;
    let count = bricks.len();
    // Coarse, fine, and shadows.
    yard.progress.stage("picture", Some(3 * count as u64));
    let quiet = Quiet(yard.progress);
    let bench = bricks.bench(yard, &quiet);
    let transform = bench.transform()?;
    let wanted = super::super::output::picture(output);
    let image = render_parts(&wanted, frame, bench.session(), |visit| {
        for brick in 0..count {
            let region = bricks.region(brick);
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
