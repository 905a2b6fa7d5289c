//! `druse sweep`: all combinations in one table, resumed, and refused.

use std::path::Path;
use std::process::{Command, Output};

const RECIPE: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.5\n\
    [[op]]\nunion = { box = { size = [4, 4, 4] } }\n[[op]]\ndilate = 0.5\n\
    [[output]]\nvdb = \"a.vdb\"\n[build]\nlayer = 0.5\n";

fn druse(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_druse"));
    command
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The rows of a table by named columns, without quotes.
fn rows(folder: &Path) -> Vec<Vec<(String, String)>> {
    let table = std::fs::read_to_string(folder.join("t.csv")).unwrap();
    let cells = |line: &str| -> Vec<String> {
        let mut all = vec![String::new()];
        let mut quoted = false;
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => all.push(String::new()),
                c => all.last_mut().unwrap().push(c),
            }
        }
        all
    };
    let mut lines = table.lines();
    let head = cells(lines.next().unwrap());
    let named = |line| head.iter().cloned().zip(cells(line)).collect();
    lines.map(named).collect()
}

fn cell(row: &[(String, String)], name: &str) -> String {
    let found = row.iter().find(|c| c.0 == name);
    found
        .unwrap_or_else(|| panic!("no column {name}"))
        .1
        .clone()
}

#[test]
fn all_combinations_are_run_once() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("r.toml"), RECIPE).unwrap();
    let run = |more: &[&str]| {
        let mut arguments = vec!["sweep", "r.toml", "op.1.dilate=0.5:1:0.5", "-o", "t.csv"];
        arguments.extend(more);
        let out = druse(folder.path(), &arguments);
        assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
        (text(&out.stdout), text(&out.stderr))
    };
    let keys = "build.up=[0,0,1],[1,1,0]";
    let (listed, _) = run(&[keys, "--dry-run"]);
    assert!(
        listed.contains("op.1.dilate=1 build.up=[1,1,0]"),
        "{listed}"
    );
    assert!(listed.contains("4 runs"), "{listed}");
    assert!(!folder.path().join("t.csv").exists());
    run(&[keys]);
    let all = rows(folder.path());
    assert_eq!(all.len(), 4);
    for (row, (dilate, up)) in all.iter().zip([
        ("0.5", "[0,0,1]"),
        ("0.5", "[1,1,0]"),
        ("1", "[0,0,1]"),
        ("1", "[1,1,0]"),
    ]) {
        assert_eq!(
            (cell(row, "op.1.dilate"), cell(row, "build.up")),
            (dilate.into(), up.into())
        );
        // Steiner's formula for a cube, whose round edges are two voxels wide at most.
        let (a, r): (f64, f64) = (4.0, dilate.parse().unwrap());
        let pi = std::f64::consts::PI;
        let exact = a.powi(3) + 6.0 * a * a * r + 3.0 * pi * a * r * r + 4.0 / 3.0 * pi * r.powi(3);
        let volume: f64 = cell(row, "volume").parse().unwrap();
        assert!((volume / exact - 1.0).abs() < 0.04, "{volume} {exact}");
        assert_eq!(
            (cell(row, "islands"), cell(row, "error")),
            ("0".into(), String::new())
        );
    }
    assert!(!folder.path().join("a.vdb").exists());
    // Rows that are there stay as they are; a row that was cut off is made again.
    let path = folder.path().join("t.csv");
    let before = std::fs::read_to_string(&path).unwrap();
    let third: usize = before.lines().take(3).map(|l| l.len() + 1).sum();
    std::fs::write(&path, &before[..third + 20]).unwrap();
    let (summary, notes) = run(&[keys]);
    assert!(summary.contains("4 rows, 2 kept"), "{summary}");
    assert!(notes.contains("3/4") && !notes.contains("2/4"), "{notes}");
    let again = std::fs::read_to_string(&path).unwrap();
    assert_eq!(
        again.lines().take(3).collect::<Vec<_>>(),
        before.lines().take(3).collect::<Vec<_>>()
    );
    assert_eq!(rows(folder.path()).len(), 4);
    // Files of each run lie in a folder of their own.
    run(&[keys, "--out", "all"]);
    assert!(folder.path().join("all/0004/a.vdb").exists());
}

#[test]
fn bad_sweeps_are_refused_and_failed_runs_are_rows() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("r.toml"), RECIPE).unwrap();
    for (keys, words) in [
        ("op.1.dilate", "KEY=VALUES"),
        ("op.1.dilate=1:2:0", "step"),
        ("op.7.dilate=1,2", "op has 2 entries"),
        ("bnad.voxel_size=1,2", "band"),
        ("build.layer=1:20000:0.1", "FIRST to LAST"),
        ("build.up=[0,0,0]", "length 0"),
        ("op.1.dilate=0:1:0.5", "positive"),
    ] {
        let out = druse(folder.path(), &["sweep", "r.toml", keys, "-o", "t.csv"]);
        let error = text(&out.stderr);
        assert!(
            out.status.code() >= Some(2) && error.contains(words),
            "{keys}: {error}"
        );
        assert!(!folder.path().join("t.csv").exists(), "{keys}");
    }
    // An erosion of everything.
    let arguments = [
        "sweep",
        "r.toml",
        "op.1={dilate=0.5},{erode=9}",
        "-o",
        "t.csv",
    ];
    let out = druse(folder.path(), &arguments);
    assert_eq!(out.status.code(), Some(1), "{}", text(&out.stderr));
    let all = rows(folder.path());
    assert!(cell(&all[0], "error").is_empty() && cell(&all[1], "error").contains("empty"));
    // A table of other keys is not overwritten.
    let out = druse(
        folder.path(),
        &["sweep", "r.toml", "build.layer=1", "-o", "t.csv"],
    );
    assert!(out.status.code() >= Some(2) && text(&out.stderr).contains("expected one of a sweep"));
}
