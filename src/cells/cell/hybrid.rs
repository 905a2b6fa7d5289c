//! Hybrid cells: combinations of cells of one element.
//!
//! Each operand enters as its solid's function (with level and side) divided by gamma, the root mean
//! square of its gradient on its surface. Near the surface that is a distance in reference units, so that
//! no operand dominates and a radius is a length.

use super::{Cell, CellError, Expression, Solid};

/// Boolean operation on solids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Join {
    /// The points in any of the solids.
    Union,
    /// The points in all of the solids.
    Intersection,
    /// The points in the first solid and in none of the others.
    Difference,
}

impl Cell {
    /// The function whose values below 0 are the cell's solid.
    /// It has the level and the side in it, and the unit of the cell's field.
    pub fn solid_expression(&self) -> Expression {
        match self.solid {
            Solid::Below => self.expression.shifted(self.level),
            Solid::Above => self.expression.shifted(self.level).negated(),
            Solid::Sheet => self.expression.magnitude().shifted(self.level),
            Solid::Channels => self.expression.magnitude().shifted(self.level).negated(),
        }
    }

    /// The solid's function, scaled so that the root mean square of its gradient on the surface is 1: near the surface
    /// about the distance in reference lengths, negative in the solid.
    ///
    /// # Errors
    /// [`CellError::Expression`] unless [`Self::gamma`] is above 1e-18 and finite, and for too many nodes.
    pub fn unit_expression(&self) -> Result<Expression, CellError> {
        let gamma = self.gamma();
        if !(gamma.is_finite() && gamma > 0.0) {
            return Err(CellError::Expression(format!(
                "cell {:?} has the mean slope {gamma} on its surface; expected a positive number (has \
                 it a surface?)",
                self.name
            )));
        }
        Expression::sum(vec![(gamma.recip(), self.solid_expression())])
    }

    /// The element that all cells share.
    /// An error for no cells, and for two elements, which names the first pair.
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

    /// The weighted average of cells of one element, each divided by its gamma. It interpolates between
    /// them. Band limits and lattices may differ.
    /// The result is a new cell with level 0 and the solid below it. Weights are divided by their sum.
    ///
    /// # Errors
    /// [`CellError::Expression`] for no cells, several elements, weights that are negative, not finite, or all
    /// 0, and as of [`Self::unit_expression`] and [`Self::new`].
    pub fn average(name: &str, parts: &[(f64, &Self)]) -> Result<Self, CellError> {
        let cells: Vec<&Self> = parts.iter().map(|p| p.1).collect();
        let element = Self::check_one_element(&cells)?;
        let total: f64 = parts.iter().map(|p| p.0).sum();
        let bad = parts.iter().find(|p| !(p.0.is_finite() && p.0 >= 0.0));
        if bad.is_some() || !(total.is_finite() && total > 0.0) {
            let weights: Vec<f64> = parts.iter().map(|p| p.0).collect();
            return Err(CellError::Expression(format!(
                "the weights are {weights:?}; expected non-negative numbers with a positive sum"
            )));
        }
        let expressions = parts
            .iter()
            .map(|(w, cell)| Ok((w / total, cell.unit_expression()?)))
            .collect::<Result<Vec<_>, CellError>>()?;
        Self::new(name, element, Expression::sum(expressions)?)
    }

    /// The union, intersection or difference of the solids of cells of one element, each divided by its
    /// gamma. Edges where two surfaces meet are rounded with `radius`, approximately a length in reference
    /// units; 0 keeps them sharp.
    /// The result is a new cell with level 0 and the solid below it.
    ///
    /// # Errors
    /// [`CellError::Expression`] as of [`Cell::average`], for a difference of fewer than two cells,
    /// or a radius that is negative or not finite.
    pub fn joined(name: &str, join: Join, cells: &[&Self], radius: f64) -> Result<Self, CellError> {
        let element = Self::check_one_element(cells)?;
        let expressions = cells
            .iter()
            .map(|c| c.unit_expression())
            .collect::<Result<Vec<_>, _>>()?;
        let expression = match join {
            Join::Union => Expression::min(expressions, radius)?,
            Join::Intersection => Expression::max(expressions, radius)?,
            Join::Difference => {
                let (first, rest) = expressions.split_at(1);
                if rest.is_empty() {
                    return Err(CellError::Expression(
                        "a difference of one cell; expected at least two".to_owned(),
                    ));
                }
                let mut all = first.to_vec();
                all.extend(rest.iter().map(Expression::negated));
                Expression::max(all, radius)?
            }
        };
        Self::new(name, element, expression)
    }
}
