//! `[crystal.NAME]`: a polygon mesh made by a script.

use super::quantity::Finite;
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// `[crystal.NAME]`: exactly one of `steps` and `file`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CrystalSection {
    /// The script: one step a line, or several with ";" between them.
    pub steps: Option<String>,
    /// A script's file (.crystal).
    pub file: Option<PathBuf>,
    /// Values for the script's parameters.
    pub set: BTreeMap<String, Finite>,
}
