//! Designed cells as users combine them: members of a library that meet, a tet cell over a scaffold of tets.

use super::{Place, json, text};
use serde_json::Value;
use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::fs;

/// Frequencies of an orbit under the signed permutations of three axes.
fn orbit(k: [i64; 3]) -> BTreeSet<[i64; 3]> {
    let orders = [
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [0, 2, 1],
        [2, 1, 0],
        [1, 0, 2],
    ];
    let signed = (0..8).map(|s| [0, 1, 2].map(|a| if s >> a & 1 == 0 { 1 } else { -1 }));
    let all = signed.flat_map(|s| orders.map(|o| [0, 1, 2].map(|a| s[a] * k[o[a]])));
    all.collect()
}

/// A cell of the cube's whole group from its file, summed wave by wave.
struct Series {
    waves: Vec<(BTreeSet<[i64; 3]>, f64)>,
    level: f64,
}

impl Series {
    fn read(cell: &Value) -> Self {
        assert_eq!(cell["group"], "Oh");
        let wave = |term: &Value| {
            let k = [0, 1, 2].map(|a| term["k"][a].as_i64().unwrap());
            assert_eq!(term["c"][1], 0.0);
            (orbit(k), term["c"][0].as_f64().unwrap())
        };
        Self {
            waves: cell["coefficients"]
                .as_array()
                .unwrap()
                .iter()
                .map(wave)
                .collect(),
            level: cell["level"].as_f64().unwrap(),
        }
    }

    /// Negative in the solid.
    fn value(&self, u: [f64; 3]) -> f64 {
        let cosine = |k: &[i64; 3]| {
            let turns: f64 = (0..3).map(|a| k[a] as f64 * u[a]).sum();
            (TAU * turns).cos()
        };
        let wave =
            |(orbit, c): &(BTreeSet<[i64; 3]>, f64)| c * orbit.iter().map(cosine).sum::<f64>();
        self.waves.iter().map(wave).sum::<f64>() - self.level
    }

    /// Share of solid at the midpoints of a grid over an eighth of the period.
    fn volume_fraction(&self, n: usize) -> f64 {
        let at = |i: usize| (i as f64 + 0.5) / (2 * n) as f64;
        let inside =
            (0..n * n * n).filter(|m| self.value([m / n / n, m / n % n, m % n].map(at)) < 0.0);
        inside.count() as f64 / (n * n * n) as f64
    }
}

#[test]
fn members_of_a_library_meet_on_the_faces_and_have_their_volume_fractions() {
    let place = Place::new();
    let output = place.run(&[
        "cell",
        "library",
        "--target",
        "{ maximise = \"bulk\", starts = 1, evaluations = 6, voxels = 10 }",
        "--volume-fraction",
        "0.3:0.4:0.1",
        "--band-limit",
        "3",
        "--start",
        "schwarz_p",
        "-o",
        "family",
        "--json",
    ]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let listed = json(&output);
    let members = listed["cells"].as_array().unwrap();
    assert_eq!(members.len(), 2);
    let mut cells = Vec::new();
    for (name, fraction) in [("3000.cell", 0.3), ("4000.cell", 0.4)] {
        let file = fs::read(place.0.path().join("family").join(name)).unwrap();
        let cell = Series::read(&serde_json::from_slice(&file).unwrap());
        let found = cell.volume_fraction(24);
        assert!((found - fraction).abs() < 5e-3, "{name}: {found}");
        cells.push(cell);
    }
    let mut inside = 0.0_f64;
    for n in 0..200 {
        let t = f64::from(n) * 0.618_034;
        let [y, z] = [t.fract() - 0.5, (7.3 * t).fract() - 0.5];
        let [a, b] = [0, 1].map(|c| cells[c].value([0.5, y, z]));
        assert!((a - b).abs() < 1e-9, "{y} {z}: {a} {b}");
        let [a, b] = [0, 1].map(|c: usize| cells[c].value([0.2, y, z]));
        inside = inside.max((a - b).abs());
    }
    // The cells themselves differ.
    assert!(inside > 1e-2, "{inside:e}");
}

#[test]
fn a_library_refuses_volume_fractions_with_the_same_file() {
    let place = Place::new();
    let output = place.run(&[
        "cell",
        "library",
        "--target",
        "bulk",
        "--volume-fraction",
        "0.3:0.3002:0.00002",
        "-o",
        "family",
    ]);
    assert_eq!(output.status.code(), Some(2));
    let message = text(&output.stderr);
    assert!(
        message.contains("0.3 and 0.30002 both have the file 3000.cell"),
        "{message}"
    );
    assert!(!place.0.path().join("family").exists());
}

#[test]
fn a_designed_tet_cell_is_continuous_over_tets() {
    let place = Place::new();
    let made = place.run(&[
        "fit",
        "--target",
        "{ maximise = \"bulk\", starts = 1, evaluations = 9, voxels = 12 }",
        "--element",
        "tet",
        "--volume-fraction",
        "0.4",
        "--band-limit",
        "1.5",
        "-o",
        "a.cell",
    ]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    place.write(
        "r.toml",
        "druse = 1\n[cell.a]\nfile = \"a.cell\"\n[scaffold]\nbox = { size = [4, 5, 3], cell_size = 2, kind = \"tet\" }\n\
         [tiling]\ncell = \"a\"\ncertificate = true\n[band]\nvoxel_size = 0.1\n",
    );
    let checked = place.run(&["scaffold", "check", "r.toml", "--json"]);
    assert!(checked.status.success(), "{}", text(&checked.stderr));
    let jump = json(&checked)["continuity"]["value_jump_max"]
        .as_f64()
        .unwrap();
    assert!(jump < 1e-5, "{jump:e}");
}

#[test]
fn the_edges_around_which_no_gyroid_continues_are_written() {
    let place = Place::new();
    place.write(
        "r.toml",
        "druse = 1\n[cell.g]\nsurface = \"gyroid\"\n[scaffold]\ncylinder = { radius = 6, height = 8, cell_size = 4 }\n\
         [tiling]\ncell = \"g\"\n[band]\nvoxel_size = 0.5\n",
    );
    let checked = place.run(&["scaffold", "check", "r.toml", "-o", "edges.vtu"]);
    assert_eq!(checked.status.code(), Some(65));
    let error = text(&checked.stderr);
    // The edges of the core along the cylinder, two hexes high.
    assert!(error.contains("around 8 inner edges in 4 lines"), "{error}");
    assert!(error.contains("with 3 elements"), "{error}");
    let edges = std::fs::read(place.0.path().join("edges.vtu")).unwrap();
    let head = String::from_utf8_lossy(&edges);
    assert!(
        head.contains("NumberOfPoints=\"12\" NumberOfCells=\"8\""),
        "{head}"
    );
    let tube = "scaffold.cylinder={ radius = 8, inner_radius = 4, height = 8, cell_size = 4 }";
    let checked = place.run(&["scaffold", "check", "r.toml", "--json", "--set", tube]);
    assert!(checked.status.success(), "{}", text(&checked.stderr));
    let jump = json(&checked)["continuity"]["value_jump_max"]
        .as_f64()
        .unwrap();
    assert!(jump < 1e-5, "{jump:e}");
}
