//! From a grid of floats of others to a level set: what it is, what is wrong with it, and what can be mended.
//!
//! Mended with a note is what leaves the surface where it is: signs of inactive values, a background that is none,
//! distances in other units than the voxels', a class that is not stated. On request a grid that is inside out is
//! turned, and a grid whose voxels are no cubes is brought onto cubes. All else is refused with a remedy.

use super::refusal::{Located, Refusal, place_of, torn, value_hint};
use super::repair::Mending;
use super::resample::on_cubes;
use super::value_survey::Slopes;
use super::{FileError, LevelSet, Session, VdbError, Volume};
use crate::frame::Vec3;
use std::path::Path;

/// How a grid of others is to be read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridReading {
    /// The value on the surface, for grids that are no level sets.
    pub value: Option<f64>,
    /// Exchange inside and outside of a level set that is inside out.
    pub invert: bool,
    /// What becomes of voxels that are no cubes along the axes.
    pub cubes: Cubes,
    /// Half width of bands that are made anew, voxels.
    pub half_width: f64,
    /// Leave a torn surface as it is, for whoever counts the tears.
    pub allow_torn: bool,
}

impl Default for GridReading {
    fn default() -> Self {
        Self {
            value: None,
            invert: false,
            cubes: Cubes::Refuse,
            half_width: 3.0,
            allow_torn: false,
        }
    }
}

/// What becomes of voxels that are no cubes along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cubes {
    /// They are refused.
    Refuse,
    /// The grid is brought onto cubes of this edge, the file's unit.
    Edge(f64),
    /// The level set stands in voxel numbers: edge 1, origin 0.
    Numbers,
}

/// A level set of others and what was mended.
pub struct Adopted {
    /// The level set.
    pub solid: LevelSet,
    /// One sentence each.
    pub notes: Vec<String>,
}

/// What a grid is.
#[derive(Clone, Debug, PartialEq)]
enum Plan {
    /// The surface where values are so.
    Isosurface(f64),
    /// A level set.
    LevelSet(Mending),
}

/// Greatest values of a fog that count as 1.
const FULL_FOG: [f32; 2] = [0.9, 1.1];
impl Volume {
    /// Edge and half width (voxels) of the voxels that the grid's level set has, or would have on cubes: the file's
    /// unit.
    pub fn voxels(&self) -> (f64, f64) {
        let width = match self.plan(&GridReading {
            invert: self.survey.is_inside_out(),
            ..GridReading::default()
        }) {
            Ok(Plan::LevelSet(mending)) if self.info.cubic => mending.half_width,
            _ => GridReading::default().half_width,
        };
        (self.info.cube_edge(), width)
    }

    /// The level set that the grid is, or that a value of it bounds; `path` is its name in errors.
    ///
    /// # Errors
    /// [`FileError::NotALevelSet`] with what is missing and what to do, [`FileError::Cancelled`], or what OpenVDB
    /// refuses.
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
        let plan = self.plan(how).map_err(|r| located.refuse(r))?;
        let map = self.info.map;
        let cubes = how.cubes;
        let is_own = self.meta("druse.content_hash").is_some();
        let (mut solid, notes) = match plan {
            Plan::Isosurface(value) => {
                let solid = self.isosurface(value, how.half_width, session);
                (solid.map_err(failed)?, Vec::new())
            }
            Plan::LevelSet(mending) => {
                self.mend(&mending, session).map_err(failed)?;
                let wrong = self.fill_signs(session).map_err(failed)?;
                let mut notes = mending.notes;
                if wrong > 0 {
                    notes.push(format!(
                        "{wrong} inactive values had the wrong sign; they have that of the band beside them now"
                    ));
                }
                let (transform, origin) = self.frame().map_err(failed)?;
                let solid = LevelSet {
                    transform,
                    origin,
                    half_width: mending.half_width,
                    grid: self.grid,
                };
                // Long moves of a surface may leave single pairs without a distance in files of Druse's own;
                // their meshes are closed, and `druse check` counts the pairs.
                if !how.allow_torn && !is_own {
                    let tears = solid.tears().map_err(failed)?;
                    if tears.torn > 0 {
                        return Err(located.refuse(torn(tears, &self.info)));
                    }
                }
                (solid, notes)
            }
        };
        if let (Some(map), Cubes::Edge(edge)) = (map, cubes) {
            let half_width = how.half_width;
            let made = on_cubes(&solid, &map, (edge, half_width), session);
            solid = made.map_err(failed)?;
        }
        Ok(Adopted { solid, notes })
    }

    /// What is made of the grid, or why nothing.
    fn plan(&self, how: &GridReading) -> Result<Plan, Refusal> {
        let survey = &self.survey;
        if let Some(refusal) = self.not_finite() {
            return Err(refusal);
        }
        if let Some(value) = how.value {
            return Ok(Plan::Isosurface(value));
        }
        match self.info.class.as_str() {
            "level set" => self.level_set(how, Vec::new()).map(Plan::LevelSet),
            "fog volume" => self.fog_value().map(Plan::Isosurface),
            class => {
                let [low, high] = survey.range.unwrap_or_default();
                let is_band =
                    low < 0.0 && high > 0.0 && self.slopes().is_some_and(Slopes::is_uniform);
                if is_band {
                    let note = format!(
                        "its class is {class}, and its values are signed distances: taken for a level set"
                    );
                    return self.level_set(how, vec![note]).map(Plan::LevelSet);
                }
                Err(Refusal::new(
                    format!("the class {class} and values from {low} to {high}"),
                    "a level set, a fog volume, or the value on its surface",
                    value_hint(f64::from(low + high) / 2.0),
                ))
            }
        }
    }

    /// The first value that is NaN or infinite, with its place.
    pub(super) fn not_finite(&self) -> Option<Refusal> {
        let (v, voxel) = self.survey.first?;
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

    /// What is to be said of the grid before anything is made of it: what commands refuse or mend.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let is_solid = matches!(self.info.class.as_str(), "level set" | "fog volume");
        match self.plan(&GridReading::default()) {
            Ok(Plan::LevelSet(mending)) => notes.extend(mending.notes),
            Err(refusal) if is_solid || self.survey.not_finite > 0 => {
                notes.push(format!(
                    "found {}; expected {}: {}",
                    refusal.found, refusal.expected, refusal.hint
                ));
            }
            Ok(Plan::Isosurface(_)) | Err(_) => {}
        }
        if !self.info.cubic {
            notes.push(format!(
                "{}: commands take it with --resample",
                self.info.shape()
            ));
        }
        notes
    }

    /// The value on the surface of a fog.
    fn fog_value(&self) -> Result<f64, Refusal> {
        let high = self.survey.range.map_or(0.0, |r| r[1]);
        let low = self.survey.range.map_or(0.0, |r| r[0]);
        let low = low.min(self.info.background.unwrap_or(0.0) as f32);
        if (FULL_FOG[0]..=FULL_FOG[1]).contains(&high) && low > -0.1 {
            return Ok(0.5);
        }
        let middle = f64::from(low.max(0.0) + high) / 2.0;
        Err(Refusal::new(
            format!("a fog with values from {low} to {high}"),
            "a fog from 0 to 1, or the value on its surface",
            value_hint(middle),
        ))
    }
}
