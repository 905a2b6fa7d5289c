//! Statistics of all values of a grid of floats, before it is interpreted.
//!
//! One pass finds the range of the active values, non-finite values, and the signs on the bounding box. A second pass
//! measures slopes in a sample of leaves.

use super::ffi;
use super::ffi::TileChoice;
use super::leaves::{LeafView, Leaves, tiles_of};
use crate::frame::Coord;
use druse_solids::voxel_mask::{self, Bits};

/// Statistics of the values of a grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Survey {
    /// Number of active voxels of leaves with finite values, plus such active tiles.
    pub active: u64,
    /// Number of those below zero.
    pub negative: u64,
    /// Least and greatest finite active value.
    pub range: Option<[f32; 2]>,
    /// Number of values that are NaN or infinite, in leaves or tiles, active or not.
    pub not_finite: u64,
    /// The first of them and its voxel.
    pub first_non_finite: Option<(f32, Coord)>,
    /// Active voxels on the faces of their bounding box: below zero, and others.
    pub outer_counts: [u64; 2],
    /// The greatest magnitude of those values.
    pub max_outer: f32,
    /// The least magnitude of an active tile.
    pub min_active_tile: Option<f32>,
}

/// Slopes of the values, per voxel: percentiles 10, 50 and 90.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slopes(pub [f64; 3]);

/// Greatest number of leaves in which slopes are measured.
const MAX_SLOPE_LEAVES: usize = 2048;
/// Least number of measured voxels for a result.
const MIN_SLOPE_VOXELS: usize = 32;
/// Share of the greatest value above which values count as clipped.
const CLIPPED_SHARE: f32 = 0.98;

impl Survey {
    /// Surveys all leaves, and all tiles that differ from the background; `bbox` is the bounding box of the active
    /// voxels.
    pub fn of(grid: &ffi::Grid, bbox: Option<[[i32; 3]; 2]>) -> Result<Self, cxx::Exception> {
        let mut found = Self::default();
        let bbox = bbox.unwrap_or([[i32::MAX; 3], [i32::MIN; 3]]);
        let leaves = Leaves::of_grid(grid)?;
        for leaf in leaves.iter() {
            found.add_leaf(&leaf, bbox);
        }
        for tile in tiles_of(grid, TileChoice::Distinct)? {
            if tile.value.is_finite() {
                if tile.active {
                    let size = tile.value.abs();
                    found.min_active_tile =
                        Some(found.min_active_tile.map_or(size, |s| s.min(size)));
                    let last = tile.edge - 1;
                    let low = tile.origin;
                    let high = low.offset(last, last, last);
                    found.add(tile.value, is_outer(low, bbox) || is_outer(high, bbox));
                }
            } else {
                found.add_non_finite(tile.value, tile.origin);
            }
        }
        Ok(found)
    }

    /// Adds the values of a leaf. `bbox` is the box of active voxels, at whose faces values are surveyed as well. All
    /// values are tested for NaN and infinity, active or not.
    fn add_leaf(&mut self, leaf: &LeafView<'_>, bbox: [[i32; 3]; 2]) {
        /// Bits that are all set in NaN and infinities only.
        const EXPONENT: u32 = 0x7f80_0000;
        // A loop without an early exit is vectorised.
        let is_bad = |v: &f32| v.to_bits() & EXPONENT == EXPONENT;
        let any_bad = leaf.values.iter().fold(false, |any, v| any | is_bad(v));
        if any_bad {
            for (n, &v) in leaf.values.iter().enumerate().filter(|(_, v)| is_bad(v)) {
                self.add_non_finite(v, leaf.voxel(n));
            }
        }
        let last = leaf.voxel(511);
        // Leaves without a voxel in the planes of the box's faces take the fast way, counts of bits and a range, if all
        // is finite.
        let meets_face = (0..3).any(|a| {
            let within = leaf.origin[a]..=last[a];
            within.contains(&bbox[0][a]) || within.contains(&bbox[1][a])
        });
        if any_bad || meets_face {
            for (n, &v) in leaf.values.iter().enumerate() {
                if leaf.is_active(n) && v.is_finite() {
                    self.add(v, meets_face && is_outer(leaf.voxel(n), bbox));
                }
            }
            return;
        }
        let negative = voxel_mask::negative(leaf.values);
        let negative: Bits = std::array::from_fn(|x| negative[x] & leaf.mask[x]);
        self.active += voxel_mask::count(&leaf.mask);
        self.negative += voxel_mask::count(&negative);
        if let Some(range) = leaf.active_range() {
            self.widen(range);
        }
    }

    fn widen(&mut self, [low, high]: [f32; 2]) {
        let [least, greatest] = self.range.unwrap_or([low, high]);
        self.range = Some([least.min(low), greatest.max(high)]);
    }

    fn add(&mut self, v: f32, is_outer: bool) {
        self.active += 1;
        self.negative += u64::from(v < 0.0);
        self.widen([v, v]);
        if is_outer {
            self.outer_counts[usize::from(v >= 0.0)] += 1;
            self.max_outer = self.max_outer.max(v.abs());
        }
    }

    fn add_non_finite(&mut self, v: f32, voxel: Coord) {
        self.not_finite += 1;
        self.first_non_finite.get_or_insert((v, voxel));
    }

    /// The greatest magnitude of a finite active value.
    pub fn max_magnitude(&self) -> f32 {
        self.range
            .map_or(0.0, |[low, high]| low.abs().max(high.abs()))
    }

    /// Whether inside and outside are exchanged: values on the bounding box are negative, and one is farther from the
    /// surface than half of the greatest magnitude.
    pub fn is_inside_out(&self) -> bool {
        self.outer_counts[0] > 0
            && self.outer_counts[1] == 0
            && self.max_outer > 0.5 * self.max_magnitude()
    }
}

/// Whether a voxel lies on a face of a box.
fn is_outer(voxel: Coord, [low, high]: [[i32; 3]; 2]) -> bool {
    (0..3).any(|a| voxel[a] == low[a] || voxel[a] == high[a])
}

impl Slopes {
    /// Measures slopes by central differences at values below 0.98 of `max_magnitude`; `None` if too few voxels
    /// qualify. They are quantiles: a tenth, the median and nine tenths. Of many leaves only some are measured.
    pub fn of(grid: &ffi::Grid, max_magnitude: f32) -> Result<Option<Self>, cxx::Exception> {
        let leaves = Leaves::of_grid(grid)?;
        let step = leaves.len().div_ceil(MAX_SLOPE_LEAVES).max(1);
        let mut slopes: Vec<f32> = Vec::new();
        for leaf in (0..leaves.len())
            .step_by(step)
            .filter_map(|n| leaves.get(n))
        {
            add_slopes(&leaf, CLIPPED_SHARE * max_magnitude, &mut slopes);
        }
        if slopes.len() < MIN_SLOPE_VOXELS {
            return Ok(None);
        }
        let last = (slopes.len() - 1) as f64;
        // A selection takes less time than a sort.
        let quantiles = [0.1, 0.5, 0.9].map(|share| {
            let rank = (share * last) as usize;
            f64::from(*slopes.select_nth_unstable_by(rank, f32::total_cmp).1)
        });
        Ok(Some(Self(quantiles)))
    }

    /// The median slope.
    pub fn median(self) -> f64 {
        self.0[1]
    }

    /// Whether slopes are nearly equal everywhere: the tenth is above 0, and the nine tenths less than 30 % above it.
    pub fn is_uniform(self) -> bool {
        let [low, _, high] = self.0;
        low > 0.0 && high < 1.3 * low
    }
}

/// Bits of the inner voxels of a word: 8 y + z with y and z from 1 to 6.
const INNER_BITS: u64 = 0x007e_7e7e_7e7e_7e00;

/// Adds the slopes at inner voxels of a leaf that are, with their neighbours, active and below `limit`.
fn add_slopes(leaf: &LeafView<'_>, limit: f32, slopes: &mut Vec<f32>) {
    let below = voxel_mask::select(leaf.values, |v| v.abs() < limit);
    let usable: Bits = std::array::from_fn(|x| below[x] & leaf.mask[x]);
    for x in 1..7 {
        let own = usable[x];
        let along = own << 8 & own >> 8 & own << 1 & own >> 1;
        let mut bits = own & along & usable[x - 1] & usable[x + 1] & INNER_BITS;
        while bits != 0 {
            let n = 64 * x + bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let difference = |stride: usize| leaf.values[n + stride] - leaf.values[n - stride];
            let square = [64, 8, 1].map(|stride| difference(stride).powi(2));
            slopes.push(square.iter().sum::<f32>().sqrt() / 2.0);
        }
    }
}
