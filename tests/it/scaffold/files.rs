//! Scaffolds read from files against the counts and volumes that gmsh gives.

use druse::io::{Place, read_scaffold};
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
    let e = with("2\n7 4 2 1 1 1 2 3 4\n8 6 2 1 1 1 2 3 4 1 2\n$EndElements\n");
    assert_eq!(e.place(), Place::ItemOnLine("element", 8, 14));
    assert!(e.found().contains("wedge"), "{e}");
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
    let e = refusal("a.msh", &HEAD.replace("2.2", "4"));
    assert!(e.hint().unwrap().contains("msh41"), "{e}");
    let e = refusal("a.msh", "solid cube\n");
    assert_eq!(e.line(), Some(1));
    let e = refusal("a.stl", "solid cube\n");
    assert!(e.found().contains(".stl"), "{e}");
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
