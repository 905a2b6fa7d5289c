//! The report of a run: the content of `report.json`.
//!
//! Lengths are in the recipe's unit, places in its coordinates. Values that were not measured are left out or null; a
//! merge of bricks has no sampling, so that its counts are 0.

use super::deck_facts::{DeckFacts, MacroDeckFacts};
use super::histogram::Histogram;
use super::layer_facts::BuildReport;
use super::requirement::Requirement;
use super::void_facts::{CavitiesReport, DrainReport};
pub use super::warning::Warning;
use crate::frame::Aabb;
use crate::tiling::{Certificate, Discontinuity, FaceStatistics, Kernel};
use crate::vdb::{ComponentSelection, RemovedComponents};
use serde::Serialize;
use std::collections::BTreeMap;

/// A run's report. Lengths are in the recipe's unit.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Version of Druse.
    pub druse: String,
    /// The recipe's file.
    pub recipe: String,
    /// BLAKE3 of the recipe's text with its overrides.
    pub recipe_blake3: String,
    /// Unit of the lengths here.
    pub unit: String,
    /// The files that were read.
    pub inputs: Vec<Input>,
    /// The scaffold; absent without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scaffold: Option<ScaffoldReport>,
    /// The cells that were used, by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub cells: BTreeMap<String, serde_json::Value>,
    /// Continuity over all shared faces; with `certificate = true`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub continuity: Option<ContinuityReport>,
    /// The bricks of the run; absent for a run in memory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bricks: Option<BricksReport>,
    /// Operations that move the surface by a distance; absent without any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub offsets: Vec<OffsetReport>,
    /// The sampling.
    pub band: BandReport,
    /// The solid after the last operation.
    pub solid: SolidReport,
    /// Time per stage.
    pub stages: Vec<Stage>,
    /// Number of worker threads.
    pub threads: usize,
    /// Peak memory of the process.
    pub peak_memory_bytes: u64,
    /// The files that were written.
    pub outputs: Vec<OutputFile>,
    /// Warnings of the run.
    pub warnings: Vec<Warning>,
    /// The requirements of the recipe; absent without any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub requirements: Vec<Requirement>,
}

/// A file that was read.
#[derive(Clone, Debug, Serialize)]
pub struct Input {
    /// The recipe's key, as in `op.0.intersect.mesh`.
    pub key: String,
    /// Its path.
    pub path: String,
    /// BLAKE3 of its bytes.
    pub hash: String,
    /// Its box in the recipe's unit; for a cell, in reference coordinates.
    #[serde(rename = "box", serialize_with = "corners")]
    pub bounds: Aabb,
}

/// The scaffold.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ScaffoldReport {
    /// Number of elements of each kind.
    pub elements: BTreeMap<String, u64>,
    /// Elements whose Jacobian changes sign or is negative.
    pub inverted: u64,
    /// Nodes that lie on a face or edge they do not belong to.
    pub hanging: u64,
    /// Conforming components.
    pub components: u64,
    /// Volume of all elements.
    pub volume: f64,
    /// What the file's reader merged or left out.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Least and greatest dihedral angle of straight tets, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dihedral_degrees: Option<[f64; 2]>,
}

/// Continuity over the faces that elements share.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ContinuityReport {
    /// Greatest jump of the field's value, over the field's range.
    pub value_jump_max: f64,
    /// 99th percentile of that jump over the points.
    pub value_jump_p99: f64,
    /// 99th percentile of the angle between both sides' surface normals, degrees.
    pub crease_degrees_p99: f64,
    /// Greatest such angle, degrees.
    pub crease_degrees_max: f64,
    /// Number of elements turned so that cells continue over their faces.
    pub turned_elements: usize,
    /// Number of elements that hold the cells in several turns, where no turn alone makes them continue.
    pub blended_elements: usize,
    /// Statistics by kind of face.
    pub faces: Vec<FaceStatistics>,
    /// The points with the greatest jumps.
    pub worst: Vec<Discontinuity>,
}

impl ContinuityReport {
    /// The report of a certificate, for a scaffold without turned elements.
    pub fn new(c: &Certificate) -> Self {
        Self {
            value_jump_max: c.value_jump_max,
            value_jump_p99: c.value_jump_p99,
            crease_degrees_p99: c.crease_degrees_p99,
            crease_degrees_max: c.crease_degrees_max,
            faces: c.kinds.clone(),
            worst: c.worst.clone(),
            ..Self::default()
        }
    }
}

/// Greatest jump, over the field's range, of a field that counts as continuous.
const MAX_CONTINUOUS_JUMP: f64 = 1e-5;
/// Gap between the faces of neighbours, over the magnitude of their coordinates, above which the mesh
/// does not conform.
const MIN_RELATIVE_GAP: f64 = 1e-6;

impl Report {
    /// Whether every requirement is met.
    pub fn meets_requirements(&self) -> bool {
        self.requirements.iter().all(|r| r.met)
    }
}

impl ContinuityReport {
    /// The text of W114 if the field is not continuous, with the worst point and a remedy; `None` where the
    /// greatest jump is within `MAX_CONTINUOUS_JUMP`.
    pub fn warning(&self) -> Option<String> {
        let seam = self.worst.first()?;
        if self.value_jump_max <= MAX_CONTINUOUS_JUMP {
            return None;
        }
        // Magnitude of the coordinates there, beside which a gap counts.
        let reach = seam.at.iter().fold(0.0f64, |m, c| m.max(c.abs()));
        let remedy = if seam.gap > MIN_RELATIVE_GAP * reach {
            "the mesh does not conform there, its faces have a gap: druse scaffold check FILE \
             lists hanging nodes and open faces"
        } else {
            "use cells that match on the faces: without group, so that they have the full symmetry of their \
             element, or all_hex = true with one hex cell; a smaller tiling.tolerance makes finer tables"
        };
        Some(format!(
            "the field is not continuous: it jumps by {:.2e} of its range; expected at most \
             {MAX_CONTINUOUS_JUMP:e}; the worst point is {} between elements {} and {}; {remedy}",
            self.value_jump_max,
            crate::frame::place_figures(seam.at.into()),
            seam.elements[0],
            seam.elements[1],
        ))
    }
}

/// The sampling.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct BandReport {
    /// Edge of a voxel.
    pub voxel_size: f64,
    /// Half width in voxels.
    pub half_width: f64,
    /// Active voxels of the result.
    pub active_voxels: u64,
    /// Leaves of the result.
    pub leaves: u64,
    /// Active voxels of the field's own sampling, before operations on the level set.
    pub active_voxels_sampled: u64,
    /// Leaves that the bound could not exclude.
    pub leaves_touched: u64,
    /// Leaves with active voxels.
    pub leaves_kept: u64,
    /// Number of points at which the field was evaluated.
    pub voxels_evaluated: u64,
    /// Elements of the scaffold near those leaves, whose cells were evaluated. Absent without a scaffold,
    /// for round beams and for merges of bricks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elements_visited: Option<u64>,
    /// Leaves that were interpolated between values of the cell at nodes; absent as above.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leaves_by_nodes: Option<u64>,
    /// The kernel that evaluated the tiling; absent as above.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kernel: Option<Kernel>,
}

/// The method by which an operation moved the surface by a distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum OffsetMethod {
    /// The field was evaluated with an offset.
    Field,
    /// Distances were rebuilt from points of the level set's surface, as far as the move needs.
    Points,
    /// OpenVDB's filter moved the surface and rebuilt distances every half voxel.
    Filter,
}

/// An operation that moves the surface by a distance, and its method.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OffsetReport {
    /// The operation, as in `op.2.dilate`.
    pub op: String,
    /// Whether the field was evaluated with an offset.
    pub re_evaluated: bool,
    /// The method.
    #[serde(rename = "way")]
    pub method: OffsetMethod,
    /// Root mean square error of the offset field at the foot points of voxels of its band, voxels.
    /// Absent if the offset leaves nothing, or the solid was a level set already.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_voxels: Option<f64>,
    /// The greatest error that is accepted.
    pub limit_voxels: f64,
    /// The reason for the method.
    pub why: &'static str,
}

/// The bricks of a run. Sampling counts of the report are those of the bricks that this run made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BricksReport {
    /// Number of bricks.
    pub count: u64,
    /// Blocks of 128 voxels along the edge of one.
    pub edge: u32,
    /// Voxels around a brick that were sampled with it.
    pub halo: u32,
    /// Complete bricks that existed before the run.
    pub found_whole: u64,
}

/// The solid.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SolidReport {
    /// Its volume.
    pub volume: f64,
    /// Area of its surface.
    pub area: f64,
    /// Its volume over that of the envelope, or of the scaffold without one.
    pub volume_fraction: Option<f64>,
    /// Volume fraction that the recipe requests of the cell or of the tiling (there the mean).
    #[serde(rename = "volume_fraction_asked")]
    pub volume_fraction_target: Option<f64>,
    /// Volume fraction of the cell in the elements as they are in space.
    pub volume_fraction_cell: Option<f64>,
    /// Number of connected components.
    pub components: u64,
    /// Number of closed cavities; where a requirement counts them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closed_cavities: Option<u64>,
    /// Closed cavities and those with a narrow way out; where `escape_radius` is required.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cavities: Option<CavitiesReport>,
    /// Components that `keep_largest` and `drop_small` removed.
    pub dropped_components: u64,
    /// Their volume.
    pub dropped_volume: f64,
    /// Cavities that `fill_voids` filled.
    pub filled_voids: u64,
    /// Their volume.
    pub filled_volume: f64,
    /// The channels that `drain` drilled, in order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub drains: Vec<DrainReport>,
    /// The layers of the build; with `[build]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub build: Option<BuildReport>,
    /// First percentile of the diameters of inscribed balls. A run in bricks measures balls of at most
    /// 24 voxels.
    pub least_wall: Option<f64>,
    /// The centre of that ball.
    pub least_wall_place: Option<[f64; 3]>,
    /// Diameters of inscribed balls by number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub walls: Option<Histogram>,
    /// First percentile of the diameters of balls in the void that touch opposite walls; where a
    /// requirement limits gaps. A run in bricks measures balls of at most 24 voxels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least_gap: Option<f64>,
    /// The centre of that ball.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least_gap_place: Option<[f64; 3]>,
    /// Diameters of balls in the void that touch opposite walls, by number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gaps: Option<Histogram>,
    /// Mass in grams; where a requirement gives the density.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// The thickness of its walls and the requested thickness.
    pub thickness: Option<ThicknessReport>,
    /// The box around it.
    #[serde(rename = "box", serialize_with = "maybe_corners")]
    pub bounds: Option<Aabb>,
}

/// The requested thickness, and that of the solid as percentiles, by area, of the diameters of inscribed
/// balls. Balls that touch a cut (an outer face of the scaffold, a mesh of a Boolean operation) are left
/// out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ThicknessReport {
    /// The requested thickness in the recipe's unit; least and greatest where it varies.
    #[serde(rename = "asked")]
    pub requested: Option<RequestedThickness>,
    /// The fifth percentile.
    pub p5: f64,
    /// The median.
    pub p50: f64,
    /// The 95th percentile.
    pub p95: f64,
}

/// One thickness, or a range of them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum RequestedThickness {
    /// The same everywhere.
    Uniform(f64),
    /// Least and greatest.
    Range([f64; 2]),
}

impl SolidReport {
    /// Adds what an operation removed to the counts: filled voids under `filled`, all other components under
    /// `dropped`.
    pub(crate) fn add(&mut self, unwanted: ComponentSelection, dropped: RemovedComponents) {
        if matches!(unwanted, ComponentSelection::Voids(_)) {
            self.filled_voids += dropped.components as u64;
            self.filled_volume += dropped.volume;
        } else {
            self.dropped_components += dropped.components as u64;
            self.dropped_volume += dropped.volume;
        }
    }
}

/// Time of a stage.
#[derive(Clone, Debug, Serialize)]
pub struct Stage {
    /// Its name.
    pub name: String,
    /// Wall time.
    pub seconds: f64,
    /// Greatest memory of the process up to its end.
    pub peak_memory_bytes: u64,
}

/// A file that was written.
#[derive(Clone, Debug, Serialize)]
pub struct OutputFile {
    /// Its path.
    pub path: String,
    /// Its size.
    pub bytes: u64,
    /// Unit of its lengths, where it has any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// BLAKE3 of its bytes.
    pub hash: String,
    /// BLAKE3 of the grids' content, for level sets: equal whenever the grids are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub content_hash: Option<String>,
    /// The facts of a mesh.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshFacts>,
    /// Of a finite-element deck.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deck: Option<DeckFacts>,
    /// Of a deck of the scaffold's elements.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub macro_deck: Option<MacroDeckFacts>,
}

/// Facts of a mesh file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MeshFacts {
    /// Triangles, quads or beams.
    pub faces: u64,
    /// Vertices that were moved onto edges and corners, where the output requests it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub creased: Option<u64>,
    /// Vertices that a projection did not move.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kept: Option<u64>,
    /// Greatest magnitude of the exact field at the other vertices, recipe units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
}

/// Results of the stages of a run.
pub(crate) struct StageResults {
    pub band: BandReport,
    pub solid: SolidReport,
    pub bricks: Option<BricksReport>,
    pub outputs: Vec<OutputFile>,
}

fn corners<S: serde::Serializer>(b: &Aabb, s: S) -> Result<S::Ok, S::Error> {
    [b.min, b.max].map(|v| [v.x, v.y, v.z]).serialize(s)
}

#[allow(clippy::ref_option)] // serde passes a reference to the field
fn maybe_corners<S: serde::Serializer>(b: &Option<Aabb>, s: S) -> Result<S::Ok, S::Error> {
    b.map(|b| [b.min, b.max].map(|v| [v.x, v.y, v.z]))
        .serialize(s)
}
