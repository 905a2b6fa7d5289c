//! Cells made of other cells of the palette: averages, unions, intersections, differences.

use super::cell::CellSection;
use super::quantity::Positive;
use crate::cell::{Cell, CellError, Join};
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr;

/// One cell of an average.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Ingredient {
    /// Its name in the palette.
    pub cell: String,
    /// Its weight; they are divided by their sum [default: 1].
    #[serde(default = "one")]
    pub weight: Positive,
}

fn one() -> Positive {
    Positive(1.0)
}

impl FromStr for Ingredient {
    type Err = String;

    /// Reads `CELL` or `CELL=WEIGHT`.
    fn from_str(s: &str) -> Result<Self, String> {
        let (cell, weight) = match s.rsplit_once('=') {
            None => (s, one()),
            Some((cell, weight)) => (cell, weight.parse().map_err(|e| format!("{e}"))?),
        };
        Ok(Self {
            cell: cell.to_owned(),
            weight,
        })
    }
}

/// What a section makes of other cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Hybrid {
    /// How, but for an average.
    join: Option<Join>,
    radius: f64,
    parts: Vec<Ingredient>,
}

impl CellSection {
    /// What it makes of other cells, if they are its source.
    pub fn hybrid(&self) -> Option<Hybrid> {
        let of = |join, parts: Vec<Ingredient>| Hybrid {
            join,
            radius: self.smooth.map_or(0.0, |r| r.0),
            parts,
        };
        if let Some(shares) = &self.average {
            return Some(of(None, shares.clone()));
        }
        let joins = [
            (Join::Union, &self.union),
            (Join::Intersection, &self.intersection),
            (Join::Difference, &self.difference),
        ];
        let (join, names) = joins
            .into_iter()
            .find_map(|(j, n)| Some((j, n.as_ref()?)))?;
        let shares = names.iter().map(|name| Ingredient {
            cell: name.clone(),
            weight: one(),
        });
        Some(of(Some(join), shares.collect()))
    }

    /// The section without what it makes of other cells, its level and its name.
    #[must_use]
    pub fn without_hybrid(&self) -> Self {
        Self {
            average: None,
            union: None,
            intersection: None,
            difference: None,
            smooth: None,
            level: None,
            volume_fraction: None,
            thickness: None,
            solid: None,
            invert: None,
            ..self.clone()
        }
    }
}

impl Hybrid {
    /// Names of its parts.
    pub fn parts(&self) -> impl Iterator<Item = &str> {
        self.parts.iter().map(|s| s.cell.as_str())
    }

    /// The same with another first part, of weight 1.
    #[must_use]
    pub fn after(mut self, first: &str) -> Self {
        let share = Ingredient {
            cell: first.to_owned(),
            weight: one(),
        };
        self.parts.insert(0, share);
        self
    }

    /// The cell that the parts make, given in order.
    ///
    /// # Errors
    /// [`CellError::Expression`]: no parts, several elements, a difference of one.
    pub fn make(&self, name: &str, cells: &[Cell]) -> Result<Cell, CellError> {
        match self.join {
            None => {
                let weights = self.parts.iter().map(|s| s.weight.0);
                let shares: Vec<(f64, &Cell)> = weights.zip(cells).collect();
                Cell::average(name, &shares)
            }
            Some(join) => Cell::joined(name, join, &cells.iter().collect::<Vec<_>>(), self.radius),
        }
    }
}

/// What is wrong with the hybrids of a palette: the name of the cell and the reason.
pub(super) fn check(cells: &BTreeMap<String, CellSection>) -> Result<(), (String, String)> {
    for (name, section) in cells {
        let wrong = |reason: String| Err((name.clone(), reason));
        let Some(hybrid) = section.hybrid() else {
            if section.smooth.is_some() {
                return wrong("smooth goes with union, intersection or difference".to_owned());
            }
            continue;
        };
        if hybrid.join.is_none() && section.smooth.is_some() {
            return wrong("an average has no edges to smooth".to_owned());
        }
        if hybrid.parts.is_empty() {
            return wrong("found no cells; expected at least one".to_owned());
        }
        if let Some(unknown) = hybrid.parts().find(|p| !cells.contains_key(*p)) {
            let known: Vec<&str> = cells.keys().map(String::as_str).collect();
            return wrong(format!(
                "no cell is named {unknown:?}; known: {}",
                known.join(", ")
            ));
        }
        if reaches(cells, name, &hybrid) {
            return wrong("it is made of itself".to_owned());
        }
    }
    Ok(())
}

/// Whether a hybrid has a cell among its parts, or their parts.
fn reaches(cells: &BTreeMap<String, CellSection>, name: &str, hybrid: &Hybrid) -> bool {
    let mut seen = BTreeSet::new();
    let mut left: Vec<String> = hybrid.parts().map(str::to_owned).collect();
    while let Some(part) = left.pop() {
        if part == name {
            return true;
        }
        let below = cells.get(&part).and_then(CellSection::hybrid);
        if seen.insert(part) {
            left.extend(below.iter().flat_map(Hybrid::parts).map(str::to_owned));
        }
    }
    false
}
