//! From coefficients to a cell with the volume fraction of the design.

use super::InverseError;
use super::design::Prepared;
use super::space::Space;
use druse_cells::cell::{Cell, Series};

/// First step of the search for a matched cell's level, periods.
const FIRST_STEP: f64 = 1e-3;
const MAX_SECANT_STEPS: usize = 30;
/// Difference of volume fractions at which the search ends; beyond the most steps the last level is taken as it is.
const FRACTION_TOLERANCE: f64 = 1e-7;

impl Prepared {
    /// The cell of coefficients near a level, with the volume fraction of the design.
    pub(super) fn cell(
        &self,
        coefficients: &[f64],
        level: f64,
        space: &Space,
    ) -> Result<Cell, InverseError> {
        let design = &self.design;
        if space.is_matched() {
            return self.matched_cell(coefficients, level, space);
        }
        let cell = self.cell_of(coefficients)?;
        // A sheet of level 0 or less is refused, and the level is found anew.
        let guess = if design.solid.is_symmetric() {
            level.max(f64::MIN_POSITIVE)
        } else {
            level
        };
        let cell = cell.with_solid(design.solid, guess)?;
        let level = cell.level_for_volume_fraction(design.volume_fraction)?;
        Ok(cell.with_solid(design.solid, level)?)
    }

    /// The cell of a matched space, by the secant method: the level multiplies a function that vanishes on the faces.
    fn matched_cell(
        &self,
        coefficients: &[f64],
        level: f64,
        space: &Space,
    ) -> Result<Cell, InverseError> {
        let at = |level: f64| {
            let moved = coefficients.iter().zip(space.direction());
            let all: Vec<f64> = moved.map(|(a, d)| a - level * d).collect();
            self.cell_of(&all)
        };
        let excess = |cell: &Cell| cell.volume_fraction() - self.design.volume_fraction;
        let (slope, _) = self.sampled(self.design.voxels)?.mean_slope(coefficients);
        let (mut before, mut level) = (level, level + FIRST_STEP * slope);
        let mut last = excess(&at(before)?);
        for _ in 0..MAX_SECANT_STEPS {
            let own = excess(&at(level)?);
            if own.abs() < FRACTION_TOLERANCE || own == last {
                break;
            }
            let next = level - own * (level - before) / (own - last);
            (before, level, last) = (level, next, own);
        }
        at(level)
    }

    /// The cell of coefficients at level 0.
    fn cell_of(&self, coefficients: &[f64]) -> Result<Cell, InverseError> {
        let (group, lattice) = (self.basis.group().clone(), self.basis.lattice().clone());
        let series = Series::new(group, lattice, &self.basis.coefficients(coefficients))?;
        Ok(Cell::new(&self.design.name, self.design.element, series)?)
    }
}
