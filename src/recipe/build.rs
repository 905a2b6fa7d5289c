//! `[build]`: how a printer stacks the layers of the part. The doc comments of its keys are the recipe reference.

use super::quantity::{Finite, Length, Size};
use crate::frame::LengthUnit;
use schemars::JsonSchema;
use serde::Deserialize;

/// The layers of the build. With this section the report lists islands, overhangs, cups and cross-sections by
/// height.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BuildSection {
    /// The direction in which layers are stacked; [0, 0, 1] when left out.
    #[serde(default = "along_z")]
    pub up: [Finite; 3],
    /// Height of a layer.
    pub layer: Size,
    /// Greatest angle between a wall and `up` that needs no support, degrees, 1 to 89; 45 when left out.
    #[serde(default = "diagonal")]
    pub overhang: Finite,
}

fn along_z() -> [Finite; 3] {
    [0.0, 0.0, 1.0].map(Finite)
}

fn diagonal() -> Finite {
    Finite(45.0)
}

impl BuildSection {
    /// The section with the defaults for all but the layer.
    pub fn new(layer: Size) -> Self {
        Self {
            up: along_z(),
            layer,
            overhang: diagonal(),
        }
    }

    /// The section with its layer height converted from the unit `own` of bare numbers to `unit`, as a bare
    /// number. A height in voxels stays, since it has no unit.
    #[must_use]
    pub fn in_unit(self, own: LengthUnit, unit: LengthUnit) -> Self {
        let layer = self.layer.0.in_unit(unit, own).map(Length::Bare);
        Self {
            layer: layer.map_or(self.layer, Size),
            ..self
        }
    }

    /// The first invalid key, with what is wrong; `None` for a valid section.
    pub(crate) fn fault(&self) -> Option<(&'static str, String)> {
        if self.up.iter().all(|c| c.0 == 0.0) {
            let message = "the direction up has length 0; expected a direction such as [0, 0, 1]";
            return Some(("up", message.into()));
        }
        let angle = self.overhang.0;
        if !(1.0..=89.0).contains(&angle) {
            let message = format!("overhang = {angle} degrees; expected 1 to 89");
            return Some(("overhang", message));
        }
        None
    }
}
