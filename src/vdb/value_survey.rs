//! A look over all values of a grid of floats of others, before anything is made of it.
//!
//! One pass tells the range of the active values, what is no number, and the sign at the outer end of the band; a
//! second one, over a sample of leaves, how steeply values rise.

use super::ffi;
use super::leaves::{LeafView, Leaves, tiles_of};
use crate::frame::Coord;

/// What the values of a grid are.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Survey {
    /// Active voxels of leaves, and active tiles.
    pub active: u64,
    /// Those below zero.
    pub negative: u64,
    /// Least and greatest active value that is finite.
    pub range: Option<[f32; 2]>,
    /// Values that are NaN or infinite, in leaves or tiles, active or not.
    pub not_finite: u64,
    /// The first of them and its voxel.
    pub first: Option<(f32, Coord)>,
    /// Active voxels at the faces of the box around all of them: below zero, and others.
    pub outer: [u64; 2],
    /// The greatest magnitude among them.
    pub outer_size: f32,
    /// Magnitude of active tiles, the least of them.
    pub least_tile: Option<f32>,
}

/// How steeply values rise from voxel to voxel, at the percentiles 10, 50 and 90.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slopes(pub [f64; 3]);

/// Leaves that slopes are measured in, at most.
const SLOPE_LEAVES: usize = 2048;
/// Voxels with a slope, at least, for it to mean something.
const SLOPE_VOXELS: usize = 32;
/// Share of the greatest value from which a band counts as cut off.
const CUT_OFF: f32 = 0.98;

impl Survey {
    /// Looks at all leaves and tiles; the box holds all active voxels.
    pub fn of(grid: &ffi::Grid, bbox: Option<[[i32; 3]; 2]>) -> Result<Self, cxx::Exception> {
        let mut found = Self::default();
        let bbox = bbox.unwrap_or([[i32::MAX; 3], [i32::MIN; 3]]);
        let leaves = Leaves::of_grid(grid)?;
        for leaf in leaves.iter() {
            found.add_leaf(&leaf, bbox);
        }
        for tile in tiles_of(grid, true)? {
            if tile.value.is_finite() {
                if tile.active {
                    let size = tile.value.abs();
                    found.least_tile = Some(found.least_tile.map_or(size, |s| s.min(size)));
                    let last = tile.edge - 1;
                    let low = tile.origin;
                    let high = low.offset(last, last, last);
                    found.add(tile.value, is_outer(low, bbox) || is_outer(high, bbox));
                }
            } else {
                found.miss(tile.value, tile.origin);
            }
        }
        Ok(found)
    }

    fn add_leaf(&mut self, leaf: &LeafView<'_>, bbox: [[i32; 3]; 2]) {
        const EXPONENT: u32 = 0x7f80_0000;
        // Without a way out of the loop it takes many values at once.
        let is_bad = |v: &f32| v.to_bits() & EXPONENT == EXPONENT;
        if leaf.values.iter().fold(false, |any, v| any | is_bad(v)) {
            for (n, &v) in leaf.values.iter().enumerate().filter(|(_, v)| is_bad(v)) {
                self.miss(v, leaf.voxel(n));
            }
        }
        let last = leaf.voxel(511);
        let meets_face = is_outer(leaf.origin, bbox)
            || is_outer(last, bbox)
            || (0..3).any(|a| {
                let within = leaf.origin[a]..=last[a];
                within.contains(&bbox[0][a]) || within.contains(&bbox[1][a])
            });
        for (n, &v) in leaf.values.iter().enumerate() {
            if leaf.is_active(n) && v.is_finite() {
                self.add(v, meets_face && is_outer(leaf.voxel(n), bbox));
            }
        }
    }

    fn add(&mut self, v: f32, is_outer: bool) {
        self.active += 1;
        self.negative += u64::from(v < 0.0);
        let [low, high] = self.range.unwrap_or([v, v]);
        self.range = Some([low.min(v), high.max(v)]);
        if is_outer {
            self.outer[usize::from(v >= 0.0)] += 1;
            self.outer_size = self.outer_size.max(v.abs());
        }
    }

    fn miss(&mut self, v: f32, voxel: Coord) {
        self.not_finite += 1;
        self.first.get_or_insert((v, voxel));
    }

    /// The greatest magnitude of an active value.
    pub fn largest(&self) -> f32 {
        self.range
            .map_or(0.0, |[low, high]| low.abs().max(high.abs()))
    }

    /// Whether values are negative all around, far from the surface: inside and outside are exchanged.
    pub fn is_inside_out(&self) -> bool {
        self.outer[0] > 0 && self.outer[1] == 0 && self.outer_size > 0.5 * self.largest()
    }
}

/// Whether a voxel lies on a face of a box.
fn is_outer(voxel: Coord, [low, high]: [[i32; 3]; 2]) -> bool {
    (0..3).any(|a| voxel[a] == low[a] || voxel[a] == high[a])
}

impl Slopes {
    /// Of values within `largest`, by differences over two voxels; `None` where too few tell.
    pub fn of(grid: &ffi::Grid, largest: f32) -> Result<Option<Self>, cxx::Exception> {
        let leaves = Leaves::of_grid(grid)?;
        let step = leaves.len().div_ceil(SLOPE_LEAVES).max(1);
        let mut slopes: Vec<f32> = Vec::new();
        for leaf in (0..leaves.len())
            .step_by(step)
            .filter_map(|n| leaves.get(n))
        {
            add_slopes(&leaf, CUT_OFF * largest, &mut slopes);
        }
        if slopes.len() < SLOPE_VOXELS {
            return Ok(None);
        }
        slopes.sort_unstable_by(f32::total_cmp);
        let last = (slopes.len() - 1) as f64;
        let at = |share: f64| f64::from(slopes[(share * last) as usize]);
        Ok(Some(Self([at(0.1), at(0.5), at(0.9)])))
    }

    /// The middle one.
    pub fn median(self) -> f64 {
        self.0[1]
    }

    /// Whether values rise alike nearly everywhere.
    pub fn is_uniform(self) -> bool {
        let [low, _, high] = self.0;
        low > 0.0 && high < 1.3 * low
    }
}

/// Slopes at the inner voxels of a leaf that, with their neighbours, are active and below a magnitude.
fn add_slopes(leaf: &LeafView<'_>, most: f32, slopes: &mut Vec<f32>) {
    for n in 0..512usize {
        let is_inner = [n >> 6, n >> 3 & 7, n & 7]
            .iter()
            .all(|c| (1..7).contains(c));
        let tells = |n: usize| leaf.is_active(n) && leaf.values[n].abs() < most;
        if !is_inner || !tells(n) {
            continue;
        }
        let strides = [64, 8, 1];
        if strides.iter().all(|s| tells(n - s) && tells(n + s)) {
            let square = strides.map(|s| (leaf.values[n + s] - leaf.values[n - s]).powi(2));
            slopes.push(square.iter().sum::<f32>().sqrt() / 2.0);
        }
    }
}
