//! Universal files of I-DEAS.

use super::zoo::{HEX, TET, WEDGE, check, data, facts, read};
use druse::io::{Place, read_elements};

/// Gmsh writes no pyramids into them.
const VOLUME: f64 = HEX + WEDGE + TET;
const GROUPS: [&str; 3] = ["PhysicalVolume1", "PhysicalVolume4", "wedge_it"];

#[test]
fn files_of_gmsh_are_read_in_both_orders() {
    for (name, kinds) in [
        ("zoo.unv", ["Hex8", "Tet4", "Wedge6"]),
        ("zoo2.unv", ["Hex20", "Tet10", "Wedge15"]),
    ] {
        let file = read_elements(data(name)).unwrap_or_else(|e| panic!("{e}"));
        check(name, &file, &kinds, VOLUME, &GROUPS);
    }
}

/// A tet and a beam with old datasets, units, and no groups.
const OLD: &str = "    -1\n   151\nany model\n    -1\n    -1\n   164\n         2Foot (pound f)               0\n\
    3.2808D+00  0.2248D+00  1.8D+00\n    -1\n    -1\n    15\n\
         1         0         0        11  0.00000E+00  0.00000E+00  0.00000E+00\n\
         2         0         0        11  1.00000E+00  0.00000E+00  0.00000E+00\n\
         3         0         0        11  0.00000E+00  1.00000E+00  0.00000E+00\n    -1\n    -1\n   781\n\
         4         0         0        11\n  0.0000000000000000D+00  0.0000000000000000D+00  1.0000000000000000D+00\n    -1\n\
    -1\n   780\n\
        17       111         1        30         1         1         7         4\n\
         1         2         3         4\n\
        18        21         1         5         1         1         7         2\n\
         0         1         1\n         1         2\n    -1\n    -1\n  2429\n\
         6         0         0         0         0         0         2\nnodes only\n\
         7         1         7         2\n    -1\n";

#[test]
fn old_datasets_are_read_and_units_noted() {
    let found = facts(&read("a.unv", OLD).unwrap_or_else(|e| panic!("{e}")));
    assert!((found.volume - 1.0 / 6.0).abs() < 1e-12);
    assert_eq!(found.skipped, 1);
    // The physical property, since the group has no elements.
    assert_eq!(found.groups, [("30".to_owned(), vec![0])]);
    assert!(
        found.notes[0].contains("\"Foot (pound f)\""),
        "{:?}",
        found.notes
    );
}

#[test]
fn damaged_files_are_refused_with_their_place() {
    let refusal = |from: &str, to: &str| {
        assert!(OLD.contains(from), "{from}");
        read("a.unv", OLD.replacen(from, to, 1)).unwrap_err()
    };
    let e = refusal("    -1\n   151", "solid\n   151");
    assert!(e.hint().unwrap().contains("I-DEAS"), "{e}");
    let e = refusal("       111 ", "       120 ");
    assert!(e.found().contains("type 120"), "{e}");
    assert!(
        matches!(e.place(), Place::ItemOnLine("element", 17, _)),
        "{e}"
    );
    let e = refusal("       111 ", "       118 ");
    assert!(e.expected().contains("10 for a Tet10"), "{e}");
    let e = refusal("  1.00000E+00", "  1.0000xE+00");
    assert!(e.found().contains("1.0000xE+00"), "{e}");
    let e = refusal("   780\n", "    71\n");
    assert!(e.found().contains("dataset 71"), "{e}");
    let e = refusal("   151\n", "   58b\n");
    assert!(e.hint().unwrap().contains("binary"), "{e}");
    let e = refusal(
        "\n2         0         0        11",
        "\n2         3         0        11",
    );
    assert!(e.found().contains("coordinate system 3"), "{e}");
    let e = refusal("nodes only\n", "");
    assert_eq!(e.class().exit_code(), 65, "{e}");
    let e = read("a.unv", &OLD[..OLD.len() - 60]).unwrap_err();
    assert!(e.hint().unwrap().contains("truncated"), "{e}");
    let e = read("a.unv", "").unwrap_err();
    assert!(e.found().contains("empty"), "{e}");
}
