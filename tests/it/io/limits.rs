//! Numbers that are too large to compute with: every format refuses them, with the place.

use super::file;
use druse::cell::Cell;
use druse::frame::{Element, Vec3};
use druse::io::{read_mesh, read_points, read_skeleton};
use druse::mesh::TriMesh;

/// Numbers that no coordinate may be.
const OUTSIDE: [&str; 7] = ["1e18", "-1e18", "1e30", "1e308", "-1e308", "inf", "nan"];

/// A tetrahedron with `x` as one coordinate, by format, and what the message names as its place.
fn meshes(x: &str) -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let corners = [
        format!("{x} 0 0"),
        "1 0 0".into(),
        "0 1 0".into(),
        "0 0 1".into(),
    ];
    let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    let rows = |head: &str, shift: usize, first: &str| -> String {
        let vertices = corners.iter().map(|c| format!("{head}{c}\n"));
        let triangle = |f: &[usize; 3]| {
            format!(
                "{first} {} {} {}\n",
                f[0] + shift,
                f[1] + shift,
                f[2] + shift
            )
        };
        vertices.chain(faces.iter().map(triangle)).collect()
    };
    let facet = |f: &[usize; 3]| {
        let loops = f.map(|n| format!("vertex {}\n", corners[n])).concat();
        format!("facet normal 0 0 0\nouter loop\n{loops}endloop\nendfacet\n")
    };
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
         element face 4\nproperty list uchar int vertex_indices\nend_header\n{}",
        rows("", 0, "3")
    );
    let stl: String = faces.iter().map(facet).collect();
    let mut all = vec![
        ("a.obj", rows("v ", 1, "f").into_bytes(), "line 1"),
        (
            "a.off",
            format!("OFF\n4 4 0\n{}", rows("", 0, "3")).into_bytes(),
            "line 3",
        ),
        ("a.ply", ply.into_bytes(), "line 10"),
        (
            "a.stl",
            format!("solid a\n{stl}endsolid a\n").into_bytes(),
            "line 4",
        ),
    ];
    let mut binary = vec![0; 80];
    binary.extend(4u32.to_le_bytes());
    for f in faces {
        binary.extend([0; 12]);
        for n in f {
            let numbers = corners[n]
                .split(' ')
                .map(|w| w.parse::<f64>().unwrap() as f32);
            binary.extend(numbers.flat_map(f32::to_le_bytes));
        }
        binary.extend([0; 2]);
    }
    all.push(("b.stl", binary, "triangle 1"));
    all
}

#[test]
fn meshes_refuse_coordinates_beyond_the_limit() {
    let place = tempfile::tempdir().unwrap();
    for (name, content, _) in meshes("-9e17") {
        let read = read_mesh(file(&place, name, content));
        assert!(read.is_ok(), "{name}: {:?}", read.err());
    }
    for x in OUTSIDE {
        for (name, content, at) in meshes(x) {
            // In single precision 1e18 is a little less.
            if name == "b.stl" && x.ends_with("1e18") {
                continue;
            }
            let message = read_mesh(file(&place, name, content))
                .unwrap_err()
                .to_string();
            assert!(
                message.contains(at) && message.contains("1e18"),
                "{name} {x}: {message}"
            );
        }
    }
    let far = vec![Vec3::new(1e18, 0.0, 0.0), Vec3::x(), Vec3::y()];
    assert!(TriMesh::new(far, vec![[0, 1, 2]]).is_err());
}

#[test]
fn points_and_graphs_refuse_numbers_beyond_the_limit() {
    let place = tempfile::tempdir().unwrap();
    let classes = "x,y,z,nx,ny,nz,class\n0,0,0,0,0,1,wall\n".to_owned();
    let message = read_points(file(&place, "p.csv", classes)).unwrap_err();
    assert!(message.hint().unwrap().contains("columns of words"));
    for x in OUTSIDE {
        let points = file(&place, "p.xyz", format!("0 0 0 0 0 1\n{x} 0 0 0 0 1\n"));
        let message = read_points(points).unwrap_err().to_string();
        assert!(
            message.contains("line 2") && message.contains("1e18"),
            "{x}: {message}"
        );
        // JSON has no infinity.
        if x.contains('n') {
            continue;
        }
        for graph in [
            format!("{{\"nodes\": [[0,0,0],[{x},0,0]], \"edges\": [[0,1]], \"radius\": 0.1}}"),
            format!("{{\"nodes\": [[0,0,0],[1,0,0]], \"edges\": [[0,1]], \"radius\": {x}}}"),
            format!("{{\"nodes\": [[0,0,0],[1,0,0]], \"edges\": [[0,1]], \"radii\": [{x}]}}"),
        ] {
            let message = read_skeleton(file(&place, "g.json", &graph), None, None);
            let message = message.unwrap_err().to_string();
            assert!(
                message.contains("edge 0") && message.contains("1e18"),
                "{graph}: {message}"
            );
        }
    }
}

#[test]
fn cells_refuse_numbers_beyond_the_limit() {
    let cell = druse::cell::Surface::SchwarzP.cell(Element::Hex).unwrap();
    let text = cell.to_json();
    let coefficient = &text[text.find("\"c\": [").unwrap() + 6..];
    let coefficient = &coefficient[..coefficient.find(',').unwrap()];
    let level = &text[text.find("\"level\": ").unwrap()..];
    let level = &level[..level.find(',').unwrap()];
    for x in ["1e18", "-1e18", "1e308"] {
        for (from, to) in [
            (format!("[{coefficient},"), format!("[{x},")),
            (level.to_owned(), format!("\"level\": {x}")),
        ] {
            let changed = text.replacen(&from, &to, 1);
            assert_ne!(changed, text);
            let error = Cell::from_json(&changed).unwrap_err();
            assert!(
                error.line.is_some() && error.reason.contains("1e18"),
                "{to}: {error}"
            );
        }
    }
}

/// Searches for levels multiply values, whose products must not underflow.
#[test]
fn cells_refuse_a_function_that_is_almost_constant() {
    let text = druse::cell::Surface::SchwarzP
        .cell(Element::Hex)
        .unwrap()
        .to_json();
    let coefficient = &text[text.find("\"c\": [").unwrap() + 6..];
    let coefficient = &coefficient[..coefficient.find(',').unwrap()];
    let series = &text[text.find("\"group\"").unwrap()..text.find("\"level\"").unwrap()];
    let series = series.trim_end().trim_end_matches(',');
    for (x, fits) in [
        ("1e-307", false),
        ("1e-308", false),
        ("1e-160", false),
        ("1e-99", true),
    ] {
        let by_coefficient = text.replacen(&format!("[{coefficient},"), &format!("[{x},"), 1);
        let sum = format!(
            "\"expression\": {{\"sum\": [{{\"weight\": {x}, \"part\": {{\"series\": {{{series}}}}}}}]}}"
        );
        let by_weight = text.replacen(series, &sum, 1);
        for changed in [by_coefficient, by_weight] {
            assert_ne!(changed, text);
            let read = Cell::from_json(&changed);
            assert_eq!(read.is_ok(), fits, "{x}: {read:?}");
            if let Err(error) = read {
                let has_place = error.line.is_some();
                assert!(
                    has_place && error.reason.contains("at least 1e-100"),
                    "{x}: {error}"
                );
            }
        }
    }
}
