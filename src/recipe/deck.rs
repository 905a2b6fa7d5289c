//! The keys of a finite-element deck in `[[output]]`, and the edge of its elements in voxels.

use super::output::Output;
use super::quantity::Scale;
use schemars::JsonSchema;
use serde::Deserialize;

/// Difference between an element's edge and a whole number of voxels that counts as rounding, relative.
const EDGE_TOLERANCE: f64 = 1e-6;
/// Maximum edge of an element, voxels.
const MAX_EDGE: f64 = 1024.0;

/// Elements of a deck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum DeckKind {
    /// Linear hexahedra (C3D8): cubes of the finished solid's voxels.
    Hex8,
}

impl Output {
    /// Edge of a deck's elements in voxels, for a solid with the voxels of `scale`: one voxel when no
    /// `element_size` is given.
    ///
    /// # Errors
    /// The reason, if `element_size` is not a whole number of voxels from 1 to 1024.
    pub fn element_voxels(&self, scale: Scale) -> Result<u32, String> {
        let Some(size) = self.element_size else {
            return Ok(1);
        };
        let (edge, voxel) = (size.0.resolve(scale), scale.voxel_size);
        let count = (edge / voxel).round();
        let is_whole = (edge - count * voxel).abs() <= EDGE_TOLERANCE * edge;
        if is_whole && (1.0..=MAX_EDGE).contains(&count) {
            return Ok(count as u32);
        }
        // The whole numbers around the edge; rounded to nine decimals for the message.
        let near = (edge / voxel).floor().clamp(1.0, MAX_EDGE - 1.0);
        let [low, high] = [near, near + 1.0].map(|n| (n * voxel * 1e9).round() / 1e9);
        Err(format!(
            "element_size is {edge} {unit}; expected a whole number of voxels of {voxel} {unit}, such as {low} \
             or {high}",
            unit = scale.unit
        ))
    }
}
