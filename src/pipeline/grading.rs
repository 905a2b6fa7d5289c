//! Gradings: from a level, volume fraction or thickness asked for to shifts of a cell's field.

use super::error::RunError;
use super::palette::Entry;
use crate::field::Field;
use crate::frame::{CellPoint, Element, Vec3};
use crate::scaffold::Scaffold;
use crate::tiling::CellField;

/// Levels tabulated over a graded quantity.
const GRADES: usize = 9;

/// World length per reference length of a shape at every node: the mean of the elements around it.
pub(super) fn scales(scaffold: &Scaffold, shape: Element) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); scaffold.nodes().len()];
    for e in scaffold.elements() {
        let scale =
            libm::cbrt(e.volume().abs() / e.shape().measure()) * e.shape().edge() / shape.edge();
        for &n in e.nodes() {
            let s = &mut sums[n as usize];
            *s = (s.0 + scale, s.1 + 1.0);
        }
    }
    let mean = |(sum, count): (f64, f64)| if count > 0.0 { sum / count } else { 1.0 };
    sums.into_iter().map(mean).collect()
}

/// A value of a graded quantity, and what gives it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grade {
    /// What is asked for.
    pub asked: f64,
    /// What the nearest level gives, where no level gives what is asked for.
    pub nearest: Option<f64>,
    /// The shift of the normalised field.
    pub shift: f64,
}

/// Shifts of the normalised field that give a cell the level asked for, over the quantity's range.
pub(super) fn shifts(
    entry: &Entry,
    key: &str,
    (low, high): (f64, f64),
) -> Result<Vec<Grade>, RunError> {
    let cell = &entry.cells[0];
    let fault = |e: crate::cell::CellError| RunError::Cell {
        key: format!("{key} of cell.{}", entry.name),
        fault: e.into(),
    };
    let steps = if high - low > 1e-9 * high.abs().max(1e-9) {
        GRADES
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
            "tiling.volume_fraction" => match &entry.densities[0] {
                Some(density) => cell.level_for_volume_fraction_by(at, density),
                None => cell.level_for_volume_fraction(at),
            }
            .map_err(fault)?,
            _ => {
                let found = cell.nearest_level_for_thickness(at).map_err(fault)?;
                nearest = (!found.meets(at)).then_some(found.thickness);
                found.level
            }
        };
        let other = cell
            .clone()
            .with_solid(cell.solid(), level)
            .map_err(fault)?;
        // Off the middle of a sheet, where its field has a kink.
        let p = CellPoint(Vec3::new(0.13, 0.07, -0.05));
        let shift = Field::value(cell, p) - Field::value(&other, p);
        found.push(Grade {
            asked: at,
            nearest,
            shift: shift / CellField::gradient_rms(&entry.tables[0]),
        });
    }
    Ok(found)
}

/// The mean over the scaffold's volume of values at its nodes, taken as the mean over each element's.
pub(super) fn mean(scaffold: &Scaffold, values: &[f64]) -> f64 {
    let (mut sum, mut volume) = (0.0, 0.0);
    for e in scaffold.elements() {
        let corners = &e.nodes()[..e.kind().corner_count()];
        let own: f64 = corners.iter().map(|&n| values[n as usize]).sum();
        sum += e.volume().abs() * own / corners.len() as f64;
        volume += e.volume().abs();
    }
    sum / volume
}

/// The grade nearest to a value.
pub(super) fn nearest(grades: &[Grade], v: f64) -> Option<&Grade> {
    let distance = |g: &Grade| (g.asked - v).abs();
    grades
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// The shift for a value, linear between grades.
pub(super) fn interpolated(grades: &[Grade], v: f64) -> f64 {
    let pairs: Vec<[f64; 2]> = grades.iter().map(|g| [g.asked, g.shift]).collect();
    super::spatial_value::mapped(&pairs, v)
}
