//! `[require]`: requirements on the finished part. If one is not met, the outputs are written all the same. Rules
//! between the keys are in `check`; the verdicts are made where solids are measured.

use super::quantity::{Positive, Size};
use schemars::JsonSchema;
use serde::Deserialize;

/// Requirements on the finished part. Each is checked against a quantity of the report. If one is not met, the
/// program ends with exit code 1, after all outputs are written.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RequireSection {
    /// Minimum wall thickness: the first percentile of the diameters of the largest inscribed balls, in the
    /// report `solid.least_wall`.
    pub least_wall: Option<Size>,
    /// Minimum width of gaps between walls: the first percentile of the diameters of the largest balls in the
    /// empty space that touch two opposite walls.
    pub least_gap: Option<Size>,
    /// Number of connected components, exactly.
    pub components: Option<u64>,
    /// Maximum number of enclosed cavities.
    pub closed_cavities: Option<u64>,
    /// Minimum escape radius of all cavities: the radius of the largest ball that can leave. It is 0 for a
    /// closed cavity. Radii up to 96 voxels are measured.
    pub escape_radius: Option<Size>,
    /// Minimum and maximum share of the envelope, or of the scaffold where there is none.
    pub volume_fraction: Option<[f64; 2]>,
    /// Minimum and maximum mass, grams; needs `density`.
    pub mass: Option<[f64; 2]>,
    /// Density of the material, grams per cubic centimetre.
    pub density: Option<Positive>,
    /// Maximum number of islands: components of a layer that lie over nothing. Needs `[build]`.
    pub islands: Option<u64>,
    /// Maximum number of cups: pockets that open upwards, or that the plate closes. Needs `[build]`.
    pub cups: Option<u64>,
    /// Maximum area that needs support, in square units of the recipe. Needs `[build]`.
    pub overhang_area: Option<f64>,
    /// Maximum jump of the field across faces that elements share, over the range of the field. The run computes
    /// the certificate for it.
    pub value_jump_max: Option<Positive>,
    /// Sizes along x, y and z of the box that the part must fit into, without rotation.
    pub fits: Option<[Size; 3]>,
}

impl RequireSection {
    /// Names of the requirements that only a run can check, because they need more than a file.
    pub fn of_runs_only(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        names.extend(self.volume_fraction.map(|_| "volume_fraction"));
        names.extend(self.value_jump_max.map(|_| "value_jump_max"));
        names
    }

    /// Names of the requirements on the layers of a build.
    pub fn of_builds(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        names.extend(self.islands.map(|_| "islands"));
        names.extend(self.cups.map(|_| "cups"));
        names.extend(self.overhang_area.map(|_| "overhang_area"));
        names
    }

    /// Whether it requires nothing.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
