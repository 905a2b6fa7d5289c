//! Scaffolds read from files against the counts and volumes that gmsh gives.

use druse::io::{Place, read_scaffold, write_vtu};
use druse::scaffold::{Kind, Orientation};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/scaffold")
        .join(name)
}

/// Every file of the table with one of these extensions: element counts, volume, connectedness.
fn agrees_with_gmsh(extension: &str) -> usize {
    let table: serde_json::Value =
        serde_json::from_str(include_str!("../../data/scaffold/facts.json")).unwrap();
    let mut checked = 0;
    for (name, known) in table.as_object().unwrap() {
        if !name.ends_with(extension) {
            continue;
        }
        checked += 1;
        let file = read_scaffold(data(name)).unwrap_or_else(|e| panic!("{e}"));
        let s = &file.scaffold;
        let mut kinds: BTreeMap<&str, u64> = BTreeMap::new();
        for e in s.elements() {
            *kinds.entry(e.kind().name()).or_default() += 1;
        }
        for (kind, count) in known["kinds"].as_object().unwrap() {
            assert_eq!(kinds.remove(kind.as_str()), count.as_u64(), "{name} {kind}");
        }
        assert!(kinds.is_empty(), "{name}: {kinds:?}");
        let volume: f64 = s.elements().map(|e| e.volume()).sum();
        let expected = known["volume"].as_f64().unwrap();
        // Some writers keep single precision only.
        assert!(
            (volume - expected).abs() < 2e-6,
            "{name}: {volume} {expected}"
        );
        assert_eq!(s.components().len(), 1, "{name}");
        let positive = |e| matches!(e, Orientation::Positive);
        assert!(s.elements().all(|e| positive(e.orientation())), "{name}");
        // The quarter cylinder: a wrong node order would bulge elsewhere.
        for e in s.elements().filter(|e| e.kind().degree() == 2) {
            assert!(e.quality() > 0.1, "{name}: {}", e.quality());
        }
    }
    checked
}

#[test]
fn msh_files_have_the_elements_and_volume_that_gmsh_reports() {
    assert_eq!(agrees_with_gmsh(".msh"), 20);
}

#[test]
fn vtk_files_have_the_elements_and_volume_that_gmsh_reports() {
    assert_eq!(agrees_with_gmsh(".vtk"), 14);
    assert_eq!(agrees_with_gmsh(".vtu"), 25);
}

#[test]
fn written_grids_read_back_the_same() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["tet10_41_ascii.msh", "hex27_22_binary.msh"] {
        let original = read_scaffold(data(name)).unwrap().scaffold;
        let quality: Vec<f64> = original.elements().map(|e| e.quality()).collect();
        let path = dir.path().join("again.vtu");
        write_vtu(&path, &original, &[("quality <1>", &quality)]).unwrap();
        let again = read_scaffold(&path).unwrap().scaffold;
        assert_eq!(again.nodes(), original.nodes());
        assert_eq!(again.connectivity(), original.connectivity());
        let wrong = write_vtu(&path, &original, &[("short", &quality[1..])]).unwrap_err();
        assert!(wrong.to_string().contains("\"short\""), "{wrong}");
    }
}

const LEGACY: &str = "# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 float\n\
    0 0 0 1 0 0 0 1 0 1 1 0\n0 0 1 1 0 1 0 1 1 1 1 1\n";

#[test]
fn voxels_are_hexes_and_other_solids_are_refused() {
    let cells = |cells: &str| format!("{LEGACY}{cells}");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("voxel.vtk");
    std::fs::write(
        &path,
        cells("CELLS 1 9\n8 0 1 2 3 4 5 6 7\nCELL_TYPES 1\n11\n"),
    )
    .unwrap();
    let s = read_scaffold(&path).unwrap().scaffold;
    assert_eq!(s.element(0).kind(), Kind::Hex8);
    assert!((s.element(0).volume() - 1.0).abs() < 1e-12);

    let e = refusal(
        "a.vtk",
        &cells("CELLS 2 12\n4 0 1 2 4\n6 0 1 2 4 5 6\nCELL_TYPES 2\n10 15\n"),
    );
    assert_eq!(e.place(), Place::Item("element", 1));
    assert!(e.found().contains("pentagonal prism"), "{e}");
    let e = refusal("a.vtk", &cells("CELLS 1 5\n4 0 1 2 8\nCELL_TYPES 1\n10\n"));
    assert!(e.found().contains("node 8"), "{e}");
    let e = refusal("a.vtk", &cells("CELLS 1 5\n5 0 1 2 4\nCELL_TYPES 1\n10\n"));
    assert!(e.found().contains("cell 0"), "{e}");
    let e = refusal("a.vtk", &cells("CELLS 1 4\n3 0 1 2\nCELL_TYPES 1\n10\n"));
    assert!(e.expected().contains("4 for a Tet4"), "{e}");
    let e = refusal("a.vtk", &LEGACY.replace("POINTS 8", "POINTS 1000000000000"));
    assert!(e.found().contains("1000000000000"), "{e}");
    let e = refusal("a.vtk", &LEGACY.replace("UNSTRUCTURED_GRID", "FIELD"));
    assert!(e.expected().contains("UNSTRUCTURED_GRID"), "{e}");
    let e = refusal("a.vtk", &LEGACY.replace("UNSTRUCTURED_GRID", "POLYDATA"));
    assert!(e.found().contains("no elements"), "{e}");
}

#[test]
fn damaged_vtu_files_are_refused() {
    let text = std::fs::read_to_string(data("tet4_text.vtu")).unwrap();
    let change = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        refusal("a.vtu", &text.replacen(from, to, 1))
    };
    let e = change("UnstructuredGrid\"", "ImageData\"");
    assert!(e.found().contains("ImageData"), "{e}");
    let e = change("UnstructuredGrid\"", "PolyData\"");
    assert!(e.found().contains("no elements"), "{e}");
    let packed = std::fs::read_to_string(data("tet4_zlib.vtu")).unwrap();
    let e = refusal("a.vtu", &packed.replace("vtkZLib", "vtkLZ4"));
    assert!(e.hint().unwrap().contains("zlib"), "{e}");
    let e = change("NumberOfCells=\"62\"", "NumberOfCells=\"63\"");
    assert!(e.expected().contains("63 cells"), "{e}");
    let e = change("NumberOfPoints=\"", "NumberOfPoints=\"9999999999999");
    assert!(e.expected().contains("9999999999999"), "{e}");
    let e = change("</Cells>", "");
    assert!(e.found().contains("XML"), "{e}");
    let e = refusal("a.vtu", &text[..text.len() / 2]);
    assert!(e.hint().unwrap().contains("truncated"), "{e}");
    let e = refusal("a.vtu", "");
    assert!(e.expected().contains("VTK XML"), "{e}");
}

#[test]
fn the_bracket_is_a_sound_scaffold() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/bracket/bracket.msh");
    let s = read_scaffold(path).unwrap().scaffold;
    let report = s.validate().unwrap();
    assert_eq!(report.kinds, [(Kind::Tet10, 1668)]);
    assert_eq!((report.components, report.warnings()), (1, Vec::new()));
    // Only elements with an edge on a hole, the crown or a fillet are curved: affine maps are faster.
    assert!((100..800).contains(&report.curved), "{}", report.curved);
    let boundary = s.boundary(0, 0.01);
    assert!(super::is_closed(&boundary.mesh));
    let gap = (boundary.mesh.volume() / report.volume - 1.0).abs();
    assert!(gap < 1e-4, "{gap}");
}

#[test]
fn physical_volumes_become_groups() {
    for (name, group) in [("tet10", "shell"), ("hex8", "part \"one\"")] {
        // Saving all elements to 2.2 leaves the groups out: that is what 22_binary is.
        for form in ["22_ascii", "41_ascii", "41_binary"] {
            let file = read_scaffold(data(&format!("{name}_{form}.msh"))).unwrap();
            assert_eq!(file.groups.len(), 1, "{name}_{form}");
            assert_eq!(file.groups[0].name, group);
            let all: Vec<u32> = (0..file.scaffold.len() as u32).collect();
            assert_eq!(file.groups[0].elements, all);
            assert!(file.skipped > 0, "the floor's triangles or quads");
        }
    }
}

fn refusal(name: &str, text: &str) -> druse::io::ReadError {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, text).unwrap();
    read_scaffold(&path).unwrap_err()
}

const HEAD: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n";

#[test]
fn damaged_msh_files_are_refused_with_their_place() {
    let with = |elements: &str| refusal("a.msh", &format!("{HEAD}$Elements\n{elements}"));
    let e = with("2\n7 4 2 1 1 1 2 3 4\n8 29 2 1 1 1 2 3 4 1 2\n$EndElements\n");
    assert_eq!(e.place(), Place::ItemOnLine("element", 8, 14));
    assert!(e.found().contains("tetrahedron of order 3"), "{e}");
    let e = with("1\n7 4 2 1 1 1 2 3 9\n$EndElements\n");
    assert_eq!(e.place(), Place::Item("element", 7));
    assert!(e.found().contains("node 9"), "{e}");
    let e = with("1\n7 4 2 1 1 1 2 x 4\n$EndElements\n");
    assert_eq!(e.line(), Some(13));
    assert!(e.found().contains("\"x\""), "{e}");
    let e = with("1\n7 4 2 1 1 1 2");
    assert!(e.hint().unwrap().contains("truncated"), "{e}");
    let e = with("99999999999\n7 4 2 1 1 1 2 3 4\n$EndElements\n");
    assert!(e.found().contains("99999999999"), "{e}");
    let e = with("1\n7 15 2 1 1 1\n$EndElements\n");
    assert!(e.expected().contains("solid"), "{e}");
    let e = refusal("a.msh", &HEAD.replace("2.2", "3"));
    assert!(e.hint().unwrap().contains("msh41"), "{e}");
    let e = refusal("a.msh", "solid cube\n");
    assert_eq!(e.line(), Some(1));
    let e = refusal("a.stl", "solid cube\n");
    assert!(e.found().contains("no elements"), "{e}");
    let nan = HEAD.replace("2 1 0 0", "2 nan 0 0");
    let e = refusal(
        "a.msh",
        &format!("{nan}$Elements\n1\n7 4 0 1 2 3 4\n$EndElements\n"),
    );
    assert_eq!(e.place(), Place::Item("node", 2));
}

#[test]
fn elements_keep_the_numbers_of_their_file() {
    let text = format!("{HEAD}$Elements\n2\n3 2 0 1 2 3\n70 4 1 5 1 2 3 4\n$EndElements\n");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.msh");
    std::fs::write(&path, text).unwrap();
    let file = read_scaffold(&path).unwrap();
    assert_eq!(file.scaffold.number(0), 70);
    assert_eq!((file.skipped, file.groups[0].name.as_str()), (1, "5"));
    assert_eq!(file.scaffold.element(0).kind(), Kind::Tet4);
}
