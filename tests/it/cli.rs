//! The program as its users meet it: exit codes, what goes to stdout and stderr, bad input, signals.

mod cells;
mod designs;
mod families;
mod fillings;
mod foreign_files;
mod frames;
mod homogenize;
mod hybrid;
mod limits;
mod live;
mod meshes;
mod parent;
mod parts;
mod portable;
mod reports;
mod sweep;
mod view;
mod words;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const BALL: &str =
    "druse = 1\n[band]\nvoxel_size = 0.4\n[[op]]\nunion = { sphere = { radius = 5 } }\n";
const FILES: &str = "[[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.stl\"\n[[output]]\npicture = \"a.png\"\nsize = [64, 48]\n";

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name)
}

/// A directory to run in, with a recipe.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn with(recipe: &str) -> Self {
        let place = Self::new();
        place.write("r.toml", recipe);
        place
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        fs::write(self.0.path().join(name), text).unwrap();
    }

    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_druse"))
            .args(arguments)
            .current_dir(&self.0)
            .stdin(Stdio::null())
            .output()
            .unwrap()
    }

    fn files(&self) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(&self.0)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn json(output: &Output) -> serde_json::Value {
    let out = text(&output.stdout);
    assert_eq!(out.trim_end().lines().count(), 1, "{out}");
    serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {out}"))
}

/// Runs a recipe that must fail, with this code and these words, and leaves nothing behind.
fn refuse(place: &Place, arguments: &[&str], code: i32, words: &[&str]) {
    let before = place.files();
    let output = place.run(arguments);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    assert!(output.stdout.is_empty(), "{arguments:?}");
    assert!(error.starts_with("error: "), "{error}");
    assert_eq!(error.matches("error: ").count(), 1, "{error}");
    for word in words {
        assert!(
            error.contains(word),
            "{arguments:?}: no {word:?} in {error}"
        );
    }
    assert_eq!(place.files(), before, "{arguments:?}: {error}");
}

#[test]
fn a_run_prints_one_line_per_output_and_nothing_else() {
    let place = Place::with(&format!("{BALL}{FILES}"));
    let output = place.run(&["run", "r.toml"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let lines: Vec<String> = text(&output.stdout).lines().map(str::to_owned).collect();
    assert_eq!(lines.len(), 3, "{lines:?}");
    assert!(
        lines[0].contains("a.vdb") && lines[0].ends_with("  m"),
        "{lines:?}"
    );
    assert!(
        lines[1].contains("a.stl") && lines[1].ends_with("  mm"),
        "{lines:?}"
    );
    assert_eq!(place.files(), ["a.png", "a.stl", "a.vdb", "r.toml"]);
    // Without a terminal there is no bar: no carriage return, no escape.
    assert!(!text(&output.stderr).contains(['\r', '\x1b']));
    let quiet = place.run(&["run", "r.toml", "--quiet"]);
    assert!(quiet.stderr.is_empty());

    let checks = [
        (vec!["check", "a.stl", "--json"], "passed"),
        (vec!["check", "a.vdb", "--json"], "content_hash_as_recorded"),
    ];
    for (arguments, key) in checks {
        let output = place.run(&arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert_eq!(json(&output)[key], true);
    }
    let info = json(&place.run(&["info", "a.vdb", "--json"]));
    assert_eq!(info["unit"], "m");
    assert_eq!(info["content_hash"].as_str().unwrap().len(), 64);
    assert_eq!(info["grids"][0]["name"], "surface");
}

#[test]
fn json_is_exactly_one_object() {
    let place = Place::with(BALL);
    let report = json(&place.run(&["run", "r.toml", "--json"]));
    let volume = report["solid"]["volume"].as_f64().unwrap();
    assert!((volume / 523.6 - 1.0).abs() < 0.02, "{volume}");
    let estimate = json(&place.run(&["run", "r.toml", "--dry-run", "--json"]));
    assert!(estimate["active_voxels"].as_u64().unwrap() > 5000);
    for arguments in [
        vec!["schema", "--json"],
        vec!["info", "r.toml", "--json"],
        vec!["cell", "info", "schwarz_p", "--json"],
        vec!["cell", "info", "--group", "Td", "--json"],
        vec!["completions", "bash", "--json"],
        vec!["man", "--json"],
        vec!["man", "--out", "pages", "--json"],
    ] {
        let output = place.run(&arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert!(json(&output).is_object());
    }
    let error = place.run(&["run", "none.toml", "--json"]);
    assert_eq!(error.status.code(), Some(66));
    let error = json(&error);
    assert_eq!(
        (error["code"].as_u64(), error["file"].as_str()),
        (Some(66), Some("none.toml"))
    );
    let usage = place.run(&["run", "--no-such-flag", "--json"]);
    assert_eq!(usage.status.code(), Some(2));
    assert_eq!(json(&usage)["code"], 2);
}

#[test]
fn pictures_are_png_of_anything_with_a_surface() {
    let place = Place::with(&format!("{BALL}{FILES}"));
    assert!(place.run(&["run", "r.toml"]).status.success());
    for file in ["a.vdb", "a.stl", "schwarz_p"] {
        let output = place.run(&["preview", file, "-o", "p.png", "--size", "40x30"]);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let bytes = fs::read(place.0.path().join("p.png")).unwrap();
        assert!(bytes.starts_with(b"\x89PNG"), "{file}");
    }
    // In millimetres, of a file in metres: the cut misses.
    let missed = [
        "preview", "a.vdb", "-o", "p.png", "--size", "40x30", "--cut", "x=2",
    ];
    let output = place.run(&missed);
    assert!(output.status.success() && text(&output.stderr).contains("W107"));
    assert!(
        !place
            .run(&[&missed[..], &["--strict"]].concat())
            .status
            .success()
    );
    let jpeg = ["preview", "a.vdb", "-o", "p.jpg"];
    refuse(&place, &jpeg, 2, &["p.jpg", ".png"]);
    refuse(&place, &["info", "."], 65, &["directory"]);
}

#[test]
fn manual_pages_are_those_of_commands_that_are_shown() {
    let place = Place::new();
    assert!(place.run(&["man", "--out", "m"]).status.success());
    let pages: Vec<_> = fs::read_dir(place.0.path().join("m")).unwrap().collect();
    let help = text(&place.run(&["--help"]).stdout);
    for page in pages {
        let name = page.unwrap().file_name().into_string().unwrap();
        let command = name.trim_end_matches(".1").split('-').nth(1);
        assert!(
            command.is_none_or(|c| help.contains(&format!("\n  {c} "))),
            "{name}"
        );
    }
}

#[test]
fn wrappers_get_progress_as_lines() {
    let place = Place::with(BALL);
    let output = place.run(&["run", "r.toml", "--progress=json"]);
    let stages: Vec<String> = text(&output.stderr)
        .lines()
        .filter_map(|l| serde_json::from_str::<serde_json::Value>(l).ok())
        .map(|v| v["stage"].as_str().unwrap().to_owned())
        .collect();
    assert!(stages.iter().any(|s| s == "band"), "{stages:?}");
    let plain = place.run(&["run", "r.toml", "--progress=plain"]);
    assert!(text(&plain.stderr).lines().any(|l| l.starts_with("band")));
}

#[test]
fn decisions_are_shown_at_the_level_that_is_named() {
    let place = Place::with(&format!(
        "{BALL}[[op]]\nunion = {{ mesh = \"t.obj\" }}\n[cell.g]\nsurface = \"gyroid\"\n[scaffold]\nfile = \"h.inp\"\n[tiling]\ncell = \"g\"\n"
    ));
    // A tet with its triangles inward, and a hex that the deck has twice.
    let tet = "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 1 3 4\n";
    place.write("t.obj", tet);
    let nodes = "1,0,0,0\n2,4,0,0\n3,4,4,0\n4,0,4,0\n5,0,0,4\n6,4,0,4\n7,4,4,4\n8,0,4,4";
    let hexes = "*ELEMENT,TYPE=C3D8\n1,1,2,3,4,5,6,7,8\n2,1,2,3,4,5,6,7,8";
    place.write("h.inp", format!("*NODE\n{nodes}\n{hexes}\n"));
    let shown = |level: &[&str]| {
        let output = place.run(&[&["run", "r.toml"], level].concat());
        text(&output.stderr)
    };
    let repairs = "info: t.obj: the triangles are oriented inward|info: scaffold: 1 duplicate elements were merged";
    let choices = "debug: run in memory|bytes; the run may use|table of a cell|cosines replace the look-up|\
        kernel: tables, because the band is wide";
    let has = |shown: &str, words: &str| words.split('|').all(|w| shown.contains(w));
    let [none, info, debug] = [&[][..], &["--log=info"], &["--log=debug"]].map(shown);
    assert!(has(&debug, choices) && has(&debug, repairs), "{debug}");
    assert!(has(&info, repairs) && !info.contains("debug:"), "{info}");
    assert!(!none.contains("info:"), "{none}");
}

#[test]
fn bad_recipes_are_refused_before_anything_is_written() {
    let cases: &[(&str, &str, &[&str])] = &[
        (
            "voxel_size",
            "voxel_szie",
            &["unknown key", "r.toml:3:1", "did you mean"],
        ),
        ("0.4", "-0.4", &["positive", "r.toml:3"]),
        ("0.4", "nan", &["band.voxel_size", "r.toml:3"]),
        ("radius = 5", "radius = -5", &["positive", "r.toml:5"]),
        (
            "radius = 5",
            "radius = 5e4",
            &["memory", "voxel size", "would fit", "--set"],
        ),
        ("0.4", "1e-7", &["OpenVDB holds none", "r.toml:3"]),
        ("druse = 1", "druse = 7", &["version 7"]),
        ("[band]", "[band", &["r.toml:2"]),
    ];
    for (from, to, words) in cases {
        let place = Place::with(&format!("{}{FILES}", BALL.replace(from, to)));
        refuse(&place, &["run", "r.toml"], 65, words);
    }
    let place = Place::with(&format!("{BALL}{FILES}"));
    refuse(
        &place,
        &["run", "r.toml", "--set", "band.voxel=1"],
        65,
        &["--set", "voxel"],
    );
    refuse(
        &place,
        &["run", "r.toml", "--memory", "30M"],
        65,
        &["memory"],
    );
    refuse(&place, &["run", "none.toml"], 66, &["none.toml"]);
    let output = "[[output]]\npicture = \"a.png\"\nunit = \"mm\"\n";
    let place = Place::with(&format!("{BALL}{output}"));
    refuse(
        &place,
        &["run", "r.toml"],
        65,
        &["unit belongs", "vdb or mesh", "r.toml:8"],
    );
    place.write("bytes.toml", b"druse = 1\nunit = \"m\xffm\"\n");
    refuse(
        &place,
        &["run", "bytes.toml"],
        65,
        &["bytes.toml:2:10", "0xff", "UTF-8"],
    );
}

#[test]
fn the_least_voxel_is_written_and_a_smaller_one_refused_at_once() {
    let recipe = |voxel: f64| {
        let radius = 12.0 * voxel;
        format!(
            "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = {voxel}\n[[op]]\nunion = {{ sphere = {{ radius = {radius} }} }}\n[[output]]\nvdb = \"a.vdb\"\n"
        )
    };
    let least = druse::frame::Transform::MIN_VOXEL_SIZE * 1e3;
    let place = Place::with(&recipe(1.0001 * least));
    assert!(place.run(&["run", "r.toml"]).status.success());
    let place = Place::with(&recipe(0.9999 * least));
    let words = &["OpenVDB holds none", "smaller unit"];
    refuse(&place, &["run", "r.toml"], 65, words);
    // The rules are no stricter than OpenVDB's.
    assert!((least * 1e-3).powi(3) < 3.001e-15);
}

#[test]
fn bad_inputs_are_refused_by_name() {
    let stl = fs::read(data("strut_hex.stl")).unwrap();
    let open = b"solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
    let cases: &[(&str, &[u8], i32)] = &[
        ("cut.stl", &stl[..stl.len() / 2], 65),
        ("text.stl", b"this is no mesh at all", 65),
        ("empty.stl", b"", 65),
        ("open.stl", open, 65),
        ("mesh.xyz", b"1 2 3", 65),
    ];
    let recipe = |mesh: &str| format!("{BALL}[[op]]\nintersect = {{ mesh = \"{mesh}\" }}\n{FILES}");
    for (name, bytes, code) in cases {
        let place = Place::with(&recipe(name));
        place.write(name, bytes);
        refuse(&place, &["run", "r.toml"], *code, &[name]);
    }
    let place = Place::with(&recipe("none.stl"));
    refuse(&place, &["run", "r.toml"], 66, &["none.stl"]);
    // A solid and an envelope that do not meet.
    let apart = format!(
        "{BALL}[[op]]\nintersect = {{ box = {{ size = [1, 1, 1], centre = [50, 0, 0] }} }}\n{FILES}"
    );
    refuse(
        &Place::with(&apart),
        &["run", "r.toml"],
        65,
        &["do not meet", "49.5"],
    );
    // An output that would overwrite the recipe's own input.
    let place = Place::with(&recipe("a.stl"));
    place.write("a.stl", &stl);
    refuse(&place, &["run", "r.toml"], 73, &["a.stl", "overwrite"]);
}

#[test]
fn bad_scaffolds_name_their_element() {
    // A unit hex whose last two nodes are exchanged: it folds.
    let msh = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n5 0 0 1\n6 1 0 1\n7 0 1 1\n8 1 1 1\n$EndNodes\n$Elements\n1\n42 5 2 1 1 1 2 3 4 5 6 7 8\n$EndElements\n";
    let recipe = "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\n[scaffold]\nfile = \"s.msh\"\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.05\n[[output]]\nvdb = \"a.vdb\"\n";
    let place = Place::with(recipe);
    place.write("s.msh", msh);
    refuse(
        &place,
        &["run", "r.toml"],
        65,
        &["s.msh", "element 42", "Jacobian"],
    );
}

#[test]
fn outputs_that_cannot_be_made_leave_nothing() {
    let place = Place::with(&format!("{BALL}[[output]]\nmesh = \"no/such/dir/a.stl\"\n"));
    refuse(&place, &["run", "r.toml"], 73, &["a.stl"]);
    if Path::new("/dev/full").exists() {
        let place = Place::with(&format!("{BALL}[[output]]\nmesh = \"full.stl\"\n"));
        std::os::unix::fs::symlink("/dev/full", place.0.path().join("full.stl")).unwrap();
        refuse(&place, &["run", "r.toml"], 74, &["full.stl"]);
    }
}

#[test]
fn damaged_level_sets_are_refused_by_a_child() {
    let place = Place::with(&format!("{BALL}[[output]]\nvdb = \"a.vdb\"\n"));
    assert!(place.run(&["run", "r.toml"]).status.success());
    let bytes = fs::read(place.0.path().join("a.vdb")).unwrap();
    place.write("cut.vdb", &bytes[..bytes.len() * 2 / 3]);
    place.write("text.vdb", "no grid here");
    for name in ["cut.vdb", "text.vdb"] {
        for command in ["info", "check"] {
            refuse(&place, &[command, name], 65, &[name]);
        }
    }
    refuse(&place, &["info", "none.vdb"], 66, &["none.vdb"]);
    refuse(&place, &["info", "r.txt"], 66, &["r.txt"]);
}

#[test]
fn new_recipes_are_valid_and_not_overwritten() {
    let place = Place::new();
    let output = place.run(&["new", "part"]);
    assert!(output.status.success());
    assert_eq!(place.files(), ["part.toml"]);
    let read = druse::recipe::Recipe::read(&place.0.path().join("part.toml"), &[]).unwrap();
    assert_eq!(read.sections().output.len(), 4);
    refuse(&place, &["new", "part"], 2, &["part.toml"]);
}

#[test]
fn a_closed_pipe_ends_quietly() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_druse"))
        .arg("schema")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
}

#[test]
fn cells_are_evaluated_at_points() {
    let place = Place::new();
    place.write("p.csv", "x,y,z\n0,0,0\n0.25,0.25,0.25\n");
    let output = place.run(&["cell", "eval", "schwarz_p", "--points", "p.csv"]);
    let table = text(&output.stdout);
    let rows: Vec<Vec<f64>> = table
        .lines()
        .skip(1)
        .map(|l| l.split(',').map(|c| c.parse().unwrap()).collect())
        .collect();
    assert!(
        (rows[0][3] - 3.0).abs() < 1e-12 && rows[0][4].abs() < 1e-12,
        "{table}"
    );
    assert!(rows[1][3].abs() < 1e-12, "{table}");
    assert!(
        (rows[1][4] + std::f64::consts::TAU).abs() < 1e-12,
        "{table}"
    );
    place.write("bad.csv", "x,y,z\n1,2,three\n");
    refuse(
        &place,
        &["cell", "eval", "schwarz_p", "--points", "bad.csv"],
        65,
        &["bad.csv:2"],
    );
}

#[test]
fn a_signal_stops_a_run_within_two_seconds_and_leaves_nothing() {
    // Many rounds of a filter, until the ball has vanished, which takes minutes; of a coarser ball only a second.
    let long = format!(
        "{}[[op]]\ngaussian = {{ width = 3, iterations = 1000 }}\n{FILES}",
        BALL.replace("0.4", "0.04")
    );
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let place = Place::with(&long);
        let mut child = Command::new(env!("CARGO_BIN_EXE_druse"))
            .args(["run", "r.toml", "--progress=plain"])
            .current_dir(&place.0)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = std::io::BufReader::new(child.stderr.take().unwrap());
        let mut lines = std::io::BufRead::lines(lines);
        assert!(lines.any(|l| l.unwrap().starts_with("gaussian")));
        std::thread::sleep(Duration::from_millis(300));
        let sent = Instant::now();
        let kill = Command::new("kill")
            .args([format!("-{signal}"), child.id().to_string()])
            .status();
        assert!(kill.unwrap().success());
        let status = child.wait().unwrap();
        assert_eq!(status.code(), Some(code));
        assert!(
            sent.elapsed() < Duration::from_secs(2),
            "{:?}",
            sent.elapsed()
        );
        assert_eq!(place.files(), ["r.toml"]);
    }
}
