//! Least widths of walls and gaps: named surfaces and designs against brute force, widths that no cell has.

use super::{largest, short};
use druse::cell::{Cell, Solid, Surface};
use druse::field::Field;
use druse::frame::{CellPoint, Element};
use druse::inverse::{Design, InverseError, Property, StartChoice, widths};
use druse::progress::Silent;

/// Voxels of the ruler along the period.
const N: usize = 32;
/// Share of the wall's voxels that may be narrower: the first percentile, with half of it more for the ruler.
const MAX_NARROW: f64 = 0.015;

/// Share of the wall's voxels of a phase that no ball of a diameter in the phase holds, on `n`^3 voxels.
fn narrow_share(n: usize, cell: &Cell, is_solid: bool, diameter: f64) -> f64 {
    let at = |v: usize| [v / (n * n), v / n % n, v % n];
    let value = |v: usize| {
        let p = at(v).map(|j| (j as f64 + 0.5) / n as f64 - 0.5);
        cell.expression().value(CellPoint(p.into()))
    };
    let phase: Vec<bool> = (0..n * n * n)
        .map(|v| (value(v) < cell.level()) == is_solid)
        .collect();
    let radius = 0.5 * diameter * n as f64;
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
        let [i, j, k] = [0, 1, 2].map(|a| (from[a] as i64 + off[a]).rem_euclid(n as i64) as usize);
        (i * n + j) * n + k
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

fn designed(min_feature: Option<f64>, fraction: f64) -> Result<Cell, InverseError> {
    let design = Design {
        min_feature,
        starts: 1,
        ..short(largest(Property::Bulk), fraction)
    };
    Ok(design.prepare()?.search(None, &Silent)?.cell)
}

#[test]
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
    let shares = [true, false].map(|s| narrow_share(N, &cell, s, wanted - 2.0 * voxel));
    assert!(
        shares.iter().all(|s| *s < MAX_NARROW),
        "{wanted} {shares:?}"
    );
}

#[test]
fn a_width_is_met_that_the_free_design_misses() {
    let design = |min_feature| Design {
        min_feature,
        start: StartChoice::Random,
        seed: 3,
        starts: 1,
        ..short(largest(Property::Bulk), 0.3)
    };
    let made = |d: Design| d.prepare().unwrap().search(None, &Silent).unwrap().cell;
    let free = made(design(None));
    let [wall, gap] = widths(&free, 24).unwrap();
    let wanted = 1.5 * wall.min(gap);
    let cell = made(design(Some(wanted)));
    let diameter = wanted - 1.0 / N as f64;
    let shares = |cell| [true, false].map(|s| narrow_share(2 * N, cell, s, diameter));
    let (free, own) = (shares(&free), shares(&cell));
    assert!(
        free.iter().any(|s| *s > MAX_NARROW) && own.iter().all(|s| *s < MAX_NARROW),
        "{wall} {gap} {wanted} {free:?} {own:?}"
    );
}

#[test]
fn widths_of_named_surfaces_are_those_of_inscribed_balls() {
    for surface in [Surface::SchwarzP, Surface::Gyroid, Surface::Iwp] {
        let cell = surface.cell(Element::Hex).unwrap();
        let cell = cell.with_solid(Solid::Below, 0.1).unwrap();
        let level = cell.level_for_volume_fraction(0.35).unwrap();
        let cell = cell.with_solid(Solid::Below, level).unwrap();
        let found = widths(&cell, 40).unwrap();
        for (is_solid, width) in [(true, found[0]), (false, found[1])] {
            let voxel = 1.0 / N as f64;
            let share = narrow_share(N, &cell, is_solid, width - 2.0 * voxel);
            assert!(share < MAX_NARROW, "{surface:?} {is_solid} {width} {share}");
        }
    }
}

#[test]
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
