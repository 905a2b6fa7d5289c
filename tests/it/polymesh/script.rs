//! Scripts, selections, groups, history, symmetry: the recipes of the thesis' figures, and what goes wrong.

use super::{json, judge};
use druse::polymesh::{Interpreter, NoFiles, PolyMesh, Script, ScriptError};
use proptest::prelude::*;

/// The error of a script that must fail.
fn refuse(text: &str) -> ScriptError {
    match run(text) {
        Err(e) => e,
        Ok(_) => panic!("accepted: {text}"),
    }
}

fn run(text: &str) -> Result<Interpreter<'static>, ScriptError> {
    let mut interpreter = Interpreter::with_history(&NoFiles, 100);
    Script::parse(text)?.run(&mut interpreter, None)?;
    Ok(interpreter)
}

fn made(text: &str) -> PolyMesh {
    let interpreter = run(text).unwrap_or_else(|e| panic!("{text}: {e}"));
    interpreter.mesh().unwrap().clone()
}

/// The recipes of the tables, as scripts; `{k}` is the number at the end of their names.
const RECIPES: &[(&str, &str)] = &[
    (
        "pseudo_menger",
        "cube; repeat {k} { remesh checkerboard t=1/3; extrude cubical group=1 dihedral=90 tiers=[-1] }",
    ),
    (
        "cube_fractal",
        "cube; repeat {k} { remesh checkerboard t=1/3; extrude cubical group=1 dihedral=90 tiers=[1] }",
    ),
    (
        "pseudo_sierpinski_in",
        "tetrahedron; repeat {k} { remesh loop_style; extrude tetrahedral group=1 dihedral=atan(sqrt(2)) tiers=[-1/sqrt(3)] }",
    ),
    (
        "tetra_koch_out",
        "tetrahedron; repeat {k} { remesh loop_style; extrude tetrahedral group=1 }",
    ),
    (
        "tower_srco_135",
        "cube; extrude small_rhombicuboctahedral top tilt=45 tiers=[.3, 2, .3] iterations={k}",
    ),
    (
        "tower_cubocta",
        "cube; extrude cuboctahedral faces(top) iterations={k}",
    ),
    (
        "four_way_star_cubical_80_t2",
        "cube; assign all 2; assign faces(abs(normal.z) < .5) 1; extrude cubical group=1 dihedral=80 tiers=[2]",
    ),
    (
        "four_way_star_tetra_80_t2",
        "cube; assign all 2; assign faces(abs(normal.z) < .5) 1; extrude tetrahedral group=1 dihedral=80 tiers=[2]",
    ),
];

fn recipe(name: &str) -> PolyMesh {
    let whole = RECIPES.iter().find(|r| r.0 == name);
    let (text, k) = if let Some(row) = whole {
        (row.1, "")
    } else {
        let (stem, k) = name.rsplit_once('_').unwrap();
        (RECIPES.iter().find(|r| r.0 == stem).unwrap().1, k)
    };
    made(&text.replace("{k}", k))
}

#[test]
fn recipes_of_the_figures_agree_with_the_table() {
    let table = json("recipes.json");
    for (name, expect) in table.as_object().unwrap() {
        if !name.starts_with('_') {
            judge(&recipe(name), expect, name);
        }
    }
}

#[test]
fn symmetry_orders_agree_with_the_table() {
    let table = json("recipes.json");
    for (name, order) in table["_symmetry_order_in_Oh_about_bbox_centre"]
        .as_object()
        .unwrap()
    {
        let mesh = match name.as_str() {
            "four_way_star_cubical" => recipe("four_way_star_cubical_80_t2"),
            "tower_srco_1" => recipe("tower_srco_135_1"),
            "cube_all6_dodeca" => made("cube; extrude dodecahedral all"),
            "cube_all6_icosa" => made("cube; extrude icosahedral all"),
            name => recipe(name),
        };
        assert_eq!(
            mesh.symmetries().len() as u64,
            order.as_u64().unwrap(),
            "{name}"
        );
    }
}

#[test]
fn solids_have_the_full_groups_of_their_families() {
    for (name, order) in [
        ("tetrahedron", 24),
        ("cube", 48),
        ("icosahedron", 120),
        ("snub_cube", 24),
        ("snub_dodecahedron", 60),
        ("great_rhombicosidodecahedron", 120),
        ("prism n=7 edge=1 height=2", 28),
        ("pyramid n=5", 10),
        ("torus counts=[12, 7]", 48),
    ] {
        assert_eq!(made(name).symmetries().len(), order, "{name}");
    }
}

/// The thesis' Figure 19: three faces round a corner of the cube, extruded twice, the second time on a side.
#[test]
fn aligned_start_vertices_keep_a_threefold_axis() {
    let text = |start: &str| {
        format!(
            "cube; assign all 2; assign faces(normal.x + normal.y + normal.z > .5) 1; {start}
             extrude cubical group=1 dihedral=80 tiers=[.6]; extrude cubical group=4 dihedral=75 tiers=[.5]"
        )
    };
    let aligned = made(&text("startvertex group=1 toward=[1, 1, 1]"));
    assert_eq!(
        (
            aligned.vertex_count(),
            aligned.edge_count(),
            aligned.face_count()
        ),
        (32, 60, 30)
    );
    let threefold = |m: &PolyMesh| m.symmetries().iter().filter(|s| s.is_rotation()).count() == 3;
    assert!(threefold(&aligned));
    let unaligned = made(&text(
        "startvertex group=1 toward=[1, 1, 1]; startvertex faces(normal.z > .5) toward=[-1, 1, 1]",
    ));
    assert_eq!(unaligned.face_count(), 30);
    assert!(!threefold(&unaligned));
}

#[test]
fn symmetrized_groups_keep_the_symmetry_through_extrusions() {
    for solid in [
        "cube",
        "dodecahedron",
        "cuboctahedron",
        "snub_cube",
        "prism n=5",
    ] {
        let before = made(solid);
        let after = made(&format!("{solid}; symmetrize; extrude cubical group=1 dihedral=80 tiers=[.5]; extrude tetrahedral group=1+2 tiers=[.2] dihedral=70")
            .replace("group=1+2", "top"));
        assert_eq!(
            before.symmetries().len(),
            after.symmetries().len(),
            "{solid}"
        );
        // A side of every source: turns stay.
        let sided = made(&format!(
            "{solid}; symmetrize rotations=true; extrude cubical all dihedral=80 tiers=[.5]"
        ));
        let greatest = sided.greatest_group();
        let sided = made(&format!(
            "{solid}; symmetrize rotations=true; extrude cubical all dihedral=80 tiers=[.5]; extrude cubical group={greatest} tiers=[.1]"
        ));
        assert!(sided.euler() == 2);
    }
    assert_eq!(made("cuboctahedron; symmetrize").group_counts().len(), 2);
    assert_eq!(made("dodecahedron; symmetrize").group_counts().len(), 1);
}

#[test]
fn selections_choose_the_faces_they_say() {
    let count = |condition: &str| {
        let mesh = made(&format!("prism n=6 edge=1 height=2; assign {condition} 9"));
        mesh.groups().iter().filter(|&&g| g == 9).count()
    };
    assert_eq!(count("faces(sides == 4)"), 6);
    assert_eq!(count("faces(sides == 6 and normal.z > 0)"), 1);
    assert_eq!(count("faces(not (sides == 6) or index == 0)"), 7);
    assert_eq!(count("faces(!(sides == 6) | index == 0 & group == 1)"), 7);
    assert_eq!(count("all"), 8);
    assert_eq!(count("top"), 1);
    assert_eq!(count("last"), 8);
    assert_eq!(count("near(0, 0, 5)"), 1);
    assert_eq!(count("faces(near(0, 0, 5) or near(0, 0, -5))"), 2);
    assert_eq!(count("ray(0, 0, 9, 0, 0, -1)"), 1);
    assert_eq!(count("faces(area > 1.9 and area < 2.1)"), 6);
    assert_eq!(count("faces(centre.z <= -1 + 1e-9)"), 1);
    assert_eq!(count("faces(mod(index, 2) == 0)"), 4);
    assert_eq!(
        count("faces(edge == max(edge, 1) and abs(residual) < 1e-9)"),
        8
    );
    let tops = made(
        "cube; extrude cubical all tiers=[.1]; assign top 99; assign faces(last and not top) 50",
    );
    let counts = tops.group_counts();
    assert_eq!((counts[&99], counts[&50]), (6, 24));
}

#[test]
fn groups_are_assigned_merged_and_renumbered() {
    let mesh = made(
        "cube; assign faces(index == 0) 7; assign faces(index == 1) new; assign faces(index == 2) 30; merge 7 8; renumber",
    );
    assert_eq!(mesh.groups(), [2, 2, 3, 1, 1, 1]);
}

#[test]
fn parameters_loops_and_until() {
    let text = "param n = 2 * 2 # corners\nparam h = n / 2\nprism n=n + 1 edge=1";
    assert!(refuse(text).to_string().contains("unexpected \"+\""));
    let text = "param n = 2 * 2 # corners\nparam h = n / 2\nprism n=n+1 edge=1 height=h\nrepeat 2 {\n  repeat 2 { remesh simplest }\n}";
    let script = Script::parse(text).unwrap();
    assert_eq!(script.parameters(), ["n", "h"]);
    let faces = |set: &[(&str, &str)], until| {
        let mut interpreter = Interpreter::new(&NoFiles);
        for (k, v) in set {
            interpreter.set(k, v).unwrap();
        }
        script.run(&mut interpreter, until).unwrap();
        interpreter.mesh().map_or(0, PolyMesh::face_count)
    };
    assert_eq!(faces(&[], Some(3)), 7);
    assert_eq!(faces(&[("n", "1+2")], Some(3)), 6);
    assert_eq!(faces(&[], Some(2)), 0);
    // Four times: faces become faces and vertices, and vertices double with the edges.
    assert_eq!(faces(&[], None), 7 + 10 + 15 + 30 + 60);
    let mut interpreter = Interpreter::new(&NoFiles);
    interpreter.set("m", "1").unwrap();
    let error = script.run(&mut interpreter, None).unwrap_err().to_string();
    assert_eq!(
        error,
        "line 1: no parameter is named \"m\"; the script has n, h; did you mean \"n\"?"
    );
    assert!(interpreter.set("n", "1/").is_err());
    for (value, found) in [("1/0", "inf"), ("0/0", "NaN"), ("-1e400", "-inf")] {
        let error = interpreter.set("n", value).unwrap_err();
        assert_eq!(
            error,
            format!("the value is {found}; expected a finite number")
        );
    }
}

#[test]
fn errors_name_line_column_and_a_way_out() {
    for (text, line, column, words) in [
        (
            "cube\nextrude cubicle all",
            2,
            1,
            "did you mean \"cubical\"?",
        ),
        (
            "cube\n  remesh chekerboard",
            2,
            3,
            "did you mean \"checkerboard\"?",
        ),
        (
            "cube; remesh checkerboard s=1",
            1,
            27,
            "unknown argument \"s\"; expected one of t, groups",
        ),
        (
            "cube\nextrude cubical group=2",
            2,
            23,
            "selects none of the 6 faces; groups in use: 1",
        ),
        ("cube; extrude cubical", 1, 7, "expected its faces"),
        ("extrude cubical all", 1, 1, "there is no mesh yet"),
        (
            "cube; extrude cubical all tiers=[1, 2]",
            1,
            7,
            "2 tiers; cubical takes exactly 1",
        ),
        (
            "cube; extrude cubical all tiers=[]",
            1,
            7,
            "0 tiers; cubical takes exactly 1",
        ),
        (
            "cube; extrude cubical all dihedral=180",
            1,
            7,
            "180 degrees; expected more than 0 and less than 180",
        ),
        (
            "cube; extrude cubical all dihedral=80 tilt=3",
            1,
            7,
            "expected one of them",
        ),
        (
            "cube; extrude cubical all tiers=[1/0]",
            1,
            34,
            "the value is inf",
        ),
        (
            "cube; extrude cubical faces(sides == ) ",
            1,
            38,
            "expected a number",
        ),
        (
            "cube; extrude cubical faces(side == 4)",
            1,
            29,
            "nothing is named \"side\"",
        ),
        (
            "cube; extrude cubical faces(sides)",
            1,
            29,
            "expected a condition such as sides == 5",
        ),
        (
            "cube\nrepeat 2 { remesh dual",
            2,
            10,
            "\"{\" without its \"}\"",
        ),
        ("cube }", 1, 6, "\"}\" without its \"{\""),
        ("cube edge=[1", 1, 6, "a bracket is not closed"),
        ("cube edge=1)", 1, 12, "')' without an opening bracket"),
        ("repeat 1.5 { cube }", 1, 8, "whole number"),
        ("repeat { cube }", 1, 8, "expected a value"),
        ("param 2t = 1", 1, 1, "not a valid name of a parameter"),
        ("cube edge=0", 1, 1, "expected a length more than 0"),
        ("cube edge=1 edge=2", 1, 13, "edge is given twice"),
        ("prism n=2", 1, 1, "expected 3 to"),
        ("cube; assign all 0", 1, 7, "groups count from 1"),
        ("cube; assign all 1.5", 1, 18, "expected a whole number"),
        ("cube; merge 1 2", 1, 7, "no face is in group 2"),
        (
            "cube; startvertex all at=99",
            1,
            7,
            "face 0 has no vertex 99",
        ),
        ("cube; startvertex all", 1, 7, "exactly one of toward"),
        ("load nothing.obj", 1, 1, "no files can be read here"),
        (
            "polygon n=4; remesh dual",
            1,
            14,
            "dual of this mesh is not a valid mesh",
        ),
    ] {
        let error = refuse(text);
        assert_eq!(
            (error.line, error.column),
            (line, column),
            "{text}: {error}"
        );
        assert!(error.to_string().contains(words), "{text}: {error}");
    }
}

#[test]
fn notes_come_with_their_lines() {
    let mut interpreter = run(
        "cube\nextrude tetrahedral all iterations=3\nextrude icosahedral top dihedral=80",
    )
    .or_else(|_| {
        run("cube\nextrude tetrahedral all iterations=3\nextrude icosahedral last dihedral=80")
    })
    .unwrap();
    let notes = interpreter.take_notes();
    assert!(
        notes
            .iter()
            .any(|n| n.line == 2 && n.text.contains("has no top face")),
        "{notes:?}"
    );
    assert!(
        notes
            .iter()
            .any(|n| n.line == 3 && n.text.contains("fold over")),
        "{notes:?}"
    );
}

/// Steps that can follow any other, for histories.
fn step() -> impl Strategy<Value = &'static str> {
    prop::sample::select(vec![
        "cube",
        "icosahedron edge=2",
        "extrude cubical all tiers=[.3]",
        "extrude tetrahedral last",
        "remesh simplest",
        "remesh dual",
        "startvertex all lowest",
        "assign faces(index == 0) new",
        "renumber",
        "scale 2",
        "turn [1, 2, 3] 30",
    ])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn undo_and_redo_restore_models_bit_for_bit(steps in prop::collection::vec(step(), 1..6), back in 1usize..8) {
        let mut interpreter = Interpreter::with_history(&NoFiles, 50);
        let mut models = vec![interpreter.model().clone()];
        let all = std::iter::once("tetrahedron").chain(steps.iter().copied());
        for step in all {
            Script::parse(step).unwrap().run(&mut interpreter, None).unwrap();
            models.push(interpreter.model().clone());
        }
        let last = models.len() - 1;
        let back = back.min(last);
        for k in 1..=back {
            prop_assert!(interpreter.history().undo().is_some());
            prop_assert_eq!(interpreter.model(), &models[last - k]);
        }
        for k in (0..back).rev() {
            prop_assert!(interpreter.history().redo().is_some());
            prop_assert_eq!(interpreter.model(), &models[last - k]);
        }
        prop_assert!(interpreter.history().redo().is_none());
        // A failed step changes nothing; a new one forgets what was undone.
        let failed = Script::parse("merge 77 78").unwrap().run(&mut interpreter, None);
        prop_assert!(failed.is_err() && interpreter.model() == &models[last]);
        if interpreter.history().undo().is_some() && interpreter.mesh().is_some() {
            Script::parse("renumber").unwrap().run(&mut interpreter, None).unwrap();
            prop_assert!(interpreter.history().redo().is_none());
        }
    }

    #[test]
    fn no_text_panics_the_reader(text in "[a-z0-9 =;{}()\\[\\],.#\n\"/*+-]{0,80}") {
        let _ = run(&text);
    }
}

#[test]
fn a_history_is_bounded() {
    let mut interpreter = Interpreter::with_history(&NoFiles, 3);
    for _ in 0..9 {
        Script::parse("cube")
            .unwrap()
            .run(&mut interpreter, None)
            .unwrap();
    }
    let undone = std::iter::from_fn(|| interpreter.history().undo().map(str::to_owned)).count();
    assert_eq!(undone, 3);
    assert!(interpreter.mesh().is_some());
}

#[test]
fn every_example_is_what_it_says() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/crystal");
    let mut seen = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "crystal") {
            continue;
        }
        let (mesh, _) = druse::io::read_crystal(&path).unwrap_or_else(|e| panic!("{e}"));
        assert!(
            mesh.volume() > 0.0 && mesh.euler() == 2,
            "{}",
            path.display()
        );
        seen += 1;
    }
    assert!(seen >= 11, "{seen}");
    let volume = |name: &str| {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/crystal");
        druse::io::read_crystal(path.join(name)).unwrap().0.volume()
    };
    for (name, expected) in [
        ("four_way_star.crystal", 4.661949237),
        ("tower.crystal", 14.482144797),
        ("pseudo_menger.crystal", 0.619265356),
        ("cube_fractal.crystal", 1.380734644),
        ("pseudo_sierpinski.crystal", 0.063226915),
    ] {
        assert!(
            (volume(name) - expected).abs() < 1e-8,
            "{name}: {}",
            volume(name)
        );
    }
}
