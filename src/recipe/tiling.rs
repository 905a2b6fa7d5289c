//! `[tiling]`: the cells that fill the scaffold, and their weights, levels and thickness, each a number, a formula
//! or a field (`Varying`). Only the keys; the run evaluates them.

use super::file::FileRef;
use super::forms::{Forms, forms};
use super::quantity::{ElementShare, Finite, Tolerance};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, Error, MapAccess, SeqAccess};

/// `[tiling]`: which cells fill the scaffold. Exactly one of `cell`, `transition` and `assign`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TilingSection {
    /// Name of the cell that fills every element.
    pub cell: Option<String>,
    /// Cells with weights: a transition from one cell to another.
    pub transition: Vec<Share>,
    /// Cells by named sets of elements or regions of space; the last that holds wins, and cells pass
    /// into each other within the elements at their borders.
    pub assign: Vec<Assignment>,
    /// How elements are turned so that cells with less symmetry than their element, such as the gyroid, continue
    /// over all faces: "auto", or { toward = [0, 0, 1] } for cells along a direction.
    pub orient: Orient,
    /// Interpolation of weights between the corners of elements.
    pub interpolation: Interpolation,
    /// Level of the cell, graded: a number, a formula or a field, in units of its field.
    pub level: Option<Varying>,
    /// Level by the solid's share of the element, graded.
    pub volume_fraction: Option<Varying>,
    /// Full local thickness, graded: in the recipe's unit. Struts of a graph become round beams of this
    /// diameter; of other cells it sets the level. In a formula, d is negative inside the envelope:
    /// "1.2 - 0.1*d" grows inwards.
    pub thickness: Option<Varying>,
    /// Maximum displacement of the surface by look-up tables and interpolation, in voxels, measured where
    /// voxels are finest against the cell. Tables are as small as that allows and leave out waves that they
    /// cannot resolve. In large elements, leaves are interpolated from nodes where that displaces the surface
    /// by at most half as much. 0 means the accuracy of single precision and 160 samples per axis, and no
    /// interpolation.
    pub tolerance: Tolerance,
    /// Measure the continuity of the field over all shared faces, into the report.
    pub certificate: bool,
}

impl TilingSection {
    /// Names of all cells, in order, each once.
    pub fn cells(&self) -> Vec<&str> {
        let listed = self.cell.iter().map(String::as_str);
        let shared = self.transition.iter().map(|s| s.cell.as_str());
        let assigned = self.assign.iter().map(|a| a.cell.as_str());
        let mut found: Vec<&str> = Vec::new();
        for name in listed.chain(shared).chain(assigned) {
            if !found.contains(&name) {
                found.push(name);
            }
        }
        found
    }

    /// Whether the tiling gives a level, volume fraction or thickness, also one that is the same everywhere.
    pub fn is_graded(&self) -> bool {
        self.level.is_some() || self.volume_fraction.is_some() || self.thickness.is_some()
    }
}

/// A cell's share in a transition.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Share {
    /// Name of the cell.
    pub cell: String,
    /// Its weight: a number, a formula such as "1 - bx", or a field. Negative weights count as 0; all
    /// are divided by their sum.
    pub weight: Varying,
}

/// Where a cell is used.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Assignment {
    /// Name of the cell.
    pub cell: String,
    /// A named set of the scaffold's elements: a physical group, an element set.
    pub group: Option<String>,
    /// A formula that is positive at the centres of the elements, such as "d + 2" within 2 below the envelope;
    /// both left out: everywhere.
    #[serde(rename = "where")]
    pub region: Option<String>,
}

/// How elements are turned. Of all ways in which the cells continue over the faces, the one that is nearest to the
/// directions is taken; without any, the one with the cells' axes along x, y and z as far as the mesh lets them.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OrientSection {
    /// Where the cells' z axis points.
    pub toward: Option<Direction>,
    /// Where their x axis points, as far as `toward` leaves a choice.
    pub up: Option<Direction>,
    /// What becomes of faces over which no turns of the elements make the cells continue, as around an edge with
    /// three hexes.
    #[serde(default)]
    pub mismatch: Mismatch,
    /// With mismatch = "blend": how far from such a face cells change their form, as a share of the element. When left
    /// out, their shares change evenly over the whole element.
    pub width: Option<ElementShare>,
}

/// Faces over which no turns of the elements make the cells continue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Mismatch {
    /// They are an error that names their edges.
    #[default]
    Error,
    /// The elements at these faces hold the cells in several turns, whose weights make them continue; cells change
    /// their form there.
    Blend,
}

/// As [`OrientSection`]; "auto" has no directions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Orient(pub Box<OrientSection>);

/// Component of a field of stresses: the direction of the principal stress of the greatest magnitude.
const PRINCIPAL: &str = "principal";

/// A direction in space.
#[derive(Clone, Debug, PartialEq)]
pub enum Direction {
    /// Its components: numbers or formulas of x, y, z, bx, by, bz and d.
    Components(Box<[Varying; 3]>),
    /// A field of vectors, or of stresses with component = "principal": the direction of the principal stress of
    /// the greatest magnitude, which has no sign.
    Field(FieldRef),
}

impl Direction {
    /// Whether it is the principal direction of stresses.
    pub fn is_principal(&self) -> bool {
        matches!(self, Self::Field(f) if f.component.as_deref() == Some(PRINCIPAL))
    }
}

/// How weights are interpolated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// Linear between corners.
    #[default]
    Linear,
    /// Flat at corners: each transition looks like steps of elements, with level ends.
    Smoothstep,
    /// Smooth in space (two continuous derivatives) whatever the elements are: through control points
    /// about one element apart; weights are local means.
    Smooth,
}

/// A value that may differ from place to place.
#[derive(Clone, Debug, PartialEq)]
pub enum Varying {
    /// The same everywhere.
    Number(f64),
    /// A formula of x, y, z (recipe units), bx, by, bz (0 to 1 in the scaffold's box) and d (signed
    /// distance to the envelope, negative inside).
    Formula(String),
    /// From a file.
    Field(FieldRef),
}

impl Varying {
    /// The same, with the nearest value outside of a file's field instead of an error.
    pub(crate) fn or_nearest(&self) -> Self {
        match self {
            Self::Field(field) if field.outside == Some(Outside::Error) => Self::Field(FieldRef {
                outside: Some(Outside::Nearest),
                ..field.clone()
            }),
            other => other.clone(),
        }
    }
}

/// A field in a file: .vtu, .vtk, .vdb or .csv.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FieldRef {
    /// The file; the scaffold's own when left out. A .csv has columns x, y, z and the field.
    pub file: Option<FileRef>,
    /// Name of the point or cell data, of the grid (floats, trilinear between voxels), or of the column.
    pub field: String,
    /// Whether the data of the points or of the cells are meant, where both have a field of this name.
    pub at: Option<FieldPlace>,
    /// Of fields with several numbers: which (x, y, z or 0, 1, ...), "magnitude", or of stresses
    /// "`von_mises`".
    pub component: Option<String>,
    /// Points (value, result) of a piecewise linear map, in order of value, clamped at both ends.
    #[serde(default, deserialize_with = "ascending")]
    pub map: Vec<[f64; 2]>,
    /// Where the field's mesh (of a .vdb the box of its active voxels) does not reach: "nearest" point,
    /// "error", or a number; "nearest" when left out. When given, it also stands for values that are
    /// missing (NaN, infinite): without it they are errors where the part meets them.
    pub outside: Option<Outside>,
}

/// What the values of a field belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum FieldPlace {
    /// The nodes of a mesh, or points of a table.
    Points,
    /// The elements of a mesh.
    Cells,
}

/// Reads a piecewise linear map: finite numbers, in order of the first ones.
fn ascending<'de, D: Deserializer<'de>>(d: D) -> Result<Vec<[f64; 2]>, D::Error> {
    let map = Vec::<[f64; 2]>::deserialize(d)?;
    if let Some(pair) = map.iter().find(|p| !p.iter().all(|v| v.is_finite())) {
        let message = format!("found {pair:?} in a map; expected pairs of finite numbers");
        return Err(serde::de::Error::custom(message));
    }
    let next = map.iter().skip(1);
    if let Some((before, after)) = map.iter().zip(next).find(|(a, b)| b[0] < a[0]) {
        let message = format!(
            "found {after:?} after {before:?} in a map; expected values in ascending order"
        );
        return Err(serde::de::Error::custom(message));
    }
    Ok(map)
}

impl Forms for Orient {
    const DESCRIPTION: &'static str = "\"auto\" or { toward, up, mismatch, width }";

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let section = generator.subschema_for::<OrientSection>();
        json_schema!({
            "description": "How elements are turned so that cells continue over all faces.",
            "anyOf": [{ "enum": ["auto"] }, section]
        })
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        match v {
            "auto" => Ok(Self::default()),
            _ => Err(E::unknown_variant(v, &["auto"])),
        }
    }
    fn table<'de, A: MapAccess<'de>>(map: A) -> Result<Self, A::Error> {
        let section = OrientSection::deserialize(MapAccessDeserializer::new(map))?;
        if section.up.is_some() && section.toward.is_none() {
            return Err(Error::missing_field("toward"));
        }
        if section.width.is_some() && section.mismatch != Mismatch::Blend {
            let message = "found width without mismatch = \"blend\"; expected both or neither";
            return Err(Error::custom(message));
        }
        Ok(Self(Box::new(section)))
    }
}

forms!(Orient, "Orient");

impl Forms for Direction {
    const DESCRIPTION: &'static str =
        "three numbers or formulas such as [\"-y\", \"x\", 0], or { file, field }";

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let field = generator.subschema_for::<FieldRef>();
        let number = generator.subschema_for::<Varying>();
        json_schema!({
            "description": "A direction: three numbers or formulas of x, y, z, bx, by, bz and d, or a field of vectors, or of \
                stresses with component = \"principal\": the direction of the principal stress of the greatest \
                magnitude.",
            "anyOf": [{ "type": "array", "items": number, "minItems": 3, "maxItems": 3 }, field]
        })
    }
    fn list<'de, A: SeqAccess<'de>>(seq: A) -> Result<Self, A::Error> {
        let components = Deserialize::deserialize(SeqAccessDeserializer::new(seq));
        components.map(Self::Components)
    }
    fn table<'de, A: MapAccess<'de>>(map: A) -> Result<Self, A::Error> {
        let field = FieldRef::deserialize(MapAccessDeserializer::new(map))?;
        match field.component.as_deref() {
            None | Some(PRINCIPAL) => Ok(Self::Field(field)),
            Some(other) => Err(Error::unknown_variant(other, &[PRINCIPAL])),
        }
    }
}

forms!(Direction, "Direction");

/// The value of a field outside its mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outside {
    /// The value of the nearest point.
    Nearest,
    /// An error that names the place.
    Error,
    /// A number, mapped like the field's own.
    Value(Finite),
}

impl Forms for Outside {
    const DESCRIPTION: &'static str = "\"nearest\", \"error\" or a number";

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "The value of a field outside its mesh.",
            "anyOf": [{ "enum": ["nearest", "error"] }, { "type": "number" }]
        })
    }
    fn number<E: Error>(v: f64) -> Result<Self, E> {
        let number = Finite::deserialize(serde::de::value::F64Deserializer::new(v))?;
        Ok(Self::Value(number))
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        match v {
            "nearest" => Ok(Self::Nearest),
            "error" => Ok(Self::Error),
            _ => Err(E::unknown_variant(v, &["nearest", "error", "a number"])),
        }
    }
}

forms!(Outside, "Outside");

impl Forms for Varying {
    const DESCRIPTION: &'static str = "a number, a formula such as \"1 - bx\", or { file, field }";

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let field = generator.subschema_for::<FieldRef>();
        json_schema!({
            "description": "A number, a formula, or a field of a file. Formulas have x, y, z (position), bx, by, bz (0 to 1 \
                in the scaffold's box) and d: the signed distance to the envelope in the recipe's unit, negative \
                inside. So \"1.2 - 0.1*d\" grows inwards.",
            "anyOf": [{ "type": "number" }, { "type": "string" }, field]
        })
    }
    fn number<E: Error>(v: f64) -> Result<Self, E> {
        if v.is_finite() {
            Ok(Self::Number(v))
        } else {
            Err(E::custom("expected a finite number"))
        }
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        Ok(Self::Formula(v.to_owned()))
    }
    fn table<'de, A: MapAccess<'de>>(map: A) -> Result<Self, A::Error> {
        FieldRef::deserialize(MapAccessDeserializer::new(map)).map(Self::Field)
    }
}

forms!(Varying, "Varying");
