//! Remeshing against the tables, and the laws that every scheme keeps.

use super::{json, judge, seed as read_seed, set_distance};
use druse::polymesh::{Grouping, PolyMesh, Remesh, RemeshError, scheme_names, seed};
use proptest::prelude::*;
use serde_json::Value;

/// The name of a row's scheme here, and its parameters.
fn scheme(row: &str) -> Remesh {
    // That program's root-3 goes the long way round.
    let name = match row {
        "global_cubic_extrude(loft)" => "loft",
        name => name,
    };
    Remesh::named(name).unwrap()
}

fn groups(mesh: &PolyMesh) -> Value {
    let counts = mesh.group_counts();
    Value::Object(
        counts
            .iter()
            .map(|(g, n)| (g.to_string(), (*n).into()))
            .collect(),
    )
}

#[test]
fn every_scheme_agrees_with_the_table() {
    let table = json("remesh.json");
    let mut seen = std::collections::BTreeSet::new();
    for row in table["cases"].as_array().unwrap() {
        let (solid, name) = (
            row["solid"].as_str().unwrap(),
            row["scheme"].as_str().unwrap(),
        );
        let old = read_seed(&table["seeds"][solid]);
        let new = if name.starts_with("root3_topmod") {
            let by = |mesh: &PolyMesh, n: &str| Remesh::named(n).unwrap().of(mesh).unwrap();
            let long = by(&by(&by(&old, "dual"), "honeycomb"), "dual");
            assert_eq!(long, by(&old, "dual_honeycomb"));
            long
        } else {
            scheme(name).of(&old).unwrap()
        };
        judge(&new, &row["expect"], &format!("{name} of {solid}"));
        assert_eq!(groups(&new), row["groups"], "{name} of {solid}");
        seen.insert(name.to_owned());
    }
    println!("figure: remeshing schemes compared | {} | 36", seen.len());
}

/// Volumes measured on the program in which these schemes were first made.
#[test]
fn schemes_agree_with_the_first_program() {
    let table = json("remesh.json");
    let mut worst = 0.0f64;
    for row in json("topmod_measured.json")["cases"].as_array().unwrap() {
        let old = read_seed(&table["seeds"][row["solid"].as_str().unwrap()]);
        let name = row["scheme"].as_str().unwrap();
        let s = scheme(name).of(&old).unwrap().summary();
        let counts = ["V", "E", "F"].map(|k| row[k].as_u64().unwrap() as usize);
        assert_eq!([s.vertices, s.edges, s.faces], counts, "{row}");
        if name == "root3" {
            // It goes by duals there, which the other table has.
            continue;
        }
        let off = (s.volume / row["volume"].as_f64().unwrap() - 1.0).abs();
        assert!(off < 1e-6, "{row}: {}", s.volume);
        worst = worst.max(off);
    }
    println!("figure: remeshed volumes against the first program | {worst:.1e} | 1e-6");
}

/// New vertices, edges, faces as (V, E, F) counts of each: one row a scheme whose counts are linear.
#[rustfmt::skip]
const COUNTS: &[(&str, [[usize; 3]; 3])] = &[
    ("dual", [[0, 0, 1], [0, 1, 0], [1, 0, 0]]),
    ("root3", [[1, 0, 1], [0, 3, 0], [0, 2, 0]]),
    ("root3_smooth", [[1, 0, 1], [0, 3, 0], [0, 2, 0]]),
    ("stellate", [[1, 0, 1], [0, 3, 0], [0, 2, 0]]),
    ("double_stellate_star", [[1, 2, 1], [0, 9, 0], [0, 6, 0]]),
    ("double_stellate_misc", [[1, 2, 1], [0, 6, 0], [0, 3, 0]]),
    ("stellate_edge_removal", [[1, 0, 1], [0, 2, 0], [0, 1, 0]]),
    ("linear_vertex_insertion", [[1, 1, 1], [0, 4, 0], [0, 2, 0]]),
    ("catmull_clark", [[1, 1, 1], [0, 4, 0], [0, 2, 0]]),
    ("pentagonal", [[1, 2, 1], [0, 5, 0], [0, 2, 0]]),
    ("cubic_pentagonal", [[1, 2, 1], [0, 5, 0], [0, 2, 0]]),
    ("fractal", [[1, 1, 1], [0, 6, 0], [0, 4, 0]]),
    ("simplest", [[0, 1, 0], [0, 2, 0], [1, 0, 1]]),
    ("vertex_truncation", [[0, 2, 0], [0, 3, 0], [1, 0, 1]]),
    ("honeycomb", [[0, 2, 0], [0, 3, 0], [1, 0, 1]]),
    ("loop_style", [[1, 1, 0], [0, 4, 0], [0, 2, 1]]),
    ("loop", [[1, 1, 0], [0, 4, 0], [0, 2, 1]]),
    ("checkerboard", [[1, 4, 0], [0, 9, 0], [0, 4, 1]]),
    ("pentagon_preserving", [[1, 3, 0], [0, 6, 0], [0, 2, 1]]),
    ("doo_sabin", [[0, 2, 0], [0, 4, 0], [1, 1, 1]]),
    ("corner_cutting", [[0, 2, 0], [0, 4, 0], [1, 1, 1]]),
    ("modified_corner_cutting", [[0, 2, 0], [0, 4, 0], [1, 1, 1]]),
    ("root4", [[1, 2, 0], [0, 4, 0], [0, 1, 1]]),
    ("dual_twelve_six_four", [[0, 4, 0], [0, 6, 0], [1, 1, 1]]),
    ("twelve_six_four", [[1, 1, 1], [0, 6, 0], [0, 4, 0]]),
    ("doo_sabin_bc", [[0, 4, 0], [0, 7, 0], [1, 2, 1]]),
    ("doo_sabin_bc_new", [[1, 4, 0], [0, 7, 0], [0, 2, 1]]),
    ("global_cubic_extrude", [[1, 2, 0], [0, 5, 0], [0, 2, 1]]),
    ("dome", [[1, 59, 0], [0, 116, 0], [0, 56, 1]]),
];

#[test]
fn every_scheme_has_its_counts_in_the_table_of_this_test() {
    let listed: Vec<&str> = COUNTS.iter().map(|row| row.0).collect();
    let missing: Vec<&str> = scheme_names()
        .into_iter()
        .filter(|n| !listed.contains(n))
        .collect();
    // The one whose counts depend on how many faces are triangles.
    assert_eq!(missing, ["triangulate"]);
}

/// Closed meshes with faces of several degrees.
fn mixed() -> impl Strategy<Value = PolyMesh> {
    let solids = prop::sample::select(seed::solids()).prop_map(|n| seed::solid(n, 1.0).unwrap());
    let prisms = (3usize..9, 0.5..2.0f64).prop_map(|(n, h)| seed::prism(n, 1.0, h).unwrap());
    let tori = (3usize..8, 3usize..8).prop_map(|(n, m)| seed::torus(2.0, 0.7, [n, m]).unwrap());
    prop_oneof![solids, prisms, tori]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn counts_follow_the_formulas(mesh in mixed()) {
        let old = [mesh.vertex_count(), mesh.edge_count(), mesh.face_count()];
        for (name, factors) in COUNTS {
            let new = Remesh::named(name).unwrap().of(&mesh).unwrap();
            let counts = factors.map(|row| row.iter().zip(old).map(|(f, n)| f * n).sum::<usize>());
            prop_assert_eq!([new.vertex_count(), new.edge_count(), new.face_count()], counts, "{}", name);
            prop_assert_eq!(new.euler(), mesh.euler());
        }
    }

    #[test]
    fn remeshing_and_moving_commute(mesh in mixed(), angle in -3.0..3.0f64) {
        let turn = nalgebra::Rotation3::from_euler_angles(angle, 0.3, -angle);
        let place = |m: &PolyMesh| m.mapped(|v| turn * v + v.map(|_| 0.7)).unwrap();
        for (name, _) in COUNTS {
            let by = |m: &PolyMesh| Remesh::named(name).unwrap().of(m).unwrap();
            let (one, other) = (by(&place(&mesh)), place(&by(&mesh)));
            prop_assert_eq!(one.faces(), other.faces());
            for (a, b) in one.vertices().iter().zip(other.vertices()) {
                prop_assert!((a - b).norm() < 1e-11, "{}: {} {}", name, a, b);
            }
        }
    }

    #[test]
    fn dual_after_dual_restores_the_topology(mesh in mixed()) {
        let dual = Remesh::named("dual").unwrap();
        let twice = dual.of(&dual.of(&mesh).unwrap()).unwrap();
        prop_assert_eq!(twice.vertex_count(), mesh.vertex_count());
        // Faces come back as loops over the same vertices, wherever they start.
        for f in 0..mesh.face_count() {
            let (mut a, mut b) = (mesh.face(f).to_vec(), twice.face(f).to_vec());
            let turn = |l: &mut Vec<u32>| {
                let least = l.iter().enumerate().min_by_key(|x| x.1).unwrap().0;
                l.rotate_left(least);
            };
            turn(&mut a);
            turn(&mut b);
            prop_assert_eq!(a, b);
        }
    }

    #[test]
    fn schemes_without_hands_ignore_start_vertices(mesh in mixed(), by in 1usize..4) {
        let turned = mesh.with_starts(&vec![by; mesh.face_count()]);
        for (name, _) in COUNTS {
            let new = |m: &PolyMesh| Remesh::named(name).unwrap().of(m).unwrap();
            let (one, other) = (new(&mesh), new(&turned));
            prop_assert!(set_distance(one.vertices(), other.vertices()) < 1e-9, "{}", name);
        }
    }
}

#[test]
fn groups_follow_the_requested_rule() {
    let old = seed::platonic("cube", 1.0)
        .unwrap()
        .with_groups(vec![5, 5, 7, 7, 9, 9]);
    let made = |name: &str, grouping: Grouping| {
        let mut scheme = Remesh::named(name).unwrap();
        scheme.grouping = grouping;
        scheme
            .of(&old)
            .map(|m| m.group_counts().into_iter().collect::<Vec<_>>())
    };
    assert_eq!(
        made("doo_sabin", Grouping::Class).unwrap(),
        [(1, 6), (2, 12), (3, 8)]
    );
    let keep = made("doo_sabin", Grouping::Keep).unwrap();
    assert_eq!(keep, [(5, 2), (7, 2), (9, 2), (10, 12), (11, 8)]);
    assert_eq!(
        made("checkerboard", Grouping::Parent).unwrap(),
        [(5, 18), (7, 18), (9, 18)]
    );
    assert_eq!(
        made("simplest", Grouping::Parent),
        Err(RemeshError::NoParent("simplest".into()))
    );
    assert_eq!(made("simplest", Grouping::Distinct).unwrap().len(), 14);
    assert_eq!(
        made("simplest", Grouping::Numbers(vec![4, 2])).unwrap(),
        [(2, 8), (4, 6)]
    );
    let few = made("simplest", Grouping::Numbers(vec![4])).unwrap_err();
    assert_eq!(
        few.to_string(),
        "simplest makes 2 classes of faces; found 1 group numbers"
    );
}

#[test]
fn bad_parameters_and_poor_meshes_are_named() {
    assert!(matches!(
        Remesh::named("dual_nothing"),
        Err(RemeshError::Unknown(_))
    ));
    let mut checkerboard = Remesh::named("checkerboard").unwrap();
    let range = checkerboard.set("t", 0.5).unwrap_err().to_string();
    assert_eq!(
        range,
        "checkerboard: t = 0.5; expected more than 0 and less than 0.5"
    );
    assert!(checkerboard.set("t", f64::NAN).is_err());
    let unknown = checkerboard.set("s", 1.0).unwrap_err().to_string();
    assert_eq!(unknown, "checkerboard has no parameter \"s\"; it has t");
    let flat = seed::polygon(5, 1.0).unwrap();
    let poor = Remesh::named("dual")
        .unwrap()
        .of(&flat)
        .unwrap_err()
        .to_string();
    assert!(
        poor.starts_with("dual of this mesh is not a valid mesh: face 0 has 2 corners"),
        "{poor}"
    );
}
