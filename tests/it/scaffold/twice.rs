//! Elements that a file gives more than once, in every format.

use druse::io::{ElementFile, ReadError, ScaffoldFile, SurfaceFile, read_elements};
use druse::scaffold::Kind;
use std::fmt::Write as _;
use std::path::Path;

fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<ElementFile, ReadError> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    read_elements(&path)
}

fn solids(name: &str, bytes: impl AsRef<[u8]>) -> Box<ScaffoldFile> {
    match read(name, bytes).unwrap_or_else(|e| panic!("{e}")) {
        ElementFile::Solids(file) => file,
        ElementFile::Surface(_) => panic!("a surface"),
    }
}

fn surface(name: &str, bytes: impl AsRef<[u8]>) -> SurfaceFile {
    match read(name, bytes).unwrap_or_else(|e| panic!("{e}")) {
        ElementFile::Surface(file) => *file,
        ElementFile::Solids(_) => panic!("solids"),
    }
}

/// Two hexes side by side; the second is given three times: as it is, turned and inside out.
const HEXES: [[u64; 8]; 4] = [
    [1, 2, 5, 4, 7, 8, 11, 10],
    [2, 3, 6, 5, 8, 9, 12, 11],
    [3, 6, 5, 2, 9, 12, 11, 8],
    [8, 9, 12, 11, 2, 3, 6, 5],
];

fn points() -> Vec<[f64; 3]> {
    let at = |i: usize| [(i % 3) as f64, (i / 3 % 2) as f64, (i / 6) as f64];
    (0..12).map(at).collect()
}

fn check(file: &ScaffoldFile, numbers: [u64; 2], note: &str) {
    let s = &file.scaffold;
    assert_eq!(s.len(), 2);
    assert_eq!([s.number(0), s.number(1)], numbers);
    let report = s.validate().unwrap();
    assert!((report.volume - 2.0).abs() < 1e-12);
    assert!(report.warnings().is_empty(), "{:?}", report.warnings());
    assert_eq!(file.notes, [note]);
}

fn groups(file: &ScaffoldFile) -> Vec<(&str, &[u32])> {
    let groups = file.groups.iter();
    groups
        .map(|g| (g.name.as_str(), g.elements.as_slice()))
        .collect()
}

const NOTE: &str = "2 duplicate elements were merged: elements 3 (into 2), 4 (into 2)";

fn msh(binary: bool) -> Vec<u8> {
    let mut out = format!("$MeshFormat\n2.2 {} 8\n", u8::from(binary)).into_bytes();
    if binary {
        out.extend(1i32.to_le_bytes());
        out.push(b'\n');
    }
    out.extend(b"$EndMeshFormat\n$PhysicalNames\n3\n3 1 \"all\"\n3 2 \"right\"\n3 3 \"more\"\n$EndPhysicalNames\n$Nodes\n12\n");
    for (i, p) in points().iter().enumerate() {
        if binary {
            out.extend((i as i32 + 1).to_le_bytes());
            out.extend(p.iter().flat_map(|c| c.to_le_bytes()));
        } else {
            out.extend(format!("{} {} {} {}\n", i + 1, p[0], p[1], p[2]).into_bytes());
        }
    }
    out.extend(b"$EndNodes\n$Elements\n4\n");
    if binary {
        out.extend([5i32, 4, 2].iter().flat_map(|n| n.to_le_bytes()));
    }
    for (i, (nodes, group)) in HEXES.iter().zip([1, 1, 2, 3]).enumerate() {
        if binary {
            let head = [i as i32 + 1, group, 1];
            let all = head.into_iter().chain(nodes.map(|n| n as i32));
            out.extend(all.flat_map(i32::to_le_bytes));
        } else {
            let nodes = nodes.map(|n| n.to_string()).join(" ");
            out.extend(format!("{} 5 2 {group} 1 {nodes}\n", i + 1).into_bytes());
        }
    }
    out.extend(b"$EndElements\n");
    out
}

#[test]
fn in_gmsh_meshes() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/truth/decks/two_groups.msh");
    let file = solids("a.msh", std::fs::read(path).unwrap());
    check(
        &file,
        [1, 2],
        "1 duplicate elements were merged: elements 3 (into 2)",
    );
    assert_eq!(groups(&file), [("all", &[0, 1][..]), ("right", &[1])]);
    for binary in [false, true] {
        let file = solids("a.msh", msh(binary));
        check(&file, [1, 2], NOTE);
        assert_eq!(
            groups(&file),
            [("all", &[0, 1][..]), ("right", &[1]), ("more", &[1])]
        );
    }
}

#[test]
fn in_decks_also_by_nodes_of_their_own() {
    let mut text = "*NODE\n".to_owned();
    for (i, p) in points().iter().enumerate() {
        let _ = writeln!(
            text,
            "{},{},{},{}\n{},{},{},{}",
            i + 1,
            p[0],
            p[1],
            p[2],
            i + 101,
            p[0],
            p[1],
            p[2]
        );
    }
    for (i, nodes) in HEXES.iter().enumerate() {
        let own = nodes
            .map(|n| (if i == 2 { n + 100 } else { n }).to_string())
            .join(",");
        let _ = writeln!(text, "*ELEMENT, TYPE=C3D8, ELSET=E{i}\n{},{own}", i + 1);
    }
    let file = solids("a.inp", &text);
    check(&file, [1, 2], NOTE);
    assert_eq!(
        groups(&file),
        [("E0", &[0][..]), ("E1", &[1]), ("E2", &[1]), ("E3", &[1])]
    );
}

#[test]
fn in_vtk_files_the_fields_of_the_first_are_kept() {
    let list = |values: Vec<String>| values.join(" ");
    let at = list(points().iter().flatten().map(f64::to_string).collect());
    let nodes = list(
        HEXES
            .iter()
            .flatten()
            .map(|n| (n - 1).to_string())
            .collect(),
    );
    let data = "7 8 9 10";
    let vtu = format!(
        "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\"><UnstructuredGrid>\
         <Piece NumberOfPoints=\"12\" NumberOfCells=\"4\">\
         <CellData><DataArray type=\"Float64\" Name=\"t\" format=\"ascii\">{data}</DataArray></CellData>\
         <Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">{at}</DataArray></Points>\
         <Cells><DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">{nodes}</DataArray>\
         <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">8 16 24 32</DataArray>\
         <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">12 12 12 12</DataArray></Cells>\
         </Piece></UnstructuredGrid></VTKFile>"
    );
    let mut cells = String::new();
    for hex in HEXES {
        let _ = writeln!(cells, "8 {}", hex.map(|n| (n - 1).to_string()).join(" "));
    }
    let vtk = format!(
        "# vtk DataFile Version 3.0\na\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 12 double\n{at}\n\
         CELLS 4 36\n{cells}CELL_TYPES 4\n12 12 12 12\nCELL_DATA 4\nSCALARS t double\nLOOKUP_TABLE default\n{data}\n"
    );
    for (name, text) in [("a.vtu", vtu), ("a.vtk", vtk)] {
        let file = solids(name, text);
        let note = "2 duplicate elements were merged: elements 2 (into 1), 3 (into 1)";
        check(&file, [0, 1], note);
        assert_eq!(file.fields[0].values, [7.0, 8.0]);
    }
}

#[test]
fn faces_of_surfaces_too() {
    let off =
        "OFF\n5 4 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n4 0 1 2 3\n3 1 4 2\n4 3 2 1 0\n3 4 2 1\n";
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\ng a\nf 1 2 3 4\nf 2 5 3\ng b\nf 4 3 2 1\nf 5 3 2\n";
    for (name, text) in [("a.off", off), ("a.obj", obj)] {
        let file = surface(name, text);
        assert_eq!(file.surface.kinds(), [(Kind::Tri3, 1), (Kind::Quad4, 1)]);
        assert!(
            file.notes[0].starts_with("2 duplicate elements"),
            "{:?}",
            file.notes
        );
        let plate = file.surface.plate(2.0).unwrap();
        assert!((plate.elements().map(|e| e.volume()).sum::<f64>() - 3.0).abs() < 1e-12);
        if name == "a.obj" {
            assert!(
                file.groups.iter().all(|g| g.elements == [0, 1]),
                "{:?}",
                file.groups
            );
        }
    }
}

#[test]
fn quadratic_elements_are_one_if_their_mid_nodes_agree() {
    // A tetrahedron, again with its first three corners turned, and with a mid node beside the other.
    let deck = |again: &str, moved: f64| {
        format!(
            "*NODE\n1,0,0,0\n2,2,0,0\n3,0,2,0\n4,0,0,2\n5,1,0,0\n6,1,1,0\n7,0,1,0\n8,0,0,1\n9,1,0,1\n\
             10,0,1,1\n11,{moved},0,0\n*ELEMENT, TYPE=C3D10\n1,1,2,3,4,5,6,7,8,9,10\n{again}\n"
        )
    };
    let turned = "2,2,3,1,4,6,7,5,9,10,8";
    let file = solids("a.inp", deck(turned, 9.0));
    assert_eq!((file.scaffold.len(), file.notes.len()), (1, 1));
    let beside = "2,1,2,3,4,11,6,7,8,9,10";
    let file = solids("a.inp", deck(beside, 1.0 + 1e-12));
    assert_eq!(file.scaffold.len(), 1);
    let e = read("a.inp", deck(beside, 1.1)).unwrap_err();
    assert_eq!(e.item(), Some(2));
    assert!(e.found().contains("element 1"), "{e}");
    let linear = "*ELEMENT, TYPE=C3D4\n2,1,2,3,4";
    let e = read("a.inp", deck(linear, 9.0)).unwrap_err();
    assert!(
        e.found()
            .contains("a Tet4 with the corners of element 1, a Tet10"),
        "{e}"
    );
}
