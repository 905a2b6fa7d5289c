//! A cube of 10 in every format, and the files of other programs that hold it.

use super::read;
use druse::io::{ElementFile, SurfaceFile, read_elements};
use std::fmt::Write as _;
use std::path::Path;

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

pub fn triangles() -> Vec<[usize; 3]> {
    let cut = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]];
    FACES.into_iter().flat_map(cut).collect()
}

pub fn row(numbers: &[impl ToString]) -> String {
    let words: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    words.join(" ")
}

pub fn rows<T: ToString, const N: usize>(list: &[[T; N]], before: &str, after: &str) -> String {
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
pub fn vtk5() -> String {
    let quads: String = rows(&FACES[..4], "", "");
    format!(
        "# vtk DataFile Version 5.1\ncube\nASCII\nDATASET POLYDATA\nPOINTS 8 float\n{}POLYGONS 5 16\n\
         OFFSETS vtktypeint64\n0 4 8 12 16\nCONNECTIVITY vtktypeint64\n{quads}\
         TRIANGLE_STRIPS 3 8\nOFFSETS vtktypeint64\n0 4 8\nCONNECTIVITY vtktypeint64\n0 4 2 6\n1 3 5 7\n",
        rows(&CORNERS, "", ""),
    )
}

/// A grid of a hexahedron, or of its faces: quads, a polygon and a strip.
pub fn vtu(solid: bool) -> String {
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
pub fn msh() -> String {
    let node = |n: usize| format!("{n} {}\n", row(&CORNERS[n - 1]));
    let quad = |n: usize| format!("{n} 3 2 0 1 {}\n", row(&FACES[n - 1].map(|v| v + 1)));
    let nodes: String = (1..9).map(node).collect();
    let quads: String = (1..7).map(quad).collect();
    format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n{nodes}$EndNodes\n$Elements\n6\n{quads}$EndElements\n"
    )
}

pub fn inp() -> String {
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

pub fn surface(path: &Path) -> SurfaceFile {
    match read_elements(path).unwrap() {
        ElementFile::Surface(file) => *file,
        ElementFile::Solids(_) => panic!("{}: solids", path.display()),
    }
}

/// A text, what of it is replaced by what, and how many warnings come of it.
pub type Change<'a> = (&'a str, &'a str, usize);

pub fn reads_as_cube(name: &str, text: &str, changes: &[Change]) {
    for (from, to, warnings) in changes {
        assert!(text.contains(from), "{from}");
        let changed = text.replace(from, to);
        let read = read(name, &changed).unwrap_or_else(|e| panic!("{from} -> {to}: {e}"));
        assert_eq!(read.mesh.volume(), 1000.0, "{from} -> {to}");
        assert_eq!(read.warnings.len(), *warnings, "{to}: {:?}", read.warnings);
    }
}
