//! Wall thickness of a solid in bricks, sampled in cubes spread over it, which do not depend on the bricks. Walls
//! thicker than the halo are only counted; wider gaps are not.

use super::BrickRun;
use super::assemble::part;
use super::solid::StoredSolid;
use crate::band::Region;
use crate::frame::{Coord, Vec3};
use crate::mesh::TriMesh;
use crate::pipeline::base::error::RunError;
use crate::pipeline::measure::least_wall;
use crate::pipeline::measure::least_wall::{MAX_BRICK_WALL, Phase, WallSamples};
use crate::progress::CancelOnly;

/// Edge of a cube, voxels. With the halo of 24 voxels and the rim of 8 on both sides it has 128, as a block.
const CUBE_EDGE: i32 = 64;
/// Voxels beyond the halo, so that its outer leaves have neighbours.
const RIM_WIDTH: i32 = 8;
/// Greatest number of cubes that are measured, which bounds the time of a large solid.
const MAX_CUBES: usize = 256;
/// Target number of samples, as in memory: enough for a percentile.
const TARGET_SAMPLES: f64 = 20_000.0;

/// Inscribed balls of one phase (solid or void) over the surface, with diameters up to [`MAX_BRICK_WALL`] voxels.
/// The cubes and vertices are chosen by the solid alone, so that the result does not depend on the bricks.
pub(super) fn sampled_walls(
    brick_run: &BrickRun,
    solid: &StoredSolid,
    phase: Phase,
) -> Result<WallSamples, RunError> {
    let store = &solid.store;
    let cubes: Vec<Region> = store.blocks().flat_map(cubes_of).collect();
    let stride = cubes.len().div_ceil(MAX_CUBES).max(1);
    let chosen: Vec<Region> = cubes.iter().step_by(stride).copied().collect();
    brick_run
        .progress
        .stage(phase.stage(), Some(chosen.len() as u64));
    // A unit of area crosses 1.5 edges of voxels on average, and its band has twice the half width.
    let half_width = solid.bricks.voxels.half_width;
    let points = 1.5 * store.active_voxels() as f64 / (2.0 * half_width * stride as f64);
    let vertex_stride = (points / TARGET_SAMPLES).ceil().max(1.0) as usize;
    let mut sampled = WallSamples::default();
    for cube in chosen {
        sampled.add(cube_walls(brick_run, solid, cube, vertex_stride, phase)?);
        brick_run.progress.advance(1);
    }
    Ok(sampled)
}

/// The eight cubes of a block.
fn cubes_of(block: Coord) -> impl Iterator<Item = Region> {
    (0..8).map(move |n| {
        let offset = |shift: u32| ((n >> shift) & 1) * CUBE_EDGE;
        Region::cube(block.offset(offset(2), offset(1), offset(0)), CUBE_EDGE)
    })
}

/// The walls at every `vertex_stride`-th vertex in a cube of voxels. A wall is a ball that touches the surface
/// there from inside the phase; its diameter is in world units.
fn cube_walls(
    brick_run: &BrickRun,
    stored: &StoredSolid,
    cube: Region,
    vertex_stride: usize,
    phase: Phase,
) -> Result<WallSamples, RunError> {
    let quiet = CancelOnly(brick_run.progress);
    let context = stored.bricks.context(brick_run, &quiet);
    let failed = RunError::level_set("walls");
    let h = context.scale.voxel_size;
    // A ball at a vertex of the cube has its opposite contact within its diameter: the surface is needed that far.
    let around = cube.grown(MAX_BRICK_WALL);
    // The part keeps the voxel numbers of the whole solid, from the world's origin: its vertices have world positions,
    // and p / h below is the voxel of p.
    let solid = part(
        context,
        &stored.store,
        around.grown(RIM_WIDTH),
        Coord([0; 3]),
    )?;
    // The whole solid's greatest coordinate, so that rounding does not depend on the cube.
    let patch = solid
        .patch(around, stored.far(), None, context.session())
        .map_err(&failed)?;
    let mesh = TriMesh::new(patch.vertices, patch.faces).map_err(|e| failed(e.into()))?;
    let is_within = |p: &Vec3| {
        let voxel = p.map(|c| (c / h).floor() as i32);
        cube.meets(Coord(voxel.into()), 1)
    };
    // Each vertex is counted in one cube: the one with its voxel.
    let vertices = mesh.vertices().iter().enumerate();
    let in_cube = vertices
        .filter(|(_, p)| is_within(p))
        .map(|(n, _)| n as u32);
    let samples: Vec<u32> = in_cube.step_by(vertex_stride).collect();
    if samples.is_empty() {
        return Ok(WallSamples::default());
    }
    let max_radius = h * f64::from(MAX_BRICK_WALL) / 2.0;
    let measure = || least_wall::sample_walls(&mesh, &samples, max_radius, phase, &quiet);
    Ok(brick_run.threads.install(measure)?)
}
