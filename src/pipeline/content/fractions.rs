//! Volume fractions of a part whose elements may be curved or distorted.
//!
//! A density here is a weight over a cell's reference element, and no mass.
//!
//! A cell's fraction is that of its reference element. An element that is not affine stretches some of
//! the cell more than the rest. The determinants of all elements of a shape, summed, are the density
//! that weights the cell's volume. Where all elements of a shape are affine the density is constant and
//! left out.

use super::tiling::{CellTiling, Content};
use crate::cell::{Cell, Density};
use crate::frame::{CellPoint, Element};
use crate::pipeline::base::error::RunError;
use crate::pipeline::inputs::run_cache::RunCache;
use crate::scaffold::Scaffold;
use rayon::prelude::*;
use std::convert::Infallible;

/// Greatest number of elements that a density is summed over, all at each of its points; of more every n-th counts.
const MAX_ELEMENTS: usize = 3000;
/// Greatest number of secant steps to the common level shift of several cells.
const MAX_STEPS: usize = 30;

/// Whether a cell fills elements of a shape.
fn fills(cell: &Cell, shape: Element) -> bool {
    cell.element() == shape || crate::tiling::fills(cell.element(), shape)
}

/// The density of the elements that a cell fills, kept by an earlier run in `cache` or new; `None` if all of them
/// are affine.
pub(crate) fn density(
    scaffold: &Scaffold,
    cell: &Cell,
    cache: Option<&RunCache>,
) -> Option<Density> {
    let Some(cache) = cache else {
        return new_density(scaffold, cell);
    };
    let place = format!("{} {:?}", cell.name(), cell.element());
    let make = || Ok::<_, Infallible>(new_density(scaffold, cell));
    let Ok(found) = cache
        .densities
        .get_or_make(place, density_key(scaffold, cell), make);
    found
}

/// All that a density depends on: the nodes, the elements, and the cell's symmetry.
fn density_key(scaffold: &Scaffold, cell: &Cell) -> String {
    let mut hasher = blake3::Hasher::new();
    for node in scaffold.nodes() {
        for c in node.iter() {
            hasher.update(&c.to_le_bytes());
        }
    }
    for element in (0..scaffold.len()).map(|e| scaffold.element(e)) {
        hasher.update(element.kind().name().as_bytes());
        for node in element.nodes() {
            hasher.update(&node.to_le_bytes());
        }
    }
    let symmetry = (cell.element(), cell.operators());
    format!("{} {symmetry:?}", hasher.finalize().to_hex())
}

/// The sum of |det J| over the elements that a cell fills, as a function of reference coordinates; `None` if all
/// are affine.
fn new_density(scaffold: &Scaffold, cell: &Cell) -> Option<Density> {
    let elements: Vec<usize> = (0..scaffold.len())
        .filter(|&e| fills(cell, scaffold.element(e).shape()))
        .collect();
    if elements.iter().all(|&e| scaffold.element(e).is_affine()) {
        return None;
    }
    let step = elements.len().div_ceil(MAX_ELEMENTS);
    let elements: Vec<usize> = elements.into_iter().step_by(step).collect();
    Some(cell.density(&|p: CellPoint<3>| {
        elements
            .iter()
            .map(|&e| scaffold.element(e).jacobian(p).determinant().abs())
            .sum()
    }))
}

/// The volume fraction of a tiling by one cell: at the tiling's level where `[tiling]` sets a fraction.
/// `None` for several cells, for sheets, whose cell is one side of the mid-surface, and for beams without one.
pub(crate) fn cell_fraction(tiling: &CellTiling) -> Option<f64> {
    let [entry] = &tiling.palette[..] else {
        return None;
    };
    if matches!(tiling.content(), Content::Sheets(_)) {
        return None;
    }
    if tiling.target_fraction.is_some() || entry.cells.is_empty() {
        return tiling.target_fraction;
    }
    let volumes = volumes(&tiling.loaded.scaffold, &entry.cells);
    let total: f64 = volumes.iter().sum();
    let own = entry.cells.iter().zip(&entry.densities).zip(volumes);
    let shares =
        own.map(|((cell, density), volume)| fraction(cell, density.as_ref()) * volume / total);
    Some(shares.sum())
}

/// The volume fraction of a cell, 0 to 1, weighted by the density of its elements where they are not affine.
fn fraction(cell: &Cell, density: Option<&Density>) -> f64 {
    density.map_or_else(
        || cell.volume_fraction(),
        |d| cell.weighted_volume_fraction(d),
    )
}

/// Total volume of the elements that each cell fills.
fn volumes(scaffold: &Scaffold, cells: &[Cell]) -> Vec<f64> {
    let volume_of = |cell: &Cell| -> f64 {
        let all: Vec<f64> = (0..scaffold.len())
            .into_par_iter()
            .filter(|&e| fills(cell, scaffold.element(e).shape()))
            .map(|e| scaffold.element(e).volume().abs())
            .collect();
        all.iter().sum()
    };
    cells.iter().map(volume_of).collect()
}

/// Cells of one field with a common level shift at which together they fill the target share of their elements.
/// `densities` belong to `cells` one by one. If no shift within `MAX_STEPS` meets the target to 1e-6, the best one
/// is taken.
pub(crate) fn with_common_shift(
    scaffold: &Scaffold,
    cells: &[Cell],
    densities: &[Option<Density>],
    target: f64,
) -> Result<Vec<Cell>, crate::cell::CellError> {
    let volumes = volumes(scaffold, cells);
    let total: f64 = volumes.iter().sum();
    let at = |shift: f64| {
        let moved = |c: &Cell| c.clone().with_solid(c.solid(), c.level() + shift);
        cells.iter().map(moved).collect::<Result<Vec<Cell>, _>>()
    };
    let share = |cells: &[Cell]| -> f64 {
        let own = cells.iter().zip(densities).zip(&volumes);
        own.map(|((c, d), v)| fraction(c, d.as_ref()) * v / total)
            .sum()
    };
    // A secant search on the last two shifts, each with its error. Fields are in edge lengths, so that 1e-3 is a
    // small first step.
    let mut last = (0.0, share(cells) - target);
    let mut next = 1e-3;
    let mut best = (last.1.abs(), 0.0);
    for _ in 0..MAX_STEPS {
        if best.0 <= 1e-6 {
            break;
        }
        let Ok(shifted) = at(next) else { break };
        let error = share(&shifted) - target;
        if error.abs() < best.0 {
            best = (error.abs(), next);
        }
        let slope = (error - last.1) / (next - last.0);
        last = (next, error);
        next -= error / slope;
        if !next.is_finite() {
            break;
        }
    }
    at(best.1)
}

/// The cell at the level at which it fills the target share of its elements. Without a density the cell has that
/// level already and is returned as it is. `key` names the cell in errors.
pub(crate) fn at_fraction(
    cell: Cell,
    density: Option<&Density>,
    target: f64,
    key: &str,
) -> Result<Cell, RunError> {
    let Some(density) = density else {
        return Ok(cell);
    };
    let level = cell.level_for_weighted_volume_fraction(target, density);
    let solid = cell.solid();
    level
        .and_then(|level| cell.with_solid(solid, level))
        .map_err(|e| RunError::Cell {
            key: key.to_owned(),
            fault: e.into(),
        })
}
