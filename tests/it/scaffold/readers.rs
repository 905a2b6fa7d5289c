//! Readers of decks and surfaces; groups and fields.

use druse::io::{ElementFile, FieldAt, Place, ReadError, read_elements, read_scaffold};
use druse::scaffold::Kind;
use std::path::Path;

fn read(name: &str, text: &str) -> Result<ElementFile, ReadError> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, text).unwrap();
    read_elements(&path)
}

const DECK: &str = "** a wedge on a hex, with sets\n*HEADING\nanything\n*Node, nset=ALL\n\
1, 0., 0., 0.\n2, 1., 0.\n3, 1., 1., 0.\n4, 0., 1., 0.\n5, 0, 0, 1.D0\n6, 1, 0, 1\n7, 1, 1, 1\n8, 0, 1, 1\n\
11, 0.5, 0, 2\n12, 0.5, 1, 2\n99, 9, 9, 9\n\
*ELEMENT, TYPE=C3D8R, ELSET=Lower\n10, 1, 2, 3, 4, 5,\n 6, 7, 8\n\
*ELEMENT, TYPE=C3D6,\n ELSET=Roof\n20, 5, 6, 11, 8, 7, 12\n\
*ELEMENT, TYPE=S4\n30, 1, 2, 3, 4\n*ELEMENT, TYPE=T3D2\n40, 1, 2\n\
*ELSET, ELSET=All, GENERATE\n10, 20, 10\n*ELSET, ELSET=Both\nLower, Roof\n*STEP\n*END STEP\n";

#[test]
fn decks_have_their_elements_and_sets() {
    let ElementFile::Solids(file) = read("a.inp", DECK).unwrap() else {
        panic!("solids");
    };
    let s = &file.scaffold;
    assert_eq!(s.len(), 2);
    assert_eq!([s.number(0), s.number(1)], [10, 20]);
    assert_eq!(
        [0, 1].map(|e| s.element(e).kind()),
        [Kind::Hex8, Kind::Wedge6]
    );
    assert!((s.element(0).volume() - 1.0).abs() < 1e-12);
    assert!((s.element(1).volume().abs() - 0.5).abs() < 1e-12);
    assert_eq!(s.neighbours(0).collect::<Vec<_>>(), [1]);
    assert_eq!((file.skipped, file.unused_nodes), (2, 1));
    let group = |name: &str| {
        let found = file.groups.iter().find(|g| g.name == name);
        found.map(|g| g.elements.clone())
    };
    assert_eq!(group("Lower"), Some(vec![0]));
    assert_eq!(group("Roof"), Some(vec![1]));
    assert_eq!(group("All"), Some(vec![0, 1]));
    assert_eq!(group("Both"), Some(vec![0, 1]));
}

#[test]
fn damaged_decks_are_refused_with_their_place() {
    let refusal = |from: &str, to: &str| {
        assert!(DECK.contains(from), "{from}");
        read("a.inp", &DECK.replace(from, to)).unwrap_err()
    };
    let e = refusal(" 6, 7, 8\n", " 6, 7\n");
    assert_eq!(e.item(), Some(10));
    assert!(e.found().contains("7 nodes"), "{e}");
    let e = refusal(" 6, 7, 8\n", " 6, 7, 8, 9\n");
    assert!(e.expected().contains("8 for a Hex8"), "{e}");
    let e = refusal("TYPE=C3D6", "TYPE=C3D7");
    assert!(e.found().contains("C3D7") && e.line().is_some(), "{e}");
    let e = refusal("TYPE=S4", "ELSET=S4");
    assert!(e.expected().contains("TYPE="), "{e}");
    let e = refusal("20, 5,", "10, 5,");
    assert!(e.found().contains("second element"), "{e}");
    let e = refusal("7, 12", "7, 77");
    assert_eq!(e.place(), Place::Item("element", 20));
    let e = refusal("Lower, Roof", "Lower, Attic");
    assert!(e.found().contains("Attic"), "{e}");
    let e = refusal("*HEADING", "*INCLUDE, INPUT=none.inp");
    assert_eq!(e.class().exit_code(), 66, "{e}");
    let e = refusal("*HEADING", "*INCLUDE, INPUT=a.inp");
    assert!(e.found().contains("deep"), "{e}");
}

#[test]
fn surfaces_keep_their_quads_and_groups() {
    let obj =
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\ng left\nf 1/1 2/2 3 4\ng right\nf 2 -1 3\n";
    let off =
        "OFF\n# two faces\n5 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n4 0 1 2 3\n3 1 4 2 255 0 0\n";
    for (name, text) in [("a.obj", obj), ("a.off", off)] {
        let ElementFile::Surface(file) = read(name, text).unwrap() else {
            panic!("a surface");
        };
        assert_eq!(file.surface.kinds(), [(Kind::Tri3, 1), (Kind::Quad4, 1)]);
        let plate = file.surface.plate(2.0).unwrap();
        let volume: f64 = plate.elements().map(|e| e.volume()).sum();
        assert!((volume - 3.0).abs() < 1e-12);
        assert_eq!(plate.components().len(), 1);
        if name == "a.obj" {
            let names: Vec<&str> = file.groups.iter().map(|g| g.name.as_str()).collect();
            assert_eq!(names, ["left", "right"]);
        }
    }
    let ElementFile::Surface(file) =
        read("a.off", &off.replace("4 0 1 2 3", "5 0 1 4 2 3")).unwrap()
    else {
        panic!("a surface");
    };
    // One of the polygon's three triangles is the one that the file has beside it.
    assert_eq!(file.surface.kinds(), [(Kind::Tri3, 3)]);
    let e = read("a.off", &off.replace("5 2 0", "5 99999999 0")).unwrap_err();
    assert!(e.found().contains("99999999"), "{e}");
    let e = read("a.obj", &obj.replace("-1", "-9")).unwrap_err();
    assert!(e.found().contains("-9"), "{e}");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.obj");
    std::fs::write(&path, obj).unwrap();
    let e = read_scaffold(&path).unwrap_err();
    assert!(e.hint().unwrap().contains("shell"), "{e}");
}

#[test]
fn point_and_cell_data_follow_what_is_kept() {
    // A line element and a node that go; their data must go with them.
    let text = "# vtk DataFile Version 3.0\nfields\nASCII\nDATASET UNSTRUCTURED_GRID\n\
POINTS 6 double\n9 9 9\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\nCELLS 3 13\n2 0 1\n4 1 2 3 4\n4 2 3 4 5\n\
CELL_TYPES 3\n3\n10\n10\n\
POINT_DATA 6\nSCALARS t double\nLOOKUP_TABLE default\n90 1 2 3 4 5\nVECTORS u double\n\
9 9 9 1 0 0 2 0 0 3 0 0 4 0 0 5 0 0\n\
CELL_DATA 3\nFIELD FieldData 1\nstress 1 3 float\n7 8 9.5\n";
    let ElementFile::Solids(file) = read("a.vtk", text).unwrap() else {
        panic!("solids");
    };
    let field = |name: &str| file.fields.iter().find(|f| f.name == name).unwrap();
    assert_eq!(field("t").at, FieldAt::Points);
    assert_eq!(field("t").values, [1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!((field("u").components, field("u").values[3]), (3, 2.0));
    assert_eq!(field("stress").at, FieldAt::Cells);
    assert_eq!(field("stress").values, [8.0, 9.5]);

    let xml = |values: &str| {
        format!(
            "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\"><UnstructuredGrid>\
             <Piece NumberOfPoints=\"4\" NumberOfCells=\"1\">\
             <PointData><DataArray type=\"Float64\" Name=\"t\" format=\"ascii\">{values}</DataArray>\
             <DataArray type=\"String\" Name=\"words\" format=\"ascii\">a b</DataArray></PointData>\
             <Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">\
             0 0 0 1 0 0 0 1 0 0 0 1</DataArray></Points>\
             <Cells><DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">0 1 2 3</DataArray>\
             <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">4</DataArray>\
             <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10</DataArray></Cells>\
             </Piece></UnstructuredGrid></VTKFile>"
        )
    };
    let ElementFile::Solids(file) = read("a.vtu", &xml("1 2 3 4")).unwrap() else {
        panic!("solids");
    };
    assert_eq!(file.fields[0].values, [1.0, 2.0, 3.0, 4.0]);
    let e = read("a.vtu", &xml("1 2 3")).unwrap_err();
    assert!(e.found().contains("\"t\" of 3 values"), "{e}");
}

#[test]
fn triangle_meshes_are_surfaces() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/bracket/strut.stl");
    let ElementFile::Surface(file) = read_elements(path).unwrap() else {
        panic!("a surface");
    };
    assert!(file.surface.len() > 10);
    assert_eq!(file.surface.kinds().len(), 1);
}
