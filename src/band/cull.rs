//! Which blocks and leaves can meet the band: halving of aligned cubes by the field's bound.

use super::{BLOCK, Band, BandError, LEAF, Region};
use crate::field::{Interval, LeafParts, WorldField};
use crate::frame::{Aabb, Coord, Transform};

/// Edge of the cubes whose leaves' sides are asked for at once.
const CUBE: i32 = 4 * LEAF;
/// Leaves along a block's edge.
const EDGE: i32 = BLOCK / LEAF;
/// The range of voxel indices in use; leaves room for neighbours and for doubling a cube.
const LARGEST_INDEX: f64 = (1 << 29) as f64;

/// What a bound says about a cube of samples; those of the layer around it have their sign.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    /// Every value is at most minus the half width.
    Inside,
    /// Every value is at least the half width.
    Outside,
    /// The band may be met.
    Unknown,
}

/// Leaves of a block that the first test of leaves is tried on, at least.
const TRIED: u32 = 64;
/// Where it decides fewer than one in so many, the last one alone takes less time.
const WORTH: u32 = 6;
/// It is then made for one in so many cubes, as the block may be another there.
const AGAIN: u32 = 8;

/// How often the first test of leaves has been made in a block, and how often it has decided.
#[derive(Clone, Copy, Default)]
struct Trial {
    made: u32,
    decided: u32,
    /// Cubes for which it might have been made.
    asked: u32,
}

impl Trial {
    fn note(&mut self, side: Side) {
        self.made += 1;
        self.decided += u32::from(side != Side::Unknown);
    }

    fn is_worth_it(&mut self) -> bool {
        self.asked += 1;
        let is_worth_it = self.made < TRIED || WORTH * self.decided >= self.made;
        is_worth_it || self.asked.is_multiple_of(AGAIN)
    }
}

/// What halving leaves of a cube.
#[derive(Default)]
pub(super) struct Sieve {
    /// Cubes of the smallest edge that may hold active voxels, sorted by origin.
    pub unknown: Vec<Coord>,
    /// Cubes of other edges, at most a block's, that lie inside and hold none.
    pub inside: Vec<(Coord, i32)>,
    /// Of leaves by eights.
    trial: Trial,
}

/// Culls for one band.
pub(super) struct Culler<'a> {
    pub field: &'a WorldField<'a>,
    pub transform: Transform,
    /// Half width in world units.
    pub background: f64,
    /// Least and greatest voxel of interest.
    range: [Coord; 2],
}

impl<'a> Culler<'a> {
    /// A culler over the voxels of a region within the half width and one voxel of the extent.
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
        let h = transform.voxel_size();
        let low = (extent.min / h).map(|c| (c - half_width).floor() - 1.0);
        let high = (extent.max / h).map(|c| (c + half_width).ceil() + 1.0);
        let usable =
            (0..3).all(|a| low[a] <= high[a] && low[a].abs().max(high[a].abs()) < LARGEST_INDEX);
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
        Ok(Self {
            field,
            transform,
            background: half_width * h,
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

    /// Whether a cube of `edge` voxels is of interest.
    fn meets(&self, origin: Coord, edge: i32) -> bool {
        (0..3).all(|a| origin[a] <= self.range[1][a] && origin[a] + edge > self.range[0][a])
    }

    /// The samples of a cube and of the layer around it.
    fn surrounded(&self, origin: Coord, edge: i32) -> Aabb {
        let h = self.transform.voxel_size();
        self.transform.sample_box(origin, edge).dilated(h)
    }

    /// What the bound says about the cube of `edge` voxels at `origin`; outside where it is of no
    /// interest.
    fn side(&self, origin: Coord, edge: i32) -> Side {
        if self.meets(origin, edge) {
            self.side_of(self.field.bound(&self.surrounded(origin, edge)))
        } else {
            Side::Outside
        }
    }

    /// The same for the eight halves of a cube, if the field knows them at once.
    fn sides(&self, origin: Coord, half: i32) -> Option<[Side; 8]> {
        let parts = std::array::from_fn(|n| part(origin, half, n));
        let bounds = self
            .field
            .bounds(&parts.map(|p| self.surrounded(p, half)))?;
        Some(std::array::from_fn(|n| {
            if self.meets(parts[n], half) {
                self.side_of(bounds[n])
            } else {
                Side::Outside
            }
        }))
    }

    /// The last test of a leaf, in eight parts of 4^3 samples, with the layer around them 5^3. Sharper than the
    /// whole, as all bounds are over smaller boxes.
    fn leaf_side(&self, origin: Coord) -> Side {
        const HALF: i32 = LEAF / 2;
        let boxes = |first: Coord, edge: i32| {
            std::array::from_fn(|n| self.transform.sample_box(part(first, edge, n), edge))
        };
        let parts = LeafParts {
            own: boxes(origin, HALF),
            wide: boxes(origin.offset(-1, -1, -1), HALF + 1),
            step: self.transform.voxel_size(),
        };
        self.side_of(self.field.leaf_bound(&parts, self.background))
    }

    /// Halves a cube, on this side, down to cubes of `smallest` voxels that may be active; ascending
    /// Morton order.
    fn halve(&self, origin: Coord, edge: i32, side: Side, smallest: i32, sieve: &mut Sieve) {
        let mut side = side;
        if side == Side::Unknown && edge == LEAF {
            side = self.leaf_side(origin);
        }
        match side {
            Side::Outside => return,
            Side::Inside if edge <= BLOCK => return sieve.inside.push((origin, edge)),
            Side::Unknown if edge == smallest => return sieve.unknown.push(origin),
            Side::Unknown if edge == CUBE && smallest == LEAF && self.part(origin, sieve) => return,
            _ => {}
        }
        let half = edge / 2;
        let is_last = half == LEAF;
        let is_tried = !is_last || sieve.trial.is_worth_it();
        let sides = is_tried.then(|| self.sides(origin, half)).flatten();
        for n in 0..8 {
            let origin = part(origin, half, n);
            let side = match sides {
                Some(all) => all[n],
                None if is_tried => self.side(origin, half),
                None if self.meets(origin, half) => Side::Unknown,
                None => Side::Outside,
            };
            if is_last && is_tried {
                sieve.trial.note(side);
            }
            self.halve(origin, half, side, smallest, sieve);
        }
    }

    /// Parts the leaves of a cube, if the field knows their sides at once; whether it does.
    fn part(&self, origin: Coord, sieve: &mut Sieve) -> bool {
        let first = self.transform.world(origin);
        let h = self.transform.voxel_size();
        let Some([inside, outside]) =
            self.field
                .sides(first, h, [-self.background, self.background])
        else {
            return false;
        };
        for half in 0..8 {
            let half_origin = part(origin, CUBE / 2, half);
            // Of this half's leaves; of the leaf (x, y, z) bit 16 x + 4 y + z.
            let first = 32 * (half >> 2) + 8 * (half >> 1 & 1) + 2 * (half & 1);
            let all = 0x0033_0033u64 << first;
            if outside & all == all {
                continue;
            }
            if inside & all == all && self.holds(half_origin, CUBE / 2) {
                sieve.inside.push((half_origin, CUBE / 2));
                continue;
            }
            for n in 0..8 {
                let bit = 1u64 << (first + 16 * (n >> 2) + 4 * (n >> 1 & 1) + (n & 1));
                let leaf = part(half_origin, LEAF, n);
                if outside & bit != 0 || !self.meets(leaf, LEAF) {
                    continue;
                }
                if inside & bit == 0 {
                    sieve.unknown.push(leaf);
                } else {
                    sieve.inside.push((leaf, LEAF));
                }
            }
        }
        true
    }

    /// Whether all leaves of a cube are of interest.
    fn holds(&self, origin: Coord, edge: i32) -> bool {
        let last = origin.offset(edge - LEAF, edge - LEAF, edge - LEAF);
        self.meets(origin, LEAF) && self.meets(last, LEAF)
    }

    /// Blocks that may hold active voxels, and those that lie inside.
    pub fn blocks(&self) -> Sieve {
        let size = (0..3)
            .map(|a| self.range[1][a] - self.range[0][a] + 1)
            .max()
            .unwrap_or(1);
        let mut sieve = Sieve::default();
        if (0..3).any(|a| self.range[0][a] > self.range[1][a]) {
            return sieve;
        }
        let mut edge = BLOCK;
        while edge < size {
            edge *= 2;
        }
        let first = self.range[0].aligned(edge);
        for n in 0..8 {
            let origin = part(first, edge, n);
            let side = self.side(origin, edge);
            self.halve(origin, edge, side, BLOCK, &mut sieve);
        }
        sieve.unknown.sort_unstable();
        sieve
    }

    /// Leaves of a block that may hold active voxels, and cubes of it that lie inside.
    pub fn leaves(&self, block: Coord) -> Sieve {
        let mut sieve = Sieve::default();
        let side = self.side(block, BLOCK);
        self.halve(block, BLOCK, side, LEAF, &mut sieve);
        // A mark for each leaf found sorts them.
        let mut marks = [0u16; (EDGE * EDGE) as usize];
        for leaf in sieve.unknown.drain(..) {
            let [x, y, z] = [0, 1, 2].map(|a| (leaf[a] - block[a]) / LEAF);
            marks[(x * EDGE + y) as usize] |= 1 << z;
        }
        for (row, mut marks) in (0..).zip(marks) {
            while marks != 0 {
                let z = marks.trailing_zeros() as i32;
                marks &= marks - 1;
                let leaf = block.offset(row / EDGE * LEAF, row % EDGE * LEAF, z * LEAF);
                sieve.unknown.push(leaf);
            }
        }
        sieve
    }
}

/// Origin of part `n` of the eight halves of a cube, in Morton order.
fn part(origin: Coord, half: i32, n: usize) -> Coord {
    let [x, y, z] = [4, 2, 1].map(|bit| if n & bit == 0 { 0 } else { half });
    origin.offset(x, y, z)
}
