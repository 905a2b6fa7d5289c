//! Culling: aligned cubes are halved while the field's bound cannot exclude them from the band.
//!
//! Only a bound decides: no sample is evaluated here. What cannot be decided stays undecided, so that the result holds
//! every active voxel. The layer around a cube is bounded too, since a voxel may be active because of its neighbours.

use super::{BLOCK, Band, BandError, LEAF, Region, VOXELS};
use druse_geometry::field::{Interval, LeafParts, ValueLimits, WorldField};
use druse_geometry::frame::{Aabb, Coord, Transform};

/// Edge of the cubes of 4^3 leaves that a field may classify in one call
/// ([`Field::sides`](druse_geometry::field::Field::sides)).
const LEAF_CUBE_EDGE: i32 = 4 * LEAF;
/// Leaves along a block's edge.
const BLOCK_EDGE_LEAVES: i32 = BLOCK / LEAF;
/// Bound of the voxel indices; leaves room for neighbours and for the doubling of a cube.
const MAX_INDEX: f64 = (1 << 29) as f64;

/// The side of the band on which a cube of samples and the layer around it lie.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    /// Every value is at most minus the half width.
    Inside,
    /// Every value is at least the half width.
    Outside,
    /// The cube may meet the band.
    Unknown,
}

/// Leaves of a block on which the batch test runs in any case.
const BATCH_TEST_MIN_TRIALS: u32 = 64;
/// Above this number of trials per decided leaf, the final test alone takes less time.
const BATCH_TEST_MAX_TRIALS_PER_HIT: u32 = 6;
/// The batch test then runs for one in this many cubes, since another part of the block may differ.
const BATCH_TEST_RETRY_INTERVAL: u32 = 8;

/// Success statistics, within a block, of the batch test: one bound for each of the eight leaves of a
/// cube, before the final test of single leaves.
#[derive(Clone, Copy, Default)]
struct BatchTestStats {
    /// Leaves tested.
    trials: u32,
    /// Leaves that the test decided.
    hits: u32,
    /// Cubes for which the test was considered.
    cubes: u32,
}

impl BatchTestStats {
    fn record(&mut self, side: Side) {
        self.trials += 1;
        self.hits += u32::from(side != Side::Unknown);
    }

    fn should_run(&mut self) -> bool {
        self.cubes += 1;
        let pays_off = self.trials < BATCH_TEST_MIN_TRIALS
            || BATCH_TEST_MAX_TRIALS_PER_HIT * self.hits >= self.trials;
        pays_off || self.cubes.is_multiple_of(BATCH_TEST_RETRY_INTERVAL)
    }
}

/// The cubes that a halving ends at. Cubes outside are left out.
#[derive(Default)]
pub(super) struct CubeClassification {
    /// Cubes of the smallest edge that may hold active voxels, sorted by origin.
    pub undecided: Vec<Coord>,
    /// Cubes, of any edge up to a block's, that lie inside and hold no active voxel: origin, edge.
    pub inside: Vec<(Coord, i32)>,
    batch_test: BatchTestStats,
}

/// The culling of one band.
pub(super) struct Culler<'a> {
    pub field: &'a WorldField<'a>,
    pub transform: Transform,
    /// Half width in world units.
    pub background: f64,
    /// Values beyond the band are clamped to it: the limits of a leaf's samples, and of those of a layer of 8^2 beside it.
    pub leaf_limits: ValueLimits,
    pub layer_limits: ValueLimits,
    /// Least and greatest voxel of the range to evaluate.
    range: [Coord; 2],
}

impl<'a> Culler<'a> {
    /// A culler over the voxels of a region within the half width and one voxel of the extent. `region` limits the
    /// voxels further.
    ///
    /// # Errors
    /// [`BandError::HalfWidth`] if it is below 1 voxel or not finite, [`BandError::Extent`] for an empty extent or one
    /// beyond the range of indices.
    pub fn new(band: &Band<'a>, region: Region) -> Result<Self, BandError> {
        let Band {
            field,
            transform,
            half_width,
            extent,
        } = *band;
        if !(half_width.is_finite() && half_width >= 1.0) {
            return Err(BandError::HalfWidth(half_width));
        }
        // The half width and one voxel around the extent hold every active voxel.
        let h = transform.voxel_size();
        let low = (extent.min / h).map(|c| (c - half_width).floor() - 1.0);
        let high = (extent.max / h).map(|c| (c + half_width).ceil() + 1.0);
        let usable =
            (0..3).all(|a| low[a] <= high[a] && low[a].abs().max(high[a].abs()) < MAX_INDEX);
        if !usable || extent.is_empty() {
            return Err(BandError::Extent {
                extent,
                voxel_size: h,
            });
        }
        let index = |a: usize| {
            let least = (low[a] as i32).max(region.min[a]);
            (least, (high[a] as i32).min(region.max[a]))
        };
        let [x, y, z] = [index(0), index(1), index(2)];
        let background = half_width * h;
        let limits = |samples: usize| {
            ValueLimits::uniform(samples, [-(background as f32), background as f32])
        };
        Ok(Self {
            field,
            transform,
            background,
            leaf_limits: limits(VOXELS),
            layer_limits: limits((LEAF * LEAF) as usize),
            range: [Coord::new(x.0, y.0, z.0), Coord::new(x.1, y.1, z.1)],
        })
    }

    fn side_of(&self, bound: Interval) -> Side {
        if bound.lo >= self.background {
            Side::Outside
        } else if bound.hi <= -self.background {
            Side::Inside
        } else {
            Side::Unknown
        }
    }

    /// Whether a cube of `edge` voxels overlaps the range.
    fn meets(&self, origin: Coord, edge: i32) -> bool {
        (0..3).all(|a| origin[a] <= self.range[1][a] && origin[a] + edge > self.range[0][a])
    }

    /// The box of a cube's samples and of the layer around it.
    fn padded_box(&self, origin: Coord, edge: i32) -> Aabb {
        let h = self.transform.voxel_size();
        self.transform.sample_box(origin, edge).dilated(h)
    }

    /// The side of the cube of `edge` voxels at `origin`; `Outside` beyond the range.
    fn side(&self, origin: Coord, edge: i32) -> Side {
        if self.meets(origin, edge) {
            self.side_of(self.field.bound(&self.padded_box(origin, edge)))
        } else {
            Side::Outside
        }
    }

    /// The sides of the eight octants of a cube, if the field bounds them in one call.
    fn sides(&self, origin: Coord, half: i32) -> Option<[Side; 8]> {
        let octants = std::array::from_fn(|n| octant(origin, half, n));
        let bounds = self
            .field
            .bounds(&octants.map(|p| self.padded_box(p, half)))?;
        Some(std::array::from_fn(|n| {
            if self.meets(octants[n], half) {
                self.side_of(bounds[n])
            } else {
                Side::Outside
            }
        }))
    }

    /// The final test of a leaf: bounds of eight parts of 4^3 samples (5^3 with the layer around them) are
    /// sharper than one bound of the whole.
    fn leaf_side(&self, origin: Coord) -> Side {
        const HALF_EDGE: i32 = LEAF / 2;
        let boxes = |first: Coord, edge: i32| {
            std::array::from_fn(|n| self.transform.sample_box(octant(first, edge, n), edge))
        };
        let parts = LeafParts {
            own: boxes(origin, HALF_EDGE),
            wide: boxes(origin.offset(-1, -1, -1), HALF_EDGE + 1),
            step: self.transform.voxel_size(),
        };
        self.side_of(self.field.leaf_bound(&parts, self.background))
    }

    /// Halves a cube whose bound gave `side` down to cubes of `smallest` voxels that may be active; visits them in
    /// ascending Morton order. These, and the cubes inside of at most a block, are added to `cubes`.
    fn halve(
        &self,
        origin: Coord,
        edge: i32,
        mut side: Side,
        smallest: i32,
        cubes: &mut CubeClassification,
    ) {
        if side == Side::Unknown && edge == LEAF {
            side = self.leaf_side(origin);
        }
        // Cubes beyond the band end here: outside ones are dropped, inside ones are tiles once they fit in a block.
        match side {
            Side::Outside => return,
            Side::Inside if edge <= BLOCK => return cubes.inside.push((origin, edge)),
            Side::Unknown if edge == smallest => return cubes.undecided.push(origin),
            Side::Unknown
                if edge == LEAF_CUBE_EDGE
                    && smallest == LEAF
                    && self.classify_leaves(origin, cubes) =>
            {
                return;
            }
            _ => {}
        }
        // The test of eight leaves at once is left out where it seldom decides one; each is still tested alone.
        let half = edge / 2;
        let are_leaves = half == LEAF;
        let is_tested = !are_leaves || cubes.batch_test.should_run();
        let sides = is_tested.then(|| self.sides(origin, half)).flatten();
        for n in 0..8 {
            let origin = octant(origin, half, n);
            let side = match sides {
                Some(all) => all[n],
                None if is_tested => self.side(origin, half),
                None if self.meets(origin, half) => Side::Unknown,
                None => Side::Outside,
            };
            if are_leaves && is_tested {
                cubes.batch_test.record(side);
            }
            self.halve(origin, half, side, smallest, cubes);
        }
    }

    /// Classifies all leaves of a cube in one call of the field; false if the field cannot. It adds those that are
    /// undecided or inside to `cubes`.
    fn classify_leaves(&self, origin: Coord, cubes: &mut CubeClassification) -> bool {
        let first = self.transform.world(origin);
        let h = self.transform.voxel_size();
        let Some([inside, outside]) =
            self.field
                .sides(first, h, [-self.background, self.background])
        else {
            return false;
        };
        for half in 0..8 {
            let half_origin = octant(origin, LEAF_CUBE_EDGE / 2, half);
            // The bits of this octant's leaves; leaf (x, y, z) has bit 16 x + 4 y + z.
            let first = 32 * (half >> 2) + 8 * (half >> 1 & 1) + 2 * (half & 1);
            // The octant's eight leaves: two steps of 16 along x, of 4 along y and of 1 along z.
            let all = 0x0033_0033u64 << first;
            if outside & all == all {
                continue;
            }
            if inside & all == all && self.contains(half_origin, LEAF_CUBE_EDGE / 2) {
                cubes.inside.push((half_origin, LEAF_CUBE_EDGE / 2));
                continue;
            }
            for n in 0..8 {
                let bit = 1u64 << (first + 16 * (n >> 2) + 4 * (n >> 1 & 1) + (n & 1));
                let leaf = octant(half_origin, LEAF, n);
                if outside & bit != 0 || !self.meets(leaf, LEAF) {
                    continue;
                }
                if inside & bit == 0 {
                    cubes.undecided.push(leaf);
                } else {
                    cubes.inside.push((leaf, LEAF));
                }
            }
        }
        true
    }

    /// Whether all leaves of a cube overlap the range.
    fn contains(&self, origin: Coord, edge: i32) -> bool {
        let last = origin.offset(edge - LEAF, edge - LEAF, edge - LEAF);
        self.meets(origin, LEAF) && self.meets(last, LEAF)
    }

    /// Blocks that may hold active voxels, ascending, and those that lie inside.
    pub fn blocks(&self) -> CubeClassification {
        let size = (0..3)
            .map(|a| self.range[1][a] - self.range[0][a] + 1)
            .max()
            .unwrap_or(1);
        let mut cubes = CubeClassification::default();
        if (0..3).any(|a| self.range[0][a] > self.range[1][a]) {
            return cubes;
        }
        // The least power of two from a block on that covers the range; eight such cubes hold it, wherever it begins.
        let mut edge = BLOCK;
        while edge < size {
            edge *= 2;
        }
        let first = self.range[0].aligned(edge);
        for n in 0..8 {
            let origin = octant(first, edge, n);
            let side = self.side(origin, edge);
            self.halve(origin, edge, side, BLOCK, &mut cubes);
        }
        cubes.undecided.sort_unstable();
        cubes
    }

    /// Ascending leaves of a block that may hold active voxels, and its cubes that lie inside. `block` is its origin.
    pub fn leaves(&self, block: Coord) -> CubeClassification {
        let mut cubes = CubeClassification::default();
        let side = self.side(block, BLOCK);
        self.halve(block, BLOCK, side, LEAF, &mut cubes);
        // Sorts the leaves by a bit for each.
        let mut marks = [0u16; (BLOCK_EDGE_LEAVES * BLOCK_EDGE_LEAVES) as usize];
        for leaf in cubes.undecided.drain(..) {
            let [x, y, z] = [0, 1, 2].map(|a| (leaf[a] - block[a]) / LEAF);
            marks[(x * BLOCK_EDGE_LEAVES + y) as usize] |= 1 << z;
        }
        for (row, mut marks) in (0..).zip(marks) {
            while marks != 0 {
                let z = marks.trailing_zeros() as i32;
                marks &= marks - 1;
                let leaf = block.offset(
                    row / BLOCK_EDGE_LEAVES * LEAF,
                    row % BLOCK_EDGE_LEAVES * LEAF,
                    z * LEAF,
                );
                cubes.undecided.push(leaf);
            }
        }
        cubes
    }
}

/// Origin of octant `n` of a cube, in Morton order; `half` is the octant's edge.
fn octant(origin: Coord, half: i32, n: usize) -> Coord {
    let [x, y, z] = [4, 2, 1].map(|bit| if n & bit == 0 { 0 } else { half });
    origin.offset(x, y, z)
}
