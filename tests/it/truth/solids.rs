//! Closed meshes are solids: unions, voids, turned shells.
//!
//! Right values are closed forms in `tests/data/truth/expected.json`, or brute force over boxes and balls.

use crate::strategy::Noise;
use druse::cell::{Caps, Placement, Source};
use druse::field::{Field, Interval, LeafBits, Leaves, SampleLattice};
use druse::frame::{Aabb, CellPoint, Element, LengthUnit, Vec3, WorldPoint};
use druse::io::read_mesh;
use druse::mesh::{MeshSolid, RepairKind, TriMesh, check};
use druse::pipeline::{Report, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;

fn path(name: &str) -> String {
    format!("{}/tests/data/truth/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn expected(file: &str, key: &str) -> f64 {
    let text = std::fs::read_to_string(path("expected.json")).unwrap();
    let all: serde_json::Value = serde_json::from_str(&text).unwrap();
    all[file][key].as_f64().unwrap()
}

/// Runs operations on voxels of so many units.
fn report(voxel: f64, ops: &str) -> Report {
    let text = format!("druse = 1\n[band]\nvoxel_size = {voxel}\n{ops}");
    let recipe = Recipe::parse(&text, &[]).unwrap();
    run(&recipe, &RunOptions::default(), &Silent).unwrap()
}

fn union(name: &str) -> String {
    format!("[[op]]\nunion = {{ mesh = {:?} }}\n", path(name))
}

fn codes(report: &Report) -> Vec<&str> {
    report.warnings.iter().map(|w| w.code).collect()
}

fn assert_near(found: f64, right: f64, relative: f64) {
    assert!(
        (found / right - 1.0).abs() < relative,
        "found {found}, expected {right}"
    );
}

fn solid(name: &str) -> (MeshSolid, Vec<RepairKind>) {
    let (solid, repairs) = MeshSolid::repaired(read_mesh(path(name)).unwrap().mesh).unwrap();
    (solid, repairs.into_iter().map(|r| r.kind).collect())
}

fn joined(parts: &[TriMesh]) -> TriMesh {
    let mut all = TriMesh::default();
    for p in parts {
        all.append(p).unwrap();
    }
    all
}

fn with_turned(mesh: &TriMesh, turned: impl Fn(usize) -> bool) -> TriMesh {
    let triangles = mesh.triangles().iter().enumerate();
    let triangles = triangles.map(|(n, &[a, b, c])| if turned(n) { [a, c, b] } else { [a, b, c] });
    TriMesh::new(mesh.vertices().to_vec(), triangles.collect()).unwrap()
}

#[test]
fn overlapping_and_nested_shells_are_one_solid() {
    for name in ["two_boxes.stl", "nested_same.stl", "nested_reversed.stl"] {
        let found = report(0.1, &union(name));
        let volume = expected(name, "volume");
        // A level set rounds edges by a share of the voxel.
        assert_near(found.solid.volume, volume, 0.003);
        assert_near(found.solid.area, expected(name, "area"), 0.015);
        assert_eq!(found.solid.components, 1, "{name}");
        let overlaps = name != "nested_reversed.stl";
        assert_eq!(codes(&found).contains(&"W113"), overlaps, "{name}");
        let closed = report(0.2, &(union(name) + "[[op]]\nfill_voids = true\n"));
        let voids = u64::from(!overlaps);
        assert_eq!(closed.solid.filled_voids, voids, "{name}");
    }
}

#[test]
fn an_erosion_of_overlapping_boxes_is_that_of_their_union() {
    let found = report(0.1, &(union("two_boxes.stl") + "[[op]]\nerode = 0.2\n"));
    let right = expected("two_boxes.stl", "eroded_0.2");
    assert_near(found.solid.volume, right, 0.004);
    assert_eq!(found.solid.components, 1);
}

#[test]
fn a_lattice_of_overlapping_beams_is_one_piece_without_voids() {
    let found = report(0.1, &(union("beams.stl") + "[[op]]\nfill_voids = true\n"));
    assert_eq!((found.solid.components, found.solid.filled_voids), (1, 0));
    assert_eq!(codes(&found), ["W113"]);
    assert!(found.warnings[0].message.contains("54 of 54 shells"));
}

#[test]
fn an_open_baffle_does_not_cut() {
    let whole = Aabb {
        min: Vec3::zeros(),
        max: Vec3::repeat(10.0),
    };
    // One ends inside, one goes from wall to wall.
    for [low, high] in [[2.0, 8.0], [0.0, 10.0]] {
        let corners = [[low, low], [high, low], [high, high], [low, high]];
        let corners = corners.map(|[y, z]| Vec3::new(5.0, y, z));
        let baffle = TriMesh::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("baffle.stl");
        let mesh = joined(&[TriMesh::cuboid(&whole), baffle]);
        druse::io::write_mesh(&file, &mesh, LengthUnit::Millimetre).unwrap();
        let file = file.display().to_string();
        let found = report(0.1, &format!("[[op]]\nunion = {{ mesh = {file:?} }}\n"));
        assert_eq!(found.solid.components, 1);
        assert_near(found.solid.volume, 1000.0, 0.002);
        assert_near(found.solid.area, 600.0, 0.015);
    }
}

#[test]
fn a_mesh_is_the_same_solid_in_every_place() {
    let file = path("two_boxes.stl");
    let block = "[[op]]\nunion = { box = { size = [60, 60, 60] } }\n";
    let whole = 60f64.powi(3);
    let volume = expected("two_boxes.stl", "volume");
    let common = report(
        0.25,
        &format!("{block}[[op]]\nintersect = {{ mesh = {file:?} }}\n"),
    );
    let left = report(
        0.25,
        &format!("{block}[[op]]\nsubtract = {{ mesh = {file:?} }}\n"),
    );
    // The box may be cut by the block's faces: both together are the block in any case.
    assert_near(common.solid.volume + left.solid.volume, whole, 0.002);
    assert_near(common.solid.volume, volume, 0.02);
    assert_eq!(common.solid.components, 1);
    for found in [&common, &left] {
        assert_eq!(codes(found), ["W113"]);
    }
}

#[test]
fn distances_pass_buried_faces_by() {
    let (boxes, repairs) = solid("two_boxes.stl");
    assert_eq!(repairs, [RepairKind::United]);
    let bounds = boxes.bounds();
    let (first, second) = {
        let mesh = boxes.mesh();
        let half = |n: usize| Aabb::of((12 * n..12 * n + 12).flat_map(|t| mesh.corners(t)));
        (half(0), half(1))
    };
    let mut noise = Noise::new(3);
    for _ in 0..3000 {
        let p = bounds.centre().0 + noise.vector().component_mul(&bounds.size()) * 0.6;
        let d = boxes.signed_distance(p);
        assert!(
            (d - union_of_boxes(&[first, second], p)).abs() < 1e-9,
            "{p:?} {d}"
        );
    }
}

/// The signed distance to a union of boxes, by brute force: outside the least of those to the boxes; inside
/// to the nearest part of a face that no box holds, found by halving squares of faces.
fn union_of_boxes(boxes: &[Aabb], p: Vec3) -> f64 {
    let distance = |b: &Aabb| {
        let away = Vec3::from_fn(|a, _| (b.min[a] - p[a]).max(p[a] - b.max[a]));
        let outside = away.map(|c| c.max(0.0)).norm();
        if outside > 0.0 { outside } else { away.max() }
    };
    let least = boxes.iter().map(distance).fold(f64::INFINITY, f64::min);
    if least > 0.0 {
        return least;
    }
    // The planes of all faces part the faces into rectangles, each buried or free as a whole.
    let cuts: [Vec<f64>; 3] = std::array::from_fn(|a| {
        let mut all: Vec<f64> = boxes.iter().flat_map(|b| [b.min[a], b.max[a]]).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    });
    let holds = |q: Vec3| {
        let within = |b: &Aabb| (0..3).all(|a| b.min[a] < q[a] && q[a] < b.max[a]);
        boxes.iter().any(within)
    };
    let mut nearest = f64::INFINITY;
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for &at in &cuts[axis] {
            for s in cuts[u].windows(2) {
                for t in cuts[v].windows(2) {
                    let mut middle = Vec3::zeros();
                    middle[axis] = at;
                    middle[u] = f64::midpoint(s[0], s[1]);
                    middle[v] = f64::midpoint(t[0], t[1]);
                    let beside = [-1e-7, 1e-7].map(|e| holds(middle + Vec3::ith(axis, e)));
                    if beside[0] == beside[1] {
                        continue;
                    }
                    let mut foot = middle;
                    foot[u] = p[u].clamp(s[0], s[1]);
                    foot[v] = p[v].clamp(t[0], t[1]);
                    nearest = nearest.min((foot - p).norm());
                }
            }
        }
    }
    -nearest
}

#[test]
fn random_boxes_unite_to_what_brute_force_says() {
    let mut noise = Noise::new(11);
    for round in 0..20 {
        // Whole corners: coplanar and touching faces are frequent.
        let boxes: Vec<Aabb> = (0..2 + round % 5)
            .map(|_| {
                let corner = noise.vector().map(|c| (3.0 * c).round());
                let size = noise.vector().map(|c| (2.0 + 1.9 * c).round().max(1.0));
                Aabb {
                    min: corner,
                    max: corner + size,
                }
            })
            .collect();
        let mesh = joined(&boxes.iter().map(TriMesh::cuboid).collect::<Vec<_>>());
        let (solid, _) = MeshSolid::repaired(mesh).unwrap();
        for _ in 0..300 {
            let p = noise.vector() * 6.0;
            let (d, right) = (solid.signed_distance(p), union_of_boxes(&boxes, p));
            assert!(
                (d - right).abs() < 1e-9,
                "round {round}, {p:?}: {d} {right}"
            );
        }
        assert_lattice_agrees(&solid, 4.0, &mut noise);
    }
}

/// Bulk values and bounds agree with those of single points.
fn assert_lattice_agrees(solid: &MeshSolid, reach: f64, noise: &mut Noise) {
    let origin = WorldPoint(noise.vector() * reach);
    let lattice = SampleLattice {
        origin,
        step: 0.17,
        counts: [8; 3],
    };
    let mut filled = vec![0.0; 512];
    solid.fill(&lattice, &mut filled);
    let (mut values, mut bits) = ([[0f32; 512]], [LeafBits::default()]);
    let background = 0.3;
    let looked = solid.fill_leaves(&mut Leaves {
        origins: &[origin],
        step: 0.17,
        by: 0.0,
        background,
        values: &mut values,
        bits: &mut bits,
    });
    assert!(looked.is_some());
    let Interval { lo, hi } = solid.bound(&lattice.span());
    for n in 0..512 {
        let single = solid.value(lattice.point(n)) as f32;
        assert_eq!(filled[n], single);
        assert_eq!(values[0][n], single.clamp(-background, background));
        assert!(lo - 1e-6 <= f64::from(single) && f64::from(single) <= hi + 1e-6);
    }
}

#[test]
fn balls_that_overlap_have_no_surface_inside() {
    let centres = [[0.0, 0.0, 0.0], [0.9, 0.2, 0.0], [0.3, 0.8, 0.4]].map(Vec3::from);
    let balls: Vec<TriMesh> = centres.iter().map(|&c| TriMesh::ball(c, 1.0, 4)).collect();
    let (solid, repairs) = MeshSolid::repaired(joined(&balls)).unwrap();
    assert_eq!(repairs.len(), 1);
    let mut noise = Noise::new(5);
    for _ in 0..2000 {
        let p = noise.vector() * 1.5;
        let least = centres.iter().map(|c| (p - c).norm() - 1.0);
        let least = least.fold(f64::INFINITY, f64::min);
        let d = solid.signed_distance(p);
        // Inside the least of the balls' distances is only a bound; facets are 0.004 within the balls.
        if least > 0.0 {
            assert!((d - least).abs() < 0.005, "{p:?} {d} {least}");
        } else {
            assert!(d < least + 0.005, "{p:?} {d} {least}");
        }
    }
}

#[test]
fn shells_of_their_own_are_turned_and_those_inside_are_not() {
    for (name, volume, pieces) in [
        ("good.stl", 2000.0, 2),
        ("one_of_two.stl", 2000.0, 2),
        ("two_of_three.stl", 3000.0, 3),
    ] {
        let found = report(0.25, &union(&format!("shell_inverted/{name}")));
        assert_near(found.solid.volume, volume, 0.01);
        assert_eq!(found.solid.components, pieces, "{name}");
        assert_eq!(codes(&found).contains(&"W103"), name != "good.stl");
    }
    // All of a hollow ball inside out is the hollow ball.
    let ball = |r: f64| TriMesh::ball(Vec3::zeros(), r, 3);
    let hollow = joined(&[ball(1.0), ball(0.5).flipped()]);
    let (turned, repairs) = MeshSolid::repaired(hollow.flipped()).unwrap();
    assert_eq!(repairs.len(), 1);
    assert_eq!(turned.mesh().volume(), hollow.volume());
    assert!(!turned.contains(Vec3::zeros()) && turned.contains(Vec3::new(0.7, 0.0, 0.0)));
}

/// A cavity may share a face, an edge, a corner or both ends with the shell that it lies in: it stays a cavity.
#[test]
fn cavities_that_touch_their_shell_stay_cavities() {
    let cuboid = |low: [f64; 3], high: [f64; 3]| {
        TriMesh::cuboid(&Aabb {
            min: low.into(),
            max: high.into(),
        })
    };
    let whole = cuboid([0.0; 3], [8.0; 3]);
    for (name, low, high) in [
        ("face", [2.0, 2.0, 0.0], [6.0, 6.0, 4.0]),
        ("edge", [2.0, 0.0, 0.0], [6.0, 4.0, 4.0]),
        ("corner", [0.0; 3], [4.0; 3]),
        ("bore", [3.0, 3.0, 0.0], [5.0, 5.0, 8.0]),
    ] {
        let cavity = cuboid(low, high);
        let right = whole.volume() - cavity.volume();
        let mesh = joined(&[whole.clone(), cavity.flipped()]);
        let (solid, repairs) = MeshSolid::repaired(mesh).unwrap();
        assert!(
            repairs.iter().all(|r| r.kind != RepairKind::Flipped),
            "{name}"
        );
        // By points on a lattice off all faces.
        let n = 32;
        let at = |i: usize| (i as f64 + 0.5) / f64::from(n as i32) * 8.0;
        let points = (0..n * n * n).map(|i| Vec3::new(at(i / n / n), at(i / n % n), at(i % n)));
        let inside = points.filter(|p| solid.contains(*p)).count();
        assert_near(inside as f64 / (n * n * n) as f64 * 512.0, right, 1e-12);
    }
    // A shell that touches from outside is none: it is turned.
    let beside = cuboid([8.0, 2.0, 2.0], [12.0, 6.0, 6.0]);
    let (solid, repairs) = MeshSolid::repaired(joined(&[whole, beside.flipped()])).unwrap();
    assert!(repairs.iter().any(|r| r.kind == RepairKind::Flipped));
    assert!(solid.contains(Vec3::new(10.0, 4.0, 4.0)));
}

#[test]
fn random_inward_shells_are_turned() {
    let mut noise = Noise::new(17);
    for _ in 0..10 {
        let inward: Vec<bool> = (0..6).map(|_| noise.signed() < 0.0).collect();
        let balls: Vec<TriMesh> = (0..6)
            .map(|n| {
                let ball = TriMesh::ball(Vec3::new(3.0 * n as f64, 0.0, 0.0), 1.0, 2);
                if inward[n] { ball.flipped() } else { ball }
            })
            .collect();
        let (solid, repairs) = MeshSolid::repaired(joined(&balls)).unwrap();
        assert_eq!(repairs.len(), usize::from(inward.contains(&true)));
        assert!((0..6).all(|n| solid.contains(Vec3::new(3.0 * n as f64, 0.1, 0.0))));
        assert_near(
            solid.mesh().volume(),
            6.0 * TriMesh::ball(Vec3::zeros(), 1.0, 2).volume(),
            1e-9,
        );
        let shells = check(&joined(&balls)).shells.unwrap();
        let count = inward.iter().filter(|i| **i).count();
        assert_eq!((shells.shells, shells.inward_shells), (6, count));
    }
}

#[test]
fn faces_that_wind_unlike_their_neighbours_are_turned() {
    for (name, volume) in [
        ("half_sphere.stl", 4047.0),
        ("cube_one_face.stl", 1000.0),
        ("cube_one_triangle.stl", 1000.0),
    ] {
        let name = format!("flipped_faces/{name}");
        let (solid, repairs) = solid(&name);
        assert_eq!(repairs, [RepairKind::Flipped]);
        assert_near(solid.mesh().volume(), volume, 1e-4);
        let found = report(0.25, &union(&name));
        assert_near(found.solid.volume, volume, 0.01);
        assert_eq!(codes(&found), ["W103"]);
    }
    let ball = TriMesh::ball(Vec3::zeros(), 1.0, 4);
    let mut noise = Noise::new(23);
    for share in [0.02, 0.3, 1.0] {
        let turned: Vec<bool> = ball
            .triangles()
            .iter()
            .map(|_| noise.signed() < 2.0 * share - 1.0)
            .collect();
        let (solid, repairs) = MeshSolid::repaired(with_turned(&ball, |n| turned[n])).unwrap();
        assert_eq!(repairs.len(), 1);
        assert_eq!(solid.mesh(), &ball);
    }
}

#[test]
fn a_check_tells_shells_apart() {
    let shells = |name: &str| check(&read_mesh(path(name)).unwrap().mesh).shells.unwrap();
    let boxes = shells("two_boxes.stl");
    assert_eq!((boxes.shells, boxes.overlapping_shells), (2, 2));
    let same = shells("nested_same.stl");
    assert_eq!((same.nested_shells, same.overlapping_shells), (1, 2));
    let hollow = shells("nested_reversed.stl");
    assert_eq!((hollow.nested_shells, hollow.overlapping_shells), (1, 0));
    let half = shells("flipped_faces/half_sphere.stl");
    assert_eq!((half.shells, half.inconsistent_faces), (1, 152));
    assert_eq!(shells("shell_inverted/two_of_three.stl").inward_shells, 2);
}

#[test]
fn a_cell_of_overlapping_shells_is_their_union() {
    let bar = |long: usize| {
        let half = Vec3::from_fn(|a, _| if a == long { 0.3 } else { 0.1 });
        Aabb {
            min: -half,
            max: half,
        }
    };
    let bars = [bar(0), bar(1), bar(2)];
    let mesh = joined(&bars.iter().map(TriMesh::cuboid).collect::<Vec<_>>());
    let source = Source::mesh(Element::Hex, &mesh, &Placement::Reference, Caps::Exclude).unwrap();
    assert!(source.warnings()[0].contains("3 of 3 shells"));
    let mut noise = Noise::new(29);
    for _ in 0..500 {
        let p = noise.vector() * 0.45;
        let (d, right) = (source.value(CellPoint(p)), union_of_boxes(&bars, p));
        assert!((d - right).abs() < 1e-4, "{p:?} {d} {right}");
    }
}

#[test]
fn signs_of_an_open_surface_are_those_of_its_solid_angles() {
    let ball = TriMesh::ball(Vec3::zeros(), 1.0, 4);
    let without = |is_left_out: &dyn Fn(usize, [Vec3; 3]) -> bool| {
        let all = ball.triangles().iter().zip(ball.iter_corners()).enumerate();
        let kept = all.filter(|(n, (_, corners))| !is_left_out(*n, *corners));
        let kept = kept.map(|(_, (t, _))| *t).collect();
        TriMesh::new(ball.vertices().to_vec(), kept).unwrap()
    };
    let mut noise = Noise::new(31);
    // Scattered holes, a large one, and triangles that share no vertex.
    let scattered = without(&|n, _| n % 97 == 0);
    let bowl = without(&|_, t| t[0].z + t[1].z + t[2].z > 1.8);
    let corners = ball.iter_corners().flatten();
    let loose: Vec<Vec3> = corners.map(|p| p + noise.vector() * 1e-3).collect();
    let numbers = (0..loose.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    let loose = TriMesh::new(loose, numbers.collect()).unwrap();
    for open in [scattered, bowl, loose] {
        let (solid, _) = MeshSolid::repaired(open.clone()).unwrap();
        for _ in 0..300 {
            let p = noise.vector() * 1.3;
            let sum: f64 = open.iter_corners().map(|t| solid_angle(t, p)).sum();
            let right = sum / (4.0 * std::f64::consts::PI);
            assert!((solid.winding_number(p) - right).abs() < 0.005);
            if (right - 0.5).abs() > 0.005 {
                assert_eq!(solid.contains(p), right > 0.5, "{p:?} {right}");
            }
        }
        for _ in 0..6 {
            assert_lattice_agrees(&solid, 1.2, &mut noise);
        }
        // Where patches that close the large hole may lie.
        let centre = Vec3::new(0.0, 0.0, 0.6);
        for n in 0..50 {
            let p = centre + Vec3::new(f64::from(n % 7), f64::from(n % 5), 0.0) * 0.05;
            let sum: f64 = open.iter_corners().map(|t| solid_angle(t, p)).sum();
            let right = sum / (4.0 * std::f64::consts::PI);
            assert!((solid.winding_number(p) - right).abs() < 0.005, "{p:?}");
        }
    }
}

/// The solid angle of a triangle, positive seen from behind.
fn solid_angle(t: [Vec3; 3], p: Vec3) -> f64 {
    let [a, b, c] = t.map(|v| v - p);
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let over = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    2.0 * a.dot(&b.cross(&c)).atan2(over)
}
