//! Conversion of a grid of floats from another program to a level set: interpretation, repairs, refusals.
//!
//! Repairs that do not move the surface are made with a note: signs of inactive values, a wrong background,
//! distances in other units than the voxels, a missing class; active tiles beyond the band are made inactive without
//! one. On request an inside-out grid is inverted, and a grid of non-cubic voxels is resampled to cubes. Everything
//! else is refused with a remedy.

use super::error::{FileError, VdbError};
use super::refusal::{Located, Refusal, place_of, torn, value_hint};
use super::repair::Repair;
use super::resample::on_cubes;
use super::value_survey::Slopes;
use super::volume::Volume;
use super::{LevelSet, Session};
use crate::frame::Vec3;
use std::path::Path;

/// Options of the conversion of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridReading {
    /// The value on the surface; a level set is then rebuilt around it.
    pub value: Option<f64>,
    /// Exchange inside and outside of a level set that is inside out.
    pub invert: bool,
    /// Treatment of voxels that are not axis-aligned cubes.
    pub cubes: Cubes,
    /// Half width of rebuilt bands, voxels.
    pub half_width: f64,
    /// Accept a band with gaps, so that they can be counted.
    pub allow_torn: bool,
}

impl Default for GridReading {
    fn default() -> Self {
        Self {
            value: None,
            invert: false,
            cubes: Cubes::Refuse,
            half_width: 3.0, // as in OpenVDB
            allow_torn: false,
        }
    }
}

/// Treatment of voxels that are not axis-aligned cubes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cubes {
    /// They are refused.
    Refuse,
    /// The grid is resampled to cubes of this edge, in the file's unit.
    Edge(f64),
    /// The level set stays in index space: edge 1, origin 0.
    IndexSpace,
}

/// A converted level set and its repairs.
pub struct Adopted {
    /// The level set; in index space where the voxels are no cubes and [`Cubes::IndexSpace`] is chosen.
    pub solid: LevelSet,
    /// One sentence per repair, and for what is read as another kind of grid or only noticed.
    pub notes: Vec<String>,
}

/// The interpretation of a grid.
#[derive(Clone, Debug, PartialEq)]
enum Plan {
    /// The isosurface at a value.
    Isosurface(f64),
    /// The surface at which the density of a fog begins to rise, over this many voxels.
    FootOfRamp(f64),
    /// A level set with repairs.
    LevelSet(Repair),
}

/// A fog whose greatest value lies in this range has densities from 0 to 1.
const FULL_FOG: [f32; 2] = [0.9, 1.1];
/// The density of a level set made a fog rises evenly: the ninth decile of its slopes is at most this many times the
/// median. Where walls are thin, many slopes are less.
const EVEN_SLOPE: f64 = 1.15;
/// Least width of such a ramp, voxels. A narrower one is the edge of a smoothed mask, with the surface in its middle.
const MIN_RAMP: f64 = 1.8;

impl Volume {
    /// Voxel edge (in the file's unit) and half width (voxels) of the grid's level set, or of its resampling to cubes.
    pub fn voxels(&self) -> (f64, f64) {
        let width = match self.plan(&GridReading {
            invert: self.survey.is_inside_out(),
            ..GridReading::default()
        }) {
            Ok(Plan::LevelSet(repair)) if self.info.cubic => repair.half_width,
            _ => GridReading::default().half_width,
        };
        (self.info.cube_edge(), width)
    }

    /// Converts the grid, or its isosurface, to a level set; `path` is the name in errors.
    ///
    /// # Errors
    /// [`FileError::NotALevelSet`] with the defect and the remedy, [`FileError::Cancelled`], or errors of OpenVDB.
    pub fn solid(
        mut self,
        path: &Path,
        how: &GridReading,
        session: Session<'_>,
    ) -> Result<Adopted, FileError> {
        let name = self.name.clone();
        let located = Located { path, grid: &name };
        let failed = |e: VdbError| located.failed(e);
        if !self.info.cubic && how.cubes == Cubes::Refuse {
            return Err(self.refuse_voxels(path));
        }
        // The plan follows from the request, the class and the values; no value has changed so far.
        let plan = self.plan(how).map_err(|r| located.refuse(r))?;
        let map = self.info.map;
        let cubes = how.cubes;
        let (mut solid, notes) = match plan.clone() {
            Plan::Isosurface(value) => {
                let solid = self.isosurface(value, how.half_width, session);
                let notes = if how.value.is_none() {
                    vec![fog_note(&plan)]
                } else {
                    Vec::new()
                };
                (solid.map_err(failed)?, notes)
            }
            Plan::FootOfRamp(ramp) => {
                let solid = self.foot_of_ramp(ramp, how.half_width, session);
                (solid.map_err(failed)?, vec![fog_note(&plan)])
            }
            Plan::LevelSet(repair) => {
                self.repair(&repair, session).map_err(failed)?;
                // Signs of inactive values are free to mend, because the band beside them fixes them.
                let wrong = self.fill_signs(session).map_err(failed)?;
                let mut notes = repair.notes;
                if wrong > 0 {
                    notes.push(format!(
                        "{wrong} inactive values had the wrong sign; they now have the sign of the band beside them"
                    ));
                }
                for note in &notes {
                    log::info!(target: "druse::vdb", "{}, grid {}: {note}", path.display(), self.name);
                }
                let (transform, origin) = self.frame().map_err(failed)?;
                let solid = LevelSet {
                    transform,
                    origin,
                    half_width: repair.half_width,
                    grid: self.grid,
                };
                if !how.allow_torn {
                    let gaps = solid.band_gaps().map_err(failed)?;
                    if gaps.gaps > 0 {
                        return Err(located.refuse(torn(gaps, &self.info)));
                    }
                }
                (solid, notes)
            }
        };
        // So far a grid with a map is in index space.
        if let (Some(map), Cubes::Edge(edge)) = (map, cubes) {
            let half_width = how.half_width;
            let made = on_cubes(&solid, &map, edge, half_width, session);
            solid = made.map_err(failed)?;
        }
        Ok(Adopted { solid, notes })
    }

    /// The interpretation of the grid, or its refusal. Nothing changes. A value that the caller gives wins over the
    /// class; values that are not finite are refused first.
    fn plan(&self, how: &GridReading) -> Result<Plan, Refusal> {
        let survey = &self.survey;
        if let Some(refusal) = self.not_finite() {
            return Err(refusal);
        }
        if let Some(value) = how.value {
            return Ok(Plan::Isosurface(value));
        }
        match self.info.class.as_str() {
            "level set" => self.level_set_repair(how, Vec::new()).map(Plan::LevelSet),
            "fog volume" => self.fog_plan(),
            class => {
                let [low, high] = survey.range.unwrap_or_default();
                // Values of both signs with nearly equal slopes are distances, whatever the class and the unit.
                let is_band =
                    low < 0.0 && high > 0.0 && self.slopes().is_some_and(Slopes::is_uniform);
                if is_band {
                    let note = format!(
                        "its class is {class}, and its values are signed distances: read as a level set"
                    );
                    return self.level_set_repair(how, vec![note]).map(Plan::LevelSet);
                }
                Err(Refusal::new(
                    format!("the class {class} and values from {low} to {high}"),
                    "a level set, a fog volume, or the value on its surface",
                    value_hint(f64::from(low + high) / 2.0),
                ))
            }
        }
    }

    /// The refusal of the first value that is NaN or infinite.
    pub(super) fn not_finite(&self) -> Option<Refusal> {
        let (v, voxel) = self.survey.first_non_finite?;
        let map = self.info.index_map();
        let index = Vec3::from(voxel.0.map(f64::from));
        Some(Refusal::new(
            format!(
                "{v} at voxel {:?}, {}, the first of {} such values",
                voxel.0,
                place_of(map.world(index), map.shortest_edge(index)),
                self.survey.not_finite
            ),
            "finite numbers",
            "fill these voxels in the program that made the file, or deactivate them with the background as value",
        ))
    }

    /// Notes on the grid before its conversion: what commands refuse or repair.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let is_solid = matches!(self.info.class.as_str(), "level set" | "fog volume");
        match self.plan(&GridReading::default()) {
            Ok(Plan::LevelSet(repair)) => notes.extend(repair.notes),
            Err(refusal) if is_solid || self.survey.not_finite > 0 => {
                notes.push(format!(
                    "found {}; expected {}: {}",
                    refusal.found, refusal.expected, refusal.hint
                ));
            }
            Ok(plan @ (Plan::Isosurface(_) | Plan::FootOfRamp(_))) => notes.push(fog_note(&plan)),
            Err(_) => {}
        }
        if !self.info.cubic {
            notes.push(format!(
                "{}: commands accept it with --resample",
                self.info.shape()
            ));
        }
        notes
    }

    /// Where the surface of a fog volume is: at the foot of a ramp that rises evenly over enough voxels, as OpenVDB and
    /// Druse make the fog of a level set, with the density 0 at the surface; else at half density. The ramp's width is
    /// in voxels. Other ranges than 0 to 1 are refused.
    fn fog_plan(&self) -> Result<Plan, Refusal> {
        let high = self.survey.range.map_or(0.0, |r| r[1]);
        let low = self.survey.range.map_or(0.0, |r| r[0]);
        let low = low.min(self.info.background.unwrap_or(0.0) as f32);
        // A fog's densities go from 0 to 1: the least is above -0.1, the greatest from 0.9 to 1.1.
        if (FULL_FOG[0]..=FULL_FOG[1]).contains(&high) && low > -0.1 {
            let even = self
                .slopes()
                .filter(|Slopes([_, median, high])| *median > 0.0 && *high <= EVEN_SLOPE * median);
            let ramp = even.map(|slopes| f64::from(high) / slopes.median());
            return Ok(match ramp {
                Some(ramp) if ramp >= MIN_RAMP => Plan::FootOfRamp(ramp),
                _ => Plan::Isosurface(0.5),
            });
        }
        let middle = f64::from(low.max(0.0) + high) / 2.0;
        Err(Refusal::new(
            format!("a fog with values from {low} to {high}"),
            "a fog from 0 to 1, or the value on its surface",
            value_hint(middle),
        ))
    }
}

/// The note on where the surface of a fog is taken.
fn fog_note(plan: &Plan) -> String {
    match plan {
        Plan::FootOfRamp(ramp) => format!(
            "its density rises evenly from 0 to 1 over {ramp:.1} voxels, as in the fog of a level set: the surface is \
             taken at density 0; value = 0.5 takes half density"
        ),
        Plan::Isosurface(value) => format!("the surface of the fog is taken at density {value}"),
        Plan::LevelSet(_) => String::new(),
    }
}
