//! Warnings of a run and their codes, which are stable: scripts and the reference name them. A strict run makes an
//! error of the first.

use serde::Serialize;

/// A warning: a probable fault that does not stop a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Stable code, as in `W101`.
    pub code: &'static str,
    /// The text.
    pub message: String,
}

impl Warning {
    /// W101: the boxes of two inputs differ more than a hundredfold.
    pub const UNITS: &'static str = "W101";
    /// W102: walls thinner than two voxels, or beams of a homogenised period thinner than three.
    pub const THIN_WALLS: &'static str = "W102";
    /// W103: a mesh with defects that were repaired, notes on a crystal's steps, or a graph that is read in part.
    pub const MESH: &'static str = "W103";
    /// W104: a cell that fits its source badly.
    pub const CELL: &'static str = "W104";
    /// W105: a scaffold with doubtful elements.
    pub const SCAFFOLD: &'static str = "W105";
    /// W106: a solid of several components.
    pub const COMPONENTS: &'static str = "W106";
    /// W107: a picture's cut that misses the part.
    pub const MISSED_CUT: &'static str = "W107";
    /// W108: operations that remove components removed more than a hundredth of the solid.
    pub const REMOVED_COMPONENTS: &'static str = "W108";
    /// W109: weights that count as 0.
    pub const WEIGHTS: &'static str = "W109";
    /// W110: a transition along which the solid becomes disconnected.
    pub const TRANSITION: &'static str = "W110";
    /// W111: a level set of other voxels than the recipe's, resampled.
    pub const RESAMPLED: &'static str = "W111";
    /// W112: a table that displaces the surface by more than the recipe allows.
    pub const TABLE: &'static str = "W112";
    /// W113: shells of a mesh that overlap or contain each other, united.
    pub const OVERLAP: &'static str = "W113";
    /// W114: a field that jumps across faces that elements share.
    pub const CONTINUITY: &'static str = "W114";
    /// W130: a phase of a period that is disconnected, or percolates along no axis.
    pub const DISCONNECTED: &'static str = "W130";
    /// W115: a thickness that no level of a cell gives, where the nearest is used, or that half of the walls miss.
    pub const THICKNESS: &'static str = "W115";
    /// W116: a graph that stays fitted although a thickness in units of length is requested.
    pub const SECTION: &'static str = "W116";
    /// W117: a grid of a file that deviates from its format, and how it was interpreted.
    pub const GRID: &'static str = "W117";
    /// W118: what a finite-element deck leaves out: elements that share no face with the rest, or what homogenised cells
    /// do not represent.
    pub const DECK: &'static str = "W118";
    /// W119: a part that its scaffold does not follow, or thin tets.
    pub const FILLING: &'static str = "W119";
}
