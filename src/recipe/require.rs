//! `[require]`: what the finished part must fulfil. A run judges it after its outputs are written.

use super::quantity::{Positive, Size};
use schemars::JsonSchema;
use serde::Deserialize;

/// Requirements on the finished part. Each is judged by what the report measures; one that is not met
/// ends the program with exit code 1, after all outputs are written.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RequireSection {
    /// Thickness that walls must have at least: of the report's `solid.least_wall`, the first percentile
    /// of the diameters of the largest inscribed balls.
    pub least_wall: Option<Size>,
    /// Width that gaps between walls must have at least: the first percentile of the diameters of the
    /// largest balls in the empty space that touch two opposite walls.
    pub least_gap: Option<Size>,
    /// Number of connected components, exactly.
    pub components: Option<u64>,
    /// Enclosed cavities, at most.
    pub closed_cavities: Option<u64>,
    /// Least and greatest share of the envelope, or of the scaffold where there is none.
    pub volume_fraction: Option<[f64; 2]>,
    /// Least and greatest mass, grams; needs `density`.
    pub mass: Option<[f64; 2]>,
    /// Density of the material, grams per cubic centimetre.
    pub density: Option<Positive>,
    /// Jump of the field across faces that elements share, over the field's range, at most. The
    /// certificate is computed for it.
    pub value_jump_max: Option<Positive>,
    /// Sizes along x, y and z of the box that the part must fit into, without being turned.
    pub fits: Option<[Size; 3]>,
}

impl RequireSection {
    /// Names of the requirements that only a run can judge, since a file does not hold what they need.
    pub fn of_runs_only(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        names.extend(self.volume_fraction.map(|_| "volume_fraction"));
        names.extend(self.value_jump_max.map(|_| "value_jump_max"));
        names
    }

    /// Whether it requires nothing.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
