//! The speed of Druse beside its limits: `cargo bench --bench workloads`.
//!
//! Every figure is measured with its baseline in one process: alternating rounds, processor time, median of
//! the ratios. `-- P1 P13` measures some, `-- --json` prints one object, `-- --full` takes the sizes of the
//! guide's table, `-- P18.native` first builds this bench for this processor, under `target/native`. Figures that
//! fell by 15 % or more since they were stored are named at the end; `-- --store` stores those of this run in
//! `tests/bench/ratios.json`, for processors of this family.
//!
//! | workload | what |
//! |---|---|
//! | W1 | gyroid in a box, cells of 40 voxels: 400^3 voxels, 200^3 where only other ratios count |
//! | W1s | one gyroid cell in a box: 100^3 and 200^3 voxels, in full 200^3 and 400^3 |
//! | W2 | a strut cell in the tets of an ellipsoid |
//! | W3 | two cells blended over a block of hexes |
//! | W4 | 5^3 strut cells of 100 voxels, in full 800: larger than its memory |
//!
//! Baselines: a scalar f64 callback per voxel; the same in f32 by leaves; dense arrays from 1-D tables, as in
//! numpy; a series' products at every voxel; writing the bytes of the leaves; fused multiplications.

mod workloads {
    pub mod baselines;
    pub mod builds;
    pub mod child;
    pub mod clock;
    pub mod dense;
    pub mod figure;
    #[cfg(feature = "vdb")]
    pub mod filters;
    pub mod fits;
    #[cfg(feature = "vdb")]
    pub mod mesher;
    pub mod ratios;
    pub mod reader;
    #[cfg(all(feature = "vdb", feature = "cli"))]
    pub mod stream;
    pub mod table;
    pub mod threads;
    pub mod w1;
    pub mod w2;
    #[cfg(feature = "vdb")]
    pub mod write;
}
use workloads::figure::{FIGURES, Found, matches_key, object, table};
use workloads::ratios::Ratios;
#[cfg(all(feature = "vdb", feature = "cli"))]
use workloads::stream;
use workloads::{builds, child, fits, table as look_up, w1, w2};
#[cfg(feature = "vdb")]
use workloads::{filters, mesher, write};

/// The options of the command line.
pub struct Setting {
    /// Sizes of the README's table.
    pub full: bool,
    /// Whether to build this bench for this machine's processor.
    pub builds_native: bool,
}

/// What a subject found.
type Measured = Result<Vec<Found>, Box<dyn std::error::Error>>;

/// Figures that are measured together.
struct Subject {
    keys: &'static [&'static str],
    measure: fn(&Setting) -> Measured,
}

const SUBJECTS: &[Subject] = &[
    Subject {
        keys: &["P1", "P2", "P3", "P4", "P4.small"],
        measure: w1::against_baselines,
    },
    #[cfg(feature = "vdb")]
    Subject {
        keys: &["P1.bridge"],
        measure: w1::through_the_bridge,
    },
    Subject {
        keys: &["P5"],
        measure: w1::first_pass,
    },
    Subject {
        keys: &["P6", "P6.gradient", "P6.products", "P18.lookup"],
        measure: look_up::look_ups,
    },
    Subject {
        keys: &["P8", "P8.dense", "P10.w2", "P10.w2.evaluated"],
        measure: w2::struts_in_tets,
    },
    Subject {
        keys: &["P8.nodes", "P10.tets", "P10.tets.evaluated"],
        measure: w2::struts_in_large_tets,
    },
    Subject {
        keys: &["P7", "P17"],
        measure: w2::orbits_and_threads,
    },
    Subject {
        keys: &["P10.w3", "P10.w3.evaluated", "P17.w3"],
        measure: w2::blend_in_hexes,
    },
    Subject {
        keys: &["P9", "P9.padding", "P10", "P10.evaluated"],
        measure: w1::growth,
    },
    #[cfg(feature = "vdb")]
    Subject {
        keys: &["P12", "P12.size"],
        measure: write::against_openvdb,
    },
    #[cfg(feature = "vdb")]
    Subject {
        keys: &["P13", "P13.mean", "P13.gaussian"],
        measure: filters::against_openvdb,
    },
    #[cfg(feature = "vdb")]
    Subject {
        keys: &["P13.lattice", "P13.far"],
        measure: filters::moves,
    },
    #[cfg(feature = "vdb")]
    Subject {
        keys: &["P14"],
        measure: mesher::against_open_vdb,
    },
    #[cfg(feature = "vdb")]
    Subject {
        keys: &["P17.mesh"],
        measure: mesher::on_two_threads,
    },
    #[cfg(all(feature = "vdb", feature = "cli"))]
    Subject {
        keys: &["P11", "P11.seconds", "P10.w4", "P10.w4.evaluated"],
        measure: stream::larger_than_memory,
    },
    #[cfg(all(feature = "vdb", feature = "cli"))]
    Subject {
        keys: &["P11.growth"],
        measure: stream::growth,
    },
    Subject {
        keys: &["P15"],
        measure: fits::against_the_transform,
    },
    Subject {
        keys: &["P16"],
        measure: fits::signed_distances,
    },
    Subject {
        keys: &["P17.w1"],
        measure: w1::threads,
    },
    Subject {
        keys: &["P18", "P18.w2"],
        measure: builds::portable,
    },
    Subject {
        keys: &["P18.native", "P18.native.w2"],
        measure: builds::native,
    },
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut setting = Setting {
        full: false,
        builds_native: false,
    };
    let (mut json, mut store, mut names) = (false, false, Vec::new());
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            // Cargo's own.
            "--bench" => {}
            "--json" => json = true,
            "--store" => store = true,
            "--full" => setting.full = true,
            "--child" => return child::run(arguments),
            name => names.push(name.to_owned()),
        }
    }
    let is_wanted = |key: &str| names.is_empty() || names.iter().any(|n| matches_key(n, key));
    if let Some(name) = names
        .iter()
        .find(|n| !FIGURES.iter().any(|f| matches_key(n, f.key)))
    {
        return Err(format!("{name}: no such figure; P1 to P18, P13.mean, ...").into());
    }
    setting.builds_native = names.iter().any(|n| n.starts_with("P18.native"));
    let mut found = Vec::new();
    for subject in SUBJECTS {
        if subject.keys.iter().any(|key| is_wanted(key)) {
            found.extend((subject.measure)(&setting)?);
        }
    }
    found.retain(|f| is_wanted(f.key()));
    if json {
        println!("{:#}", object(&found));
    } else {
        println!("{}", workloads::baselines::processor());
        print!("{}", table(&found));
    }
    let stored = Ratios::read()?;
    for loss in stored.losses(&found) {
        eprintln!("{loss}");
    }
    if store {
        stored.store(&found)?;
    }
    Ok(())
}
