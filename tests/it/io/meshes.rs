//! Meshes as other programs write them: every format and dialect, through one loader, in every role.

use super::cubes::{DIALECTS, binary_stl, cubes, obj, reads_as_cube, stl, surface};
use super::{failure, file, read};
use druse::io::{read_mesh, read_polymesh};
use druse::mesh::check;
use druse::polymesh::LoadOptions;
use druse::scaffold::Kind;
use std::path::{Path, PathBuf};

fn dialect(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/dialects")
        .join(name)
}

/// The cube of 10 in each role that the library knows.
fn is_cube(path: &Path) {
    let name = path.display();
    let mesh = read_mesh(path).unwrap_or_else(|e| panic!("{e}")).mesh;
    let errors = [mesh.volume() - 1000.0, mesh.area() - 600.0];
    assert!(errors.iter().all(|e| e.abs() < 1e-9), "{name}: {errors:?}");
    assert_eq!(
        (mesh.triangles().len(), mesh.vertices().len()),
        (12, 8),
        "{name}"
    );
    assert!(check(&mesh).is_sound(), "{name}");
    let polygons = read_polymesh(path, &LoadOptions::default()).unwrap().mesh;
    assert!(
        (polygons.volume() - 1000.0).abs() < 1e-9 && polygons.euler() == 2,
        "{name}"
    );
    if path.ends_with("solid.vtu") {
        return;
    }
    let surface = surface(path).surface;
    let scaffold = surface.shell(1.0).unwrap();
    let volume: f64 = scaffold.elements().map(|e| e.volume()).sum();
    // Walls of 1 at the edges too, half to each side.
    let exact = 11f64.powi(3) - 9f64.powi(3);
    assert!((volume / exact - 1.0).abs() < 0.01, "{name}: {volume}");
    assert_eq!(scaffold.components().len(), 1, "{name}");
}

#[test]
fn every_format_serves_in_every_role() {
    let directory = tempfile::tempdir().unwrap();
    for (name, bytes) in cubes() {
        is_cube(&file(&directory, name, bytes));
    }
    for name in DIALECTS {
        is_cube(&dialect(name));
    }
}

#[test]
fn line_ends_and_marks_of_every_editor_are_read() {
    let directory = tempfile::tempdir().unwrap();
    for (name, bytes) in cubes() {
        let Ok(text) = String::from_utf8(bytes) else {
            continue;
        };
        if name == "binary.stl" {
            continue;
        }
        for (change, ends) in [
            ("CRLF", "\r\n"),
            ("CR", "\r"),
            ("CRCRLF", "\r\r\n"),
            ("LF", "\n"),
        ] {
            let own = text.replace('\n', ends);
            is_cube(&file(&directory, name, own.trim_end()));
            let marked = [b"\xef\xbb\xbf", own.as_bytes()].concat();
            let path = file(&directory, name, marked);
            assert!(read_mesh(&path).is_ok(), "{name} {change} with a mark");
            is_cube(&path);
        }
        let wide = text.encode_utf16().flat_map(u16::to_le_bytes);
        for mark in [&b"\xff\xfe"[..], b""] {
            let bytes: Vec<u8> = mark.iter().copied().chain(wide.clone()).collect();
            let e = failure(name, bytes);
            assert!(
                e.contains("found UTF-16 text; expected UTF-8 text"),
                "{name}: {e}"
            );
        }
    }
}

#[test]
fn text_stl_is_read_by_its_words() {
    let text = stl();
    reads_as_cube(
        "x.stl",
        &text,
        &[
            ("endloop", "ENDLOOP", 0),
            ("endloop", "end  loop", 0),
            ("endfacet", "end facet", 0),
            ("endsolid cube", "end solid cube", 0),
            ("endsolid cube", "end", 0),
            ("endsolid cube\n", "", 1),
            ("solid cube", "SOLID", 0),
            ("solid cube", "solid facet 7 of a caf\u{e9}", 0),
            ("facet normal 0 0 0", "facet", 0),
            ("facet normal 0 0 0", "facet normal -nan nan 1.#QNAN", 0),
            ("facet normal 0 0 0", "facet\nnormal 0\n0 0", 0),
            ("\n", " ", 0),
            ("  ", "\t", 0),
            ("vertex 0 0 0", "vertex 0.D0 0.0d+00 -0E-3", 0),
            ("vertex 0 0 0", "vertex\n0\n0 0", 0),
            (
                "solid cube\n",
                "solid cube\n# a comment \\\n; one\n// more\n! last\n",
                0,
            ),
            ("  outer loop", "  colour 1 0 0\n  outer loop", 0),
            (
                "solid cube\n facet",
                "Exported by hand\n\nsolid cube\n facet",
                1,
            ),
            (
                "endsolid cube\n",
                "endsolid cube\nsolid empty\nendsolid\n",
                0,
            ),
        ],
    );
    let padded = text.clone() + "\u{1a}\0\0\0\0";
    assert_eq!(read("x.stl", padded).unwrap().mesh.volume(), 1000.0);
    // Several solids, on one line too.
    let again = text.replace("solid cube", "solid other").replace('\n', " ");
    assert_eq!(
        read("x.stl", text.clone() + &again)
            .unwrap()
            .mesh
            .triangles()
            .len(),
        24
    );
    let both = text.replace('\n', " ") + &again;
    assert_eq!(read("x.stl", both).unwrap().mesh.triangles().len(), 24);
    let comma = failure("x.stl", text.replace("vertex 0 0 0", "vertex 0,5 0 0"));
    assert!(comma.contains("not with a comma"), "{comma}");
    let extra = failure("x.stl", text.replace("vertex 0 0 0", "vertex 0 0 0 7"));
    assert!(extra.starts_with("line 4: found"), "{extra}");
    let word = failure("x.stl", text.replacen("  vertex 0 0 0", "  vertx 0 0 0", 1));
    assert!(word.contains("2 vertices in a facet"), "{word}");
}

#[test]
fn binary_stl_is_as_long_as_it_is() {
    let warnings = |header: &[u8], count, more: usize| {
        let mut bytes = binary_stl(header, count);
        bytes.resize(bytes.len() + more, 7);
        let read = read("x.stl", bytes).unwrap();
        assert_eq!(read.mesh.volume(), 1000.0);
        read.warnings
    };
    assert!(warnings(b"solid facet vertex", 12, 0).is_empty());
    assert_eq!(
        warnings(b"COLOR=\xff\xff\xff\xff", 12, 3),
        ["3 bytes after the last triangle; ignored"]
    );
    for count in [u32::MAX, 0, 1, 11, 13, 1 << 30] {
        assert_eq!(
            warnings(b"solid", count, 0),
            [format!(
                "the header counts {count} triangles where the file has 12; all of them are read"
            )]
        );
    }
    // Without its last triangles it does not close.
    let whole = binary_stl(b"", 12);
    for left in [1, 6, 11] {
        let e = failure("x.stl", &whole[..84 + 50 * left]);
        let found = format!("a claim of 12 triangles where the file has {left}");
        assert!(e.contains(&found) && e.contains("truncated"), "{e}");
    }
    let e = failure("x.stl", &whole[..84 + 50 * 6 + 7]);
    assert!(
        e.contains("a claim of 12 triangles with 307 bytes left"),
        "{e}"
    );
}

#[test]
fn statements_of_obj_are_read_passed_over_or_refused() {
    let text = obj();
    reads_as_cube(
        "x.obj",
        &text,
        &[
            ("v 0 0 0\n", "o A cube with spaces\nv 0 0 0 1.0\n", 0),
            ("v 10 0 0\n", "v 10 0 0 0.5 0.25 1\n", 0),
            (
                "f 1 3 4 2\n",
                "# a comment that ends so \\\nf 1//1 3/2 4/3/2 2 # and another\n",
                0,
            ),
            ("f 1 3 4 2\n", "f 1 3 \\\n4 \\ \n2\n", 0),
            ("f 1 3 4 2\n", "f\t-8  -6\t-5 -7\n", 0),
            (
                "f 1 3 4 2\n",
                "usemtl my paint\ns 1\nvn 0 0 1\nvt 0 0\nl 1 2 3\np 1\nf 1 3 4 2\n",
                1,
            ),
            (
                "f 1 3 4 2\n",
                "vp 0 0\ncstype bspline\ndeg 3 3\nsurf 0 1 0 1 1 2\nparm u 0 1\ntrim 0 1 1\nend\nf 1 3 4 2\n",
                1,
            ),
            ("f 2 4 8 6\n", "f 2 4 8 6\nf 1 2\n", 1),
            ("v 0 0 0\n", "\n   v 0.0d0 0E0 +0.\n", 0),
        ],
    );
    let free = text.clone() + "curv 0 1 1 2\ncurv2 1 2\ncurv 1 2 1 2\n";
    assert_eq!(
        read("x.obj", free).unwrap().warnings,
        ["3 statements of free-form curves and surfaces (curv, curv2); ignored"]
    );
    let lines = text.clone() + "l 1 2\np 3\nl 4 5";
    assert_eq!(
        read("x.obj", lines).unwrap().warnings,
        ["3 points and lines; left out"]
    );
    // Faces may come before their vertices if these come.
    let (vertices, faces) = text.split_at(text.find('f').unwrap());
    assert_eq!(
        read("x.obj", faces.to_owned() + vertices)
            .unwrap()
            .mesh
            .volume(),
        1000.0
    );
    let refused = |from: &str, to: &str, words: [&str; 2]| {
        let e = failure("x.obj", text.replace(from, to));
        assert!(words.iter().all(|w| e.contains(w)), "{e}");
    };
    refused(
        "f 1 3 4 2",
        "call other.obj",
        ["line 9: found call", "one plain OBJ"],
    );
    refused(
        "f 1 3 4 2",
        "csh rm -r x",
        ["line 9: found csh", "one plain OBJ"],
    );
    refused(
        "f 1 3 4 2",
        "f 1 3 4 9",
        ["line 9: found vertex number 9", "in the file"],
    );
    refused(
        "f 1 3 4 2",
        "f -9 3 4 2",
        ["line 9: found \"-9\"", "from -1 backward"],
    );
    refused("v 10 0 0", "v 1,5 0 0", ["line 2", "not with a comma"]);
    refused("v 10 0 0", "w 10 0 0", ["line 2", "an OBJ statement"]);
}

#[test]
fn groups_of_obj_become_groups_of_the_surface() {
    let text = obj().replace("f 1 3 4 2\n", "g low side\nf 1 3 4 2\ng\n");
    let text = text.replace("f 1 2 6 5\n", "o walls\nf 1 2 6 5\n");
    let directory = tempfile::tempdir().unwrap();
    let found = surface(&file(&directory, "x.obj", &text));
    let groups: Vec<(&str, &[u32])> = found
        .groups
        .iter()
        .map(|g| (g.name.as_str(), &g.elements[..]))
        .collect();
    assert_eq!(groups, [("low side", &[0][..]), ("walls", &[2, 3, 4, 5])]);
    // A polygon that is cut keeps its group.
    let l = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nv 3 0 0\ng l\nf 1 2 3 4 5 6\ng t\nf 2 7 3\n";
    let found = surface(&file(&directory, "x.obj", l));
    assert_eq!(found.surface.kinds(), [(Kind::Tri3, 5)]);
    assert_eq!(found.groups[0].elements, [0, 1, 2, 3]);
    assert_eq!(found.groups[1].elements, [4]);
}
