//! Bands that are narrower on one side: how far distances are known inside and outside, and how the narrower side
//! is rebuilt.
//!
//! A file tells one half width, its background, which is that of the outside. Programs may write fewer voxels
//! inside (or, seldom, outside). Operations would take the missing distances for those of a thin wall.

use super::redistance::Rebuild;
use super::{LeafView, LevelSet, Session, VdbError};
use crate::band::Region;

/// Share of a background that counts as all of it.
const WHOLE: f32 = 1.0 - 1e-3;

/// What the leaves say of one side.
#[derive(Clone, Copy, Default)]
struct Extremes {
    /// Greatest distance of an active voxel.
    active: f32,
    /// Greatest distance that a voxel and its six neighbours have in common, which no distance does.
    plateau: f32,
    /// Whether a voxel lies beyond the band.
    has_beyond: bool,
}

impl LevelSet {
    /// How far from the surface distances are known, voxels: inside, outside. The half width where nothing
    /// shows that it is less.
    ///
    /// # Errors
    /// As [`LevelSet::leaves`].
    pub fn known_widths(&self) -> Result<[f64; 2], VdbError> {
        let mut sides = [Extremes::default(); 2];
        self.for_each_leaf(|leaf| look_at(&leaf, &mut sides))?;
        sides[0].has_beyond |= self.tiles()?.iter().any(|t| t.value < 0.0);
        let (background, h) = (self.background() as f32, self.voxel_size() as f32);
        Ok(sides.map(|side| {
            let is_cut_off = side.has_beyond && side.active < background - 1.01 * h;
            let is_flat = side.plateau > 0.0 && side.plateau < WHOLE * background;
            if is_flat && side.plateau >= WHOLE * side.active {
                f64::from(side.plateau / h)
            } else if is_cut_off && side.active > 0.0 {
                f64::from(side.active / h)
            } else {
                self.half_width
            }
        }))
    }

    /// Rebuilds the distances of a band that is narrower on one side, without moving the surface; whether it
    /// was.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn even_band(&mut self, session: Session<'_>) -> Result<bool, VdbError> {
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

/// Adds what a leaf says, inside and outside.
fn look_at(leaf: &LeafView<'_>, sides: &mut [Extremes; 2]) {
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
