//! The full local thickness of a solid, anywhere near it: the diameter of the ball within it that touches
//! its surface at the nearest place where one was measured.
//!
//! The balls are those of [`super::least_wall`]. Up to a radius of [`WIDEST`] voxels they are looked for among
//! all points of the surface, wider ones among ever fewer: where the radius doubles, three of four points
//! are left out, so that a ball is told by about as many. Those lie no farther apart than a fifth of its
//! radius r, and between points s apart a ball sinks in by s^2 / (8 r): half a hundredth of it.
//!
//! A solid larger than memory is measured region by region, each with what is around it. No number
//! depends on the regions or on the order of points: which of them count is told by their voxels, of
//! points that are equally near the same one is taken, and every point knows the whole normal.

use super::error::RunError;
use super::least_wall::{BIN_EDGES, Ball, Phase, Sampled, SurfacePoint, Wall, ball_at};
use super::level_set_ops::Bench;
use super::nearest::{Site, Sites};
use super::spatial_bins::Bins;
use crate::band::Region;
use crate::frame::{Coord, Vec3};
use crate::mesh::TriMesh;
use crate::progress::Cancelled;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Places at which it is measured, about, if the surface has more points.
pub(super) const PLACES: f64 = 400_000.0;
/// Radius, voxels, of the widest balls that are looked for among all points.
const WIDEST: i32 = 16;
/// The last level: of balls wider than any part that files hold.
pub(super) const LAST: u32 = 20;
/// Samples from which the least wall is told: a percentile needs no more.
const SAMPLES: f64 = 20_000.0;
/// Voxels around a region of which its balls of the first level may hear.
pub(super) const HALO: i32 = 2 * WIDEST;
/// A vertex on an edge of voxels may seem to lie this much below it, voxels, by rounding; along its edge it
/// keeps farther from the ends.
const ROUNDED: f64 = 1e-5;

/// A surface whose points are asked for region by region.
pub(super) trait Surface {
    /// Regions that together are all of it.
    fn regions(&self) -> Vec<Region>;

    /// A region around a voxel that is good to look at at once on a level.
    fn region_of(&self, voxel: Coord, level: u32) -> Region;

    /// The points of a level in a region and so many voxels around it.
    ///
    /// # Errors
    /// What reading or meshing refuses.
    fn around(&self, region: Region, halo: i32, level: u32) -> Result<Vec<SurfacePoint>, RunError>;
}

/// Where the voxels of a surface's points are.
#[derive(Clone, Copy)]
pub(super) struct Lattice {
    /// World position of voxel (0, 0, 0).
    pub origin: Vec3,
    pub voxel_size: f64,
}

impl Lattice {
    /// The voxel at which the edge of a vertex begins.
    pub fn voxel(&self, vertex: Vec3) -> Coord {
        let index = (vertex - self.origin) / self.voxel_size;
        Coord(index.map(|c| (c + ROUNDED).floor() as i32).into())
    }

    /// Whether a vertex is a point of a level.
    pub fn keeps(&self, vertex: Vec3, level: u32) -> bool {
        level == 0 || rank(self.voxel(vertex)) <= u64::MAX >> (2 * level).min(63)
    }
}

/// A number of a voxel that is spread evenly, along surfaces as well: the Kronecker sequence of the powers
/// of 1 / g where g^4 = g + 1.
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
struct Whole<'a> {
    mesh: &'a TriMesh,
    /// Its vertices' normals.
    outward: Vec<Vec3>,
    lattice: Lattice,
}

impl<'a> Whole<'a> {
    fn new(mesh: &'a TriMesh, lattice: Lattice, phase: Phase) -> Self {
        Self {
            mesh,
            outward: phase.outward(mesh.vertex_normals_by_area()),
            lattice,
        }
    }
}

impl Surface for Whole<'_> {
    fn regions(&self) -> Vec<Region> {
        vec![Region::EVERYWHERE]
    }

    fn region_of(&self, _: Coord, _: u32) -> Region {
        Region::EVERYWHERE
    }

    fn around(&self, _: Region, _: i32, level: u32) -> Result<Vec<SurfacePoint>, RunError> {
        let all = self.mesh.vertices().par_iter().zip(&self.outward);
        let all = all.with_min_len(1 << 12).map(|(&place, &outward)| Site {
            place,
            tag: -outward,
        });
        if level == 0 {
            // Unfiltered they take no more room than they need.
            return Ok(all.collect());
        }
        Ok(all.filter(|p| self.lattice.keeps(p.place, level)).collect())
    }
}

/// The solid whose thickness is measured.
#[derive(Clone, Copy)]
pub(super) struct Measured {
    pub lattice: Lattice,
    /// Of its band.
    pub active_voxels: u64,
    /// Voxels along its longest side.
    pub extent: f64,
}

/// The thickness at places on a surface.
pub(super) struct Thickness(Sites<f32>);

impl Thickness {
    /// Measures it over the closed mesh of a solid in memory.
    pub fn of_mesh(bench: Bench, mesh: &TriMesh, solid: Measured) -> Result<Self, RunError> {
        let surface = Whole::new(mesh, solid.lattice, Phase::Solid);
        Self::new(bench, &surface, solid)
    }

    /// Measures it.
    pub fn new(bench: Bench, surface: &impl Surface, solid: Measured) -> Result<Self, RunError> {
        let walls = walls(bench, ("thickness", PLACES), surface, solid)?.into_iter();
        let sites = walls.map(|(place, wall)| Site {
            place,
            tag: wall.thickness as f32,
        });
        Ok(Self(Sites::new(sites.collect())))
    }

    /// In the unit of the solid; 0 if no ball is inscribed anywhere.
    pub fn at(&self, p: Vec3) -> f32 {
        let nearest = self.0.nearest_within(p, f64::INFINITY, |_| true);
        nearest.map_or(0.0, |site| site.tag)
    }
}

/// Inscribed balls of one phase over the closed mesh of a solid in memory, enough to tell percentiles.
pub(super) fn sampled_walls(
    bench: Bench,
    mesh: &TriMesh,
    solid: Measured,
    phase: Phase,
) -> Result<Sampled, RunError> {
    let surface = Whole::new(mesh, solid.lattice, phase);
    let walls = walls(bench, (phase.stage(), SAMPLES), &surface, solid)?;
    let walls = walls.into_iter().map(|(_, wall)| wall);
    Ok(Sampled::of(walls.collect()))
}

/// Inscribed balls at places on a surface, about so many if it has more points.
fn walls(
    bench: Bench,
    (stage, most): (&str, f64),
    surface: &impl Surface,
    solid: Measured,
) -> Result<Vec<(Vec3, Wall)>, RunError> {
    let Measured {
        lattice,
        active_voxels,
        extent,
    } = solid;
    // A unit of area crosses 1.5 edges of voxels in the mean, and has a band of both half widths.
    let points = 1.5 * active_voxels as f64 / (2.0 * bench.half_width);
    let each = (points / most).ceil().max(1.0) as u64;
    let h = lattice.voxel_size;
    let mut found = Vec::new();
    let mut wider: Vec<SurfacePoint> = Vec::new();
    let mut look = |points, places: &[SurfacePoint], edge: f64, radii: [f64; 2]| {
        let mut wider = Vec::new();
        let balls = balls(bench, (points, edge), places, radii)?;
        for (place, ball) in places.iter().zip(balls) {
            match ball {
                Ball::Inscribed(wall) => found.push((place.place, wall)),
                Ball::Wider => wider.push(*place),
                Ball::Pierced => {}
            }
        }
        Ok::<_, RunError>(wider)
    };
    let regions = surface.regions();
    bench.progress.stage(stage, Some(regions.len() as u64));
    for region in regions {
        let points = surface.around(region, HALO, 0)?;
        let is_place = |p: &&SurfacePoint| {
            let voxel = lattice.voxel(p.place);
            region.meets(voxel, 1) && rank(voxel) <= u64::MAX / each
        };
        let places = || points.par_iter().with_min_len(1 << 12).filter(is_place);
        let places: Vec<SurfacePoint> = bench.threads.install(|| places().copied().collect());
        let radii = [h, h * f64::from(WIDEST)];
        wider.extend(look(points, &places, BIN_EDGES * h, radii)?);
        bench.progress.advance(1);
    }
    let mut level = 0;
    // No ball within it is as wide as the solid is long.
    while !wider.is_empty() && level < LAST && f64::from(WIDEST << level) < 2.0 * extent {
        level += 1;
        let mut regions: BTreeMap<Coord, (Region, Vec<SurfacePoint>)> = BTreeMap::new();
        for place in std::mem::take(&mut wider) {
            let region = surface.region_of(lattice.voxel(place.place), level);
            let group = regions.entry(region.min);
            group.or_insert_with(|| (region, Vec::new())).1.push(place);
        }
        bench.progress.stage(stage, Some(regions.len() as u64));
        let radius = h * f64::from(WIDEST << level);
        for (region, places) in regions.into_values() {
            let points = surface.around(region, HALO << level, level)?;
            // Of points ever farther apart.
            let edge = BIN_EDGES * h * f64::from(1 << level);
            wider.extend(look(points, &places, edge, [radius; 2])?);
            bench.progress.advance(1);
        }
    }
    Ok(found)
}

/// The balls at places, with radii from the first to the second, among the points of a surface, which are
/// looked up in cubes of an edge.
fn balls(
    bench: Bench,
    (points, edge): (Vec<SurfacePoint>, f64),
    places: &[SurfacePoint],
    radii: [f64; 2],
) -> Result<Vec<Ball>, RunError> {
    if places.is_empty() {
        return Ok(Vec::new());
    }
    let all = || {
        let near = Bins::new(points, edge);
        let places = places.par_iter().with_min_len(64);
        let balls = places.map(|place| {
            if bench.progress.cancelled() {
                return Err(Cancelled);
            }
            Ok(ball_at(*place, &near, radii))
        });
        balls.collect::<Result<_, _>>()
    };
    Ok(bench.threads.install(all)?)
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
        let solid = Measured {
            lattice: Lattice {
                origin: Vec3::zeros(),
                voxel_size: 0.1,
            },
            active_voxels: 0,
            extent: 10.0 * mesh.bounds().size().max(),
        };
        let bench = Bench::new(&recipe, &threads, &Silent);
        let walls = sampled_walls(bench, mesh, solid, Phase::Solid).unwrap();
        walls.least().unwrap()
    }

    /// A box of `size`, each face an n x n grid of quads.
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
        let mesh = grid_box(Vec3::new(10.0, 10.0, 1.0), 100);
        assert!((mesh.volume() - 100.0).abs() < 1e-9);
        let wall = least(&mesh);
        assert!((wall.thickness - 1.0).abs() < 0.02, "{wall:?}");
        assert!((wall.place.z - 0.5).abs() < 0.02);
    }

    #[test]
    fn a_ball_is_as_thick_as_its_diameter() {
        let mesh = TriMesh::ball(Vec3::new(1.0, 2.0, 3.0), 2.0, 5);
        let wall = least(&mesh);
        assert!((wall.thickness - 4.0).abs() < 0.05, "{wall:?}");
        assert!((wall.place - Vec3::new(1.0, 2.0, 3.0)).norm() < 0.1);
    }
}
