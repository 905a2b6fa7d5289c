//! Look-ups in a cell's table.

use super::baselines;
use super::clock::{Spread, in_turn};
use super::figure::Found;
use super::w2::walk;
use crate::Setting;
use druse::cell::{Surface, Table};
use druse::frame::Element;
use std::hint::black_box;

const ROUNDS: usize = 7;
/// Greatest error, in reference lengths: makes a table of 128 samples and 5 MiB.
const TOLERANCE: f64 = 1e-6;
/// A hundredth of a voxel where 40 make a cell: the pipeline's tolerance for the same cell.
const DISPLACEMENT: f64 = 0.01 / 40.0;

/// P6 and P18.lookup.
pub fn look_ups(_: &Setting) -> Result<Vec<Found>, Box<dyn std::error::Error>> {
    let cell = Surface::Neovius.cell(Element::Hex)?;
    let table = Table::with_tolerance(&cell, TOLERANCE)?;
    let portable = Table::with_tolerance(&cell, TOLERANCE)?.portable();
    let products = Table::for_displacement(&cell, DISPLACEMENT)?;
    let points = walk();
    let (mut values, mut more) = (vec![0.0; 512], vec![0.0; 512]);
    let (mut slopes, mut others, mut steep) =
        (vec![[0.0; 4]; 512], vec![0.0; 512], vec![[0.0; 4]; 512]);
    let seconds = in_turn(
        ROUNDS,
        &mut [
            &mut || {
                for leaf in points.chunks(512) {
                    table.values(leaf, &mut values);
                    black_box(&values);
                }
            },
            &mut || {
                for leaf in points.chunks(512) {
                    table.values_and_gradients(leaf, &mut slopes);
                    black_box(&slopes);
                }
            },
            &mut || {
                for leaf in points.chunks(512) {
                    portable.values(leaf, &mut more);
                    black_box(&more);
                }
            },
            &mut || {
                for leaf in points.chunks(512) {
                    products.values(leaf, &mut others);
                    black_box(&others);
                }
            },
            &mut || {
                for leaf in points.chunks(512) {
                    products.values_and_gradients(leaf, &mut steep);
                    black_box(&steep);
                }
            },
            &mut baselines::fuse,
        ],
    );
    let each = |s: &[f64]| -> Vec<f64> {
        let each = s.iter().map(|s| s * 1e9 / points.len() as f64);
        each.collect()
    };
    let size = format!(
        "; {} samples, {:.1} MiB",
        table.samples(),
        table.bytes() as f64 / 1048576.0
    );
    let figure =
        |key, s: &[f64], note: &str| baselines::at_reference(key, &each(s), &seconds[5], note);
    let ratios = Spread::of_ratios(&seconds[2], &seconds[0]);
    let steep = format!("; with gradient here {}", Spread::of(&each(&seconds[4])));
    Ok(vec![
        figure("P6", &seconds[0], &size),
        figure("P6.gradient", &seconds[1], &size),
        figure("P6.products", &seconds[3], &steep),
        Found::new("P18.lookup", ratios.median, ratios.to_string()),
    ])
}
