//! Widths of the band inside and outside, and rebuilding of a band that is narrower on one side.
//!
//! A file has one half width, its background. Some programs write fewer voxels inside or, rarely, outside.
//! Operations would interpret the missing distances as a thin wall.

use super::redistance::Rebuild;
use super::{LeafView, LevelSet, Session, VdbError};
use crate::band::Region;

/// Share of the background from which a value counts as the full half width.
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

/// Adds the values of a leaf to the extremes inside and outside.
fn add_extremes(leaf: &LeafView<'_>, sides: &mut [SideExtremes; 2]) {
    for (n, &v) in leaf.values.iter().enumerate() {
        let side = &mut sides[usize::from(v >= 0.0)];
        let size = v.abs();
        if !leaf.is_active(n) {
            side.has_beyond = true;
            continue;
        }
        side.active = side.active.max(size);
        let is_inner = [n >> 6, n >> 3 & 7, n & 7]
            .iter()
            .all(|c| (1..7).contains(c));
        if is_inner && size > side.plateau {
            let is_alike =
                |stride: usize| leaf.values[n - stride] == v && leaf.values[n + stride] == v;
            if [64, 8, 1].into_iter().all(is_alike) {
                side.plateau = size;
            }
        }
    }
}
