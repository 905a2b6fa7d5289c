//! Meshing against OpenVDB's, on the same level set with the same threads.

use super::clock::{Spread, in_turn};
use super::figure::Found;
use super::threads::one_against_two;
use super::w1::W1;
use crate::Setting;
use druse::progress::{Silent, Threads};
use druse::vdb::Session;
use std::hint::black_box;

type Fault = std::boxed::Box<dyn std::error::Error>;

const ROUNDS: usize = 5;

/// P14 and P17.mesh: W1's surface. OpenVDB's time is that of `volumeToMesh` as the library calls it, with
/// the copy that keeps it manifold.
pub fn against_open_vdb(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let level_set = W1::new(setting.full)?.level_set()?;
    let [one, two] = [Threads::new(1)?, Threads::new(2)?];
    let ours = |threads: &Threads| level_set.to_mesh(Session::new(threads, &Silent));
    let theirs = || level_set.to_quads(0.0, Session::new(&one, &Silent));
    let counts = [ours(&one)?.vertices().len(), theirs()?.vertices().len()];
    let seconds = in_turn(
        ROUNDS,
        &mut [&mut || drop(black_box(ours(&one))), &mut || {
            drop(black_box(theirs()));
        }],
    );
    // By vertex: one on each edge that is crossed, and one in each cell.
    let [per, other] = [0, 1].map(|n| {
        let each = seconds[n].iter().map(|s| s * 1e9 / counts[n] as f64);
        each.collect::<Vec<f64>>()
    });
    let ratios = Spread::of_ratios(&other, &per);
    let note = format!(
        "{ratios}; {:.0} and {:.0} ns a vertex, {} and {} vertices",
        Spread::of(&per).median,
        Spread::of(&other).median,
        counts[0],
        counts[1]
    );
    let on = |threads: &Threads| drop(black_box(ours(threads)));
    Ok(vec![
        Found::new("P14", ratios.median, note),
        one_against_two("P17.mesh", &mut || on(&one), &mut || on(&two)),
    ])
}
