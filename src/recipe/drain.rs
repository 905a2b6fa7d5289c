//! `drain`: the keys of the operation that drills channels from cavities to the outside.

use super::brief::short;
use super::quantity::{Finite, Size};
use schemars::JsonSchema;
use serde::Deserialize;

/// Channels from cavities to the outside.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Drain {
    /// Radius of the channels, at least one voxel, at most 94.
    pub radius: Size,
    /// Which cavities are drained.
    #[serde(default)]
    pub cavities: Drained,
    /// The preferred direction of the channels, such as [0, 0, -1]: a channel along it may be twice as long as
    /// one across it, and three times as long as one against it. The shortest ones when left out.
    pub toward: Option<[Finite; 3]>,
    /// Greatest number of channels; a part that needs more is refused.
    #[schemars(range(min = 1))]
    pub at_most: Option<u64>,
}

short!(Drain {
    radius: Size,
    cavities: Drained::default(),
    toward: None,
    at_most: None
});

/// Which cavities are drained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Drained {
    /// Those without any way out.
    #[default]
    Closed,
    /// Also those in which a ball of the radius fits that cannot leave.
    All,
}
