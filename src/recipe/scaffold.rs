//! `[scaffold]`, `[tiling]` and `[band]`: what is filled, with what, and how finely it is sampled.

use super::file::FileRef;
use super::quantity::{HalfWidth, Length, Size};
use schemars::JsonSchema;
use serde::Deserialize;

/// `[scaffold]`: the mesh whose elements are filled. Exactly one of `file` and `box`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ScaffoldSection {
    /// A mesh of tets or hexes: .msh, .vtu or .vtk.
    pub file: Option<FileRef>,
    /// A box of equal hexes, made here.
    #[serde(rename = "box")]
    pub block: Option<BoxScaffold>,
    /// "cut": the scaffold's outer faces end the solid; "extend": only the envelope does.
    pub boundary: Boundary,
}

/// A structured box of hexes.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxScaffold {
    /// Edge lengths along x, y, z.
    pub size: [Size; 3],
    /// Edge of a hex; rounded so that a whole number of them fills each edge of the box.
    pub cell_size: Size,
    /// Least corner of the box.
    #[serde(default = "zero")]
    pub origin: [Length; 3],
}

fn zero() -> [Length; 3] {
    [Length::Bare(0.0); 3]
}

/// How the solid ends at the scaffold's boundary.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Boundary {
    /// At the outer faces.
    #[default]
    Cut,
    /// Nowhere: the structure continues outward unchanged until the envelope.
    Extend,
}

/// `[tiling]`: which cell fills the scaffold.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TilingSection {
    /// Name of the cell that fills every element.
    pub cell: String,
}

/// `[band]`: the sampling of the solid.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BandSection {
    /// Edge of a voxel.
    pub voxel_size: Size,
    /// Half width of the narrow band, in voxels.
    #[serde(default = "three")]
    pub half_width: HalfWidth,
    /// "fast": two Newton steps per voxel; "exact": searched closest points.
    #[serde(default)]
    pub distance: Distance,
}

fn three() -> HalfWidth {
    HalfWidth(3.0)
}

/// How distances to the structure's surface are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Distance {
    /// Two regularised Newton steps, blended across element faces.
    #[default]
    Fast,
    /// Converged closest points on the cells, faces and edges within the band.
    Exact,
}
