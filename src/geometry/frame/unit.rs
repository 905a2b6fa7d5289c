//! Units of length of numbers in files and on the command line.
//!
//! World units carry no unit of their own. Files and the command line name one, and numbers are converted once, where
//! they are read or written.

use std::fmt;
use std::str::FromStr;

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum LengthUnit {
    /// Micrometre.
    Micrometre,
    /// Millimetre, the default of CAD and of meshes without a unit.
    #[default]
    Millimetre,
    /// Centimetre.
    Centimetre,
    /// Metre, the unit of Houdini and Blender.
    Metre,
    /// Inch.
    Inch,
    /// Foot.
    Foot,
}

/// Symbol, metres and 3MF name of each unit, in the order of [`LengthUnit`].
const UNITS: [(LengthUnit, &str, f64, &str); 6] = [
    (LengthUnit::Micrometre, "um", 1e-6, "micron"),
    (LengthUnit::Millimetre, "mm", 1e-3, "millimeter"),
    (LengthUnit::Centimetre, "cm", 1e-2, "centimeter"),
    (LengthUnit::Metre, "m", 1.0, "meter"),
    (LengthUnit::Inch, "in", 0.0254, "inch"),
    (LengthUnit::Foot, "ft", 0.3048, "foot"),
];

/// A string that is not a unit of length.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown unit {0:?}; expected one of um, mm, cm, m, in, ft")]
pub struct UnknownUnit(pub String);

impl LengthUnit {
    fn row(self) -> (LengthUnit, &'static str, f64, &'static str) {
        UNITS[self as usize]
    }

    /// The symbol, as in "0.2mm".
    pub fn symbol(self) -> &'static str {
        self.row().1
    }

    /// The length of the unit in metres.
    pub fn metres(self) -> f64 {
        self.row().2
    }

    /// The name in a 3MF model.
    pub fn name_3mf(self) -> &'static str {
        self.row().3
    }

    /// The factor from a number in this unit to a number in `other`.
    ///
    /// ```
    /// # extern crate druse_geometry as druse;
    /// use druse::frame::LengthUnit;
    /// assert_eq!(60.0 * LengthUnit::Millimetre.to(LengthUnit::Metre), 0.06);
    /// ```
    pub fn to(self, other: Self) -> f64 {
        // In this order, ratios of powers of ten are exact, except from um to cm and from mm to um.
        self.metres() / other.metres()
    }
}

impl fmt::Display for LengthUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol())
    }
}

/// Reads a symbol or a 3MF name, in lower case and without blanks.
impl FromStr for LengthUnit {
    type Err = UnknownUnit;
    fn from_str(s: &str) -> Result<Self, UnknownUnit> {
        UNITS
            .iter()
            .find(|row| row.1 == s || row.3 == s)
            .map(|row| row.0)
            .ok_or_else(|| UnknownUnit(s.to_owned()))
    }
}
