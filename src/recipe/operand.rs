//! Operands of operations: solids, and grids as masks. Only the keys; the run makes the solids.

use super::Brief;
use super::brief::short;
use super::crystal::{CrystalRef, SurfaceRef};
use super::file::{FileRef, Similarity};
use super::forms::{Forms, forms};
use super::quantity::{Finite, Length, QuantityError, Size, Unit};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::Error;
use std::path::PathBuf;
use std::str::FromStr;

/// A solid to combine with.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Operand {
    /// The inside of a closed mesh.
    Mesh(FileRef),
    /// The inside of a crystal of the recipe.
    Crystal(CrystalRef),
    /// A wall along a closed mesh or crystal.
    Skin(Skin),
    /// A grid of an OpenVDB file: a level set, a fog, or the part of a grid above a value.
    Vdb(Brief<Grid>),
    /// A ball.
    Sphere(Ball),
    /// An axis-aligned box.
    Box(Block),
    /// A straight cylinder with flat ends.
    Cylinder(Rod),
    /// A cylinder with round ends.
    Capsule(Rod),
    /// All of space on one side of a plane.
    Plane(Plane),
    /// One element of a cell of the palette, such as the ball of an icosahedral one.
    Cell(Single),
}

impl Operand {
    /// The surface that bounds it or that it follows, for those that have one.
    pub fn surface(&self) -> Option<SurfaceRef<'_>> {
        match self {
            Self::Mesh(file) => Some(SurfaceRef::Mesh(file)),
            Self::Crystal(crystal) => Some(SurfaceRef::Crystal(crystal)),
            Self::Skin(skin) => SurfaceRef::of(skin.mesh.as_ref(), skin.crystal.as_ref()),
            _ => None,
        }
    }
}

/// A wall along a closed mesh or crystal: exactly one of `mesh` and `crystal`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Skin {
    /// The mesh.
    pub mesh: Option<FileRef>,
    /// The crystal.
    pub crystal: Option<CrystalRef>,
    /// Full thickness of the wall.
    pub thickness: Size,
    /// On which side of the mesh the wall lies.
    #[serde(default)]
    pub side: Side,
}

/// Side of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Within it.
    #[default]
    Inside,
    /// Around it.
    Outside,
    /// Half the thickness on each side.
    Both,
}

/// A grid of an OpenVDB file: a path, or a table.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Where the file is, relative to the recipe.
    pub path: PathBuf,
    /// Name of the grid: "surface", the only level set or the only grid of floats when left out.
    pub grid: Option<String>,
    /// The isovalue of a grid that is not a level set. Without it the surface of a fog is where its density begins to
    /// rise, if that rises evenly as in the fog of a level set, else 0.5.
    pub value: Option<Finite>,
    /// Unit of its lengths; the unit stated in the file, else metres, when left out.
    pub unit: Option<Unit>,
    /// A placement applied last, in the recipe's unit.
    #[serde(default)]
    pub transform: Similarity,
    /// Resample a grid whose voxels are not axis-aligned cubes (rotated, mirrored, sheared, stretched, of a
    /// frustum): true for the recipe's voxels, or the edge of the cubes. Without it such a grid is refused.
    pub resample: Option<Onto>,
    /// Exchange inside and outside of a level set that is negative outside.
    #[serde(default)]
    pub invert: bool,
}

/// The voxels that a grid is brought onto: true or false, or the edge of cubes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Onto {
    /// Those of the recipe, or none.
    Recipe(bool),
    /// Cubes of this edge.
    Edge(Size),
}

impl Onto {
    /// Whether a grid is to be resampled.
    pub fn is_wanted(self) -> bool {
        self != Self::Recipe(false)
    }
}

impl FromStr for Onto {
    type Err = QuantityError;
    fn from_str(s: &str) -> Result<Self, QuantityError> {
        match s {
            "true" => Ok(Self::Recipe(true)),
            "false" => Ok(Self::Recipe(false)),
            size => size.parse().map(Self::Edge),
        }
    }
}

impl Forms for Onto {
    const DESCRIPTION: &'static str = "true, false or the edge of a voxel such as 0.2 or \"0.2mm\"";

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let size = generator.subschema_for::<Size>();
        json_schema!({
            "description": "The voxels that a grid is brought onto: true for those of the recipe, or the edge of cubes.",
            "anyOf": [{ "type": "boolean" }, size]
        })
    }
    fn flag<E: Error>(is_wanted: bool) -> Result<Self, E> {
        Ok(Self::Recipe(is_wanted))
    }
    fn number<E: Error>(v: f64) -> Result<Self, E> {
        Size::try_from(v).map(Self::Edge).map_err(E::custom)
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        v.parse().map(Self::Edge).map_err(E::custom)
    }
}

forms!(Onto, "Onto");

short!(Grid {
    path: PathBuf,
    grid: None,
    value: None,
    unit: None,
    transform: Similarity::default(),
    resample: None,
    invert: false
});

/// A ball.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Ball {
    /// Its radius.
    pub radius: Size,
    /// Its centre.
    #[serde(default = "origin")]
    pub centre: [Length; 3],
}

/// An axis-aligned box.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Edge lengths along x, y, z.
    pub size: [Size; 3],
    /// Its centre.
    #[serde(default = "origin")]
    pub centre: [Length; 3],
}

/// A cylinder or capsule between two points.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rod {
    /// Its radius.
    pub radius: Size,
    /// One end of its axis.
    pub from: [Length; 3],
    /// The other end.
    pub to: [Length; 3],
}

/// One element of a cell, which stands alone.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Single {
    /// The cell, one of `[cell.NAME]`; a cell that names no element is made for a hex, with group Ih for a
    /// ball.
    pub name: String,
    /// Length of the unit of its reference coordinates: the edge of a hex, the diameter of a ball.
    pub size: Size,
    /// Where the origin of its reference coordinates stands.
    #[serde(default = "origin")]
    pub centre: [Length; 3],
}

/// All of space on one side of a plane.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plane {
    /// Points out of the solid; of any length but 0.
    pub normal: [Finite; 3],
    /// A point of the plane.
    #[serde(default = "origin")]
    pub point: [Length; 3],
}

fn origin() -> [Length; 3] {
    [Length::Bare(0.0); 3]
}

/// Where an operation acts: not at all where a grid's values are at the low end of a range, wholly at
/// the high end, linearly between. Written alone it is the path.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Mask {
    /// The OpenVDB file, relative to the recipe.
    pub path: PathBuf,
    /// Name of the grid of floats; the only one when left out.
    pub grid: Option<String>,
    /// The two values.
    #[serde(default = "unit_range")]
    pub range: [Finite; 2],
    /// Exchange "not at all" and "wholly".
    #[serde(default)]
    pub invert: bool,
    /// Unit of its lengths; the unit stated in the file, else metres, when left out.
    pub unit: Option<Unit>,
}

short!(Mask {
    path: PathBuf,
    grid: None,
    range: unit_range(),
    invert: false,
    unit: None
});

/// The values of a mask at which nothing and everything happens, unless others are given.
fn unit_range() -> [Finite; 2] {
    [Finite(0.0), Finite(1.0)]
}
