//! Nastran bulk data: fields, continuations, coordinate systems, elements of both orders.

use super::zoo::{HEX, LINEAR, TET, VOLUME, WEDGE, check, data, facts, read};
use druse::io::{ElementFile, Place, ReadError, read_elements, read_scaffold};
use std::fmt::Write as _;

const GROUPS: [&str; 4] = ["1", "2", "3", "4"];

#[test]
fn decks_of_gmsh_and_meshio_are_read_in_every_field_format() {
    for name in [
        "zoo_small.bdf",
        "zoo_large.bdf",
        "zoo_free.bdf",
        "zoo_meshio.bdf",
    ] {
        let file = read_elements(data(name)).unwrap_or_else(|e| panic!("{e}"));
        check(name, &file, &LINEAR, VOLUME, &GROUPS);
        assert_eq!(facts(&file).notes, ["skipped cards: 1 CBAR"]);
    }
    for name in ["zoo2_small.bdf", "zoo2_large.bdf", "zoo2_free.bdf"] {
        let file = read_elements(data(name)).unwrap_or_else(|e| panic!("{e}"));
        let kinds = ["Hex20", "Tet10", "Wedge15"];
        check(name, &file, &kinds, HEX + WEDGE + TET, &["1", "2", "4"]);
    }
}

/// A deck as people write them: sections, comments, tabs, every field format, numbers of all kinds.
const DECK: &str = "$ a hex on a tet's side\nSOL 101\nCEND\nTITLE = GRID,1,2\n  SUBCASE 1\n  SET 1 = 5,6\n\
    BEGIN BULK\nPARAM,POST,-1\nGRDSET\t\t0\n\
    GRID           1              0.      0.      0.\n\
    grid*   2                               10.-1           0.D+0\n\
    *                   .0\n\
    GRID,3,,1.,+1.0E0,0. $ in free field\n\
    GRID*   4                                             0.            1.+0*A\n\
    $ between\n*A                    0.\n\
    GRID\t5\t\t0.\t0.\t1.\n\
    GRID           6              1.      0.      1.       0\n\
    GRID           7              1.      1.      1.\n\
    GRID           8              0.      1.     1.0\n\
    GRID          99             -1.      0.      0.\n\
    GRID          98              9.      9.      9.\n\
    MAT1           1   2.+11              .3\n\
    PSOLID         7       1\n\
    CHEXA         10       7       1       2       3       4       5       6+H\n\
    +H             7       8\n\
    CTETRA  20      8       1       5       4       99\n\
    CONM2,30,1,,2.5\nRBE2,31,1,123456,2,3,4\nCELAS1,32,1,1,1\nCELAS1,33,1,2,1\n\
    ENDDATA\nGRID,1,1,junk\n";

#[test]
fn decks_by_hand_are_read() {
    for text in [DECK.to_owned(), DECK.replace('\n', "\r\n")] {
        let file = read("a.nas", text).unwrap_or_else(|e| panic!("{e}"));
        let found = facts(&file);
        assert_eq!(found.kinds["Hex8"] + found.kinds["Tet4"], 2);
        assert!((found.volume - 7.0 / 6.0).abs() < 1e-12, "{found:?}");
        assert_eq!(
            found.groups,
            [("7".to_owned(), vec![0]), ("8".to_owned(), vec![1])]
        );
        assert_eq!(found.skipped, 4);
        assert_eq!(found.notes, ["skipped cards: 2 CELAS1, 1 CONM2, 1 RBE2"]);
        let ElementFile::Solids(file) = file else {
            panic!("solids");
        };
        assert_eq!((file.unused_nodes, file.scaffold.number(1)), (1, 20));
    }
}

/// The unit cube in a coordinate system, as a deck; `points` are its corners there.
fn cube(cards: &str, system: u64, points: [[f64; 3]; 8]) -> Result<ElementFile, ReadError> {
    let mut text = format!("{cards}\n");
    for (n, p) in (1..).zip(points) {
        let [a, b, c] = p.map(|x| format!("{x:.12}"));
        let _ = write!(text, "GRID*,{n},{system},{a},{b}\n*,{c}\n");
    }
    text += "CHEXA,1,1,1,2,3,4,5,6,+\n+,7,8\n";
    read("a.bdf", text)
}

const CORNERS: [[f64; 3]; 8] = [
    [1., 1., 1.],
    [2., 1., 1.],
    [2., 2., 1.],
    [1., 2., 1.],
    [1., 1., 2.],
    [2., 1., 2.],
    [2., 2., 2.],
    [1., 2., 2.],
];

fn cylindrical([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x.hypot(y), y.atan2(x).to_degrees(), z]
}

fn spherical([x, y, z]: [f64; 3]) -> [f64; 3] {
    let r = (x * x + y * y + z * z).sqrt();
    [r, (z / r).acos().to_degrees(), y.atan2(x).to_degrees()]
}

#[test]
fn coordinate_systems_place_points() {
    let turned = |[x, y, z]: [f64; 3]| [10.0 - y, 20.0 + x, 30.0 + z];
    let placed = |name: &str, file: ElementFile, place: &dyn Fn([f64; 3]) -> [f64; 3]| {
        let ElementFile::Solids(file) = file else {
            panic!("solids");
        };
        assert!(
            (file.scaffold.element(0).volume() - 1.0).abs() < 1e-9,
            "{name}"
        );
        for (found, corner) in file.scaffold.nodes().iter().zip(CORNERS) {
            let expected = place(corner);
            let gap = (0..3)
                .map(|a| (found[a] - expected[a]).abs())
                .fold(0.0, f64::max);
            assert!(gap < 1e-9, "{name}: {found:?}, not {expected:?}");
        }
    };
    let same = |p| p;
    // The axes turned by a quarter about z, the origin at (10, 20, 30).
    let frame = "10.,20.,30.,10.,20.,31.,+\n+,10.,21.,35.";
    let rectangular = format!("CORD2R,5,0,{frame}");
    placed(
        "rectangular",
        cube(&rectangular, 5, CORNERS).unwrap(),
        &turned,
    );
    let round = format!("CORD2C,5,,{frame}");
    placed(
        "cylindrical",
        cube(&round, 5, CORNERS.map(cylindrical)).unwrap(),
        &turned,
    );
    let ball = format!("CORD2S,5,0,{frame}");
    placed(
        "spherical",
        cube(&ball, 5, CORNERS.map(spherical)).unwrap(),
        &turned,
    );
    placed(
        "default",
        cube(
            "GRDSET,,7\nCORD2C,7,,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.",
            0,
            CORNERS,
        )
        .unwrap(),
        &same,
    );

    // Systems that stand in others, the first last; its points are cylindrical in system 8: the origin
    // at radius 2 and azimuth 90, so at (0, 2, 0), its x axis towards the far y.
    let chain = "CORD2R,9,8,2.,90.,0.,2.,90.,1.,+\n+,3.,90.,0.\n\
        CORD2C,8,6,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.\nCORD2R,6,,0.,0.,5.,0.,0.,6.,+\n+,1.,0.,5.";
    placed("chain", cube(chain, 9, CORNERS).unwrap(), &|[x, y, z]| {
        [-y, 2.0 + x, z + 5.0]
    });

    // By grid points that are themselves given in another system, two systems on a card.
    let grids = "CORD2C,3,,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.\nGRID,101,3,1.,180.,0.\nGRID,102,,-1.,0.,4.\n\
        GRID,103,,-1.,7.,1.\nCORD1R,4,101,102,103,5,102,101,103";
    placed("grids", cube(grids, 4, CORNERS).unwrap(), &|[x, y, z]| {
        [-1.0 - y, x, z]
    });
    placed("second", cube(grids, 5, CORNERS).unwrap(), &|[x, y, z]| {
        [-1.0 + y, x, 4.0 - z]
    });
    // GRDSET's system where a grid point names none.
    let text = "GRDSET,,5\nCORD2C,5,0,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.\nGRID,1,,2.,90.,0.\n\
        GRID,2,0,1.,0.,0.\nGRID,3,0,0.,1.,0.\nGRID,4,0,0.,0.,1.\nCTETRA,1,1,1,2,3,4\n";
    let ElementFile::Solids(file) = read("a.bdf", text).unwrap() else {
        panic!("solids");
    };
    let first = file.scaffold.nodes()[0];
    assert!(
        (first[0].abs() + (first[1] - 2.0).abs()) < 1e-12,
        "{first:?}"
    );
}

#[test]
fn coordinate_systems_that_lead_nowhere_are_refused() {
    let refusal = |cards: &str, system| cube(cards, system, CORNERS).unwrap_err();
    let e = refusal("", 5);
    assert_eq!(e.place(), Place::ItemOnLine("node", 1, 2));
    assert!(e.found().contains("system 5"), "{e}");
    let e = refusal("CORD2R,5,6,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.", 5);
    assert!(e.found().contains("system 6"), "{e}");
    let loop_of_two =
        "CORD2R,5,6,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.\nCORD2R,6,5,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.";
    let e = refusal(loop_of_two, 5);
    assert!(e.found().contains("defined in itself"), "{e}");
    let e = refusal("CORD2R,5,0,0.,0.,0.,0.,0.,1.,+\n+,0.,0.,7.", 5);
    assert!(e.found().contains("one line"), "{e}");
    let e = refusal("CORD1R,5,1,2,77", 5);
    assert!(e.found().contains("grid point 77"), "{e}");
    let e = refusal("CORD1R,5,1,2,3", 5);
    assert!(e.found().contains("defined in itself"), "{e}");
    let e = refusal("CORD3G,5,1,2,3", 5);
    assert!(e.found().contains("CORD3G"), "{e}");
    let e = refusal("CORD1R,5,1,2,3\nCORD1R,5,1,2,4", 5);
    assert!(e.found().contains("which line 1 defines"), "{e}");
    // A chain of ten thousand systems is no deep recursion.
    let chain: Vec<String> = (1..10_000u32)
        .map(|n| {
            format!(
                "CORD2R,{n},{},0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.\n",
                (n + 1) % 10_000
            )
        })
        .collect();
    cube(&chain.concat(), 1, CORNERS).unwrap();
}

/// Grid points of the unit tet and the middle of its edges but that of 3 and 4.
const TET10: &str = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,0.,1.,0.\nGRID,4,,0.,0.,1.\n\
    GRID,5,,.5,0.,0.\nGRID,6,,.5,.5,0.\nGRID,7,,0.,.5,0.\nGRID,8,,0.,0.,.5\nGRID,9,,.5,0.,.5\n";

#[test]
fn mid_nodes_that_are_left_out_lie_in_the_middle() {
    for last in ["", "0"] {
        let text = format!("{TET10}CTETRA,1,1,1,2,3,4,5,6,+\n+,7,8,9,{last}\n");
        let found = facts(&read("a.bdf", &text).unwrap());
        // All that follows the last node is blank: nine of ten are given, or eight where 0 stands for one.
        assert_eq!((found.kinds["Tet10"], found.curved), (1, 0), "{found:?}");
        assert!((found.volume - 1.0 / 6.0).abs() < 1e-12);
        assert!(
            found.notes[0].starts_with("1 mid nodes are left out"),
            "{found:?}"
        );
    }
    let linear = format!("{TET10}CTETRA,1,1,1,2,3,4\n");
    assert_eq!(facts(&read("a.bdf", linear).unwrap()).kinds["Tet4"], 1);
    let hole = format!("{TET10}CTETRA,1,1,1,2,3,,5,6\n");
    let e = read("a.bdf", hole).unwrap_err();
    assert!(e.found().contains("corner 4"), "{e}");
    // Two neighbours without mid nodes on their common face share the new ones.
    let pair = format!(
        "{TET10}GRID,10,,1.,1.,1.\nGRID,11,,.5,.5,1.\nCTETRA,1,1,1,2,3,4,5\nCTETRA,2,1,2,3,4,10,,,+\n+,,,,11\n"
    );
    let ElementFile::Solids(file) = read("a.bdf", pair).unwrap() else {
        panic!("solids");
    };
    let report = file.scaffold.validate().unwrap();
    assert_eq!((report.components, report.curved), (1, 0));
    assert!(
        (report.volume - 0.5).abs() < 1e-12 && report.warnings().is_empty(),
        "{report:?}"
    );
    assert!(file.notes[0].starts_with("7 mid nodes"), "{:?}", file.notes);
}

#[test]
fn pyramids_have_thirteen_nodes() {
    // A base of 2 by 2 and an apex at (0, 0, 3): the mid nodes of the base's edges, then of the others.
    let grids = "GRID,1,,0.,0.,0.\nGRID,2,,2.,0.,0.\nGRID,3,,2.,2.,0.\nGRID,4,,0.,2.,0.\nGRID,5,,0.,0.,3.\n\
        GRID,6,,1.,0.,0.\nGRID,7,,2.,1.,0.\nGRID,8,,1.,2.,0.\nGRID,9,,0.,1.,0.\nGRID,10,,0.,0.,1.5\n\
        GRID,11,,1.,0.,1.5\nGRID,12,,1.,1.,1.5\nGRID,13,,0.,1.,1.5\n";
    for (name, rest, kind) in [
        ("CPYRAM", ",6,+\n+,7,8,9,10,11,12,13", "Pyramid13"),
        ("CPYRA", ",6,+\n+,7,8,9,,,,13", "Pyramid13"),
        ("CPYRA", "", "Pyramid5"),
    ] {
        let text = format!("{grids}{name},1,1,1,2,3,4,5{rest}\n");
        let found = facts(&read("a.bdf", text).unwrap_or_else(|e| panic!("{e}")));
        assert_eq!(
            (found.kinds[kind], found.curved),
            (1, 0),
            "{name}: {found:?}"
        );
        assert!((found.volume - 4.0).abs() < 1e-9, "{name}: {found:?}");
    }
}

#[test]
fn shells_are_surfaces_with_their_fields_after_the_nodes() {
    let grids = "GRID,1,,0.,0.\nGRID,2,,2.,0.\nGRID,3,,2.,2.\nGRID,4,,0.,2.\nGRID,5,,1.,0.\nGRID,6,,2.,1.\n\
        GRID,7,,1.,2.\nGRID,8,,0.,1.\nGRID,9,,4.,0.\n";
    for (card, kind, area) in [
        ("CQUAD4,1,3,1,2,3,4,45.,.1", "Quad4", 4.0),
        ("CQUADR,1,3,1,2,3,4", "Quad4", 4.0),
        ("CSHEAR,1,3,1,2,3,4", "Quad4", 4.0),
        (
            "CQUAD8,1,3,1,2,3,4,5,6,+\n+,7,8,.1,.1,.1,.1,30.",
            "Quad8",
            4.0,
        ),
        ("CQUAD8,1,3,1,2,3,4,,,+\n+,,,.1,.1,.1,.1,30.", "Quad4", 4.0),
        ("CQUAD8,1,3,1,2,3,4,5,,+\n+,7,8", "Quad8", 4.0),
        ("CTRIA3,1,3,1,2,3,45.", "Tri3", 2.0),
        ("CTRIAR,1,3,1,2,3", "Tri3", 2.0),
        ("CTRIA6,1,3,2,9,3,,,,+\n+,45.,.1,.2,.2,.2", "Tri3", 2.0),
    ] {
        let file =
            read("a.bdf", format!("{grids}{card}\n")).unwrap_or_else(|e| panic!("{card}: {e}"));
        let ElementFile::Surface(file) = file else {
            panic!("a surface");
        };
        assert_eq!(file.surface.kinds()[0].0.name(), kind, "{card}");
        let plate = file.surface.plate(1.0).unwrap();
        let volume: f64 = plate.elements().map(|e| e.volume()).sum();
        assert!((volume - area).abs() < 1e-9, "{card}: {volume}");
        assert_eq!(file.groups[0].name, "3");
    }
}

#[test]
fn cards_that_are_given_twice_are_one_or_refused() {
    let tet = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,0.,1.,0.\nGRID,4,,0.,0.,1.\nCTETRA,1,1,1,2,3,4\n";
    let found = facts(&read("a.bdf", format!("{tet}{tet}")).unwrap());
    assert_eq!(found.notes, ["5 repeated cards are used once"]);
    assert!((found.volume - 1.0 / 6.0).abs() < 1e-12);
    let e = read("a.bdf", format!("{tet}GRID,4,,0.,0.,2.\n")).unwrap_err();
    assert_eq!(e.place(), Place::ItemOnLine("node", 4, 6));
    assert!(e.found().contains("line 4"), "{e}");
    let e = read("a.bdf", format!("{tet}CTETRA,1,1,2,1,3,4\n")).unwrap_err();
    assert_eq!(e.place(), Place::ItemOnLine("element", 1, 6));
}

#[test]
fn what_is_not_understood_is_refused_by_name() {
    let refusal = |from: &str, to: &str| {
        assert!(DECK.contains(from), "{from}");
        read("a.bdf", DECK.replacen(from, to, 1)).unwrap_err()
    };
    for card in [
        "GRIDB,1,2",
        "CTRIAX6,1,2,1,2,3",
        "CIHEX1,1,1,1",
        "EGRID,4",
        "CWHATEVER,1",
        "=,*(1),=,=,*(1.)",
    ] {
        let e = refusal("CONM2,30", &format!("{card}\nCONM2,30"));
        let name = card.split(',').next().unwrap();
        assert!(e.found().contains(name), "{card}: {e}");
        assert!(e.line().is_some(), "{card}: {e}");
    }
    let e = refusal("+H             7", "+X             7");
    assert!(e.found().contains("\"X\" after \"H\""), "{e}");
    let e = refusal("10.-1", "ten  ");
    assert!(e.found().contains("\"ten\" in field 4 of GRID"), "{e}");
    let e = refusal("CTETRA  20 ", "CTETRA  2.0");
    assert!(e.found().contains("\"2.0\" in field 2"), "{e}");
    let e = refusal("       4       99\n", "       4       77\n");
    assert_eq!(e.place(), Place::Item("element", 20));
    let e = refusal(
        "+H             7       8\n",
        "+H             7       8       9      10      11      12\n",
    );
    assert!(
        e.found().contains("node") || e.found().contains("corner"),
        "{e}"
    );
    let e = refusal("ENDDATA", "BEGIN SUPER=1");
    assert!(e.found().contains("SUPER 1"), "{e}");
    let e = refusal("CONM2,30", "INCLUDE 'none.bdf'\nCONM2,30");
    assert_eq!(e.class().exit_code(), 66, "{e}");
    let e = refusal("CONM2,30", "INCLUDE 'a.bdf'\nCONM2,30");
    assert!(
        e.found().contains("BEGIN") || e.found().contains("deep"),
        "{e}"
    );
    // 27 nodes, as gmsh writes a hex with nodes on its faces.
    let many = "+,7,8,1,2,3,4,1,2,+\n+,3,4,1,2,3,4,5,6,+\n+,1,2,3";
    let e = read(
        "a.bdf",
        DECK.replace("+H             7       8", many)
            .replace("6+H", "6"),
    )
    .unwrap_err();
    assert!(e.found().contains("more than 20 nodes"), "{e}");
    let e = read("a.bdf", "solid cube\n").unwrap_err();
    assert!(e.expected().contains("solid elements"), "{e}");
}

#[test]
fn included_files_stand_beside_the_deck() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("parts")).unwrap();
    let grids = TET10.lines().take(4).collect::<Vec<_>>().join("\n");
    // A dollar or the other mark within quotation marks, and an apostrophe without any.
    let texts = [
        ("größe.dat", "include it's.dat $ a comment\n"),
        ("it's.dat", "include \"ü'$brig.bdf\" $ \"$ a comment\n"),
        ("ü'$brig.bdf", &grids),
    ];
    for (name, text) in texts {
        std::fs::write(dir.path().join("parts").join(name), text).unwrap();
    }
    let deck = "SOL 101\nCEND\nINCLUDE 'case.txt'\nBEGIN BULK\nINCLUDE 'parts/\ngröße.dat' $ both\nCTETRA,1,1,1,2,3,4\n";
    let path = dir.path().join("a.bdf");
    std::fs::write(&path, deck).unwrap();
    let file = read_scaffold(&path).unwrap_or_else(|e| panic!("{e}"));
    assert!((file.scaffold.element(0).volume() - 1.0 / 6.0).abs() < 1e-12);
}
