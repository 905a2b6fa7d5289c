//! A requirement of a recipe and its verdict, as the report of a run lists them. The texts hold rounded numbers
//! with units; `value` is the number itself.

use super::error::short_number;
use serde::Serialize;

/// A requirement and its verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Requirement {
    /// Its key in `[require]`.
    pub name: &'static str,
    /// The required value, with its unit.
    pub required: String,
    /// The measured value, with its unit.
    pub found: String,
    /// The measured value as a number, where there is one: lengths in the unit of the requirement, mass
    /// in grams.
    pub value: Option<f64>,
    /// Whether it is met.
    pub met: bool,
    /// The worst point, in the unit of the requirement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub place: Option<[f64; 3]>,
    /// A remedy where it is not met.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hint: Option<&'static str>,
}

impl std::fmt::Display for Requirement {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let verdict = if self.met { "met" } else { "NOT met" };
        let Self {
            name,
            required,
            found,
            ..
        } = self;
        write!(f, "require {name}: {verdict}: {required}, found {found}")?;
        if let Some([x, y, z]) = self.place.map(|p| p.map(short_number)) {
            write!(f, " at ({x}, {y}, {z})")?;
        }
        if let Some(hint) = self.hint {
            write!(f, "; {hint}")?;
        }
        Ok(())
    }
}
