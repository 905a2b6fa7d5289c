//! The signed distance to another field's zero set, at any point, from points of that surface.
//!
//! The source field is sampled on the voxel lattice in a thin band around its zero set. Distances are those of
//! [`SurfacePoints`], so they are true distances up to `reach`, whatever the source's values are. Samples are made on
//! demand in blocks of [`BLOCK_EDGE`] voxels. The points of the surface in a block are found on demand too, from the
//! samples in it and one leaf around it. A block of distances uses all points within reach of its voxels, and all
//! blocks share one lattice. So values depend neither on which blocks are kept nor on threads nor on bricks.
//!
//! phi < 0 where the source is negative. Lengths are in world units.

use super::super::cull::Culler;
use super::super::evaluate::batch_values;
use super::super::leaf::{LEAF, VOXELS};
use super::super::smooth::LeafRef;
use super::super::{Band, Region};
use super::cache::{PositionCache, SharedValue};
use super::{LeafPoints, SurfacePoints};
use druse_geometry::field::{Field, Interval, LeafBits, SampleLattice, WorldField};
use druse_geometry::frame::{Aabb, Coord, Transform, Vec3, WorldPoint};
use std::collections::HashMap;
use std::sync::OnceLock;

/// Voxels along the edge of a block.
const BLOCK_EDGE: i32 = 64;
/// Half width in voxels of the sampled band: what the stencils of surface points need.
const BAND_HALF_WIDTH: f64 = 3.0;
/// Leaves that are evaluated at once, at most the 32 of `batch_values`.
const LEAVES_AT_ONCE: usize = 32;
/// Leaves along the edge of a block.
const LEAVES_PER_EDGE: i32 = BLOCK_EDGE / LEAF;
/// Blocks of each kind kept per thread, whatever their memory: a block and its neighbours.
const KEPT_PER_THREAD: usize = 27;
/// Memory limit of each kind beyond that, bytes.
const MAX_CACHE_BYTES: usize = 64 << 20;

/// The distance to the zero set of a field, clamped to a reach.
pub struct ClosestPointField<'a> {
    source: Box<WorldField<'a>>,
    bounds: Box<WorldField<'a>>,
    /// The solid within which distances are requested.
    region_of_interest: Option<Box<WorldField<'a>>>,
    transform: Transform,
    reach: f64,
    samples: PositionCache<Option<Samples>>,
    points: PositionCache<Option<Vec<LeafPoints>>>,
    blocks: PositionCache<Option<Block>>,
}

/// The source's values in the leaves of a block that its zero set may cross.
#[derive(Default)]
struct Samples {
    leaves: Vec<SampledLeaf>,
    values: Vec<[f32; VOXELS]>,
}

/// A leaf with the signs of the source's values in it.
struct SampledLeaf {
    origin: Coord,
    /// Inside voxels.
    inside: [u64; 8],
    /// Voxels within the band, and the number of the values; none for a leaf without such voxels.
    band: Option<([u64; 8], usize)>,
}

/// Points of the surface around a block, and the signs of its leaves.
struct Block {
    surface: SurfacePoints,
    /// Inside voxels of the evaluated leaves.
    inside: HashMap<Coord, [u64; 8]>,
    /// Distances of the block's own leaves, made on demand; z fastest.
    leaves: Vec<OnceLock<Box<[f32; VOXELS]>>>,
}

impl Block {
    /// Memory that it takes, bytes.
    fn bytes(&self) -> usize {
        let made = self.leaves.iter().filter(|leaf| leaf.get().is_some());
        self.surface.bytes()
            + made.count() * size_of::<[f32; VOXELS]>()
            + self.inside.len() * 2 * size_of::<[u64; 8]>()
    }
}

impl Samples {
    /// Memory that they take, bytes.
    fn bytes(&self) -> usize {
        self.values.len() * size_of::<[f32; VOXELS]>()
            + self.leaves.len() * size_of::<SampledLeaf>()
    }
}

impl<'a> ClosestPointField<'a> {
    /// Memory that kept blocks take, bytes: those of three kinds, and what is being made; blocks kept for each thread
    /// may take more.
    pub const BYTES_KEPT: usize = 4 * MAX_CACHE_BYTES;

    /// The distance to the zero set of `source`, which needs to be accurate within three voxels only. `bounds` is
    /// a field with the same zero set whose bounds hold as far as `reach`.
    pub fn new(
        source: Box<WorldField<'a>>,
        bounds: Box<WorldField<'a>>,
        transform: Transform,
        reach: f64,
    ) -> Self {
        Self {
            source,
            bounds,
            region_of_interest: None,
            transform,
            reach,
            samples: PositionCache::new(KEPT_PER_THREAD, MAX_CACHE_BYTES, |samples| {
                samples.as_ref().map_or(0, Samples::bytes)
            }),
            points: PositionCache::new(KEPT_PER_THREAD, MAX_CACHE_BYTES, |points| {
                let leaves = points.iter().flatten();
                leaves.map(LeafPoints::bytes).sum()
            }),
            blocks: PositionCache::new(KEPT_PER_THREAD, MAX_CACHE_BYTES, |block| {
                block.as_ref().map_or(0, Block::bytes)
            }),
        }
    }

    /// Requests distances only within a solid and the reach around it: points of the surface farther outside
    /// are omitted.
    #[must_use]
    pub fn near(self, region: Box<WorldField<'a>>) -> Self {
        Self {
            region_of_interest: Some(region),
            ..self
        }
    }

    /// Whether a cube may be within reach of the solid in which distances are requested.
    fn is_requested(&self, cube: Region) -> bool {
        let corners = [cube.min, cube.max].map(|c| self.transform.world(c).0);
        let is_far = |region: &WorldField<'a>| region.bound(&Aabb::of(corners)).lo > self.reach;
        !self.region_of_interest.as_deref().is_some_and(is_far)
    }

    /// The block of points whose first voxel is `origin`, a multiple of [`BLOCK_EDGE`]; `None` where the source has a
    /// value that is not finite or a voxel beyond the range of indices.
    fn block(&self, origin: Coord) -> SharedValue<Option<Block>> {
        self.blocks.get(origin, || self.make_block(origin))
    }

    /// Samples the source in the block whose first voxel is `origin`. `None` where a value is not finite, or where the
    /// block lies beyond the range of voxel indices; distances of all points that need the block are then NaN. A block
    /// that is not requested has no leaves.
    fn sample(&self, origin: Coord) -> Option<Samples> {
        let region = Region::cube(origin, BLOCK_EDGE);
        let mut samples = Samples::default();
        if !self.is_requested(region) {
            return Some(samples);
        }
        let band = Band {
            field: &*self.source,
            transform: self.transform,
            half_width: BAND_HALF_WIDTH,
            extent: Aabb::of([region.min, region.max].map(|c| self.transform.world(c).0)),
        };
        // Only leaves whose bounds admit a zero or a value in the band are evaluated; the others are wholly inside or
        // outside and are left out.
        let culler = Culler::new(&band, region).ok()?;
        let mut leaves: Vec<Coord> = Vec::new();
        for block in culler.blocks().undecided {
            leaves.extend(culler.leaves(block).undecided);
        }
        leaves.retain(|&leaf| self.is_requested(Region::cube(leaf, LEAF)));
        let mut buffer = vec![[0.0; VOXELS]; LEAVES_AT_ONCE];
        for group in leaves.chunks(LEAVES_AT_ONCE) {
            let mut bits = [LeafBits::default(); LEAVES_AT_ONCE];
            let (buffer, bits) = (&mut buffer[..group.len()], &mut bits[..group.len()]);
            batch_values(&culler, group, buffer, bits).ok()?;
            // Values are contiguous; leaves out of the band have none.
            let mut own = buffer.iter();
            for (&origin, bits) in group.iter().zip(bits) {
                let leaf = if bits.is_out() {
                    SampledLeaf {
                        origin,
                        // All voxels of such a leaf have the sign of the first one: its bit is spread over all 512.
                        inside: [(bits.negative[0] & 1).wrapping_neg(); 8],
                        band: None,
                    }
                } else {
                    samples.values.push(*own.next()?);
                    SampledLeaf {
                        origin,
                        inside: bits.negative,
                        band: Some((bits.within, samples.values.len() - 1)),
                    }
                };
                samples.leaves.push(leaf);
            }
        }
        Some(samples)
    }

    /// The blocks of samples that a region meets.
    fn samples_in(&self, region: Region) -> Vec<SharedValue<Option<Samples>>> {
        let blocks = region.cubes(BLOCK_EDGE);
        let made = blocks.map(|o| self.samples.get(o, || self.sample(o)));
        made.collect()
    }

    /// The points of the surface in the leaves of a block. `None` where a value around it is not finite, or beyond the
    /// range of voxel indices.
    fn points_in(&self, origin: Coord) -> Option<Vec<LeafPoints>> {
        let own = Region::cube(origin, BLOCK_EDGE);
        let around = own.grown(LEAF);
        // Points of the block's own leaves depend on voxels of the leaves around them.
        let samples = self.samples_in(around);
        let mut found: Vec<LeafRef<'_>> = Vec::new();
        for samples in &samples {
            let samples = samples.get()?.as_ref()?;
            let banded = samples.leaves.iter().filter_map(|leaf| {
                let (mask, number) = leaf.band?;
                around.meets(leaf.origin, LEAF).then_some(LeafRef {
                    origin: leaf.origin,
                    mask,
                    values: &samples.values[number],
                })
            });
            found.extend(banded);
        }
        found.sort_unstable_by_key(|leaf| leaf.origin);
        let h = self.transform.voxel_size();
        Some(SurfacePoints::of_leaves(
            found.len(),
            |n| found[n],
            |leaf| own.meets(leaf, LEAF),
            h,
            (BAND_HALF_WIDTH * h) as f32,
        ))
    }

    /// The points of the surface within reach of a block. `None` as in [`Self::points_in`]. `inside` has the leaves of
    /// the block only; the distances of its leaves follow when they are needed.
    fn make_block(&self, origin: Coord) -> Option<Block> {
        let h = self.transform.voxel_size();
        let own = Region::cube(origin, BLOCK_EDGE);
        let mut inside = HashMap::new();
        for samples in self.samples_in(own) {
            let leaves = samples.get()?.as_ref()?.leaves.iter();
            inside.extend(leaves.map(|leaf| (leaf.origin, leaf.inside)));
        }
        // A crossing lies up to a voxel beyond its leaf, and a corner farther.
        let reach =
            own.grown((self.reach / h + 1.0 + SurfacePoints::MAX_CORNER_OFFSET).ceil() as i32);
        let mut found: Vec<LeafPoints> = Vec::new();
        for block in reach.cubes(BLOCK_EDGE) {
            let points = self.points.get(block, || self.points_in(block));
            let leaves = points.get()?.as_ref()?.iter();
            found.extend(
                leaves
                    .filter(|leaf| reach.meets(leaf.origin, LEAF))
                    .cloned(),
            );
        }
        found.sort_unstable_by_key(|leaf| leaf.origin);
        let surface = SurfacePoints::joined(found, h as f32, self.reach as f32);
        let count = LEAVES_PER_EDGE.pow(3) as usize;
        Some(Block {
            surface,
            inside,
            leaves: std::iter::repeat_with(OnceLock::new).take(count).collect(),
        })
    }

    /// Hands the distances of the leaf at an origin to `take`; `None` where the source has no finite value.
    fn with_leaf<T>(&self, origin: Coord, take: impl FnOnce(&[f32; VOXELS]) -> T) -> Option<T> {
        let block_origin = origin.aligned(BLOCK_EDGE);
        let block = self.block(block_origin);
        let block = block.get()?.as_ref()?;
        let [x, y, z] = [0, 1, 2].map(|a| (origin[a] - block_origin[a]) / LEAF);
        let number = (x * LEAVES_PER_EDGE + y) * LEAVES_PER_EDGE + z;
        let leaf = block.leaves[number as usize].get_or_init(|| {
            let inside = block.inside.get(&origin).copied();
            let inside = inside.unwrap_or_else(|| {
                let first = self.source.value(self.transform.world(origin));
                [if first < 0.0 { u64::MAX } else { 0 }; 8]
            });
            Box::new(block.surface.moved(origin, &inside, 0.0).values)
        });
        Some(take(leaf))
    }

    /// The first voxel of a lattice whose samples are voxels; `None` for others.
    fn first_voxel(&self, lattice: &SampleLattice<WorldPoint>) -> Option<Coord> {
        let h = self.transform.voxel_size();
        let voxel = Coord((lattice.origin.0 / h).map(|c| c.round() as i32).into());
        // Within a millionth of a voxel a sample counts as the voxel.
        let is_voxel = (self.transform.world(voxel).0 - lattice.origin.0).amax() <= 1e-6 * h;
        (is_voxel && (lattice.step - h).abs() <= 1e-9 * h).then_some(voxel)
    }

    /// The unsigned distance at a point and the direction away from the surface; `None` beyond the reach, NaN where the
    /// block has no points because of a value that is not finite.
    fn nearest(&self, p: WorldPoint) -> Option<(f64, Vec3)> {
        let h = self.transform.voxel_size();
        let voxel = p.0 / h;
        let origin = Coord(voxel.map(|c| c.floor() as i32).into()).aligned(LEAF);
        let block = self.block(origin.aligned(BLOCK_EDGE));
        let Some(Some(block)) = block.get() else {
            return Some((f64::NAN, Vec3::repeat(f64::NAN)));
        };
        let place = voxel - Vec3::from(origin.0.map(f64::from));
        let (distance, away) = block.surface.distance(origin, place)?;
        let distance = distance * h;
        (distance < self.reach).then_some((distance, away))
    }
}

impl Field for ClosestPointField<'_> {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        let distance = self.nearest(p).map_or(self.reach, |found| found.0);
        distance.copysign(self.source.value(p))
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let value = self.source.value(p);
        match self.nearest(p) {
            Some((distance, away)) => {
                let sign = 1f64.copysign(value);
                (sign * distance, away * sign)
            }
            None => (self.reach.copysign(value), Vec3::zeros()),
        }
    }

    fn bound(&self, region: &Aabb) -> Interval {
        clamped(self.bounds.bound(region), self.reach)
    }

    fn bounds(&self, regions: &[Aabb; 8]) -> Option<[Interval; 8]> {
        let all = self.bounds.bounds(regions)?;
        Some(all.map(|b| clamped(b, self.reach)))
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        // Samples off the voxel lattice are evaluated one by one.
        let Some(first) = self.first_voxel(lattice) else {
            for (n, v) in out.iter_mut().enumerate() {
                *v = self.value(lattice.point(n)) as f32;
            }
            return;
        };
        let [nx, ny, nz] = lattice.counts.map(|n| n as i32);
        let region = Region {
            min: first,
            max: first.offset(nx - 1, ny - 1, nz - 1),
        };
        out.fill(f32::NAN);
        // Rows of each leaf's cached values are copied to the lattice; NaN stays where the source is not finite.
        for origin in region.cubes(LEAF) {
            let part = region.common(Region::cube(origin, LEAF));
            self.with_leaf(origin, |leaf| {
                for x in part.min[0]..=part.max[0] {
                    for y in part.min[1]..=part.max[1] {
                        let row = ((x - first[0]) * ny + (y - first[1])) * nz;
                        let to = (row + part.min[2] - first[2]) as usize;
                        let own = ((x - origin[0]) << 6 | (y - origin[1]) << 3) as usize;
                        let from = own + (part.min[2] - origin[2]) as usize;
                        let count = (part.max[2] - part.min[2] + 1) as usize;
                        out[to..to + count].copy_from_slice(&leaf[from..from + count]);
                    }
                }
            });
        }
    }
}

/// The bound of a distance clamped to a reach, from a bound of the other field.
fn clamped(bound: Interval, reach: f64) -> Interval {
    if bound.lo >= reach {
        Interval::new(reach, reach)
    } else if bound.hi <= -reach {
        Interval::new(-reach, -reach)
    } else if bound.lo > 0.0 {
        Interval::new(0.0, reach)
    } else if bound.hi < 0.0 {
        Interval::new(-reach, 0.0)
    } else {
        Interval::new(-reach, reach)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use druse_geometry::field::Sphere;

    /// A ball whose values are not distances, so that only its zero set counts.
    struct Cubic(Sphere);

    impl Field for Cubic {
        type Point = WorldPoint;
        fn value(&self, p: WorldPoint) -> f64 {
            let d = self.0.value(p);
            d + 0.02 * d * d * d
        }
        fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
            let (d, g) = self.0.value_and_gradient(p);
            (d + 0.02 * d * d * d, g * (1.0 + 0.06 * d * d))
        }
        fn bound(&self, region: &Aabb) -> Interval {
            self.0.bound(region)
        }
    }

    fn field() -> (Sphere, ClosestPointField<'static>) {
        let ball = Sphere {
            centre: Vec3::new(0.3, -0.2, 0.1),
            radius: 20.0,
        };
        let h = Transform::new(1.0).unwrap();
        let made = ClosestPointField::new(Box::new(Cubic(ball)), Box::new(ball), h, 9.0);
        (ball, made)
    }

    #[test]
    fn leaves_and_points_have_the_true_distance() {
        let (ball, field) = field();
        let mut count = 0;
        for origin in [[8, 8, 0], [16, 0, 0], [8, 8, 8], [-24, 0, 8], [0, 24, 0]] {
            let lattice = SampleLattice {
                origin: WorldPoint(Vec3::from(origin.map(f64::from))),
                step: 1.0,
                counts: [8; 3],
            };
            let mut values = [0.0; 512];
            field.fill(&lattice, &mut values);
            for (n, v) in values.iter().enumerate() {
                let p = lattice.point(n);
                let d = ball.value(p).clamp(-9.0, 9.0);
                assert!((f64::from(*v) - d).abs() < 0.02, "{p:?}: {v} for {d}");
                assert!((field.value(p) - d).abs() < 0.02, "{p:?}");
                count += usize::from(d.abs() < 9.0);
            }
        }
        assert!(count > 1000);
    }

    #[test]
    fn gradients_point_away_from_the_surface() {
        let (ball, field) = field();
        for p in [[17.3, 2.1, 1.4], [3.3, 25.2, 4.4], [-8.0, -9.5, 8.25]] {
            let p = WorldPoint(Vec3::from(p));
            let (v, g) = field.value_and_gradient(p);
            let (d, expected) = ball.value_and_gradient(p);
            assert!(
                (v - d).abs() < 0.02 && (g - expected).norm() < 0.02,
                "{p:?}: {g:?}"
            );
        }
    }
}
