//! Several open scans of one object, and triangles given twice: one copy counts.

use super::{joined, points, v, without};
use druse::frame::Aabb;
use druse::mesh::{MeshSolid, TriMesh};

/// A ball without its lowest 60 degrees.
fn scan(radius: f64) -> TriMesh {
    let ball = TriMesh::ball(v(0., 0., 0.), radius, 4);
    without(&ball, |_, t| {
        t.iter().map(|p| p.z).sum::<f64>() < -1.5 * radius
    })
}

fn box_of_balls() -> Aabb {
    Aabb {
        min: v(-12., -12., -12.),
        max: v(12., 12., 12.),
    }
}

/// Holds that a mesh is the same solid as another one.
fn assert_same(mesh: TriMesh, right: &TriMesh, what: &str) {
    let (solid, repairs) = MeshSolid::repaired(mesh).unwrap();
    assert!(!repairs.is_empty(), "{what}");
    let (right, _) = MeshSolid::repaired(right.clone()).unwrap();
    for p in points(&box_of_balls(), 400) {
        let d = right.signed_distance(p);
        let found = solid.signed_distance(p);
        assert!((found - d).abs() < 1e-9, "{what}: {p:?} {found} {d}");
    }
}

#[test]
fn one_of_several_scans_of_a_surface_counts() {
    let [outer, inner] = [scan(10.0), scan(9.9)];
    let cases = [
        ("inside", [outer.clone(), inner.clone()]),
        ("around", [inner.clone(), outer.clone()]),
        ("inward", [outer.clone(), inner.flipped()]),
        ("both inward", [outer.flipped(), inner.flipped()]),
        ("twice", [outer.clone(), outer.clone()]),
    ];
    for (what, scans) in cases {
        assert_same(joined(&scans), &outer, what);
    }
    // The two sides of one sheet.
    let sheet = joined(&[outer.clone(), outer.flipped()]);
    assert!(MeshSolid::repaired(sheet).is_err());
    let three = [scan(9.8), outer.clone(), inner];
    assert_same(joined(&three), &outer, "three");
}

#[test]
fn triangles_given_twice_count_once() {
    let ball = TriMesh::ball(v(0., 0., 0.), 10.0, 3);
    let some = without(&ball, |n, _| n % 3 != 0);
    assert_same(joined(&[ball.clone(), some]), &ball, "a third");
    let open = scan(10.0);
    let some = without(&open, |n, _| n % 2 == 0);
    assert_same(
        joined(&[some, open.clone()]),
        &open,
        "a half of an open one",
    );
}

#[test]
fn an_open_shell_within_another_counts_only_if_it_is_a_wall() {
    let outer = scan(10.0);
    for radius in [9.3, 8.0, 6.0] {
        let both = joined(&[outer.clone(), scan(radius)]);
        assert_same(both, &outer, &format!("{radius}"));
    }
    // A vessel: its cavity is wound inward.
    let vessel = joined(&[outer.clone(), scan(8.0).flipped()]);
    let (solid, _) = MeshSolid::repaired(vessel).unwrap();
    assert!(solid.contains(v(0., 0., 9.)) && !solid.contains(v(0., 0., 5.)));
    // A bowl beside it.
    let beside = scan(6.0).mapped(|p| p + v(30., 0., 0.));
    let (solid, repairs) = MeshSolid::repaired(joined(&[outer, beside])).unwrap();
    assert!(solid.contains(v(0., 0., 8.)) && solid.contains(v(30., 0., 0.)));
    let texts: Vec<String> = repairs.iter().map(ToString::to_string).collect();
    assert!(!texts.iter().any(|t| t.contains("left out")), "{texts:?}");
}
