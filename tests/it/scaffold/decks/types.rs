//! Types of elements, and elements written in every way.

use super::{CUBE, assert_near, group, read, refusal, solids, stored, volume};
use druse::io::{ElementFile, SurfaceFile};
use druse::scaffold::Kind;
use std::fmt::Write as _;

fn surface(text: &str) -> SurfaceFile {
    match read(text).unwrap_or_else(|e| panic!("{e}")) {
        ElementFile::Surface(file) => *file,
        ElementFile::Solids(_) => panic!("solids"),
    }
}

#[test]
fn continuum_shells_are_solids() {
    let file = solids(stored("sc8r.inp"));
    assert_eq!(file.scaffold.len(), 10);
    assert_near(volume(&file), 10.0);
    assert_eq!(group(&file, "A").unwrap().len(), 5);
    assert_eq!(group(&file, "B").unwrap().len(), 5);
    for kind in [
        "SC8R", "SC8RT", "CSS8", "C3D8IH", "c3d8rht", "F3D8", "FC3D8", "Q3D8",
    ] {
        let text = format!("*NODE\n{CUBE}*ELEMENT, TYPE={kind}\n1,1,2,3,4,5,6,7,8\n");
        assert_near(volume(&solids(read(&text))), 1.0);
    }
    for kind in ["SC6R", "SC6RT", "C3D6", "AC3D6"] {
        let text = format!("*NODE\n{CUBE}*ELEMENT, TYPE={kind}\n1,1,2,4,5,6,8\n");
        assert_near(volume(&solids(read(&text))), 0.5);
    }
}

#[test]
fn faces_of_every_type() {
    let Ok(ElementFile::Surface(file)) = stored("s4r5.inp") else {
        panic!("no surface");
    };
    assert_eq!(file.surface.kinds(), [(Kind::Quad4, 2)]);
    let Ok(ElementFile::Surface(file)) = stored("only_stri65.inp") else {
        panic!("no surface");
    };
    assert_eq!(file.surface.kinds(), [(Kind::Tri6, 1)]);
    for (types, kind, nodes) in [
        (
            "S4 S4R S4R5 CPS4R CPE4H CAX4P CGAX4R M3D4 SFM3D4R R3D4 DC2D4 AC2D4 DS4",
            Kind::Quad4,
            "1,2,3,4",
        ),
        ("S3 S3R STRI3 CPS3 CAX3 DCAX3 R3D3 US3", Kind::Tri3, "1,2,3"),
        (
            "S8R S8R5 CPE8RP CAX8R M3D8R",
            Kind::Quad8,
            "1,2,3,4,5,6,7,8",
        ),
        ("STRI65 S6 CPS6M CGAX6", Kind::Tri6, "1,2,3,4,5,6"),
        ("S9R5 M3D9R", Kind::Quad9, "1,2,3,4,5,6,7,8,9"),
    ] {
        for name in types.split(' ') {
            let text = format!("*NODE\n{CUBE}9,5,5,5\n*ELEMENT, TYPE={name}\n7,{nodes}\n");
            assert_eq!(surface(&text).surface.kinds(), [(kind, 1)], "{name}");
        }
    }
}

#[test]
fn what_has_no_volume_is_counted_and_what_is_unknown_refused() {
    let base = format!("*NODE\n{CUBE}*ELEMENT, TYPE=C3D8\n1,1,2,3,4,5,6,7,8\n");
    let text = base.clone()
        + "*ELEMENT, TYPE=B32R\n11,1,2,3\n12,2,\n3,4\n*ELEMENT, TYPE=MASS, ELSET=M\n13,1\n\
           *ELEMENT, TYPE=SPRINGA\n14,1,2\n*ELEMENT, TYPE=CONN3D2\n15,,2\n*ELEMENT, TYPE=D\n16,0,1,2\n\
           *ELEMENT, TYPE=DCOUP3D\n17,1\n*ELEMENT, TYPE=S4\n18,1,2,3,4\n";
    let file = solids(read(&text));
    assert_eq!((file.scaffold.len(), file.skipped), (1, 8));
    let note = "7 elements without volume or surface are skipped: \
                2 B32R, 1 CONN3D2, 1 D, 1 DCOUP3D, 1 MASS, 1 SPRINGA";
    assert_eq!(file.notes, [note]);
    for name in [
        "COH3D8", "CIN3D8", "GK3D8", "F3D4", "U1", "Z3", "BANANA", "C3D7", "S5", "C3D",
    ] {
        let e = refusal(&format!("{base}*ELEMENT, TYPE={name}\n9,1,2,3,4,5,6,7,8\n"));
        assert!(e.found().contains(name) && e.line().is_some(), "{e}");
    }
    let e = refusal("*NODE\n1,0,0,0\n2,1,0,0\n*ELEMENT, TYPE=B31\n1,1,2\n");
    assert!(e.found().contains("1 elements without volume"), "{e}");
}

/// A unit cube's 27 nodes on a lattice of thirds times two.
fn lattice(at: [i32; 3]) -> u32 {
    (1 + at[0] + 3 * at[1] + 9 * at[2]) as u32
}

fn lattice_nodes() -> String {
    let mut text = "*NODE\n".to_owned();
    for n in 0..27 {
        let [x, y, z] = [n % 3, n / 3 % 3, n / 9].map(|c| f64::from(c) / 2.0);
        let _ = writeln!(text, "{},{x},{y},{z}", n + 1);
    }
    text
}

#[test]
fn nodes_within_faces_stand_in_the_order_of_abaqus() {
    let corners = [
        [0, 0, 0],
        [2, 0, 0],
        [2, 2, 0],
        [0, 2, 0],
        [0, 0, 2],
        [2, 0, 2],
        [2, 2, 2],
        [0, 2, 2],
    ];
    let edges = [
        [1, 0, 0],
        [2, 1, 0],
        [1, 2, 0],
        [0, 1, 0],
        [1, 0, 2],
        [2, 1, 2],
        [1, 2, 2],
        [0, 1, 2],
        [0, 0, 1],
        [2, 0, 1],
        [2, 2, 1],
        [0, 2, 1],
    ];
    // The centre, then the faces 1-2-3-4, 5-8-7-6, 1-5-6-2, 2-6-7-3, 3-7-8-4, 4-8-5-1.
    let inner = [
        [1, 1, 1],
        [1, 1, 0],
        [1, 1, 2],
        [1, 0, 1],
        [2, 1, 1],
        [1, 2, 1],
        [0, 1, 1],
    ];
    let list = |all: &[[i32; 3]]| {
        let words: Vec<String> = all.iter().map(|p| lattice(*p).to_string()).collect();
        words.join(",")
    };
    let hex27 = [&corners[..], &edges, &inner].concat();
    let text = format!(
        "{}*ELEMENT, TYPE=C3D27R\n1,{}\n",
        lattice_nodes(),
        list(&hex27)
    );
    let file = solids(read(&text));
    assert_eq!(file.scaffold.element(0).kind(), Kind::Hex27);
    assert!(file.scaffold.element(0).is_affine());
    assert_near(volume(&file), 1.0);

    let corners = [
        [0, 0, 0],
        [2, 0, 0],
        [0, 2, 0],
        [0, 0, 2],
        [2, 0, 2],
        [0, 2, 2],
    ];
    let edges = [
        [1, 0, 0],
        [1, 1, 0],
        [0, 1, 0],
        [1, 0, 2],
        [1, 1, 2],
        [0, 1, 2],
        [0, 0, 1],
        [2, 0, 1],
        [0, 2, 1],
    ];
    let sides = [[1, 0, 1], [1, 1, 1], [0, 1, 1]];
    let wedge15 = [&corners[..], &edges].concat();
    let wedge18 = [&corners[..], &edges, &sides].concat();
    for (nodes, kind) in [(wedge15, Kind::Wedge15), (wedge18, Kind::Wedge18)] {
        let (first, rest) = nodes.split_at(15);
        let rest = if rest.is_empty() {
            String::new()
        } else {
            format!(",\n{}", list(rest))
        };
        let text = format!(
            "{}*ELEMENT, TYPE=C3D15V\n1,{}{rest}\n",
            lattice_nodes(),
            list(first)
        );
        let file = solids(read(&text));
        assert_eq!(file.scaffold.element(0).kind(), kind);
        assert!(file.scaffold.element(0).is_affine());
        assert_near(volume(&file), 0.5);
    }
    let text = format!(
        "{}*ELEMENT, TYPE=C3D15V\n1,{},\n1\n",
        lattice_nodes(),
        list(&hex27[..15])
    );
    assert!(refusal(&text).found().contains("16 nodes"));
}

#[test]
fn elements_on_many_lines_and_given_again() {
    let nodes = format!("*NODE, NSET=ALL,\n{CUBE}*NODE\n1,0,0,0\n");
    let text = nodes.clone()
        + "*ELEMENT, TYPE=C3D8, ELSET=A,\n7,1,2,3,\n4,5,6\n7,8\n*ELEMENT, TYPE=C3D8, ELSET=B\n7,5,6,7,8,1,2,3,4\n";
    let file = solids(read(&text));
    assert_eq!(file.scaffold.len(), 1);
    assert_near(volume(&file), 1.0);
    assert_eq!(
        (group(&file, "A"), group(&file, "B")),
        (Some(vec![0]), Some(vec![0]))
    );
    assert!(file.notes[0].contains("1 duplicate elements were merged: elements 7"));
    let e = refusal(&(nodes.clone() + "*NODE\n1,0,0,.1\n"));
    assert!(e.found().contains("second node"), "{e}");
    let e = refusal(&(nodes + "*ELEMENT, TYPE=C3D4\n7,1,2,3,5\n7,1,2,3,6\n"));
    assert!(e.found().contains("second element"), "{e}");
}
