//! Coordinate systems, keywords that make nodes and elements, keywords that are refused or passed over.

use super::{CUBE, assert_box, assert_near, group, names, read, refusal, solids, stored, volume};
use druse::frame::Vec3;
use druse::io::{ScaffoldFile, read_elements};

fn cube_in(before: &str, parameters: &str) -> Box<ScaffoldFile> {
    let element = "*ELEMENT,TYPE=C3D8\n1,1,2,3,4,5,6,7,8\n";
    solids(read(&format!("{before}*NODE{parameters}\n{CUBE}{element}")))
}

fn has_node(file: &ScaffoldFile, at: [f64; 3]) -> bool {
    let at = Vec3::from(at);
    file.scaffold
        .nodes()
        .iter()
        .any(|n| (n - at).norm() < 1e-12)
}

#[test]
fn cylindrical_and_spherical_nodes() {
    let file = solids(stored("cylindrical.inp"));
    assert_box(&file, [0.0; 3], [2.0, 2.0, 1.0]);
    assert_near(volume(&file), 1.5);
    let file = solids(stored("spherical.inp"));
    let c = 0.5f64.sqrt();
    assert_box(&file, [0.0; 3], [2.0, 2.0, 2.0 * c]);
    // The map is the radius times a bilinear map of directions, whose determinant is c (1 + (c - 1) v).
    assert_near(volume(&file), 7.0 / 6.0 * (c + 0.5));
}

#[test]
fn systems_move_and_turn_nodes() {
    let file = solids(stored("system.inp"));
    assert_box(&file, [99.0, 0.0, 0.0], [100.0, 1.0, 1.0]);
    assert_near(volume(&file), 1.0);
    for (lines, min) in [
        ("5,6,7\n", [5.0, 6.0, 7.0]),
        ("5,6,7,\n", [5.0, 6.0, 7.0]),
        ("5,,\n", [5.0, 0.0, 0.0]),
        // x along +y, so y along -x.
        ("5,0,0, 5,3,0\n", [4.0, 0.0, 0.0]),
        ("5,0,0, 5,3,0,\n4,0,0\n", [4.0, 0.0, 0.0]),
        // x along z, y along x, z along y.
        ("0,0,0, 0,0,2\n9,0,3\n", [0.0; 3]),
        // x along -x, y along y, z along -z.
        ("0,0,0, -1,0,0, -1,1,0\n", [-1.0, 0.0, -1.0]),
        ("", [0.0; 3]),
    ] {
        let file = cube_in(&format!("*System\n{lines}"), "");
        assert_box(&file, min, [min[0] + 1.0, min[1] + 1.0, min[2] + 1.0]);
        assert_near(volume(&file), 1.0);
    }
    // Without data lines the global system is back.
    let file = cube_in("*SYSTEM\n5,6,7\n*NODE\n99,0,0,0\n*SYSTEM\n", "");
    assert_box(&file, [0.0; 3], [1.0; 3]);
    // Local cylindrical coordinates.
    let text = std::fs::read_to_string("tests/data/truth/decks/cylindrical.inp").unwrap();
    let file = solids(read(&format!("*SYSTEM\n10,0,0, 10,1,0\n{text}")));
    assert_box(&file, [8.0, 0.0, 0.0], [10.0, 2.0, 1.0]);
    for lines in ["0,0,0, 1,0,1\n", "0,0,0, 1,0,0, 2,0,0\n", "1,1,1, 1,1,1\n"] {
        let e = refusal(&format!("*SYSTEM\n{lines}*NODE\n{CUBE}"));
        assert!(e.expected().contains("*SYSTEM"), "{e}");
    }
    // Displacements are given in the system of *TRANSFORM; nodes are not.
    let file = cube_in(
        "",
        ", nset=N\n1,0,0,0\n*TRANSFORM, NSET=N, TYPE=C\n0,0,0,0,0,1\n*Node",
    );
    assert_near(volume(&file), 1.0);
}

/// Rings of nodes at radius 1 and 2 and at heights 0 and 1, and hexes between them.
fn ring(ngen: &str, last: [f64; 2], count: u32) -> Box<ScaffoldFile> {
    let [x, y] = last;
    let end = 1 + count;
    solids(read(&format!(
        "*NODE\n1,1,0,0\n{end},{x},{y},0\n101,2,0,0\n{},{},{},0\n999,0,0,0\n\
         *NGEN, LINE=C, NSET=RING\n1,{end},1,{ngen}\n101,{},1,{ngen}\n\
         *NCOPY, CHANGE NUMBER=200, OLD SET=ring, SHIFT, NEW SET=TOP\n0,0,1\n\
         *ELEMENT, TYPE=C3D8, ELSET=FIRST\n1,1,101,102,2,201,301,302,202\n*ELGEN, ELSET=ALL\n1,{count}\n",
        100 + end,
        2.0 * x,
        2.0 * y,
        100 + end
    )))
}

#[test]
fn nodes_on_arcs() {
    // Chords of a quarter in four, about a node, about a point, about a point in cylindrical coordinates.
    let quarter = 6.0 * 22.5f64.to_radians().sin();
    for ngen in ["999", ",0,0,0", "999,,,,0,0,1"] {
        let file = ring(ngen, [0.0, 1.0], 4);
        assert_eq!(file.scaffold.len(), 4);
        assert_near(volume(&file), quarter);
        assert_box(&file, [0.0; 3], [2.0, 2.0, 1.0]);
        assert_eq!(file.scaffold.components().len(), 1);
        assert_eq!(group(&file, "ALL"), Some(vec![0, 1, 2, 3]));
        assert_eq!(group(&file, "FIRST"), Some(vec![0]));
    }
    // Three quarters need a normal; it tells the way round.
    let file = ring("999,,,,0,0,1", [0.0, -1.0], 3);
    assert_near(volume(&file), 4.5);
    assert_box(&file, [-2.0, -2.0, 0.0], [2.0, 2.0, 1.0]);
    let file = ring("999,,,,0,0,-1", [0.0, -1.0], 3);
    assert_near(volume(&file), 3.0 * 1.5 * 30f64.to_radians().sin());
    // Half a turn without a normal has no plane.
    let base = "*NODE\n1,1,0,0\n5,-1,0,0\n9,0,0,0\n7,0,2,0\n*NGEN, LINE=C\n";
    let e = refusal(&format!("{base}1,5,1,9\n"));
    assert!(e.expected().contains("normal"), "{e}");
    let e = refusal(&format!("{base}1,7,1,9\n"));
    assert!(e.expected().contains("circle"), "{e}");
    let e = refusal(&format!("{base}1,5,1\n"));
    assert!(e.expected().contains("centre"), "{e}");
}

/// The nodes of a keyword, as corners of a tetrahedron that is not flat.
fn nodes_of(deck: &str, [a, b, c]: [u32; 3]) -> Box<ScaffoldFile> {
    solids(read(&format!(
        "*NODE\n9000,.3,.3,7\n{deck}*ELEMENT, TYPE=C3D4\n1,{a},{b},{c},9000\n"
    )))
}

#[test]
fn nodes_on_parabolas_and_lines() {
    let file = nodes_of(
        "1,0,0,0\n5,2,0,0\n9,1,1,0\n*NGEN, LINE=P\n1,5,1,9\n",
        [2, 3, 4],
    );
    for at in [[0.5, 0.75, 0.0], [1.0, 1.0, 0.0], [1.5, 0.75, 0.0]] {
        assert!(has_node(&file, at), "{at:?}");
    }
    // Downwards, in steps.
    let file = nodes_of("30,0,0,0\n10,2,0,0\n1,1,5,0\n*NGEN\n30,10,5\n", [25, 15, 1]);
    for at in [[0.5, 0.0, 0.0], [1.5, 0.0, 0.0]] {
        assert!(has_node(&file, at), "{at:?}");
    }
    // Intervals of 1, 2, 4: each half of the next.
    let file = nodes_of(
        "1,0,0,0\n5,7,0,0\n3,1,5,0\n*NSET,NSET=A\n1\n*NSET,NSET=b\n5\n*NFILL, BIAS=0.5\na,B,3,10\n",
        [11, 21, 3],
    );
    for at in [[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]] {
        assert!(has_node(&file, at), "{at:?}");
    }
}

#[test]
fn a_block_of_generated_nodes_and_elements() {
    let text = "*Node\n1,0,0,0\n3,2,0,0\n7,0,2,0\n9,2,2,0\n19,0,0,2\n21,2,0,2\n25,0,2,2\n27,2,2,2\n\
        *NGEN, NSET=A\n1,3\n*NGEN, NSET=B\n7,9,1\n*NFILL, NSET=LOW\nA,B,2,3\n\
        *NGEN, NSET=C\n19,21,1\n*NGEN, NSET=D\n25,27,1\n*NFILL, NSET=HIGH\nC,D,2,3\n*NFILL\nLOW,HIGH,2,9\n\
        *ELEMENT, TYPE=C3D8, ELSET=MASTER\n1,1,2,5,4,10,11,14,13\n*ELGEN, ELSET=ALL\n1,2,1,1,2,3,2,2,9,4\n";
    let file = solids(read(text));
    assert_eq!((file.scaffold.len(), file.scaffold.nodes().len()), (8, 27));
    assert_near(volume(&file), 8.0);
    assert_eq!(file.scaffold.components().len(), 1);
    let mut numbers: Vec<u64> = (0..8).map(|e| file.scaffold.number(e)).collect();
    numbers.sort_unstable();
    assert_eq!(numbers, [1, 2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(group(&file, "ALL").unwrap().len(), 8);
    assert!(file.scaffold.report().warnings().is_empty());
}

#[test]
fn copies_of_nodes_and_elements() {
    let base =
        format!("*NODE, NSET=OLD\n{CUBE}*ELEMENT, TYPE=C3D8, ELSET=ONE\n1,1,2,3,4,5,6,7,8\n");
    let copied = |ncopy: &str, copies: u64| {
        let mut text = base.clone() + ncopy;
        for _ in 0..copies {
            text += "*ELCOPY, OLD SET=one, NEW SET=TWO, ELEMENT SHIFT=10, SHIFT NODES=10\n";
        }
        solids(read(&text))
    };
    for (ncopy, min, max, all) in [
        ("SHIFT\n3,0,0\n", [0.0; 3], [4.0, 1.0, 1.0], 2.0),
        // The translation comes before the rotation.
        (
            "SHIFT\n3,0,0\n0,0,0, 0,0,1, 90\n",
            [-1.0, 0.0, 0.0],
            [1.0, 4.0, 1.0],
            2.0,
        ),
        (
            "SHIFT\n\n0,0,0, 0,0,1, 180\n",
            [-1.0, -1.0, 0.0],
            [1.0; 3],
            2.0,
        ),
        (
            "REFLECT=MIRROR\n2,0,0, 2,1,0\n2,0,1\n",
            [0.0; 3],
            [4.0, 1.0, 1.0],
            2.0,
        ),
        (
            "REFLECT=LINE\n2,0,0, 2,0,1\n",
            [0.0, -1.0, 0.0],
            [4.0, 1.0, 1.0],
            2.0,
        ),
        ("REFLECT=POINT\n2,2,2\n", [0.0; 3], [4.0; 3], 2.0),
        // Twice as far from the pole, so twice as large.
        ("POLE\n,-1,0,0\n", [0.0; 3], [3.0, 2.0, 2.0], 9.0),
    ] {
        let file = copied(
            &format!("*NCOPY, CHANGE NUMBER=10, OLD SET=old, {ncopy}"),
            1,
        );
        assert_box(&file, min, max);
        assert_near(volume(&file), all);
        assert_eq!(group(&file, "TWO"), Some(vec![1]), "{ncopy}");
        assert_eq!(file.scaffold.number(1), 11);
    }
    let text = base.clone()
        + "*NCOPY, CHANGE NUMBER=10, OLD SET=OLD, SHIFT, MULTIPLE=3, NEW SET=NEW\n2,0,0\n\
           *ELGEN, ELSET=ROW\n1,4,10,1\n";
    let file = solids(read(&text));
    assert_box(&file, [0.0; 3], [7.0, 1.0, 1.0]);
    assert_near(volume(&file), 4.0);
    for (bad, word) in [
        (
            "*NCOPY, CHANGE NUMBER=10, OLD SET=NONE, SHIFT\n1,0,0\n",
            "NONE",
        ),
        (
            "*NCOPY, CHANGE NUMBER=10, OLD SET=OLD\n1,0,0\n",
            "no copy mode",
        ),
        ("*NCOPY, OLD SET=OLD, SHIFT\n1,0,0\n", "CHANGE NUMBER"),
        (
            "*NCOPY, CHANGE NUMBER=1, OLD SET=OLD, SHIFT\n1,0,.5\n",
            "second node",
        ),
        ("*ELGEN\n1,2,50,1\n", "node 51"),
        ("*ELGEN\n9,2,1,1\n", "element 9"),
        ("*ELGEN\n1,4000000,1,1\n", "4000000"),
        (
            "*ELCOPY, OLD SET=ONE, ELEMENT SHIFT=1, SHIFT NODES=-5\n",
            "number -4",
        ),
        ("*NGEN\n1,8,3\n", "steps of 3"),
        ("*NGEN\n1,99\n", "node 99"),
        ("*NFILL\nOLD,1,2,3\n", "8 and 1"),
    ] {
        let e = refusal(&(base.clone() + bad));
        assert!(e.found().contains(word), "{bad}{e}");
    }
}

#[test]
fn what_makes_geometry_otherwise_is_refused_by_name() {
    let base = format!("*NODE, NSET=ALL\n{CUBE}*ELEMENT, TYPE=C3D8\n1,1,2,3,4,5,6,7,8\n");
    for (line, word) in [
        ("*NMAP, NSET=ALL, TYPE=CYLINDRICAL\n", "NMAP"),
        ("*IMPERFECTION, FILE=a, STEP=1\n", "IMPERFECTION"),
        ("*Symmetric Model Generation\n", "SYMMETRICMODELGENERATION"),
        ("*NODES\n9,0,0,9\n", "NODES"),
        ("*ELEMNT, TYPE=C3D8\n", "ELEMNT"),
        ("*NFILL, TWO STEP, BIAS=2\n", "TWOSTEP"),
        ("*NGEN, LINE=Q\n", "LINE"),
        ("*NODE, SYSTEM=X\n", "SYSTEM"),
        ("*ELEMENT, TYPE=C3D8, OFFSET=9\n", "OFFSET"),
    ] {
        let e = refusal(&(base.clone() + line));
        assert!(e.found().contains(word) && e.line().is_some(), "{line}{e}");
    }
    let e = refusal(&(base.clone() + "*ELEMENTS, TYPE=C3D8\n"));
    assert!(e.hint().unwrap().contains("*ELEMENT?"), "{e}");
    let e = refusal("1,0,0,0\n2,1,0,0\n");
    assert!(e.expected().contains("keywords such as *NODE"), "{e}");
    let file = solids(read(&format!(">**\n>** a part\n{base}")));
    assert_eq!(
        file.warnings,
        ["2 lines before the first keyword are ignored: \">**\""]
    );

    // One note counts and names what cannot change geometry, known or not.
    let file = solids(read(
        &(base.clone()
            + "*SOLID SECTION, ELSET=A, MATERIAL=M\n1.\n*SOLIDSECTION\n*Material, name=M\n*ELASTIC\n1,2\n*COUPLED TEMPERATURE-DISPLACEMENT\n*Pre-tension Section\n\
           *STEP\n*STATIC\n1,1\n*BOUNDARY\n1,1,3\n*NODE PRINT\nU\n*END STEP\n"),
    ));
    assert_eq!((file.notes.len(), file.warnings.len()), (1, 0));
    let named = "(11 in all): *BOUNDARY, *COUPLEDTEMPERATUREDISPLACEMENT, *ELASTIC, *ENDSTEP, *MATERIAL, *NODEPRINT, \
                 *PRETENSIONSECTION, *SOLIDSECTION and 2 others";
    assert!(file.notes[0].ends_with(named), "{:?}", file.notes);
    let file = solids(read(&(base + "*BANANA SPLIT\n1,2\n*BANANA SPLIT\n")));
    assert!(
        file.notes[0].ends_with("(2 in all): *BANANASPLIT"),
        "{:?}",
        file.notes
    );
}

#[test]
fn sets_in_any_case_and_order() {
    let text = format!(
        "*ELSET, ELSET=early\n1\n*NODE\n{CUBE}9,0,0,2\n10,1,0,2\n11,1,1,2\n12,0,1,2\n\
         *ELEMENT, TYPE=C3D8, ELSET=\"Lower part\"\n1,1,2,3,4,5,6,7,8\n\
         *element, type=c3d8, elset=Upper\n2,5,6,7,8,9,10,11,12\n*ELEMENT, TYPE=SPRINGA, ELSET=S\n3,1,2\n\
         *ELSET, ELSET=BOTH, INTERNAL\n\"LOWER PART\", upper\n*Elset, elset=UPPER\n2\n\
         *ELSET, elset=one, generate\n1\n*ELSET, ELSET=range, GENERATE,\nUNSORTED\n1,2\n\
         *ELSET, ELSET=twos, generate\n1,2,1\n1,1,1\n*ELSET, ELSET=mixed\nS, 1, 77\n"
    );
    let file = solids(read(&text));
    for (name, elements) in [
        ("early", vec![0]),
        ("Lower part", vec![0]),
        ("Upper", vec![1]),
        ("BOTH", vec![0, 1]),
        ("one", vec![0]),
        ("range", vec![0, 1]),
        ("twos", vec![0, 1]),
        ("mixed", vec![0]),
    ] {
        assert_eq!(
            group(&file, name),
            Some(elements),
            "{name}: {:?}",
            names(&file)
        );
    }
    assert_eq!(file.groups.len(), 8, "{:?}", names(&file));
    assert!(file.notes[0].contains("1 SPRINGA"), "{:?}", file.notes);
    assert!(file.warnings[0].contains("1 members") && file.warnings[0].contains("mixed"));
    let e = refusal(&text.replace("S, 1, 77", "attic"));
    assert!(e.found().contains("attic"), "{e}");
}

#[test]
fn decks_of_several_files() {
    let directory = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = directory.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    write("sub/Nodes.txt", &format!("** nodes\n{CUBE}"));
    write("sub/elements.txt", "1,1,2,3,4,\n5,6,7,8\n");
    write(
        "sub/mesh.inp",
        "*NODE, Input=\"Nodes.txt\"\n*ELEMENT, TYPE=C3D8, input=elements.txt\n*INCLUDE, INPUT=sets.inp\n",
    );
    write("sets.inp", "*ELSET, ELSET=A\n1\n");
    write("a.inp", "*HEADING\n*INCLUDE,INPUT=sub/mesh.inp\n");
    let file = solids(read_elements(directory.path().join("a.inp")));
    assert_near(volume(&file), 1.0);
    assert_eq!(group(&file, "A"), Some(vec![0]));
    write("sub/elements.txt", "*ELSET\n");
    let e = read_elements(directory.path().join("a.inp")).unwrap_err();
    assert!(e.expected().contains("data lines"), "{e}");
    write("sub/elements.txt", "1,1,2,3,4\n");
    assert!(read_elements(directory.path().join("a.inp")).is_err());
    // Files that include each other many times over.
    write("a.inp", &"*INCLUDE, INPUT=b.inp\n".repeat(60));
    write("b.inp", &"*INCLUDE, INPUT=c.inp\n".repeat(60));
    write("c.inp", "*HEADING\n");
    let e = read_elements(directory.path().join("a.inp")).unwrap_err();
    assert!(e.expected().contains("1000 files"), "{e}");
}
