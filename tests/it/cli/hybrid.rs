//! Hybrids and groups from the command line and in recipes.

use super::{Place, json, refuse, text};

const TILE: &str = "[scaffold]\nbox = { size = [4, 4, 4], cell_size = 4 }\n[tiling]\ncell = \"both\"\n[band]\nvoxel_size = 0.125\n";

fn palette(both: &str) -> String {
    format!(
        "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nlevel = -0.6\n[cell.w]\nsurface = \"iwp\"\nsolid = \"above\"\nlevel = 2\n[cell.both]\n{both}\n{TILE}"
    )
}

fn volume(both: &str) -> f64 {
    let place = Place::with(&palette(both));
    let output = place.run(&["run", "r.toml", "--json", "--quiet"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    json(&output)["solid"]["volume"].as_f64().unwrap()
}

#[test]
fn recipes_join_cells_of_the_palette() {
    let single = |name: &str| volume(&format!("union = [\"{name}\"]"));
    let (p, w) = (single("p"), single("w"));
    let (both, common) = (
        volume("union = [\"p\", \"w\"]"),
        volume("intersection = [\"p\", \"w\"]"),
    );
    let minus = volume("difference = [\"p\", \"w\"]");
    // |A| + |B| = |A or B| + |A and B|, |A| = |A minus B| + |A and B|, to the voxels' share.
    assert!(
        (p + w - both - common).abs() < 0.03 * both,
        "{p} {w} {both} {common}"
    );
    assert!(
        (p - minus - common).abs() < 0.04 * both,
        "{p} {minus} {common}"
    );
    assert!(volume("union = [\"p\", \"w\"]\nsmooth = 0.2") > both);
    let half =
        volume("average = [{ cell = \"p\" }, { cell = \"w\", weight = 2 }]\nvolume_fraction = 0.3");
    assert!((half / 64.0 - 0.3).abs() < 0.02, "{half}");
}

#[test]
fn wrong_hybrids_are_refused_by_name() {
    for (both, words) in [
        (
            "union = [\"p\", \"q\"]",
            &["cell.both", "\"q\"", "both, p, w"][..],
        ),
        (
            "union = [\"both\", \"p\"]",
            &["cell.both", "made of itself"],
        ),
        ("union = []", &["at least one"]),
        (
            "union = [\"p\"]\nsurface = \"iwp\"",
            &["exactly one source", "surface, union"],
        ),
        (
            "surface = \"iwp\"\nsmooth = 0.1",
            &["smooth goes with union"],
        ),
        (
            "average = [{ cell = \"p\" }]\nsmooth = 0.1",
            &["no edges to smooth"],
        ),
        (
            "surface = \"iwp\"\nenvironment = \"cell\"",
            &["environment goes with minkowski_sum"],
        ),
        (
            "minkowski_sum = [\"p\"]\nsmooth = 0.1",
            &["no edges to smooth"],
        ),
        ("average = [{ cell = \"p\", weight = 0 }]", &["positive"]),
        ("difference = [\"p\"]", &["cell.both", "at least two"]),
    ] {
        let place = Place::with(&palette(both));
        let output = place.run(&["run", "r.toml", "--quiet"]);
        let message = text(&output.stderr);
        assert!(!output.status.success(), "{both}");
        for word in words {
            assert!(message.contains(word), "{both}: {message}");
        }
    }
}

#[test]
fn fit_joins_its_input_with_other_cells() {
    let place = Place::new();
    let flags = [
        "--union",
        "iwp",
        "--smooth",
        "0.1",
        "--volume-fraction",
        "0.4",
        "-o",
        "u.cell",
    ];
    let mut all = vec!["fit", "schwarz_p"];
    all.extend(flags);
    let output = place.run(&all);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let facts = json(&place.run(&["cell", "info", "u.cell", "--json"]));
    assert_eq!(
        (&facts["group"], &facts["operators"]),
        (&"Oh".into(), &48.into())
    );
    let fraction = facts["volume_fraction"].as_f64().unwrap();
    assert!((fraction - 0.4).abs() < 1e-3, "{fraction}");
    let average = place.run(&[
        "fit",
        "u.cell",
        "--average",
        "schwarz_p=0.5",
        "-o",
        "v.cell",
    ]);
    assert!(average.status.success(), "{}", text(&average.stderr));
    refuse(
        &place,
        &["fit", "u.cell", "--average", "schwarz_p=x", "-o", "w.cell"],
        2,
        &["schwarz_p=x"],
    );
    refuse(
        &place,
        &["fit", "schwarz_p", "--union", "none.cell", "-o", "w.cell"],
        66,
        &["none.cell"],
    );
}

#[test]
fn groups_are_described() {
    let place = Place::new();
    let facts = json(&place.run(&["cell", "info", "--group", "Td", "--json"]));
    assert_eq!(facts["operators"].as_array().unwrap().len(), 24);
    assert_eq!(facts["lattice"], "fcc2");
    assert_eq!(facts["frequency_domain"], "fx >= fy >= |fz|");
    assert_eq!(facts["elements"], serde_json::json!(["tet", "hex"]));
    place.write("brick.group", "name D2 # no mirrors\n-x,-y,z\nx,-y,-z\n");
    let facts = json(&place.run(&["cell", "info", "--group", "brick.group", "--json"]));
    assert_eq!(
        (&facts["group"], &facts["lattice"]),
        (&"D2".into(), &"cubic".into())
    );
    assert_eq!(facts["operators"].as_array().unwrap().len(), 4);
    assert_eq!(facts["elements"], serde_json::json!(["tet", "hex"]));
    // With a lattice of its own the file's operators are listed on the one of the flag, as in a fit.
    place.write("cubic.group", "lattice cubic\ny,z,x\n");
    let line = ["cell", "info", "--group", "cubic.group", "--lattice"];
    let facts = json(&place.run(&[&line[..], &["fcc2", "--json"]].concat()));
    assert_eq!(facts["lattice"], "fcc2");
    for group in [
        "D3", "D4", "D3h", "C4v", "D2h", "D4h", "T", "Th", "O", "C3v", "C1", "Oh",
    ] {
        let output = place.run(&["cell", "info", "--group", group]);
        assert!(output.status.success(), "{group}: {}", text(&output.stderr));
    }
    place.write("shear.group", "x,y,z\nx+y,y,z\n");
    let arguments = ["cell", "info", "--group", "shear.group"];
    refuse(&place, &arguments, 65, &["shear.group", "2", "infinite"]);
    refuse(
        &place,
        &["cell", "info", "--group", "D5"],
        2,
        &["D5", "known"],
    );
    refuse(
        &place,
        &["cell", "info", "--group", "D3", "--lattice", "cubic"],
        2,
        &["D3"],
    );
}

#[test]
fn cells_get_groups_from_files_and_planar_ones_are_evaluated_in_the_plane() {
    let place = Place::new();
    place.write("turns.group", "lattice cubic\n-x,-y,z # about z\nx,-y,-z\n");
    let arguments = [
        "fit",
        "hypot(x - 0.1, y) - 0.2 + 0.1 * z",
        "--group",
        "turns.group",
        "--band-limit",
        "2",
        "-o",
        "t.cell",
    ];
    let output = place.run(&arguments);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let facts = json(&place.run(&["cell", "info", "t.cell", "--json"]));
    assert_eq!(
        (&facts["group"], &facts["operators"]),
        (&"turns".into(), &4.into())
    );
    assert_eq!(facts["any_numbering"], false);
    let planar = [
        "fit",
        "hypot(x, y) - 0.3",
        "--element",
        "quad",
        "--band-limit",
        "4",
        "-o",
        "q.cell",
    ];
    let output = place.run(&planar);
    assert!(output.status.success(), "{}", text(&output.stderr));
    place.write("p.csv", "x,y\n0.1,0.2\n");
    let output = place.run(&["cell", "eval", "q.cell", "--points", "p.csv"]);
    let table = text(&output.stdout);
    assert!(table.starts_with("x,y,phi,gx,gy\n0.1,0.2,-0.0"), "{table}");
    refuse(
        &place,
        &["cell", "eval", "t.cell", "--points", "p.csv"],
        65,
        &["x,y,z"],
    );
}

#[test]
fn fit_grows_and_erodes_its_input_by_another_cell() {
    let place = Place::new();
    let ball = |radius: &str| format!("sqrt(x^2 + y^2 + z^2) - {radius}");
    let fit = |input: &str, more: &[&str]| {
        let mut all = vec!["fit", input, "--element", "hex", "--band-limit", "4"];
        all.extend(more);
        let output = place.run(&all);
        assert!(output.status.success(), "{}", text(&output.stderr));
    };
    fit(&ball("0.1"), &["-o", "small.cell"]);
    for (flag, radius) in [
        ("--minkowski-sum", 0.35f64),
        ("--minkowski-difference", 0.15),
    ] {
        fit(&ball("0.25"), &[flag, "small.cell", "-o", "x.cell"]);
        let facts = json(&place.run(&["cell", "info", "x.cell", "--json"]));
        let fraction = facts["volume_fraction"].as_f64().unwrap();
        let exact = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        assert!(
            (fraction / exact - 1.0).abs() < 0.15,
            "{flag}: {fraction} {exact}"
        );
    }
}
