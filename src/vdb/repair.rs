//! Repairs of level sets from other programs: scale, sign, background, active tiles, inactive signs.
//!
//! A repair is a plan from the survey of all values; it is applied afterwards. Repairs do not move the surface. Values
//! may be scaled to world units; signs of inactive values follow from the band beside them.

use super::error::VdbError;
use super::ffi::TileChoice;
use super::foreign::GridReading;
use super::refusal::{Refusal, value_hint};
use super::value_survey::Slopes;
use super::volume::Volume;
use super::{Session, ffi};

/// The repairs of a level set.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Repair {
    /// Factor on all values.
    pub factor: f64,
    /// New background, after scaling.
    pub background: Option<f32>,
    /// Half width after the repairs, voxels.
    pub half_width: f64,
    /// Whether tiles beyond the band are active.
    pub has_active_tiles: bool,
    /// A sentence for each repair.
    pub notes: Vec<String>,
}

/// Range of the median slope that counts as distances in world units: creases lower it, coarse values spread it.
const UNIT_SLOPES: [f64; 2] = [0.8, 1.25];

/// The repairs of a grid without active voxels: an empty level set, if its background is that of a band.
fn empty_level_set(background: f64, h: f64, mut repair: Repair) -> Result<Repair, Refusal> {
    repair.half_width = background / h;
    if repair.half_width >= 1.0 && (background as f32).is_normal() {
        return Ok(repair);
    }
    Err(Refusal::new(
        format!("no active voxel, and the background {background}"),
        "a background of at least one voxel",
        "write the grid again in the program that made it: there is no surface in it",
    ))
}

impl Volume {
    /// The slopes of the values across the surface; `None` where too few voxels qualify.
    pub(super) fn slopes(&self) -> Option<Slopes> {
        // Fails only if OpenVDB does (memory).
        Slopes::of(&self.grid, self.survey.max_magnitude())
            .ok()
            .flatten()
    }

    /// The repairs that make the grid a level set, or why it cannot be one. Every refusal names a remedy; `notes` are
    /// those found so far. Nothing changes here.
    pub(super) fn level_set_repair(
        &self,
        how: &GridReading,
        notes: Vec<String>,
    ) -> Result<Repair, Refusal> {
        let survey = &self.survey;
        let h = self.own_edge();
        let mut repair = Repair {
            factor: 1.0,
            notes,
            ..Repair::default()
        };
        // The decisions follow from the survey of all values, in the order: empty, sign, active tiles,
        // scale, background.
        let largest = f64::from(survey.max_magnitude());
        let background = self.info.background.unwrap_or(0.0);
        if survey.active == 0 {
            return empty_level_set(background, h, repair);
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
            (true, true) => repair.factor = -1.0,
            (false, true) => {
                return Err(Refusal::new(
                    "distances that are negative inside, as they should be",
                    "a level set that is inside out",
                    "leave out invert",
                ));
            }
            (false, false) => {}
        }
        // Inside are the negative values, or the others where signs are exchanged.
        let inside = if repair.factor < 0.0 {
            survey.active - survey.negative
        } else {
            survey.negative
        };
        if inside == 0 && !self.has_inside(repair.factor) {
            // A wall of half the known distances, at most three voxels thick, is a solid.
            return Err(Refusal::new(
                "no distance below 0: an unsigned distance, which has no inside",
                "signed distances",
                value_hint((largest / 2.0).min(1.5 * self.info.cube_edge()))
                    + " (a wall of that thickness on each side of its zero set)",
            ));
        }
        // Active tiles within the band, by more than rounding, hold distances of cubes, which no leaf can replace.
        if let Some(least) = survey.min_active_tile {
            if f64::from(least) < 0.999 * background.abs().min(largest) {
                return Err(Refusal::new(
                    format!("active tiles of {least}"),
                    "a narrow band, active in leaves only, or tiles beyond it",
                    value_hint(0.0) + " (which rebuilds the band)",
                ));
            }
            repair.has_active_tiles = true;
        }
        self.scale(h, &mut repair);
        let scale = repair.factor.abs();
        let mut width = background.abs() * scale;
        // A background below the active values, or none: the band ends at the greatest value.
        if !(width.is_finite() && width >= 0.999 * largest * scale) || background == 0.0 {
            repair.notes.push(format!(
                "its background is {} and its band {} wide: the background is set to the width",
                background as f32, largest as f32
            ));
            width = largest * scale;
            repair.background = Some(width as f32);
        } else if background * repair.factor < 0.0 {
            repair.background = Some(width as f32);
        }
        repair.half_width = width / h;
        if repair.half_width < 1.0 || !(width as f32).is_normal() {
            return Err(Refusal::new(
                format!(
                    "a band of {} voxels on each side",
                    (repair.half_width * 1000.0).round() / 1000.0
                ),
                "a band of at least one voxel",
                value_hint(0.0)
                    + " (which rebuilds the band; the surface moves by up to half a voxel)",
            ));
        }
        Ok(repair)
    }

    /// Whether any value times a factor, active or not, lies inside: a band may be active outside only.
    fn has_inside(&self, factor: f64) -> bool {
        let Ok(leaves) = self.leaves() else {
            return false;
        };
        leaves
            .iter()
            .any(|l| l.values.iter().any(|&v| f64::from(v) * factor < 0.0))
    }

    /// Sets the factor in `repair` for distances that are not in world units, with a note; `h` is the edge of a voxel.
    /// Where voxels are no cubes, distances become voxels, without a note. Slopes near 1, or too few of them, change
    /// nothing, and values that are no distances only get a note.
    fn scale(&self, h: f64, repair: &mut Repair) {
        let slopes = self.slopes();
        if !self.info.cubic {
            // Voxels have no single edge length: distances count voxels, approximately.
            let median = slopes.map(Slopes::median).filter(|m| *m > 0.0);
            repair.factor /= median.unwrap_or_else(|| self.info.cube_edge());
            return;
        }
        let Some(slopes) = slopes else {
            return;
        };
        let slope = slopes.median() / h;
        if (UNIT_SLOPES[0]..=UNIT_SLOPES[1]).contains(&slope) || slope <= 0.0 {
            return;
        }
        if !slopes.is_uniform() {
            let [low, _, high] = slopes.0.map(|s| (s / h) as f32);
            repair.notes.push(format!(
                "its values are not distances (slopes of {low} to {high} per unit of length): widths of operations are \
                 off by as much; value = 0 rebuilds the distances"
            ));
            return;
        }
        // The nearest power of ten, within a tenth: a unit such as metres for millimetres.
        let decimal = 10f64.powi(slope.log10().round() as i32);
        let is_near = |a: f64| (slope / a - 1.0).abs() < 0.1;
        let (factor, what) = if is_near(1.0 / h) {
            (h, "count voxels".to_owned())
        } else if is_near(decimal) {
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
        repair.factor *= factor;
        repair.notes.push(format!(
            "its distances {what}: multiplied by {}",
            factor as f32
        ));
    }

    /// Applies the repairs to values, background and tiles. Values are scaled first; background and tiles are set in
    /// the unit of the result.
    pub(super) fn repair(&mut self, repair: &Repair, session: Session<'_>) -> Result<(), VdbError> {
        let failed = |e| VdbError::of("reading a level set", session, &e);
        let host = session.host();
        let factor = repair.factor as f32;
        if factor != 1.0 {
            ffi::grid_scale_values(self.grid.pin_mut(), factor, 0.0, &host).map_err(failed)?;
        }
        if let Some(background) = repair.background {
            ffi::grid_set_background(self.grid.pin_mut(), background, &host).map_err(failed)?;
        }
        // Active tiles lie beyond the band: they become inactive, with the background of their side.
        if repair.has_active_tiles {
            let tiles =
                super::leaves::tiles_of(&self.grid, TileChoice::Distinct).map_err(failed)?;
            for is_inside in [false, true] {
                let of_side = tiles
                    .iter()
                    .filter(|t| t.active && (t.value < 0.0) == is_inside);
                let cubes: Vec<i32> = of_side
                    .flat_map(|t| [t.origin[0], t.origin[1], t.origin[2], t.edge])
                    .collect();
                let background = repair.half_width * self.own_edge();
                let fill = if is_inside {
                    -background as f32
                } else {
                    background as f32
                };
                ffi::grid_edit(self.grid.pin_mut(), &[], &[], &[], &cubes, fill, &host)
                    .map_err(failed)?;
            }
        }
        Ok(())
    }

    /// Fills in the signs of inactive values; returns by how many the number of those below zero changed.
    pub(super) fn fill_signs(&mut self, session: Session<'_>) -> Result<u64, VdbError> {
        let failed = |e| VdbError::of("reading a level set", session, &e);
        let before = self.inactive_inside()?;
        ffi::grid_flood_fill(self.grid.pin_mut(), &session.host()).map_err(failed)?;
        let wrong = before.abs_diff(self.inactive_inside()?);
        if wrong == 0 {
            return Ok(0);
        }
        // Pruning turns leaves without active voxels into tiles, whose signs come from their neighbours.
        ffi::grid_prune(self.grid.pin_mut(), &session.host()).map_err(failed)?;
        ffi::grid_flood_fill(self.grid.pin_mut(), &session.host()).map_err(failed)?;
        Ok(before.abs_diff(self.inactive_inside()?))
    }

    /// Number of inactive voxels below zero.
    fn inactive_inside(&self) -> Result<u64, VdbError> {
        let mut count = 0;
        for leaf in self.leaves()?.iter() {
            let below = druse_solids::voxel_mask::negative(leaf.values);
            let words = below.iter().zip(leaf.mask);
            count += words
                .map(|(b, m)| u64::from((b & !m).count_ones()))
                .sum::<u64>();
        }
        let tiles = super::leaves::tiles_of(&self.grid, TileChoice::Distinct)
            .map_err(|e| VdbError::plain("listing tiles", &e))?;
        let inside = tiles.iter().filter(|t| !t.active && t.value < 0.0);
        Ok(count + inside.map(|t| (t.edge as u64).pow(3)).sum::<u64>())
    }
}
