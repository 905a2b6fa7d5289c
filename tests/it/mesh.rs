//! Laws of `mesh`: measures, distance, winding number, skins.

mod check;
mod scans;
pub mod signs;

use crate::field::assert_field_laws;
use druse::field::{Field, SampleLattice};
use druse::frame::{Aabb, Vec3, WorldPoint};
use druse::mesh::{MeshError, MeshSolid, QuadMesh, Side, Skin, TriMesh};
use proptest::prelude::*;

fn v(x: f64, y: f64, z: f64) -> Vec3 {
    Vec3::new(x, y, z)
}

fn cube(min: Vec3, edge: f64) -> TriMesh {
    TriMesh::cuboid(&Aabb {
        min,
        max: min.add_scalar(edge),
    })
}

/// The mesh without the triangles that `drop` names.
fn without(mesh: &TriMesh, drop: impl Fn(usize, [Vec3; 3]) -> bool) -> TriMesh {
    let kept = (0..mesh.triangles().len()).filter(|&t| !drop(t, mesh.corners(t)));
    let kept = kept.map(|t| mesh.triangles()[t]).collect();
    TriMesh::new(mesh.vertices().to_vec(), kept).unwrap()
}

fn joined(parts: &[TriMesh]) -> TriMesh {
    let mut all = TriMesh::default();
    for p in parts {
        all.append(p).unwrap();
    }
    all
}

/// Random points of a box, the same on every run.
fn points(bounds: &Aabb, count: usize) -> Vec<Vec3> {
    let mut s = 7u64;
    let mut next = || {
        s = s
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (s >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..count)
        .map(|_| bounds.min + Vec3::from_fn(|_, _| next()).component_mul(&bounds.size()))
        .collect()
}

/// Distance to a triangle by another route: the plane if the foot lies within, else the sides.
fn distance_to(t: [Vec3; 3], p: Vec3) -> f64 {
    let n = (t[1] - t[0]).cross(&(t[2] - t[0]));
    let within = (0..3).all(|i| n.cross(&(t[(i + 1) % 3] - t[i])).dot(&(p - t[i])) >= 0.0);
    let longest = (0..3)
        .map(|i| (t[i] - t[(i + 1) % 3]).norm_squared())
        .fold(0.0, f64::max);
    if within && n.norm() > 1e-8 * longest {
        return (p - t[0]).dot(&n).abs() / n.norm();
    }
    let side = |i: usize| {
        let (a, d) = (t[i], t[(i + 1) % 3] - t[i]);
        let s = if d.norm_squared() > 0.0 {
            (d.dot(&(p - a)) / d.norm_squared()).clamp(0.0, 1.0)
        } else {
            0.0
        };
        (a + d * s - p).norm()
    };
    side(0).min(side(1)).min(side(2))
}

/// The winding number as a plain sum of solid angles.
fn winding_by_sum(mesh: &TriMesh, q: Vec3) -> f64 {
    let angle = |t: [Vec3; 3]| {
        let [a, b, c] = t.map(|p| p - q);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let n = a.dot(&b.cross(&c));
        let d = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * n.atan2(d)
    };
    mesh.iter_corners().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// Three bumpy meshes: a ball, a ring of boxes that cross, a random soup of triangles.
fn varied() -> Vec<TriMesh> {
    let bumpy = TriMesh::ball(v(0.1, 0.2, -0.1), 1.0, 4)
        .mapped(|p| p * (1.0 + 0.2 * (7.0 * p.x).sin() * (5.0 * p.y).cos()));
    let ring = (0..7).map(|i| {
        let a = f64::from(i) * 0.9;
        cube(v(a.cos() - 0.3, a.sin() - 0.3, -0.4), 0.8)
    });
    let p = points(
        &Aabb {
            min: v(-1., -1., -1.),
            max: v(1., 1., 1.),
        },
        300,
    );
    let soup = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    vec![
        bumpy,
        joined(&ring.collect::<Vec<_>>()),
        TriMesh::new(p, soup).unwrap(),
    ]
}

const SEARCH_BOX: Aabb = Aabb {
    min: Vec3::new(-1.7, -1.7, -1.7),
    max: Vec3::new(1.7, 1.7, 1.7),
};

#[test]
fn what_is_not_a_mesh_is_refused() {
    let triangle = vec![v(0., 0., 0.), v(1., 0., 0.), v(0., 1., 0.)];
    let e = TriMesh::new(triangle.clone(), vec![[0, 1, 2], [0, 1, 3]]).unwrap_err();
    assert_eq!(
        e.to_string(),
        "face 1 names vertex 3; expected one of 0 to 2"
    );
    let e = QuadMesh::new(triangle, vec![[0, 1, 2, 2], [0, 1, 2, 3]]).unwrap_err();
    assert_eq!(
        e.to_string(),
        "face 1 names vertex 3; expected one of 0 to 2"
    );
    let e = TriMesh::new(vec![v(0., f64::NAN, 0.)], vec![]).unwrap_err();
    assert!(matches!(e, MeshError::NotFinite { vertex: 0, .. }));
}

#[test]
fn merging_joins_equal_corners_and_keeps_the_triangles() {
    let cube = cube(v(-1., -1., -1.), 2.0);
    let soup: Vec<Vec3> = cube.iter_corners().flatten().collect();
    let numbers = (0..12).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let soup = TriMesh::new(soup, numbers).unwrap();
    let merged = soup.merged();
    assert_eq!(merged.vertices().len(), 8);
    assert!(merged.iter_corners().eq(cube.iter_corners()));
    assert_eq!(merged.edges().len(), 18);
    // Zero has two signs and one place.
    let zeros = TriMesh::new(
        vec![v(0., 1., 0.), v(-0., 1., 0.), v(1., 1., 0.)],
        vec![[0, 1, 2]],
    );
    assert_eq!(zeros.unwrap().merged().vertices().len(), 2);
}

#[test]
fn a_ball_converges_to_the_sphere_at_second_order() {
    let exact = (
        4.0 / 3.0 * std::f64::consts::PI * 8.0,
        16.0 * std::f64::consts::PI,
    );
    let error = |levels| {
        let ball = TriMesh::ball(v(1e3, -1e3, 5.0), 2.0, levels);
        assert_eq!(ball.triangles().len(), 8 << (2 * levels));
        (1.0 - ball.volume() / exact.0, 1.0 - ball.area() / exact.1)
    };
    let (a, b) = (error(3), error(5));
    assert!(b.0 > 0.0 && (a.0 / b.0 - 16.0).abs() < 1.5 && (a.1 / b.1 - 16.0).abs() < 1.5);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn volume_and_area_follow_a_similarity(
        scale in 0.01..100.0f64, angle in prop::array::uniform3(-3.0..3.0), shift in prop::array::uniform3(-1e3..1e3),
    ) {
        let mesh = &varied()[0];
        let r = nalgebra::Rotation3::new(Vec3::from(angle));
        let moved = mesh.mapped(|p| r * p * scale + Vec3::from(shift));
        let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-9;
        prop_assert!(near(moved.volume(), mesh.volume() * scale.powi(3)));
        prop_assert!(near(moved.area(), mesh.area() * scale * scale));
        let mirrored = mesh.mapped(|p| v(-p.x, p.y, p.z));
        prop_assert!(near(mirrored.volume(), -mesh.volume()));
        prop_assert!(near(mirrored.flipped().volume(), mesh.volume()));
    }

    #[test]
    fn distance_follows_a_similarity(
        scale in 1e-6..1e6f64, angle in prop::array::uniform3(-3.0..3.0), shift in prop::array::uniform3(-1e3..1e3),
        p in prop::array::uniform3(-2.0..2.0),
    ) {
        let mesh = varied().swap_remove(0);
        let r = nalgebra::Rotation3::new(Vec3::from(angle));
        let map = |p: Vec3| (r * p + Vec3::from(shift)) * scale;
        let moved = MeshSolid::new(mesh.mapped(map));
        let d = MeshSolid::new(mesh).signed_distance(Vec3::from(p));
        prop_assert!((moved.signed_distance(map(Vec3::from(p))) - d * scale).abs() < 1e-11 * scale);
    }
}

#[test]
fn distance_and_winding_agree_with_sums_over_all_triangles() {
    // Closed, and with one triangle missing.
    let whole = varied();
    let open: Vec<TriMesh> = whole.iter().map(|m| without(m, |t, _| t == 11)).collect();
    for mesh in whole.into_iter().chain(open) {
        let solid = MeshSolid::new(mesh.clone());
        for p in points(&SEARCH_BOX, 1000) {
            let c = solid.closest(p);
            let scan = mesh
                .iter_corners()
                .map(|t| distance_to(t, p))
                .fold(f64::INFINITY, f64::min);
            assert!(
                (c.distance - scan).abs() < 1e-12,
                "{} against {scan} at {p:?}",
                c.distance
            );
            assert!(distance_to(mesh.corners(c.triangle as usize), c.point) < 1e-12);
            assert!(((c.point - p).norm() - c.distance).abs() < 1e-14);
            let w = winding_by_sum(&mesh, p);
            let fast = solid.winding_number(p);
            assert!(
                !solid.is_cycle() || (fast - w).abs() < 1e-9,
                "{fast} against {w} at {p:?}"
            );
            assert!((fast - w).abs() < 0.03, "{fast} against {w} at {p:?}");
        }
    }
}

#[test]
fn needles_and_points_keep_the_distance_exact() {
    // Triangles that degenerate to needles, segments and points.
    let p = points(&SEARCH_BOX, 600);
    let shrunk = |i: usize, f: f64| p[3 * i] + (p[3 * i + 1] - p[3 * i]) * f;
    let mut vertices = Vec::new();
    for i in 0..200 {
        let a = p[3 * i];
        let along = shrunk(i, 0.7);
        let third = match i % 4 {
            0 => along,
            1 => along + (p[3 * i + 2] - a) * 1e-9,
            2 => along + (p[3 * i + 2] - a) * 1e-5,
            _ => a,
        };
        let second = if i % 8 == 3 { a } else { p[3 * i + 1] };
        vertices.extend([a, second, third]);
    }
    let triangles = (0..200).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mesh = TriMesh::new(vertices, triangles).unwrap();
    let solid = MeshSolid::new(mesh.clone());
    for q in points(&SEARCH_BOX.dilated(0.1), 2000) {
        let scan = mesh
            .iter_corners()
            .map(|t| distance_to(t, q))
            .fold(f64::INFINITY, f64::min);
        let d = solid.closest(q).distance;
        // A needle 1e-9 wide is its own segment within that width.
        assert!((d - scan).abs() < 4e-9, "{d} against {scan}");
    }
    // Many at a time are as exact.
    for q in points(&SEARCH_BOX, 40) {
        let lattice = SampleLattice {
            origin: WorldPoint(q),
            step: 0.03,
            counts: [5, 7, 9],
        };
        let mut out = vec![0f32; lattice.len()];
        solid.fill(&lattice, &mut out);
        for (n, &f) in out.iter().enumerate() {
            let d = solid.closest(lattice.point(n).0).distance;
            // Distances within their own rounding are those of the surface.
            let d = if d < 1e-11 { 0.0 } else { d };
            assert_eq!(f.abs(), d as f32, "{:?}", lattice.point(n));
        }
    }
}

#[test]
fn a_box_mesh_is_the_box() {
    let solid = MeshSolid::new(cube(v(-1., -1., -1.), 2.0));
    let exact = druse::field::BoxSolid(solid.bounds());
    assert!(solid.is_cycle());
    for p in points(&SEARCH_BOX, 5000) {
        let (d, e) = (solid.signed_distance(p), exact.value(WorldPoint(p)));
        assert!((d - e).abs() < 1e-14, "{d} against {e}");
    }
}

#[test]
fn inside_is_known_for_nested_doubled_and_crossing_surfaces() {
    let ball = |r: f64| TriMesh::ball(v(0., 0., 0.), r, 3);
    // A hollow: the inner surface winds inward.
    let hollow = MeshSolid::new(joined(&[ball(1.0), ball(0.5).flipped()]));
    // Islands within islands, all outward; a surface given twice; two that cross.
    let nested = MeshSolid::new(joined(&[ball(1.0), ball(0.5)]));
    let doubled = MeshSolid::new(joined(&[ball(1.0), ball(1.0)]));
    let crossing = MeshSolid::new(joined(&[
        ball(1.0),
        ball(1.0).mapped(|p| p + v(0.9, 0., 0.)),
    ]));
    for p in points(&SEARCH_BOX, 3000) {
        let r = p.norm();
        if (r - 1.0).abs() < 0.03
            || (r - 0.5).abs() < 0.03
            || ((p.x - 0.9).hypot(p.y.hypot(p.z)) - 1.0).abs() < 0.03
        {
            continue;
        }
        assert_eq!(hollow.contains(p), r < 1.0 && r > 0.5);
        assert_eq!(nested.contains(p), r < 1.0);
        assert_eq!(doubled.contains(p), r < 1.0);
        assert_eq!(
            crossing.contains(p),
            r < 1.0 || (p - v(0.9, 0., 0.)).norm() < 1.0
        );
    }
}

#[test]
fn a_ray_through_corners_and_sides_counts_them_once() {
    // Symmetric meshes, queried in their planes of symmetry, where rays meet only corners and sides.
    let ball = TriMesh::ball(v(0., 0., 0.), 1.0, 3);
    let box_ = cube(v(-1., -1., -1.), 2.0);
    for (mesh, scale) in [(&ball, 0.95), (&box_, 0.99)] {
        let solid = MeshSolid::new(mesh.clone());
        for p in mesh.vertices() {
            for f in [0.0, 0.3, 0.5, scale] {
                assert_eq!(solid.winding_number(p * f), 1.0, "{p:?} {f}");
            }
            assert_eq!(solid.winding_number(p * 1.01), 0.0);
            let twice = joined(&[mesh.clone(), mesh.mapped(|q| q * 0.5)]);
            assert_eq!(MeshSolid::new(twice).winding_number(p * 0.25), 2.0);
        }
    }
}

#[test]
fn an_open_hemisphere_closes_along_its_disc() {
    let ball = TriMesh::ball(v(0., 0., 0.), 1.0, 4);
    let bowl = MeshSolid::new(without(&ball, |_, t| {
        t.iter().map(|p| p.z).sum::<f64>() > 0.0
    }));
    assert!(!bowl.is_cycle());
    for p in points(&SEARCH_BOX, 3000) {
        let margin = (p.norm() - 1.0).abs().min(p.z.abs());
        if margin > 0.05 {
            assert_eq!(
                bowl.contains(p),
                p.norm() < 1.0 && p.z < 0.0,
                "{p:?} {}",
                bowl.winding_number(p)
            );
        }
    }
    // By symmetry the disc of the rim sees exactly half.
    assert!((bowl.winding_number(v(0., 0., 0.)) - 0.5).abs() < 0.02);
}

#[test]
fn caps_close_the_solid_but_have_no_distance() {
    let cube = cube(v(-1., -1., -1.), 2.0);
    let on_top = |t: [Vec3; 3]| t.iter().all(|p| p.z == 1.0);
    let is_cap: Vec<bool> = cube.iter_corners().map(on_top).collect();
    let solid = MeshSolid::with_caps(cube, &is_cap);
    assert_eq!(solid.signed_distance(v(0., 0., 0.9)), -1.0);
    assert_eq!(solid.signed_distance(v(0.25, 0., 0.9)), -0.75);
    assert!((solid.signed_distance(v(0., 0., 1.5)) - 1.25f64.sqrt()).abs() < 1e-14);
    assert_field_laws(
        &solid,
        &Aabb {
            min: v(-0.2, -0.2, 0.8),
            max: v(0.2, 0.2, 1.2),
        },
        1e-9,
    );
}

#[test]
fn mesh_solids_and_skins_obey_the_field_laws() {
    let mut meshes = varied();
    let open = without(&meshes[0], |t, _| t % 97 == 0);
    meshes.push(open);
    for mesh in meshes {
        let solid = MeshSolid::new(mesh);
        let skins = [Side::Inside, Side::Outside, Side::Both].map(|s| Skin::new(&solid, 0.3, s));
        for (i, c) in points(&SEARCH_BOX, 60).into_iter().enumerate() {
            let edge = [0.01, 0.1, 1.0][i % 3];
            let region = Aabb {
                min: c,
                max: c.add_scalar(edge),
            };
            assert_field_laws(&solid, &region, 1e-9);
            for s in &skins {
                assert_field_laws(s, &region, 1e-9);
            }
        }
    }
}

#[test]
fn bulk_evaluation_equals_single_on_whole_leaves() {
    for mesh in varied() {
        let solid = MeshSolid::new(mesh);
        for (i, c) in points(&SEARCH_BOX, 80).into_iter().enumerate() {
            let step = [0.004, 0.02, 0.1][i % 3];
            let lattice = SampleLattice {
                origin: WorldPoint(c),
                step,
                counts: [8, 8, 8],
            };
            let mut out = vec![0f32; 512];
            solid.fill(&lattice, &mut out);
            for (n, &f) in out.iter().enumerate() {
                let single = solid.value(lattice.point(n));
                assert_eq!(f, single as f32, "sample {n} of leaf {i}");
            }
        }
    }
}

#[test]
fn a_skin_is_the_offset_shell() {
    let solid = MeshSolid::new(cube(v(-1., -1., -1.), 2.0));
    let at = |side, x| Skin::new(&solid, 0.2, side).value(WorldPoint(v(x, 0., 0.)));
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-14, "{a} {b}");
    near(at(Side::Inside, 0.9), -0.1);
    near(at(Side::Inside, 0.7), 0.1);
    near(at(Side::Inside, 1.1), 0.1);
    near(at(Side::Outside, 1.1), -0.1);
    near(at(Side::Outside, 0.9), 0.1);
    near(at(Side::Both, 1.0), -0.1);
    near(at(Side::Both, 0.85), 0.05);
}

#[test]
fn an_empty_mesh_is_nowhere() {
    let solid = MeshSolid::new(TriMesh::default());
    assert_eq!(solid.signed_distance(v(0., 0., 0.)), f64::INFINITY);
    assert_eq!(solid.winding_number(v(0., 0., 0.)), 0.0);
    let mut out = [0f32; 8];
    let origin = WorldPoint(v(0., 0., 0.));
    solid.fill(
        &SampleLattice {
            origin,
            step: 1.0,
            counts: [2; 3],
        },
        &mut out,
    );
    assert_eq!(out, [f32::INFINITY; 8]);
}

/// Processor time of this thread in ns, which a busy machine does not stretch much.
fn busy() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    let first = text.split_ascii_whitespace().next().unwrap();
    first.parse().unwrap()
}

/// Prints the cost per point; a figure for people, so it has no limit.
#[test]
fn speed_is_printed() {
    if !crate::is_full() {
        return;
    }
    for levels in [5, 7, 9] {
        let mesh = TriMesh::ball(v(0., 0., 0.), 1.0, levels)
            .mapped(|p| p * (1.0 + 0.2 * (7.0 * p.x).sin() * (5.0 * p.y).cos()));
        let triangles = mesh.triangles().len();
        let solid = MeshSolid::new(mesh);
        let random = points(&SEARCH_BOX, 20_000);
        let mut start = busy();
        let mut lap = |samples: usize| {
            let ns = (busy() - start) / samples as f64;
            start = busy();
            ns
        };
        let mut sum: f64 = random.iter().map(|&p| solid.signed_distance(p)).sum();
        let far = lap(random.len());
        let near: Vec<Vec3> = random
            .iter()
            .map(|&p| solid.closest(p).point + p * 0.02)
            .collect();
        lap(1);
        sum += near.iter().map(|&p| solid.signed_distance(p)).sum::<f64>();
        let close = lap(near.len());
        let step = 0.01;
        let mut out = vec![0f32; 512];
        for p in near.iter().take(2000) {
            let origin = WorldPoint((p / step / 8.0).map(f64::floor) * step * 8.0);
            let lattice = SampleLattice {
                origin,
                step,
                counts: [8; 3],
            };
            solid.fill(&lattice, &mut out);
            sum += f64::from(out[0]);
        }
        let bulk = lap(2000 * 512);
        assert!(sum.is_finite());
        println!(
            "figure: signed distance to {triangles} triangles | {far:.0} ns anywhere, {close:.0} ns near, \
             {bulk:.0} ns in leaves | 4000 ns"
        );
    }
}
