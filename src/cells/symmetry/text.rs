//! Groups as text: generators in crystallographic notation, one per line.
//!
//! ```text
//! # a brick with rotations by 180 degrees about its three axes
//! name D2
//! lattice cubic
//! -x,-y,z
//! x,-y,-z
//! ```
//!
//! Generators act on the coordinates of the lattice (for `cubic`, Cartesian ones). Two images define a
//! group in the plane, three a group in space. `name` and `lattice` are optional. Text from `#` to the end of
//! a line is a comment.

use super::{Lattice, Operator, PointGroup, SymmetryError};

/// Why text is not a group: the line, from 1, and the reason.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct GroupTextError {
    /// The line at fault.
    pub line: usize,
    /// What was found and what was expected.
    pub reason: String,
}

/// A group in text form; see the module's head.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GroupText {
    /// The name, if the text has one.
    pub name: Option<String>,
    /// The name of the lattice, if the text has one.
    pub lattice: Option<String>,
    /// Number of coordinates: 2 or 3.
    pub dimension: usize,
    /// The generators and their lines.
    generators: Vec<(usize, String)>,
}

/// Maximal number of generators.
const MAX_GENERATORS: usize = 48;

impl GroupText {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`GroupTextError`]: an unknown, repeated or incomplete word, no generator or more than 48, generators without 2
    /// or 3 images or of different dimensions.
    pub fn parse(text: &str) -> Result<Self, GroupTextError> {
        let (mut name, mut lattice) = (None, None);
        let mut generators: Vec<(usize, String)> = Vec::new();
        let mut dimension = 0;
        for (number, line) in text.lines().enumerate() {
            let line_number = number + 1;
            let fail = |reason: String| GroupTextError {
                line: line_number,
                reason,
            };
            let line = line.split('#').next().unwrap_or("").trim();
            if line.is_empty() {
                continue;
            }
            if !line.contains(',') {
                let (word, value) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
                let value = value.trim();
                let place = match word {
                    "name" => &mut name,
                    "lattice" => &mut lattice,
                    _ => {
                        return Err(fail(format!(
                            "found {line:?}; expected an operator such as \"x,-z,y\", or name or \
                             lattice and a word"
                        )));
                    }
                };
                if value.is_empty() || value.contains(char::is_whitespace) {
                    return Err(fail(format!(
                        "found {line:?}; expected one word after {word}"
                    )));
                }
                if place.replace(value.to_owned()).is_some() {
                    return Err(fail(format!("{word} is given twice")));
                }
                continue;
            }
            let images = line.split(',').count();
            if !(2..=3).contains(&images) || (dimension != 0 && images != dimension) {
                return Err(fail(format!(
                    "operator {line:?} has {images} images; expected {}",
                    match dimension {
                        0 => "2 or 3".to_owned(),
                        d => format!("{d}, as the lines before"),
                    }
                )));
            }
            if generators.len() == MAX_GENERATORS {
                return Err(fail(format!(
                    "more than {MAX_GENERATORS} generators; no finite group needs so many"
                )));
            }
            dimension = images;
            generators.push((line_number, line.to_owned()));
        }
        if generators.is_empty() {
            return Err(GroupTextError {
                line: text.lines().count().max(1),
                reason: "no generator; expected lines such as \"x,-z,y\"".to_owned(),
            });
        }
        Ok(Self {
            name,
            lattice,
            dimension,
            generators,
        })
    }

    /// The text on one line, with parts separated by `;`, without comments.
    pub fn line(&self) -> String {
        let word = |key: &str, value: &Option<String>| value.as_ref().map(|v| format!("{key} {v}"));
        let mut parts: Vec<String> = word("name", &self.name)
            .into_iter()
            .chain(word("lattice", &self.lattice))
            .collect();
        parts.extend(self.generators.iter().map(|g| g.1.clone()));
        parts.join("; ")
    }

    /// The group in the coordinates of the text's lattice, or of the lattice `default`. `name` is used if the
    /// text has no name.
    ///
    /// # Errors
    /// [`GroupTextError`]: a text of another dimension, an unknown lattice, an invalid operator, generators
    /// of an infinite group, operators that change lengths on the lattice.
    pub fn group<const D: usize>(
        &self,
        name: &str,
        default: &str,
    ) -> Result<(PointGroup<D>, Lattice<D>), GroupTextError> {
        let first = self.generators.first().map_or(1, |g| g.0);
        let on_line = |line: usize| {
            move |e: SymmetryError| GroupTextError {
                line,
                reason: e.to_string(),
            }
        };
        if self.dimension != D {
            return Err(GroupTextError {
                line: first,
                reason: format!(
                    "the group acts on {} coordinates; expected {D}",
                    self.dimension
                ),
            });
        }
        let lattice = Lattice::<D>::named(self.lattice.as_deref().unwrap_or(default))
            .map_err(on_line(first))?;
        let mut operators = Vec::with_capacity(self.generators.len());
        for (line, text) in &self.generators {
            let operator: Operator<D> = text.parse().map_err(on_line(*line))?;
            // Each generator is checked separately, so that an error names its line.
            PointGroup::generated("", &[operator]).map_err(on_line(*line))?;
            operators.push(operator);
        }
        let group = PointGroup::generated(self.name.as_deref().unwrap_or(name), &operators)
            .map_err(on_line(first))?;
        for (m, q) in group.operators().iter().zip(group.cartesian(&lattice)) {
            let miss = q.transpose() * q - nalgebra::SMatrix::<f64, D, D>::identity();
            if miss.iter().any(|c| c.abs() > 1e-9) {
                return Err(GroupTextError {
                    line: first,
                    reason: format!(
                        "the operator {m} changes lengths on the lattice {}; expected rotations and \
                         reflections (name the lattice whose coordinates the operators act on)",
                        lattice.name().unwrap_or("given")
                    ),
                });
            }
        }
        Ok((group, lattice))
    }
}
