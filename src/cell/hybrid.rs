//! Hybrids: cells made of other cells of one element.
//!
//! Each part enters by its solid (level and side included) divided by its gamma, the root mean
//! square of its gradient on its surface: near the surface that is a distance in reference lengths,
//! so that no part outweighs the others and a radius is a length.

use super::{Cell, CellError, Form, Solid};

/// How solids become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Join {
    /// What lies in any of them.
    Union,
    /// What lies in all of them.
    Intersection,
    /// What lies in the first and in none of the others.
    Difference,
}

impl Cell {
    /// The function whose values below 0 are the cell's solid.
    pub(super) fn solid_form(&self) -> Form {
        match self.solid {
            Solid::Below => self.form.shifted(self.level),
            Solid::Above => self.form.shifted(self.level).negated(),
            Solid::Sheet => self.form.magnitude().shifted(self.level),
            Solid::Channels => self.form.magnitude().shifted(self.level).negated(),
        }
    }

    /// The solid's function with gamma 1.
    fn unit_form(&self) -> Result<Form, CellError> {
        let gamma = self.gamma();
        if !(gamma.is_finite() && gamma > 0.0) {
            return Err(CellError::Expression(format!(
                "cell {:?} has the mean slope {gamma} on its surface; expected a positive number (has \
                 it a surface?)",
                self.name
            )));
        }
        Form::sum(vec![(gamma.recip(), self.solid_form())])
    }

    fn check_one_element(cells: &[&Self]) -> Result<super::Element, CellError> {
        let Some(first) = cells.first() else {
            return Err(CellError::Expression(
                "no cells; expected at least one".to_owned(),
            ));
        };
        match cells.iter().find(|c| c.element != first.element) {
            None => Ok(first.element),
            Some(other) => Err(CellError::Expression(format!(
                "cell {:?} is made for a {}, cell {:?} for a {}; expected one element",
                first.name,
                first.element.name(),
                other.name,
                other.element.name()
            ))),
        }
    }

    /// The weighted average of cells of one element, each divided by its gamma: a cell between them.
    /// Bands and lattices may differ.
    ///
    /// # Errors
    /// [`CellError::Expression`] for no cells, several elements, a cell without slope, or weights
    /// that are negative, not finite, or all 0.
    pub fn average(name: &str, parts: &[(f64, &Self)]) -> Result<Self, CellError> {
        let cells: Vec<&Self> = parts.iter().map(|p| p.1).collect();
        let element = Self::check_one_element(&cells)?;
        let total: f64 = parts.iter().map(|p| p.0).sum();
        let bad = parts.iter().find(|p| !(p.0.is_finite() && p.0 >= 0.0));
        if bad.is_some() || !(total.is_finite() && total > 0.0) {
            let weights: Vec<f64> = parts.iter().map(|p| p.0).collect();
            return Err(CellError::Expression(format!(
                "the weights are {weights:?}; expected numbers from 0 on with a positive sum"
            )));
        }
        let forms = parts
            .iter()
            .map(|(w, cell)| Ok((w / total, cell.unit_form()?)))
            .collect::<Result<Vec<_>, CellError>>()?;
        Self::new(name, element, Form::sum(forms)?)
    }

    /// The union, intersection or difference of the solids of cells of one element, each divided by
    /// its gamma. Edges where two meet are rounded with `radius`, about a length in reference
    /// units; 0 keeps them sharp.
    ///
    /// # Errors
    /// [`CellError::Expression`] as of [`Cell::average`], for a difference of fewer than two cells,
    /// or a radius that is negative or not finite.
    pub fn joined(name: &str, join: Join, cells: &[&Self], radius: f64) -> Result<Self, CellError> {
        let element = Self::check_one_element(cells)?;
        let forms = cells
            .iter()
            .map(|c| c.unit_form())
            .collect::<Result<Vec<_>, _>>()?;
        let form = match join {
            Join::Union => Form::least(forms, radius)?,
            Join::Intersection => Form::greatest(forms, radius)?,
            Join::Difference => {
                let (first, rest) = forms.split_at(1);
                if rest.is_empty() {
                    return Err(CellError::Expression(
                        "a difference of one cell; expected at least two".to_owned(),
                    ));
                }
                let mut all = first.to_vec();
                all.extend(rest.iter().map(Form::negated));
                Form::greatest(all, radius)?
            }
        };
        Self::new(name, element, form)
    }
}
