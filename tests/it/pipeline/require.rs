//! `[require]`: measures against closed forms, and verdicts in memory, in bricks and on files.

use super::recipe;
use druse::pipeline::{Report, Requirement, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::path::Path;
use std::process::{Command, Output};

/// Two plates of 10 x 10 x 2, a gap of 1.2 between them, and a ball of radius 3 with a cavity of radius 1.
const PART: &str = "druse = 1\n[band]\nvoxel_size = 0.2\n\
    [[op]]\nunion = { box = { size = [10, 10, 2] } }\n\
    [[op]]\nunion = { box = { size = [10, 10, 2], centre = [0, 0, 3.2] } }\n\
    [[op]]\nunion = { sphere = { radius = 3, centre = [20, 0, 0] } }\n\
    [[op]]\nsubtract = { sphere = { radius = 1, centre = [20, 0, 0] } }\n";

/// Runs a recipe in a folder of its own, in memory or in bricks of so many blocks.
fn run_alone(text: &str, bricks: Option<u32>) -> Report {
    let place = tempfile::tempdir().unwrap();
    let options = RunOptions {
        bricks,
        out: Some(place.path().to_owned()),
        ..RunOptions::default()
    };
    run(&recipe(text), &options, &Silent).unwrap()
}

fn made(require: &str, bricks: Option<u32>) -> Report {
    run_alone(&format!("{PART}[require]\n{require}\n"), bricks)
}

fn named<'a>(list: &'a [Requirement], name: &str) -> &'a Requirement {
    list.iter().find(|r| r.name == name).unwrap()
}

/// Volume of the part, mm^3.
fn volume() -> f64 {
    400.0 + 4.0 / 3.0 * std::f64::consts::PI * 26.0
}

#[test]
fn measures_are_those_of_closed_forms_in_memory_and_in_bricks() {
    let require = "least_wall = 1.9\nleast_gap = \"1.1mm\"\ncomponents = 3\nclosed_cavities = 1\n\
        mass = [0, 10]\ndensity = 2\nfits = [28.01, 10.01, 7.2]\n";
    for bricks in [None, Some(1)] {
        let report = made(require, bricks);
        let list = &report.requirements;
        assert!(report.meets_requirements(), "{list:#?}");
        assert_eq!(list.len(), 6);
        assert_eq!(report.solid.components, 3);
        assert_eq!(report.solid.closed_cavities, Some(1));
        let near = |name: &str, exact: f64, tolerance: f64| {
            let value = named(list, name).value.unwrap();
            assert!((value / exact - 1.0).abs() < tolerance, "{name} {value}");
        };
        near("least_wall", 2.0, 0.03);
        near("least_gap", 1.2, 0.05);
        near("mass", 2e-3 * volume(), 0.01);
        let place = report.solid.least_gap_place.unwrap();
        assert!((place[2] - 1.6).abs() < 0.1, "{place:?}");
    }
}

#[test]
fn each_requirement_fails_by_itself_with_its_value() {
    for (require, name) in [
        ("least_wall = 2.2", "least_wall"),
        ("least_gap = \"1.4mm\"", "least_gap"),
        ("least_gap = \"7vx\"", "least_gap"),
        ("components = 2", "components"),
        ("closed_cavities = 0", "closed_cavities"),
        ("mass = [2, 3]\ndensity = 2", "mass"),
        ("fits = [28.01, 10.01, 5.1]", "fits"),
    ] {
        let report = made(require, None);
        let [verdict] = &report.requirements[..] else {
            panic!("{require}: {:?}", report.requirements)
        };
        assert!(!verdict.met && verdict.name == name, "{verdict:?}");
        assert!(!report.meets_requirements());
        assert!(verdict.to_string().contains("NOT met"), "{verdict}");
        let has_place = ["least_wall", "least_gap"].contains(&name);
        assert_eq!(verdict.place.is_some(), has_place, "{verdict:?}");
    }
}

#[test]
fn a_ball_has_no_gap_and_wide_walls_in_bricks() {
    let text = "druse = 1\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { radius = 5 } }\n\
        [require]\nleast_gap = 4\nleast_wall = 4.5\n";
    for bricks in [None, Some(1)] {
        let report = run_alone(text, bricks);
        assert!(report.meets_requirements(), "{:#?}", report.requirements);
        assert_eq!(report.solid.least_gap, None);
    }
    // Bricks look no farther than 24 voxels: what is wider is not taken for granted.
    let report = run_alone(&text.replace("least_wall = 4.5", "least_wall = 6"), Some(1));
    let verdict = named(&report.requirements, "least_wall");
    assert!(!verdict.met && verdict.found.contains("4.8"), "{verdict:?}");
}

#[test]
fn the_jump_of_a_continuous_field_is_required_and_certified() {
    let text = "druse = 1\n[cell.a]\nelement = \"hex\"\nsurface = \"schwarz_p\"\n\
        [scaffold]\nbox = { size = [4, 4, 4], cell_size = 2 }\n[tiling]\ncell = \"a\"\n\
        [band]\nvoxel_size = 0.2\n[require]\nvalue_jump_max = 1e-5\nvolume_fraction = [0.45, 0.55]\n";
    let report = run_alone(text, None);
    assert!(report.continuity.is_some() && report.requirements.len() == 2);
    assert!(report.meets_requirements(), "{:#?}", report.requirements);
}

/// A box with a room of 4^3 and a duct of 1.4 x 1.4 to the outside, on several blocks of voxels, and a closed
/// ball of radius 1.
const ROOM: &str = "druse = 1\n[band]\nvoxel_size = 0.2\n\
    [[op]]\nunion = { box = { size = [12, 8, 8] } }\n\
    [[op]]\nsubtract = { box = { size = [4, 4, 4] } }\n\
    [[op]]\nsubtract = { box = { size = [8, 1.4, 1.4], centre = [5, 0, 0] } }\n";

#[test]
fn the_escape_radius_is_that_of_the_duct_in_memory_and_in_bricks() {
    let closed = "[[op]]\nsubtract = { sphere = { radius = 1, centre = [-4, 0, 0] } }\n";
    let text = |ops: &str, least: f64| format!("{ROOM}{ops}[require]\nescape_radius = {least}\n");
    let mut reports = Vec::new();
    for bricks in [None, Some(1), Some(2)] {
        let report = run_alone(&text("", 0.6), bricks);
        let [verdict] = &report.requirements[..] else {
            panic!("{:?}", report.requirements)
        };
        assert!(verdict.met, "{verdict}");
        let radius = verdict.value.unwrap();
        assert!((radius - 0.7).abs() < 0.06, "{radius}");
        let both = run_alone(&text(closed, 0.6), bricks);
        let verdict = &both.requirements[0];
        assert!(
            !verdict.met && verdict.found == "a closed cavity",
            "{verdict}"
        );
        let found = both.solid.cavities.unwrap();
        assert_eq!((found.count, found.closed), (2, 1));
        let ball = 4.0 / 3.0 * std::f64::consts::PI;
        assert!(
            (found.list[0].volume / ball - 1.0).abs() < 0.05,
            "{found:?}"
        );
        reports.push(found);
    }
    assert!(reports.iter().all(|r| *r == reports[0]), "{reports:#?}");
    let narrow = run_alone(&text("", 0.8), None);
    let verdict = &narrow.requirements[0];
    let [x, y, z] = verdict.place.unwrap();
    assert!(
        !verdict.met && x > 1.9 && y.abs() < 0.8 && z.abs() < 0.8,
        "{verdict}"
    );
    let wide = run_alone(&text("", 40.0), None);
    assert!(!wide.requirements[0].met);
}

#[test]
fn contradictions_are_refused_with_their_key() {
    for (require, key, words) in [
        ("mass = [1, 2]", "require.mass", "density"),
        ("density = 2", "require.density", "mass"),
        ("mass = [3, 2]\ndensity = 2", "require.mass", "no number"),
        (
            "mass = [-1, 2]\ndensity = 2",
            "require.mass",
            "not negative",
        ),
        (
            "volume_fraction = [0.2, 0.3]",
            "require.volume_fraction",
            "envelope",
        ),
        (
            "volume_fraction = [0.2, 1.3]",
            "require.volume_fraction",
            "0 to 1",
        ),
        ("components = 0", "require.components", "at least 1"),
        (
            "value_jump_max = 1e-5",
            "require.value_jump_max",
            "[scaffold]",
        ),
        (
            "least_wall = 3\nfits = [10, 10, 2]",
            "require.least_wall",
            "do not fit",
        ),
    ] {
        let error = Recipe::parse(&format!("{PART}[require]\n{require}\n"), &[]).unwrap_err();
        assert_eq!(error.key.as_deref(), Some(key), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    }
    let error = Recipe::parse(&format!("{PART}[require]\nleast_wal = 1\n"), &[]).unwrap_err();
    assert_eq!(error.hint.as_deref(), Some("did you mean \"least_wall\"?"));
}

fn druse(place: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_druse"));
    command.args(arguments).current_dir(place).output().unwrap()
}

#[test]
fn the_program_ends_with_1_and_writes_its_files_all_the_same() {
    let place = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(place.path().join(name), text).unwrap();
    write(
        "r.toml",
        &format!(
            "{PART}[[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.stl\"\n[[output]]\nmesh = \"a.obj\"\n\
             [require]\ncomponents = 1\nleast_wall = 1\n"
        ),
    );
    let out = druse(place.path(), &["run", "r.toml", "--json", "--quiet"]);
    assert_eq!(out.status.code(), Some(1));
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(json["requirements"][0]["met"], true);
    assert_eq!(json["requirements"][1]["value"], 3.0);
    assert!(place.path().join("a.vdb").exists() && place.path().join("a.stl").exists());

    // The same part as a file, whose unit is not that of the requirements.
    write(
        "all.toml",
        "[require]\nleast_wall = 1.9\nleast_gap = 1.1\ncomponents = 3\nclosed_cavities = 1\n\
         mass = [1.01, 1.03]\ndensity = 2\nfits = [28.1, 10.1, 7.3]\n",
    );
    let out = druse(place.path(), &["check", "a.vdb", "--require", "all.toml"]);
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    assert_eq!(out.status.code(), Some(0), "{text}");
    assert_eq!(text.matches(": met:").count(), 6, "{text}");
    write("escape.toml", "[require]\nescape_radius = 0.5\n");
    let arguments = [
        "check",
        "a.vdb",
        "--cavities",
        "--require",
        "escape.toml",
        "--json",
    ];
    let out = druse(place.path(), &arguments);
    assert_eq!(out.status.code(), Some(1));
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let cavities = &json["grids"][0]["cavities"];
    assert_eq!(
        (&cavities["count"], &cavities["closed"]),
        (&1.into(), &1.into())
    );
    assert_eq!(json["requirements"][0]["found"], "a closed cavity");
    write("one.toml", "unit = \"cm\"\n[require]\nleast_gap = 0.15\n");
    let out = druse(place.path(), &["check", "a.vdb", "--require", "one.toml"]);
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    assert_eq!(out.status.code(), Some(1), "{text}");
    assert!(
        text.contains("NOT met: at least 0.15 cm, found 0.1"),
        "{text}"
    );

    let obj = std::fs::read_to_string(place.path().join("a.obj")).unwrap();
    let unitless: Vec<&str> = obj.lines().filter(|l| !l.starts_with('#')).collect();
    write("a.obj", &unitless.join("\n"));
    // A mesh tells its bodies and cavities, not its walls; its unit may have to be named.
    write(
        "mesh.toml",
        "[require]\ncomponents = 3\nclosed_cavities = 1\n",
    );
    for arguments in [
        &["check", "a.stl", "--require", "mesh.toml"][..],
        &["check", "a.obj", "--require", "mesh.toml", "--unit", "mm"],
    ] {
        let out = druse(place.path(), arguments);
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        assert_eq!(out.status.code(), Some(0), "{text}");
    }
    for (arguments, words) in [
        (
            &["check", "a.obj", "--require", "mesh.toml"][..],
            "--unit mm",
        ),
        (
            &["check", "a.stl", "--require", "all.toml"],
            "druse voxelize",
        ),
        (&["check", "a.stl", "--cavities"], "druse voxelize"),
        (&["check", "a.vdb", "--require", "r2.toml"], "No such file"),
        (&["check", "a.vdb", "--require", "empty.toml"], "[require]"),
        (&["check", "a.vdb", "--require", "runs.toml"], "druse run"),
    ] {
        write("empty.toml", "unit = \"mm\"\n");
        write("runs.toml", "[require]\nvalue_jump_max = 1e-5\n");
        let out = druse(place.path(), arguments);
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(
            out.status.code() >= Some(2) && text.contains(words),
            "{arguments:?}: {text}"
        );
    }
}
