//! `target` of `[cell.NAME]`: a cell by the properties that it shall have. Only the keys and their rules; the
//! search is elsewhere.

use super::cell::{CellSection, Solid};
use super::forms::{Forms, forms, from_argument};
use super::quantity::{Finite, Positive};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess};
use std::collections::BTreeMap;
use std::str::FromStr;

/// A property that is made as large as it can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum TargetProperty {
    /// Bulk modulus.
    Bulk,
    /// Shear modulus, mean over directions under uniform stress.
    Shear,
    /// Young's modulus, harmonic mean over all directions.
    Young,
    /// Conductivity, mean over directions.
    Conductivity,
    /// Permeability of the void, mean over directions.
    Permeability,
}

/// Target properties of a cell, relative to its solid. Left out keys do not count.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TargetTable {
    /// The property that shall be as large as it can be.
    pub maximise: Option<TargetProperty>,
    /// Zener's ratio 2 C44 / (C11 - C12); 1 is isotropic.
    pub zener: Option<Positive>,
    /// Poisson's ratio along the axes, C12 / (C11 + C12), between -1 and 0.5.
    pub poisson: Option<Finite>,
    /// A stiffness to come near to: six rows of six numbers, order 11 22 33 23 13 12, engineering shear,
    /// relative to the solid's Young's modulus.
    pub stiffness: Option<[[Finite; 6]; 6]>,
    /// Weight of the square of the relative distance to the stiffness, beside maximise [default: 10].
    pub weight: Option<Positive>,
    /// Least opening: radius of the greatest ball that travels through the void to the next period along every axis,
    /// in reference lengths; of a sheet through the void on each side.
    pub min_opening: Option<Positive>,
    /// Least permeability of the void, mean over directions, in squares of the period.
    pub min_permeability: Option<Positive>,
    /// Greatest permeability of the void, in squares of the period.
    pub max_permeability: Option<Positive>,
    /// Poisson's ratio of the solid [default: 0.3].
    pub solid_poisson: Option<Finite>,
    /// Number of starts; after each of three stages the better half goes on [default: 8].
    pub starts: Option<u32>,
    /// Evaluations of the objective for each start that reaches the last stage [default: 100].
    pub evaluations: Option<u32>,
    /// Voxels along the period in the last stage, an even number; figures are for as many and for twice
    /// as many [default: 24, of sheets 32, or four for the shortest wave].
    pub voxels: Option<u32>,
}

/// The value of `target`: a table, or a property's name for `{ maximise = NAME }`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TargetWord(pub TargetTable);

impl FromStr for TargetWord {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        from_argument(s)
    }
}

impl Forms for TargetWord {
    const DESCRIPTION: &'static str = "a property (bulk, shear, young, conductivity, permeability) or a table with maximise, \
                     zener, poisson or stiffness";

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let table = generator.subschema_for::<TargetTable>();
        let word = generator.subschema_for::<TargetProperty>();
        json_schema!({ "anyOf": [word, table] })
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        let word = serde::de::value::StrDeserializer::new(v);
        Ok(Self(TargetTable {
            maximise: Some(TargetProperty::deserialize(word)?),
            ..TargetTable::default()
        }))
    }
    fn table<'de, A: MapAccess<'de>>(map: A) -> Result<Self, A::Error> {
        TargetTable::deserialize(MapAccessDeserializer::new(map)).map(Self)
    }
}

forms!(TargetWord, "Target");

impl CellSection {
    /// Names of keys that belong to a target, where they are given.
    fn target_keys(&self) -> Vec<&'static str> {
        let given = [
            ("start", self.start.is_some()),
            ("seed", self.seed.is_some()),
            ("min_feature", self.min_feature.is_some()),
            ("match", self.matched.is_some()),
        ];
        given.iter().filter(|g| g.1).map(|g| g.0).collect()
    }

    /// What is wrong with the keys around a target: the key and the reason; `None` for a valid section, with a
    /// target or without.
    pub(crate) fn target_fault(&self) -> Option<(&'static str, String)> {
        if self.target.is_none() {
            let key = self.target_keys().into_iter().next()?;
            return Some((
                key,
                format!("found {key} without target; expected both or none"),
            ));
        }
        if self.volume_fraction.is_none() {
            return Some((
                "target",
                "found target without volume_fraction; expected the share of solid beside it"
                    .to_owned(),
            ));
        }
        // Keys of a fit to a source, which a search by properties has not.
        let others = [
            ("invert", self.invert.is_some()),
            ("keep", self.keep.is_some()),
            ("tolerance", self.tolerance.is_some()),
            ("method", self.method.is_some()),
            ("place", self.place.is_some()),
        ];
        if let Some((key, _)) = others.iter().find(|o| o.1) {
            return Some((
                key,
                format!("found {key} beside target; expected a fit with {key}"),
            ));
        }
        if self.solid == Some(Solid::Above) {
            let reason =
                "found solid = \"above\" beside target; expected below (a network) or sheet";
            return Some(("solid", reason.to_owned()));
        }
        None
    }
}

/// What is wrong with the first faulty target of a palette: the cell's name, the key and the reason.
pub(super) fn check(
    cells: &BTreeMap<String, CellSection>,
) -> Result<(), (String, &'static str, String)> {
    for (name, section) in cells {
        let wrong = |key, reason: String| Err((name.clone(), key, reason));
        if let Some((key, reason)) = section.target_fault() {
            return wrong(key, reason);
        }
        for other in section.matched.iter().flatten() {
            match cells.get(other) {
                _ if other == name => {
                    return wrong(
                        "match",
                        "a cell cannot match itself; expected other cells".to_owned(),
                    );
                }
                None => {
                    let known: Vec<&str> = cells.keys().map(String::as_str).collect();
                    let known = known.join(", ");
                    return wrong(
                        "match",
                        format!("no cell is named {other:?}; known: {known}"),
                    );
                }
                // A chain of matches would have no order in which to search.
                Some(own) if own.matched.is_some() => {
                    return wrong(
                        "match",
                        format!(
                            "{other} has match itself; expected a cell that stands by its own keys"
                        ),
                    );
                }
                Some(_) => {}
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_words_or_tables() {
        let word: TargetWord = "bulk".parse().unwrap();
        let table: TargetWord = "{ maximise = \"bulk\" }".parse().unwrap();
        assert_eq!(word, table);
        let both: TargetWord = "{ zener = 1, poisson = -0.2, voxels = 16 }"
            .parse()
            .unwrap();
        assert_eq!(both.0.poisson, Some(Finite(-0.2)));
        for (text, words) in [
            ("bluk", "bulk"),
            ("{ maximize = \"bulk\" }", "maximise"),
            ("{ zener = 0 }", "positive"),
            ("{ min_opening = -0.1 }", "positive"),
            ("{ min_openning = 0.1 }", "min_opening"),
            ("{ stiffness = [[1, 2]] }", "array"),
        ] {
            let refused = text.parse::<TargetWord>().unwrap_err();
            assert!(refused.contains(words), "{text}: {refused}");
        }
    }
}
