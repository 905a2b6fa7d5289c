//! Chosen faces cut into quads and triangles.

use druse::polymesh::{Interpreter, NoFiles, Parts, PolyMesh, Script, seed};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn cutting_faces_keeps_shape_groups_and_characteristic(
        name in prop::sample::select(seed::solids()), pick in any::<u64>(), triangles in any::<bool>()
    ) {
        let mesh = seed::solid(name, 1.0).unwrap();
        let groups = (0..mesh.face_count()).map(|f| 1 + f as u32 % 3).collect();
        let mesh = mesh.with_groups(groups);
        let chosen: Vec<bool> = (0..mesh.face_count()).map(|f| pick.rotate_left(f as u32) & 1 == 1).collect();
        let into = if triangles { Parts::Triangles } else { Parts::Quads };
        let (cut, first) = mesh.subdivided(&chosen, into).unwrap();
        prop_assert_eq!(cut.euler(), 2);
        prop_assert!((cut.volume() / mesh.volume() - 1.0).abs() < 1e-12);
        prop_assert!((cut.area() / mesh.area() - 1.0).abs() < 1e-12);
        // Parts are as many as the corners of what is cut, and have the share of each group's area.
        let corners: usize = (0..mesh.face_count()).filter(|&f| chosen[f]).map(|f| mesh.face(f).len()).sum();
        prop_assert_eq!(cut.face_count() - first, corners);
        prop_assert_eq!(first, chosen.iter().filter(|c| !**c).count());
        let sides = if triangles { 3 } else { 4 };
        prop_assert!((first..cut.face_count()).all(|f| cut.face(f).len() == sides));
        let area = |m: &PolyMesh, group: u32| (0..m.face_count()).filter(|&f| m.groups()[f] == group).map(|f| m.face_area(f)).sum::<f64>();
        for group in 1..=3 {
            prop_assert!((area(&cut, group) - area(&mesh, group)).abs() < 1e-9);
        }
    }
}

#[test]
fn scripts_subdivide_what_they_select() {
    let run = |text: &str| {
        let mut interpreter = Interpreter::new(&NoFiles);
        Script::parse(text)?.run(&mut interpreter, None)?;
        Ok::<_, druse::polymesh::ScriptError>(interpreter.mesh().unwrap().clone())
    };
    let quads = run("cube; subdivide top").unwrap();
    // The four faces beside it have five corners now.
    assert_eq!((quads.vertex_count(), quads.face_count()), (13, 9));
    assert_eq!(quads.faces().iter().filter(|f| f.len() == 5).count(), 4);
    let triangles = run("cube; subdivide all into=triangles; extrude tetrahedral last").unwrap();
    assert_eq!(triangles.face_count(), 72);
    for (text, words) in [
        (
            "cube; subdivide all into=hexes",
            "expected quads or triangles",
        ),
        ("cube; subdivide", "expected its faces"),
        ("cube; subdivide group=2", "selects none"),
        ("subdivide all", "there is no mesh yet"),
    ] {
        let error = run(text).unwrap_err().to_string();
        assert!(error.contains(words), "{text}: {error}");
    }
}
