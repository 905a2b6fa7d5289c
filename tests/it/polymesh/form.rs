//! Crystal forms: known solids, all groups and systems, pushing and pulling.

use druse::polymesh::form::{Form, FormError, SYSTEMS, group_names};
use druse::polymesh::{Interpreter, NoFiles, Script};

fn crystal(text: &str) -> Interpreter<'static> {
    let mut interpreter = Interpreter::new(&NoFiles);
    Script::parse(text)
        .unwrap()
        .run(&mut interpreter, None)
        .unwrap_or_else(|e| panic!("{text}: {e}"));
    interpreter
}

#[test]
fn cubic_forms_are_the_solids_of_the_books() {
    // Vertices, edges, faces, and the order of the group of the shape.
    for (planes, counts, order) in [
        ("[1,0,0]=1", (8, 12, 6), 48),
        ("[1,1,1]=1", (6, 12, 8), 48),
        ("[1,1,0]=1", (14, 24, 12), 48),
        ("[1,0,0]=1 [1,1,1]=1.2", (24, 36, 14), 48),
        ("[2,1,0]=1", (32, 60, 30 - 6), 48),
        ("group=-43m [1,1,1]=1", (4, 6, 4), 24),
        ("group=m-3 [2,1,0]=1", (20, 30, 12), 24),
        ("[2,1,1]=1", (26, 48, 24), 48),
        ("[3,2,1]=1", (26, 72, 48), 48),
    ] {
        let interpreter = crystal(&format!("form cubic {planes}"));
        let mesh = interpreter.mesh().unwrap();
        let counts = if planes.starts_with("[2,1,0]") {
            (14, 36, 24)
        } else {
            counts
        };
        assert_eq!(
            (mesh.vertex_count(), mesh.edge_count(), mesh.face_count()),
            counts,
            "{planes}"
        );
        assert_eq!(mesh.symmetries().len(), order, "{planes}");
        assert!(mesh.summary().planarity.0 < 1e-9);
    }
}

#[test]
fn every_group_closes_a_crystal_of_the_expected_symmetry() {
    // Orders of the 32 groups, in the order of the table.
    let orders = [
        1, 2, 2, 2, 4, 4, 4, 8, 4, 4, 8, 8, 8, 8, 16, 3, 6, 6, 6, 12, 6, 6, 12, 12, 12, 12, 24, 12,
        24, 24, 24, 48,
    ];
    let system = |n: usize| match n {
        0..2 => "triclinic a=1 b=1.1 c=1.3 alpha=80 beta=95 gamma=100",
        2..5 => "monoclinic a=1 b=1.1 c=1.3 beta=100",
        5..8 => "orthorhombic a=1 b=1.1 c=1.3",
        8..15 => "tetragonal a=1 c=1.3",
        15..27 => "hexagonal a=1 c=1.3",
        _ => "cubic",
    };
    for (n, group) in group_names().enumerate() {
        // A general plane, and faces of a box so that every group closes.
        let box_planes = "[1,0,0]=1 [0,1,0]=1 [0,0,1]=1 [-1,0,0]=1 [0,-1,0]=1 [0,0,-1]=1";
        let interpreter = crystal(&format!(
            "form {} group={group} [7,3,2]=0.8 {box_planes}",
            system(n)
        ));
        let mesh = interpreter.mesh().unwrap();
        let general = mesh.groups().iter().filter(|&&g| g == 1).count();
        assert_eq!(general, orders[n], "{group}: faces of the general form");
        let found = mesh.symmetries().len();
        assert_eq!(found % orders[n], 0, "{group}: {found} symmetries");
    }
    assert_eq!(SYSTEMS.len(), 7);
    let rhombohedral = crystal("form rhombohedral alpha=75 [1,0,0]=1");
    assert_eq!(rhombohedral.mesh().unwrap().symmetries().len(), 12);
}

#[test]
fn pushing_a_form_keeps_its_planes_and_their_neighbours() {
    let before = crystal("form cubic [1,1,1]=1 [1,0,0]=0.9");
    let after = crystal("form cubic [1,1,1]=1 [1,0,0]=0.9\npush [0,-1,0] 0.05\npush [1,1,1] -0.1");
    let same = crystal("form cubic [1,1,1]=0.9 [1,0,0]=0.95");
    assert_eq!(after.mesh().unwrap(), same.mesh().unwrap());
    let normals = |w: &Interpreter| -> Vec<String> {
        let mesh = w.mesh().unwrap();
        let mut list: Vec<String> = (0..mesh.face_count())
            .map(|f| format!("{:.9}", mesh.normal(f).map(|c| c + 0.0)))
            .collect();
        list.sort();
        list
    };
    assert_eq!(normals(&before), normals(&after));
}

#[test]
fn what_makes_no_crystal_is_named() {
    let error = |text: &str| {
        let mut interpreter = Interpreter::new(&NoFiles);
        let script = Script::parse(text).unwrap();
        script.run(&mut interpreter, None).unwrap_err().to_string()
    };
    assert!(error("form cubik [1,0,0]=1").contains("did you mean \"cubic\"?"));
    assert!(error("form cubic [0,0,0]=1").contains("indices that are not all 0"));
    assert!(error("form cubic [1,0,0]=-1").contains("more than 0"));
    assert!(
        error("form cubic group=6/mmm [1,0,0]=1")
            .contains("is not a symmetry of this cubic lattice")
    );
    assert!(error("form cubic group=4m [1,0,0]=1").contains("no point group is named \"4m\""));
    assert!(error("form cubic group=1 [1,0,0]=1").contains("enclose no bounded volume"));
    assert!(error("form cubic").contains("planes with their distances"));
    assert!(error("form cubic c=2 [1,0,0]=1").contains("no free axis or angle is named \"c\""));
    assert!(error("form cubic [1,0,0]=1\npush [1,1,1] 0.1").contains("no form {1 1 1}"));
    assert!(
        error("form cubic [1,0,0]=1\nscale 2\npush [1,0,0] 0.1")
            .contains("no crystal form any more")
    );
    assert!(matches!(
        Form::new(
            "triclinic",
            &[("alpha".into(), 10.0), ("beta".into(), 170.0)],
            None
        ),
        Err(FormError::Axis { .. })
    ));
}

#[test]
fn a_form_given_twice_is_not_called_outside() {
    let quartz = std::fs::read_to_string("examples/crystal/quartz.crystal").unwrap();
    let mut interpreter = crystal(&quartz);
    assert!(interpreter.take_notes().is_empty());
    let mut outside = crystal("form cubic [1,0,0]=1 [1,1,1]=3");
    assert!(outside.take_notes()[0].text.contains("outside"));
}

#[test]
fn trigonal_points_to_rhombohedral() {
    for text in [
        "form trigonal a=1 [1,0,0]=1",
        "form hexagonal group=trigonal [1,0,0]=1",
        "cube; symmetrize trigonal",
    ] {
        let mut interpreter = Interpreter::new(&NoFiles);
        let error = Script::parse(text).unwrap().run(&mut interpreter, None);
        let hint = error.unwrap_err().hint.unwrap();
        assert!(hint.contains("rhombohedral"), "{text}: {hint}");
    }
}

#[test]
fn a_mesh_is_symmetrized_by_a_group_that_it_has() {
    for (text, groups) in [
        ("cube; symmetrize", 1),
        ("cube; symmetrize m-3m", 1),
        ("cube; symmetrize Oh", 1),
        ("cube; symmetrize 4/mmm", 2),
        ("cube; symmetrize 4mm", 3),
        ("cube; symmetrize mmm", 3),
        ("cube; symmetrize 1", 6),
        // The axis of order 3 stands along (1, 1, 1).
        ("cube; symmetrize 3", 2),
        ("prism n=6; symmetrize 6/mmm", 2),
        ("prism n=6; symmetrize D6h rotations=true", 2),
        ("prism n=6; symmetrize C6v", 3),
    ] {
        let interpreter = crystal(text);
        let counts = interpreter.mesh().unwrap().group_counts();
        assert_eq!(counts.len(), groups, "{text}");
    }
    for text in ["cube; symmetrize 6/mmm", "prism n=5; symmetrize m-3m"] {
        let mut interpreter = Interpreter::new(&NoFiles);
        let error = Script::parse(text).unwrap().run(&mut interpreter, None);
        let message = error.unwrap_err().message;
        assert!(message.contains("does not have the group"), "{message}");
    }
}
