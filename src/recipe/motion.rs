//! `[scaffold.motion]`: how the nodes of a scaffold move from frame to frame. Only the keys; which go together is
//! checked in `check/motion.rs`.

use super::file::FileRef;
use schemars::JsonSchema;
use serde::Deserialize;

/// `[scaffold.motion]`: how the nodes of the scaffold move. A `file` with a frame token moves without it.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Motion {
    /// A point cache (.pc2), or a USD layer with time samples (.usda, its time codes are frames), with the nodes of
    /// `file` at every frame, in their order.
    pub points: Option<FileRef>,
    /// The place of a node at a frame: three formulas of its place at rest `x y z`, of `bx by bz` (0 to 1 in the
    /// scaffold's box at rest) and of `frame`, `time` and `fps`.
    pub deform: Option<[String; 3]>,
    /// Point field of `file` with the displacement of the nodes, in the file's unit, as solvers write it: it is
    /// added to the nodes, and `rest` is where they are without it.
    pub displacement: Option<String>,
    /// Point field of `file` with the velocity of the nodes, in the file's unit per second; differences of frames
    /// when left out.
    pub velocity: Option<String>,
    /// The frame that the grid `rest` refers to. When left out: the scaffold without its displacement, else the first
    /// file of a series, else the scaffold before it moves.
    pub rest_frame: Option<i32>,
}
