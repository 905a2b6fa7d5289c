//! Extrusions against the tables, and the laws that every extrusion keeps.

use super::{indices, json, judge, numbers, points, seed as read_seed, set_distance};
use druse::frame::Vec3;
use druse::polymesh::{
    Dihedral, ExtrudeError, Extrusion, Kind, Operator, PolyMesh, extrusion_named, seed,
};
use proptest::prelude::*;
use serde_json::Value;

/// The seed of a row: a two-sided polygon, groups 1 and 2.
fn base(row: &Value) -> PolyMesh {
    let base = &row["base"];
    let mesh = if base["points"].is_array() {
        seed::two_sided(points(&base["points"])).unwrap()
    } else {
        let n = base["n"].as_u64().unwrap() as usize;
        seed::polygon(n, base["edge"].as_f64().unwrap_or(1.0)).unwrap()
    };
    mesh.with_groups(vec![1, 2])
}

fn extrusion(row: &Value) -> Extrusion {
    let (kind, operator) = extrusion_named(row["extrusion"].as_str().unwrap()).unwrap();
    Extrusion {
        kind,
        operator,
        dihedral: Dihedral::Degrees(row["delta_deg"].as_f64().unwrap()),
        tiers: numbers(&row["tiers"]),
        iterations: row["iterations"].as_u64().unwrap() as usize,
        level: row["level"].as_bool().unwrap(),
        odd: false,
    }
}

#[test]
fn every_extrusion_agrees_with_the_table() {
    let rows = json("extrusions.json");
    for row in rows.as_array().unwrap() {
        let name = row["id"].as_str().unwrap();
        let made = extrusion(row).of_group(&base(row), 1).unwrap().mesh;
        if name == "dodecahedral_negative" {
            // All vertices of its second tier coincide: the planes through them, and so the third tier, are
            // whatever rounding makes of them.
            assert_eq!((made.vertex_count(), made.face_count()), (20, 12));
            continue;
        }
        judge(&made, &row["expect"], name);
        if row["vertices"].is_array() {
            for (p, q) in made.vertices().iter().zip(points(&row["vertices"])) {
                assert!((p - q).norm() < 1e-9, "{name}: {p} {q}");
            }
            let faces = row["faces"].as_array().unwrap();
            for (f, face) in faces.iter().enumerate() {
                assert_eq!(made.face(f), indices(face), "{name}: face {f}");
            }
            assert_eq!(made.groups(), indices(&row["groups"]), "{name}");
        }
    }
    assert_eq!(rows.as_array().unwrap().len(), 264);
}

#[test]
fn archimedean_extrusions_agree_with_the_table() {
    let rows = json("archimedean.json");
    let letters = ["t", "a", "e", "b", "s"];
    for row in rows.as_array().unwrap() {
        let name = row["id"].as_str().unwrap();
        let extrusion = match row["op"].as_str() {
            None => extrusion(row),
            Some(letter) => {
                let place = letters.iter().position(|l| *l == letter).unwrap();
                let kind: Kind = row["seed_extrusion"].as_str().unwrap().parse().unwrap();
                Extrusion {
                    operator: Some(Operator::ALL[place].0),
                    ..Extrusion::regular(kind)
                }
            }
        };
        let made = extrusion.of_group(&base(row), 1).unwrap().mesh;
        judge(&made, &row["expect"], name);
        if row["vertices"].is_array() {
            let off = set_distance(made.vertices(), &points(&row["vertices"]));
            assert!(off < 1e-9, "{name}: {off}");
            let faces = row["faces"].as_array().unwrap();
            assert_eq!(made.face(0), indices(&faces[0]), "{name}");
            assert_eq!(made.groups(), indices(&row["groups"]), "{name}");
        }
    }
}

/// Numbers measured on the program in which these extrusions were first made.
#[test]
fn extrusions_agree_with_the_first_program_where_it_keeps_the_rules() {
    let rows = json("topmod_measured_extrude.json");
    for row in rows.as_array().unwrap() {
        let kind: Kind = row["extrusion"].as_str().unwrap().parse().unwrap();
        let tiers = numbers(&row["tiers"]);
        let extrusion = Extrusion {
            dihedral: Dihedral::Degrees(row["delta_deg"].as_f64().unwrap()),
            tiers: tiers[..kind.tiers()].to_vec(),
            ..Extrusion::regular(kind)
        };
        let n = row["n"].as_u64().unwrap() as usize;
        let made = extrusion.of_group(&seed::polygon(n, 1.0).unwrap().with_groups(vec![1, 2]), 1);
        let found = made.unwrap().mesh.summary();
        let counts = ["V", "E", "F"].map(|k| row[k].as_u64().unwrap() as usize);
        assert_eq!([found.vertices, found.edges, found.faces], counts);
        // That program starts from the second corner's side on some polygons; the volume shows nothing of it.
        let volume = row["volume"].as_f64().unwrap();
        assert!(
            (found.volume / volume - 1.0).abs() < 1e-6,
            "{row}: {}",
            found.volume
        );
    }
}

#[test]
fn groups_follow_the_thesis() {
    let rows = json("groups.json");
    for row in rows.as_array().unwrap() {
        let name = row["id"].as_str().unwrap();
        let mut mesh = read_seed(&row["seed"]);
        for step in row["steps"].as_array().unwrap() {
            mesh = match step[0].as_str().unwrap() {
                "set" => {
                    let mut groups = mesh.groups().to_vec();
                    let group = step[2].as_u64().unwrap() as u32;
                    for f in indices(&step[1]) {
                        groups[f as usize] = group;
                    }
                    mesh.with_groups(groups)
                }
                "gex" => {
                    let (kind, operator) = extrusion_named(step[2].as_str().unwrap()).unwrap();
                    let extrusion = Extrusion {
                        operator,
                        dihedral: Dihedral::Degrees(step[3].as_f64().unwrap()),
                        tiers: numbers(&step[4]),
                        ..Extrusion::regular(kind)
                    };
                    let group = step[1].as_u64().unwrap() as u32;
                    extrusion.of_group(&mesh, group).unwrap().mesh
                }
                _ => continue,
            };
        }
        if row["steps"][0][0] == "check" {
            continue;
        }
        judge(&mesh, &row["expect"], name);
        let faces = row["expect"]["faces_with_groups"].as_array().unwrap();
        for (f, face) in faces.iter().enumerate() {
            assert_eq!(
                u64::from(mesh.groups()[f]),
                face[0].as_u64().unwrap(),
                "{name}: face {f}"
            );
            let centre = Vec3::from_iterator(numbers(&face[1]));
            assert!((mesh.centre(f) - centre).norm() < 1e-9, "{name}: face {f}");
        }
    }
}

#[test]
fn regular_solids_come_out_exactly() {
    for kind in Kind::ALL {
        let base = seed::polygon(kind.corners(), 1.0)
            .unwrap()
            .with_groups(vec![1, 2]);
        let solid = Extrusion::regular(kind).of_group(&base, 1).unwrap().mesh;
        let s = solid.summary();
        assert!(s.edge_lengths.1 - s.edge_lengths.0 < 1e-14, "{kind}");
        assert!(s.planarity.0 < 1e-14, "{kind}");
        // All corners on one sphere.
        let centre: Vec3 = solid.vertices().iter().sum::<Vec3>() / s.vertices as f64;
        let radii: Vec<f64> = solid
            .vertices()
            .iter()
            .map(|v| (v - centre).norm())
            .collect();
        let spread = radii
            .iter()
            .map(|r| (r - radii[0]).abs())
            .fold(0.0, f64::max);
        assert!(spread < 1e-14, "{kind}: {spread}");
    }
}

#[test]
fn automatic_angles_make_uniform_pyramids_and_antiprisms() {
    let made = |kind, n| {
        let extrusion = Extrusion {
            dihedral: Dihedral::Auto,
            ..Extrusion::regular(kind)
        };
        let base = seed::polygon(n, 1.0).unwrap().with_groups(vec![1, 2]);
        extrusion
            .of_group(&base, 1)
            .unwrap()
            .mesh
            .summary()
            .edge_lengths
    };
    let uniform = |(least, most): (f64, f64)| (most - least).abs() < 1e-13;
    assert!((3..=5).all(|n| uniform(made(Kind::Tetrahedral, n))));
    assert!((3..=20).all(|n| uniform(made(Kind::Octahedral, n))));
    assert!(!uniform(made(Kind::Tetrahedral, 6)));
}

/// An L: its corner 3 is reflex.
fn ell() -> PolyMesh {
    let p = |x: f64, y: f64| Vec3::new(x, y, 0.0);
    let points = vec![
        p(0., 0.),
        p(2., 0.),
        p(2., 1.),
        p(1., 1.),
        p(1., 2.),
        p(0., 2.),
    ];
    seed::two_sided(points).unwrap().with_groups(vec![1, 2])
}

#[test]
fn reflex_corners_rise_like_the_others() {
    for kind in [Kind::Cubical, Kind::Dodecahedral] {
        for degrees in [70.0, 110.0] {
            let extrusion = Extrusion {
                dihedral: Dihedral::Degrees(degrees),
                tiers: vec![0.1; kind.tiers()],
                ..Extrusion::regular(kind)
            };
            let mesh = extrusion.of_group(&ell(), 1).unwrap().mesh;
            assert!(mesh.vertices()[6..].iter().all(|v| v.z > 0.0), "{kind}");
        }
    }
}

#[test]
fn level_makes_a_plane_top_on_an_uneven_base() {
    for kind in [
        Kind::Cubical,
        Kind::Dodecahedral,
        Kind::Icosahedral,
        Kind::Cuboctahedral,
    ] {
        let p = |x: f64, y: f64| Vec3::new(x, y, 0.0);
        let uneven = vec![p(0., 0.), p(2., 0.), p(2.5, 1.2), p(1., 2.2), p(-0.4, 1.)];
        let base = seed::two_sided(uneven).unwrap().with_groups(vec![1, 2]);
        let made = |level| {
            let extrusion = Extrusion {
                dihedral: Dihedral::Degrees(110.0),
                level,
                ..Extrusion::regular(kind)
            };
            extrusion.of_group(&base, 1).unwrap()
        };
        let (bent, plane) = (made(false), made(true));
        assert!(bent.mesh.residual(1) > 1e-3, "{kind}");
        assert!(
            bent.notes.iter().any(|n| n.contains("level")),
            "{kind}: {:?}",
            bent.notes
        );
        assert!(plane.mesh.summary().planarity.0 < 1e-12, "{kind}");
    }
}

#[test]
fn bad_parameters_are_named() {
    let cube = seed::platonic("cube", 1.0).unwrap();
    let with = |change: fn(&mut Extrusion)| {
        let mut extrusion = Extrusion::regular(Kind::Dodecahedral);
        change(&mut extrusion);
        extrusion.of_group(&cube, 1).unwrap_err()
    };
    assert_eq!(
        with(|e| e.dihedral = Dihedral::Degrees(180.0)),
        ExtrudeError::Angle(180.0)
    );
    assert!(
        with(|e| e.dihedral = Dihedral::Degrees(f64::NAN))
            .to_string()
            .contains("expected more than 0")
    );
    let tiers = with(|e| e.tiers = vec![1.0, 1.0]);
    assert_eq!(tiers.to_string(), "2 tiers; dodecahedral takes exactly 3");
    assert!(matches!(
        with(|e| e.tiers = vec![1.0, f64::NAN, 1.0]),
        ExtrudeError::Tier { index: 2, .. }
    ));
    assert_eq!(with(|e| e.iterations = 0), ExtrudeError::Iterations(0));
    let nothing = Extrusion::regular(Kind::Cubical)
        .of_group(&cube, 7)
        .unwrap_err();
    assert_eq!(nothing, ExtrudeError::Nothing);
    let truncated = with(|e| e.operator = Some(Operator::Truncate)).to_string();
    assert!(
        truncated.contains("4 corners; truncated_dodecahedral expects at least 6"),
        "{truncated}"
    );
    // An edge without length, and a spike.
    let p = |x: f64, y: f64| Vec3::new(x, y, 0.0);
    for (points, word) in [
        (
            vec![p(0., 0.), p(1., 0.), p(1., 0.), p(0., 1.)],
            "edge 1 has the length 0",
        ),
        (
            vec![p(0., 0.), p(2., 0.), p(1., 0.), p(0., 1.)],
            "corner 1 is a spike",
        ),
        (vec![p(0., 0.), p(1., 0.), p(2., 0.)], "no area"),
    ] {
        let base = seed::two_sided(points).unwrap();
        let error = Extrusion::regular(Kind::Cubical)
            .of_group(&base, 1)
            .unwrap_err()
            .to_string();
        assert!(
            error.starts_with("face 0: ") && error.contains(word),
            "{error}"
        );
    }
}

/// A random rotation and shift.
fn motion() -> impl Strategy<Value = (nalgebra::Rotation3<f64>, Vec3)> {
    let part = -3.0..3.0f64;
    (
        part.clone(),
        part.clone(),
        part.clone(),
        part.clone(),
        part.clone(),
        part,
    )
        .prop_map(|(a, b, c, x, y, z)| {
            (
                nalgebra::Rotation3::from_euler_angles(a, b, c),
                Vec3::new(x, y, z),
            )
        })
}

fn any_extrusion() -> impl Strategy<Value = Extrusion> {
    let kind = prop::sample::select(Kind::ALL.to_vec());
    let tiers = prop::collection::vec(0.2..1.5f64, 3);
    (kind, 95.0..150.0f64, tiers, any::<bool>()).prop_map(|(kind, degrees, tiers, level)| {
        Extrusion {
            dihedral: Dihedral::Degrees(degrees),
            tiers: tiers[..kind.tiers()].to_vec(),
            level,
            ..Extrusion::regular(kind)
        }
    })
}

/// Solids whose faces are regular or nearly so.
fn solid() -> impl Strategy<Value = PolyMesh> {
    let names = seed::solids();
    prop::sample::select(names).prop_map(|name| seed::solid(name, 1.0).unwrap())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn counts_follow_the_formulas_and_euler_stays(mesh in solid(), extrusion in any_extrusion(), pick in any::<u32>()) {
        let chosen: Vec<bool> = (0..mesh.face_count()).map(|f| pick >> (f % 32) & 1 == 1 || f == 0).collect();
        let made = extrusion.of(&mesh, &chosen).unwrap().mesh;
        let (mut v, mut f) = (mesh.vertex_count(), mesh.face_count());
        for face in (0..chosen.len()).filter(|&f| chosen[f]) {
            let (points, faces) = extrusion.kind.counts(mesh.face(face).len());
            v += points;
            f += faces - 1;
        }
        prop_assert_eq!((made.vertex_count(), made.face_count()), (v, f));
        prop_assert_eq!(made.euler(), mesh.euler());
    }

    #[test]
    fn moving_and_extruding_commute(mesh in solid(), extrusion in any_extrusion(), (turn, shift) in motion()) {
        let place = |m: &PolyMesh| m.mapped(|v| turn * v + shift).unwrap();
        let one = extrusion.of_group(&place(&mesh), 1).unwrap().mesh;
        let other = place(&extrusion.of_group(&mesh, 1).unwrap().mesh);
        prop_assert_eq!(one.faces(), other.faces());
        for (a, b) in one.vertices().iter().zip(other.vertices()) {
            prop_assert!((a - b).norm() < 1e-9 * (1.0 + b.norm()), "{} {}", a, b);
        }
    }

    #[test]
    fn the_start_vertex_changes_no_geometry(mesh in solid(), extrusion in any_extrusion(), by in 1usize..5) {
        let turned = mesh.with_starts(&vec![by; mesh.face_count()]);
        let one = extrusion.of_group(&mesh, 1).unwrap().mesh;
        let other = extrusion.of_group(&turned, 1).unwrap().mesh;
        prop_assert!(set_distance(one.vertices(), other.vertices()) < 1e-9);
        prop_assert!((one.volume() - other.volume()).abs() < 1e-9 * one.volume().abs().max(1.0));
    }

    #[test]
    fn snub_solids_of_both_kinds_have_equal_edges(kind in prop::sample::select(Kind::ALL[..5].to_vec())) {
        let extrusion = Extrusion { operator: Some(Operator::Snub), ..Extrusion::regular(kind) };
        let base = seed::polygon(kind.corners(), 1.0).unwrap().with_groups(vec![1, 2]);
        let made = extrusion.of_group(&base, 1).unwrap().mesh.summary();
        prop_assert!(made.edge_lengths.1 - made.edge_lengths.0 < 1e-12);
        prop_assert!(made.planarity.0 < 1e-12);
    }
}
