//! Which blocks and leaves can meet the band: halving of aligned cubes by the field's bound.

use super::{BLOCK, Band, BandError, LEAF};
use crate::field::WorldField;
use crate::frame::{Aabb, Coord, Transform};

/// The range of voxel indices in use; leaves room for neighbours and for doubling a cube.
const LARGEST_INDEX: f64 = (1 << 29) as f64;

/// What a bound says about a cube of samples and the layer around it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    /// Every value is at most minus the half width.
    Inside,
    /// Every value is at least the half width.
    Outside,
    /// The band may be met.
    Unknown,
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
    /// A culler over the voxels within the half width and one voxel of the extent.
    pub fn new(band: &Band<'a>) -> Result<Self, BandError> {
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
        let index = |v: crate::frame::Vec3| Coord([v.x as i32, v.y as i32, v.z as i32]);
        Ok(Self {
            field,
            transform,
            background: half_width * h,
            range: [index(low), index(high)],
        })
    }

    fn side_of(&self, region: &Aabb) -> Side {
        let b = self.field.bound(region);
        if b.lo >= self.background {
            Side::Outside
        } else if b.hi <= -self.background {
            Side::Inside
        } else {
            Side::Unknown
        }
    }

    /// Whether the cube of `edge` voxels at `origin` is of interest and may hold an active voxel.
    fn may_be_active(&self, origin: Coord, edge: i32) -> bool {
        let meets =
            (0..3).all(|a| origin[a] <= self.range[1][a] && origin[a] + edge > self.range[0][a]);
        let h = self.transform.voxel_size();
        meets && self.side_of(&self.transform.sample_box(origin, edge).dilated(h)) == Side::Unknown
    }

    /// The last test of a leaf, in eight parts of 5^3 samples that together are the leaf and the layer
    /// around it. Sharper than the whole, as all bounds are over smaller boxes; parts on different
    /// sides leave a sign change between them.
    fn leaf_may_be_active(&self, origin: Coord) -> bool {
        let mut common = None;
        for part in 0..8 {
            let low = [4, 2, 1].map(|bit| if part & bit == 0 { -1 } else { LEAF / 2 });
            let first = origin.offset(low[0], low[1], low[2]);
            match self.side_of(&self.transform.sample_box(first, LEAF / 2 + 1)) {
                Side::Unknown => return true,
                side if common.is_some_and(|c| c != side) => return true,
                side => common = Some(side),
            }
        }
        false
    }

    /// Halves a cube down to cubes of `smallest` voxels that may be active; ascending Morton order.
    fn halve(&self, origin: Coord, edge: i32, smallest: i32, found: &mut Vec<Coord>) {
        if !self.may_be_active(origin, edge) {
            return;
        }
        if edge == smallest {
            if edge > LEAF || self.leaf_may_be_active(origin) {
                found.push(origin);
            }
            return;
        }
        let half = edge / 2;
        for part in 0..8 {
            let [x, y, z] = [4, 2, 1].map(|bit| if part & bit == 0 { 0 } else { half });
            self.halve(origin.offset(x, y, z), half, smallest, found);
        }
    }

    /// Blocks that may hold active voxels, sorted by origin.
    pub fn blocks(&self) -> Vec<Coord> {
        let size = (0..3)
            .map(|a| self.range[1][a] - self.range[0][a] + 1)
            .max()
            .unwrap_or(1);
        let mut edge = BLOCK;
        while edge < size {
            edge *= 2;
        }
        let first = self.range[0].aligned(edge);
        let mut found = Vec::new();
        for part in 0..8 {
            let [x, y, z] = [4, 2, 1].map(|bit| if part & bit == 0 { 0 } else { edge });
            self.halve(first.offset(x, y, z), edge, BLOCK, &mut found);
        }
        found.sort_unstable();
        found
    }

    /// Leaves of a block (or of another aligned cube) that may hold active voxels, sorted by origin.
    pub fn leaves(&self, origin: Coord, edge: i32) -> Vec<Coord> {
        let mut found = Vec::new();
        self.halve(origin, edge, LEAF, &mut found);
        found.sort_unstable();
        found
    }
}
