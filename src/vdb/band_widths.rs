//! Widths of the band inside and outside, and rebuilding of a band that is narrower on one side.
//!
//! A file has one half width, its background. Some programs write fewer voxels inside or, rarely, outside.
//! Operations would interpret the missing distances as a thin wall.

use super::error::VdbError;
use super::leaves::{LeafView, chosen, raise};
use super::redistance::Rebuild;
use super::{LevelSet, Session};
use crate::band::Region;
use druse_solids::voxel_mask;

/// Share of the background from which a value counts as the full half width: less by more than half floats round.
const FULL_WIDTH_SHARE: f32 = 1.0 - 1e-3;

/// Extreme values of one side of the surface.
#[derive(Clone, Copy, Default)]
struct SideExtremes {
    /// Greatest magnitude of an active voxel.
    active: f32,
    /// Greatest magnitude that a voxel shares with its six neighbours: a clipped value, not a distance.
    plateau: f32,
    /// Whether there are voxels beyond the band.
    has_beyond: bool,
}

impl LevelSet {
    /// Greatest distance from the surface up to which distances are valid, voxels: inside and outside. The half
    /// width unless the values show less.
    ///
    /// # Errors
    /// As [`LevelSet::leaves`].
    pub fn known_widths(&self) -> Result<[f64; 2], VdbError> {
        let mut sides = [SideExtremes::default(); 2];
        self.for_each_leaf(|leaf| add_extremes(&leaf, &mut sides))?;
        sides[0].has_beyond |= self.tiles()?.iter().any(|t| t.value < 0.0);
        let (background, h) = (self.background() as f32, self.voxel_size() as f32);
        Ok(sides.map(|side| {
            // The outermost layer of a full band is at most a voxel from its end; 1 % covers rounding.
            let is_cut_off = side.has_beyond && side.active < background - 1.01 * h;
            let is_flat = side.plateau > 0.0 && side.plateau < FULL_WIDTH_SHARE * background;
            if is_flat && side.plateau >= FULL_WIDTH_SHARE * side.active {
                f64::from(side.plateau / h)
            } else if is_cut_off && side.active > 0.0 {
                f64::from(side.active / h)
            } else {
                self.half_width
            }
        }))
    }

    /// Rebuilds the distances of a band that is narrower on one side, without moving the surface. Returns
    /// whether it was.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn rebuild_narrow_side(&mut self, session: Session<'_>) -> Result<bool, VdbError> {
        let [inside, outside] = self.known_widths()?;
        let known = inside.min(outside);
        if known >= self.half_width {
            return Ok(false);
        }
        let background = self.background() as f32;
        let rebuild = Rebuild {
            outwards: 0.0,
            background,
            known: (known * self.voxel_size()) as f32,
            within: Region::EVERYWHERE,
        };
        self.rebuild("rebuilding the band", rebuild, session)?;
        Ok(true)
    }
}

/// Adds the values of a leaf to the extremes inside and outside. The first side is the inside.
fn add_extremes(leaf: &LeafView<'_>, sides: &mut [SideExtremes; 2]) {
    let negative = voxel_mask::negative(leaf.values);
    let negative = negative.iter().flat_map(|word| word.to_le_bytes());
    // By side and z.
    let mut greatest = [[0f32; 8]; 2];
    for (at, ((row, active), negative)) in leaf.rows().zip(negative).enumerate() {
        let sizes = row.map(f32::abs);
        for (n, of_side) in [negative, !negative].into_iter().enumerate() {
            sides[n].has_beyond |= of_side & !active != 0;
            if of_side & active != 0 {
                raise(&mut greatest[n], &chosen(&sizes, of_side & active, 0.0));
            }
        }
        if active != 0 && may_be_flat(leaf, at) {
            for n in (1..7).filter(|n| active >> n & 1 == 1) {
                add_plateau(leaf, 8 * at + n, sides);
            }
        }
    }
    for (side, greatest) in sides.iter_mut().zip(greatest) {
        side.active = greatest.into_iter().fold(side.active, f32::max);
    }
}

/// Whether row number `row` may have a voxel whose value its six neighbours share.
fn may_be_flat(leaf: &LeafView<'_>, row: usize) -> bool {
    let is_inner = [row >> 3, row & 7].iter().all(|c| (1..7).contains(c));
    if !is_inner {
        return false;
    }
    let rows = leaf.values.as_chunks::<8>().0;
    let [own, before, after] = [row, row - 8, row + 8].map(|n| &rows[n]);
    // Without an early exit it is vectorised.
    let is_alike = |n: usize| before[n] == own[n] && after[n] == own[n];
    (0..8).fold(false, |any, n| any | is_alike(n))
}

/// Adds a voxel of an inner row to the plateau inside or outside, if its neighbours have its value. It lies between the
/// ends of the row.
fn add_plateau(leaf: &LeafView<'_>, n: usize, sides: &mut [SideExtremes; 2]) {
    let v = leaf.values[n];
    let side = &mut sides[usize::from(v >= 0.0)];
    let is_alike = |stride: usize| leaf.values[n - stride] == v && leaf.values[n + stride] == v;
    if v.abs() > side.plateau && [64, 8, 1].into_iter().all(is_alike) {
        side.plateau = v.abs();
    }
}
