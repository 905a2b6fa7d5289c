//! The four words, and how open a surface is.

use super::{cube, joined, v, varied, without};
use druse::frame::Vec3;
use druse::mesh::{MeshReport, MeshSolid, Repair, TriMesh, check};

/// The answers of the four words as letters: upper case for yes.
fn words(mesh: &TriMesh) -> String {
    let r = check(mesh);
    let letter = |(word, answer): (&str, Option<bool>)| {
        let l = word.chars().next().unwrap();
        if answer.unwrap() {
            l.to_ascii_uppercase()
        } else {
            l
        }
    };
    r.properties().into_iter().map(letter).collect()
}

fn texts(repairs: &[Repair]) -> Vec<&str> {
    repairs.iter().map(|r| r.message.as_str()).collect()
}

fn unit() -> TriMesh {
    cube(v(0., 0., 0.), 1.0)
}

fn shifted(x: f64, y: f64, z: f64) -> TriMesh {
    cube(v(x, y, z), 1.0)
}

#[test]
fn sound_meshes_have_all_four_words() {
    for mesh in [
        unit(),
        unit().flipped(),
        TriMesh::ball(v(0.3, 0., 0.), 2.0, 4),
        varied().swap_remove(0),
    ] {
        let r = check(&mesh);
        assert!(r.is_sound() && r.defects().is_empty(), "{r}");
        assert_eq!(r.is_solid(), r.volume > 0.0);
        // Euler: a sphere.
        assert_eq!(r.vertices as i64 - r.triangles as i64 / 2, 2);
    }
    let two = check(&joined(&[unit(), shifted(2., 0., 0.)]));
    assert!(two.is_sound() && two.components == 2 && two.volume == 2.0 && two.area == 12.0);
}

#[test]
fn a_soup_is_judged_by_its_geometry() {
    let corners: Vec<Vec3> = unit().iter_corners().flatten().collect();
    let soup = (0..12).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    assert_eq!(words(&TriMesh::new(corners, soup).unwrap()), "COMN");
}

#[test]
fn each_defect_takes_its_word() {
    let open = without(&unit(), |t, _| t == 5);
    assert_eq!(words(&open), "cOMN");
    assert_eq!(check(&open).open_edges.count, 3);

    let mut t = unit().triangles().to_vec();
    t[3].swap(0, 1);
    let turned = TriMesh::new(unit().vertices().to_vec(), t).unwrap();
    assert_eq!(words(&turned), "CoMN");
    assert_eq!(
        check(&turned).misoriented_edges.places[0].triangles.len(),
        2
    );

    // Two cubes along one edge; at one corner.
    let along = joined(&[unit(), shifted(1., 1., 0.)]);
    assert_eq!(words(&along), "COmN");
    assert_eq!(check(&along).nonmanifold_edges.count, 1);
    assert_eq!(check(&along).nonmanifold_edges.places[0].at, v(1., 1., 0.5));
    let corner = joined(&[unit(), shifted(1., 1., 1.)]);
    let r = check(&corner);
    assert_eq!(words(&corner), "COmN");
    assert_eq!((r.pinched_vertices.count, r.components), (1, 1));
    assert_eq!(r.pinched_vertices.places[0].at, v(1., 1., 1.));

    let crossing = joined(&[unit(), shifted(0.5, 0.25, 0.125)]);
    assert_eq!(words(&crossing), "COMn");
    assert_eq!(words(&TriMesh::default()), "cOMN");
}

#[test]
fn a_triangle_without_area_is_counted_and_keeps_the_surface_closed() {
    // One face's diagonal gets a middle vertex on one side only: a sliver closes the gap.
    let cube = unit();
    let [a, b, c] = cube.triangles()[0];
    let mut vertices = cube.vertices().to_vec();
    vertices.push((vertices[a as usize] + vertices[b as usize]) / 2.0);
    let m = vertices.len() as u32 - 1;
    let mut triangles = cube.triangles().to_vec();
    triangles[0] = [a, m, c];
    triangles.extend([[m, b, c], [a, b, m]]);
    let r = check(&TriMesh::new(vertices, triangles).unwrap());
    assert_eq!(r.degenerate.count, 1);
    assert!(r.is_closed() && r.is_oriented() && r.is_manifold());
}

/// Whether two triangles meet beyond what they share.
fn meets(t: [[f64; 3]; 2], u: [[f64; 3]; 2], shared: [f64; 3]) -> bool {
    let p = |c: [f64; 3]| Vec3::from(c);
    let vertices = vec![p(t[0]), p(t[1]), p(shared), p(u[0]), p(u[1])];
    pair(&TriMesh::new(vertices, vec![[2, 0, 1], [2, 3, 4]]).unwrap())
}

fn pair(mesh: &TriMesh) -> bool {
    let r: MeshReport = check(mesh);
    r.is_free_of_intersections() == Some(false)
}

#[test]
fn pairs_of_triangles_meet_exactly_where_they_should_not() {
    let o = [0., 0., 0.];
    let flat = [[2., 0., 0.], [0., 2., 0.]];
    // About a common corner: apart, through it, in its plane beside it, in its plane over it.
    assert!(!meets(flat, [[1., 1., 1.], [1., 2., 1.]], o));
    assert!(meets(flat, [[1., 1., 1.], [0.25, 0.25, -1.]], o));
    assert!(!meets(flat, [[-1., 0., 0.], [0., -1., 0.]], o));
    assert!(meets(flat, [[1., 1., 0.], [-1., 3., 0.]], o));
    // A corner of one lies exactly on the other.
    assert!(meets(flat, [[0.5, 0.5, 0.], [1., 1., 1.]], o));
    // About a common side: unfolded, folded to an angle, folded flat.
    let folded = |d: [f64; 3]| {
        let vertices = [o, [1., 0., 0.], [0., 1., 0.], d].map(Vec3::from).to_vec();
        pair(&TriMesh::new(vertices, vec![[0, 1, 2], [1, 0, 3]]).unwrap())
    };
    assert!(!folded([0.3, -1., 0.]) && !folded([0.3, 1., 1e-300]) && folded([0.3, 0.7, 0.]));
    // Apart by less than any tolerance, touching, and the same twice.
    let apart = |z: f64| {
        let t = [o, [1., 0., 0.], [0., 1., 0.]];
        let mut vertices = t.map(Vec3::from).to_vec();
        vertices.extend([[0.2, 0.2, z], [0.3, 0.2, 1.], [0.2, 0.3, 1.]].map(Vec3::from));
        pair(&TriMesh::new(vertices, vec![[0, 1, 2], [3, 4, 5]]).unwrap())
    };
    assert!(!apart(1e-300) && apart(0.0) && apart(-1e-300));
    let t = vec![v(0., 0., 0.), v(1., 0., 0.), v(0., 1., 0.)];
    assert!(pair(&TriMesh::new(t, vec![[0, 1, 2], [0, 2, 1]]).unwrap()));
    // In one plane: beside each other, one within the other.
    let plane = |s: f64, x: f64| {
        let t = [[0., 0.], [1., 0.], [0., 1.]];
        let mut vertices: Vec<Vec3> = t.map(|[a, b]| v(a, 0.5, b)).to_vec();
        vertices.extend(t.map(|[a, b]| v(x + s * a, 0.5, x + s * b)));
        pair(&TriMesh::new(vertices, vec![[0, 1, 2], [3, 4, 5]]).unwrap())
    };
    assert!(!plane(1.0, 0.6) && plane(0.1, 0.2) && plane(9.0, -1.0));
}

#[test]
fn crossing_balls_are_found_in_any_order_of_triangles() {
    let ball = TriMesh::ball(v(0., 0., 0.), 1.0, 4);
    let crossing = joined(&[ball.clone(), ball.mapped(|p| p + v(0.7, 0.01, 0.02))]);
    let r = check(&crossing);
    // Each of them has an earlier or a later partner; only later ones are searched.
    assert!(r.to_string().contains("\nat least "), "{r}");
    let found = r.self_intersections.unwrap();
    // A ring of about the length of the common circle over the length of an edge.
    assert!(found.count > 100 && found.count < 500, "{}", found.count);
    for d in &found.places {
        assert!((d.at - v(0.35, 0., 0.)).norm() < 1.05 && (d.at.x - 0.35).abs() < 0.15);
    }
    assert!(check(&joined(&[ball.clone(), ball.mapped(|p| p * 0.9)])).is_sound());
}

#[test]
fn what_can_be_closed_is_and_what_cannot_is_refused_with_its_place() {
    let (solid, warnings) = MeshSolid::repaired(unit()).unwrap();
    assert!(warnings.is_empty() && solid.is_cycle());

    let (solid, warnings) = MeshSolid::repaired(unit().flipped()).unwrap();
    assert!(solid.contains(v(0.5, 0.5, 0.5)));
    assert_eq!(
        texts(&warnings),
        ["the triangles are oriented inward; flipped"]
    );

    let lid = |t: [Vec3; 3]| t.iter().all(|p| p.z == 1.0);
    let (solid, warnings) = MeshSolid::repaired(without(&unit(), |_, t| lid(t))).unwrap();
    assert!(solid.contains(v(0.5, 0.5, 0.95)) && !solid.contains(v(0.5, 0.5, 1.05)));
    assert_eq!(
        texts(&warnings),
        [
            "4 of 17 edges are open, in 1 hole; the longest has 4 edges, length 4.0000, around (0.5000, 0.5000, 1.0000); closed by the winding number"
        ]
    );

    let half = without(&unit(), |_, t| {
        [0, 1, 2].iter().any(|&a| t.iter().all(|p| p[a] == 1.0))
    });
    let sheet = without(&unit(), |_, t| !lid(t));
    for without_volume in [half, sheet, TriMesh::default()] {
        let e = MeshSolid::repaired(without_volume)
            .err()
            .expect("bounds nothing");
        assert!(
            e.to_string().starts_with("the surface bounds no solid: "),
            "{e}"
        );
    }
    let ball = TriMesh::ball(v(0., 0., 0.), 1.0, 4);
    let holed = without(&ball, |t, _| t % 50 == 0);
    let (solid, warnings) = MeshSolid::repaired(holed).unwrap();
    let open = solid.openness();
    let edges = check(solid.mesh()).open_edges.count;
    assert_eq!((warnings.len(), open.open_edges), (1, edges));
    assert_eq!(open.holes.iter().map(|h| h.edges).sum::<usize>(), edges);
}

#[test]
fn checking_three_million_triangles_is_printed() {
    if !crate::is_full() {
        return;
    }
    let ball = TriMesh::ball(v(0., 0., 0.), 1.0, 9)
        .mapped(|p| p * (1.0 + 0.2 * (7.0 * p.x).sin() * (5.0 * p.y).cos()));
    let start = std::time::Instant::now();
    let r = check(&ball);
    assert!(r.is_sound(), "{r}");
    println!(
        "figure: check of {} triangles | {:.1?} | 60 s",
        r.triangles,
        start.elapsed()
    );
}
