//! Cells made of other cells of the palette: averages, unions, intersections, differences, Minkowski
//! sums and differences.

use super::cell::CellSection;
use super::quantity::Positive;
use crate::cell::minkowski::{Environment, Minkowski, Operation, minkowski};
use crate::cell::{Cell, CellError, FitError, FitOptions, Join};
use crate::progress::Progress;
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

/// The field around the element in a Minkowski sum or difference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Surroundings {
    /// The first cell's own continuation, as its neighbours in a tiling.
    #[default]
    Torus,
    /// Void: the first cell ends at the faces.
    Cell,
}

/// How cells are combined.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Way {
    Average,
    Join(Join, f64),
    Minkowski(Minkowski),
}

/// A cell made of other cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Hybrid {
    way: Way,
    parts: Vec<Ingredient>,
}

impl CellSection {
    /// The hybrid that the section describes, if other cells are its source; `None` for other sources. Of several
    /// such keys the first in a fixed order counts; the check refuses them.
    pub fn hybrid(&self) -> Option<Hybrid> {
        // An average has weights; the other ways name cells alone.
        if let Some(shares) = &self.average {
            return Some(Hybrid {
                way: Way::Average,
                parts: shares.clone(),
            });
        }
        let radius = self.smooth.map_or(0.0, |r| r.0);
        let environment = match self.environment.unwrap_or_default() {
            Surroundings::Torus => Environment::Torus,
            Surroundings::Cell => Environment::Cell,
        };
        let minkowski = |operation| {
            Way::Minkowski(Minkowski {
                operation,
                environment,
            })
        };
        let ways = [
            (Way::Join(Join::Union, radius), &self.union),
            (Way::Join(Join::Intersection, radius), &self.intersection),
            (Way::Join(Join::Difference, radius), &self.difference),
            (minkowski(Operation::Sum), &self.minkowski_sum),
            (minkowski(Operation::Difference), &self.minkowski_difference),
        ];
        let (way, names) = ways
            .into_iter()
            .find_map(|(way, names)| Some((way, names.as_ref()?)))?;
        let shares = names.iter().map(|name| Ingredient {
            cell: name.clone(),
            weight: one(),
        });
        Some(Hybrid {
            way,
            parts: shares.collect(),
        })
    }

    /// The section without the keys of hybrids, of the level and of the solid side: options of the fit remain.
    #[must_use]
    pub fn without_hybrid(&self) -> Self {
        Self {
            average: None,
            union: None,
            intersection: None,
            difference: None,
            minkowski_sum: None,
            minkowski_difference: None,
            environment: None,
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

    /// The cell that the parts make; `cells` are they, in the order of [`Hybrid::parts`]. A Minkowski sum or
    /// difference is fitted with the options.
    ///
    /// # Errors
    /// [`CellError::Expression`]: no parts, several elements, a difference of one; those of
    /// [`minkowski`].
    pub fn make(
        &self,
        name: &str,
        cells: &[Cell],
        options: &FitOptions,
        progress: &dyn Progress,
    ) -> Result<Cell, FitError> {
        let all: Vec<&Cell> = cells.iter().collect();
        match self.way {
            Way::Average => {
                let weights = self.parts.iter().map(|s| s.weight.0);
                let shares: Vec<(f64, &Cell)> = weights.zip(cells).collect();
                Ok(Cell::average(name, &shares)?)
            }
            Way::Join(join, radius) => Ok(Cell::joined(name, join, &all, radius)?),
            Way::Minkowski(how) => {
                let [first, rest @ ..] = all.as_slice() else {
                    let none = "a Minkowski sum needs cells; found none".to_owned();
                    return Err(CellError::Expression(none).into());
                };
                let mut cell = (*first).clone();
                for other in rest {
                    cell = minkowski(name, &cell, other, how, options, progress)?;
                }
                Ok(cell.named(name))
            }
        }
    }
}

const ENVIRONMENT: &str = "environment goes with minkowski_sum or minkowski_difference";

/// The first error of the hybrids of a palette: the name of the cell and the reason.
pub(super) fn check(cells: &BTreeMap<String, CellSection>) -> Result<(), (String, String)> {
    for (name, section) in cells {
        let wrong = |reason: String| Err((name.clone(), reason));
        let Some(hybrid) = section.hybrid() else {
            if section.smooth.is_some() {
                return wrong("smooth goes with union, intersection or difference".to_owned());
            }
            if section.environment.is_some() {
                return wrong(ENVIRONMENT.to_owned());
            }
            continue;
        };
        if section.smooth.is_some() {
            let kind = match hybrid.way {
                Way::Average => Some("an average"),
                Way::Minkowski(_) => Some("a Minkowski sum"),
                Way::Join(..) => None,
            };
            if let Some(kind) = kind {
                return wrong(format!("{kind} has no edges to smooth"));
            }
        }
        let sum = matches!(hybrid.way, Way::Minkowski(_));
        if section.environment.is_some() && !sum {
            return wrong(ENVIRONMENT.to_owned());
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
        // A cell that is made of itself could not be fitted in any order.
        if reaches(cells, name, &hybrid) {
            return wrong("it is made of itself".to_owned());
        }
    }
    Ok(())
}

/// Whether a hybrid has the cell `name` among its parts, or their parts.
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
