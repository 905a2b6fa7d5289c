//! Meshing against OpenVDB's, on the same level set with the same threads, and on two threads.

use super::clock::{Spread, in_turn};
use super::figure::Found;
use super::threads::one_against_two;
use super::w1::W1;
use crate::Setting;
use druse::progress::{Silent, Threads};
use druse::vdb::Session;
use std::hint::black_box;
use std::process::{Command, Stdio};

type Fault = std::boxed::Box<dyn std::error::Error>;

const ROUNDS: usize = 5;

/// P14: W1's surface. OpenVDB's time is that of `volumeToMesh` as the library calls it, with the copy
/// that keeps it manifold.
pub fn against_open_vdb(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let level_set = W1::new(setting.full)?.level_set()?;
    let one = Threads::new(1)?;
    let ours = || level_set.to_mesh(Session::new(&one, &Silent));
    let theirs = || level_set.to_quads(0.0, Session::new(&one, &Silent));
    let counts = [ours()?.vertices().len(), theirs()?.vertices().len()];
    let seconds = in_turn(
        ROUNDS,
        &mut [&mut || drop(black_box(ours())), &mut || {
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
    Ok(vec![Found::new("P14", ratios.median, note)])
}

/// The C library's allocator takes room of more than 128 KiB from the system and gives it back, as in a
/// run, which makes one mesh. Otherwise it keeps some of what was given back, in one process and not in
/// the next, and what two threads gain follows that.
const ALLOCATOR: [&str; 2] = ["GLIBC_TUNABLES", "glibc.malloc.mmap_threshold=131072"];

/// P17.mesh: W1's surface, in a process whose allocator is in a known state.
pub fn on_two_threads(setting: &Setting) -> Result<Vec<Found>, Fault> {
    const KEY: &str = "P17.mesh";
    let [variable, value] = ALLOCATOR;
    if std::env::var(variable).is_ok_and(|v| v == value) {
        let level_set = W1::new(setting.full)?.level_set()?;
        let [one, two] = [Threads::new(1)?, Threads::new(2)?];
        let on = |threads: &Threads| {
            drop(black_box(level_set.to_mesh(Session::new(threads, &Silent))));
        };
        return Ok(vec![one_against_two(KEY, &mut || on(&one), &mut || {
            on(&two);
        })]);
    }
    let program = std::env::current_exe()?;
    let mut child = Command::new(&program);
    child.args([KEY, "--json"]).env(variable, value);
    child.stderr(Stdio::inherit());
    if setting.full {
        child.arg("--full");
    }
    let output = child.output()?;
    if !output.status.success() {
        return Err(format!("{}: {}", program.display(), output.status).into());
    }
    let found: serde_json::Value = serde_json::from_slice(&output.stdout)?;
    let note = found[KEY]["note"].as_str().unwrap_or_default().to_owned();
    Ok(vec![match found[KEY]["value"].as_f64() {
        Some(value) => Found::new(KEY, value, note),
        None => Found::skipped(KEY, note),
    }])
}
