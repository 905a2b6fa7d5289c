//! `druse cell homogenize`: its files, its refusals, its warnings.

use super::{Place, json, refuse, text};
use std::fs;

fn run(place: &Place, arguments: &[&str]) -> serde_json::Value {
    let mut all = vec!["cell", "homogenize"];
    all.extend(arguments);
    all.push("--json");
    let output = place.run(&all);
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        text(&output.stderr)
    );
    json(&output)
}

#[test]
fn a_surface_gives_every_file() {
    let place = Place::new();
    let arguments = [
        "schwarz_p",
        "--volume-fraction",
        "0.4",
        "--resolution",
        "16",
        "--gradient",
        "-o",
        "C.json",
        "--modulus",
        "E.csv",
        "--picture",
        "E.png",
    ];
    let found = run(&place, &arguments);
    assert_eq!(place.files(), ["C.json", "E.csv", "E.png"]);
    let written: serde_json::Value =
        serde_json::from_slice(&fs::read(place.0.path().join("C.json")).unwrap()).unwrap();
    assert_eq!(written["stiffness"], found["stiffness"]);
    assert!((found["volume_fraction"].as_f64().unwrap() - 0.4).abs() < 2e-3);
    for word in ["stiffness", "conductivity", "permeability"] {
        let error = found["error"][word].as_f64().unwrap();
        assert!((0.0..0.5).contains(&error), "{word}: {error}");
    }
    assert_eq!(found["gradient"].as_array().unwrap().len(), 2);
    assert_eq!(found["material"]["relative"], true);
    let table = fs::read_to_string(place.0.path().join("E.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 37 * 72);
    let along_z: f64 = table
        .lines()
        .nth(1)
        .unwrap()
        .rsplit(',')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    let young = found["engineering"]["young"][2].as_f64().unwrap();
    assert!((along_z / young - 1.0).abs() < 1e-9);
    // A material of its own scales the numbers.
    let scaled = run(
        &place,
        &[
            "schwarz_p",
            "--volume-fraction",
            "0.4",
            "--resolution",
            "16",
            "--E",
            "110e3",
            "--only",
            "stiffness",
        ],
    );
    let of = |v: &serde_json::Value| v["stiffness"][0][0].as_f64().unwrap();
    assert!((of(&scaled) / of(&found) / 110e3 - 1.0).abs() < 1e-4);
    assert!(scaled["conductivity"].is_null());
}

#[test]
fn a_sweep_is_a_table_with_a_picture() {
    let place = Place::new();
    let arguments = [
        "iwp",
        "--solid",
        "sheet",
        "--resolution",
        "12",
        "--sweep",
        "volume_fraction=0.3:0.5:0.1",
        "-o",
        "t.csv",
        "--plot",
        "t.png",
    ];
    let found = run(&place, &arguments);
    assert_eq!(place.files(), ["t.csv", "t.png"]);
    let rows = found["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 3);
    let young: Vec<f64> = rows.iter().map(|r| r["E1"].as_f64().unwrap()).collect();
    assert!(young[0] < young[1] && young[1] < young[2], "{young:?}");
    let table = fs::read_to_string(place.0.path().join("t.csv")).unwrap();
    assert!(table.starts_with("volume_fraction,level,E1,"), "{table}");
    assert!(table.lines().nth(2).unwrap().starts_with("0.4,"), "{table}");
}

/// Every voxel of a nearly solid cell holds solid, so that nothing flows and no curve has a point.
#[test]
fn a_picture_without_points_has_an_axis() {
    let place = Place::new();
    let sweep = ["--sweep", "volume_fraction=0.9995:0.9999:0.0004"];
    let wanted = ["--only", "permeability", "--plot", "t.png"];
    let cell = ["schwarz_p", "--resolution", "16"];
    run(&place, &[&cell[..], &sweep[..], &wanted[..]].concat());
    let file = fs::File::open(place.0.path().join("t.png")).unwrap();
    let mut reader = png::Decoder::new(std::io::BufReader::new(file))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    // A row between two lines across: the frame, and four lines of the grid within it.
    let row = &pixels[300 * frame.line_size..301 * frame.line_size];
    let bytes = frame.line_size / frame.width as usize;
    let marked = row.chunks_exact(bytes).filter(|p| *p != &row[..bytes]);
    assert_eq!(marked.count(), 6);
}

#[test]
fn struts_are_round_beams_in_cubes_and_tets_and_a_recipe_names_its_cells() {
    let place = Place::new();
    let cube = run(
        &place,
        &[
            "octet",
            "--volume-fraction",
            "0.3",
            "--resolution",
            "24",
            "--only",
            "stiffness",
        ],
    );
    assert!((cube["volume_fraction"].as_f64().unwrap() - 0.3).abs() < 1e-6);
    assert_eq!(cube["period"], "one cube");
    let tets = run(
        &place,
        &[
            "edges",
            "--element",
            "tet",
            "--radius",
            "0.15",
            "--tets",
            "kuhn",
            "--resolution",
            "16",
            "--only",
            "stiffness",
        ],
    );
    assert_eq!(tets["period"], "6 tets in a cube (kuhn)");
    place.write(
        "r.toml",
        "druse = 1\n[cell.net]\nsurface = \"schwarz_p\"\nvolume_fraction = 0.5\n[band]\nvoxel_size = 0.1\n[[op]]\nunion = { sphere = { radius = 1 } }\n",
    );
    let own = run(
        &place,
        &[
            "net",
            "--recipe",
            "r.toml",
            "--resolution",
            "8",
            "--only",
            "conductivity",
        ],
    );
    assert!((own["volume_fraction"].as_f64().unwrap() - 0.5).abs() < 0.01);
    let arguments = ["cell", "homogenize", "nett", "--recipe", "r.toml"];
    refuse(&place, &arguments, 65, &["no such cell", "net"]);
}

#[test]
fn wrong_arguments_are_named_with_what_is_expected() {
    let place = Place::new();
    let with = |more: &[&'static str]| -> Vec<&'static str> {
        let mut all = vec!["cell", "homogenize", "schwarz_p"];
        all.extend(more);
        all
    };
    for (more, words) in [
        (&["--E", "0"][..], &["--E", "0", "positive"][..]),
        (&["--E", "-3"], &["--E", "-3"]),
        (&["--nu", "0.5"], &["--nu", "0.5", "between -1 and 0.5"]),
        (&["--nu", "-1"], &["--nu", "-1"]),
        (&["--kappa", "0"], &["--kappa", "positive"]),
        (&["--void", "1"], &["--void", "below 1"]),
        (&["--resolution", "33"], &["33", "even number from 8"]),
        (&["--resolution", "6"], &["6", "even number from 8"]),
        (
            &["--resolution", "100000"],
            &["100000", "GB", "even number"],
        ),
        (&["-o", "x.txt"], &["x.txt", ".json or .csv"]),
        (&["--picture", "x.jpg"], &["x.jpg", ".png"]),
        (
            &["--only", "stiffness", "--gradient"],
            &["--gradient", "conductivity"],
        ),
    ] {
        refuse(&place, &with(more), 2, words);
    }
    refuse(
        &place,
        &["cell", "homogenize", "missing.cell"],
        66,
        &["missing.cell"],
    );
    refuse(
        &place,
        &["cell", "homogenize", "edges", "--element", "wedge"],
        65,
        &["wedge", "hex"],
    );
    let narrow = [
        "cell",
        "homogenize",
        "sqrt(x*x+y*y+z*z)-0.4",
        "--band-limit",
        "8",
        "--resolution",
        "8",
    ];
    refuse(
        &place,
        &narrow,
        2,
        &["frequencies", "Nyquist", "--resolution 16"],
    );
    let beams = [
        "cell",
        "homogenize",
        "octet",
        "--resolution",
        "16",
        "--gradient",
    ];
    refuse(&place, &beams, 2, &["Fourier series", "--fitted"]);
}

#[test]
fn a_solid_that_does_not_hang_together_is_a_warning() {
    let place = Place::new();
    let balls = [
        "cell",
        "homogenize",
        "schwarz_p",
        "--level",
        "-2",
        "--resolution",
        "16",
        "--only",
        "stiffness",
    ];
    let output = place.run(&balls);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let error = text(&output.stderr);
    assert!(
        error.contains("W130") && error.contains("along x, y, z"),
        "{error}"
    );
    let mut strict = balls.to_vec();
    strict.push("--strict");
    assert_eq!(place.run(&strict).status.code(), Some(65));
}
