//! Medit meshes, text and binary.

use super::zoo::{ELEMENTS, LINEAR, NODES, VOLUME, check, data, facts, read};
use druse::io::{ElementFile, read_elements};

const GROUPS: [&str; 4] = ["1", "2", "3", "4"];

#[test]
fn meshes_of_meshio_and_gmsh_are_read() {
    for name in ["zoo.mesh", "zoo.meshb"] {
        let file = read_elements(data(name)).unwrap_or_else(|e| panic!("{e}"));
        check(name, &file, &LINEAR, VOLUME, &GROUPS);
    }
    let found = facts(&read_elements(data("tet10.mesh")).unwrap());
    assert_eq!((found.kinds["Tet10"], found.curved), (1, 0));
    assert!((found.volume - 1.0 / 6.0).abs() < 1e-12);
    assert_eq!((found.groups[0].0.as_str(), found.skipped), ("6", 1));
}

#[test]
fn words_stand_in_any_lines_and_case() {
    let text = std::fs::read_to_string(data("zoo.mesh")).unwrap();
    let loose = text
        .replace("Dimension 3", "# a comment\nDIMENSION\n3")
        .replace(
            "MeshVersionFormatted 2",
            "meshversionformatted\n\n 4 # version",
        )
        .replace("Vertices\n12\n", "vertices 12 ")
        .replace(
            "Prisms\n1\n",
            "Ridges\n1\n1\nNormals 1\n0.5 0 1e-3\nPENTAHEDRA 1 ",
        )
        .replace("e+00", "D+00")
        .replace("Hexahedra", "Corners 2 1 2 RequiredVertices 1 3 hexahedra")
        .replace(
            "\nEnd\n",
            "\nSolAtVertices 1 1 1 0.5 end words after the end",
        );
    let file = read("a.mesh", &loose).unwrap_or_else(|e| panic!("{e}\n{loose}"));
    check("loose", &file, &LINEAR, VOLUME, &GROUPS);
    assert_eq!(facts(&file).notes, ["the values SolAtVertices are ignored"]);
    let joined = text
        .replace("MeshVersionFormatted 2", "MeshVersionFormatted1")
        .replace('\n', "\r\n");
    check(
        "joined",
        &read("a.mesh", joined).unwrap(),
        &LINEAR,
        VOLUME,
        &GROUPS,
    );
}

#[test]
fn planes_of_two_dimensions_lie_at_zero() {
    let text = "MeshVersionFormatted 1 Dimension 2 Vertices 4 0 0 0 2 0 0 2 1 0 0 1 0 \
        Quadrilaterals 1 1 2 3 4 -5 End";
    let ElementFile::Surface(file) = read("a.mesh", text).unwrap() else {
        panic!("a surface");
    };
    let plate = file.surface.plate(0.5).unwrap();
    let volume: f64 = plate.elements().map(|e| e.volume()).sum();
    assert!((volume - 1.0).abs() < 1e-12);
    assert_eq!(file.groups[0].name, "-5");
}

/// A binary file of version 1 to 4, with an unknown section.
fn binary(version: u32, big: bool) -> Vec<u8> {
    let mut out = Vec::new();
    let put = |out: &mut Vec<u8>, mut bytes: Vec<u8>| {
        if big {
            bytes.reverse();
        }
        out.extend(bytes);
    };
    let int = |out: &mut Vec<u8>, n: i64| match version {
        4 => put(out, n.to_le_bytes().into()),
        _ => put(out, (n as i32).to_le_bytes().into()),
    };
    let keyword = |out: &mut Vec<u8>, code: i32, body: Vec<u8>| {
        put(out, code.to_le_bytes().into());
        let size = if version >= 3 { 8 } else { 4 };
        let next = (out.len() + size + body.len()) as i64;
        match size {
            8 => put(out, next.to_le_bytes().into()),
            _ => put(out, (next as i32).to_le_bytes().into()),
        }
        out.extend(body);
    };
    put(&mut out, 1i32.to_le_bytes().into());
    put(&mut out, version.to_le_bytes().into());
    // The dimension has 32 bits in every version.
    let mut body = Vec::new();
    put(&mut body, 3i32.to_le_bytes().into());
    keyword(&mut out, 3, body);
    let mut body = Vec::new();
    int(&mut body, 12);
    for at in NODES {
        for c in at {
            match version {
                1 => put(&mut body, (c as f32).to_le_bytes().into()),
                _ => put(&mut body, c.to_le_bytes().into()),
            }
        }
        int(&mut body, 0);
    }
    keyword(&mut out, 4, body);
    keyword(&mut out, 999, vec![7; 33]);
    for (group, (code, (_, _, nodes))) in
        (1..).zip([10, 9, 49, 8, 6, 7, 5].into_iter().zip(ELEMENTS))
    {
        let mut body = Vec::new();
        int(&mut body, 1);
        for n in nodes {
            int(&mut body, i64::from(*n));
        }
        int(&mut body, group);
        keyword(&mut out, code, body);
    }
    keyword(&mut out, 54, Vec::new());
    out
}

#[test]
fn binary_versions_are_read_in_both_byte_orders() {
    for version in 1..=4 {
        for big in [false, true] {
            let name = format!("version {version}, big {big}");
            let file =
                read("a.meshb", binary(version, big)).unwrap_or_else(|e| panic!("{name}: {e}"));
            check(&name, &file, &LINEAR, VOLUME, &GROUPS);
            let notes = facts(&file).notes;
            assert_eq!(notes, ["the section of code 999 is ignored"]);
        }
    }
}

#[test]
fn what_is_not_understood_is_refused() {
    let text = std::fs::read_to_string(data("zoo.mesh")).unwrap();
    let refusal = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        read("a.mesh", text.replacen(from, to, 1)).unwrap_err()
    };
    let e = refusal("MeshVersionFormatted 2", "<mesh>");
    assert!(e.hint().unwrap().contains("Medit"), "{e}");
    let e = refusal("MeshVersionFormatted 2", "MeshVersionFormatted 7");
    assert_eq!((e.found(), e.line()), ("\"7\"", Some(1)));
    let e = refusal("Dimension 3", "Dimension 4");
    assert!(e.found().contains("dimension 4"), "{e}");
    let e = refusal("Dimension 3", "");
    assert!(e.found().contains("before Dimension"), "{e}");
    let e = refusal("Prisms", "Polytopes");
    assert!(e.found().contains("\"Polytopes\""), "{e}");
    // As gmsh writes a hex of 20 nodes.
    let e = refusal("6 7 8 1\n", "6 7 8 1 9 10\n");
    assert!(
        e.found().contains("\"9\"") && e.hint().unwrap().contains("gmsh"),
        "{e}"
    );
    let e = refusal(
        "Prisms\n1\n2 9 3 6 10 7 2",
        "PrismsP2\n1\n2 9 3 6 10 7 1 1 1 1 1 1 1 1 1 1 1 1 2",
    );
    assert!(e.found().contains("1 PrismsP2"), "{e}");
    let e = refusal("Vertices\n12", "Vertices\n99999999");
    assert!(e.found().contains("99999999"), "{e}");
    let e = refusal("Tetrahedra\n1\n9", "Tetrahedra\n1\n-9");
    assert!(e.found().contains("vertex -9"), "{e}");
    let e = refusal("Tetrahedra\n1\n9", "Tetrahedra\n1\n13");
    assert!(e.found().contains("node 13"), "{e}");
    let e = refusal("Tetrahedra\n1\n9", "Tetrahedra\n1\n9.5");
    assert!(e.found().contains("9.5"), "{e}");
    let e = read("a.mesh", &text[..600]).unwrap_err();
    assert!(e.hint().unwrap().contains("truncated"), "{e}");
    let good = binary(2, false);
    let e = read("a.meshb", &good[..good.len() / 2]).unwrap_err();
    assert_eq!(e.class().exit_code(), 65, "{e}");
}
