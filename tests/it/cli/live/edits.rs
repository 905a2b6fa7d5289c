//! Changes of a recipe that move operations and add keys.

use super::{Place, RECIPE, Served};
use serde_json::{Value, json};

#[test]
fn operations_change_places_and_keys_are_added() {
    let place = Place::with(RECIPE);
    let served = Served::new(&place, &["view", "r.toml"]);
    let controls: Value = serde_json::from_slice(&served.get("controls").1).unwrap();
    let list = controls["controls"].as_array().unwrap();
    // Operations change places with their values; a key that the recipe lacks comes after the header of its section.
    let changed = |sent: Value| {
        let (status, body) = served.post("set", &sent.to_string());
        let text = if status == 200 {
            served.get("recipe").1
        } else {
            body
        };
        (status, String::from_utf8(text).unwrap())
    };
    let values = json!({ "op.1.subtract.capsule.radius": 1 });
    let (_, text) = changed(json!({ "values": values, "order": [1, 0] }));
    let [subtract, union] = ["subtract", "union"].map(|op| text.find(op).unwrap());
    assert!(subtract < union && text.contains("\"1mm\""), "{text}");
    served.at_rest();
    let absent = list.iter().find(|c| c["key"] == "band.half_width").unwrap();
    assert_eq!(
        [&absent["value"], &absent["first"]],
        [&Value::Null, &json!(3.0)]
    );
    let (_, text) = changed(json!({ "values": { "band.half_width": 4 } }));
    assert!(text.contains("[band]\nhalf_width = 4\n"), "{text}");
    assert_eq!(served.at_rest()["error"], Value::Null);
    let (status, text) = changed(json!({ "order": [0, 2] }));
    assert!(status == 422 && text.contains("each of 2 once"), "{text}");
    served.quit();
}

/// A wall of one and a half voxels of the first step, smoothed by a voxel of the recipe.
const WALL: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.1\n\
    [[op]]\nunion = { box = { size = [60, 60, 60] } }\n[[op]]\nhollow = { thickness = 1.2 }\n\
    [[op]]\ngaussian = 1\n[[op]]\nkeep_largest = true\n[[output]]\nvdb = \"wall.vdb\"\n";

#[test]
fn coarse_steps_leave_out_what_would_erase_walls() {
    let place = Place::with(WALL);
    let served = Served::new(&place, &["view", "r.toml", "--no-thickness"]);
    let state = served.until(|state| state["number"].as_u64().unwrap() > 0);
    assert_eq!(state["result"]["step"], 1, "{state}");
    assert!(
        state["result"]["voxelSize"].as_f64().unwrap() > 0.5,
        "{state}"
    );
    let exact = 60f64.powi(3) - 57.6f64.powi(3);
    let found = served.volume();
    assert!((found / exact - 1.0).abs() < 0.3, "{found} {exact}");
    served.quit();
}

/// A sheet in 64 hexes of 5 mm.
const TILED: &str = "druse = 1\nunit = \"mm\"\n[cell.c]\nsurface = \"schwarz_p\"\n[scaffold]\n\
    box = { size = [20, 20, 20], cell_size = 5 }\n[tiling]\ncell = \"c\"\nthickness = 0.8\n\
    [band]\nvoxel_size = 0.1\n[[output]]\nvdb = \"tiled.vdb\"\n";

#[test]
fn the_scaffold_is_shown_before_the_first_step() {
    let place = Place::with(TILED);
    let served = Served::new(&place, &["view", "r.toml", "--no-thickness"]);
    let first = served.until(|state| state["number"].as_u64().unwrap() > 0);
    if first["number"] == 1 {
        assert_eq!(first["result"]["shows"], "scaffold", "{first}");
    }
    // The scaffold and each step are one result; later changes do not show the scaffold again.
    let made = served.at_rest();
    let step = made["result"]["step"].as_u64().unwrap();
    assert_eq!(made["number"].as_u64(), Some(step + 1), "{made}");
    served.post(
        "set",
        &json!({ "values": { "tiling.thickness": 1 } }).to_string(),
    );
    let changed = served.at_rest();
    let steps = changed["result"]["step"].as_u64().unwrap();
    assert_eq!(
        changed["number"].as_u64(),
        Some(step + 1 + steps),
        "{changed}"
    );
    assert_eq!(changed["error"], Value::Null);
    served.quit();
}

/// A column in each of 8 hexes, along a direction.
const DIRECTED: &str = "druse = 1\nunit = \"mm\"\n[cell.c]\nsurface = \"gyroid\"\n[scaffold]\n\
    box = { size = [8, 8, 8], cell_size = 4 }\n[tiling]\ncell = \"c\"\n\
    orient = { toward = [\"x + 1\", 0, 0], mismatch = \"blend\", width = 0.4 }\n\
    [band]\nvoxel_size = 0.2\n[[output]]\nvdb = \"a.vdb\"\n";

#[test]
fn directions_of_cells_are_shown_and_changed() {
    let place = Place::with(DIRECTED);
    let served = Served::new(&place, &["view", "r.toml", "--no-thickness"]);
    served.at_rest();
    let controls: Value = serde_json::from_slice(&served.get("controls").1).unwrap();
    let list = controls["controls"].as_array().unwrap();
    let control = |key: &str| {
        list.iter()
            .find(|c| c["key"] == format!("tiling.orient.{key}"))
    };
    let kind = |key: &str| control(key).unwrap()["kind"].as_str().unwrap();
    assert_eq!(
        ["toward.0", "toward.1", "mismatch", "width"].map(kind),
        ["formula", "number", "word", "number"]
    );
    assert_eq!(
        control("mismatch").unwrap()["choices"],
        json!(["error", "blend"])
    );
    let set = |values: Value| {
        served
            .post("set", &json!({ "values": values }).to_string())
            .0
    };
    let values = json!({
        "tiling.orient.toward.0": "0 * x", "tiling.orient.toward.2": 1, "tiling.orient.width": 0.8,
    });
    assert_eq!(set(values), 200);
    let text = String::from_utf8(served.get("recipe").1).unwrap();
    let expected = "{ toward = [\"0 * x\", 0, 1], mismatch = \"blend\", width = 0.8 }";
    assert!(text.contains(expected), "{text}");
    let state = served.at_rest();
    assert_eq!(state["error"], Value::Null, "{state}");
    // A direction without length is reported beside its key.
    assert_eq!(set(json!({ "tiling.orient.toward.0": "0 * x" })), 200);
    let state = served.at_rest();
    assert!(state["error"].to_string().contains("length 0"), "{state}");
    assert!(
        state.to_string().contains("\"tiling.orient.toward\""),
        "{state}"
    );
    served.quit();
}

/// A formula over three lines, with an operation after it.
const LONG: &str = "druse = 1\nunit = \"mm\"\n[cell.c]\nsurface = \"schwarz_p\"\n[scaffold]\n\
    box = { size = [4, 4, 4], cell_size = 4 }\n[tiling]\ncell = \"c\"\n\
    volume_fraction = \"\"\"\n\\\n0.3 + 0.1*bx\"\"\"\n[band]\nvoxel_size = 0.2\n\
    [[op]]\nkeep_largest = true\n[[output]]\nvdb = \"a.vdb\"\n";

#[test]
fn a_formula_over_several_lines_keeps_them() {
    let place = Place::with(LONG);
    let served = Served::new(&place, &["view", "r.toml", "--no-thickness"]);
    let values = json!({ "tiling.volume_fraction": "0.4 + 0.1*bx" });
    let (status, body) = served.post("set", &json!({ "values": values, "off": [0] }).to_string());
    assert_eq!(status, 200, "{}", String::from_utf8_lossy(&body));
    let text = String::from_utf8(served.get("recipe").1).unwrap();
    let expected = LONG
        .replace("0.3 +", "0.4 +")
        .replace("[[op]]\nkeep", "# [[op]]\n# keep");
    assert_eq!(text, expected);
    assert_eq!(served.at_rest()["error"], Value::Null);
    served.quit();
}
