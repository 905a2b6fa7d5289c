//! Names of the grids that an output may hold, and what each needs: numbers per voxel, a scaffold, other frames.

use super::forms::{Forms, forms};
use schemars::{Schema, SchemaGenerator, json_schema};
use serde::de::Error;
use std::fmt;
use std::str::FromStr;

/// A grid of an output: the solid, its fog, or values for shading.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GridWord {
    /// The level set.
    Surface,
    /// The fog volume.
    Density,
    /// Number of the cell with the greatest weight, from 0 in the order of the tiling; -1 without one.
    CellId,
    /// Number of the element in its file (exact up to 2^24); -1 without one.
    ElementId,
    /// Weight of a cell of the tiling, 0 to 1.
    Weight(String),
    /// Full local thickness of the solid at the surface nearest by, in the file's unit; 0 where no ball
    /// is inscribed.
    Thickness,
    /// Reference coordinates in the element.
    Uvw,
    /// Folded reference coordinates, continuous over every face whatever the numbering: the three
    /// greatest barycentric coordinates of a tet, |u| of a hex in falling order.
    Fold,
    /// Velocity of the material, the file's unit per second.
    Vel,
    /// Place of the material at the rest frame, the file's unit.
    Rest,
}

impl GridWord {
    /// Numbers at each voxel: one or three.
    pub const fn components(&self) -> usize {
        match self {
            Self::Uvw | Self::Fold | Self::Vel | Self::Rest => 3,
            _ => 1,
        }
    }

    /// Whether it needs a scaffold.
    pub const fn needs_scaffold(&self) -> bool {
        !matches!(self, Self::Surface | Self::Density | Self::Thickness)
    }

    /// Whether its values are lengths, which follow the unit of a file.
    pub const fn has_lengths(&self) -> bool {
        matches!(self, Self::Thickness | Self::Vel | Self::Rest)
    }

    /// Whether it needs other frames of the scaffold.
    pub const fn needs_motion(&self) -> bool {
        matches!(self, Self::Vel | Self::Rest)
    }

    /// Whether it is an attribute of the surface and not the solid itself.
    pub const fn is_attribute(&self) -> bool {
        !matches!(self, Self::Surface | Self::Density)
    }
}

impl fmt::Display for GridWord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Surface => "surface",
            Self::Density => "density",
            Self::CellId => "cell_id",
            Self::ElementId => "element_id",
            Self::Weight(cell) => return write!(f, "weight_{cell}"),
            Self::Thickness => "thickness",
            Self::Uvw => "uvw",
            Self::Fold => "fold",
            Self::Vel => "vel",
            Self::Rest => "rest",
        })
    }
}

impl FromStr for GridWord {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        let known = [
            Self::Surface,
            Self::Density,
            Self::CellId,
            Self::ElementId,
            Self::Thickness,
            Self::Uvw,
            Self::Fold,
            Self::Vel,
            Self::Rest,
        ];
        if let Some(cell) = s.strip_prefix("weight_").filter(|c| !c.is_empty()) {
            return Ok(Self::Weight(cell.to_owned()));
        }
        let names = known.each_ref().map(ToString::to_string);
        let found = known.into_iter().find(|w| w.to_string() == s);
        found.ok_or_else(|| {
            format!(
                "found {s:?}, expected one of {}, weight_NAME",
                names.join(", ")
            )
        })
    }
}

impl Forms for GridWord {
    const DESCRIPTION: &'static str = "the name of a grid";

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "A grid of an output.",
            "type": "string",
            "pattern": "^(surface|density|cell_id|element_id|thickness|uvw|fold|vel|rest|weight_.+)$"
        })
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        v.parse().map_err(E::custom)
    }
}

forms!(GridWord, "GridWord");
