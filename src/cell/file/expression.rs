//! The function of a `.cell` file: a series, or a tree of nodes over several.

use super::super::compatibility::{rank, symmetry_of};
use super::super::{CellError, Form, Series, lattices};
use super::CellTextError;
use crate::frame::Element;
use crate::symmetry::{Frequency, Lattice, Operator, PointGroup, SymmetryError};
use serde::Deserialize;

/// A coefficient.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Entry {
    pub k: Vec<i32>,
    pub c: [f64; 2],
}

/// One series, as it stands in a file.
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
pub(super) enum Expression {
    Series(SeriesEntry),
    Sum(Vec<Weighted>),
    Least(Parts),
    Greatest(Parts),
    Magnitude(Box<Expression>),
    Shift(Shifted),
    Negation(Box<Expression>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Weighted {
    weight: f64,
    part: Expression,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parts {
    parts: Vec<Expression>,
    #[serde(default)]
    radius: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Shifted {
    part: Box<Expression>,
    by: f64,
}

/// The text with what has been read of it, for errors that name a line: series have the same keys,
/// so that the n-th series' key is the n-th of its name.
pub(super) struct Reader<'a> {
    pub text: &'a str,
    pub element: Element,
    /// Series and coefficients that have been read.
    pub series: usize,
    pub coefficients: usize,
}

impl Reader<'_> {
    /// The line of the n-th time that a key stands in the text.
    pub fn line(&self, key: &str, n: usize) -> Option<usize> {
        let quoted = format!("{key:?}");
        let (at, _) = self.text.match_indices(&quoted).nth(n)?;
        Some(self.text[..at].matches('\n').count() + 1)
    }

    /// An error at a key of the series that is being read.
    fn on(&self, key: &str, reason: String) -> CellTextError {
        CellTextError {
            line: self.line(key, self.series),
            reason,
        }
    }

    /// An error at the key of what is wrong, if it has one.
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
            CellError::Expression(_) => self.line("expression", 0),
            _ => self.line("lattice", self.series),
        };
        CellTextError {
            line,
            reason: e.to_string(),
        }
    }

    /// The function that an expression describes.
    pub fn form(&mut self, expression: &Expression) -> Result<Form, CellTextError> {
        let mut all = |parts: &[Expression]| -> Result<Vec<Form>, CellTextError> {
            parts.iter().map(|e| self.form(e)).collect()
        };
        let made = match expression {
            Expression::Series(entry) => return self.leaf(entry),
            Expression::Sum(parts) => {
                let mut forms = Vec::with_capacity(parts.len());
                for p in parts {
                    forms.push((p.weight, self.form(&p.part)?));
                }
                Form::sum(forms)
            }
            Expression::Least(p) => Form::least(all(&p.parts)?, p.radius),
            Expression::Greatest(p) => Form::greatest(all(&p.parts)?, p.radius),
            Expression::Magnitude(part) => Ok(self.form(part)?.magnitude()),
            Expression::Shift(s) if !s.by.is_finite() => Err(CellError::Expression(format!(
                "shift by {}; expected a finite number",
                s.by
            ))),
            Expression::Shift(s) => Ok(self.form(&s.part)?.shifted(s.by)),
            Expression::Negation(part) => Ok(self.form(part)?.negated()),
        };
        made.map_err(|e| self.fault(&e))
    }

    fn leaf(&mut self, entry: &SeriesEntry) -> Result<Form, CellTextError> {
        let form: Form = match rank(self.element) {
            2 => self.series_of::<2>(entry)?.into(),
            3 => self.series_of::<3>(entry)?.into(),
            _ => self.series_of::<6>(entry)?.into(),
        };
        // Each part alone, so that what does not fit is found on its line.
        symmetry_of(self.element, &form).map_err(|e| self.fault(&e))?;
        self.series += 1;
        self.coefficients += entry.coefficients.len();
        Ok(form)
    }

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
        // A named lattice is exact whatever the file's digits.
        let lattice: Lattice<D> = match lattice.name() {
            Some(name) => Lattice::named(name).map_err(of_lattice)?,
            None => {
                return Err(self.on(
                    "lattice",
                    format!(
                        "the lattice {:?} does not go with a {}; expected {}",
                        entry.lattice,
                        self.element.name(),
                        lattices(self.element).join(" or ")
                    ),
                ));
            }
        };
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
