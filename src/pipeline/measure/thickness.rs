//! The local thickness of a solid: the diameter of the inscribed ball at the nearest point where one was
//! measured.
//!
//! The balls are those of [`super::least_wall`]. Up to a radius of [`FIRST_LEVEL_RADIUS`] voxels they
//! are searched among all points of the surface, wider ones on levels of fewer points: each level
//! doubles the radius and keeps a quarter of the points, so that every ball meets about as many. Points
//! are at most a fifth of the ball's radius r apart. Between points s apart a ball sinks in by s^2 / (8
//! r), which is 0.5 % of r.
//!
//! A solid larger than memory is measured region by region with a halo. The result depends neither on
//! the regions nor on the order of points: a point's level follows from its voxel, ties between equally
//! near points are broken by coordinates, and every normal is complete.

use super::least_wall::{
    BIN_EDGE_FACTOR, Phase, SearchRadii, SurfacePoint, TouchingBall, Wall, WallSamples, ball_at,
};
use super::spatial_bins::{Bins, Site};
use crate::band::Region;
use crate::frame::{Coord, Vec3};
use crate::mesh::TriMesh;
use crate::pipeline::base::context::{StageContext, VoxelLattice};
use crate::pipeline::base::error::RunError;
use crate::progress::Cancelled;
use crate::vdb::LevelSet;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Approximate number of points at which thickness is measured, if the surface has more.
pub(crate) const TARGET_POINTS: f64 = 400_000.0;
/// Greatest radius of balls that are searched among all points, voxels.
const FIRST_LEVEL_RADIUS: i32 = 16;
/// The last level; its balls are wider than any part that files can hold.
pub(crate) const MAX_LEVEL: u32 = 20;
/// Approximate number of samples for the least wall, which is a percentile.
const TARGET_SAMPLES: f64 = 20_000.0;
/// Halo of a region on the first level, voxels: the reach of its balls.
pub(crate) const FIRST_LEVEL_HALO: i32 = 2 * FIRST_LEVEL_RADIUS;
/// Rounding tolerance, voxels: a vertex on an edge of voxels may be this much below it. Along its edge
/// it is farther than this from the ends.
const ROUNDING_TOLERANCE: f64 = 1e-5;

/// A surface that provides its points region by region.
pub(crate) trait RegionalSurface {
    /// Regions that cover the surface.
    fn regions(&self) -> Vec<Region>;

    /// The region around a voxel that is processed at once on a level.
    fn region_of(&self, voxel: Coord, level: u32) -> Region;

    /// The points of a level in a region and a halo around it.
    ///
    /// # Errors
    /// An error of reading or meshing.
    fn around(&self, region: Region, halo: i32, level: u32) -> Result<Vec<SurfacePoint>, RunError>;
}

impl VoxelLattice {
    /// The voxel at the lower end of the edge of the voxel lattice that a vertex lies on.
    pub fn voxel(&self, vertex: Vec3) -> Coord {
        let index = (vertex - self.origin) / self.voxel_size;
        // Without instructions for it, `floor` is a call.
        let floor = |c: f64| (c as i32).saturating_sub(i32::from(f64::from(c as i32) > c));
        Coord(index.map(|c| floor(c + ROUNDING_TOLERANCE)).into())
    }

    /// Whether a vertex belongs to a level: each level keeps the lowest quarter of the ranks of the one before.
    pub fn keeps(&self, vertex: Vec3, level: u32) -> bool {
        level == 0 || rank(self.voxel(vertex)) <= u64::MAX >> (2 * level).min(63)
    }
}

/// A quasi-random number of a voxel, evenly distributed along surfaces as well: the Kronecker sequence of the
/// powers of 1 / g with g^4 = g + 1, as fractions of 2^64.
fn rank(Coord(voxel): Coord) -> u64 {
    const STEPS: [u64; 3] = [
        0xd1b5_4a32_d192_ed03,
        0xabc9_8388_fb8f_ac03,
        0x8cb9_2ba7_2f3d_8dd7,
    ];
    let along = voxel.iter().zip(STEPS);
    along.fold(0, |sum, (&c, step)| {
        sum.wrapping_add((i64::from(c) as u64).wrapping_mul(step))
    })
}

/// A surface in memory.
struct MeshSurface<'a> {
    mesh: &'a TriMesh,
    /// Its vertices' normals.
    outward: Vec<Vec3>,
    lattice: VoxelLattice,
}

impl<'a> MeshSurface<'a> {
    fn new(context: StageContext, mesh: &'a TriMesh, solid: SolidGeometry, phase: Phase) -> Self {
        let normals = context.threads.install(|| mesh.vertex_normals_by_area());
        Self {
            mesh,
            outward: phase.outward(normals),
            lattice: solid.lattice,
        }
    }
}

impl RegionalSurface for MeshSurface<'_> {
    fn regions(&self) -> Vec<Region> {
        vec![Region::EVERYWHERE]
    }

    fn region_of(&self, _: Coord, _: u32) -> Region {
        Region::EVERYWHERE
    }

    fn around(&self, _: Region, _: i32, level: u32) -> Result<Vec<SurfacePoint>, RunError> {
        let all = self.mesh.vertices().par_iter().zip(&self.outward);
        let all = all.with_min_len(1 << 12).map(|(&position, &outward)| Site {
            position,
            value: -outward,
        });
        if level == 0 {
            // Without a filter the list is allocated exactly.
            return Ok(all.collect());
        }
        Ok(all
            .filter(|p| self.lattice.keeps(p.position, level))
            .collect())
    }
}

/// The properties of a solid that its wall thickness is measured with.
#[derive(Clone, Copy)]
pub(crate) struct SolidGeometry {
    pub lattice: VoxelLattice,
    /// Active voxels of its band.
    pub active_voxels: u64,
    /// Length of its longest side, voxels.
    pub extent: f64,
}

impl SolidGeometry {
    /// The geometry of a solid and its mesh.
    pub fn of(context: StageContext, solid: &LevelSet, mesh: &TriMesh) -> Result<Self, RunError> {
        let counted = solid.active_voxels();
        let bounds = context.threads.install(|| mesh.vertex_bounds());
        Ok(Self {
            lattice: VoxelLattice {
                origin: solid.origin(),
                voxel_size: context.scale.voxel_size,
            },
            active_voxels: counted.map_err(RunError::level_set("counting"))?,
            extent: bounds.size().max() / context.scale.voxel_size,
        })
    }
}

/// The thickness at points of a surface, searched by the nearest point.
pub(crate) struct Thickness(Bins<f32>);

impl Thickness {
    /// Measures it over the closed mesh of a solid in memory.
    pub fn of_mesh(
        context: StageContext,
        mesh: &TriMesh,
        solid: SolidGeometry,
    ) -> Result<Self, RunError> {
        let surface = MeshSurface::new(context, mesh, solid, Phase::Solid);
        Self::new(context, &surface, solid)
    }

    /// Measures it over a surface.
    pub fn new(
        context: StageContext,
        surface: &impl RegionalSurface,
        solid: SolidGeometry,
    ) -> Result<Self, RunError> {
        let walls = walls(context, "thickness", TARGET_POINTS, surface, solid)?;
        // Twice the distance between points, from the area that the band tells: most searches meet eight cubes.
        let area = solid.active_voxels as f64 / (2.0 * context.half_width);
        let spacing = solid.lattice.voxel_size * (area / walls.len().max(1) as f64).sqrt();
        let sites = walls.into_iter().map(|(position, wall)| Site {
            position,
            value: wall.thickness as f32,
        });
        let sites = sites.collect();
        Ok(Self(
            context.threads.install(|| Bins::new(sites, 2.0 * spacing)),
        ))
    }

    /// The thickness at a point, in the unit of the solid; 0 if no ball is inscribed anywhere.
    pub fn at(&self, p: Vec3) -> f32 {
        self.0.nearest(p).map_or(0.0, |site| site.value)
    }
}

/// Inscribed balls of one phase over the closed mesh of a solid in memory, enough for percentiles.
pub(crate) fn sampled_walls(
    context: StageContext,
    mesh: &TriMesh,
    solid: SolidGeometry,
    phase: Phase,
) -> Result<WallSamples, RunError> {
    let surface = MeshSurface::new(context, mesh, solid, phase);
    let walls = walls(context, phase.stage(), TARGET_SAMPLES, &surface, solid)?;
    let walls = walls.into_iter().map(|(_, wall)| wall);
    Ok(WallSamples::of(walls.collect()))
}

/// Inscribed balls at about `target_count` points of a surface, or at all points if it has fewer, with the points.
/// `stage` is the stage in progress.
fn walls(
    context: StageContext,
    stage: &str,
    target_count: f64,
    surface: &impl RegionalSurface,
    solid: SolidGeometry,
) -> Result<Vec<(Vec3, Wall)>, RunError> {
    let SolidGeometry {
        lattice,
        active_voxels,
        extent,
    } = solid;
    // A unit of area crosses 1.5 edges of voxels on average, and its band has twice the half width.
    let points = 1.5 * active_voxels as f64 / (2.0 * context.half_width);
    let sampling_ratio = (points / target_count).ceil().max(1.0) as u64;
    let h = lattice.voxel_size;
    let mut found = Vec::new();
    let mut wider: Vec<SurfacePoint> = Vec::new();
    let mut measure = |points, sample_points: &[SurfacePoint], edge: f64, radii: SearchRadii| {
        let mut wider = Vec::new();
        let balls = balls(context, points, edge, sample_points, radii)?;
        for (point, ball) in sample_points.iter().zip(balls) {
            match ball {
                TouchingBall::Inscribed(wall) => found.push((point.position, wall)),
                TouchingBall::Wider => wider.push(*point),
                TouchingBall::Pierced => {}
            }
        }
        Ok::<_, RunError>(wider)
    };
    let regions = surface.regions();
    context.progress.stage(stage, Some(regions.len() as u64));
    for region in regions {
        // Points of the region and of the halo that the first balls reach.
        let points = surface.around(region, FIRST_LEVEL_HALO, 0)?;
        let is_sample = |p: &&SurfacePoint| {
            let voxel = lattice.voxel(p.position);
            region.meets(voxel, 1) && rank(voxel) <= u64::MAX / sampling_ratio
        };
        let sample_points = || points.par_iter().with_min_len(1 << 12).filter(is_sample);
        let sample_points: Vec<SurfacePoint> = context
            .threads
            .install(|| sample_points().copied().collect());
        let radii = SearchRadii {
            first: h,
            max: h * f64::from(FIRST_LEVEL_RADIUS),
        };
        wider.extend(measure(points, &sample_points, BIN_EDGE_FACTOR * h, radii)?);
        context.progress.advance(1);
    }
    let mut level = 0;
    // No inscribed ball is wider than the diagonal, which is less than twice the longest side.
    while !wider.is_empty()
        && level < MAX_LEVEL
        && f64::from(FIRST_LEVEL_RADIUS << level) < 2.0 * extent
    {
        level += 1;
        // Points whose balls are wider, by the larger regions of this level.
        let mut regions: BTreeMap<Coord, (Region, Vec<SurfacePoint>)> = BTreeMap::new();
        for point in std::mem::take(&mut wider) {
            let region = surface.region_of(lattice.voxel(point.position), level);
            let group = regions.entry(region.min);
            group.or_insert_with(|| (region, Vec::new())).1.push(point);
        }
        context.progress.stage(stage, Some(regions.len() as u64));
        // All balls up to half this radius were searched on the level before.
        let radius = h * f64::from(FIRST_LEVEL_RADIUS << level);
        let radii = SearchRadii {
            first: radius,
            max: radius,
        };
        for (region, sample_points) in regions.into_values() {
            let points = surface.around(region, FIRST_LEVEL_HALO << level, level)?;
            // The distance between points doubles with each level.
            let edge = BIN_EDGE_FACTOR * h * f64::from(1 << level);
            wider.extend(measure(points, &sample_points, edge, radii)?);
            context.progress.advance(1);
        }
    }
    Ok(found)
}

/// The balls at some points of a surface, searched among `points` in cubes of the given edge, world units.
fn balls(
    context: StageContext,
    points: Vec<SurfacePoint>,
    edge: f64,
    sample_points: &[SurfacePoint],
    radii: SearchRadii,
) -> Result<Vec<TouchingBall>, RunError> {
    if sample_points.is_empty() {
        return Ok(Vec::new());
    }
    let all = || {
        let bins = Bins::new(points, edge);
        let sample_points = sample_points.par_iter().with_min_len(64);
        let balls = sample_points.map(|point| {
            if context.progress.cancelled() {
                return Err(Cancelled);
            }
            Ok(ball_at(*point, &bins, radii))
        });
        balls.collect::<Result<_, _>>()
    };
    Ok(context.threads.install(all)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::{Silent, Threads};
    use crate::recipe::Recipe;

    fn least(mesh: &TriMesh) -> Wall {
        let text =
            "druse = 1\n[band]\nvoxel_size = 0.1\n[[op]]\nunion = { sphere = { radius = 1 } }\n";
        let recipe = Recipe::parse(text, &[]).unwrap();
        let threads = Threads::new(1).unwrap();
        let solid = SolidGeometry {
            lattice: VoxelLattice {
                origin: Vec3::zeros(),
                voxel_size: 0.1,
            },
            // So many that one point of twenty is sampled.
            active_voxels: 1_600_000,
            extent: 10.0 * mesh.bounds().size().max(),
        };
        let context = StageContext::new(&recipe, &threads, &Silent);
        let walls = sampled_walls(context, mesh, solid, Phase::Solid).unwrap();
        walls.least().unwrap()
    }

    /// A box of `size` whose faces are n x n grids of quads.
    fn grid_box(size: Vec3, n: u32) -> TriMesh {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for axis in 0..3 {
            for side in [0.0, 1.0] {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let start = vertices.len() as u32;
                for i in 0..=n {
                    for j in 0..=n {
                        let mut p = Vec3::zeros();
                        p[axis] = side * size[axis];
                        p[u] = f64::from(i) / f64::from(n) * size[u];
                        p[v] = f64::from(j) / f64::from(n) * size[v];
                        vertices.push(p);
                    }
                }
                for i in 0..n {
                    for j in 0..n {
                        let at = |i, j| start + i * (n + 1) + j;
                        let quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                        let [a, b, c, d] = quad;
                        if side == 1.0 {
                            triangles.extend([[a, b, c], [a, c, d]]);
                        } else {
                            triangles.extend([[a, c, b], [a, d, c]]);
                        }
                    }
                }
            }
        }
        TriMesh::new(vertices, triangles).unwrap().merged()
    }

    #[test]
    fn a_plate_is_as_thick_as_its_least_edge() {
        let mesh = grid_box(Vec3::new(4.0, 4.0, 1.0), 40);
        assert!((mesh.volume() - 16.0).abs() < 1e-9);
        let wall = least(&mesh);
        assert!((wall.thickness - 1.0).abs() < 0.02, "{wall:?}");
        assert!((wall.centre.z - 0.5).abs() < 0.02);
    }

    #[test]
    fn a_ball_is_as_thick_as_its_diameter() {
        let mesh = TriMesh::ball(Vec3::new(1.0, 2.0, 3.0), 2.0, 5);
        let wall = least(&mesh);
        assert!((wall.thickness - 4.0).abs() < 0.05, "{wall:?}");
        assert!((wall.centre - Vec3::new(1.0, 2.0, 3.0)).norm() < 0.1);
    }
}
