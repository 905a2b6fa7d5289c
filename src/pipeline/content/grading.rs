//! Gradings: level shifts of a cell's field for a target level, volume fraction or thickness. A shift is in units
//! of the normalised field, whose gradient has a root mean square of 1 on the surface; it moves the surface by
//! about that many reference lengths. Shifts are tabulated over the range of a quantity and interpolated at nodes.

use super::fractions;
use crate::cell::{Cell, Density, Table};
use crate::field::Field;
use crate::frame::{CellPoint, Element, Vec3};
use crate::pipeline::base::error::RunError;
use crate::scaffold::Scaffold;
use crate::tiling::{CellField, TilingError};

/// Number of grades that tabulate the range of a quantity; each takes a search for its level.
const GRADE_COUNT: usize = 9;

/// World length per reference length of a shape at every node: the mean over the elements around it; 1 at a node
/// without elements.
pub(crate) fn node_scales(scaffold: &Scaffold, shape: Element) -> Vec<f64> {
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
pub(crate) struct Grade {
    /// The target value.
    pub target: f64,
    /// The nearest value that a level gives, where no level gives the target.
    pub nearest: Option<f64>,
    /// The shift of the normalised field.
    pub shift: f64,
}

/// A cell whose level is graded.
#[derive(Clone, Copy)]
pub(crate) struct GradedCell<'a> {
    pub name: &'a str,
    pub cell: &'a Cell,
    /// Density of the elements that the cell fills, unless all are affine.
    pub density: Option<&'a Density>,
    /// Root mean square of the gradient on its surface.
    pub slope: f64,
}

/// A quantity that sets the level of a cell at every node of a scaffold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GradedQuantity {
    /// The level, in units of the cell's field.
    Level,
    /// The solid's share of the element.
    VolumeFraction,
    /// The full local thickness, world units.
    Thickness,
}

/// Shifts of a cell's normalised field at the nodes of a scaffold, as [`crate::tiling::Blend::graded`] expects
/// them, that give the cell the values of a quantity there, as `[tiling]` of a recipe does. `table` is the table
/// of the cell that fills the scaffold.
///
/// # Errors
/// [`RunError::Tiling`] unless there is one value for each node, [`RunError::Cell`] if no level gives a value; a
/// thickness then takes the nearest that one gives.
pub fn level_shifts(
    scaffold: &Scaffold,
    cell: &Cell,
    table: &Table,
    quantity: GradedQuantity,
    mut values: Vec<f64>,
) -> Result<Vec<f64>, RunError> {
    let (found, expected) = (values.len(), scaffold.nodes().len());
    if found != expected {
        let e = TilingError::WeightCount { found, expected };
        return Err(RunError::Tiling(e.to_string()));
    }
    let key = match quantity {
        GradedQuantity::Level => "tiling.level",
        GradedQuantity::VolumeFraction => "tiling.volume_fraction",
        GradedQuantity::Thickness => "tiling.thickness",
    };
    // Thicknesses are tabulated in reference lengths: a world thickness is divided by the local size of the elements.
    if quantity == GradedQuantity::Thickness {
        for (v, s) in values.iter_mut().zip(node_scales(scaffold, cell.element())) {
            *v /= s;
        }
    }
    // Only corners carry a grading: other nodes must not widen the range of the table.
    let is_corner = crate::pipeline::inputs::spatial_value::corner_nodes(scaffold);
    let used = values.iter().zip(&is_corner).filter(|v| *v.1);
    let (low, high) = used.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), (v, _)| {
        (a.min(*v), b.max(*v))
    });
    let density = fractions::density(scaffold, cell, None);
    let graded = GradedCell {
        name: cell.name(),
        cell,
        density: density.as_ref(),
        slope: CellField::gradient_rms(table),
    };
    // A few levels are found over the range, and interpolated for each node.
    let grades = grade_shifts(graded, key, low, high)?;
    let shift = |(v, is_corner): (f64, bool)| {
        if is_corner {
            interpolated_shift(&grades, v)
        } else {
            0.0
        }
    };
    Ok(values.into_iter().zip(is_corner).map(shift).collect())
}

/// Shifts of the normalised field that give a cell the quantity, tabulated at equal steps from `low` to `high`; a
/// thickness is in reference lengths here. `key` is the graded key of the recipe, as in `tiling.level`, and
/// selects the quantity. A single entry where both are equal.
pub(crate) fn grade_shifts(
    graded: GradedCell<'_>,
    key: &str,
    low: f64,
    high: f64,
) -> Result<Vec<Grade>, RunError> {
    let cell = graded.cell;
    let fault = |e: crate::cell::CellError| RunError::Cell {
        key: format!("{key} of cell.{}", graded.name),
        fault: e.into(),
    };
    // Ends count as equal within a relative 1e-9; the inner one keeps the tolerance above 0 for ends of 0.
    let steps = if high - low > 1e-9 * high.abs().max(1e-9) {
        GRADE_COUNT
    } else {
        1
    };
    let targets: Vec<f64> = (0..steps)
        .map(|i| low + (high - low) * (i as f64 / (steps - 1).max(1) as f64))
        .collect();
    // All thicknesses at once: what is measured for one serves the others.
    let of_thickness = match key {
        "tiling.thickness" => cell
            .nearest_levels_for_thicknesses(&targets)
            .map_err(fault)?,
        _ => Vec::new(),
    };
    let mut found = Vec::new();
    for (i, &at) in targets.iter().enumerate() {
        let mut nearest = None;
        let level = match key {
            "tiling.level" => at,
            "tiling.volume_fraction" => match graded.density {
                Some(density) => cell.level_for_weighted_volume_fraction(at, density),
                None => cell.level_for_volume_fraction(at),
            }
            .map_err(fault)?,
            _ => {
                let found = of_thickness[i];
                nearest = (!found.meets(at)).then_some(found.thickness);
                found.level
            }
        };
        let shifted_cell = cell
            .clone()
            .with_solid(cell.solid(), level)
            .map_err(fault)?;
        // Any point serves, as level sets of one field differ by a constant; this one lies off the mid-surface of
        // sheets, where the field has a kink.
        let p = CellPoint(Vec3::new(0.13, 0.07, -0.05));
        // Level and shift differ by the cell's own level and sign; the difference of two fields is the
        // shift, in units of the field.
        let shift = Field::value(cell, p) - Field::value(&shifted_cell, p);
        found.push(Grade {
            target: at,
            nearest,
            shift: shift / graded.slope,
        });
    }
    Ok(found)
}

/// The mean over the scaffold's volume of values at its nodes. Each element counts with the mean of its
/// corners.
pub(crate) fn volume_mean(scaffold: &Scaffold, values: &[f64]) -> f64 {
    let (mut sum, mut volume) = (0.0, 0.0);
    for e in scaffold.elements() {
        let corners = &e.nodes()[..e.kind().corner_count()];
        let corner_sum: f64 = corners.iter().map(|&n| values[n as usize]).sum();
        sum += e.volume().abs() * corner_sum / corners.len() as f64;
        volume += e.volume().abs();
    }
    sum / volume
}

/// The grade with the target nearest to a value; `None` only for an empty table.
pub(crate) fn nearest_grade(grades: &[Grade], v: f64) -> Option<&Grade> {
    let distance = |g: &Grade| (g.target - v).abs();
    grades
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// The shift for a value, by linear interpolation between grades; beyond them that of the nearest.
pub(crate) fn interpolated_shift(grades: &[Grade], v: f64) -> f64 {
    let pairs: Vec<[f64; 2]> = grades.iter().map(|g| [g.target, g.shift]).collect();
    crate::pipeline::inputs::spatial_value::piecewise_linear(&pairs, v)
}
