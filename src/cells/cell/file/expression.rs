//! The function of a `.cell` file: a series, or an expression of several.
//!
//! The entries mirror the objects of the file; [`Reader`] makes functions from them. The named lattice that it equals
//! replaces a lattice in the file; any other is an error. Lines of errors are found by counting keys in the text,
//! since the parser keeps none.

use super::super::compatibility::{rank, symmetry_of};
use super::super::{CellError, Expression, Series, lattices};
use super::CellTextError;
use crate::symmetry::{Frequency, Lattice, Operator, PointGroup, SymmetryError};
use druse_geometry::frame::{Element, is_in_range};
use serde::Deserialize;

/// A coefficient `c` of the orbit of the index `k`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Entry {
    pub k: Vec<i32>,
    pub c: [f64; 2],
}

/// A series in a file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SeriesEntry {
    pub group: String,
    #[serde(default)]
    pub generators: Option<Vec<String>>,
    pub lattice: Vec<Vec<f64>>,
    pub coefficients: Vec<Entry>,
}

/// A node of an expression.
#[derive(Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum ExpressionEntry {
    Series(SeriesEntry),
    Sum(Vec<Weighted>),
    #[serde(rename = "least")]
    Min(Parts),
    #[serde(rename = "greatest")]
    Max(Parts),
    Magnitude(Box<ExpressionEntry>),
    Shift(Shifted),
    Negation(Box<ExpressionEntry>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Weighted {
    weight: f64,
    part: ExpressionEntry,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parts {
    parts: Vec<ExpressionEntry>,
    #[serde(default)]
    radius: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Shifted {
    part: Box<ExpressionEntry>,
    by: f64,
}

/// Reads the function of a file. The counts of series and coefficients that are already read locate errors: the
/// n-th series has the n-th occurrence of each key.
pub(super) struct Reader<'a> {
    pub text: &'a str,
    pub element: Element,
    /// Series and coefficients that are already read.
    pub series: usize,
    pub coefficients: usize,
}

impl Reader<'_> {
    /// The line of the n-th occurrence of a key in the text.
    /// `n` counts from 0, and the line from 1. `None` if there is no such occurrence. Keys within strings count too.
    pub fn line(&self, key: &str, n: usize) -> Option<usize> {
        let quoted = format!("{key:?}");
        let (at, _) = self.text.match_indices(&quoted).nth(n)?;
        Some(self.text[..at].matches('\n').count() + 1)
    }

    /// An error at a key of the current series.
    fn on(&self, key: &str, reason: String) -> CellTextError {
        CellTextError {
            line: self.line(key, self.series),
            reason,
        }
    }

    /// An error at the key that causes it, if it has one.
    /// Otherwise at the lattice of the current series.
    pub fn fault(&self, e: &CellError) -> CellTextError {
        let line = match e {
            CellError::Coefficient { place, .. } => {
                let start = self.text.find("\"coefficients\"").unwrap_or(0);
                let mut keys = self.text[start..].match_indices("\"k\"");
                let at = keys
                    .nth(self.coefficients + place)
                    .map(|(at, _)| start + at);
                at.map(|at| self.text[..at].matches('\n').count() + 1)
            }
            CellError::Unfitting { what, .. } | CellError::OutOfRange { what, .. } => {
                self.line(what, self.series)
            }
            // A series alone has no expression.
            CellError::Expression(_) => self
                .line("expression", 0)
                .or_else(|| self.line("coefficients", 0)),
            _ => self.line("lattice", self.series),
        };
        CellTextError {
            line,
            reason: e.to_string(),
        }
    }

    /// The function of an expression.
    /// Counts the series and coefficients that it reads.
    pub fn function(&mut self, expression: &ExpressionEntry) -> Result<Expression, CellTextError> {
        let mut all = |parts: &[ExpressionEntry]| -> Result<Vec<Expression>, CellTextError> {
            parts.iter().map(|e| self.function(e)).collect()
        };
        let made = match expression {
            ExpressionEntry::Series(entry) => return self.leaf(entry),
            ExpressionEntry::Sum(parts) => {
                let mut functions = Vec::with_capacity(parts.len());
                for p in parts {
                    functions.push((p.weight, self.function(&p.part)?));
                }
                Expression::sum(functions)
            }
            ExpressionEntry::Min(p) => Expression::min(all(&p.parts)?, p.radius),
            ExpressionEntry::Max(p) => Expression::max(all(&p.parts)?, p.radius),
            ExpressionEntry::Magnitude(part) => Ok(self.function(part)?.magnitude()),
            ExpressionEntry::Shift(s) if !is_in_range(s.by) => Err(CellError::Expression(format!(
                "shift by {}; expected a finite number below 1e18",
                s.by
            ))),
            ExpressionEntry::Shift(s) => Ok(self.function(&s.part)?.shifted(s.by)),
            ExpressionEntry::Negation(part) => Ok(self.function(part)?.negated()),
        };
        made.map_err(|e| self.fault(&e))
    }

    /// The function of one series, checked for the element. Advances the counts.
    fn leaf(&mut self, entry: &SeriesEntry) -> Result<Expression, CellTextError> {
        let function: Expression = match rank(self.element) {
            2 => self.series_of::<2>(entry)?.into(),
            3 => self.series_of::<3>(entry)?.into(),
            _ => self.series_of::<6>(entry)?.into(),
        };
        // Each series is checked separately, so that an error names its line.
        symmetry_of(self.element, &function).map_err(|e| self.fault(&e))?;
        self.series += 1;
        self.coefficients += entry.coefficients.len();
        Ok(function)
    }

    /// The series of an entry in dimension `D`; errors have the line of their key.
    /// The lattice must be one of the element's, with `D` vectors of `D` components.
    fn series_of<const D: usize>(&self, entry: &SeriesEntry) -> Result<Series<D>, CellTextError> {
        let vectors: Option<Vec<[f64; D]>> = entry
            .lattice
            .iter()
            .map(|v| v.as_slice().try_into().ok())
            .collect();
        let vectors: [[f64; D]; D] = vectors.and_then(|v| v.try_into().ok()).ok_or_else(|| {
            let found = &entry.lattice;
            self.on(
                "lattice",
                format!("the lattice is {found:?}; expected {D} vectors of {D} components"),
            )
        })?;
        let of_lattice = |e: SymmetryError| self.on("lattice", e.to_string());
        let lattice = Lattice::new(vectors).map_err(of_lattice)?;
        // The exact named lattice replaces the rounded vectors of the file.
        let lattice: Lattice<D> = match lattice.name() {
            Some(name) => Lattice::named(name).map_err(of_lattice)?,
            None => {
                return Err(self.on(
                    "lattice",
                    format!(
                        "the lattice {:?} is not compatible with a {}; expected {}",
                        entry.lattice,
                        self.element.name(),
                        lattices(self.element).join(" or ")
                    ),
                ));
            }
        };
        // A group without a name is generated by its operators.
        let group = match &entry.generators {
            None => PointGroup::named(&entry.group, &lattice)
                .map_err(|e| self.on("group", e.to_string()))?,
            Some(texts) => {
                let operators = texts.iter().map(|t| t.parse::<Operator<D>>());
                operators
                    .collect::<Result<Vec<_>, _>>()
                    .and_then(|o| PointGroup::generated(&entry.group, &o))
                    .map_err(|e| CellTextError {
                        line: self.line("group", self.series),
                        reason: e.to_string(),
                    })?
            }
        };
        let mut terms: Vec<(Frequency<D>, [f64; 2])> = Vec::with_capacity(entry.coefficients.len());
        for (place, t) in entry.coefficients.iter().enumerate() {
            let k = t.k.as_slice().try_into().map_err(|_| {
                self.fault(&CellError::Coefficient {
                    place,
                    index: format!("{:?}", t.k),
                    reason: format!("{} indices; expected {D}", t.k.len()),
                })
            })?;
            terms.push((k, t.c));
        }
        Series::new(group, lattice, &terms).map_err(|e| self.fault(&e))
    }
}
