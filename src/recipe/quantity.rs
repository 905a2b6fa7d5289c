//! Quantities of a recipe: lengths with their unit, kernel widths, and numbers with a range.
//!
//! A length is a number (the recipe's unit) or a string such as `"0.2mm"` or `"3vx"` (voxels). Sizes
//! are positive; a bare kernel width counts voxels. TOML and the command line share one parser
//! and its errors.

use super::forms::{Forms, forms};
use crate::frame::LengthUnit;
use schemars::{Schema, SchemaGenerator, json_schema};
use serde::de::Error;
use std::fmt;
use std::str::FromStr;

/// The scale of lengths: the recipe's unit and its voxel size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// The unit of bare numbers.
    pub unit: LengthUnit,
    /// Edge of a voxel in that unit.
    pub voxel_size: f64,
}

/// A text or number that is not a valid quantity.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum QuantityError {
    /// Neither a number nor a number with a unit.
    #[error(
        "{0:?} is not a length; expected a number with um, mm, cm, m, in, ft or vx (voxels), as in \"0.2mm\""
    )]
    NotALength(String),
    /// A number out of its range.
    #[error("found {found}, expected {expected}")]
    Range {
        /// The number, as text.
        found: String,
        /// The accepted values.
        expected: &'static str,
    },
}

/// A length as written: a finite number and its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// A bare number: the recipe's unit (or voxels, where the key states it).
    Bare(f64),
    /// A number with a unit of length.
    In(f64, LengthUnit),
    /// A number of voxels.
    Voxels(f64),
}

impl Length {
    /// The number without its unit.
    pub fn number(self) -> f64 {
        match self {
            Self::Bare(v) | Self::In(v, _) | Self::Voxels(v) => v,
        }
    }

    /// The length in the recipe's unit.
    pub fn resolve(self, scale: Scale) -> f64 {
        match self {
            Self::Bare(v) => v,
            Self::In(v, unit) => v * unit.to(scale.unit),
            Self::Voxels(v) => v * scale.voxel_size,
        }
    }

    /// The length in `unit`, a bare number being in `bare`; `None` for voxels.
    pub fn in_unit(self, unit: LengthUnit, bare: LengthUnit) -> Option<f64> {
        match self {
            Self::Bare(v) => Some(v * bare.to(unit)),
            Self::In(v, own) => Some(v * own.to(unit)),
            Self::Voxels(_) => None,
        }
    }

    /// The same length; an error for one that is infinite or not a number.
    fn finite(self) -> Result<Self, QuantityError> {
        in_range(self.number(), f64::is_finite, "a finite length").map(|_| self)
    }
}

/// The number, if `ok` admits it; `expected` describes the admitted ones.
fn in_range(v: f64, ok: fn(f64) -> bool, expected: &'static str) -> Result<f64, QuantityError> {
    if ok(v) {
        Ok(v)
    } else {
        Err(QuantityError::Range {
            found: v.to_string(),
            expected,
        })
    }
}

impl From<f64> for Length {
    fn from(v: f64) -> Self {
        Self::Bare(v)
    }
}

impl FromStr for Length {
    type Err = QuantityError;
    fn from_str(s: &str) -> Result<Self, QuantityError> {
        let text = s.trim();
        if let Ok(v) = text.parse::<f64>() {
            return Self::Bare(v).finite();
        }
        // The trailing letters are the unit; the text before them must be a number ("1e-3m").
        let bad = || QuantityError::NotALength(s.to_owned());
        let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let unit = &text[number.len()..];
        let v = number.trim().parse::<f64>().map_err(|_| bad())?;
        match unit {
            "vx" => Self::Voxels(v).finite(),
            _ => Self::In(v, unit.parse().map_err(|_| bad())?).finite(),
        }
    }
}

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bare(v) => write!(f, "{v}"),
            Self::In(v, unit) => write!(f, "{v}{unit}"),
            Self::Voxels(v) => write!(f, "{v}vx"),
        }
    }
}

/// A positive length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size(pub Length);

impl Size {
    /// The size in the recipe's unit.
    pub fn resolve(self, scale: Scale) -> f64 {
        self.0.resolve(scale)
    }
}

/// A positive kernel width: voxels when bare.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Width(pub Length);

impl Width {
    /// The width in voxels.
    pub fn voxels(self, scale: Scale) -> f64 {
        match self.0 {
            Length::Bare(v) | Length::Voxels(v) => v,
            length @ Length::In(..) => length.resolve(scale) / scale.voxel_size,
        }
    }
}

impl Default for Width {
    fn default() -> Self {
        Self(Length::Bare(1.0))
    }
}

/// The same length; an error unless it is above 0.
fn positive(length: Length, expected: &'static str) -> Result<Length, QuantityError> {
    if length.number() > 0.0 {
        Ok(length)
    } else {
        Err(QuantityError::Range {
            found: length.to_string(),
            expected,
        })
    }
}

impl TryFrom<Length> for Size {
    type Error = QuantityError;
    fn try_from(length: Length) -> Result<Self, QuantityError> {
        positive(length, "a positive length").map(Self)
    }
}

impl TryFrom<Length> for Width {
    type Error = QuantityError;
    fn try_from(length: Length) -> Result<Self, QuantityError> {
        positive(length, "a positive width").map(Self)
    }
}

/// The common half of a quantity: text, TOML and schema, given its checked construction.
macro_rules! quantity {
    ($name:ident, $expecting:literal, $schema:tt) => {
        impl Forms for $name {
            const DESCRIPTION: &'static str = $expecting;

            fn schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!($schema)
            }
            fn number<E: Error>(v: f64) -> Result<Self, E> {
                Self::try_from(v).map_err(E::custom)
            }
            fn text<E: Error>(v: &str) -> Result<Self, E> {
                v.parse().map_err(E::custom)
            }
        }
        forms!($name, stringify!($name));
    };
}

macro_rules! length_quantity {
    ($name:ident, $expecting:literal, $schema:tt) => {
        impl TryFrom<f64> for $name {
            type Error = QuantityError;
            fn try_from(v: f64) -> Result<Self, QuantityError> {
                Self::try_from(Length::Bare(v).finite()?)
            }
        }
        impl FromStr for $name {
            type Err = QuantityError;
            fn from_str(s: &str) -> Result<Self, QuantityError> {
                Self::try_from(s.parse::<Length>()?)
            }
        }
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)
            }
        }
        quantity!($name, $expecting, $schema);
    };
}

length_quantity!(Size, "a positive length such as 0.2, \"0.2mm\" or \"3vx\"", {
    "description": "A positive length: a number in the recipe's unit, or a string such as \"0.2mm\" or \"3vx\" (voxels).",
    "type": ["number", "string"], "exclusiveMinimum": 0
});
length_quantity!(Width, "a positive width in voxels, or a length such as \"0.2mm\"", {
    "description": "A positive kernel width: a number of voxels, or a string such as \"0.2mm\".",
    "type": ["number", "string"], "exclusiveMinimum": 0
});

impl Forms for Length {
    const DESCRIPTION: &'static str = "a length such as 0.2, \"0.2mm\" or \"3vx\"";

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "A length: a number in the recipe's unit, or a string such as \"-0.2mm\" or \"3vx\" (voxels).",
            "type": ["number", "string"]
        })
    }
    fn number<E: Error>(v: f64) -> Result<Self, E> {
        Self::Bare(v).finite().map_err(E::custom)
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        v.parse().map_err(E::custom)
    }
}

forms!(Length, "Length");

/// A number within a range, as a type.
macro_rules! number {
    ($(#[$doc:meta])* $name:ident, $ok:expr, $expected:literal, $schema:tt) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name(pub f64);
        impl TryFrom<f64> for $name {
            type Error = QuantityError;
            fn try_from(v: f64) -> Result<Self, QuantityError> {
                in_range(v, $ok, $expected).map(Self)
            }
        }
        impl FromStr for $name {
            type Err = QuantityError;
            fn from_str(s: &str) -> Result<Self, QuantityError> {
                let v = s.trim().parse::<f64>().map_err(|_| QuantityError::Range {
                    found: format!("{s:?}"),
                    expected: $expected,
                })?;
                Self::try_from(v)
            }
        }
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)
            }
        }
        quantity!($name, $expected, $schema);
    };
}

number!(
    /// A positive finite number.
    Positive, |v| v > 0.0 && v.is_finite(), "a positive number",
    { "type": "number", "exclusiveMinimum": 0 });
number!(
    /// A finite number.
    Finite, f64::is_finite, "a finite number", { "type": "number" });
number!(
    /// A number strictly between 0 and 1.
    Fraction, |v| v > 0.0 && v < 1.0, "a number between 0 and 1, both excluded",
    { "type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1 });
number!(
    /// A share of an element's width: above 0, at most 1.
    ElementShare, |v| v > 0.0 && v <= 1.0, "a share of an element above 0 and at most 1",
    { "type": "number", "exclusiveMinimum": 0, "maximum": 1 });
number!(
    /// A number from 0 to 1, both included.
    Portion, |v| (0.0..=1.0).contains(&v), "a number from 0 to 1",
    { "type": "number", "minimum": 0, "maximum": 1 });
number!(
    /// A band half width in voxels: at least 1.5, so that every crossing has its neighbours.
    HalfWidth, |v| (1.5..=64.0).contains(&v), "a number of voxels between 1.5 and 64",
    { "type": "number", "minimum": 1.5, "maximum": 64 });
number!(
    /// A tolerance in voxels.
    Tolerance, |v| (0.0..=1.0).contains(&v), "a number of voxels between 0 and 1",
    { "type": "number", "minimum": 0, "maximum": 1 });

impl Default for Tolerance {
    fn default() -> Self {
        Self(0.01)
    }
}

/// A unit of length as a key of a recipe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unit(pub LengthUnit);

impl FromStr for Unit {
    type Err = crate::frame::UnknownUnit;
    fn from_str(s: &str) -> Result<Self, Self::Err> {
        s.parse().map(Self)
    }
}

impl Forms for Unit {
    const DESCRIPTION: &'static str = "a unit of length";

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "A unit of length.",
            "type": "string", "enum": ["um", "mm", "cm", "m", "in", "ft"]
        })
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        v.parse().map(Self).map_err(E::custom)
    }
}

forms!(Unit, "Unit");
