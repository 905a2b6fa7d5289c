//! `druse fit --target`: its files, its plan, its refusals, what an interrupt leaves.

use super::{Place, json, refuse, text};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A design of about a second.
const SHORT: [&str; 6] = [
    "fit",
    "--target",
    "{ maximise = \"bulk\", starts = 2, evaluations = 12, voxels = 10 }",
    "--volume-fraction",
    "0.3",
    "--band-limit=2.3",
];

fn with<'a>(more: &[&'a str]) -> Vec<&'a str> {
    SHORT.iter().chain(more).copied().collect()
}

#[test]
fn a_target_makes_a_cell_that_goes_on_into_a_tiling() {
    let place = Place::new();
    let plan = place.run(&with(&["-o", "a.cell", "--dry-run", "--json"]));
    assert!(plan.status.success(), "{}", text(&plan.stderr));
    let facts = json(&plan);
    assert_eq!(
        facts["coefficients"],
        facts["unknowns"].as_u64().unwrap() + 1
    );
    assert!(place.files().is_empty());
    let made = place.run(&with(&["-o", "a.cell", "--json"]));
    assert!(made.status.success(), "{}", text(&made.stderr));
    let facts = json(&made);
    let design = &facts["report"]["design"];
    assert_eq!(design["target"], "{ maximise = \"bulk\" }");
    assert!(design["properties"][0]["bulk_over_bound"].as_f64().unwrap() > 0.3);
    assert!((facts["volume_fraction"].as_f64().unwrap() - 0.3).abs() < 1e-4);
    let shown = place.run(&["cell", "info", "a.cell"]);
    assert!(text(&shown.stdout).contains("sharp voxels: bulk"));
    let more = place.run(&with(&["-o", "a.cell", "--resume", "--json"]));
    assert!(more.status.success(), "{}", text(&more.stderr));
    let history = |v: &serde_json::Value| v["history"].as_array().unwrap().len();
    assert!(history(&json(&more)["report"]["design"]) > history(design));
    place.write(
        "r.toml",
        "druse = 1\n[cell.a]\nfile = \"a.cell\"\n[scaffold]\nbox = { size = [8, 4, 4], cell_size = 4 }\n\
         [tiling]\ncell = \"a\"\ncertificate = true\n[band]\nvoxel_size = 0.2\n[[output]]\nreport = \"a.json\"\n",
    );
    let run = place.run(&["run", "r.toml"]);
    assert!(run.status.success(), "{}", text(&run.stderr));
    let report = std::fs::read(place.0.path().join("a.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    let jump = report["continuity"]["value_jump_max"].as_f64().unwrap();
    assert!(jump < 1e-5, "{jump:e}");
}

#[test]
fn wrong_targets_are_refused_with_what_is_expected() {
    let place = Place::new();
    let fit = |more: &[&'static str]| -> Vec<&'static str> {
        ["fit", "-o", "a.cell"]
            .iter()
            .chain(more)
            .copied()
            .collect()
    };
    for (more, words) in [
        (
            &["--target", "bluk", "--volume-fraction", "0.3"][..],
            &["bluk", "bulk"][..],
        ),
        (&["--target", "bulk"], &["volume_fraction"]),
        (&["--target", "bulk", "--level", "0"], &["volume_fraction"]),
        (
            &[
                "--target",
                "bulk",
                "--volume-fraction",
                "0.3",
                "--solid",
                "above",
            ],
            &["above", "below"],
        ),
        (
            &["--target", "{ poisson = 0.7 }", "--volume-fraction", "0.3"],
            &["poisson", "0.7", "0.5"],
        ),
        (
            &[
                "--target",
                "bulk",
                "--volume-fraction",
                "0.3",
                "--band-limit",
                "40",
            ],
            &["128"],
        ),
        (
            &[
                "--target",
                "{ maximise = \"bulk\", voxels = 8 }",
                "--volume-fraction",
                "0.3",
                "--band-limit",
                "6",
            ],
            &["Nyquist", "12 voxels"],
        ),
        (
            &[
                "--target",
                "bulk",
                "--volume-fraction",
                "0.3",
                "--element",
                "wedge",
            ],
            &["wedge", "hex"],
        ),
        (
            &[
                "--target",
                "bulk",
                "--volume-fraction",
                "0.3",
                "--start",
                "nothing",
            ],
            &["nothing", "schwarz_p"],
        ),
        (&["schwarz_p", "--target", "bulk"], &["cannot be used with"]),
        (&["schwarz_p", "--sheet"], &["--target"]),
        (&[], &["INPUT"]),
    ] {
        refuse(&place, &fit(more), 2, words);
    }
    let recipe = |cell: &str| {
        format!(
            "druse = 1\n[cell.a]\n{cell}\n[cell.p]\nsurface = \"schwarz_p\"\n[scaffold]\nbox = {{ size = [4, 4, 4], \
             cell_size = 4 }}\n[tiling]\ncell = \"a\"\n[band]\nvoxel_size = 0.2\n"
        )
    };
    for (cell, words) in [
        ("target = \"bulk\"", &["volume_fraction"][..]),
        (
            "surface = \"iwp\"\nmin_feature = 0.1",
            &["min_feature", "target"],
        ),
        (
            "target = \"bulk\"\nvolume_fraction = 0.3\nmatch = [\"q\"]",
            &["\"q\"", "known: a, p"],
        ),
        (
            "target = \"bulk\"\nvolume_fraction = 0.3\nmatch = [\"a\"]",
            &["itself"],
        ),
        (
            "target = \"bulk\"\nvolume_fraction = 0.3\nlevel = 0",
            &["level", "volume_fraction"],
        ),
        (
            "target = \"hard\"\nvolume_fraction = 0.3",
            &["hard", "bulk"],
        ),
        (
            "target = { maximise = \"bulk\", zener = 1, stiffness = 3 }\nvolume_fraction = 0.3",
            &["stiffness"],
        ),
    ] {
        place.write("r.toml", recipe(cell));
        refuse(&place, &["run", "r.toml"], 65, words);
    }
}

#[test]
fn an_interrupted_search_keeps_its_best_cell_and_continues() {
    let place = Place::new();
    let long = [
        "fit",
        "--target",
        "{ maximise = \"bulk\", starts = 20, evaluations = 4000, voxels = 16 }",
        "--volume-fraction",
        "0.3",
        "-o",
        "a.cell",
        "--progress",
        "plain",
    ];
    let mut child = Command::new(env!("CARGO_BIN_EXE_druse"))
        .args(long)
        .current_dir(&place.0)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // However fast the machine is, the first steps are made then and the last one is minutes away.
    let begun = BufReader::new(child.stderr.take().unwrap())
        .lines()
        .map_while(Result::ok)
        .any(|line| line.contains("design 1 of") && !line.contains(" 0 %"));
    assert!(begun);
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status().unwrap();
    assert!(sent.success());
    // The rest of the search takes minutes on any machine.
    let start = Instant::now();
    let code = child.wait().unwrap().code();
    assert!(start.elapsed() < Duration::from_secs(60));
    assert_eq!(code, Some(75));
    let cell = std::fs::read_to_string(place.0.path().join("a.cell")).unwrap();
    assert!(cell.contains("\"complete\":false"), "{cell}");
}

#[test]
#[ignore = "long; tests/run full"]
fn short_designs_of_sheets_are_stiffer_than_named_surfaces() {
    let place = Place::new();
    let design = |target: &str| {
        let target = format!("{{ {target}, starts = 1, evaluations = 6, voxels = 24 }}");
        let flags = [
            "fit",
            "--target",
            &target,
            "--sheet",
            "--volume-fraction",
            "0.3",
        ];
        let made = place.run(&[&flags[..], &["-o", "a.cell"]].concat());
        assert!(made.status.success(), "{}", text(&made.stderr));
        let command = "cell homogenize a.cell --sharp --resolution 48 --only stiffness --json";
        let found = json(&place.run(&command.split(' ').collect::<Vec<_>>()));
        let bulk = found["over_bounds"]["bulk"].as_f64().unwrap();
        [bulk, found["engineering"]["zener"].as_f64().unwrap()]
    };
    // Schwarz' P, the stiffest of the named ones, has 0.830 of the bound; the gyroid, the most nearly isotropic, 0.806.
    let [bulk, _] = design("maximise = \"bulk\"");
    assert!(bulk > 0.86, "{bulk}");
    let [bulk, zener] = design("maximise = \"bulk\", zener = 1");
    assert!(bulk > 0.82 && (zener - 1.0).abs() < 0.02, "{bulk} {zener}");
}
