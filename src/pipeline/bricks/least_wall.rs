//! The walls of a solid in bricks: measured in cubes spread over it, each with the surface around.

use super::super::error::RunError;
use super::super::least_wall::{self, Phase, REACH, Sampled};
use super::assemble::part;
use super::solid::StoredSolid;
use super::{Quiet, Yard};
use crate::band::Region;
use crate::frame::{Coord, Vec3};
use crate::mesh::TriMesh;

/// Edge of a cube, voxels. With what is around it has as many leaves as a block.
const EDGE: i32 = 64;
/// Voxels beyond, so that leaves at the rim have their neighbours.
const RIM: i32 = 8;
/// Cubes that are looked into at most: all of a solid that fills no more.
const CUBES: usize = 256;
/// Samples that are wanted.
const SAMPLES: f64 = 20_000.0;

/// Inscribed balls of one phase over the surface, up to [`REACH`] voxels of diameter. They do not depend
/// on the bricks.
pub(super) fn sampled_walls(
    yard: &Yard,
    solid: &StoredSolid,
    phase: Phase,
) -> Result<Sampled, RunError> {
    let store = &solid.store;
    let cubes: Vec<Region> = store.blocks().flat_map(cubes_of).collect();
    let stride = cubes.len().div_ceil(CUBES).max(1);
    let chosen: Vec<Region> = cubes.iter().step_by(stride).copied().collect();
    yard.progress
        .stage(phase.stage(), Some(chosen.len() as u64));
    // A unit of area crosses 1.5 edges of voxels in the mean, and has a band of both half widths.
    let half_width = solid.bricks.voxels.half_width;
    let points = 1.5 * store.active_voxels() as f64 / (2.0 * half_width * stride as f64);
    let each = (points / SAMPLES).ceil().max(1.0) as usize;
    let mut sampled = Sampled::default();
    for cube in chosen {
        sampled.add(cube_walls(yard, solid, cube, (each, phase))?);
        yard.progress.advance(1);
    }
    Ok(sampled)
}

/// The eight cubes of a block.
fn cubes_of(block: Coord) -> impl Iterator<Item = Region> {
    (0..8).map(move |n| {
        let at = |shift: u32| (n >> shift & 1) * EDGE;
        Region::cube(block.offset(at(2), at(1), at(0)), EDGE)
    })
}

/// The walls at every `each`-th vertex in a cube.
fn cube_walls(
    yard: &Yard,
    stored: &StoredSolid,
    cube: Region,
    (each, phase): (usize, Phase),
) -> Result<Sampled, RunError> {
    let quiet = Quiet(yard.progress);
    let bench = stored.bricks.bench(yard, &quiet);
    let failed = RunError::level_set("walls");
    let h = bench.scale.voxel_size;
    let around = cube.grown(REACH);
    let solid = part(bench, &stored.store, around.grown(RIM), Coord([0; 3]))?;
    let patch = solid
        .patch(around, stored.far(), None, bench.session())
        .map_err(&failed)?;
    let mesh = TriMesh::new(patch.vertices, patch.faces).map_err(|e| failed(e.into()))?;
    let is_within = |p: &Vec3| {
        let voxel = p.map(|c| (c / h).floor() as i32);
        cube.meets(Coord(voxel.into()), 1)
    };
    let own = mesh.vertices().iter().enumerate();
    let own = own.filter(|(_, p)| is_within(p)).map(|(n, _)| n as u32);
    let samples: Vec<u32> = own.step_by(each).collect();
    if samples.is_empty() {
        return Ok(Sampled::default());
    }
    let widest = h * f64::from(REACH) / 2.0;
    let measure = || least_wall::sampled(&mesh, &samples, widest, phase, &quiet);
    Ok(yard.threads.install(measure)?)
}
