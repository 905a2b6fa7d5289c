//! `--frames`: sequences of runs, what they skip, what they refuse, and their plans.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn druse(place: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_druse"));
    command.args(arguments).current_dir(place).output().unwrap()
}

fn facts(place: &Path, arguments: &[&str]) -> Value {
    let output = druse(place, &[arguments, &["--json"]].concat());
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {error}");
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(place: &Path, arguments: &[&str], code: i32, words: &[&str]) {
    let output = druse(place, arguments);
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    for word in words {
        assert!(error.contains(word), "{word:?} is not in {error}");
    }
}

/// A bar of four hexes that is stretched after frame 2.
const BAR: &str = "druse = 1\nunit = \"mm\"\n[cell.p]\nsurface = \"schwarz_p\"\n\
    [scaffold]\nbox = { size = [4, 2, 2], cell_size = 2 }\n\
    [scaffold.motion]\ndeform = [\"x*(1 + max(0, frame - 2)/10)\", \"y\", \"z\"]\n\
    [tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.2\n\
    [[output]]\nvdb = \"bar.$F4.vdb\"\nusda = true\ngrids = [\"surface\", \"vel\"]\n";

fn hashes(answer: &Value) -> Vec<String> {
    let frames = answer["frames"].as_array().unwrap().iter();
    let hash = |f: &Value| {
        f["report"]["outputs"][0]["content_hash"]
            .as_str()
            .unwrap()
            .to_owned()
    };
    frames.map(hash).collect()
}

#[test]
fn frames_are_made_once_and_again_where_something_changed() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    std::fs::write(place.join("bar.toml"), BAR).unwrap();
    let run = ["run", "bar.toml", "--out", "out", "--frames", "1-5x2,6"];
    let first = facts(place, &run);
    assert_eq!(
        (&first["made"], &first["unchanged"]),
        (&4.into(), &0.into())
    );
    let before = hashes(&first);
    assert_ne!(before[0], before[1]);
    assert!(place.join("out/bar.0003.vdb").exists() && place.join("out/report.0006.json").exists());
    let again = facts(place, &run);
    assert_eq!(
        (&again["made"], &again["unchanged"]),
        (&0.into(), &4.into())
    );
    assert_eq!(hashes(&again), before);
    // A file that someone replaced is made again; the others stay.
    std::fs::write(place.join("out/bar.0005.vdb"), "").unwrap();
    assert_eq!(facts(place, &run)["made"], 1);
    // Frames for which formulas have equal values have the same grids.
    let still = facts(
        place,
        &[
            "run",
            "bar.toml",
            "--out",
            "still",
            "--frames",
            "1-2",
            "--set",
            "output.0.grids=[\"surface\"]",
        ],
    );
    let still = hashes(&still);
    assert_eq!(still[0], still[1]);
    let scene = std::fs::read_to_string(place.join("out/bar.usda")).unwrap();
    for words in [
        "startTimeCode = 1",
        "endTimeCode = 6",
        "timeCodesPerSecond = 24",
        "3: @./bar.0003.vdb@,",
        "extent.timeSamples",
    ] {
        assert!(scene.contains(words), "{words} is not in {scene}");
    }
    let repeated = druse(place, &["run", "out/bar.0006.vdb"]);
    assert!(
        repeated.status.success(),
        "{}",
        String::from_utf8_lossy(&repeated.stderr)
    );
}

#[test]
fn bad_frames_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    std::fs::write(place.join("bar.toml"), BAR).unwrap();
    let run = |frames, more: &[&'static str], code, words: &[&str]| {
        refused(
            place,
            &[&["run", "bar.toml", "--frames", frames], more].concat(),
            code,
            words,
        );
    };
    run("9-1", &[], 2, &["runs backwards"]);
    run("1-9x0", &[], 2, &["a step of 0"]);
    run(
        "1-2",
        &["--set", "output.0.vdb=bar.vdb"],
        65,
        &["expected a frame token", "bar.$F4.vdb"],
    );
    run(
        "1-2",
        &["--set", "output.0.vdb=$F4/bar.$F2.vdb"],
        65,
        &["which disagree"],
    );
    std::fs::write(place.join("m.0002.stl"), "").unwrap();
    std::fs::write(place.join("m.0009.stl"), "").unwrap();
    let cut = format!("{BAR}[[op]]\nintersect = {{ mesh = \"m.####.stl\" }}\n");
    std::fs::write(place.join("cut.toml"), cut).unwrap();
    refused(
        place,
        &["run", "cut.toml", "--frames", "2-5"],
        66,
        &[
            "no file for frames 3-5",
            "the nearest frames that exist are 2 and 9",
        ],
    );
    run(
        "2,9",
        &["--set", "scaffold.motion.deform=[\"x\",\"y\",\"z + fram\"]"],
        65,
        &["frame, time, fps"],
    );
    refused(
        place,
        &["preview", "a.$F4.vdb", "-o", "a.png", "--frames", "1-2"],
        66,
        &["no file for frames 1-2"],
    );
    refused(
        place,
        &["preview", "m.$F4.stl", "-o", "a.png", "--frames", "2,9"],
        2,
        &["expected a frame token"],
    );
}

#[test]
fn a_plan_of_a_sequence_has_an_item_per_frame_and_brick() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    std::fs::write(place.join("bar.toml"), BAR).unwrap();
    let whole = hashes(&facts(
        place,
        &["run", "bar.toml", "--out", "whole", "--frames", "2-3"],
    ));
    let planned = facts(
        place,
        &[
            "plan", "bar.toml", "-o", "seq.json", "--out", "farm", "--frames", "2-3", "--emit",
            "parallel", "--emit", "slurm",
        ],
    );
    assert_eq!(planned["items"], 2);
    let script = std::fs::read_to_string(place.join("seq.slurm.sh")).unwrap();
    assert!(script.contains("--array=0-1 "), "{script}");
    refused(place, &["merge", "seq.json"], 65, &["no files of frame 2"]);
    assert_eq!(
        facts(place, &["run", "seq.json", "--brick", "0-1"])["made"],
        2
    );
    assert_eq!(
        facts(place, &["run", "seq.json", "--brick", "1"])["made"],
        0
    );
    let merged = facts(place, &["merge", "seq.json"]);
    assert_eq!(hashes(&merged), whole);
    assert!(place.join("farm/bar.usda").exists());
    // In bricks of 128 voxels, whose borders cross the bar, the same.
    let fine = [
        "--set",
        "band.voxel_size=0.06",
        "--set",
        "scaffold.box.origin=[-2, -1, -1]",
    ];
    let whole = hashes(&facts(
        place,
        &[
            &["run", "bar.toml", "--out", "w", "--frames", "3"],
            &fine[..],
        ]
        .concat(),
    ));
    let plan = [
        "plan",
        "bar.toml",
        "-o",
        "fine.json",
        "--out",
        "b",
        "--frames",
        "3",
        "--bricks",
        "1",
    ];
    let planned = facts(place, &[&plan[..], &fine].concat());
    assert!(planned["items"].as_u64().unwrap() > 1);
    let last = format!("0-{}", planned["items"].as_u64().unwrap() - 1);
    facts(place, &["run", "fine.json", "--brick", &last]);
    assert_eq!(hashes(&facts(place, &["merge", "fine.json"])), whole);
}

#[test]
fn other_commands_go_through_frames() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    std::fs::write(place.join("bar.toml"), BAR).unwrap();
    std::fs::write(
        place.join("c.crystal"),
        "param frame = 1\ncube edge=frame\n",
    )
    .unwrap();
    druse(
        place,
        &[
            "crystal",
            "c.crystal",
            "-o",
            "c.$F2.obj",
            "--frames",
            "1-3x2",
        ],
    );
    let width = |name: &str| {
        let text = std::fs::read_to_string(place.join(name)).unwrap();
        let numbers = text
            .lines()
            .filter_map(|l| l.strip_prefix("v ")?.split(' ').next()?.parse().ok());
        numbers.fold(f64::MIN, f64::max)
    };
    assert!((width("c.03.obj") / width("c.01.obj") - 3.0).abs() < 1e-9);
    let sliced = facts(
        place,
        &[
            "slice",
            "bar.toml",
            "-o",
            "s.$F4.svg",
            "--layer",
            "1mm",
            "--frames",
            "2,12",
        ],
    );
    let [a, b] = [0, 1].map(|n| sliced["frames"][n]["volume"].as_f64().unwrap());
    assert!((b / a - 2.0).abs() < 0.1, "{a} {b}");
    facts(
        place,
        &["crystal", "c.crystal", "-o", "c.$F2.stl", "--frames", "1-2"],
    );
    facts(
        place,
        &[
            "preview",
            "c.$F2.stl",
            "-o",
            "p.%02d.png",
            "--size",
            "64x64",
            "--frames",
            "1-2",
        ],
    );
    assert!(place.join("p.02.png").exists());
}
