//! `[build]`: the report in memory and in bricks, its requirements, `druse check --layer`, and bad input.

use super::recipe;
use druse::pipeline::{Report, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::path::Path;
use std::process::Command;

/// A cap of 8 x 8 on a stem of 4 x 4, a block in the air, and a pocket in the cap.
const PART: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.25\n\
    [[op]]\nunion = { box = { size = [8, 8, 2] } }\n\
    [[op]]\nunion = { box = { size = [4, 4, 8], centre = [0, 0, -4] } }\n\
    [[op]]\nunion = { box = { size = [3, 3, 3], centre = [20, 0, 0] } }\n\
    [[op]]\nsubtract = { box = { size = [2, 2, 2], centre = [0, 0, 1] } }\n\
    [build]\nlayer = 0.1\n";

fn made(require: &str, bricks: Option<u32>) -> Report {
    let place = tempfile::tempdir().unwrap();
    let options = RunOptions {
        bricks,
        out: Some(place.path().to_owned()),
        ..RunOptions::default()
    };
    run(&recipe(&format!("{PART}{require}")), &options, &Silent).unwrap()
}

#[test]
fn layers_have_their_closed_forms_in_memory_and_in_bricks() {
    let require = "[require]\nislands = 1\ncups = 1\noverhang_area = 60\n";
    let one = made(require, None);
    let build = one.solid.build.clone().unwrap();
    assert!(one.meets_requirements(), "{:#?}", one.requirements);
    assert_eq!((build.islands, build.cups), (1, 1));
    assert!(
        (build.island_list[0].place[2] + 1.5).abs() < 0.3,
        "{build:?}"
    );
    assert!((build.cup_list[0].place[2] - 0.0).abs() < 0.3, "{build:?}");
    assert!((build.heights[0] + 8.0).abs() < 0.2 && (build.heights[1] - 1.5).abs() < 0.2);
    // The cap beyond the stem, without a strip of a voxel, and the block.
    let exact = 64.0 - 20.25 + 9.0;
    assert!(
        (build.overhang_area / exact - 1.0).abs() < 0.12,
        "{}",
        build.overhang_area
    );
    assert!(
        (build.section_max[0] / 73.0 - 1.0).abs() < 0.1,
        "{:?}",
        build.section_max
    );
    assert!(
        (build.sealed_max[0] / 4.0 - 1.0).abs() < 0.3,
        "{:?}",
        build.sealed_max
    );
    let profile: f64 = build.profile.iter().map(|p| p.overhang).sum();
    assert!((profile - build.overhang_area).abs() < 1e-9);
    for edge in [1, 2] {
        assert_eq!(made(require, Some(edge)).solid.build.unwrap(), build);
    }
    let strict = made(
        "[require]\nislands = 0\ncups = 0\noverhang_area = 40\n",
        None,
    );
    assert!(
        strict.requirements.iter().all(|r| !r.met),
        "{:#?}",
        strict.requirements
    );
    assert!(strict.requirements[0].place.is_some());
}

fn druse(directory: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_druse"))
        .args(arguments)
        .current_dir(directory)
        .output()
        .unwrap();
    let text = [out.stdout, out.stderr].concat();
    (
        out.status.code(),
        String::from_utf8_lossy(&text).into_owned(),
    )
}

#[test]
fn files_are_checked_by_layer_and_bad_builds_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(place.path().join(name), text).unwrap();
    write(
        "r.toml",
        &format!("{PART}[[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.stl\"\n"),
    );
    assert_eq!(druse(place.path(), &["run", "r.toml"]).0, Some(0));
    let arguments = ["check", "a.vdb", "--layer", "0.1mm", "--plot", "p.png"];
    let (code, text) = druse(place.path(), &arguments);
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("islands: 1") && text.contains("cups: 1"),
        "{text}"
    );
    let png = std::fs::read(place.path().join("p.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG"));
    // Upside down the pocket opens downwards, so that it is no cup; the block, which is taller, stands on the plate and
    // the cap begins in the air.
    let arguments = [
        "check", "a.vdb", "--layer", "0.1mm", "--up", "0,0,-1", "--json",
    ];
    let (_, json) = druse(place.path(), &arguments);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["grids"][0]["layers"]["cups"], 0);
    assert_eq!(json["grids"][0]["layers"]["islands"], 1);
    write(
        "l.toml",
        "unit = \"mm\"\n[build]\nlayer = 0.1\n[require]\nislands = 0\noverhang_area = 100\n",
    );
    let (code, text) = druse(place.path(), &["check", "a.vdb", "--require", "l.toml"]);
    assert_eq!(code, Some(1), "{text}");
    assert!(
        text.contains("require islands: NOT met: at most 0, found 1 at"),
        "{text}"
    );
    assert!(text.contains("require overhang_area: met"), "{text}");
    write("n.toml", "[require]\nislands = 0\n");
    for (arguments, words) in [
        (
            &["check", "a.vdb", "--layer", "0.1mm", "--up", "0,0,0"][..],
            "length 0",
        ),
        (
            &["check", "a.vdb", "--layer", "0.1mm", "--up", "0,1"],
            "three numbers",
        ),
        (
            &["check", "a.vdb", "--layer", "0.1mm", "--overhang", "90"],
            "1 to 89",
        ),
        (&["check", "a.vdb", "--layer", "0.1um"], "0.0004 voxels"),
        (&["check", "a.vdb", "--up", "0,0,1"], "--layer"),
        (&["check", "a.stl", "--layer", "0.1mm"], "druse voxelize"),
        (&["check", "a.vdb", "--require", "n.toml"], "[build]"),
    ] {
        let (code, text) = druse(place.path(), arguments);
        assert!(
            code >= Some(2) && text.contains(words),
            "{arguments:?}: {text}"
        );
    }
    for (text, key) in [
        (
            PART.replace("layer = 0.1", "layer = 0.1\nup = [0, 0, 0]"),
            "build.up",
        ),
        (
            PART.replace("layer = 0.1", "layer = 0.1\noverhang = 0"),
            "build.overhang",
        ),
        (
            PART.replace("[build]\nlayer = 0.1", "[require]\ncups = 0"),
            "require.cups",
        ),
        (
            format!("{PART}[require]\noverhang_area = -1\n"),
            "require.overhang_area",
        ),
    ] {
        let error = Recipe::parse(&text, &[]).unwrap_err();
        assert_eq!(error.key.as_deref(), Some(key), "{error}");
    }
}
