//! All laws and oracles, in one binary; modules are named after those of `src`.

mod band;
mod blend;
mod bricks;
mod cell;
mod certificate;
mod field;
mod homogenize;
mod house;
mod inverse;
mod io;
mod malformed;
mod mesh;
mod mesher;
mod polymesh;
mod recipe;
mod scaffold;
mod sequence;
mod strategy;
mod symmetry;
mod tiling;

/// Whether the long series are wanted: `tests/run full` sets the variable.
fn is_full() -> bool {
    std::env::var_os("DRUSE_FULL").is_some()
}

/// Runs a law on numbered random cases, the first ones and those that were wrong once: the long series has 10,000 from a
/// start that the seed chooses, and `DRUSE_CASES=1365,5060` runs just those. Reports all cases that are wrong.
fn each_case(short: u64, once_wrong: &[u64], wrong: impl Fn(u64) -> Option<String>) {
    let variable = |name: &str| std::env::var(name).ok();
    let number = |text: &str| text.trim().parse::<u64>().expect("a number");
    let seed = variable("PROPTEST_RNG_SEED").map_or(1, |text| number(&text));
    let start = 10_000 * (seed - 1);
    let cases: Vec<u64> = match variable("DRUSE_CASES") {
        Some(list) => list.split(',').map(number).collect(),
        None if is_full() => (start..start + 10_000).collect(),
        None => (0..short).chain(once_wrong.iter().copied()).collect(),
    };
    let found = cases.iter().filter_map(|&case| Some((case, wrong(case)?)));
    let wrong: Vec<String> = found
        .map(|(case, what)| format!("case {case}: {what}"))
        .collect();
    let (count, all) = (wrong.len(), cases.len());
    assert!(wrong.is_empty(), "{count} of {all}: {wrong:#?}");
}

/// Random cases of a law: all of them in the long series, else a third.
fn cases(all: u32) -> u32 {
    if is_full() { all } else { all / 3 }
}

#[cfg(feature = "vdb")]
mod cli;
#[cfg(feature = "vdb")]
mod guide;
#[cfg(feature = "vdb")]
mod pipeline;
#[cfg(feature = "vdb")]
mod safety;
#[cfg(feature = "vdb")]
mod truth;
#[cfg(feature = "vdb")]
mod vdb;
#[cfg(feature = "vdb")]
mod vdb_commands;
