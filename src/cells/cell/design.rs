//! How a cell was designed: its target, the course of the optimisation, the properties of the result.
//!
//! The report is written into `.cell` files as it is, so that names of fields are names in files. Absent fields are
//! read as 0, false, empty or none. Nothing here computes; properties are relative to those of the solid material.

use serde::{Deserialize, Serialize};

/// What a `.cell` file keeps of an inverse design.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DesignReport {
    /// The target in the words of a recipe.
    pub target: String,
    /// The target volume fraction.
    pub volume_fraction: f64,
    /// The start that led to the result: a surface, a file or `seed N`.
    pub start: String,
    /// Stages that were finished.
    pub stages: usize,
    /// The objective of the result.
    pub objective: f64,
    /// Whether all stages were finished.
    pub complete: bool,
    /// One entry for each start and stage.
    pub history: Vec<DesignStep>,
    /// Properties of wholly solid or void voxels, relative to the solid, the finer grid first.
    pub properties: Vec<DesignProperties>,
}

/// One start in one stage.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DesignStep {
    /// Number of the stage, from 1.
    pub stage: usize,
    /// The start.
    pub start: String,
    /// Voxels along the period.
    pub voxels: usize,
    /// Evaluations of the objective.
    pub evaluations: usize,
    /// The least objective of a connected cell; none where no cell was connected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objective: Option<f64>,
}

/// Properties of a cell on one grid, relative to the solid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DesignProperties {
    /// Voxels along the period.
    pub voxels: usize,
    /// Volume fraction of the solid voxels.
    pub volume_fraction: f64,
    /// Bulk modulus.
    pub bulk: f64,
    /// Shear modulus, mean over directions under uniform stress.
    pub shear: f64,
    /// C44, mean over the axes.
    pub c44: f64,
    /// Young's modulus along the axes, their mean.
    pub young: f64,
    /// C12 / (C11 + C12), means over the axes.
    pub poisson: f64,
    /// Zener's ratio.
    pub zener: f64,
    /// Conductivity, mean over the axes.
    pub conductivity: f64,
    /// Permeability of the void, mean over the axes, period squared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub permeability: Option<f64>,
    /// Radius of the greatest ball that travels through the void to the next period, reference lengths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub opening: Option<f64>,
    /// Least width of the solid, reference lengths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least_wall: Option<f64>,
    /// Least width of the void, reference lengths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least_gap: Option<f64>,
    /// Bulk modulus over its Hashin-Shtrikman bound.
    pub bulk_over_bound: f64,
    /// Mean shear modulus over its bound.
    pub shear_over_bound: f64,
    /// Conductivity over its bound.
    pub conductivity_over_bound: f64,
}
