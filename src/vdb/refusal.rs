//! Why a grid of others is refused, and what to do.

use super::torn_band::Tears;
use super::{FileError, GridInfo, VdbError, Volume};
use crate::frame::Vec3;
use std::path::Path;

/// A grid of a file, for errors.
pub(super) struct Located<'a> {
    pub path: &'a Path,
    pub grid: &'a str,
}

impl Located<'_> {
    pub fn refuse(&self, refusal: Refusal) -> FileError {
        FileError::NotALevelSet {
            path: self.path.to_owned(),
            grid: self.grid.to_owned(),
            found: refusal.found,
            expected: refusal.expected.to_owned(),
            hint: refusal.hint,
        }
    }

    pub fn failed(&self, error: VdbError) -> FileError {
        match error {
            VdbError::Cancelled(c) => FileError::Cancelled(c),
            VdbError::Open => self.refuse(Refusal::new(
                "values that end where the surface goes on: it is open",
                "values on both sides of all of the surface",
                "write the grid again with one voxel more around it, or choose another value",
            )),
            error => FileError::OpenVdb {
                path: self.path.to_owned(),
                reason: error.to_string(),
            },
        }
    }
}

/// What is wrong with a grid and what to do.
pub(super) struct Refusal {
    pub found: String,
    pub expected: &'static str,
    pub hint: String,
}

impl Refusal {
    pub fn new(found: impl Into<String>, expected: &'static str, hint: impl Into<String>) -> Self {
        Self {
            found: found.into(),
            expected,
            hint: hint.into(),
        }
    }
}

pub(super) fn value_hint(value: f64) -> String {
    // Four digits.
    let step = 10f64.powi(value.abs().max(1e-30).log10().floor() as i32 - 3);
    let value = ((value / step).round() * step) as f32;
    format!("--value {value}; in a recipe value = {value} beside the path")
}

/// A point of the world as a message has it, to a thousandth of a voxel's edge or better.
pub(super) fn place_of(at: Vec3, edge: f64) -> String {
    let step = 10f64.powi(edge.log10().floor() as i32 - 3);
    let [x, y, z] = [at.x, at.y, at.z].map(|c| ((c / step).round() * step) as f32 + 0.0);
    format!("({x}, {y}, {z})")
}

/// A torn surface: by a band that ends before the next voxel, or by a hole.
pub(super) fn torn(tears: Tears, info: &GridInfo) -> Refusal {
    let at = tears.first.unwrap_or_default();
    let at = info.map.map_or(at, |m| m.world(at));
    let place = place_of(at, info.cube_edge());
    if tears.torn * 5 > tears.crossings {
        return Refusal::new(
            format!(
                "a band that is narrower than a voxel on one side: of {} pairs of neighbours across the surface {} lack a distance, \
                 the first at {place}",
                tears.crossings, tears.torn
            ),
            "a band of at least one voxel on each side",
            value_hint(0.0)
                + " (which makes the band anew; the surface moves by up to half a voxel)",
        );
    }
    Refusal::new(
        format!(
            "a torn surface: {} of {} pairs of neighbours across it lack a distance, the first at {place}",
            tears.torn, tears.crossings
        ),
        "a whole narrow band, closed around the solid",
        "write it again in the program that made it, with all leaves of its band; druse voxelize makes one of a mesh",
    )
}

impl Volume {
    /// The error of voxels that are no cubes.
    pub(super) fn refuse_voxels(&self, path: &Path) -> FileError {
        let edge = self.info.cube_edge() as f32;
        let located = Located {
            path,
            grid: &self.name,
        };
        located.refuse(Refusal::new(
            self.info.shape(),
            "cubes along the axes",
            format!(
                "--resample brings it onto cubes of {edge}, --resample=LENGTH onto others (druse filter, mesh, slice; for other \
                 commands druse filter FILE -o CUBES.vdb resample={edge}); in a recipe resample = true beside the path"
            ),
        ))
    }
}
