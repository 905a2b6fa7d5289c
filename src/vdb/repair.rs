//! What a level set of others needs to be one of ours, and how it gets that.

use super::foreign::GridReading;
use super::refusal::{Refusal, value_hint};
use super::value_survey::Slopes;
use super::{Session, VdbError, Volume, ffi};

/// What a level set needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Mending {
    /// Factor on all values.
    pub factor: f64,
    /// The new background, after that.
    pub background: Option<f32>,
    /// The half width in voxels that it then has.
    pub half_width: f64,
    /// Whether tiles are active that lie beyond the band.
    pub has_active_tiles: bool,
    pub notes: Vec<String>,
}

/// Slopes of distances, world units per world unit.
const SLOPES: [f64; 2] = [0.8, 1.25];

/// A grid without an active voxel: empty, if its background may be that of a band.
fn empty_level_set(background: f64, h: f64, mut mending: Mending) -> Result<Mending, Refusal> {
    mending.half_width = background / h;
    if mending.half_width >= 1.0 && (background as f32).is_normal() {
        return Ok(mending);
    }
    Err(Refusal::new(
        format!("no active voxel, and the background {background}"),
        "a background of at least one voxel",
        "write the grid again in the program that made it: there is no surface in it",
    ))
}

impl Volume {
    pub(super) fn slopes(&self) -> Option<Slopes> {
        // Only OpenVDB's own refusals (memory).
        Slopes::of(&self.grid, self.survey.largest()).ok().flatten()
    }

    /// What a level set needs, or why it is none.
    pub(super) fn level_set(
        &self,
        how: &GridReading,
        notes: Vec<String>,
    ) -> Result<Mending, Refusal> {
        let survey = &self.survey;
        let h = self.own_edge();
        let mut mending = Mending {
            factor: 1.0,
            notes,
            ..Mending::default()
        };
        let largest = f64::from(survey.largest());
        let background = self.info.background.unwrap_or(0.0);
        if survey.active == 0 {
            return empty_level_set(background, h, mending);
        }
        if survey.negative == survey.active && survey.is_inside_out() && !self.has_inside(-1.0) {
            return Err(Refusal::new(
                format!(
                    "no distance above 0 ({} is the greatest): there is no surface",
                    survey.range.unwrap_or_default()[1]
                ),
                "signed distances, negative inside and positive outside",
                "write the grid again in the program that made it, wide enough around the surface",
            ));
        }
        match (survey.is_inside_out(), how.invert) {
            (true, false) => {
                return Err(Refusal::new(
                    "distances that are negative outside: it is inside out",
                    "distances that are negative inside",
                    "--invert exchanges inside and outside; in a recipe invert = true beside the path",
                ));
            }
            (true, true) => mending.factor = -1.0,
            (false, true) => {
                return Err(Refusal::new(
                    "distances that are negative inside, as they should be",
                    "a level set that is inside out",
                    "leave invert away",
                ));
            }
            (false, false) => {}
        }
        let inside = if mending.factor < 0.0 {
            survey.active - survey.negative
        } else {
            survey.negative
        };
        if inside == 0 && !self.has_inside(mending.factor) {
            return Err(Refusal::new(
                "no distance below 0: an unsigned distance, which has no inside",
                "signed distances",
                value_hint((largest / 2.0).min(1.5 * self.info.cube_edge()))
                    + " (a wall of that thickness on each side of its zero set)",
            ));
        }
        if let Some(least) = survey.least_tile {
            if f64::from(least) < 0.999 * background.abs().min(largest) {
                return Err(Refusal::new(
                    format!("active tiles of {least}"),
                    "a narrow band, active in leaves only, or tiles beyond it",
                    value_hint(0.0) + " (which makes the band anew)",
                ));
            }
            mending.has_active_tiles = true;
        }
        self.scale(h, &mut mending);
        let size = mending.factor.abs();
        let mut width = background.abs() * size;
        // Less than what active voxels hold, or nothing: the background is the end of the band.
        if !(width.is_finite() && width >= 0.999 * largest * size) || background == 0.0 {
            mending.notes.push(format!(
                "its background is {} and its band {} wide: the background is that now",
                background as f32, largest as f32
            ));
            width = largest * size;
            mending.background = Some(width as f32);
        } else if background * mending.factor < 0.0 {
            mending.background = Some(width as f32);
        }
        mending.half_width = width / h;
        if mending.half_width < 1.0 || !(width as f32).is_normal() {
            return Err(Refusal::new(
                format!(
                    "a band of {} voxels on each side",
                    (mending.half_width * 1000.0).round() / 1000.0
                ),
                "a band of at least one voxel",
                value_hint(0.0)
                    + " (which makes the band anew; the surface moves by up to half a voxel)",
            ));
        }
        Ok(mending)
    }

    /// Whether voxels that are not active say where the inside is, at the surface of a band that is active outside
    /// only.
    fn has_inside(&self, factor: f64) -> bool {
        let Ok(leaves) = self.leaves() else {
            return false;
        };
        leaves
            .iter()
            .any(|l| l.values.iter().any(|&v| f64::from(v) * factor < 0.0))
    }

    /// Distances in other units than the world's are scaled.
    fn scale(&self, h: f64, mending: &mut Mending) {
        let slopes = self.slopes();
        if !self.info.cubic {
            // Voxels have no one edge: distances count voxels, more or less.
            let median = slopes.map(Slopes::median).filter(|m| *m > 0.0);
            mending.factor /= median.unwrap_or_else(|| self.info.cube_edge());
            return;
        }
        let Some(slopes) = slopes else {
            return;
        };
        let slope = slopes.median() / h;
        if (SLOPES[0]..=SLOPES[1]).contains(&slope) || slope <= 0.0 {
            return;
        }
        if !slopes.is_uniform() {
            let [low, _, high] = slopes.0.map(|s| (s / h) as f32);
            mending.notes.push(format!(
                "its values are no distances (they rise by {low} to {high} per unit of length): widths of operations are off by \
                 as much; value = 0 makes distances anew"
            ));
            return;
        }
        let decimal = 10f64.powi(slope.log10().round() as i32);
        let near = |a: f64| (slope / a - 1.0).abs() < 0.1;
        let (factor, what) = if near(1.0 / h) {
            (h, "count voxels".to_owned())
        } else if near(decimal) {
            (
                1.0 / decimal,
                format!("rise by {decimal} per unit of length"),
            )
        } else {
            (
                1.0 / slope,
                format!("rise by {} per unit of length", slope as f32),
            )
        };
        mending.factor *= factor;
        mending.notes.push(format!(
            "its distances {what}: multiplied by {}",
            factor as f32
        ));
    }

    /// Brings values and background in order.
    pub(super) fn mend(&mut self, mending: &Mending, session: Session<'_>) -> Result<(), VdbError> {
        let failed = |e| VdbError::of("reading a level set", session, &e);
        let host = session.host();
        let factor = mending.factor as f32;
        if (factor - 1.0).abs() > 0.0 {
            ffi::grid_scale_values(self.grid.pin_mut(), factor, 0.0, &host).map_err(failed)?;
        }
        if let Some(background) = mending.background {
            ffi::grid_set_background(self.grid.pin_mut(), background, &host).map_err(failed)?;
        }
        if mending.has_active_tiles {
            let tiles = super::leaves::tiles_of(&self.grid, true).map_err(failed)?;
            for is_inside in [false, true] {
                let own = tiles
                    .iter()
                    .filter(|t| t.active && (t.value < 0.0) == is_inside);
                let own: Vec<i32> = own
                    .flat_map(|t| [t.origin[0], t.origin[1], t.origin[2], t.edge])
                    .collect();
                let background = mending.half_width * self.own_edge();
                let fill = if is_inside {
                    -background as f32
                } else {
                    background as f32
                };
                ffi::grid_edit(self.grid.pin_mut(), &[], &[], &[], &own, fill, &host)
                    .map_err(failed)?;
            }
        }
        Ok(())
    }

    /// Fills the signs of inactive values in; how many had the other one.
    pub(super) fn fill_signs(&mut self, session: Session<'_>) -> Result<u64, VdbError> {
        let failed = |e| VdbError::of("reading a level set", session, &e);
        let before = self.inactive_inside()?;
        ffi::grid_flood_fill(self.grid.pin_mut(), &session.host()).map_err(failed)?;
        let wrong = before.abs_diff(self.inactive_inside()?);
        if wrong > 0 {
            // Leaves without an active voxel get their signs from their neighbours as tiles.
            ffi::grid_prune(self.grid.pin_mut(), &session.host()).map_err(failed)?;
            ffi::grid_flood_fill(self.grid.pin_mut(), &session.host()).map_err(failed)?;
        }
        Ok(before.abs_diff(self.inactive_inside()?))
    }

    /// Voxels that are inactive and below zero.
    fn inactive_inside(&self) -> Result<u64, VdbError> {
        let mut count = 0;
        for leaf in self.leaves()?.iter() {
            let below = super::voxel_mask::select(leaf.values, |v| v < 0.0);
            let own = below.iter().zip(leaf.mask);
            count += own
                .map(|(b, m)| u64::from((b & !m).count_ones()))
                .sum::<u64>();
        }
        let tiles = super::leaves::tiles_of(&self.grid, true)
            .map_err(|e| VdbError::plain("listing tiles", &e))?;
        let inside = tiles.iter().filter(|t| !t.active && t.value < 0.0);
        Ok(count + inside.map(|t| (t.edge as u64).pow(3)).sum::<u64>())
    }
}
