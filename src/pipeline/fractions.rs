//! Volume fractions of a part, whose elements may be curved or distorted.
//!
//! A cell's fraction is that of its reference element. Elements that are not affine stretch some of the
//! cell more than the rest: their determinants, summed over the elements of a shape, are the density by which
//! its volumes count. Where all elements of a shape are affine it is the same everywhere and left out.

use super::error::RunError;
use super::tiling::Fill;
use crate::cell::{Cell, Density};
use crate::frame::{CellPoint, Element};
use crate::scaffold::Scaffold;
use rayon::prelude::*;

/// Elements that a density is summed over at most; beyond, every n-th one.
const MOST_ELEMENTS: usize = 3000;
/// Steps that bring a common shift of several cells to the fraction asked for.
const STEPS: usize = 30;

/// Whether a cell fills elements of a shape.
fn fills(cell: &Cell, shape: Element) -> bool {
    cell.element() == shape || crate::tiling::fills(cell.element(), shape)
}

/// How the elements that a cell fills stretch it; `None` if all of them are affine.
pub(super) fn density(scaffold: &Scaffold, cell: &Cell) -> Option<Density> {
    let own: Vec<usize> = (0..scaffold.len())
        .filter(|&e| fills(cell, scaffold.element(e).shape()))
        .collect();
    if own.iter().all(|&e| scaffold.element(e).is_affine()) {
        return None;
    }
    let step = own.len().div_ceil(MOST_ELEMENTS);
    let own: Vec<usize> = own.into_iter().step_by(step).collect();
    Some(cell.density(&|p: CellPoint<3>| {
        own.iter()
            .map(|&e| scaffold.element(e).jacobian(p).determinant().abs())
            .sum()
    }))
}

/// The share of its elements that the one cell of a palette fills, at the level of the tiling where that
/// asks for a share; `None` of several cells, and of sheets, whose cell is the side of the mid-surface.
pub(super) fn of_cell(fill: &Fill) -> Option<f64> {
    let [entry] = &fill.palette[..] else {
        return None;
    };
    if fill.sheets().is_some() {
        return None;
    }
    if fill.fraction_asked.is_some() || entry.cells.is_empty() {
        return fill.fraction_asked;
    }
    let volumes = volumes(&fill.loaded.scaffold, &entry.cells);
    let total: f64 = volumes.iter().sum();
    let own = entry.cells.iter().zip(&entry.densities).zip(volumes);
    let shares =
        own.map(|((cell, density), volume)| fraction(cell, density.as_ref()) * volume / total);
    Some(shares.sum())
}

fn fraction(cell: &Cell, density: Option<&Density>) -> f64 {
    density.map_or_else(|| cell.volume_fraction(), |d| cell.volume_fraction_by(d))
}

/// Volumes of the elements that each cell fills.
fn volumes(scaffold: &Scaffold, cells: &[Cell]) -> Vec<f64> {
    let of = |cell: &Cell| -> f64 {
        let all: Vec<f64> = (0..scaffold.len())
            .into_par_iter()
            .filter(|&e| fills(cell, scaffold.element(e).shape()))
            .map(|e| scaffold.element(e).volume().abs())
            .collect();
        all.iter().sum()
    };
    cells.iter().map(of).collect()
}

/// Cells of one field, whose levels are shifted alike so that together they fill a share of their elements.
pub(super) fn shifted(
    scaffold: &Scaffold,
    cells: &[Cell],
    densities: &[Option<Density>],
    asked: f64,
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
    // Regula falsi between the last two shifts; fields are in edge lengths.
    let mut last = (0.0, share(cells) - asked);
    let mut next = 1e-3;
    let mut best = (last.1.abs(), 0.0);
    for _ in 0..STEPS {
        if best.0 <= 1e-6 {
            break;
        }
        let Ok(tried) = at(next) else { break };
        let off = share(&tried) - asked;
        if off.abs() < best.0 {
            best = (off.abs(), next);
        }
        let slope = (off - last.1) / (next - last.0);
        last = (next, off);
        next -= off / slope;
        if !next.is_finite() {
            break;
        }
    }
    at(best.1)
}

/// The cell at the level at which it fills a share of its elements.
pub(super) fn levelled(
    cell: Cell,
    density: Option<&Density>,
    asked: f64,
    key: &str,
) -> Result<Cell, RunError> {
    let Some(density) = density else {
        return Ok(cell);
    };
    let level = cell.level_for_volume_fraction_by(asked, density);
    let solid = cell.solid();
    level
        .and_then(|level| cell.with_solid(solid, level))
        .map_err(|e| RunError::Cell {
            key: key.to_owned(),
            fault: e.into(),
        })
}
