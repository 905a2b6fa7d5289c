//! Names of the Platonic and Archimedean solids, and how they are spelled.

use druse::polymesh::{Interpreter, NoFiles, Script, seed};

/// Vertices, edges and faces of each solid, from any table of them, with names that it goes by.
const SOLIDS: [(&str, [usize; 3], &[&str]); 18] = [
    (
        "tetrahedron",
        [4, 6, 4],
        &["Tetrahedron", "regular tetrahedron"],
    ),
    ("cube", [8, 12, 6], &["hexahedron", "Regular-Hexahedron"]),
    (
        "octahedron",
        [6, 12, 8],
        &["rectified_tetrahedron", "Tetratetrahedron"],
    ),
    ("dodecahedron", [20, 30, 12], &["pentagonal-dodecahedron"]),
    ("icosahedron", [12, 30, 20], &["snub_tetrahedron"]),
    (
        "truncated_tetrahedron",
        [12, 18, 8],
        &["Truncated Tetrahedron"],
    ),
    (
        "truncated_cube",
        [24, 36, 14],
        &["truncated_hexahedron", "truncated-cube"],
    ),
    (
        "truncated_octahedron",
        [24, 36, 14],
        &[
            "omnitruncated tetrahedron",
            "tetrakaidecahedron",
            "truncated_tetratetrahedron",
        ],
    ),
    (
        "truncated_dodecahedron",
        [60, 90, 32],
        &["TruncatedDodecahedron"],
    ),
    (
        "truncated_icosahedron",
        [60, 90, 32],
        &["buckyball", "soccer-ball"],
    ),
    (
        "cuboctahedron",
        [12, 24, 14],
        &[
            "rectified_cube",
            "rectified octahedron",
            "cantellated_tetrahedron",
            "expanded-tetrahedron",
        ],
    ),
    (
        "icosidodecahedron",
        [30, 60, 32],
        &["rectified_dodecahedron", "rectified icosahedron"],
    ),
    (
        "small_rhombicuboctahedron",
        [24, 48, 26],
        &[
            "rhombicuboctahedron",
            "rhombocuboctahedron",
            "cantellated_cube",
            "Expanded Octahedron",
        ],
    ),
    (
        "small_rhombicosidodecahedron",
        [60, 120, 62],
        &[
            "rhombicosidodecahedron",
            "cantellated icosahedron",
            "expanded_dodecahedron",
        ],
    ),
    (
        "great_rhombicuboctahedron",
        [48, 72, 26],
        &[
            "truncated_cuboctahedron",
            "rhombitruncated_cuboctahedron",
            "omnitruncated_cube",
            "cantitruncated octahedron",
            "Truncated-Cuboctahedron",
            "great rhombicuboctahedron",
        ],
    ),
    (
        "great_rhombicosidodecahedron",
        [120, 180, 62],
        &[
            "truncated_icosidodecahedron",
            "rhombitruncated_icosidodecahedron",
            "omnitruncated_dodecahedron",
            "cantitruncated-icosahedron",
            "TRUNCATED ICOSIDODECAHEDRON",
        ],
    ),
    (
        "snub_cube",
        [24, 60, 38],
        &["snub_cuboctahedron", "Snub Cube", "snub-hexahedron"],
    ),
    (
        "snub_dodecahedron",
        [60, 150, 92],
        &["snub_icosidodecahedron"],
    ),
];

fn made(script: &str) -> Result<[usize; 3], (String, Option<String>)> {
    let mut interpreter = Interpreter::new(&NoFiles);
    let done = Script::parse(script).and_then(|s| s.run(&mut interpreter, None));
    done.map_err(|e| (e.message, e.hint))?;
    let s = interpreter.mesh().unwrap().summary();
    let edge = s.edge_lengths;
    assert!(
        (edge.0 - 2.0).abs() < 1e-9 && (edge.1 - 2.0).abs() < 1e-9,
        "{script}: {edge:?}"
    );
    Ok([s.vertices, s.edges, s.faces])
}

#[test]
fn every_solid_goes_by_all_its_names() {
    assert_eq!(seed::solids(), SOLIDS.map(|s| s.0));
    for (own, counts, names) in SOLIDS {
        for name in names.iter().chain(&[own]) {
            assert_eq!(seed::canonical(name), Some(own), "{name}");
            // Names of several words, a comment and a second step on the line.
            for script in [
                format!("{name} edge=2"),
                format!("{name}   edge=2 # as large\n"),
                format!("cube; {name} edge=2; renumber"),
            ] {
                assert_eq!(made(&script), Ok(counts), "{script}");
            }
        }
    }
    for name in [
        "rectified",
        "truncated",
        "cube2",
        "",
        "cub e1",
        "dodeca(hedron)",
    ] {
        assert_eq!(seed::canonical(name), None, "{name}");
    }
}

#[test]
fn a_name_that_is_none_gets_the_nearest_and_the_list() {
    let (message, hint) = made("truncated_cuboctahedrn edge=2").unwrap_err();
    assert!(
        message.contains("no step is called \"truncated_cuboctahedrn\""),
        "{message}"
    );
    let hint = hint.unwrap();
    assert!(
        hint.starts_with("did you mean \"great_rhombicuboctahedron\"?"),
        "{hint}"
    );
    for name in seed::solids() {
        assert!(hint.contains(name), "{name} is not in {hint}");
    }
    let (_, hint) = made("rhombic_heptahedron").unwrap_err();
    assert!(hint.unwrap().contains("the solids are tetrahedron, cube"));
    let (_, hint) = made("rhombic triacontahedron edge=2").unwrap_err();
    assert!(hint.unwrap().contains("the solids are tetrahedron, cube"));
    let (_, hint) = made("Truncated Cubeoctahedron edge=2").unwrap_err();
    let hint = hint.unwrap();
    assert!(
        hint.starts_with("did you mean \"great_rhombicuboctahedron\"?"),
        "{hint}"
    );
    let (_, hint) = made("extrud cubical").unwrap_err();
    assert_eq!(hint.as_deref(), Some("did you mean \"extrude\"?"));
}
