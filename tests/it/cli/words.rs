//! What commands say: measures of any size, ranges with their ends, and all of a scaffold.

use serde_json::{Value, json};
use std::path::Path;
use std::process::{Command, Output};

fn druse(place: &Path, line: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_druse"))
        .args(line.split(' '))
        .current_dir(place)
        .output()
        .unwrap()
}

fn output_of(place: &Path, line: &str) -> String {
    let output = druse(place, line);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{line}: {error}");
    String::from_utf8_lossy(&output.stdout).into_owned() + &error
}

fn facts(place: &Path, line: &str) -> Value {
    let output = druse(place, &format!("{line} --json"));
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{line}: {error}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A ball of radius 5 mm and a block, in metres.
const SMALL: &str = "druse = 1\nunit = \"m\"\n[band]\nvoxel_size = 0.0004\n[[op]]\nunion = { sphere = { radius = 0.005 } }\n\
    [[op]]\nunion = { box = { centre = [0.006, 0, 0], size = [0.008, 0.004, 0.004] } }\n\
    [[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.3mf\"\n";

/// The number that follows a word.
fn after<'a>(text: &'a str, word: &str) -> &'a str {
    let rest = text
        .split_once(word)
        .unwrap_or_else(|| panic!("{word:?} is not in {text}"))
        .1;
    rest.split([' ', ',', '\n']).next().unwrap()
}

#[test]
fn measures_have_four_digits_in_any_unit() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    std::fs::write(place.join("a.toml"), SMALL).unwrap();
    let summary = output_of(place, "run a.toml");
    let report = facts(place, "run a.toml");
    let (volume, area) = (&report["solid"]["volume"], &report["solid"]["area"]);
    let same = |text: &str, exact: &Value, share: f64| {
        let (shown, exact): (f64, f64) = (text.parse().unwrap(), exact.as_f64().unwrap());
        assert!((shown / exact - 1.0).abs() < share, "{text} for {exact}");
        let digits = text.split('e').next().unwrap();
        let digits = digits.replace(['.', '-'], "");
        assert_eq!(digits.trim_start_matches('0').len(), 4, "{text}");
    };
    same(after(&summary, "volume "), volume, 5e-4);
    same(after(&summary, "area "), area, 5e-4);
    assert!(summary.contains(" m^3, area ") && summary.contains(" m^2, "));
    for line in ["info a.3mf", "check a.3mf"] {
        let text = output_of(place, line);
        // The mesh is a little smaller than the level set.
        same(after(&text, "volume "), volume, 2e-2);
        same(after(&text, "area "), area, 2e-2);
        assert!(
            text.contains(" m^3, area ") && text.contains(" m^2"),
            "{text}"
        );
    }
    let filtered = output_of(place, "filter a.vdb -o b.vdb dilate=0.4mm");
    same(
        after(&filtered, "volume "),
        &facts(place, "filter a.vdb -o b.vdb dilate=0.4mm")["solid"]["volume"],
        5e-4,
    );
    let exact = facts(place, "info a.3mf")["volume"].as_f64().unwrap();
    assert!(
        format!("{exact:e}").len() > 10,
        "JSON keeps all digits: {exact:e}"
    );
}

/// A band may be left of a plate that was eroded by more than half its thickness; nothing is inside any more.
#[test]
fn a_file_of_which_nothing_is_left_is_not_written() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    let plate = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.1\n[[op]]\nunion = { box = { size = [8, 8, 1] } }\n\
                 [[output]]\nvdb = \"a.vdb\"\n";
    std::fs::write(place.join("a.toml"), plate).unwrap();
    output_of(place, "run a.toml");
    for distance in ["0.5mm", "0.55mm", "0.7mm", "0.81mm"] {
        let output = druse(place, &format!("filter a.vdb -o b.vdb erode={distance}"));
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(error.contains("the solid is empty"), "{distance}: {error}");
        assert!(!output.status.success() && !place.join("b.vdb").exists());
    }
}

#[test]
fn adaptivity_takes_both_its_ends() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    std::fs::write(place.join("a.toml"), SMALL).unwrap();
    output_of(place, "run a.toml");
    let triangles = |extra: &str| {
        output_of(place, &format!("mesh a.vdb -o b.ply{extra}"));
        facts(place, "info b.ply")["triangles"].as_u64().unwrap()
    };
    let plain = triangles("");
    assert_eq!(triangles(" --adaptivity 0"), plain, "0 merges nothing");
    let half = triangles(" --adaptivity 0.5");
    let all = triangles(" --adaptivity 1");
    assert!(all <= half && half < plain, "{all} {half} {plain}");
    for bad in ["-0.1", "1.1", "NaN"] {
        let refused = druse(place, &format!("mesh a.vdb -o c.ply --adaptivity={bad}"));
        assert_eq!(refused.status.code(), Some(2), "{bad}");
        assert!(String::from_utf8_lossy(&refused.stderr).contains("a number from 0 to 1"));
    }
    for (value, is_taken) in [("0", true), ("1", true), ("1.5", false)] {
        let text = SMALL.replace(
            "mesh = \"a.3mf\"",
            &format!("mesh = \"d.ply\"\nadaptivity = {value}"),
        );
        std::fs::write(place.join("d.toml"), text).unwrap();
        assert_eq!(
            druse(place, "run d.toml").status.success(),
            is_taken,
            "{value}"
        );
    }
    // 0 is as if it were left out: nothing of it stands against Druse's own mesher.
    output_of(place, "mesh a.vdb -o b.ply --adaptivity 0 --mesher druse");
    assert!(
        !druse(place, "mesh a.vdb -o b.ply --adaptivity 0.1 --mesher druse")
            .status
            .success()
    );
}

/// A hex and a tet beside it, a field at points and one at cells; a line and a node that no element uses.
const GRID: &str = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 10 double\n\
    0 0 0 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 1 1 1 0 1 1 3 0 0 9 9 9\nCELLS 3 17\n8 0 1 2 3 4 5 6 7\n4 1 8 2 5\n2 0 1\n\
    CELL_TYPES 3\n12\n10\n3\nPOINT_DATA 10\nVECTORS v double\n\
    0 0 1 1 0 1 2 0 1 3 0 1 4 0 1 5 0 1 6 0 1 7 0 1 8 -2 1 9 9 9\nCELL_DATA 3\nSCALARS d double 1\nLOOKUP_TABLE default\n0.5 2.5 99\n";

#[test]
fn scaffold_info_says_as_much_in_json_as_in_words() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    std::fs::write(place.join("g.vtk"), GRID).unwrap();
    let text = output_of(place, "scaffold info g.vtk");
    let all = facts(place, "scaffold info g.vtk");
    assert_eq!(all["elements"], json!({ "Hex8": 1, "Tet4": 1 }));
    assert_eq!(
        (&all["nodes"], &all["unused_nodes"], &all["skipped"]),
        (&json!(9), &json!(1), &json!(1))
    );
    assert_eq!(all["box"], json!([[0.0, 0.0, 0.0], [3.0, 1.0, 1.0]]));
    assert!((all["volume"].as_f64().unwrap() - 4.0 / 3.0).abs() < 1e-12);
    assert!(text.contains("volume 1.333\n"), "{text}");
    let fields = all["fields"].as_array().unwrap();
    let named = |name: &str| fields.iter().find(|f| f["name"] == name).unwrap();
    assert_eq!(
        (
            &named("v")["at"],
            &named("v")["components"],
            &named("v")["range"]
        ),
        (
            &json!("points"),
            &json!(3),
            &json!([[0.0, 8.0], [-2.0, 0.0], [1.0, 1.0]])
        )
    );
    assert_eq!(
        (&named("d")["at"], &named("d")["range"]),
        (&json!("cells"), &json!([[0.5, 2.5]]))
    );
    for words in [
        "field \"v\": 3 numbers at points, 0 to 8.000; -2.000 to 0; 1.000 to 1.000",
        "field \"d\": 1 number at cells, 0.5000 to 2.500",
        "1 element of lower dimension passed over",
        "1 node without an element",
    ] {
        assert!(text.contains(words), "{words:?} is not in {text}");
    }
    for key in [
        "quality",
        "curved",
        "inverted",
        "degenerate",
        "mirrored",
        "hanging",
        "components",
        "outer_faces",
        "groups",
        "warnings",
        "unit",
        "inverted_at",
        "degenerate_at",
    ] {
        assert!(all.get(key).is_some(), "{key}");
    }
    assert!(all["quality"]["element"].is_u64() && all["quality"]["worst"].is_f64());
    // Each note of the text is one of the object.
    let notes = text.lines().filter(|l| l.starts_with("note: ")).count();
    assert_eq!(all["warnings"].as_array().unwrap().len(), notes);
    // A hex with two corners exchanged is inverted; place and amount are reported in both.
    let turned = GRID.replace("8 0 1 2 3 4 5 6 7", "8 0 1 3 2 4 5 6 7");
    std::fs::write(place.join("t.vtk"), turned).unwrap();
    let text = output_of(place, "scaffold info t.vtk");
    let all = facts(place, "scaffold info t.vtk");
    let bad = [&all["inverted_at"], &all["degenerate_at"]];
    let bad = bad
        .iter()
        .find_map(|b| b.as_array().unwrap().first())
        .unwrap();
    assert_eq!(bad["kind"], "Hex8");
    let element = format!("element {} (Hex8)", bad["element"]);
    assert!(
        text.contains(&element) && text.contains(bad["at"].as_str().unwrap()),
        "{text}"
    );
}
