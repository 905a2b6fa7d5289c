//! Figures of a finished cell on a grid: properties of wholly solid or void voxels, openings, widths, connectedness.
//!
//! Shares of solid in wide interfaces overestimate moduli; sharp voxels keep all bounds.

use super::InverseError;
use super::objective::Effective;
use super::problem::is_connected;
use super::tube::Way;
use crate::homogenize::{
    Grid, Packing, Period, Properties, Settings, cubic_means, opening, properties, sharpened, width,
};
use druse_cells::cell::{Cell, DesignProperties, Solid};
use druse_geometry::field::Field;
use druse_geometry::frame::Element;
use druse_geometry::progress::{CancelOnly, Progress};
use rayon::prelude::*;

/// Samples along each edge of a voxel: it is solid where half of them or more are.
const FINENESS: usize = 2;
/// Nodes along the period are a multiple of this: throats of common surfaces lie at multiples of an eighth.
const NODE_MULTIPLE: usize = 8;
/// Most nodes along the period: distances of throats err by a thousandth of the period there.
const MAX_NODES: usize = 128;
/// Nodes along the period for widths, beside the voxels.
const WIDTH_NODES: usize = 24;
/// Most nodes for widths: four across a wall of 0.05.
const MAX_WIDTH_NODES: usize = 80;

/// Properties on a grid, of sharp voxels.
///
/// # Errors
/// [`InverseError::Homogenize`]: of [`Period::of_cell`], the grid, the band or the solver, or the user stopped it.
pub fn properties_of(
    cell: &Cell,
    n: usize,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<DesignProperties, InverseError> {
    Ok(figures(cell, n, settings, progress)?.0)
}

/// As [`properties_of`], with the tensors.
///
/// # Errors
/// As [`properties_of`].
pub(super) fn figures(
    cell: &Cell,
    n: usize,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(DesignProperties, Effective), InverseError> {
    let period = Period::of_cell(cell.clone(), Packing::Bcc)?;
    let samples = period.samples(n, FINENESS, progress)?;
    let shares = sharpened(&samples.shares());
    let found = properties(samples.grid(), &shares, settings, &CancelOnly(progress))?;
    let mut own = summary(&found);
    own.opening = Some(ways(cell, n)?.0);
    let tensors = Effective {
        stiffness: found.stiffness.unwrap_or_default(),
        conductivity: found.conductivity.unwrap_or_default(),
        permeability: own.permeability.unwrap_or(0.0),
    };
    Ok((own, tensors))
}

/// The opening of a cell's void, a radius in reference lengths, of a sheet the lesser of its two sides, and the ways of
/// the greatest balls, on at least `n` nodes along the period, and at most 128.
///
/// # Errors
/// [`InverseError`] of a cell without a period, see [`Period::of_cell`].
pub fn ways(cell: &Cell, n: usize) -> Result<(f64, Vec<Way>), InverseError> {
    let n = n.next_multiple_of(NODE_MULTIPLE).min(MAX_NODES);
    let (field, level, is_sheet) = (sampled(cell, n)?, cell.level(), cell.solid().is_symmetric());
    let mut least = f64::INFINITY;
    let mut all = Vec::new();
    for side in void_sides(cell.solid()) {
        // The void of a network above its level is that of minus the field below it.
        let edge = if is_sheet { level } else { side * level };
        let depths: Vec<f64> = field.iter().map(|phi| side * phi - edge).collect();
        let found = opening(n, &depths, |v| !is_sheet || side * field[v] > 0.0);
        least = least.min(found.radius);
        all.push(Way {
            side: *side,
            path: found.path,
            step: 1.0 / n as f64,
        });
    }
    Ok((least / scale(cell.element()), all))
}

/// The least widths (diameters) of a cell's solid and of its void, of a sheet the lesser of both sides, in reference
/// lengths; on `n + 24` nodes or a few more along the period, and at most 80.
///
/// # Errors
/// [`InverseError`] of a cell without a period, see [`Period::of_cell`].
pub fn widths(cell: &Cell, n: usize) -> Result<[f64; 2], InverseError> {
    let n = (n + WIDTH_NODES)
        .next_multiple_of(NODE_MULTIPLE)
        .min(MAX_WIDTH_NODES);
    let (field, level, is_sheet) = (sampled(cell, n)?, cell.level(), cell.solid().is_symmetric());
    let sides = void_sides(cell.solid());
    let solid: Vec<f64> = if is_sheet {
        field.iter().map(|phi| level - phi.abs()).collect()
    } else {
        field.iter().map(|phi| sides[0] * (level - phi)).collect()
    };
    let wall = width(n, &solid, &|_| true);
    let gaps = sides.iter().map(|side| {
        let edge = if is_sheet { level } else { side * level };
        let depths: Vec<f64> = field.iter().map(|phi| side * phi - edge).collect();
        width(n, &depths, &|v| !is_sheet || side * field[v] > 0.0)
    });
    let gap = gaps.fold(f64::INFINITY, f64::min);
    Ok([wall, gap].map(|width| width / scale(cell.element())))
}

/// Signs of the field in the voids: 1 above the level, -1 below.
fn void_sides(solid: Solid) -> &'static [f64] {
    match solid {
        Solid::Sheet | Solid::Channels => &[1.0, -1.0],
        Solid::Below => &[1.0],
        Solid::Above => &[-1.0],
    }
}

/// The field at `n` nodes along the period, from -1/2.
fn sampled(cell: &Cell, n: usize) -> Result<Vec<f64>, InverseError> {
    let period = Period::of_cell(cell.clone(), Packing::Bcc)?;
    let value = |v: usize| {
        let at = [v / (n * n), v / n % n, v % n];
        let p = at.map(|j| j as f64 / n as f64 - 0.5);
        cell.expression().value(period.reference(p.into()))
    };
    Ok((0..n * n * n).into_par_iter().map(value).collect())
}

/// Lengths in the period over those of the reference element: of twelve tets, whose longest edges are its own, the
/// greatest factor, so that no wall or gap of a regular tet is narrower than stated.
pub(super) fn scale(element: Element) -> f64 {
    1.0 / element.edge()
}

fn summary(found: &Properties) -> DesignProperties {
    let mean = |k: &[[f64; 3]; 3]| (k[0][0] + k[1][1] + k[2][2]) / 3.0;
    let mut own = DesignProperties {
        voxels: found.voxels[0],
        volume_fraction: found.volume_fraction,
        conductivity: found.conductivity.as_ref().map_or(0.0, mean),
        permeability: found.permeability.as_ref().map(mean),
        bulk_over_bound: found.over_bounds.bulk.unwrap_or(0.0),
        shear_over_bound: found.over_bounds.shear.unwrap_or(0.0),
        conductivity_over_bound: found.over_bounds.conductivity.unwrap_or(0.0),
        ..DesignProperties::default()
    };
    if let Some(c) = &found.stiffness {
        let [c11, c12, c44] = cubic_means(c);
        own.c44 = c44;
        own.poisson = c12 / (c11 + c12);
        own.bulk = (c11 + 2.0 * c12) / 3.0;
    }
    if let Some(e) = &found.engineering {
        own.shear = e.shear_reuss;
        own.zener = e.zener;
        own.young = e.young.iter().sum::<f64>() / 3.0;
    }
    own
}

/// Refuses a cell whose sharp voxels are not connected on a grid.
///
/// # Errors
/// [`InverseError::Disconnected`], those of [`Period::of_cell`] and of the grid, or the user stopped it.
pub fn check_connected(cell: &Cell, n: usize, progress: &dyn Progress) -> Result<(), InverseError> {
    let (grid, shares, field) = sharp(cell, n, progress)?;
    is_connected(grid, cell.solid(), &shares, &field).map_err(InverseError::Disconnected)
}

/// Sharp voxels of a cell, and, of a sheet, which has two sides, the values of its function in their middles; else 0.
fn sharp(
    cell: &Cell,
    n: usize,
    progress: &dyn Progress,
) -> Result<(Grid, Vec<f64>, Vec<f64>), InverseError> {
    let period = Period::of_cell(cell.clone(), Packing::Bcc)?;
    let samples = period.samples(n, FINENESS, progress)?;
    let shares = sharpened(&samples.shares());
    let field = if cell.solid().is_symmetric() {
        (0..n * n * n)
            .map(|v| {
                let at = [v / (n * n), v / n % n, v % n];
                let p = at.map(|j| (j as f64 + 0.5) / n as f64 - 0.5);
                cell.expression().value(period.reference(p.into()))
            })
            .collect()
    } else {
        vec![0.0; shares.len()]
    };
    Ok((samples.grid(), shares, field))
}
