//! Meshes whose files are tables: PLY, OFF, VTK; solids as meshes; units.

use super::cubes::{
    CORNERS, FACES, binary_stl, obj, off, ply, reads_as_cube, rows, surface, vtk, vtp, vtu,
};
use super::{failure, file, read};
use druse::frame::LengthUnit;
use druse::io::{ElementFile, FieldAt, read_elements, read_mesh, stated_unit};
use druse::mesh::check;
use druse::scaffold::Kind;
use std::path::Path;

#[test]
fn ply_is_read_whatever_its_properties() {
    let text = ply();
    reads_as_cube(
        "x.ply",
        &text,
        &[
            ("vertex_indices", "vertex_index", 0),
            ("vertex_indices", "corners", 0),
            (
                "property float x",
                "comment a comment\nobj_info made by\nproperty double x",
                0,
            ),
            ("list uchar int", "list int64 uint64", 0),
            ("4 0 2 3 1\n", "4 0 2\n3 1\n", 0),
            ("0 0 0\n10 0 0\n", "0 0 0 \n\n10 0 0 7 7 7\n", 0),
            ("format ascii 1.0", "format  ascii   1.0 ", 0),
            ("4 0 2 3 1\n", "4 0 2 3 1 \n\n", 0),
        ],
    );
    let comma = failure("x.ply", text.replace("10 0 0\n", "1,5 0 0\n"));
    assert!(
        comma.contains("found \"1,5\"") && comma.contains("not with a comma"),
        "{comma}"
    );
    let head = text.find("0 0 0").unwrap();
    let one_line = text[..head].to_owned() + &text[head..].replace('\n', " ");
    assert_eq!(read("x.ply", one_line).unwrap().mesh.volume(), 1000.0);
    let colours = text
        .replace(
            "property float z\n",
            "property float z\nproperty uchar red\n",
        )
        .replace(
            "vertex_indices\n",
            "vertex_indices\nproperty list uchar float texcoord\n",
        );
    let with: String = colours[..colours.find("0 0 0").unwrap()].to_owned()
        + &rows(&CORNERS, "", " 255")
        + &rows(&FACES, "4 ", " 2 0.5 0.5");
    assert_eq!(read("x.ply", with).unwrap().mesh.volume(), 1000.0);
    // A header of Windows and of old Macs before binary data that begins like the end of a line.
    for ends in ["\n", "\r\n", "\r"] {
        let head = text[..head].replace("ascii", "binary_little_endian");
        let head = head.replace("float", "double").replace('\n', ends);
        let mut bytes = head.into_bytes();
        for c in CORNERS {
            let mut place: Vec<u8> = c.iter().flat_map(|&x| f64::from(x).to_le_bytes()).collect();
            // The least double that begins with the byte of a line feed is next to nothing.
            place[0] |= 0x0a;
            bytes.extend(place);
        }
        for f in FACES {
            bytes.push(4);
            bytes.extend(f.iter().flat_map(|&v| (v as i32).to_le_bytes()));
        }
        let read = read("x.ply", bytes).unwrap_or_else(|e| panic!("{ends:?}: {e}"));
        assert!((read.mesh.volume() - 1000.0).abs() < 1e-9, "{ends:?}");
    }
}

#[test]
fn off_is_read_with_all_that_may_follow() {
    let text = off();
    reads_as_cube(
        "x.off",
        &text,
        &[
            ("OFF\n8 6 12", "OFF 8 6 12", 0),
            ("OFF\n", "# a cube\n\nOFF # so\n# counts\n", 0),
            ("OFF\n", "off\n", 0),
            ("OFF\n", "", 0),
            ("8 6 12", "8 6", 0),
            ("8 6 12", "8\n6\n12", 0),
            ("4 0 2 3 1\n", "4 0 2 3 1 255 0 0\n", 0),
            ("4 0 2 3 1\n", "4 0 2 3 1 0.5 0.5 0.5 1.0 # red\n", 0),
            ("4 0 2 3 1\n", "4 0 2\n3 1\n", 0),
        ],
    );
    let coloured = |word: &str, after: &str| {
        let text = text.replace("OFF\n", &format!("{word}\n"));
        let vertices = rows(&CORNERS, "", "");
        text.replace(&vertices, &rows(&CORNERS, "", after))
    };
    for (word, after) in [
        ("COFF", " 255 0 0 255"),
        ("COFF", " 0.1 0.2 0.3"),
        ("NOFF", " 0 0 1"),
        ("CNOFF", " 0 0 1 255 0 0 255"),
        ("STOFF", " 0.5 0.5"),
        ("STCNOFF", " 0 0 1 1 1 1 1 0.5 0.5"),
        ("OFF", " 7 7 7"),
    ] {
        let read = read("x.off", coloured(word, after)).unwrap();
        assert_eq!(read.mesh.volume(), 1000.0, "{word}");
    }
    let head = text.find("0 0 0").unwrap();
    let one_line = text[..head].to_owned() + &text[head..].replace('\n', " ");
    assert_eq!(read("x.off", one_line).unwrap().mesh.volume(), 1000.0);
    for (word, named) in [
        ("4OFF", "4OFF"),
        ("nOFF", "nOFF"),
        ("OFF BINARY", "OFF BINARY"),
        ("SOFF", "\"SOFF\""),
    ] {
        let e = failure("x.off", coloured(word, ""));
        assert!(e.starts_with("line 1: found") && e.contains(named), "{e}");
    }
    let few = failure("x.off", text.replace("8 6 12", "8 7 12"));
    assert!(
        few.contains("found the end of the file; expected face 7 of 7"),
        "{few}"
    );
    let wrong = failure("x.off", text.replace("4 0 2 3 1", "4 0 2 3 8"));
    assert!(wrong.contains("face 1: found vertex number 8"), "{wrong}");
    assert!(failure("x.off", text.replace("4 0 2 3 1", "4 0 2 3 -1")).contains("vertex number -1"));
    assert!(
        failure("x.off", text.replace("8 6 12", "800000000 6 12")).contains("a claim of 800000000")
    );
}

#[test]
fn fields_of_polygons_go_with_their_faces() {
    let directory = tempfile::tempdir().unwrap();
    // Numbers of cells: of VTK's XML after a point and two lines, of the legacy file after a line.
    for (name, text, first) in [("x.vtp", vtp(), 3.0), ("x.vtk", vtk(), 1.0)] {
        let found = surface(&file(&directory, name, text));
        assert_eq!(found.surface.kinds(), [(Kind::Tri3, 4), (Kind::Quad4, 4)]);
        assert_eq!(found.skipped, first as usize);
        let number = found.fields.iter().find(|f| f.name == "number").unwrap();
        assert_eq!(number.at, FieldAt::Cells);
        let expected = [0.0, 1.0, 2.0, 3.0, 4.0, 4.0, 5.0, 5.0].map(|n| n + first);
        assert_eq!(number.values, expected, "{name}");
    }
    let found = surface(&file(&directory, "x.vtp", vtp()));
    let height = found.fields.iter().find(|f| f.name == "height").unwrap();
    let z: Vec<f64> = found.surface.nodes().iter().map(|p| p.z).collect();
    assert_eq!(height.values, z);
    assert_eq!(
        read("x.vtp", vtp()).unwrap().warnings,
        ["3 points and lines; left out"]
    );
    let short = vtp().replace("0 1 2 3 4 5 6 7 8<", "0 1 2 3<");
    assert!(failure_of_elements("x.vtp", &short).contains("\"number\" of 4 values"));
    let wrong = failure("x.vtp", vtp().replace("0 4 2 6 1 3 5 7", "0 4 2 6 1 3 5 8"));
    assert!(wrong.contains("vertex number 8"), "{wrong}");
    let ends = failure("x.vtp", vtp().replace(">4 8 12 16<", ">4 8 12 17<"));
    assert!(ends.contains("of Polys"), "{ends}");
    let count = failure(
        "x.vtp",
        vtp().replace("NumberOfPolys=\"4\"", "NumberOfPolys=\"5\""),
    );
    assert!(
        count.contains("4 offsets of Polys; expected one for each of 5"),
        "{count}"
    );
    // The content decides, not the extension.
    let grid = read("x.vtp", vtu(false)).unwrap();
    assert_eq!(grid.mesh.volume(), 1000.0);
    assert!(
        failure("x.vtu", vtp().replace("PolyData", "ImageData")).contains("of type \"ImageData\"")
    );
}

fn failure_of_elements(name: &str, text: &str) -> String {
    let directory = tempfile::tempdir().unwrap();
    read_elements(file(&directory, name, text))
        .unwrap_err()
        .to_string()
}

#[test]
fn solids_give_their_outer_faces_and_say_so() {
    let solid = read("x.vtu", vtu(true)).unwrap();
    assert_eq!(
        solid.warnings,
        ["1 solid elements: the mesh is their outer faces, 12 triangles"]
    );
    // A quarter of a thick cylinder shell, curved: its volume to the smoothness of its faces.
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/scaffold/tet10_41_ascii.msh");
    let ElementFile::Solids(file) = read_elements(&path).unwrap() else {
        panic!("solids");
    };
    let volume: f64 = file.scaffold.elements().map(|e| e.volume()).sum();
    let mesh = read_mesh(&path).unwrap().mesh;
    assert!(check(&mesh).is_sound());
    assert!(
        (mesh.volume() / volume - 1.0).abs() < 1e-3,
        "{} {volume}",
        mesh.volume()
    );
}

#[test]
fn units_of_heads_are_those_of_readers() {
    let directory = tempfile::tempdir().unwrap();
    let mut stl_bytes = binary_stl(b"druse unit=cm", 12);
    for (name, bytes) in [
        ("a.stl", std::mem::take(&mut stl_bytes)),
        ("a.obj", format!("# druse unit=in\n{}", obj()).into()),
        (
            "a.ply",
            ply()
                .replace("element vertex", "comment unit=m\nelement vertex")
                .into(),
        ),
        ("b.ply", ply().into()),
        ("a.off", off().into()),
    ] {
        let path = file(&directory, name, bytes);
        assert_eq!(
            stated_unit(&path).unwrap(),
            read_mesh(&path).unwrap().unit,
            "{name}"
        );
    }
    let path = directory.path().join("a.stl");
    assert_eq!(stated_unit(path).unwrap(), Some(LengthUnit::Centimetre));
}
