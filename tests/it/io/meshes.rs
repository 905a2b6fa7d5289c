//! Meshes as other programs write them: every format and dialect, through one loader, in every role.

use super::{failure, file, read};
use druse::frame::LengthUnit;
use druse::io::{
    ElementFile, FieldAt, SurfaceFile, read_elements, read_mesh, read_polymesh, stated_unit,
};
use druse::mesh::check;
use druse::polymesh::LoadOptions;
use druse::scaffold::Kind;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The cube of 10 by its corners, and its faces seen from outside.
pub const CORNERS: [[i32; 3]; 8] = [
    [0, 0, 0],
    [10, 0, 0],
    [0, 10, 0],
    [10, 10, 0],
    [0, 0, 10],
    [10, 0, 10],
    [0, 10, 10],
    [10, 10, 10],
];
pub const FACES: [[usize; 4]; 6] = [
    [0, 2, 3, 1],
    [4, 5, 7, 6],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 4, 6, 2],
    [1, 3, 7, 5],
];

fn triangles() -> Vec<[usize; 3]> {
    let cut = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]];
    FACES.into_iter().flat_map(cut).collect()
}

fn row(numbers: &[impl ToString]) -> String {
    let words: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    words.join(" ")
}

fn rows<T: ToString, const N: usize>(list: &[[T; N]], before: &str, after: &str) -> String {
    let line = |r: &[T; N]| format!("{before}{}{after}\n", row(r));
    list.iter().map(line).collect()
}

/// The cube as text STL.
pub fn stl() -> String {
    let mut text = "solid cube\n".to_owned();
    for t in triangles() {
        text += " facet normal 0 0 0\n  outer loop\n";
        for v in t {
            let _ = writeln!(text, "   vertex {}", row(&CORNERS[v]));
        }
        text += "  endloop\n endfacet\n";
    }
    text + "endsolid cube\n"
}

/// The cube as binary STL with a header and a count that may be wrong.
pub fn binary_stl(header: &[u8], count: u32) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend(count.to_le_bytes());
    for t in triangles() {
        bytes.extend([0; 12]);
        let numbers = t.iter().flat_map(|&v| CORNERS[v]);
        bytes.extend(numbers.flat_map(|c| (c as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

pub fn obj() -> String {
    let faces = FACES.map(|f| f.map(|v| v + 1));
    rows(&CORNERS, "v ", "") + &rows(&faces, "f ", "")
}

pub fn off() -> String {
    format!(
        "OFF\n8 6 12\n{}{}",
        rows(&CORNERS, "", ""),
        rows(&FACES, "4 ", "")
    )
}

pub fn ply() -> String {
    format!(
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
         element face 6\nproperty list uchar int vertex_indices\nend_header\n{}{}",
        rows(&CORNERS, "", ""),
        rows(&FACES, "4 ", "")
    )
}

/// Polygons as VTK's XML, after other cells; with a field of points and one of cells.
pub fn vtp() -> String {
    let array = |kind: &str, name: &str, values: String| {
        format!("<DataArray type=\"{kind}\" Name=\"{name}\" format=\"ascii\">{values}</DataArray>")
    };
    let section = |name: &str, connectivity: &str, offsets: &str| {
        let nodes = array("Int64", "connectivity", connectivity.to_owned());
        let ends = array("Int64", "offsets", offsets.to_owned());
        format!("<{name}>{nodes}{ends}</{name}>")
    };
    let quads = rows(&FACES[..4], "", "");
    // The last two faces are strips.
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" byte_order=\"LittleEndian\"><PolyData>\
         <Piece NumberOfPoints=\"8\" NumberOfVerts=\"1\" NumberOfLines=\"2\" NumberOfStrips=\"2\" NumberOfPolys=\"4\">\
         <PointData>{}</PointData><CellData>{}</CellData>\
         <Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">{}</DataArray></Points>{}{}{}{}\
         </Piece></PolyData></VTKFile>",
        array("Float64", "height", "0 0 0 0 10 10 10 10".into()),
        array("Float64", "number", "0 1 2 3 4 5 6 7 8".into()),
        rows(&CORNERS, "", ""),
        section("Verts", "7", "1"),
        section("Lines", "0 1 2 3 4", "2 5"),
        section("Strips", "0 4 2 6 1 3 5 7", "4 8"),
        section("Polys", &quads, "4 8 12 16"),
    )
}

/// Polygons and strips as a legacy VTK file.
pub fn vtk() -> String {
    format!(
        "# vtk DataFile Version 3.0\ncube\nASCII\nDATASET POLYDATA\nPOINTS 8 float\n{}LINES 1 3\n2 0 1\n\
         POLYGONS 4 20\n{}TRIANGLE_STRIPS 2 10\n4 0 4 2 6\n4 1 3 5 7\nCELL_DATA 7\nSCALARS number double\n\
         LOOKUP_TABLE default\n0 1 2 3 4 5 6\n",
        rows(&CORNERS, "", ""),
        rows(&FACES[..4], "4 ", "")
    )
}

/// The same, as version 5.1 writes it.
fn vtk5() -> String {
    let quads: String = rows(&FACES[..4], "", "");
    format!(
        "# vtk DataFile Version 5.1\ncube\nASCII\nDATASET POLYDATA\nPOINTS 8 float\n{}POLYGONS 5 16\n\
         OFFSETS vtktypeint64\n0 4 8 12 16\nCONNECTIVITY vtktypeint64\n{quads}\
         TRIANGLE_STRIPS 3 8\nOFFSETS vtktypeint64\n0 4 8\nCONNECTIVITY vtktypeint64\n0 4 2 6\n1 3 5 7\n",
        rows(&CORNERS, "", ""),
    )
}

/// A grid of a hexahedron, or of its faces: quads, a polygon and a strip.
fn vtu(solid: bool) -> String {
    let hex = ("0 1 3 2 4 5 7 6".to_owned(), "8", "12", 1);
    let quads = rows(&FACES[..4], "", "") + "0 4 6 2\n1 3 5 7";
    let (nodes, ends, types, count) = if solid {
        hex
    } else {
        (quads, "4 8 12 16 20 24", "9 9 9 9 7 6", 6)
    };
    format!(
        "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece NumberOfPoints=\"8\" NumberOfCells=\"{count}\">\
         <Points><DataArray type=\"Float32\" NumberOfComponents=\"3\">{}</DataArray></Points><Cells>\
         <DataArray type=\"Int32\" Name=\"connectivity\">{nodes}</DataArray>\
         <DataArray type=\"Int32\" Name=\"offsets\">{ends}</DataArray>\
         <DataArray type=\"UInt8\" Name=\"types\">{types}</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>",
        rows(&CORNERS, "", "")
    )
}

/// Planar elements as Gmsh and Abaqus have them.
fn msh() -> String {
    let nodes: String = (1..9)
        .map(|n| format!("{n} {}\n", row(&CORNERS[n - 1])))
        .collect();
    let quads: String = (1..7)
        .map(|n| format!("{n} 3 2 0 1 {}\n", row(&FACES[n - 1].map(|v| v + 1))))
        .collect();
    format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n{nodes}$EndNodes\n$Elements\n6\n{quads}$EndElements\n"
    )
}

fn inp() -> String {
    let line = |n: usize, list: &[String]| format!("{n}, {}\n", list.join(", "));
    let nodes: String = (1..9)
        .map(|n| line(n, &CORNERS[n - 1].map(|c| c.to_string())))
        .collect();
    let quads: String = (1..7)
        .map(|n| line(n, &FACES[n - 1].map(|v| (v + 1).to_string())))
        .collect();
    format!("*NODE\n{nodes}*ELEMENT, TYPE=S4\n{quads}")
}

/// The cube in every format, by name.
pub fn cubes() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("text.stl", stl().into()),
        ("binary.stl", binary_stl(b"", 12)),
        ("a.obj", obj().into()),
        ("a.ply", ply().into()),
        ("a.off", off().into()),
        ("a.vtp", vtp().into()),
        ("a.vtk", vtk().into()),
        ("b.vtk", vtk5().into()),
        ("a.vtu", vtu(false).into()),
        ("solid.vtu", vtu(true).into()),
        ("a.msh", msh().into()),
        ("a.inp", inp().into()),
    ]
}

fn dialect(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/dialects")
        .join(name)
}

/// Every file of the dialects is this cube.
pub const DIALECTS: [&str; 13] = [
    "a02_leading_space.stl",
    "a04_end_solid.stl",
    "a05_end_loop.stl",
    "a09_cr.stl",
    "a13_comment.stl",
    "b03_count_ff.stl",
    "blank_first.stl",
    "bom.stl",
    "color.stl",
    "o05_cr.obj",
    "o06_bom.obj",
    "p09_tristrips_bin.ply",
    "p10_tristrips_ascii.ply",
];

/// The cube of 10 in each role that the library knows.
fn is_cube(path: &Path) {
    let name = path.display();
    let mesh = read_mesh(path).unwrap_or_else(|e| panic!("{e}")).mesh;
    assert_eq!((mesh.volume(), mesh.area()), (1000.0, 600.0), "{name}");
    assert_eq!(
        (mesh.triangles().len(), mesh.vertices().len()),
        (12, 8),
        "{name}"
    );
    assert!(check(&mesh).is_sound(), "{name}");
    let polygons = read_polymesh(path, &LoadOptions::default()).unwrap().mesh;
    assert_eq!((polygons.volume(), polygons.euler()), (1000.0, 2), "{name}");
    if path.ends_with("solid.vtu") {
        return;
    }
    let surface = surface(path).surface;
    let scaffold = surface.shell(1.0).unwrap();
    let volume: f64 = scaffold.elements().map(|e| e.volume()).sum();
    assert!(volume > 500.0, "{name}: {volume}");
    assert_eq!(scaffold.components().len(), 1, "{name}");
}

fn surface(path: &Path) -> SurfaceFile {
    match read_elements(path).unwrap() {
        ElementFile::Surface(file) => file,
        ElementFile::Solids(_) => panic!("{}: solids", path.display()),
    }
}

#[test]
fn every_format_serves_in_every_role() {
    let directory = tempfile::tempdir().unwrap();
    for (name, bytes) in cubes() {
        is_cube(&file(&directory, name, bytes));
    }
    DIALECTS.iter().for_each(|name| is_cube(&dialect(name)));
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

/// A text, what of it is replaced by what, and how many warnings come of it.
type Change<'a> = (&'a str, &'a str, usize);

fn reads_as_cube(name: &str, text: &str, changes: &[Change]) {
    for (from, to, warnings) in changes {
        assert!(text.contains(from), "{from}");
        let changed = text.replace(from, to);
        let read = read(name, &changed).unwrap_or_else(|e| panic!("{from} -> {to}: {e}"));
        assert_eq!(read.mesh.volume(), 1000.0, "{from} -> {to}");
        assert_eq!(read.warnings.len(), *warnings, "{to}: {:?}", read.warnings);
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
        ["3 bytes after the last triangle; passed over"]
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
        ["3 statements of free-form curves and surfaces (curv, curv2); passed over"]
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
    // A grid under the other extension is what it says.
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
