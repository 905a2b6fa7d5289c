//! Gradings: level shifts of a cell's field for a target level, volume fraction or thickness.

use super::error::RunError;
use super::palette::PaletteCell;
use crate::field::Field;
use crate::frame::{CellPoint, Element, Vec3};
use crate::scaffold::Scaffold;
use crate::tiling::CellField;

/// Number of grades that tabulate the range of a quantity.
const GRADE_COUNT: usize = 9;

/// World length per reference length of a shape at every node: the mean over the elements around it.
pub(super) fn node_scales(scaffold: &Scaffold, shape: Element) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); scaffold.nodes().len()];
    for e in scaffold.elements() {
        let scale =
            libm::cbrt(e.volume().abs() / e.shape().measure()) * e.shape().edge() / shape.edge();
        for &n in e.nodes() {
            let s = &mut sums[n as usize];
            *s = (s.0 + scale, s.1 + 1.0);
        }
    }
    let average = |(sum, count): (f64, f64)| if count > 0.0 { sum / count } else { 1.0 };
    sums.into_iter().map(average).collect()
}

/// A value of a graded quantity and the shift that gives it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grade {
    /// The target value.
    pub target: f64,
    /// The nearest value that a level gives, where no level gives the target.
    pub nearest: Option<f64>,
    /// The shift of the normalised field.
    pub shift: f64,
}

/// Shifts of the normalised field that give a cell the quantity, tabulated over its range.
pub(super) fn grade_shifts(
    palette_cell: &PaletteCell,
    key: &str,
    (low, high): (f64, f64),
) -> Result<Vec<Grade>, RunError> {
    let cell = &palette_cell.cells[0];
    let fault = |e: crate::cell::CellError| RunError::Cell {
        key: format!("{key} of cell.{}", palette_cell.name),
        fault: e.into(),
    };
    let steps = if high - low > 1e-9 * high.abs().max(1e-9) {
        GRADE_COUNT
    } else {
        1
    };
    let mut found = Vec::new();
    for i in 0..steps {
        let t = i as f64 / (steps - 1).max(1) as f64;
        let at = low + (high - low) * t;
        let mut nearest = None;
        let level = match key {
            "tiling.level" => at,
            "tiling.volume_fraction" => match &palette_cell.densities[0] {
                Some(density) => cell.level_for_weighted_volume_fraction(at, density),
                None => cell.level_for_volume_fraction(at),
            }
            .map_err(fault)?,
            _ => {
                let found = cell.nearest_level_for_thickness(at).map_err(fault)?;
                nearest = (!found.meets(at)).then_some(found.thickness);
                found.level
            }
        };
        let shifted_cell = cell
            .clone()
            .with_solid(cell.solid(), level)
            .map_err(fault)?;
        // A point off the mid-surface of a sheet, where the field has a kink.
        let p = CellPoint(Vec3::new(0.13, 0.07, -0.05));
        let shift = Field::value(cell, p) - Field::value(&shifted_cell, p);
        found.push(Grade {
            target: at,
            nearest,
            shift: shift / CellField::gradient_rms(&palette_cell.tables[0]),
        });
    }
    Ok(found)
}

/// The mean over the scaffold's volume of values at its nodes. Each element counts with the mean of its
/// corners.
pub(super) fn volume_mean(scaffold: &Scaffold, values: &[f64]) -> f64 {
    let (mut sum, mut volume) = (0.0, 0.0);
    for e in scaffold.elements() {
        let corners = &e.nodes()[..e.kind().corner_count()];
        let own: f64 = corners.iter().map(|&n| values[n as usize]).sum();
        sum += e.volume().abs() * own / corners.len() as f64;
        volume += e.volume().abs();
    }
    sum / volume
}

/// The grade with the target nearest to a value.
pub(super) fn nearest_grade(grades: &[Grade], v: f64) -> Option<&Grade> {
    let distance = |g: &Grade| (g.target - v).abs();
    grades
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// The shift for a value, by linear interpolation between grades.
pub(super) fn interpolated_shift(grades: &[Grade], v: f64) -> f64 {
    let pairs: Vec<[f64; 2]> = grades.iter().map(|g| [g.target, g.shift]).collect();
    super::spatial_value::mapped(&pairs, v)
}
