//! Laws of meshes: manifold wherever walls lie, exact where a field is at hand, sharp at creases.

use super::{complement, cube, intersection, level_set, session, union};
use druse::field::{BoxSolid, Capsule, Field, HalfSpace, Intersection, Sphere, WorldField};
use druse::frame::{Aabb, Vec3, WorldPoint};
use druse::mesh::{MeshReport, ProjectionOptions, QuadMesh, check};
use druse::progress::Silent;

fn quads(field: &WorldField, half_edge: f64, h: f64) -> QuadMesh {
    let solid = level_set(field, cube(half_edge), h);
    solid.to_quads(0.0, session()).unwrap()
}

fn words(mesh: &QuadMesh) -> MeshReport {
    check(&mesh.triangulated())
}

fn assert_sound(mesh: &QuadMesh, what: &str) {
    let report = words(mesh);
    let sound = report.is_closed() && report.is_oriented() && report.is_manifold();
    assert!(sound, "{what}: {report}");
    assert_eq!(report.degenerate.count, 0, "{what}: {report}");
}

fn slab(least: [f64; 3], greatest: [f64; 3]) -> BoxSolid {
    BoxSolid(Aabb::of([least.into(), greatest.into()]))
}

/// Boxes whose walls lie in planes of voxels, meeting in edges, touching in edges and corners.
#[test]
fn walls_in_planes_of_voxels_give_manifold_meshes() {
    let plain = slab([-2.0; 3], [2.0; 3]);
    let step = union(plain, slab([0.0, 0.0, 0.0], [3.0, 3.0, 3.0]));
    let touching = union(slab([-2.0; 3], [0.0; 3]), slab([0.0; 3], [2.0; 3]));
    let along_an_edge = union(
        slab([-2.0, -2.0, -2.0], [0.0, 0.0, 2.0]),
        slab([0.0, 0.0, -2.0], [2.0, 2.0, 2.0]),
    );
    let frame = intersection(plain, complement(slab([-1.0, -1.0, -3.0], [1.0, 1.0, 3.0])));
    let slit = intersection(plain, complement(slab([-3.0, -0.0, -3.0], [3.0, 0.5, 1.0])));
    let fields: [(&str, &WorldField); 6] = [
        ("box", &plain),
        ("step", &step),
        ("touching in a corner", &touching),
        ("touching along an edge", &along_an_edge),
        ("frame", &frame),
        ("slit", &slit),
    ];
    for (name, field) in fields {
        for h in [0.5, 0.25, 0.125] {
            let mesh = quads(field, 3.0, h);
            assert_sound(&mesh, &format!("{name} at {h}"));
        }
    }
}

#[test]
fn projected_vertices_lie_on_the_exact_surface() {
    let ball = Sphere {
        centre: Vec3::new(0.1, 0.2, -0.3),
        radius: 3.0,
    };
    let h = 0.5;
    let mut mesh = quads(&ball, 4.0, h);
    let error = |m: &QuadMesh| {
        let depth = m
            .vertices()
            .iter()
            .map(|&v| ball.value(WorldPoint(v)).abs());
        depth.fold(0.0, f64::max)
    };
    let before = error(&mesh);
    let how = ProjectionOptions {
        voxel_size: h,
        sharp: false,
    };
    let found = mesh.project(&ball, how, &Silent).unwrap();
    // Linear interpolation between voxels errs by h^2 / 8 over the radius, in the mean over a cell.
    assert!(before > 1e-3 * h, "{before}");
    assert!(
        error(&mesh) < 1e-7 * h && found.error < 1e-7 * h,
        "{found:?}"
    );
    assert_eq!((found.kept, found.creased), (0, 0));
    assert_sound(&mesh, "ball");
}

/// The share of a solid's volume that a mesh lacks or has too much.
fn volume_error(mesh: &QuadMesh, exact: f64) -> f64 {
    (mesh.triangulated().volume() / exact - 1.0).abs()
}

#[test]
fn sharp_meshes_have_the_edges_and_corners_of_their_solids() {
    // Not in planes of voxels, and none parallel to another.
    let normals = [
        [1.0, 0.2, 0.1],
        [-0.9, 0.3, -0.1],
        [0.1, 1.0, -0.2],
        [0.2, -1.0, 0.1],
        [-0.1, 0.2, 1.0],
        [0.1, 0.1, -1.0],
    ];
    let half = |n: [f64; 3]| {
        let normal = Vec3::from(n).normalize();
        HalfSpace {
            point: normal * 1.7,
            normal,
        }
    };
    let faces = normals.map(|n| Box::new(half(n)) as Box<WorldField>);
    let solid = Intersection(faces.into());
    let h = 0.2;
    let mut mesh = quads(&solid, 3.0, h);
    let blunt = mesh.triangulated().volume();
    let how = ProjectionOptions {
        voxel_size: h,
        sharp: true,
    };
    let found = mesh.project(&solid, how, &Silent).unwrap();
    assert_sound(&mesh, "polyhedron");
    assert!(found.creased > 100 && found.error < 1e-6, "{found:?}");
    // Every corner of the polyhedron is a vertex of the mesh.
    let planes = normals.map(half);
    let mut corners = 0;
    for a in 0..6 {
        for b in a + 1..6 {
            for c in b + 1..6 {
                let rows = [a, b, c].map(|i| planes[i].normal.transpose());
                let m = nalgebra::Matrix3::from_rows(&rows);
                let Some(inverse) = m.try_inverse() else {
                    continue;
                };
                let corner = inverse * Vec3::repeat(1.7);
                let on = solid.value(WorldPoint(corner)).abs() < 1e-9;
                if !on {
                    continue;
                }
                corners += 1;
                let near = mesh.vertices().iter().map(|v| (v - corner).norm());
                let least = near.fold(f64::INFINITY, f64::min);
                assert!(least < 1e-6, "corner {corner:?}: {least}");
            }
        }
    }
    assert_eq!(corners, 8);
    // What the bevels cut away is back: flat faces between right edges give the volume to rounding.
    let exact = polyhedron_volume(&planes);
    assert!(
        volume_error(&mesh, exact) < 1e-3,
        "{} {exact}",
        mesh.triangulated().volume()
    );
    assert!((blunt / exact - 1.0).abs() > 1e-3, "{blunt} {exact}");
}

/// By the divergence theorem over a fine mesh of the same planes: a third of distance times area.
fn polyhedron_volume(planes: &[HalfSpace]) -> f64 {
    planes
        .iter()
        .map(|face| {
            let n = face.normal;
            let u = n.cross(&Vec3::new(0.3, 0.5, 0.8)).normalize();
            let v = n.cross(&u);
            let mut polygon = vec![(-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0)];
            for other in planes.iter().filter(|o| o.normal != n) {
                let at = |p: (f64, f64)| {
                    (face.point + u * p.0 + v * p.1 - other.point).dot(&other.normal)
                };
                let mut kept = Vec::new();
                for i in 0..polygon.len() {
                    let (p, q) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                    let (a, b) = (at(p), at(q));
                    if a <= 0.0 {
                        kept.push(p);
                    }
                    if (a < 0.0) != (b < 0.0) {
                        let t = a / (a - b);
                        kept.push((p.0 + t * (q.0 - p.0), p.1 + t * (q.1 - p.1)));
                    }
                }
                polygon = kept;
            }
            let twice: f64 = (0..polygon.len())
                .map(|i| {
                    let (p, q) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                    p.0 * q.1 - p.1 * q.0
                })
                .sum();
            face.point.dot(&n) * twice.abs() / 2.0 / 3.0
        })
        .sum()
}

#[test]
fn sharp_curves_run_where_surfaces_meet() {
    // A rod through a ball: the edge is a circle.
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius: 3.0,
    };
    let rod = Capsule {
        ends: [Vec3::new(-9.0, 0.0, 0.0), Vec3::new(9.0, 0.0, 0.0)],
        radius: 1.3,
    };
    let solid = intersection(ball, complement(rod));
    let h = 0.2;
    let mut mesh = quads(&solid, 4.0, h);
    let how = ProjectionOptions {
        voxel_size: h,
        sharp: true,
    };
    let found = mesh.project(&solid, how, &Silent).unwrap();
    assert_sound(&mesh, "napkin ring");
    let on_edge = |v: &Vec3| {
        let r = v.yz().norm();
        (r - 1.3).abs() < 1e-4 && (v.norm() - 3.0).abs() < 1e-4
    };
    let around = mesh.vertices().iter().filter(|v| on_edge(v)).count();
    // Two circles of radius 1.3, a vertex for each voxel that they cross: at least one an edge of h.
    let least = 2.0 * std::f64::consts::TAU * 1.3 / h;
    assert!(around as f64 > 0.9 * least, "{around} {least} {found:?}");
    // A ring of height H is 4/3 pi (H / 2)^3, whatever the ball.
    let half_height = (9.0f64 - 1.69).sqrt();
    let exact = 4.0 / 3.0 * std::f64::consts::PI * half_height.powi(3);
    assert!(
        volume_error(&mesh, exact) < 4e-3,
        "{}",
        mesh.triangulated().volume()
    );
}
