//! Messages for grids that are refused: what was found, what is expected, and the remedy.
//!
//! The checks are elsewhere; this file has the words that several share. Remedies name options of the command line and
//! keys of a recipe.

use super::error::{FileError, VdbError};
use super::file::GridInfo;
use super::torn_band::BandGaps;
use super::volume::Volume;
use crate::frame::Vec3;
use std::path::Path;

/// A grid of a file, for errors.
pub(super) struct Located<'a> {
    pub path: &'a Path,
    pub grid: &'a str,
}

impl Located<'_> {
    /// The error of a refusal, with the file and the grid.
    pub fn refuse(&self, refusal: Refusal) -> FileError {
        FileError::NotALevelSet {
            path: self.path.to_owned(),
            grid: self.grid.to_owned(),
            found: refusal.found,
            expected: refusal.expected.to_owned(),
            hint: refusal.hint,
        }
    }

    /// The error of a failed operation on the grid: a cancellation stays one, an open surface is a refusal with a
    /// remedy, any other failure is one of OpenVDB.
    pub fn failed(&self, error: VdbError) -> FileError {
        match error {
            VdbError::Cancelled(c) => FileError::Cancelled(c),
            VdbError::Open => self.refuse(Refusal::new(
                "values that end before the surface does: it is open",
                "values on both sides of the whole surface",
                "write the grid again with one voxel more around it, or choose another value",
            )),
            error => FileError::OpenVdb {
                path: self.path.to_owned(),
                reason: error.to_string(),
            },
        }
    }
}

/// The defect of a grid, the expectation and the remedy.
pub(super) struct Refusal {
    pub found: String,
    pub expected: &'static str,
    pub hint: String,
}

impl Refusal {
    /// A refusal from what was found, what was expected, and a remedy.
    pub fn new(found: impl Into<String>, expected: &'static str, hint: impl Into<String>) -> Self {
        Self {
            found: found.into(),
            expected,
            hint: hint.into(),
        }
    }
}

/// The hint to give a value of the surface, rounded to four digits.
pub(super) fn value_hint(value: f64) -> String {
    // Four digits: the step is a thousandth of the leading digit's place; 1e-30 stands for zero, whose logarithm is
    // infinite.
    let step = 10f64.powi(value.abs().max(1e-30).log10().floor() as i32 - 3);
    let value = ((value / step).round() * step) as f32;
    format!("--value {value}; in a recipe value = {value} beside the path")
}

/// A world position as text, rounded to a thousandth of a voxel's edge or finer.
pub(super) fn place_of(at: Vec3, edge: f64) -> String {
    let step = 10f64.powi(edge.log10().floor() as i32 - 3);
    // The sum turns -0 into 0.
    let [x, y, z] = [at.x, at.y, at.z].map(|c| ((c / step).round() * step) as f32 + 0.0);
    format!("({x}, {y}, {z})")
}

/// The refusal of a band with gaps: too narrow on one side, or with holes.
pub(super) fn torn(gaps: BandGaps, info: &GridInfo) -> Refusal {
    let at = gaps.first.unwrap_or_default();
    let at = info.map.map_or(at, |m| m.world(at));
    let place = place_of(at, info.cube_edge());
    // More than a fifth of all pairs: one side of the band is missing as a whole, else there are holes.
    if gaps.gaps * 5 > gaps.crossings {
        return Refusal::new(
            format!(
                "a band that is narrower than a voxel on one side: {} of {} pairs of neighbours across the surface lack a distance, \
                 the first at {place}",
                gaps.gaps, gaps.crossings
            ),
            "a band of at least one voxel on each side",
            value_hint(0.0) + " (which rebuilds the band; the surface moves by up to half a voxel)",
        );
    }
    Refusal::new(
        format!(
            "a torn surface: {} of {} pairs of neighbours across it lack a distance, the first at {place}",
            gaps.gaps, gaps.crossings
        ),
        "a complete narrow band, closed around the solid",
        "write it again in the program that made it, with all leaves of its band; druse voxelize makes one from a mesh",
    )
}

impl Volume {
    /// The error for voxels that are not axis-aligned cubes.
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
                "--resample resamples it to cubes of {edge}, --resample=LENGTH to others (druse filter, mesh, slice; for other \
                 commands druse filter FILE -o CUBES.vdb resample={edge}); in a recipe resample = true beside the path"
            ),
        ))
    }
}
