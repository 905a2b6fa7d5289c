//! What a run found and made: the content of `report.json`.

use super::cut_faces::CutFaces;
use super::least_wall::Sampled;
use super::requirements::Requirement;
use crate::frame::Aabb;
use crate::progress::Threads;
use crate::tiling::{Certificate, FaceStatistics, Kernel, Seam};
use crate::vdb::{Dropped, Unwanted};
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
    /// How the run went through bricks; absent when it was in memory as a whole.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bricks: Option<BricksReport>,
    /// Operations that move the surface of what is still a field; absent without any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub offsets: Vec<OffsetReport>,
    /// The sampling.
    pub band: BandReport,
    /// The solid after the last operation.
    pub solid: SolidReport,
    /// Time per stage.
    pub stages: Vec<Stage>,
    /// Threads that were used.
    pub threads: usize,
    /// Greatest memory of the process.
    pub peak_memory_bytes: u64,
    /// The files that were written.
    pub outputs: Vec<OutputFile>,
    /// What looked wrong.
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
    /// Its 99th percentile over the points.
    pub value_jump_p99: f64,
    /// 99th percentile of the angle between both sides' surface normals, degrees.
    pub crease_degrees_p99: f64,
    /// Greatest such angle, degrees.
    pub crease_degrees_max: f64,
    /// By kind of face.
    pub faces: Vec<FaceStatistics>,
    /// The worst places.
    pub worst: Vec<Seam>,
}

impl From<&Certificate> for ContinuityReport {
    fn from(c: &Certificate) -> Self {
        Self {
            value_jump_max: c.value_jump_max,
            value_jump_p99: c.value_jump_p99,
            crease_degrees_p99: c.crease_degrees_p99,
            crease_degrees_max: c.crease_degrees_max,
            faces: c.kinds.clone(),
            worst: c.worst.clone(),
        }
    }
}

/// Jump over the field's range up to which a field counts as continuous.
const CONTINUOUS: f64 = 1e-5;
/// Faces of neighbours that are this share of their coordinates apart do not fit together.
const APART: f64 = 1e-6;

impl Report {
    /// Whether every requirement is met.
    pub fn meets_requirements(&self) -> bool {
        self.requirements.iter().all(|r| r.met)
    }
}

impl ContinuityReport {
    /// W114 if the field is not continuous, with the worst place and what to do about it.
    pub fn warning(&self) -> Option<String> {
        let seam = self.worst.first()?;
        if self.value_jump_max <= CONTINUOUS {
            return None;
        }
        let reach = seam.at.iter().fold(0.0f64, |m, c| m.max(c.abs()));
        let remedy = if seam.gap > APART * reach {
            "the mesh does not fit together there, its faces are apart: druse scaffold check FILE \
             names hanging nodes and open faces"
        } else {
            "use cells that agree on the faces: without group, so that they have their element's whole \
             symmetry, or all_hex = true with one hex cell; a smaller tiling.tolerance makes finer tables"
        };
        Some(format!(
            "the field is not continuous: it jumps by {:.2e} of its range, at most {CONTINUOUS:e} was \
             expected, worst at {} between elements {} and {}; {remedy}",
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
    /// Leaves that held active voxels.
    pub leaves_kept: u64,
    /// At how many points the field was looked at.
    pub voxels_evaluated: u64,
    /// Elements of the scaffold that came near those leaves, so that their cells were looked
    /// at; absent without a scaffold, and where bricks were only merged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elements_visited: Option<u64>,
    /// Leaves whose values the cell at a few nodes told; absent as above.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leaves_by_nodes: Option<u64>,
    /// How the tiled scaffold's values were found; absent without one, and where bricks were only merged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kernel: Option<Kernel>,
}

/// How an operation moved the surface by a distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// The field was evaluated again, with its distances moved.
    Field,
    /// The level set's distances were rebuilt from points of its surface, as far as the move goes.
    Points,
    /// OpenVDB's filter moved it, rebuilding distances every half voxel.
    Filter,
}

/// An operation that moves the surface by a distance, and which way was taken.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OffsetReport {
    /// The operation, as in `op.2.dilate`.
    pub op: String,
    /// Whether the field was evaluated again.
    pub re_evaluated: bool,
    /// Which way was taken.
    pub way: Way,
    /// By how many voxels (root mean square) the moved field is off its surface at the feet of voxels
    /// of its band; absent if nothing is left of it, or it was no field any more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_voxels: Option<f64>,
    /// The most that is accepted.
    pub limit_voxels: f64,
    /// What decided.
    pub why: &'static str,
}

/// A run in bricks. Of the sampling the counts are those of the bricks that this run made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BricksReport {
    /// Number of bricks.
    pub count: u64,
    /// Blocks of 128 voxels along the edge of one.
    pub edge: u32,
    /// Voxels around a brick that were sampled with it.
    pub halo: u32,
    /// Bricks that were there already, whole.
    pub found_whole: u64,
}

/// The solid.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SolidReport {
    /// Its volume.
    pub volume: f64,
    /// Area of its surface.
    pub area: f64,
    /// Its share of the envelope, or of the scaffold where there is none.
    pub volume_fraction: Option<f64>,
    /// Share of its elements that the recipe asked for, of the cell or of the tiling (there the mean).
    pub volume_fraction_asked: Option<f64>,
    /// Share that the cell fills of its elements as they are in space.
    pub volume_fraction_cell: Option<f64>,
    /// Pieces that do not touch.
    pub components: u64,
    /// Enclosed cavities; where a requirement counts them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closed_cavities: Option<u64>,
    /// Pieces that `keep_largest` and `drop_small` removed.
    pub dropped_components: u64,
    /// Their volume.
    pub dropped_volume: f64,
    /// Voids that `fill_voids` closed.
    pub filled_voids: u64,
    /// Their volume.
    pub filled_volume: f64,
    /// First percentile of the diameters of the largest inscribed balls; in bricks if it is at most 24
    /// voxels, which is as far as they look.
    pub least_wall: Option<f64>,
    /// Where it was found.
    pub least_wall_place: Option<[f64; 3]>,
    /// First percentile of the diameters of the largest balls in the empty space that touch opposite walls;
    /// where a requirement is on gaps. In bricks of those of at most 24 voxels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least_gap: Option<f64>,
    /// Where it was found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least_gap_place: Option<[f64; 3]>,
    /// Mass in grams; where a requirement gives the density.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// How thick its walls are beside what was asked.
    pub thickness: Option<ThicknessReport>,
    /// The box around it.
    #[serde(rename = "box", serialize_with = "maybe_corners")]
    pub bounds: Option<Aabb>,
}

/// The thickness asked for, and that of the solid: percentiles, by area, of the diameters of inscribed balls.
/// Balls that touch a cut (an outer face of the scaffold, a mesh that the solid is cut with) are left out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ThicknessReport {
    /// What the recipe asks for in its unit; the least and the greatest where it varies.
    pub asked: Option<Asked>,
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
pub enum Asked {
    /// The same everywhere.
    Uniform(f64),
    /// Least and greatest.
    Range([f64; 2]),
}

impl SolidReport {
    /// Notes what was found of its walls.
    pub(super) fn add_walls(
        &mut self,
        walls: Sampled,
        asked: Option<[f64; 2]>,
        cut: &CutFaces,
        threads: &Threads,
    ) {
        let (all, thicker) = walls.all();
        let percentiles = threads.install(|| cut.percentiles(all, thicker));
        self.thickness = percentiles.map(|[p5, p50, p95]| ThicknessReport {
            asked: asked.map(|[least, greatest]| {
                if greatest - least <= 1e-9 * greatest {
                    Asked::Uniform(greatest)
                } else {
                    Asked::Range([least, greatest])
                }
            }),
            p5,
            p50,
            p95,
        });
        let wall = walls.least();
        self.least_wall = wall.map(|w| w.thickness);
        self.least_wall_place = wall.map(|w| w.place.into());
    }

    /// Notes what was found of the gaps between its walls.
    pub(super) fn add_gaps(&mut self, gaps: Sampled) {
        let gap = gaps.least();
        self.least_gap = gap.map(|g| g.thickness);
        self.least_gap_place = gap.map(|g| g.place.into());
    }

    /// Notes what an operation removed.
    pub(super) fn add(&mut self, unwanted: Unwanted, dropped: Dropped) {
        if matches!(unwanted, Unwanted::Voids(_)) {
            self.filled_voids += dropped.pieces as u64;
            self.filled_volume += dropped.volume;
        } else {
            self.dropped_components += dropped.pieces as u64;
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
    /// BLAKE3 of what it says, for level sets: equal whenever the grids are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub content_hash: Option<String>,
    /// Of a mesh.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshFacts>,
    /// Of a finite-element deck.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deck: Option<DeckFacts>,
}

/// Counts of a finite-element deck; lengths are in the deck's unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct DeckFacts {
    /// Nodes.
    pub nodes: u64,
    /// Elements.
    pub elements: u64,
    /// Edge of the elements.
    pub element_size: f64,
    /// Volume of the elements.
    pub volume: f64,
    /// Elements that share no face with the largest component, left out.
    pub dropped_elements: u64,
    /// Components of these.
    pub dropped_components: u64,
}

/// What is known of a mesh that was written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MeshFacts {
    /// Triangles, quads or beams.
    pub faces: u64,
    /// Vertices that were put onto edges and corners, if that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub creased: Option<u64>,
    /// Vertices that a projection left where they were.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kept: Option<u64>,
    /// Greatest magnitude of the exact field at the others, recipe units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
}

/// Something that looks wrong but does not stop a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Stable code, as in `W101`.
    pub code: &'static str,
    /// What was seen.
    pub message: String,
}

impl Warning {
    /// W101: the boxes of two inputs differ more than a hundredfold.
    pub const UNITS: &'static str = "W101";
    /// W102: walls thinner than two voxels.
    pub const THIN: &'static str = "W102";
    /// W103: a mesh with defects that were repaired.
    pub const MESH: &'static str = "W103";
    /// W104: a cell that fits its source badly.
    pub const CELL: &'static str = "W104";
    /// W105: a scaffold with doubtful elements.
    pub const SCAFFOLD: &'static str = "W105";
    /// W106: pieces that do not hang together.
    pub const PIECES: &'static str = "W106";
    /// W107: a picture's cut that misses the part.
    pub const CUT: &'static str = "W107";
    /// W108: operations that keep pieces dropped more than a hundredth of the solid.
    pub const DROPPED: &'static str = "W108";
    /// W109: weights that count as 0.
    pub const WEIGHTS: &'static str = "W109";
    /// W110: a transition along which the solid falls apart.
    pub const TRANSITION: &'static str = "W110";
    /// W111: a level set of other voxels than the recipe's, resampled.
    pub const RESAMPLED: &'static str = "W111";
    /// W112: a table that displaces the surface by more than the recipe allows.
    pub const TABLE: &'static str = "W112";
    /// W113: shells of a mesh that overlap or lie in each other, united.
    pub const OVERLAP: &'static str = "W113";
    /// W114: a field that jumps across faces that elements share.
    pub const CONTINUITY: &'static str = "W114";
    /// W130: a phase of a period that does not hang together, or goes on along no axis.
    pub const DISCONNECTED: &'static str = "W130";
    /// W115: a thickness that no level of a cell gives; the nearest level is used.
    pub const THICKNESS: &'static str = "W115";
    /// W116: a graph that stays fitted though a thickness in units of length is asked.
    pub const SECTION: &'static str = "W116";
    /// W117: a grid of a file that is not quite what it says, and what was made of it.
    pub const GRID: &'static str = "W117";
    /// W118: elements of a finite-element deck that are left out, since they share no face with the rest.
    pub const DECK: &'static str = "W118";
}

fn corners<S: serde::Serializer>(b: &Aabb, s: S) -> Result<S::Ok, S::Error> {
    [b.min, b.max].map(|v| [v.x, v.y, v.z]).serialize(s)
}

#[allow(clippy::ref_option)] // serde passes a reference to the field
fn maybe_corners<S: serde::Serializer>(b: &Option<Aabb>, s: S) -> Result<S::Ok, S::Error> {
    b.map(|b| [b.min, b.max].map(|v| [v.x, v.y, v.z]))
        .serialize(s)
}
