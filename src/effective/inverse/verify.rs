//! Figures of a finished cell, by voxels that are wholly solid or void, on two grids.
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

/// Samples along each edge of a voxel, from which it is solid or void.
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
/// [`InverseError`] of the solver, or the user stopped it.
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

/// The opening of a cell's void in reference lengths, of a sheet the lesser of its two sides, and the ways of the
/// greatest balls, on at least `n` nodes along the period, and at most 128.
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

/// The least widths of a cell's solid and of its void, of a sheet the lesser of both sides, in reference lengths; on a
/// grid of nodes that is finer for more voxels `n`.
///
/// # Errors
/// [`InverseError`] of an element without a period.
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

/// Lengths in the period over those of the reference element: a tet of the packing is smaller.
pub(super) fn scale(element: Element) -> f64 {
    if element == Element::Tet {
        Packing::Bcc.shrinkage()
    } else {
        1.0
    }
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

/// Sharp voxels of a cell, and the values of its function in their middles.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inverse::{Design, Property, Target};
    use druse_cells::cell::Surface;
    use druse_geometry::frame::CellPoint;
    use druse_geometry::progress::Silent;

    /// Voxels of the ruler along the period.
    const N: usize = 32;
    /// Share of the wall's voxels that may be narrower: the first percentile, with half of it more for the ruler.
    const MAX_NARROW: f64 = 0.015;

    /// Share of the wall's voxels of a phase that no ball of a diameter in the phase holds.
    fn narrow_share(cell: &Cell, is_solid: bool, diameter: f64) -> f64 {
        let at = |v: usize| [v / (N * N), v / N % N, v % N];
        let value = |v: usize| {
            let p = at(v).map(|j| (j as f64 + 0.5) / N as f64 - 0.5);
            cell.expression().value(CellPoint(p.into()))
        };
        let phase: Vec<bool> = (0..N * N * N)
            .map(|v| (value(v) < cell.level()) == is_solid)
            .collect();
        let radius = 0.5 * diameter * N as f64;
        let reach = radius.floor() as i64;
        let mut ball = Vec::new();
        for m in 0..(2 * reach + 1).pow(3) {
            let side = 2 * reach + 1;
            let off = [m / side / side, m / side % side, m % side].map(|c| c - reach);
            if off.iter().map(|c| (c * c) as f64).sum::<f64>() <= radius * radius {
                ball.push(off);
            }
        }
        let moved = |v: usize, off: [i64; 3]| {
            let from = at(v);
            let [i, j, k] =
                [0, 1, 2].map(|a| (from[a] as i64 + off[a]).rem_euclid(N as i64) as usize);
            (i * N + j) * N + k
        };
        let mut is_held = vec![false; phase.len()];
        for v in 0..phase.len() {
            if phase[v] && ball.iter().all(|off| phase[moved(v, *off)]) {
                for off in &ball {
                    is_held[moved(v, *off)] = true;
                }
            }
        }
        let faces = [
            [1, 0, 0],
            [0, 1, 0],
            [0, 0, 1],
            [-1, 0, 0],
            [0, -1, 0],
            [0, 0, -1],
        ];
        let wall =
            (0..phase.len()).filter(|v| phase[*v] && faces.iter().any(|f| !phase[moved(*v, *f)]));
        let wall: Vec<usize> = wall.collect();
        // Balls of voxels leave out some beside those that they hold.
        let is_near =
            |v: usize| (0..27).any(|m| is_held[moved(v, [m / 9 - 1, m / 3 % 3 - 1, m % 3 - 1])]);
        wall.iter().filter(|v| !is_near(**v)).count() as f64 / wall.len() as f64
    }

    fn bulk() -> Target {
        Target {
            maximise: Some(Property::Bulk),
            ..Target::default()
        }
    }

    fn designed(min_feature: Option<f64>, fraction: f64) -> Result<Cell, InverseError> {
        let design = Design {
            min_feature,
            starts: 1,
            band_limit: 3.0,
            voxels: 12,
            evaluations: 20,
            ..Design::new("wide", Element::Hex, bulk(), fraction)
        };
        Ok(design.prepare()?.search(None, &Silent)?.cell)
    }

    #[test]
    #[ignore = "long; tests/run full"]
    fn a_design_has_the_width_that_it_reports() {
        let least = |cell: &Cell, n: usize| {
            let own = &cell.report().unwrap().design.as_ref().unwrap().properties[n];
            own.least_wall.unwrap().min(own.least_gap.unwrap())
        };
        // Near what the cell has without the request.
        let [wall, gap] = widths(&designed(None, 0.3).unwrap(), 24).unwrap();
        let wanted = 0.9 * wall.min(gap);
        let cell = designed(Some(wanted), 0.3).unwrap();
        let (fine, coarse) = (least(&cell, 0), least(&cell, 1));
        assert!(
            fine >= wanted && coarse > 0.95 * wanted,
            "{wanted} {fine} {coarse}"
        );
        let voxel = 1.0 / N as f64;
        let shares = [true, false].map(|s| narrow_share(&cell, s, wanted - 2.0 * voxel));
        assert!(
            shares.iter().all(|s| *s < MAX_NARROW),
            "{wanted} {shares:?}"
        );
    }

    #[test]
    #[ignore = "long; tests/run full"]
    fn widths_of_named_surfaces_are_those_of_inscribed_balls() {
        for surface in [Surface::SchwarzP, Surface::Gyroid, Surface::Iwp] {
            let cell = surface.cell(Element::Hex).unwrap();
            let cell = cell.with_solid(Solid::Below, 0.1).unwrap();
            let level = cell.level_for_volume_fraction(0.35).unwrap();
            let cell = cell.with_solid(Solid::Below, level).unwrap();
            let found = widths(&cell, 40).unwrap();
            for (is_solid, width) in [(true, found[0]), (false, found[1])] {
                let voxel = 1.0 / N as f64;
                let share = narrow_share(&cell, is_solid, width - 2.0 * voxel);
                assert!(share < MAX_NARROW, "{surface:?} {is_solid} {width} {share}");
            }
        }
    }

    #[test]
    #[ignore = "long; tests/run full"]
    fn widths_that_no_cell_has_name_the_nearest() {
        let e = designed(Some(0.45), 0.3).err().unwrap();
        assert!(matches!(e, InverseError::Infeasible { .. }), "{e}");
        let message = e.to_string();
        assert!(
            message.contains("the nearest has min_feature 0."),
            "{message}"
        );
        assert!(
            message.contains("where 0.45 was wanted; expected at most 0."),
            "{message}"
        );
    }
}
