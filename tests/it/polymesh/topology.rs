//! What a polygon mesh is and is not, the seeds, and triangles.

use druse::frame::Vec3;
use druse::mesh::check;
use druse::polymesh::{Faces, PolyError, PolyMesh, seed};

fn cube() -> PolyMesh {
    seed::platonic("cube", 1.0).unwrap()
}

/// The cube with its list of faces changed.
fn changed(change: impl Fn(&mut Vec<Vec<u32>>)) -> PolyError {
    let cube = cube();
    let mut faces: Vec<Vec<u32>> = cube.faces().iter().map(<[u32]>::to_vec).collect();
    change(&mut faces);
    PolyMesh::from_lists(cube.vertices().to_vec(), faces).unwrap_err()
}

#[test]
fn what_is_no_manifold_is_refused_by_name() {
    let text = |change: fn(&mut Vec<Vec<u32>>)| changed(change).to_string();
    assert_eq!(changed(Vec::clear), PolyError::Empty);
    assert!(text(|f| drop(f.pop())).contains("has no face on its other side"));
    assert!(matches!(
        changed(|f| drop(f.pop())),
        PolyError::Open { face: 1, .. }
    ));
    let flipped = changed(|f| f[3].reverse());
    assert!(
        matches!(flipped, PolyError::SameDirection { second: 3, .. }),
        "{flipped}"
    );
    assert!(matches!(
        changed(|f| f.push(f[0].clone())),
        PolyError::SameDirection {
            first: 0,
            second: 6,
            ..
        }
    ));
    assert!(matches!(
        changed(|f| f[2].truncate(2)),
        PolyError::TooFewCorners {
            face: 2,
            corners: 2
        }
    ));
    assert!(matches!(
        changed(|f| f[2][1] = 8),
        PolyError::NoSuchVertex {
            face: 2,
            vertex: 8,
            count: 8
        }
    ));
    assert!(matches!(
        changed(|f| f[2][1] = f[2][3]),
        PolyError::RepeatedVertex { face: 2, .. }
    ));
    let mut points = cube().vertices().to_vec();
    points.push(Vec3::zeros());
    let faces: Vec<Vec<u32>> = cube().faces().iter().map(<[u32]>::to_vec).collect();
    assert_eq!(
        PolyMesh::from_lists(points.clone(), &faces),
        Err(PolyError::Unused(8))
    );
    points[8].x = f64::NAN;
    assert!(matches!(
        PolyMesh::from_lists(points, &faces),
        Err(PolyError::NotFinite { vertex: 8, .. })
    ));
    let loops: Faces = faces.iter().cloned().collect();
    let groups = PolyMesh::new(cube().vertices().to_vec(), loops.clone(), vec![1; 5]);
    assert!(matches!(
        groups,
        Err(PolyError::GroupCount {
            groups: 5,
            faces: 6
        })
    ));
    let zero = PolyMesh::new(cube().vertices().to_vec(), loops, vec![1, 1, 0, 1, 1, 1]);
    assert_eq!(zero, Err(PolyError::GroupZero(2)));
}

#[test]
fn two_solids_at_one_vertex_are_pinched_there() {
    let t = seed::platonic("tetrahedron", 1.0).unwrap();
    let mut points = t.vertices().to_vec();
    points.extend(t.vertices()[1..].iter().map(|v| v + Vec3::x() * 9.0));
    let other = |v: &u32| if *v == 0 { 0 } else { v + 3 };
    let mut faces: Vec<Vec<u32>> = t.faces().iter().map(<[u32]>::to_vec).collect();
    faces.extend(t.faces().iter().map(|f| f.iter().map(other).collect()));
    let error = PolyMesh::from_lists(points, faces).unwrap_err();
    assert_eq!(error, PolyError::Pinched { vertex: 0, fans: 2 });
}

#[test]
fn solids_have_equal_edges_planes_and_positive_volume() {
    assert_eq!(seed::solids().len(), 5 + 13);
    for name in seed::solids() {
        let s = seed::solid(name, 2.5).unwrap().summary();
        assert_eq!(s.euler, 2, "{name}");
        assert!(
            (s.edge_lengths.0 - 2.5).abs() < 1e-12,
            "{name}: {:?}",
            s.edge_lengths
        );
        assert!(
            (s.edge_lengths.1 - 2.5).abs() < 1e-12,
            "{name}: {:?}",
            s.edge_lengths
        );
        assert!(
            s.planarity.0 < 1e-12 && s.volume > 0.0,
            "{name}: {:?}",
            s.planarity
        );
    }
}

#[test]
fn other_seeds_have_the_volumes_of_their_formulas() {
    let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
    near(
        seed::prism(6, 2.0, 3.0).unwrap().volume(),
        1.5 * 3f64.sqrt() * 4.0 * 3.0,
    );
    near(seed::pyramid(4, 2.0, Some(3.0)).unwrap().volume(), 4.0);
    near(
        seed::antiprism(3, 1.0, None).unwrap().volume(),
        2f64.sqrt() / 3.0,
    );
    let grid = seed::grid([2, 3, 4], 0.5).unwrap();
    near(grid.volume(), 3.0);
    assert_eq!(grid.face_count(), 2 * (6 + 12 + 8));
    let torus = seed::torus(2.0, 0.5, [16, 8]).unwrap();
    assert_eq!((torus.euler(), torus.face_count()), (0, 128));
    assert!(torus.volume() > 0.0);
    for wrong in [
        seed::prism(2, 1.0, 1.0),
        seed::prism(5, 1.0, 0.0),
        seed::polygon(3, f64::NAN),
        seed::grid([0, 1, 1], 1.0),
        seed::grid([1 << 20; 3], 1.0),
        seed::torus(1.0, 1.0, [9, 9]),
        seed::torus(1.0, 0.1, [2, 9]),
    ] {
        assert!(wrong.unwrap_err().to_string().contains("expected"));
    }
}

#[test]
fn turning_start_vertices_keeps_the_mesh() {
    let mesh = seed::solid("snub_cube", 1.0).unwrap();
    let shift: Vec<usize> = (0..mesh.face_count()).collect();
    let turned = mesh.with_starts(&shift);
    for f in 0..mesh.face_count() {
        let n = mesh.face(f).len();
        assert_eq!(turned.face(f)[0], mesh.face(f)[shift[f] % n]);
    }
    // What is stored beside the loops follows them.
    let again = PolyMesh::new(
        turned.vertices().to_vec(),
        turned.faces().clone(),
        turned.groups().to_vec(),
    );
    assert_eq!(again.unwrap(), turned);
    assert_eq!(mesh.flipped().volume(), -mesh.volume());
    assert_eq!(mesh.flipped().flipped(), mesh);
}

#[test]
fn triangles_keep_volume_and_closedness() {
    let p = |x: f64, y: f64| Vec3::new(x, y, 0.0);
    let comb = vec![
        p(0., 0.),
        p(5., 0.),
        p(5., 3.),
        p(4., 1.),
        p(3., 3.),
        p(2., 1.),
        p(0., 3.),
    ];
    let base = seed::two_sided(comb).unwrap().with_groups(vec![1, 2]);
    let mut meshes: Vec<PolyMesh> = seed::solids()
        .iter()
        .map(|n| seed::solid(n, 1.0).unwrap())
        .collect();
    let prism = druse::polymesh::Extrusion::regular(druse::polymesh::Kind::Cubical);
    meshes.push(prism.of_group(&base, 1).unwrap().mesh);
    meshes.push(seed::torus(3.0, 1.0, [12, 8]).unwrap());
    for mesh in meshes {
        let cut = mesh.triangulated().unwrap();
        let report = check(&cut.mesh);
        assert!(report.is_sound(), "{report}");
        assert_eq!(cut.faces.len(), cut.mesh.triangles().len());
        let volume = mesh.volume();
        assert!(
            (report.volume - volume).abs() < 1e-9 * volume,
            "{} {volume}",
            report.volume
        );
    }
}
