//! Cavities and the channels that drain them, as the report of a run lists them. Lengths, places and volumes are
//! in the recipe's unit. A cavity is a void from which a ball of the radius `limit` cannot get outside; a closed
//! cavity has no way out at all.

use serde::Serialize;

/// The cavities of a solid.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CavitiesReport {
    /// Number of cavities, closed or not.
    pub count: u64,
    /// Number of closed cavities.
    pub closed: u64,
    /// Volume of all cavities.
    pub volume: f64,
    /// Least escape radius; 0 with a closed cavity, absent without any cavity.
    pub escape_radius: Option<f64>,
    /// The greatest radius that is measured. A void that a ball of this radius can leave is no cavity.
    pub limit: f64,
    /// The first cavities, by escape radius, then falling volume.
    pub list: Vec<CavityReport>,
}

/// A cavity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CavityReport {
    /// Volume of its voxels.
    pub volume: f64,
    /// Its point farthest from the solid.
    pub place: [f64; 3],
    /// Distance of that point from the solid.
    pub radius: f64,
    /// Radius of the largest ball that can leave; 0 for a closed cavity.
    pub escape_radius: f64,
    /// The narrowest point on the way out; absent for a closed cavity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub throat: Option<[f64; 3]>,
}

/// A channel that `drain` drilled: a cylinder with round ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DrainReport {
    /// Its end in the cavity, where solid begins to be removed.
    pub from: [f64; 3],
    /// Its end outside, or in a cavity that is drained too.
    pub to: [f64; 3],
    /// Its radius.
    pub radius: f64,
    /// Distance of the ends.
    pub length: f64,
}
