//! Volume, area and pictures of a solid in bricks. Each brick is meshed with a layer of leaves around it
//! and keeps its own triangles.

use super::BrickRun;
use super::assemble::part;
use super::meshes::{Meshes, VertexSource};
use super::solid::StoredSolid;
use crate::frame::{Aabb, Coord, Vec3};
use crate::io::atomic::write_bytes;
use crate::mesh::TriMesh;
use crate::pipeline::base::error::RunError;
use crate::pipeline::measure::solid_measures::refuse_torn;
use crate::progress::CancelOnly;
use crate::recipe::Output;
use crate::vdb::{SolidParts, VdbError, render_parts};
use std::path::Path;

/// Layer around a brick that is rendered with it, voxels.
const LAYER_WIDTH: i32 = 8;

/// Measures of the surface, in world units.
pub(super) struct SurfaceMeasures {
    pub volume: f64,
    pub area: f64,
    pub bounds: Aabb,
    /// The box that pictures show.
    pub frame: Aabb,
}

/// Meshes all bricks, sums volume and area, and adds their triangles to the files. Volumes are sums over bricks in
/// a fixed order.
pub(super) fn measure(
    brick_run: &BrickRun,
    solid: &StoredSolid,
    files: &mut Meshes,
) -> Result<SurfaceMeasures, RunError> {
    let StoredSolid { bricks, store } = solid;
    let count = bricks.len();
    brick_run.progress.stage("mesh", Some(count as u64));
    let mut found = SurfaceMeasures {
        volume: 0.0,
        area: 0.0,
        bounds: Aabb::EMPTY,
        frame: Aabb::EMPTY,
    };
    let quiet = CancelOnly(brick_run.progress);
    let context = bricks.context(brick_run, &quiet);
    let failed = RunError::level_set("mesh");
    let far = solid.far();
    let centre = Vec3::from(solid.centre());
    let halo = files.halo();
    // Patches are welded in descending order.
    for brick in (0..count).rev() {
        let region = bricks.region(brick);
        let with_halo = part(context, store, region.grown(halo), Coord([0; 3]))?;
        // A brick whose surface is torn stops the run before it is written.
        refuse_torn(context, brick_run.inputs, &with_halo, region)?;
        let bounds = with_halo.parallel_bounds(context.threads);
        found.frame = found.frame.union(bounds.map_err(&failed)?);
        let session = context.session();
        let patch = with_halo
            .patch(region, far, None, session)
            .map_err(&failed)?;
        files.add(context, &patch, VertexSource::LevelSet)?;
        let mesh = TriMesh::new(patch.vertices, patch.faces).map_err(|e| failed(e.into()))?;
        // All parts refer to one point, because a part alone is not closed. The point lies in the solid,
        // so that no digits are lost.
        let own_measures = context
            .threads
            .install(|| mesh.measures_about(Some(centre)));
        found.volume += own_measures.volume;
        found.area += own_measures.area;
        found.bounds = found.bounds.union(own_measures.bounds);
        drop(mesh);
        if let Some(field) = files.exact() {
            let patch = with_halo.patch(region, far, Some(field), session);
            files.add(context, &patch.map_err(&failed)?, VertexSource::ExactField)?;
        }
        files.add_other_faces(context, solid, &with_halo, region, far)?;
        brick_run.progress.advance(1);
    }
    Ok(found)
}

/// Writes a picture of the solid, framed by the box `frame` in world units, to `path` as a PNG.
pub(super) fn picture(
    brick_run: &BrickRun,
    solid: &StoredSolid,
    output: &Output,
    path: &Path,
    frame: Aabb,
) -> Result<(), RunError> {
    let StoredSolid { bricks, store } = solid;
    let count = bricks.len();
    let quiet = CancelOnly(brick_run.progress);
    let context = bricks.context(brick_run, &quiet);
    let transform = context.transform()?;
    let picture_options = crate::pipeline::outputs::output::picture(output);
    let filled = |&n: &usize| store.blocks_in(bricks.region(n)).next().is_some();
    let numbers: Vec<usize> = (0..count).filter(filled).collect();
    let around = |n: &usize| {
        let region = bricks.region(*n);
        let corners = [region.min, region.max].map(|c| transform.world(c).0);
        // A part may show up to the layer of two voxels that the renderer requires around its box.
        Aabb::of(corners).dilated(2.0 * context.scale.voxel_size)
    };
    // The renderer visits each part three times: coarse samples, fine samples, shadows.
    let visits = 3 * numbers.len() as u64;
    brick_run.progress.stage("picture", Some(visits));
    let boxes: Vec<Aabb> = numbers.iter().map(around).collect();
    let mut make = |n: usize| {
        let region = bricks.region(numbers[n]).grown(LAYER_WIDTH);
        part(context, store, region, Coord([0; 3])).map_err(PictureError)
    };
    let parts = SolidParts {
        boxes: &boxes,
        make: &mut make,
        visited: &|| brick_run.progress.advance(1),
    };
    let image = render_parts(&picture_options, frame, context.session(), parts);
    let image = image.map_err(|e| e.0)?;
    let png = image.png().map_err(RunError::level_set("picture"))?;
    write_bytes(path, &png)?;
    Ok(())
}

/// An error of the renderer, whose own are those of the stage `picture`.
struct PictureError(RunError);

impl From<VdbError> for PictureError {
    fn from(error: VdbError) -> Self {
        Self(RunError::level_set("picture")(error))
    }
}
