//! `[[output]]`: the files a run writes.

use super::quantity::Unit;
use crate::frame::LengthUnit;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::SeqAccessDeserializer;
use serde::de::{Error as _, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// One file. Exactly one of `vdb`, `mesh`, `picture` and `report` says which.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// An OpenVDB file with the level set "surface".
    pub vdb: Option<PathBuf>,
    /// A triangle mesh: .stl, .ply, .obj or .3mf.
    pub mesh: Option<PathBuf>,
    /// A shaded picture (.png).
    pub picture: Option<PathBuf>,
    /// The run's report (.json).
    pub report: Option<PathBuf>,
    /// Unit of the file: metres for .vdb, the recipe's for meshes when left out.
    pub unit: Option<Unit>,
    /// Also write the fog volume "density" into the .vdb.
    pub fog: bool,
    /// Store the values of the .vdb as half floats: a fifth smaller, distances to 1.5 thousandths of a
    /// voxel; meant for fog.
    pub half: bool,
    /// How the values of the .vdb are compressed; blosc when left out.
    pub compression: Option<Compression>,
    /// Width and height of the picture in pixels: [1000, 800] or "1000x800".
    pub size: Option<PictureSize>,
    /// A cut plane of the picture, as in "x=0" (recipe's unit).
    pub cut: Option<Cut>,
}

/// How values are compressed in a .vdb.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Compression {
    /// Not at all.
    None,
    /// zlib: slower and no smaller than blosc.
    Zip,
    /// The fastest and the best.
    Blosc,
}

/// What an output holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputKind {
    /// An OpenVDB file.
    Vdb,
    /// A triangle mesh.
    Mesh,
    /// A picture.
    Picture,
    /// The report.
    Report,
}

impl Output {
    /// The files that are named; a valid output names exactly one.
    pub fn named(&self) -> Vec<(OutputKind, &Path)> {
        [
            (OutputKind::Vdb, &self.vdb),
            (OutputKind::Mesh, &self.mesh),
            (OutputKind::Picture, &self.picture),
            (OutputKind::Report, &self.report),
        ]
        .into_iter()
        .filter_map(|(kind, path)| path.as_deref().map(|p| (kind, p)))
        .collect()
    }

    /// The unit of the file, given the recipe's.
    pub fn unit_or_default(&self, recipe: LengthUnit) -> LengthUnit {
        match self.unit {
            Some(Unit(unit)) => unit,
            None if self.vdb.is_some() => LengthUnit::Metre,
            None => recipe,
        }
    }
}

/// Width and height in pixels, written [1000, 800] or "1000x800".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureSize(pub u32, pub u32);

impl Default for PictureSize {
    fn default() -> Self {
        Self(1000, 800)
    }
}

/// Least and greatest number of pixels a side.
const SIDES: std::ops::RangeInclusive<u32> = 16..=16384;

impl FromStr for PictureSize {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        s.split_once('x')
            .and_then(|(w, h)| Some(Self(w.parse().ok()?, h.parse().ok()?)))
            .filter(|size| SIDES.contains(&size.0) && SIDES.contains(&size.1))
            .ok_or_else(|| {
                format!(
                    "found {s:?}, expected WIDTHxHEIGHT with 16 to 16384 pixels a side, as in \"1000x800\""
                )
            })
    }
}

impl<'de> Deserialize<'de> for PictureSize {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct Form;
        impl<'de> Visitor<'de> for Form {
            type Value = PictureSize;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("[width, height] or \"WIDTHxHEIGHT\" in pixels")
            }
            fn visit_str<E: serde::de::Error>(self, v: &str) -> Result<PictureSize, E> {
                v.parse().map_err(E::custom)
            }
            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<PictureSize, A::Error> {
                let [w, h] = <[i64; 2]>::deserialize(SeqAccessDeserializer::new(seq))?;
                self.visit_str(&format!("{w}x{h}"))
            }
        }
        d.deserialize_any(Form)
    }
}

impl JsonSchema for PictureSize {
    fn schema_name() -> Cow<'static, str> {
        "PictureSize".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [
            { "type": "array", "items": { "type": "integer" }, "minItems": 2, "maxItems": 2 },
            { "type": "string", "pattern": "^[0-9]+x[0-9]+$" },
        ] })
    }
}

/// A plane at a coordinate, written "x=0": what lies beyond it is left out of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// The coordinate.
    pub at: f64,
}

impl FromStr for Cut {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        s.split_once('=')
            .and_then(|(axis, at)| {
                let axis = ["x", "y", "z"].iter().position(|a| *a == axis.trim())?;
                let at = at.trim().parse::<f64>().ok().filter(|v| v.is_finite())?;
                Some(Self { axis, at })
            })
            .ok_or_else(|| format!("found {s:?}, expected an axis and a number, as in \"x=0\""))
    }
}

impl<'de> Deserialize<'de> for Cut {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        String::deserialize(d)?.parse().map_err(D::Error::custom)
    }
}

impl JsonSchema for Cut {
    fn schema_name() -> Cow<'static, str> {
        "Cut".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "pattern": "^[xyz]=.*$" })
    }
}
