//! Cells from the command line: every kind of input, every way to be wrong, cells that stand alone.

use super::{Place, json, refuse, text};
use std::fmt::Write;

/// Struts along the axes of order 5 of the icosahedron.
const STAR: &str = "nodes = [[0,0,0],[0,0.26,0.42068884],[0,-0.26,-0.42068884],[0,-0.26,0.42068884],\
[0,0.26,-0.42068884],[0.42068884,0,0.26],[-0.42068884,0,-0.26],[0.42068884,0,-0.26],[-0.42068884,0,0.26],\
[0.26,0.42068884,0],[-0.26,-0.42068884,0],[-0.26,0.42068884,0],[0.26,-0.42068884,0]]\n\
edges = [[0,1],[0,2],[0,3],[0,4],[0,5],[0,6],[0,7],[0,8],[0,9],[0,10],[0,11],[0,12]]\nradius = 0.09\n";

/// The text of triangles as STL.
fn stl(triangles: &[[[f64; 3]; 3]]) -> String {
    let mut text = "solid x\n".to_owned();
    for t in triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in t {
            let _ = writeln!(text, "vertex {x} {y} {z}");
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid x\n"
}

/// A tetrahedron of edge about `size` about a point.
fn tetrahedron(centre: f64, size: f64) -> [[[f64; 3]; 3]; 4] {
    let corners = [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]];
    let at = corners.map(|c| c.map(|x: f64| centre + x * size));
    [[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]].map(|t| t.map(|i: usize| at[i]))
}

/// A .npy of doubles over N^3 points of the period: the distance to a ball.
fn npy(n: usize, damaged: bool) -> Vec<u8> {
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({n}, {n}, {n}), }}");
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    bytes.extend(format!("{header:117}\n").into_bytes());
    for i in 0..n * n * n {
        let x = [i / (n * n), i / n % n, i % n].map(|j| j as f64 / n as f64 - 0.5);
        let value = x.iter().map(|c| c * c).sum::<f64>().sqrt() - 0.3;
        let lost = damaged && i == n + 2;
        bytes.extend(if lost { f64::NAN } else { value }.to_le_bytes());
    }
    bytes
}

#[test]
fn bad_input_is_named_and_leaves_nothing() {
    let place = Place::new();
    place.write("empty.stl", stl(&[]));
    place.write(
        "flat.stl",
        stl(&[[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]]),
    );
    let mut odd = tetrahedron(0.0, 0.3);
    odd[2][1][0] = f64::NAN;
    place.write("nan.stl", stl(&odd));
    place.write("far.stl", stl(&tetrahedron(7.0, 0.3)));
    place.write("huge.stl", stl(&tetrahedron(1e30, 1e30)));
    place.write("ok.stl", stl(&tetrahedron(0.0, 0.3)));
    place.write("nan.npy", npy(8, true));
    place.write("ball.npy", npy(16, false));
    let hostile = "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999, 99999999, 9999), }";
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    bytes.extend(format!("{hostile:117}\n").into_bytes());
    place.write("hostile.npy", bytes);
    place.write("infinite.txt", "x+y,y,z\n-y,x,z\n");
    let gyroid = "sin(2*pi*x)*cos(2*pi*y)+sin(2*pi*y)*cos(2*pi*z)+sin(2*pi*z)*cos(2*pi*x)";
    let rows: [(&[&str], &[&str]); 17] = [
        (&["empty.stl"], &["no triangles", "empty.stl"]),
        (&["flat.stl"], &["bounds no solid"]),
        (&["nan.stl"], &["NaN"]),
        (
            &["far.stl"],
            &[
                "nothing solid inside the hex",
                "[6.7, 6.7, 6.7]",
                "[-0.5, -0.5, -0.5]",
            ],
        ),
        (&["huge.stl"], &["huge.stl:4", "below 1e18"]),
        (&["nan.npy"], &["voxel [0, 1, 2] is NaN"]),
        (&["hostile.npy"], &["99999999", "expected"]),
        (
            &["ball.npy", "--method", "fft", "--band-limit", "12"],
            &["16 samples", "at least 25 samples"],
        ),
        (
            &["ball.npy", "--band-limit", "20"],
            &["too few", "at least 41"],
        ),
        (
            &["ok.stl", "--band-limit", "500"],
            &["unknowns", "band limit below"],
        ),
        (
            &["ok.stl", "--element", "tet", "--group", "D4h"],
            &["cannot have group \"D4h\"", "Td"],
        ),
        (&["ok.stl", "--group", "infinite.txt"], &["infinite"]),
        (
            &["ok.stl", "--group", "Ih", "--element", "hex"],
            &["Ih", "ball"],
        ),
        (&["ok.stl", "--group", "Ih", "--face-normal"], &["no faces"]),
        (
            &[gyroid],
            &[
                "no part with the symmetry Oh",
                "of its energy",
                "a smaller group",
            ],
        ),
        (&["gyroid", "--element", "tet"], &["gyroid", "hexes"]),
        (&["ok.stl", "--level", "0.2", "--thickness", "-1"], &["-1"]),
    ];
    for (arguments, words) in rows {
        let mut all = vec!["fit"];
        all.extend(arguments);
        all.extend(["-o", "x.cell"]);
        let code = if words.contains(&"-1") { 2 } else { 65 };
        refuse(&place, &all, code, words);
    }
    let arguments = ["fit", "schwarz_q", "-o", "x.cell"];
    refuse(
        &place,
        &arguments,
        66,
        &["did you mean \"schwarz_p\"?", "strut graph"],
    );
    let arguments = ["fit", "octt", "-o", "x.cell"];
    refuse(&place, &arguments, 66, &["did you mean \"octet\"?"]);
}

#[test]
fn malformed_cells_name_line_and_key() {
    let place = Place::new();
    let output = place.run(&["fit", "schwarz_p", "-o", "p.cell"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let good = std::fs::read_to_string(place.0.path().join("p.cell")).unwrap();
    for (from, to, words) in [
        ("\"group\": \"Oh\"", "\"group\": \"Oo\"", ["m.cell:4", "Oo"]),
        ("\"coefficients\"", "\"coeffs\"", ["m.cell:6", "coeffs"]),
        (
            "\"version\": 1",
            "\"version\": 7",
            ["m.cell:2", "version 7"],
        ),
        (
            "\"solid\": \"below\"",
            "\"solid\": \"beneath\"",
            ["m.cell:", "beneath"],
        ),
        (
            "\"k\": [1, 0, 0]",
            "\"k\": [1, 0]",
            ["m.cell:7", "2 indices"],
        ),
        (
            "\"k\": [1, 0, 0]",
            "\"k\": [999999999, 0, 0]",
            ["m.cell:7", "4096"],
        ),
        (
            "\"element\": \"hex\"",
            "\"element\": \"ball\"",
            ["m.cell:5", "6 vectors"],
        ),
    ] {
        assert!(good.contains(from), "{from} in {good}");
        place.write("m.cell", good.replacen(from, to, 1));
        refuse(&place, &["cell", "info", "m.cell"], 65, &words);
    }
    place.write("m.cell", &good[..good.len() / 2]);
    refuse(&place, &["cell", "info", "m.cell"], 65, &["m.cell:"]);
}

#[test]
fn voxels_of_either_kind_are_the_ball_they_hold() {
    let place = Place::with(
        "druse = 1\n[band]\nvoxel_size = 0.025\n[[op]]\nunion = { sphere = { radius = 0.3 } }\n[[output]]\nvdb = \"s.vdb\"\nunit = \"mm\"\n",
    );
    let output = place.run(&["run", "r.toml", "--quiet"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    place.write("ball.npy", npy(20, false));
    let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.027;
    let all = [
        &["s.vdb", "--element", "hex"][..],
        &["ball.npy", "--method", "fft"],
        &["ball.npy"],
    ];
    let tried = if crate::is_full() { 3 } else { 2 };
    for input in all.into_iter().take(tried) {
        let mut all = vec!["fit"];
        all.extend(input);
        all.extend(["-o", "x.cell", "--json"]);
        let facts = json(&place.run(&all));
        let share = facts["volume_fraction"].as_f64().unwrap();
        assert!((share / exact - 1.0).abs() < 0.02, "{input:?}: {share}");
        let method = if input.contains(&"fft") { "fft" } else { "lsq" };
        assert_eq!(facts["report"]["method"], method, "{input:?}");
        let far = facts["report"]["hausdorff"]["cell_to_source"]
            .as_f64()
            .unwrap();
        assert!(far < 0.01, "{input:?}: {far}");
    }
}

#[test]
fn a_tolerance_raises_the_band_until_the_surfaces_meet() {
    let place = Place::new();
    let fit = |tolerance: &str, most: &str| {
        let formula = "hypot(x, y, z) - 0.3";
        json(&place.run(&[
            "fit",
            formula,
            "--tolerance",
            tolerance,
            "--band-limit",
            most,
            "-o",
            "x.cell",
            "--json",
        ]))
    };
    let far = |facts: &serde_json::Value| {
        let h = &facts["report"]["hausdorff"];
        let side = |key: &str| h[key].as_f64().unwrap();
        side("cell_to_source").max(side("source_to_cell"))
    };
    let band = |facts: &serde_json::Value| facts["report"]["band_limit"].as_f64().unwrap();
    let (coarse, fine) = (fit("0.02", "14"), fit("0.004", "14"));
    assert!(
        far(&coarse) <= 0.02 && far(&fine) <= 0.004,
        "{coarse} {fine}"
    );
    assert!(
        band(&coarse) < band(&fine),
        "{} {}",
        band(&coarse),
        band(&fine)
    );
    // A band limit that cannot meet it is reported with the error reached.
    let output = place.run(&[
        "fit",
        "hypot(x, y, z) - 0.3",
        "--tolerance",
        "0.0001",
        "--band-limit",
        "5",
        "-o",
        "x.cell",
    ]);
    let error = text(&output.stderr);
    assert!(
        output.status.success() && error.contains("the tolerance was 0.0001"),
        "{error}"
    );
}

#[test]
fn groups_are_listed_with_operators_orbits_and_domain() {
    let place = Place::new();
    let beyond = ["cell", "info", "--group", "Td", "--band-limit", "17"];
    refuse(&place, &beyond, 2, &["--band-limit", "17", "0 to 16"]);
    for (group, order, domain) in [
        ("Td", 24, "fx >= fy >= |fz|"),
        ("D3", 6, "k1 >= k2 >= 0"),
        ("Ih", 120, "fx, fy >= 0, fz >= t (t fx + fy) with t = 1.618"),
    ] {
        let facts = json(&place.run(&["cell", "info", "--group", group, "--json"]));
        assert_eq!(facts["operators"].as_array().unwrap().len(), order);
        assert_eq!(facts["frequency_domain"], domain);
        let orbits = facts["orbits"].as_array().unwrap();
        assert_eq!(facts["degrees_of_freedom"], orbits.len(), "{group}");
        let printed = text(&place.run(&["cell", "info", "--group", group]).stdout);
        assert!(printed.contains(domain) && printed.contains(&format!("{order} operators")));
    }
}

#[test]
fn icosahedral_cells_stand_alone() {
    let place = Place::new();
    place.write("star.toml", STAR);
    let fit = [
        "fit",
        "star.toml",
        "--group",
        "Ih",
        "--band-limit",
        "6",
        "-o",
        "star.cell",
        "--json",
    ];
    let facts = json(&place.run(&fit));
    assert_eq!(
        (&facts["element"], &facts["group"]),
        (&"ball".into(), &"Ih".into())
    );
    let share = facts["volume_fraction"].as_f64().unwrap();
    let info = json(&place.run(&["cell", "info", "star.cell", "--json"]));
    assert_eq!(info["volume_fraction"], facts["volume_fraction"]);
    // Values at a point and at its image under a turn of 72 degrees about (0, 1, t).
    let t = f64::midpoint(1.0, 5f64.sqrt());
    let axis = nalgebra::Unit::new_normalize(nalgebra::Vector3::new(0.0, 1.0, t));
    let turn = nalgebra::Rotation3::from_axis_angle(&axis, std::f64::consts::TAU / 5.0);
    let p = nalgebra::Vector3::new(0.11, 0.23, -0.07);
    let q = turn * p;
    place.write(
        "p.csv",
        format!("x,y,z\n{},{},{}\n{},{},{}\n", p.x, p.y, p.z, q.x, q.y, q.z),
    );
    let printed = text(
        &place
            .run(&["cell", "eval", "star.cell", "--points", "p.csv"])
            .stdout,
    );
    let phi: Vec<f64> = printed
        .lines()
        .skip(1)
        .map(|l| l.split(',').nth(3).unwrap().parse().unwrap())
        .collect();
    assert!((phi[0] - phi[1]).abs() < 1e-12, "{phi:?}");
    let plot = [
        "cell",
        "plot",
        "star.cell",
        "-o",
        "s.png",
        "--source",
        "star.toml",
        "--json",
    ];
    assert!(json(&place.run(&plot))["bytes"].as_u64().unwrap() > 10_000);
    let preview = ["preview", "star.cell", "-o", "p.png", "--size", "80x60"];
    assert!(place.run(&preview).status.success());

    let head = "druse = 1\n[cell.star]\nfile = \"star.cell\"\n[band]\nvoxel_size = 0.25\n";
    let op = "[[op]]\nunion = { cell = { name = \"star\", size = 10, centre = [1, 2, 3] } }\n";
    place.write("alone.toml", format!("{head}{op}"));
    let report = json(&place.run(&["run", "alone.toml", "--json", "--quiet"]));
    let volume = report["solid"]["volume"].as_f64().unwrap();
    let wanted = share * std::f64::consts::PI / 6.0 * 1000.0;
    assert!((volume / wanted - 1.0).abs() < 0.03, "{volume} {wanted}");
    let middle: Vec<f64> = (0..3)
        .map(|a| {
            let end = |side: usize| report["solid"]["box"][side][a].as_f64().unwrap();
            f64::midpoint(end(0), end(1))
        })
        .collect();
    assert!(
        middle
            .iter()
            .zip([1.0, 2.0, 3.0])
            .all(|(m, c)| (m - c).abs() < 0.1),
        "{middle:?}"
    );

    let tile = "[scaffold]\nbox = { size = [4, 4, 4], cell_size = 2 }\n[tiling]\ncell = \"star\"\n";
    place.write("tiled.toml", format!("{head}{tile}"));
    refuse(
        &place,
        &["run", "tiled.toml"],
        65,
        &["no lattice in space", "stand alone"],
    );
    place.write(
        "unknown.toml",
        format!("{head}{}", op.replace("\"star\"", "\"stra\"")),
    );
    refuse(
        &place,
        &["run", "unknown.toml"],
        65,
        &["op.0.union.cell.name", "did you mean \"star\""],
    );
}
